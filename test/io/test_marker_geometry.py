"""Bytes, ellipses and gates of the markers."""

import dataclasses

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from hypothesis import given, settings
from hypothesis import strategies as st
from marker_run import marker_results, table
from rclpy.serialization import deserialize_message
from scipy.stats import chi2
from visualization_msgs.msg import Marker, MarkerArray

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.markers import cdr, layers, shapes
from gda_tracker.io.markers.parameters import (
    colour_of,
)
from gda_tracker.kinematics.gating import gate
from gda_tracker.tracking.gates import gates_of


@pytest.fixture(scope="module")
def run():
    """Results of the ring on the crossing targets."""
    return marker_results()


def test_the_bytes_are_those_of_the_messages_field_by_field():
    """Against the serialiser of the rosbags library, which knows the definitions alone."""
    points = np.array([[1.5, -2.5], [3.0, 4.0], [5.0, 6.0]])
    blue = colour_of("#0000ff80")
    update = layers.Update(
        "tracks",
        1_234_567_890_123,
        "map",
        [
            shapes.Shape(
                "é", 2**31 - 1, shapes.TEXT, blue, (0, 0, 3), (1, 2, 3), 0.5, text="äx\n7"
            ),
            shapes.Shape("abc", 0, shapes.LINE_STRIP, blue, (0.25, 0, 0), points=points),
            shapes.Shape("", 7, shapes.SPHERE, blue, (1, 2, 3), (-1.0, 0.5, 9.0), -3.0),
        ],
        gone=[("confirmed", 5), ("a", 6)],
        anew=True,
    )
    p = table(lifetime_s=2.25, height_m=-1.5)
    written = cdr.marker_array(update, p)
    expected = []
    for action, namespace, number in ((3, "", 0), (2, "confirmed", 5), (2, "a", 6)):
        expected.append(Marker(action=action, ns=namespace, id=number))
    for shape in update.shapes:
        marker = Marker(ns=shape.namespace, id=shape.number, type=shape.kind, text=shape.text)
        for part, names, values in (
            (marker.pose.position, "xyz", shape.position),
            (marker.scale, "xyz", shape.scale),
            (marker.color, "rgba", shape.colour),
        ):
            for name, value in zip(names, values, strict=True):
                setattr(part, name, float(value))
        marker.pose.orientation.z = float(np.sin(0.5 * shape.yaw_rad))
        marker.pose.orientation.w = float(np.cos(0.5 * shape.yaw_rad))
        marker.points = [Point(x=float(x), y=float(y), z=-1.5) for x, y in shape.points]
        marker.lifetime = Duration(sec=2, nanosec=250_000_000)
        expected.append(marker)
    for marker in expected:
        marker.header.stamp.sec, marker.header.stamp.nanosec = 1234, 567_890_123
        marker.header.frame_id = "map"
    for marker in expected[:3]:
        marker.pose.orientation.w = 1.0
    assert written == serialize(MarkerArray(markers=expected))
    empty = cdr.marker_array(layers.Update("tracks", 0, ""), p)
    assert deserialize_message(empty, MarkerArray) == MarkerArray()


# --- geometry -------------------------------------------------------------------------------------


def test_an_ellipse_by_hand():
    covariance = np.array([[[4.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 9.0]]])
    axes, yaw = shapes.ellipses(covariance, 1.0 - np.exp(-2.0))
    # -2 log exp(-2) = 4: twice the standard deviations.
    np.testing.assert_allclose(axes, [[4.0, 2.0], [6.0, 2.0]], rtol=1e-12)
    np.testing.assert_allclose(np.abs(np.sin(yaw)), [0.0, 1.0], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-50.0, 50.0), min_size=4, max_size=4),
    st.floats(0.01, 0.999),
    st.floats(-np.pi, np.pi),
)
def test_the_edge_of_an_ellipse_has_the_mahalanobis_distance_of_its_probability(
    entries, probability, angle
):
    root = np.array(entries).reshape(2, 2)
    covariance = root @ root.T + 0.5 * np.eye(2)
    (axes,), (yaw,) = shapes.ellipses(covariance[None], probability)
    along = axes[0] * np.cos(angle) * np.array([np.cos(yaw), np.sin(yaw)])
    point = along + axes[1] * np.sin(angle) * np.array([-np.sin(yaw), np.cos(yaw)])
    squared = point @ np.linalg.solve(covariance, point)
    assert squared == pytest.approx(chi2.ppf(probability, 2), rel=1e-6)


def test_detections_are_gated_that_lie_within_the_line_of_the_gate(run):
    """The lines against the gate that association uses, on detections all around."""
    result = next(r for r in run if r.predictions is not None and len(r.predictions) >= 2)
    scan, predictions = result.scan, result.predictions
    gates = gates_of(scan, predictions, None)
    edges = gates.outlines(scan.sensor_position_m[:2], 720)
    noise = np.median(scan.noise_covariance, axis=0)
    rng = np.random.default_rng(2)
    agree, inside_count = 0, 0
    for g, edge in enumerate(edges):
        low, high = edge.min(axis=0), edge.max(axis=0)
        point = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (400, 2))
        off = point - scan.sensor_position_m[:2]
        around = dataclasses.replace(
            scan,
            range_m=np.hypot(*off.T),
            azimuth_rad=np.arctan2(off[:, 1], off[:, 0]),
            noise_covariance=np.tile(noise, (400, 1, 1)),
            source_index=np.arange(400, dtype=np.int32),
            rcs_m2=np.zeros(400),
            rcs_valid=np.zeros(400, dtype=bool),
            elevation_rad=None,
            range_rate_mps=None,
        )
        alone = _heaviest(predictions, gates.track_id[g])
        pairs = gate(around, alone)
        gated = np.isin(np.arange(400), pairs.detection)
        x, y = edge[:-1].T
        turns = np.zeros(400)
        for a in range(len(x)):
            b = (a + 1) % len(x)
            crossing = (y[a] > point[:, 1]) != (y[b] > point[:, 1])
            at = (x[b] - x[a]) * (point[:, 1] - y[a]) / (y[b] - y[a] + 1e-300) + x[a]
            turns += crossing & (point[:, 0] < at)
        inside = turns % 2 == 1
        agree += np.count_nonzero(inside == gated)
        inside_count += np.count_nonzero(inside)
    assert agree >= 0.995 * 400 * len(edges)
    assert inside_count > 50 * len(edges)


def _heaviest(predictions, track_id):
    """The heaviest component of the first hypothesis of a track, alone."""
    row = int(np.flatnonzero(predictions.track_id == track_id)[0])
    first, last = predictions.component_start[row : row + 2]
    component = first + int(np.argmax(predictions.component_weight[first:last]))
    changed = {
        f.name: getattr(predictions, f.name)[[row]]
        for f in dataclasses.fields(predictions)
        if f.name in ("hypothesis_id", "parent_id", "track_id", "detection_probability")
    }
    return dataclasses.replace(
        predictions,
        **changed,
        component_start=np.array([0, 1], dtype=np.int32),
        component_weight=np.ones(1),
        component_model=predictions.component_model[[component]],
        component_mean=predictions.component_mean[[component]],
        component_covariance=predictions.component_covariance[[component]],
    )
