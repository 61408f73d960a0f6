"""Messages of the set-valued tracker that do not fit, and the ellipses that are drawn."""

from __future__ import annotations

import math

import message_examples as examples
import numpy as np
import pytest

from gda_tracker.io import messages
from gda_tracker.io.messages import MessageError
from gda_tracker.io.track_set_markers import markers_of_track_sets, position_ellipses
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.track_sets import TrackSetArray


def sets_of(shape, covariance, **further):
    """One set with a given K K' of positions."""
    matrix = np.zeros((1, 4, 4))
    matrix[0, :2, :2] = np.linalg.cholesky(np.asarray(shape) + 1e-300 * np.eye(2))
    spread = np.eye(4)[None].copy()
    spread[0, :2, :2] = covariance
    one, zero = np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    values = {
        "track_id": one,
        "branch_id": one,
        "status": one,
        "best": np.ones(1, dtype=bool),
        "centroid": np.array([[10.0, -20.0, 0.0, 0.0]]),
        "covariance": spread,
        "matrix": matrix,
        "detection_index": zero,
        **further,
    }
    return TrackSetArray(key=ScanKey(1, "radar", 5_000_000_007), frame_id="map", **values)


@pytest.mark.parametrize("name", ["centroid", "covariance", "set_matrix"])
def test_a_field_that_lacks_an_element_is_refused(name):
    message = messages.track_sets_to_message(examples.track_sets())
    setattr(message.track_sets[1], name, getattr(message.track_sets[1], name)[:-1])
    with pytest.raises(MessageError, match=f"{name} has"):
        messages.track_sets_from_message(message)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("status", 300, "status = 300: allowed is 0 to 255"),
        ("detection_index", 2**40, "detection_index = 1099511627776"),
        ("misses", -1, "misses = -1"),
        ("may_own_index", 2**33, "detection_indices = "),
    ],
)
def test_a_number_that_does_not_fit_is_named(name, value, told):
    sets = examples.track_sets()
    getattr(sets, name)[0] = value
    with pytest.raises(MessageError, match=told):
        messages.track_sets_to_message(sets)
    short = examples.track_sets()
    short.system_uuid = bytes(3)
    with pytest.raises(MessageError, match="system_uuid has 3 bytes"):
        messages.track_sets_to_message(short)


def test_the_bare_set_is_drawn_as_it_is():
    turn = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    shape = turn @ np.diag([9.0, 4.0]) @ turn.T
    half_axes, heading = position_ellipses(sets_of(shape, 100.0 * np.eye(2)), 0.0)
    np.testing.assert_allclose(half_axes, [[3.0, 2.0]])
    assert math.tan(heading[0]) == pytest.approx(math.tan(0.5))


def test_a_point_is_drawn_with_its_covariance():
    half_axes, _ = position_ellipses(sets_of(np.zeros((2, 2)), np.diag([4.0, 25.0])), 2.0)
    np.testing.assert_allclose(half_axes, [[10.0, 4.0]], rtol=1e-6)


def test_the_ellipse_holds_every_mean_with_its_own():
    shape, covariance = np.array([[9.0, 2.0], [2.0, 4.0]]), np.array([[3.0, -1.0], [-1.0, 6.0]])
    sets = sets_of(shape, covariance)
    half_axes, heading = position_ellipses(sets, 1.5)
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    means = np.linalg.cholesky(shape) @ circle
    about = 1.5 * np.linalg.cholesky(covariance) @ circle
    points = (means[:, :, None] + about[:, None, :]).reshape(2, -1)
    turn = np.array(
        [
            [math.cos(heading[0]), math.sin(heading[0])],
            [-math.sin(heading[0]), math.cos(heading[0])],
        ]
    )
    inside = np.sum((turn @ points / half_axes[0][:, None]) ** 2, axis=0)
    assert inside.max() <= 1.0 + 1e-9
    assert inside.max() > 0.9


def test_markers_say_what_is_drawn_and_delete_what_was():
    found = markers_of_track_sets(sets_of(np.diag([9.0, 4.0]), np.eye(2)), 0.0).markers
    assert [m.action for m in found] == [3, 0, 0]
    ellipse, name = found[1:]
    assert (ellipse.ns, ellipse.type) == ("track_sets", 3)
    assert (ellipse.scale.x, ellipse.scale.y) == pytest.approx((6.0, 4.0))
    assert (ellipse.pose.position.x, ellipse.pose.position.y) == (10.0, -20.0)
    assert (ellipse.header.frame_id, ellipse.header.stamp.nanosec) == ("map", 7)
    assert (name.ns, name.text) == ("track_names", "1")
    pale = markers_of_track_sets(
        sets_of(np.diag([9.0, 4.0]), np.eye(2), status=np.zeros(1, dtype=np.int64)), 0.0
    ).markers
    assert len(pale) == 2
    assert pale[1].color.a < ellipse.color.a
    assert len(markers_of_track_sets(examples.track_sets(0), 1.0).markers) == 1
