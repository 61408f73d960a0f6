"""Bags with odometry: what stands still does so for a car that drives and turns."""

from collections import Counter

import numpy as np
import pytest
from odometry_examples import (
    MOUNTING,
    POSTS,
    WALKER_MPS,
    S,
    columns_at,
    odometry_message,
)
from test_transform_bags import tf, transform

from gda_tracker.io.adapters import InputOptions, load_recording
from gda_tracker.io.adapters.adapter import RecordingError
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.odometry_messages import take_odometry
from gda_tracker.io.radar.parameter_groups.motion import ODOMETRY, TWIST, TWIST_WITH_COVARIANCE
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.io.transform_messages import TF_MESSAGE
from gda_tracker.kinematics.odometry_buffer import OdometryBuffer
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking.ring import Ring

RADAR = {"sensor_id": "corner", "moving_above_mps": 0.0, **MOUNTING}
FROM_ODOMETRY = {**RADAR, "sensor_motion": "odometry", "range_rate_reference": "ground"}
ON_THE_MAP = {**FROM_ODOMETRY, "pose_source": "odometry"}
TOPICS = {ODOMETRY: "/odom", TWIST: "/twist", TWIST_WITH_COVARIANCE: "/twist_covariance"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Four seconds of driving; the odometry comes at 50 Hz, with a hole of 0.7 s near the end."""
    path = tmp_path_factory.mktemp("drive") / "bag"
    topics = [BagTopic(name, kind) for kind, name in TOPICS.items()]
    topics += [BagTopic("/points", "sensor_msgs/msg/PointCloud2")]
    topics += [BagTopic("/tf_static", TF_MESSAGE, transient_local=True)]
    with BagWriter(path, topics) as writer:
        yaw = np.deg2rad(MOUNTING["sensor_roll_pitch_yaw_deg"][2])
        x, y, _ = MOUNTING["sensor_position_m"]
        writer.write("/tf_static", tf(transform("base_link", "radar", 0, x, y, yaw)), 0)
        for k in range(-5, 206):
            seconds = 10.0 + 0.02 * k
            if 13.2 < seconds < 13.9:
                continue
            for kind, name in TOPICS.items():
                writer.write(name, odometry_message(seconds, kind), round(seconds * S))
        for k in range(41):
            seconds = 10.003 + 0.1 * k
            stamp_ns = round(seconds * S)
            columns = columns_at(seconds)
            types = dict.fromkeys(columns, "float32")
            message = point_cloud_of_columns(columns, types, stamp_ns, "radar")
            writer.write("/points", message, stamp_ns)
    return path


def load(bag, table):
    return load_recording(bag, "auto", InputOptions(None, "none", table))


def still_share(recording):
    (note,) = (line for line in recording.notes if line.startswith("standing still"))
    return float(note.split(":")[1].split("%")[0]) / 100.0


def test_posts_stand_still_with_odometry_and_move_without(bag):
    with_it = load(bag, {**FROM_ODOMETRY, "moving_above_mps": 0.2})
    # The walker goes round to where his range rate is small.
    assert still_share(with_it) > 0.98
    assert {len(scan.range_m) for scan in with_it.detections} <= {0, 1}
    assert sum(len(scan.range_m) for scan in with_it.detections) > 20
    without = load(bag, {**RADAR, "range_rate_reference": "ground", "moving_above_mps": 0.2})
    assert still_share(without) < 0.1


def test_without_the_lever_arm_the_turn_of_the_car_is_left_over(bag):
    """At 0.25 rad/s and 2 m the sensor moves by half a metre a second to the side."""
    bare = {**FROM_ODOMETRY, "sensor_position_m": [0.0, 0.0, 0.0], "moving_above_mps": 0.2}
    assert still_share(load(bag, bare)) < 0.9


@pytest.fixture(scope="module")
def declared(bag):
    """Scans with the speed of the odometry and the declared mounting pose."""
    return load(bag, FROM_ODOMETRY).detections


@pytest.mark.parametrize("kind", [TWIST, TWIST_WITH_COVARIANCE])
def test_twists_alone_tell_the_speed_as_well(bag, declared, kind):
    table = {**FROM_ODOMETRY, "odometry_topic": TOPICS[kind].lstrip("/")}
    for one, other in zip(load(bag, table).detections, declared, strict=True):
        np.testing.assert_array_equal(one.range_rate_mps, other.range_rate_mps)


def test_the_mounting_pose_may_come_from_tf(bag, declared):
    of_tf = {"sensor_id": "corner", "sensor_motion": "odometry", "pose_source": "tf",
             "tracking_frame": "base_link", "range_rate_reference": "ground"}  # fmt: skip
    for one, other in zip(load(bag, of_tf).detections, declared, strict=True):
        np.testing.assert_allclose(one.range_rate_mps, other.range_rate_mps, atol=1e-9)
        np.testing.assert_allclose(one.sensor_position_m[:2], other.sensor_position_m[:2])


def test_with_the_pose_of_the_odometry_posts_and_walker_are_tracked_on_the_map(bag):
    recording = load(bag, ON_THE_MAP)
    manager = {"attribute_term": "none", "range_std_m": 0.3, "max_speed_mps": 20.0,
               "azimuth_std_rad": 0.005, "process_noise_std_mps2": 0.5}  # fmt: skip
    ring = Ring({"track_manager": manager})
    for scan in recording.detections[:32]:
        tracks = ring.process(scan).tracks
    speed = np.hypot(*tracks.mean[:, 2:4].T)
    confirmed = tracks.status == 1
    found = np.linalg.norm(tracks.mean[:, None, :2] - POSTS, axis=2).min(axis=0)
    assert np.mean(found < 1.0) > 0.9
    assert np.median(speed[confirmed]) < 0.3
    walkers = confirmed & (speed > 2.0)
    assert np.count_nonzero(walkers) == 1
    np.testing.assert_allclose(tracks.mean[walkers][0, 2:4], [WALKER_MPS, 0.0], atol=0.5)


def test_scans_in_a_hole_of_the_odometry_are_left_out_with_the_reason(bag):
    recording = load(bag, FROM_ODOMETRY)
    assert len(recording.detections) == 41 - 7
    text = "\n".join(recording.warnings)
    assert "lie between two reports, more than 0.5 s" in text
    assert "2 more frames are left out" in text
    assert len(load(bag, {**FROM_ODOMETRY, "odometry_gap_s": 1.0}).detections) == 41


def test_a_topic_or_frame_that_is_not_there_is_named(bag, tmp_path):
    with pytest.raises(RecordingError, match=r"'wheel': allowed is one of /odom, /twist, /twist_"):
        load(bag, {**FROM_ODOMETRY, "odometry_topic": "wheel"})
    with pytest.raises(RecordingError, match=r"'points' \(sensor_msgs/msg/PointCloud2\): allowed"):
        load(bag, {**FROM_ODOMETRY, "odometry_topic": "points"})
    with pytest.raises(RecordingError, match="no odometry has come yet"):
        load(bag, {**ON_THE_MAP, "tracking_frame": "odom"})
    with pytest.raises(RecordingError, match="no odometry has come yet"):
        load(bag, {**FROM_ODOMETRY, "odometry_frame": "trailer"})
    with pytest.raises(RecordingError, match="pose_source is odometry, but only twists come"):
        load(bag, {**ON_THE_MAP, "odometry_topic": "twist"})
    path = tmp_path / "plots.csv"
    path.write_text("time_s,range_m,azimuth_deg\n0.0,10.0,5.0\n")
    with pytest.raises(RecordingError, match="sensor_motion = 'odometry' are for bags"):
        load_recording(path, "auto", InputOptions(None, None, FROM_ODOMETRY))


def test_every_message_that_is_not_taken_is_counted():
    counts = Counter()
    table = from_mapping(RadarInputParameters, {**ON_THE_MAP, "odometry_frame": "base_link"})
    buffer = OdometryBuffer()
    early, nan, crooked = (odometry_message(1.0) for _ in range(3))
    early.header.stamp.sec = -1
    nan.twist.twist.angular.z = float("nan")
    crooked.pose.pose.orientation.w = 3.0
    for message, kind, said in (
        (early, ODOMETRY, "header.stamp = -1 s"),
        (nan, ODOMETRY, "numbers that are none"),
        (crooked, ODOMETRY, "numbers that are none"),
        (odometry_message(1.0, parent="odom"), ODOMETRY, "told in odom, tracks in map"),
        (odometry_message(1.0, child="trailer"), ODOMETRY, "odometry_frame is base_link"),
        (odometry_message(1.0, child=""), ODOMETRY, "it is of (no frame)"),
        (odometry_message(1.0, TWIST, child="trailer"), TWIST, "it is of trailer, parameter"),
        (odometry_message(5.0), ODOMETRY, ""),
        (odometry_message(1.0), ODOMETRY, ""),
    ):
        found = take_odometry(buffer, message, kind, table, counts)
        assert said in found
        assert bool(said) == bool(found)
    assert counts == {
        "odometry_received": 9,
        "odometry_refused": 3,
        "odometry_unknown_frame": 4,
        "odometry_jumped_back": 1,
    }
    # Where the pose is not asked for, it may be anything.
    speed_alone = from_mapping(RadarInputParameters, FROM_ODOMETRY)
    assert take_odometry(OdometryBuffer(), crooked, ODOMETRY, speed_alone, Counter()) == ""


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"pose_source": "odometry", "tracking_frame": ""}, "pose_source odometry needs a frame"),
        ({"sensor_motion": "odometry", "odometry_topic": ""}, "odometry_topic is empty"),
        ({"pose_source": "odometry", "odometry_type": TWIST}, "a twist tells no pose"),
        ({"odometry_type": "nav_msgs/msg/Path"}, "odometry_type = 'nav_msgs/msg/Path': allowed"),
        ({"odometry_gap_s": 0.0}, "odometry_gap_s = 0.0: allowed is a number >= 0.001"),
    ],
)
def test_wrong_parameters_of_odometry_are_named(values, text):
    with pytest.raises(ParameterError) as caught:
        from_mapping(RadarInputParameters, values)
    assert text in str(caught.value)
