"""Radar bags with ``/tf``: the pose of every scan is that of its own time."""

import math

import numpy as np
import pytest

from gda_tracker.io.adapters import InputOptions, load_recording
from gda_tracker.io.adapters.adapter import RecordingError
from gda_tracker.io.bag_types import type_store
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.io.transform_messages import TF_MESSAGE
from gda_tracker.tracking.ring import Ring

S = 1_000_000_000
RADAR = {"pose_source": "tf", "sensor_id": "mast", "maximum_range_m": 5000.0}
TARGET = np.array([400.0, 300.0])
LATCHED = BagTopic("/tf_static", TF_MESSAGE, transient_local=True)


def transform(parent, child, stamp_ns, x=0.0, y=0.0, yaw=0.0):
    types = type_store().types
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, S)), parent
    )
    return types["geometry_msgs/msg/TransformStamped"](
        header,
        child,
        types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](x, y, 0.0),
            types["geometry_msgs/msg/Quaternion"](
                0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)
            ),
        ),
    )


def tf(*transforms):
    return type_store().types[TF_MESSAGE](list(transforms))


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A ship sails East at 8 m/s and turns; its radar, 2 m before its centre, sees a buoy."""
    path = tmp_path_factory.mktemp("sea") / "bag"
    cloud = BagTopic("/points", "sensor_msgs/msg/PointCloud2")
    with BagWriter(path, [BagTopic("/tf", TF_MESSAGE), LATCHED, cloud]) as writer:
        writer.write("/tf_static", tf(transform("ship", "radar", 0, x=2.0)), 0)
        for k in range(41):
            east, yaw = 2.0 * k, 0.02 * k
            moved = transform("map", "ship", k * S // 4, x=east, yaw=yaw)
            writer.write("/tf", tf(moved), k * S // 4)
        for k in range(1, 20):
            stamp_ns = k * S // 2 + S // 8
            position = 2.0 * stamp_ns / (S / 4)
            yaw = 0.02 * stamp_ns / (S / 4)
            ahead = np.array([math.cos(yaw), math.sin(yaw)])
            seen = TARGET - [position, 0.0] - 2.0 * ahead
            x, y = ahead @ seen, ahead[0] * seen[1] - ahead[1] * seen[0]
            columns = {"x": np.array([x]), "y": np.array([y])}
            message = point_cloud_of_columns(
                columns, dict.fromkeys("xy", "float32"), stamp_ns, "radar"
            )
            writer.write("/points", message, stamp_ns)
    return path


def test_what_stands_still_does_so_for_a_radar_that_moves_and_turns(bag):
    recording = load_recording(bag, "auto", InputOptions(None, "none", RADAR))
    assert not recording.warnings
    assert len(recording.detections) == 19
    ring = Ring({"track_manager": {"attribute_term": "none", "range_std_m": 1.0}})
    for scan in recording.detections:
        tracks = ring.process(scan).tracks
    (mean,) = tracks.mean
    np.testing.assert_allclose(mean[:2], TARGET, atol=1.0)
    assert np.hypot(*mean[2:4]) < 0.5


def test_without_the_poses_it_seems_to_move(bag):
    declared = {"sensor_id": "mast"}
    recording = load_recording(bag, "auto", InputOptions(None, "none", declared))
    ring = Ring({"track_manager": {"attribute_term": "none", "range_std_m": 1.0}})
    for scan in recording.detections:
        tracks = ring.process(scan).tracks
    assert not len(tracks) or np.hypot(*tracks.mean[0, 2:4]) > 5.0


def test_a_frame_that_no_transform_names(bag):
    with pytest.raises(RecordingError, match=r"no scan could be read.*odom: no transform names it"):
        load_recording(bag, "auto", InputOptions(None, "none", {**RADAR, "tracking_frame": "odom"}))


def test_files_without_transforms_say_so(tmp_path):
    path = tmp_path / "plots.csv"
    path.write_text("time_s,range_m,azimuth_deg\n0.0,10.0,5.0\n")
    with pytest.raises(RecordingError, match="pose_source and sensor_motion = 'tf' are for bags"):
        load_recording(path, "auto", InputOptions(None, None, RADAR))
