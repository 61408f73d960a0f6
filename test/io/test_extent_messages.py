"""Extended objects in messages: every bit comes back, and contradictions are refused."""

from __future__ import annotations

import dataclasses

import message_examples as examples
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from gda_tracker.io.belief_messages import predictions_from_message, predictions_to_message
from gda_tracker.io.extended_input import fault_of_clusters
from gda_tracker.io.fields import MessageError
from gda_tracker.io.markers import shapes
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.io.parameter_files import ParameterFileError, read_parameter_file
from gda_tracker.io.scan_messages import (
    scan_from_message,
    scan_report_from_message,
    scan_report_to_message,
    scan_to_message,
    scan_truth_from_message,
    scan_truth_to_message,
)
from gda_tracker.io.track_cdr import tracks_to_cdr
from gda_tracker.io.track_messages import tracks_from_message, tracks_to_message


def there_and_back(message):
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize("count", [0, 1, 4])
def test_cells(count):
    scan = examples.scan_of_cells(count)
    found = scan_from_message(there_and_back(scan_to_message(scan)))
    examples.assert_identical(found.cells, scan.cells)
    examples.assert_identical(
        dataclasses.replace(found, cells=None), dataclasses.replace(scan, cells=None)
    )


@pytest.mark.parametrize("count", [0, 3])
def test_predicted_extents(count):
    told = examples.extended_predictions(count)
    found = predictions_from_message(there_and_back(predictions_to_message(told)))
    examples.assert_identical(found.extents, told.extents)


@pytest.mark.parametrize("count", [1, 4])
def test_tracks_also_written_straight_to_bytes(count):
    tracks = examples.extended_tracks(count)
    message = tracks_to_message(tracks)
    examples.assert_identical(tracks_from_message(there_and_back(message)), tracks)
    straight = deserialize_message(tracks_to_cdr(tracks), type(message))
    examples.assert_identical(tracks_from_message(straight), tracks)


def test_report_and_truth():
    report = dataclasses.replace(examples.scan_report(), cells=5, partition_probability=0.875)
    found = scan_report_from_message(there_and_back(scan_report_to_message(report)))
    examples.assert_identical(found, report)
    truth = dataclasses.replace(
        examples.scan_truth(), target_extent=examples.floats(3, 2, 2, seed=31)
    )
    found = scan_truth_from_message(there_and_back(scan_truth_to_message(truth)))
    examples.assert_identical(found, truth)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("cell_count", [1, 2], "cell_count has 2"),
        ("cell_count", [1, 0, 3], "cell_count holds 0"),
        ("cell_scatter", [1.0], "cell_scatter has 1"),
        ("cell_member", [1], "cell_member has 1"),
        ("partition_probability", [], "partition_probability has none"),
    ],
)
def test_scans_that_contradict_themselves(name, value, text):
    message = scan_to_message(examples.scan_of_cells())
    setattr(message, name, value)
    with pytest.raises(MessageError, match=text):
        scan_from_message(message)


def test_predictions_and_tracks_that_contradict_themselves():
    message = predictions_to_message(examples.extended_predictions())
    message.extent_weight = [1.0]
    with pytest.raises(MessageError, match="extent_weight has 1"):
        predictions_from_message(message)
    message = tracks_to_message(examples.extended_tracks())
    message.detection_rows = [1]
    with pytest.raises(MessageError, match="detection_rows has 1"):
        tracks_from_message(message)
    message.detection_counts = []
    with pytest.raises(MessageError, match="detection_counts has none"):
        tracks_from_message(message)


def test_a_marker_is_as_large_as_the_object():
    tracks = examples.extended_tracks(1)
    tracks.mean[:] = [10.0, 20.0, 1.0, 0.0]
    tracks.covariance[:] = np.eye(4)
    tracks.class_probability[:] = [0.2, 0.3, 0.5]
    tracks.existence_probability[:] = 0.5
    tracks.status[:] = 1
    tracks.extent[:] = np.diag([4.0, 25.0])
    (disc,) = shapes.track_spheres(tracks, MarkerParameters())
    assert disc.scale[:2] == pytest.approx((10.0, 4.0))
    assert abs(disc.yaw_rad) == pytest.approx(np.pi / 2)


def test_clusters_of_the_radar_input_are_refused(tmp_path):
    assert not fault_of_clusters({"cluster_distance_m": 0.5}, {})
    assert not fault_of_clusters({}, {"extended_objects": "random_matrix"})
    path = tmp_path / "both.yaml"
    path.write_text(
        "radar_input:\n  ros__parameters:\n    cluster_distance_m: 0.8\n"
        "track_manager:\n  ros__parameters:\n    extended_objects: random_matrix\n"
    )
    with pytest.raises(ParameterFileError, match=r"cluster_distance_m.*extended_objects"):
        read_parameter_file(path)
