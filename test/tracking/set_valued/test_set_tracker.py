"""The set-valued tracker: branching, merging, coasting, ends, starts, and figure 1."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from set_tracker_examples import (
    CLEAR,
    CLUTTERED,
    UNTHINNED,
    outputs_of,
    parameters,
    scan_at,
    scans,
    tracker_of,
)

from gda_tracker.evaluation.track_sets import covering, undecided
from gda_tracker.kinematics.set_valued.filter import TrackSets
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.set_valued.branches import new_branches, with_ids
from gda_tracker.tracking.set_valued.leading import led_by_own_score, led_jointly
from gda_tracker.tracking.set_valued.thinning import cap, duplicates, merge
from gda_tracker.vocabulary.tracks import CONFIRMED


def columns(sets):
    return {f.name: getattr(sets, f.name) for f in dataclasses.fields(sets)}


# --- the crossing


def test_figure_1_is_open_where_tracks_are_close_and_decided_afterwards():
    sets, _ = outputs_of()
    tracks = [np.unique(s.track_id).tolist() for s in sets]
    assert all(t == [1, 2, 3] for t in tracks)
    count = [len(s) for s in sets]
    # Tracks 1 and 3 at first, tracks 1 and 2 at sample eleven, nothing before and after.
    assert max(count[1:4]) > 3
    assert max(count[8:13]) >= 5
    assert count[5:8] == [3, 3, 3]
    assert count[14:] == [3] * 11
    radius = [s.position_radius_m[s.best].max() for s in sets]
    assert radius[0] > 200.0
    assert max(radius[-5:]) < 5.0
    # Every target stays with its track, although the tracker was never told to decide.
    for one, truth in zip(sets[14:], scans()[1][14:], strict=True):
        own = one.detection_index[one.best]
        assert [int(truth.source_id[i]) for i in own] == [
            int(scans()[1][0].source_id[i]) for i in sets[0].detection_index
        ]


@pytest.mark.parametrize("seed", [0, 3])
def test_every_target_is_covered_and_the_sets_stay_few(seed):
    sets, _ = outputs_of(seed=seed)
    truth = scans(CLEAR, seed)[1]
    covered = [
        covering(s, t.target_state[:, :2]).any(axis=1) for s, t in zip(sets, truth, strict=True)
    ]
    assert np.mean(covered) > 0.98
    assert max(len(s) for s in sets) <= 30


def test_without_management_the_sets_multiply():
    few, _ = outputs_of(samples=10)
    many, _ = outputs_of(samples=10, **UNTHINNED)
    assert max(len(s) for s in few) <= 12
    assert len(many[-1]) > 100


def test_the_same_scans_give_the_same_sets():
    first, _ = outputs_of(CLUTTERED)
    second, _ = outputs_of(CLUTTERED)
    for one, other in zip(first, second, strict=True):
        for name, value in columns(one).items():
            np.testing.assert_array_equal(value, getattr(other, name))


def test_the_order_of_the_detections_changes_nothing_but_the_indices():
    straight, turned = tracker_of(CLUTTERED), tracker_of(CLUTTERED)
    for scan in scans(CLUTTERED)[0]:
        one, _ = straight.process(scan)
        back = dataclasses.replace(
            scan, range_m=scan.range_m[::-1], azimuth_rad=scan.azimuth_rad[::-1]
        )
        other, _ = turned.process(back)
        assert len(one) == len(other)
        order = [np.lexsort(s.centroid.T) for s in (one, other)]
        np.testing.assert_allclose(
            one.centroid[order[0]], other.centroid[order[1]], rtol=1e-7, atol=1e-7
        )


# --- what is told


def test_what_is_told_of_the_sets_fits_together():
    sets, tracker = outputs_of(CLUTTERED)
    seen_tracks, seen_branches, known = set(), set(), {}
    for scan, one in zip(scans(CLUTTERED)[0], sets, strict=True):
        assert len(set(one.branch_id.tolist())) == len(one)
        assert np.array_equal(one.track_id, np.sort(one.track_id))
        for track in np.unique(one.track_id):
            rows = one.track_id == track
            assert one.best[rows].tolist() == [True] + [False] * (rows.sum() - 1)
            assert (np.diff(one.score[rows][1:]) <= 0.0).all()
            assert len(set(one.status[rows].tolist())) == 1
        now = dict(zip(one.branch_id.tolist(), one.track_id.tolist(), strict=True))
        for row in range(len(one)):
            branch, parent = int(one.branch_id[row]), int(one.parent_branch_id[row])
            if parent:
                # A successor is of the same track; what kept its name is its own successor.
                assert known[parent] == one.track_id[row]
                assert branch == parent or branch not in seen_branches
            else:
                assert one.track_id[row] not in seen_tracks
            own = one.may_own(row).tolist()
            index = int(one.detection_index[row])
            assert index == -1 or index in own
            assert all(0 <= i < len(scan.range_m) for i in own)
            assert one.hits[row] + one.misses[row] >= 1
            assert (index == -1) == (one.coasted_scans[row] > 0)
        ended = set(known) - set(now) - set(one.parent_branch_id.tolist())
        assert set(one.deleted_branch_id.tolist()) == ended
        assert set(one.deleted_track_id.tolist()) == set(known.values()) - set(now.values())
        seen_tracks |= set(one.track_id.tolist())
        seen_branches |= set(now)
        known = now
    for covariance in sets[-1].covariance:
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
    assert tracker.counters["tracks_started"] == len(seen_tracks)


def test_undecided_sets_are_those_that_share_or_choose():
    for one in outputs_of()[0]:
        found = undecided(one)
        for row in range(len(one)):
            own = set(one.may_own(row).tolist())
            shared = any(
                own & set(one.may_own(other).tolist())
                for other in range(len(one))
                if one.track_id[other] != one.track_id[row]
            )
            assert found[row] == (len(own) > 1 or shared)


# --- life of a track


def test_a_target_is_confirmed_coasts_and_ends():
    tracker = tracker_of()
    path = [(100.0 * t, 5000.0) for t in range(0, 40, 2)]
    statuses = []
    for k, place in enumerate(path[:6]):
        sets, report = tracker.process(scan_at(2.0 * k, [place]))
        statuses.append(int(sets.status[0]))
    assert statuses == [0, 0, 1, 1, 1, 1]
    assert (report.tracks_confirmed, report.tracks_tentative) == (1, 0)
    radii, misses = [sets.position_radius_m[0]], 0
    while len(sets):
        misses += 1
        sets, _ = tracker.process(scan_at(2.0 * (5 + misses), []))
        if len(sets):
            assert sets.coasted_scans[0] == misses
            assert sets.detection_index[0] == -1
            assert sets.may_own(0).tolist() == []
            radii.append(sets.position_radius_m[0])
    assert misses == parameters().max_coasted_scans + 1
    assert (np.diff(radii) > 0.0).all()
    assert sets.deleted_track_id.tolist() == [1]
    assert len(sets.deleted_branch_id) == 1
    sets, _ = tracker.process(scan_at(60.0, [(0.0, 3000.0)]))
    assert sets.track_id.tolist() == [2]


def test_a_tentative_track_ends_sooner():
    tracker = tracker_of()
    tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
    tracker.process(scan_at(2.0, []))
    assert len(tracker.branches) == 1
    tracker.process(scan_at(4.0, []))
    assert len(tracker.branches) == 0
    assert tracker.counters["sets_coasted_out"] == 1


def test_two_detections_in_reach_make_two_branches_of_one_track():
    tracker = tracker_of(merge_distance=0.0, miss_branches="never")
    tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
    sets, _ = tracker.process(scan_at(2.0, [(150.0, 5000.0), (-150.0, 5000.0)]))
    assert sets.track_id.tolist() == [1, 1]
    assert sets.parent_branch_id.tolist() == [1, 1]
    assert sorted(sets.branch_id.tolist()) == [2, 3]
    assert sorted(sets.detection_index.tolist()) == [0, 1]
    assert [sets.may_own(0).tolist(), sets.may_own(1).tolist()] == [[0, 1], [0, 1]]
    # A third one out of reach of any speed that is possible starts a track.
    sets, _ = tracker.process(scan_at(4.0, [(300.0, 5000.0), (0.0, 9000.0)]))
    assert sorted(set(sets.track_id.tolist())) == [1, 2]


def test_a_miss_lives_on_beside_an_open_association():
    for choice, expected in (("never", 0), ("ambiguous", 1), ("always", 1)):
        tracker = tracker_of(miss_branches=choice, score_margin=1e6)
        tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
        sets, _ = tracker.process(scan_at(2.0, [(150.0, 5000.0), (-150.0, 5000.0)]))
        assert (sets.detection_index == -1).sum() == expected
    for choice, expected in (("ambiguous", 0), ("always", 1)):
        tracker = tracker_of(miss_branches=choice, score_margin=1e6)
        tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
        sets, _ = tracker.process(scan_at(2.0, [(150.0, 5000.0)]))
        assert (sets.detection_index == -1).sum() == expected


def test_who_claims_a_detection_keeps_it_from_starting_a_track():
    started = {}
    for claimants in ("all", "confirmed", "leading"):
        tracker = tracker_of(initiation_claims=claimants, miss_branches="never")
        tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
        tracker.process(scan_at(2.0, [(150.0, 5000.0), (-150.0, 5000.0)]))
        started[claimants] = tracker.counters["tracks_started"]
    assert started == {"all": 1, "confirmed": 3, "leading": 2}


# --- parts


def made(centroids, track_id, score, memory, confirmed=None):
    n = len(track_id)
    state = np.zeros((n, 4))
    state[:, 0] = centroids
    sets = TrackSets(state, np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(4), (n, 1, 1)))
    branches = new_branches(
        sets, np.array(track_id), np.arange(n), np.arange(n), detections=n, stamp_ns=0
    )
    branches.score[:] = score
    branches.memory[:, -len(memory[0]) :] = memory
    if confirmed is not None:
        branches.confirmed[:] = confirmed
    return led_by_own_score(branches)


def test_leading_sets_share_no_detection_as_far_as_they_can():
    memory = [[k] for k in range(5)]
    branches = made(np.arange(5), [1, 1, 2, 2, 3], [9.0, 8.0, 7.0, 1.0, 5.0], memory)
    branches.detection[:] = [0, 1, 0, 1, 2]
    # 8 + 7 beats 9 + 1; the third track has its detection to itself.
    led = led_jointly(branches)
    assert led.score.tolist() == [8.0, 9.0, 7.0, 1.0, 5.0]
    assert led.leads.tolist() == [True, False, True, False, True]
    assert led_by_own_score(led).score.tolist() == [9.0, 8.0, 7.0, 1.0, 5.0]
    # Without a detection sets do not exclude each other; who has nothing else shares.
    branches.detection[:] = [-1, 1, -1, 1, 1]
    led = led_jointly(branches)
    assert led.score[led.leads].tolist() == [9.0, 7.0, 5.0]
    alone = made(np.arange(2), [1, 2], [3.0, 4.0], [[0], [0]])
    alone.detection[:] = 0
    assert led_jointly(alone).leads.tolist() == [True, True]


def test_leading_sets_are_the_best_of_all_choices():
    rng = np.random.default_rng(2)
    for _ in range(30):
        track = np.sort(rng.integers(1, 4, 8))
        branches = made(np.arange(8), track, 10.0 * rng.random(8), [[k] for k in range(8)])
        branches.detection[:] = rng.integers(-1, 4, 8)
        rows = [np.flatnonzero(branches.track_id == t) for t in np.unique(track)]
        sums = []
        for choice in itertools.product(*rows):
            own = branches.detection[list(choice)]
            own = own[own >= 0]
            if len(own) == len(set(own.tolist())):
                sums.append(branches.score[list(choice)].sum())
        led = led_jointly(branches)
        assert led.leads.sum() == len(rows)
        if sums:
            assert led.score[led.leads].sum() == pytest.approx(max(sums))


def test_close_sets_and_those_with_the_same_past_are_merged():
    branches = made(
        [0.0, 1.0, 9.0, 9.5, 0.5], [1, 1, 1, 1, 2], [5, 4, 3, 2, 9], [[k] * 3 for k in range(5)]
    )
    # Under P + K K' = 2 I a step of 1 is 0.7.
    kept = merge(branches, 1.0, 3)
    assert kept.score.tolist() == [5, 3, 9]
    assert kept.may_own.tolist() == [
        [True, True, False, False, False],
        [False, False, True, True, False],
        [False, False, False, False, True],
    ]
    assert len(merge(branches, 0.5, 3)) == 4
    assert len(merge(branches, 0.0, 3)) == 5
    branches.memory[2] = branches.memory[0]
    assert merge(branches, 0.0, 3).score.tolist() == [5, 4, 2, 9]


def test_of_duplicates_the_best_of_its_track_stays():
    same, other = [4, 5, 6], [7, 8, 9]
    branches = made([0, 1, 2, 3], [1, 1, 2, 2], [9, 8, 5, 4], [other, same, same, other])
    # Row 1 is the second of track 1, row 2 the first of track 2; row 3 the second, row 0 the first.
    assert duplicates(branches, 3).tolist() == [False, True, False, True]
    assert duplicates(branches, 0).tolist() == [False] * 4
    both = made([0, 1], [1, 2], [5, 6], [same, same])
    assert duplicates(both, 3).tolist() == [True, False]
    both = made([0, 1], [1, 2], [5, 6], [same, same], confirmed=[True, False])
    assert duplicates(both, 3).tolist() == [False, True]
    # One that has not lived so long, or has missed the scan, is none.
    assert duplicates(made([0, 1], [1, 2], [5, 6], [[6], [6]]), 3).tolist() == [False, False]
    missed = made([0, 1], [1, 2], [5, 6], [[4, 5, -1], [4, 5, -1]])
    assert duplicates(missed, 3).tolist() == [False, False]


def test_caps_keep_the_best():
    counters = tracker_of().counters
    branches = made(
        np.arange(6) * 9.0,
        [1, 1, 1, 2, 2, 3],
        [9, 8, 7, 3, 2, 1],
        [[k] for k in range(6)],
        confirmed=[0, 0, 0, 1, 1, 0],
    )
    kept = cap(branches, parameters(max_sets_per_track=2), counters)
    assert kept.score.tolist() == [9, 8, 3, 2, 1]
    kept = cap(branches, parameters(max_sets=4), counters)
    assert kept.score.tolist() == [9, 3, 2, 1]
    assert counters["sets_over_track_limit"] == 1
    assert counters["sets_over_limit"] == 2


def test_an_only_successor_keeps_its_id():
    branches = made([0, 1, 2, 3], [1, 1, 2, 3], [4, 3, 2, 1], [[k] for k in range(4)])
    branches.branch_id[:] = [7, 7, 8, 0]
    named = with_ids(branches, 20)
    assert named.branch_id.tolist() == [20, 21, 8, 22]
    assert named.parent_id.tolist() == [7, 7, 8, 0]


def test_parameters_that_do_not_go_together_are_refused():
    with pytest.raises(ParameterError, match="confirmation_hits = 5: allowed is at most"):
        parameters(confirmation_hits=5, confirmation_scans=4)


def test_coverage_counts_the_set_and_the_covariance_about_it():
    sets = outputs_of()[0][0]
    far = sets.centroid[0, :2] + [0.0, sets.position_radius_m[0] * 1.05]
    assert covering(sets, far[None])[0, 0]
    assert not covering(sets, far[None] + 500.0)[0, 0]
    bare = dataclasses.replace(sets, matrix=np.zeros_like(sets.matrix))
    assert not covering(bare, far[None])[0, 0]
    assert covering(dataclasses.replace(sets), np.zeros((0, 2))).shape == (0, len(sets))


def test_tracks_of_clutter_end_and_most_of_the_confirmed_ones_are_targets():
    sets, _ = outputs_of(CLUTTERED)
    truth = scans(CLUTTERED)[1]
    confirmed = [len(np.unique(s.track_id[s.status == CONFIRMED])) for s in sets]
    covered = []
    for one, t in zip(sets[4:], truth[4:], strict=True):
        rows = one.status == CONFIRMED
        covered.append(covering(one, t.target_state[:, :2])[:, rows].any(axis=1).mean())
    assert np.mean(covered) > 0.85
    assert np.mean(confirmed[4:]) < 8.0
