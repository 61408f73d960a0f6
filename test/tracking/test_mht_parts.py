"""Parts of the trees: branches, walks back, merging, starts, by worked values and properties."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association.log_ratios import log_ratios
from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.mht.branches import branch
from gda_tracker.tracking.mht.decision import global_hypothesis
from gda_tracker.tracking.mht.generations import Generation, ancestors, path, rows_of, settle
from gda_tracker.tracking.mht.pruning import Nearness, leaves_in_all, merge
from gda_tracker.tracking.mht.start import fit, start_numbers, start_scores
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary import ScanKey

KEY = ScanKey(0, "radar", 0)


def leaves(track, numbers, score=None, parents=None, first_id=1, **columns):
    """A table with the columns that the trees look at."""
    n = len(track)
    made = HypothesisTable(
        hypothesis_id=first_id + np.arange(n),
        parent_id=np.zeros(n, dtype=np.int64) if parents is None else np.array(parents),
        track_id=np.array(track, dtype=np.int64),
        status=np.ones(n, dtype=np.int64),
        mean=np.zeros((n, 4)),
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        masses=np.zeros((n, 0)),
        class_probability=np.full((n, 2), 0.5),
        chosen=np.zeros(n, dtype=bool),
        log_score=np.zeros(n) if score is None else np.array(score, dtype=float),
        detection_numbers=np.array(numbers, dtype=np.int64).reshape(n, -1),
    )
    zeros = np.zeros(n, dtype=np.int64)
    for name in (
        *("history", "age_scans", "hits", "misses", "coasted_scans"),
        *("first_detection_ns", "last_detection_ns", "detection_index"),
    ):
        setattr(made, name, zeros)
    made.conflict = np.zeros(n)
    made.log_likelihood_ratio = np.zeros(n)
    for name, values in columns.items():
        setattr(made, name, np.array(values))
    return made


def test_log_ratios_by_hand():
    pair, miss = log_ratios(
        np.array([0, 1]),
        np.array([1, 0]),
        np.log([3.0, 5.0]),
        np.log([0.5, 0.2]),
        np.log([4.0, 2.0]),
        np.array([0.9, 0.6]),
        0.01,
    )
    np.testing.assert_allclose(
        np.exp(pair), [0.9 * 3.0 * 0.5 / (0.01 * 2.0), 0.6 * 5.0 * 0.2 / (0.01 * 4.0)]
    )
    np.testing.assert_allclose(np.exp(miss), [0.1, 0.4])
    alone, _ = log_ratios(
        np.array([0]), np.array([0]), np.log([3.0]), None, None, np.array([0.9]), 0.01
    )
    np.testing.assert_allclose(np.exp(alone), [270.0])


def test_certain_detection_and_no_clutter_leave_scores_finite():
    pair, miss = log_ratios(
        np.array([0]), np.array([0]), np.zeros(1), None, None, np.array([1.0]), 0.0
    )
    assert np.isfinite(pair).all()
    assert np.isfinite(miss).all()
    assert miss[0] < -1e5 < 1e5 < pair[0]


def test_a_leaf_branches_into_a_miss_and_its_pairs():
    table = leaves([4, 4, 9], [[7, -1], [-1, 3], [5, 2]], [1.0, 2.0, 3.0])
    found = branch(
        table,
        np.array([0, 0, 2], dtype=np.int32),
        np.array([0, 2, 1], dtype=np.int32),
        np.array([10.0, 20.0, 30.0]),
        np.array([-1.0, -2.0, -3.0]),
        100,
    )
    assert found.parent.tolist() == [0, 0, 0, 1, 2, 2]
    assert found.detection.tolist() == [-1, 0, 2, -1, -1, 1]
    assert found.pair.tolist() == [-1, 0, 1, -1, -1, 2]
    assert found.track_id.tolist() == [4, 4, 4, 4, 9, 9]
    assert found.log_score.tolist() == [0.0, 11.0, 21.0, 0.0, 0.0, 33.0]
    assert found.detection_numbers.tolist() == [
        [-1, 7, -1],
        [100, 7, -1],
        [102, 7, -1],
        [-1, -1, 3],
        [-1, 5, 2],
        [101, 5, 2],
    ]


def generation(table, settled=()):
    marked = np.zeros(len(table), dtype=bool)
    marked[list(settled)] = True
    return Generation(KEY, table, marked, np.zeros(0, dtype=np.int64), False)


def test_walks_back_and_what_they_settle():
    # Track 1 splits at the second scan, track 2 starts there.
    first = generation(leaves([1], [[-1]], first_id=10))
    second = generation(leaves([1, 1, 2], [[-1]] * 3, parents=[10, 10, 0], first_id=20))
    steps = [first, second]
    parents = np.array([21, 20, 22, 0])
    assert [rows.tolist() for rows in ancestors(parents, steps)] == [
        [0, 0, -1, -1],
        [1, 0, 2, -1],
    ]
    assert [rows.tolist() for rows in path(steps, np.array([21, 22]))] == [[0], [1, 2]]
    # Track 1 has ended on its first branch: it is told though no leaf leads there.
    settle(steps, np.array([20]))
    assert [rows.tolist() for rows in path(steps, np.array([22]))] == [[0], [0, 2]]


@settings(derandomize=True, deadline=None)
@given(st.lists(st.integers(0, 30), unique=True), st.lists(st.integers(0, 30)))
def test_rows_are_found_or_absent(identifiers, wanted):
    ids = sorted(identifiers)
    found = rows_of(np.array(ids, dtype=np.int64), np.array(wanted, dtype=np.int64))
    assert found.tolist() == [ids.index(w) if w in ids else -1 for w in wanted]


def test_near_leaves_are_merged_into_the_best_with_the_sum_of_the_weights():
    table = leaves(
        [1, 1, 1, 1, 1, 2],
        [[5, 1], [5, 2], [5, 3], [6, 1], [5, 4], [5, 1]],
        np.log([1.0, 2.0, 4.0, 8.0, 16.0, 32.0]),
        chosen=[False, True, False, False, False, True],
    )
    # Row 2 is far away, row 4 believes in another class.
    table.mean[2, 0] = 10.0
    table.class_probability[4] = [0.9, 0.1]
    merged = merge(table, Nearness(1, 1.0, 0.05))
    assert merged.hypothesis_id.tolist() == [2, 3, 4, 5, 6]
    np.testing.assert_allclose(np.exp(merged.log_score), [3.0, 4.0, 8.0, 16.0, 32.0])
    # With both scans looked at no two of them have the same detections.
    assert len(merge(table, Nearness(2, 1.0, 0.05))) == len(table)
    # The better one stays where none is chosen.
    table.chosen[:] = False
    merged = merge(table, Nearness(1, np.inf, 1.0))
    assert merged.hypothesis_id.tolist() == [4, 5, 6]
    np.testing.assert_allclose(np.exp(merged.log_score), [8.0, 23.0, 32.0])


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 3), st.floats(0.0, 3.0))
def test_merging_keeps_weights_tracks_and_chosen_leaves(seed, scans, distance):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 20))
    table = leaves(
        np.sort(rng.integers(1, 4, n)), rng.integers(-1, 2, (n, 3)), rng.normal(0.0, 3.0, n)
    )
    table.mean = rng.normal(size=(n, 4))
    for track in np.unique(table.track_id):
        table.chosen[rng.choice(np.flatnonzero(table.track_id == track))] = True
    before = dataclasses.replace(table)
    merged = merge(table, Nearness(scans, distance**2, 1.0))
    assert set(before.hypothesis_id[before.chosen]) <= set(merged.hypothesis_id)
    for track in np.unique(table.track_id):
        total = np.logaddexp.reduce(table.log_score[table.track_id == track])
        left = np.logaddexp.reduce(merged.log_score[merged.track_id == track])
        assert left == pytest.approx(total, abs=1e-12)
    np.testing.assert_array_equal(table.log_score, before.log_score)


def test_leaves_in_all_are_shared_among_the_tracks():
    assert leaves_in_all(10, 1000, 20) == 10
    assert leaves_in_all(10, 100, 20) == 5
    assert leaves_in_all(10, 100, 2000) == 1
    assert leaves_in_all(10, 100, 0) == 10


def test_an_optional_track_is_absent_where_its_detections_are_worth_more_to_others():
    # Track 0 must have one of its leaves, track 1 may be absent.
    track, used = np.array([0, 0, 1]), np.array([[1, 2], [-1, -1], [2, -1]])
    chosen, probability, absent = global_hypothesis(
        np.log([5.0, 1.0, 3.0]), track, used, np.array([1], dtype=np.int64)
    )
    assert chosen.tolist() == [True, False, False]
    # Hypotheses: 5 (track 1 absent), 1 (absent), 1 * 3.
    np.testing.assert_allclose(probability, np.array([5.0, 4.0, 3.0]) / 9.0, atol=1e-9)
    np.testing.assert_allclose(absent, [6.0 / 9.0], atol=1e-9)
    chosen, _, _ = global_hypothesis(
        np.log([2.0, 1.0, 3.0]), track, used, np.array([1], dtype=np.int64)
    )
    assert chosen.tolist() == [False, True, True]
    # Where both must be, the detection goes to the better sum.
    chosen, _, _ = global_hypothesis(
        np.log([50.0, 1.0, 3.0]), track, used, np.zeros(0, dtype=np.int64)
    )
    assert chosen.tolist() == [False, True, True]


@pytest.fixture
def started():
    return NewTracks(
        detection=np.array([1, 0]),
        first_stamp_ns=np.array([8, 6]) * 1_000_000_000,
        gap_scans=np.array([1, 3]),
        first_number=np.array([90, 70]),
    )


def test_the_score_of_a_start_by_hand(started):
    from tracking_examples import scan_at

    from gda_tracker.tracking.ring import Ring

    scan, _ = Ring().manager.validate(scan_at(10.0, [(2000.0, 0.0), (0.0, 3000.0)]))
    p = TrackManagerParameters(
        max_speed_mps=100.0, detection_probability=0.8, mht_new_target_ratio=1e-2
    )
    found = start_scores(started, scan, 1e-5, p)
    expected = [
        1e-2 * 0.8 / 1e-5 * 3000.0 / (math.pi * 200.0**2),
        1e-2 * 0.2**2 * 0.8 / 1e-5 * 2000.0 / (math.pi * 400.0**2),
    ]
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-9)
    assert np.isfinite(start_scores(started, scan, 0.0, p)).all()


def test_detections_of_a_start_and_columns_that_fit(started):
    assert start_numbers(started, 100, 4).tolist() == [[101, 90, -1, -1], [100, -1, -1, 70]]
    assert start_numbers(started, 100, 3).tolist() == [[101, 90, -1], [100, -1, -1]]
    table = leaves([1, 1, 2], [[5, 4], [6, 4], [-1, 7]], [1.0, 2.0, 3.0], chosen=[0, 1, 1])
    table.chosen = table.chosen.astype(bool)
    assert fit(table, 2) is table
    assert fit(table, 3).detection_numbers.tolist() == [[5, 4, -1], [6, 4, -1], [-1, 7, -1]]
    assert fit(table, 1).detection_numbers.tolist() == [[5], [6], [-1]]
    ended = fit(table, 0)
    assert ended.hypothesis_id.tolist() == [2, 3]
    assert ended.detection_numbers.shape == (2, 0)
    assert (ended.log_score == 0.0).all()


def test_scores_of_pairs_are_those_of_each_hypothesis_alone():
    from gda_tracker.association.hypothesis_scores import score_hypotheses
    from gda_tracker.vocabulary import AssociationSettings, Predictions, Scan

    pairs = GatedPairs(
        np.array([0, 0, 2], dtype=np.int32),
        np.array([0, 1, 1], dtype=np.int32),
        np.array([1.0, 2.0, 3.0]),
        np.log([2e-4, 1e-4, 3e-4]),
    )
    predictions = Predictions(
        key=KEY,
        settings=AssociationSettings(decision="mht", clutter_density=1e-5),
        hypothesis_id=np.array([1, 2, 3]),
        parent_id=np.zeros(3, dtype=np.int64),
        track_id=np.array([1, 1, 2]),
        detection_probability=np.array([0.9, 0.9, 0.8]),
        component_start=np.arange(4, dtype=np.int32),
        component_weight=np.ones(3),
        component_model=np.zeros(3, dtype=np.int32),
        component_mean=np.zeros((3, 4)),
        component_covariance=np.tile(np.eye(4), (3, 1, 1)),
    )
    empty = np.zeros(2)
    scan = Scan(
        KEY,
        "map",
        np.zeros(3),
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.arange(2, dtype=np.int32),
        empty,
        empty,
        np.tile(np.eye(2), (2, 1, 1)),
        empty,
        empty.astype(bool),
    )
    found = score_hypotheses(scan, predictions, None, pairs)
    w = np.array([0.9 * 20.0, 0.9 * 10.0, 0.8 * 30.0])
    total = np.array([0.1 + w[0] + w[1]] * 2 + [0.2 + w[2]])
    np.testing.assert_allclose(found.p_kinematic, w / total, rtol=1e-12)
    assert not found.chosen.any()
    assert found.assigned_detection.tolist() == [-1, -1, -1]
    assert found.cluster.tolist() == [0, 0, 1]
    assert found.engine_names == ("each_hypothesis_alone",)
