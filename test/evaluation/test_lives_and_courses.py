"""Pictures of one replay: the data of their lines, units on the axes, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from report_examples import make_detections, make_tracks, make_truth, swapping_run

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.evaluation import figures
from gda_tracker.evaluation.consistency import NormalisedErrors, gated_bounds
from gda_tracker.evaluation.figures.courses import SMOOTHED_SCANS, heard_conflicts, running_mean
from gda_tracker.evaluation.figures.lives import (
    longest_lives,
    rcs_dbsm,
    says_a_class,
    seconds_of,
)
from gda_tracker.evaluation.figures.series import track_histories
from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.vocabulary.tracks import TENTATIVE


def labels(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def lives():
    """Track 7 is confirmed on scan 1, coasts on 2, ends after 3; track 9 comes on 2 and stays."""
    tracks = [
        make_tracks(0, [[100, 0]], [0], ids=(7,)),
        make_tracks(1, [[110, 0]], [0], ids=(7,)),
        make_tracks(2, [[120, 0], [300, 50]], [-1, 0], ids=(7, 9)),
        make_tracks(3, [[130, 0], [300, 60]], [1, 0], ids=(7, 9)),
        make_tracks(4, [[300, 70]], [0], ids=(9,)),
    ]
    tracks[0].status = np.array([TENTATIVE])
    return tracks


def test_seconds_count_from_the_first_scan_and_keep_nanoseconds():
    tracks = lives()
    epoch = 1_700_000_000_000_000_001
    for k, live in enumerate(tracks):
        live.key = live.key._replace(stamp_ns=epoch + 250 * k)
    np.testing.assert_allclose(seconds_of(tracks), 2.5e-7 * np.arange(5), rtol=1e-12)
    assert seconds_of([]).shape == (0,)


def test_longest_lives_are_those_with_most_confirmed_scans():
    tracks = lives()
    assert [h.track_id for h in longest_lives(tracks)] == [7, 9]
    tracks[1].status = np.array([TENTATIVE])
    assert [h.track_id for h in longest_lives(tracks, 1)] == [9]
    for live in tracks:
        live.status = np.full(len(live), TENTATIVE)
    assert longest_lives(tracks) == []


def test_plan_position_shows_every_confirmed_track_from_its_confirmation():
    detections, truth, tracks = swapping_run()
    tracks[0].status = np.array([TENTATIVE, 1])
    figure = figures.plan_position(detections, tracks, truth, axis_names=("East", "North"))
    axes = figure.axes[0]
    lines = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 1.6]
    np.testing.assert_allclose(lines[0], [t.mean[0, :2] for t in tracks[1:]])
    np.testing.assert_allclose(lines[1], [t.mean[1, :2] for t in tracks])
    assert {text.get_text() for text in axes.texts} == {"1", "2"}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("East [m]", "North [m]")
    assert "truth" in labels(figure)
    assert "truth" not in labels(figures.plan_position(detections, tracks))


def test_plan_position_without_any_track():
    detections = [make_detections(0, [[10.0, 5.0]])]
    figure = figures.plan_position(detections, [make_tracks(0, [], [], ids=())])
    assert not figure.axes[0].texts


def test_lives_show_confirmation_detections_coasting_and_end():
    axes = figures.track_lives(lives()).axes[0]

    def points(marker):
        found = [line.get_xydata() for line in axes.lines if line.get_marker() == marker]
        return sorted(tuple(p) for p in np.concatenate(found))

    assert points(">") == [(1.0, 0.0), (2.0, 1.0)]
    assert points("X") == [(3.0, 0.0)]  # the other one lives at the end
    assert points("|") == [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (3.0, 0.0), (3.0, 1.0), (4.0, 1.0)]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["7", "9"]
    assert axes.get_xlabel() == "time since the first scan [s]"


def believing(values):
    """One track whose class probabilities are the rows of ``values``."""
    return [make_tracks(k, [[1, 2]], [0], ids=(3,), classes=[row]) for k, row in enumerate(values)]


def test_beliefs_of_each_class_over_time():
    belief = np.array([[0.2, 0.4, 0.4], [0.1, 0.6, 0.3], [0.0, 0.9, 0.1]])
    tracks = believing(belief)
    (history,) = track_histories(tracks)
    assert says_a_class(tracks, history)
    figure = figures.belief_courses(tracks, [history])
    for place, line in enumerate(figure.axes[0].lines):
        np.testing.assert_allclose(line.get_xydata(), np.stack([[0, 1, 2], belief[:, place]], 1))
    assert labels(figure) == ["false alarm", "fighter", "cargo"]
    assert figure.axes[0].get_ylabel() == "class probability [1]"


def test_beliefs_that_never_move_say_nothing():
    tracks = believing([[0.2, 0.4, 0.4]] * 3)
    assert not says_a_class(tracks, track_histories(tracks)[0])
    with pytest.raises(ValueError, match="no track"):
        figures.belief_courses(tracks, [])


def test_radar_cross_sections_of_the_detections_a_track_took():
    tracks = [make_tracks(k, [[1, 2]], [row], ids=(3,)) for k, row in enumerate([1, -1, 0, 0, 0])]
    detections = [make_detections(k, [[1, 2], [5, 5]]) for k in range(5)]
    rcs = [[9.0, 10.0], [1.0, 1.0], [0.1, 9.0], [4.0, 9.0], [0.0, 9.0]]
    detections = [
        replace(one, rcs_m2=np.array(values)) for one, values in zip(detections, rcs, strict=True)
    ]
    detections[3].rcs_valid = np.array([False, True])
    (history,) = track_histories(tracks)
    expected = [10.0, np.nan, -10.0, np.nan, np.nan]  # a zero has no decibels
    np.testing.assert_allclose(rcs_dbsm(detections, history), expected)
    detections[2].rcs_m2 = None
    assert np.isfinite(rcs_dbsm(detections, history)).tolist() == [True, *[False] * 4]


def test_the_ground_has_the_colour_of_the_class_that_gets_the_mass():
    fuzzifier = RcsFuzzifier(RcsFuzzifierParameters())
    tracks = [make_tracks(k, [[1, 2]], [0], ids=(3,)) for k in range(3)]
    detections = [
        replace(make_detections(k, [[1, 2]]), rcs_m2=np.array([value]))
        for k, value in enumerate((0.05, 1.0, 20.0))
    ]
    figure = figures.rcs_courses(detections, tracks, track_histories(tracks), fuzzifier)
    axes = figure.axes[0]
    (image,) = axes.images
    ground = np.asarray(image.get_array())[:, 0]
    low, high = image.get_extent()[2:]
    assert low < 10.0 * np.log10(0.05)
    assert high > 10.0 * np.log10(20.0)
    level = np.linspace(low, high, len(ground))
    grades = fuzzifier.membership(10.0 ** (level / 10.0))
    best = (grades / grades.sum(axis=1, keepdims=True)).argmax(axis=1)
    # Grey is even, the blue of the second class lacks red, the orange of the third lacks blue.
    assert best[-1] == 2
    assert ground[-1][2] < ground[-1][0]
    middle = int(np.flatnonzero(best == 1)[len(np.flatnonzero(best == 1)) // 2])
    assert ground[middle][0] < ground[middle][2]
    assert "dBsm" in axes.get_ylabel()
    assert "measured" in labels(figure)


def test_running_mean_is_weighted_and_short_at_the_ends():
    values = np.array([1.0, np.nan, 3.0, *[np.nan] * 20, 8.0])
    weights = np.array([1, 5, 3, *[0] * 20, 2])
    mean = running_mean(values, weights)
    assert mean[0] == pytest.approx((1.0 * 1 + 3.0 * 3) / 4)
    assert mean[2 + SMOOTHED_SCANS] == pytest.approx(3.0)
    assert np.isnan(mean[3 + SMOOTHED_SCANS])
    assert mean[-1] == 8.0
    assert len(mean) == len(values)


def test_nis_of_each_scan_with_the_bounds_of_its_number():
    tracks = lives()
    gate = gate_threshold(0.99)
    errors = NormalisedErrors(np.array([1.0, 3.0, 5.0]), np.array([1, 1, 4]), 2, gate)
    axes = figures.nis_course(errors, tracks).axes[0]
    means = axes.lines[0].get_xydata()
    np.testing.assert_allclose(means[[1, 4]], [[1.0, 2.0], [4.0, 5.0]])
    assert np.isnan(means[[0, 2, 3], 1]).all()
    segments = np.array([s for c in axes.collections for s in c.get_segments()])
    lower, upper = gated_bounds(2, np.array([2, 1]), gate)
    np.testing.assert_allclose(segments[:, 0, 1], lower)
    np.testing.assert_allclose(segments[:, 1, 1], upper)
    assert axes.get_ylabel() == "NIS [1]"
    none = NormalisedErrors(np.zeros(0), np.zeros(0, dtype=np.int64), 2, gate)
    with pytest.raises(ValueError, match="no value"):
        figures.nis_course(none, tracks)


def test_conflict_counts_confirmed_tracks_that_took_a_detection():
    tracks = lives()
    for k, live in enumerate(tracks):
        live.conflict = 0.1 * (k + 1) * np.ones(len(live))
    tracks[2].conflict = np.array([0.9, 0.3])  # the first one coasts
    place, values = heard_conflicts(tracks)
    assert place.tolist() == [1, 2, 3, 3, 4]
    np.testing.assert_allclose(values, [0.2, 0.3, 0.4, 0.4, 0.5])
    axes = figures.conflict_course(tracks).axes[0]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), values)
    # All scans lie within one window.
    np.testing.assert_allclose(axes.lines[1].get_ydata(), np.full(5, values.mean()))


def test_latencies_of_stages_with_their_numbers():
    axes = figures.stage_latencies({"fuzzifier": (0.25, 1.5), "association": (2.0, 4.0)}).axes[0]
    assert [bar.get_width() for bar in axes.patches] == [1.5, 0.25, 4.0, 2.0]
    assert [text.get_text() for text in axes.texts] == ["0.25 / 1.50", "2.00 / 4.00"]
    assert axes.get_xlabel() == "time per scan [ms]"
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["fuzzifier", "association"]


def test_truth_of_a_scan_without_known_targets_draws_nothing():
    tracks = [make_tracks(0, [[10, 5]], [0], ids=(1,))]
    truth = [make_truth(0, [[np.nan, np.nan], [np.nan, np.nan]], None)]
    figure = figures.plan_position([make_detections(0, [[10.0, 5.0]])], tracks, truth)
    assert np.isfinite(figure.axes[0].get_xlim()).all()
