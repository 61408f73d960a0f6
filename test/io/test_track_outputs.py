"""Tracks in the messages of others: values, units, covariances, and their way through a bag."""

import math
import uuid

import numpy as np
import pytest

from gda_tracker.io.bag_types import type_store
from gda_tracker.io.bags import BagTopic, BagWriter, read_bag
from gda_tracker.io.track_output_parameters import TrackOutputParameters
from gda_tracker.io.track_outputs import (
    FORMATS,
    MOVING_THRESHOLD,
    UNKNOWN_ANGLE_VARIANCE,
    UNKNOWN_VARIANCE,
    bag_message,
    detections_3d,
    radar_tracks,
    tracked_objects,
)
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks

UUID = bytes(range(16))
STATE = np.array([[100.0, -50.0, 3.0, 4.0], [7.0, 8.0, 0.1, 0.0], [1.0, 2.0, 5.0, 0.0]])
SPREAD = np.array(
    [[4.0, 1.0, 0.5, 0.0], [1.0, 9.0, 0.0, 0.5], [0.5, 0.0, 0.2, 0.05], [0.0, 0.5, 0.05, 0.1]]
)


def tracks(**fields):
    values = {
        "key": ScanKey(1, "radar", 12_345_678_901),
        "frame_id": "map",
        "system_uuid": UUID,
        "track_id": np.array([5, 6, 9]),
        "status": np.array([1, 1, 0]),
        "mean": STATE,
        "covariance": np.tile(SPREAD, (3, 1, 1)),
        "class_names": ("false_alarm", "fighter", "cargo"),
        "class_probability": np.array([[0.1, 0.2, 0.7], [0.0, 0.6, 0.4], [0.2, 0.4, 0.4]]),
    }
    return Tracks(**{**values, **fields})


def table(**values):
    return from_mapping(TrackOutputParameters, values)


def test_radar_tracks():
    p = table(
        radar_classes=["cargo=32002", "fighter=7"], object_size_m=[4.0, 2.0, 1.5], height_m=2.0
    )
    found = radar_tracks(tracks(), p, bag_message)
    assert (found.header.frame_id, found.header.stamp.sec, found.header.stamp.nanosec) == (
        "map",
        12,
        345_678_901,
    )
    first, second = found.tracks  # the third is tentative
    assert (first.position.x, first.position.y, first.position.z) == (100.0, -50.0, 2.0)
    assert (first.velocity.x, first.velocity.y, first.velocity.z) == (3.0, 4.0, 0.0)
    assert (first.classification, second.classification) == (32002, 7)
    np.testing.assert_allclose(first.position_covariance, [4.0, 1.0, 0.0, 9.0, 0.0, 100.0])
    expected = [0.2, 0.05, 0.0, 0.1, 0.0, UNKNOWN_VARIANCE]
    np.testing.assert_allclose(first.velocity_covariance, expected, rtol=1e-6)
    assert first.position_covariance.dtype == np.float32
    assert (first.size.x, first.size.y, first.size.z) == (4.0, 2.0, 1.5)
    identity = uuid.uuid5(uuid.UUID(bytes=UUID), "5").bytes
    assert bytes(first.uuid.uuid) == identity
    assert bytes(second.uuid.uuid) != identity


def test_what_a_radar_gave_out_can_be_read_in_again():
    from gda_tracker.io.radar.messages import RADAR_TRACKS, frame_of_message

    frame = frame_of_message(radar_tracks(tracks(), table(), bag_message), RADAR_TRACKS)
    assert frame.stamp_ns == 12_345_678_901
    read = frame.read(["x", "y"], {})
    np.testing.assert_allclose(read["x"], STATE[:2, 0])
    np.testing.assert_allclose(read["y"], STATE[:2, 1])


def test_detections_in_space():
    p = table(vision_classes=["cargo=truck"], height_m=1.0, height_std_m=0.5)
    found = detections_3d(tracks(), p, bag_message)
    assert [item.id for item in found.detections] == ["5", "6"]
    first, second = found.detections
    assert [r.hypothesis.class_id for r in first.results] == ["false_alarm", "fighter", "truck"]
    np.testing.assert_allclose([r.hypothesis.score for r in first.results], [0.1, 0.2, 0.7])
    covariance = first.results[0].pose.covariance.reshape(6, 6)
    np.testing.assert_allclose(covariance[:2, :2], SPREAD[:2, :2])
    assert covariance[2, 2] == 0.25
    assert covariance[3, 3] == UNKNOWN_ANGLE_VARIANCE
    turn = first.bbox.center.orientation
    assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(math.atan2(4.0, 3.0))
    # The direction of a velocity, differentiated: d yaw = (vx dvy - vy dvx) / v2.
    gradient = np.array([-4.0, 3.0]) / 25.0
    assert covariance[5, 5] == pytest.approx(gradient @ SPREAD[2:, 2:] @ gradient)
    # A track that may stand still has no direction.
    assert (second.bbox.center.orientation.z, second.bbox.center.orientation.w) == (0.0, 1.0)
    assert second.results[0].pose.covariance.reshape(6, 6)[5, 5] == UNKNOWN_ANGLE_VARIANCE
    assert second.header.frame_id == "map"


def test_tracked_objects():
    p = table(autoware_classes=["cargo=TRUCK", "fighter=TRUCK"], tentative=True)
    found = tracked_objects(tracks(), p, bag_message)
    first, second, third = found.objects
    assert [o.existence_probability for o in found.objects] == [1.0, 1.0, 0.5]
    told = tracks(existence_probability=np.array([0.99, 0.9, 0.25]))
    again = tracked_objects(told, p, bag_message).objects
    assert [o.existence_probability for o in again] == [0.99, 0.9, 0.25]
    probabilities = {c.label: c.probability for c in first.classification}
    assert probabilities == pytest.approx({0: 0.1, 2: 0.9})
    twist = first.kinematics.twist_with_covariance
    assert twist.twist.linear.x == pytest.approx(5.0)  # along its own axis
    assert twist.twist.linear.y == pytest.approx(0.0, abs=1e-12)
    along = np.array([0.6, 0.8])
    covariance = twist.covariance.reshape(6, 6)
    assert covariance[0, 0] == pytest.approx(along @ SPREAD[2:, 2:] @ along)
    assert covariance[2, 2] == UNKNOWN_VARIANCE
    assert np.trace(covariance[:2, :2]) == pytest.approx(np.trace(SPREAD[2:, 2:]))
    assert first.kinematics.orientation_availability == 2
    assert second.kinematics.orientation_availability == 0
    assert (first.kinematics.is_stationary, second.kinematics.is_stationary) == (False, True)
    assert second.kinematics.twist_with_covariance.twist.linear.x == pytest.approx(0.1)
    assert not third.kinematics.is_stationary
    v = STATE[1, 2:]
    assert v @ np.linalg.solve(SPREAD[2:, 2:], v) < MOVING_THRESHOLD


def test_without_belief_the_class_is_unknown():
    plain = tracks(class_names=(), class_probability=np.zeros((3, 0)))
    p = table(radar_classes=["cargo=3"])
    assert [t.classification for t in radar_tracks(plain, p, bag_message).tracks] == [0, 0]
    (result,) = detections_3d(plain, p, bag_message).detections[0].results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("", 1.0)
    (label,) = tracked_objects(plain, p, bag_message).objects[0].classification
    assert (label.label, label.probability) == (0, 1.0)


@pytest.mark.parametrize("name", FORMATS)
def test_all_formats_go_through_a_bag_with_and_without_tracks(name, tmp_path):
    kind, convert = FORMATS[name]
    none = tracks(
        track_id=np.zeros(0, dtype=np.int64),
        status=np.zeros(0, dtype=np.int64),
        mean=np.zeros((0, 4)),
        covariance=np.zeros((0, 4, 4)),
        class_probability=np.zeros((0, 3)),
    )
    sent = [convert(one, table(), bag_message) for one in (tracks(), none)]
    with BagWriter(tmp_path / "bag", [BagTopic(name, kind)]) as bag:
        for number, message in enumerate(sent):
            bag.write(name, message, number)
    store = type_store()
    for record, message in zip(read_bag(tmp_path / "bag"), sent, strict=True):
        assert record.type == kind
        again = store.serialize_cdr(record.message(), kind)
        assert bytes(again) == bytes(store.serialize_cdr(message, kind))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"radar_classes": ["car=-1"]}, "radar_classes: car=-1, allowed is an integer >= 0"),
        ({"radar_classes": ["car=70000"]}, "allowed is an integer >= 0 and <= 65535"),
        ({"autoware_classes": ["car=VAN"]}, "autoware_classes: car=VAN, allowed is one of UNKNOWN"),
        ({"vision_classes": ["car"]}, "vision_classes: 'car', allowed are entries class=name"),
        ({"vision_classes": ["a=b", "a=c"]}, "entries class=name that differ"),
        ({"object_size_m": [1.0]}, "object_size_m = .*allowed are 3 numbers"),
    ],
)
def test_mappings_that_are_none_are_refused(values, text):
    with pytest.raises(ParameterError, match=text):
        table(**values)
