"""Bad paths and numbers are refused; windows that are too short; maps of any size."""

from __future__ import annotations

import tracemalloc
from collections import Counter

import numpy as np
import pytest

from gda_tracker.events.missed_detections import look_increments
from gda_tracker.io.context_files import read_context_file
from gda_tracker.kinematics.context import Lane
from gda_tracker.kinematics.lane_motion import LaneCourse
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.class_motion import histories_after
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameters import TrackManagerParameters

LARGE = "0x" + 4000 * "f"


@pytest.mark.parametrize("path", ["~no_such_user_here/roads.yaml", "roads\0.yaml"])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(ParameterError):
        TrackManagerParameters(context_file=path)
    with pytest.raises(ParameterError):
        read_context_file(path)


@pytest.mark.parametrize(
    "text",
    [
        f"frame_id: {LARGE}",
        f"lanes: {LARGE}",
        f"lanes: [{LARGE}]",
        f"lanes: [{{name: {LARGE}, width_m: 1, margin_m: 1, points_m: []}}]",
        f"lanes: [{{name: a, width_m: {LARGE}, margin_m: 1, points_m: [[0, 0], [1, 1]]}}]",
        f"lanes: [{{name: a, width_m: 1, margin_m: 1, points_m: [[{LARGE}, 0], [1, 1]]}}]",
        f"lanes: [{{name: a, width_m: 1, margin_m: 1, points_m: [{LARGE}, [1, 1]]}}]",
        f"plans: [{{name: a, track_id: {LARGE}, margin_m: 1, waypoints: []}}]",
    ],
)
def test_integers_of_thousands_of_digits_are_refused(tmp_path, text):
    path = tmp_path / "roads.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError):
        TrackManagerParameters(context_file=str(path))


def histories(velocity, step_s, parameters):
    found, counters = None, Counter()
    for k, (v, p) in enumerate(zip(velocity, parameters, strict=True)):
        table = HypothesisTable(
            hypothesis_id=np.array([1]),
            parent_id=np.array([-1]),
            mean=np.array([[0.0, 0.0, *v]]),
            covariance=np.diag([100.0, 100.0, 1.0, 1.0])[None],
        )
        found = histories_after(found, table, round(k * step_s * 1e9), p, counters)
    return found, counters


def moving(scans):
    return TrackManagerParameters(
        filter="cv",
        class_motion="ranges",
        class_motion_names=["cargo"],
        class_speed_mps=[0.0, 0.0, 20.0, 25.0],
        class_acceleration_mps2=[0.0, 0.0, 1.0, 2.0],
        class_motion_scans=scans,
    )


def test_a_restart_with_a_shorter_window_forgets_nothing():
    long, short = moving(40), moving(5)
    velocity = [(300.0 if 10 <= k < 12 else 100.0, 0.0) for k in range(30)]
    before, _ = histories(velocity[:25], 2.0, [long] * 25)
    after, _ = histories(velocity, 2.0, [long] * 25 + [short] * 5)
    assert after.extremes[0, 0, 0] >= before.extremes[0, 0, 0] > 200.0
    assert after.extremes[0, 2, 0] >= before.extremes[0, 2, 0] > 30.0


@pytest.mark.parametrize(("step_s", "counted"), [(0.5, 20), (1.0, 0)])
def test_a_window_without_accelerations_is_counted(step_s, counted):
    turn = 0.3 * step_s * np.arange(30)
    velocity = 100.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    found, counters = histories(velocity, step_s, [moving(10)] * 30)
    assert counters["class_motion_window_too_short"] == counted
    assert np.isnan(found.extremes[0, 2, 0]) == (counted > 0)


def test_a_look_that_excludes_a_stop_is_a_number():
    add = look_increments(
        np.array([True]),
        np.array([10.0]),
        stopped=0.0,
        blind_speed=2.0,
        detection_probability=0.9,
        false_detection_probability=0.0,
    )
    assert np.isfinite(add).all()
    assert add[0] < -700.0


def test_a_large_map_takes_no_memory_by_states_and_pieces():
    points = np.column_stack([10.0 * np.arange(20_001), np.zeros(20_001)])
    course = LaneCourse((Lane("road", points, 10.0, 1.0),), 10.0)
    n = 80
    mean = np.tile([1e5, 0.0, 10.0, 0.0], (n, 1))
    mean[:, 0] += 37.0 * np.arange(n)
    covariance = np.tile(np.diag([1e9, 1e9, 100.0, 100.0]), (n, 1, 1))
    tracemalloc.start()
    found = course.piece_of(mean, covariance)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6
    np.testing.assert_array_equal(
        found[:5], [course.piece_of(m[None], covariance[:1])[0] for m in mean[:5]]
    )
