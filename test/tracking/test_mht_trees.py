"""Hypothesis trees in the ring: bounds, exclusion, delayed tracks, changes while running."""

import dataclasses

import numpy as np
import pytest
from tracking_examples import (
    SECOND,
    answers,
    assert_same,
    initial_tracks,
    moving,
    ring_of,
    scan_at,
    simulated,
)

from gda_tracker.kinematics.gating import gate
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.answers import Inconsistent
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE

SCANS = simulated(40, n_targets=5, clutter=40, seed=5)
CLUTTERED = {"clutter_density_per_m_rad": 7e-3, "process_noise_std_mps2": 6.0}
DEPTH = 4


def trees(**parameters):
    return ring_of(**{"decision": "mht", "mht_scans": DEPTH, **CLUTTERED, **parameters})


def run(ring, scans):
    """Results of the scans, and everything that was told with delay."""
    results = [ring.process(scan) for scan in scans]
    delayed = [told for result in results for told in result.delayed]
    return results, [*delayed, *ring.rest_of_delayed()]


def assert_no_detection_twice(tracks):
    used = tracks.detection_index[tracks.detection_index >= 0]
    assert len(set(used.tolist())) == len(used)
    assert (np.diff(tracks.track_id) > 0).all()


def test_every_scan_is_told_once_in_order_and_no_detection_goes_to_two_tracks():
    results, delayed = run(trees(), SCANS)
    assert [d.key for d in delayed] == [r.tracks.key for r in results]
    for tracks in [*(r.tracks for r in results), *delayed]:
        assert_no_detection_twice(tracks)
    # Every scan is told as soon as it is so many scans old.
    assert [len(result.delayed) for result in results] == [0] * DEPTH + [1] * (len(SCANS) - DEPTH)


def test_the_past_told_is_the_walk_back_from_the_chosen_leaves():
    """Told by dictionaries of all nodes ever, not by the tables that the manager keeps."""
    ring = trees(mht_retrodiction=False)
    nodes, chosen, told = {}, [], {}
    for k, scan in enumerate(SCANS):
        result = ring.process(scan)
        table = ring.manager.state.table
        for row in range(len(table)):
            nodes[int(table.hypothesis_id[row])] = (
                k,
                int(table.parent_id[row]),
                int(table.track_id[row]),
                int(table.detection_index[row]),
                table.mean[row],
            )
        chosen.append(table.hypothesis_id[table.chosen].tolist())
        for delayed in result.delayed:
            told[k - DEPTH] = delayed
    assert len(told) == len(SCANS) - DEPTH
    moved = 0
    for k, delayed in told.items():
        expected = {}
        for leaf in chosen[k + DEPTH]:
            while leaf and nodes[leaf][0] > k:
                leaf = nodes[leaf][1]
            if leaf:
                expected[nodes[leaf][2]] = leaf
        live = zip(delayed.track_id.tolist(), delayed.hypothesis_id.tolist(), strict=True)
        for track, leaf in live:
            if track not in expected:
                # It has ended meanwhile, on a path that was chosen then.
                assert all(nodes[i][2] != track for i in chosen[k + DEPTH])
                continue
            assert expected.pop(track) == leaf
            row = delayed.track_id.tolist().index(track)
            assert nodes[leaf][3] == delayed.detection_index[row]
            np.testing.assert_array_equal(nodes[leaf][4], delayed.mean[row])
            moved += leaf not in chosen[k]
        assert not expected
    assert moved, "hindsight never changed anything"


@pytest.mark.parametrize("filter_name", ["cv", "imm"])
def test_delayed_states_know_what_came_later(filter_name):
    """Retrodicted by plain formulas from the filtered states, and nearer to the truth."""
    rng, scans, truth = np.random.default_rng(3), [], []
    for k in range(30):
        truth.append(moving(k, (3000.0, 1000.0), (20.0, -10.0)))
        scan = scan_at(k, [truth[-1]])
        scan.range_m += rng.normal(0.0, 10.0)
        scan.azimuth_rad += rng.normal(0.0, 0.001 * 3)
        scans.append(scan)
    parameters = {
        "filter": filter_name,
        "azimuth_std_rad": 0.003,
        "process_noise_std_mps2": 1.0,
        "clutter_density_per_m_rad": 1e-6,
    }
    results, delayed = run(trees(**parameters), scans)
    filtered = np.array([r.tracks.mean[0] for r in results[12:]])
    smoothed = np.array([d.mean[0] for d in delayed[12:]])
    error = [np.square(v[:, :2] - truth[12:]).sum(axis=1).mean() for v in (filtered, smoothed)]
    assert error[1] < 0.7 * error[0]
    np.testing.assert_array_equal(smoothed[-1], filtered[-1])
    if filter_name == "imm":
        return
    f = np.eye(4)
    f[0, 2] = f[1, 3] = 1.0
    g = np.array([[0.5, 0], [0, 0.5], [1.0, 0], [0, 1.0]])
    for k in (10, 20, 28):
        last = min(k + DEPTH, 29)
        mean, spread = results[last].tracks.mean[0], results[last].tracks.covariance[0]
        for earlier in range(last - 1, k - 1, -1):
            x, p = results[earlier].tracks.mean[0], results[earlier].tracks.covariance[0]
            predicted = f @ p @ f.T + g @ g.T
            gain = p @ f.T @ np.linalg.inv(predicted)
            mean, spread = x + gain @ (mean - f @ x), p + gain @ (spread - predicted) @ gain.T
        np.testing.assert_allclose(delayed[k].mean[0], mean, rtol=0, atol=1e-7)
        np.testing.assert_allclose(delayed[k].covariance[0], spread, rtol=1e-7, atol=1e-9)


def test_a_track_that_has_ended_is_in_the_past_told_as_long_as_it_lived():
    ring = trees(deletion_misses=2)
    scans = [scan_at(k, [moving(k)] if k < 6 else []) for k in range(12)]
    results, delayed = run(ring, scans)
    ended = next(k for k, r in enumerate(results) if len(r.tracks.deleted_track_id))
    assert ended == 7
    assert [len(d) for d in delayed] == [len(r.tracks) for r in results]
    assert delayed[ended].deleted_track_id.tolist() == [1]
    assert [d.detection_index[0] for d in delayed[1:7]] == [0] * 5 + [-1]


def test_hindsight_mends_what_the_scan_alone_gets_wrong():
    """A scan with a false alarm where the track is expected, the own detection aside."""
    outcome = {}
    for decision in ("map", "mht"):
        ring = ring_of(
            decision=decision,
            initiation="labelled",
            attribute_term="none",
            deletion_misses=0,
            detection_probability=0.95,
            clutter_density_per_m_rad=1e-3,
            process_noise_std_mps2=6.0,
        )
        ring.initialise(initial_tracks(1))
        start, velocity = np.array([3000.0, 1000.0]), np.array([10.0, -5.0])
        # The target turns away; a false alarm stands where it would have been.
        tangent = np.array([0.45, 0.9])
        scans = []
        for k in range(1, 8):
            straight = start + (10 + k) * velocity
            turned = straight + tangent * 5.0 * max(k - 2, 0) ** 1.5
            places = [turned] if k != 4 else [turned, straight + tangent * 3.0]
            scans.append(scan_at(10 + k, places))
        results, delayed = run(ring, scans)
        outcome[decision] = [int(r.tracks.detection_index[0]) for r in results]
        if decision == "mht":
            revised = [int(d.detection_index[0]) for d in delayed]
    assert outcome["mht"][3] == outcome["map"][3] == 1
    assert revised == [0] * 7


def test_the_trees_are_bounded_and_stay_so():
    parameters = {"mht_leaves_per_track": 6, "mht_max_leaves": 15, "mht_leaf_probability": 0.0}
    ring = trees(**parameters)
    most = 0
    for scan in simulated(150, n_targets=6, clutter=25, seed=8):
        ring.process(scan)
        state = ring.manager.state
        count = np.bincount(state.table.track_id)
        tracks = np.count_nonzero(state.table.chosen)
        assert count.max(initial=0) <= 6
        assert len(state.table) <= max(15, tracks) + tracks  # those born count from the next scan
        assert len(state.generations) <= DEPTH - 1
        most = max(most, len(state.table))
    assert most > 8


def test_one_leaf_per_track_speaks_and_statuses_are_the_tracks():
    ring = trees()
    for scan in SCANS:
        result = ring.process(scan)
        table = ring.manager.state.table
        for track in np.unique(table.track_id):
            rows = table.track_id == track
            assert table.chosen[rows].sum() == 1
            assert len(set(table.status[rows].tolist())) == 1
        assert (np.diff(table.hypothesis_id) > 0).all()
        assert (np.diff(table.track_id) >= 0).all()
        assert result.report.tracks_confirmed == (result.tracks.status == CONFIRMED).sum()
        assert result.report.tracks_tentative == (result.tracks.status == TENTATIVE).sum()
        # Rows of one track in the predictions exclude each other.
        assert len(result.predictions) == len(result.predictions.track_id)


def test_targets_are_found_and_kept_in_clutter():
    """As single-scan association does, with the same confirmation."""
    found = {}
    for decision in ("map", "mht"):
        ring = ring_of(decision=decision, clutter_density_per_m_rad=1e-3)
        results, _ = run(ring, simulated(40, n_targets=3, clutter=4, seed=2))
        last = results[-1].tracks
        found[decision] = {i for i, h in zip(last.track_id, last.hits, strict=True) if h > 20}
    assert len(found["map"]) == len(found["mht"]) == 3


@pytest.mark.parametrize("term", ["none", "dsm_classic", "bayes"])
@pytest.mark.parametrize("filter_name", ["cv", "imm"])
def test_restarted_at_every_scan_it_goes_on_bit_for_bit(tmp_path, term, filter_name):
    path = tmp_path / "state"
    parameters = {"attribute_term": term, "filter": filter_name, "deletion_misses": 2}
    through, restarting = trees(**parameters), trees(**parameters)
    for k, scan in enumerate(SCANS[:16]):
        expected, result = through.process(scan), restarting.process(scan)
        assert_same(result, expected, f"scan {k}")
        checkpoint.save(restarting.manager, path)
        restarting = trees(**parameters)
        assert checkpoint.load(restarting.manager, path)
        assert_same(restarting.manager.state, through.manager.state, f"scan {k}")
    assert len(expected.delayed[0]) > 2
    assert_same(restarting.rest_of_delayed(), through.rest_of_delayed())


def change(ring, **parameters):
    manager = ring.manager
    manager.set_parameters(dataclasses.replace(manager.parameters, **parameters))


def test_to_map_the_trees_collapse_to_the_chosen_leaves_and_back_they_grow():
    ring, before = trees(), []
    while len(before) < 12 or len(ring.manager.state.table) == len(before[-1].tracks):
        before.append(ring.process(SCANS[len(before)]))
    now = len(before)
    told = [d.key for r in before for d in r.delayed]
    change(ring, decision="map")
    result = ring.process(SCANS[now])
    assert result.predictions.hypothesis_id.tolist() == before[-1].tracks.hypothesis_id.tolist()
    table = ring.manager.state.table
    assert table.chosen.all()
    assert table.detection_numbers.shape[1] == 0
    assert not ring.manager.state.generations
    # What was still open is told at once.
    told += [d.key for d in result.delayed]
    assert told == [r.tracks.key for r in before]
    assert ring.rest_of_delayed() == []
    last = ring.process(SCANS[now + 1])
    assert last.delayed == ()
    change(ring, decision="mht")
    results, delayed = run(ring, SCANS[now + 2 :])
    assert [d.key for d in delayed] == [r.tracks.key for r in results]
    assert results[0].predictions.hypothesis_id.tolist() == last.tracks.hypothesis_id.tolist()
    assert any(len(r.predictions) > len(set(r.predictions.track_id.tolist())) for r in results)


@pytest.mark.parametrize("depth", [2, 7])
def test_another_depth_at_a_scan_boundary(depth):
    ring = trees()
    before = [ring.process(scan) for scan in SCANS[:12]]
    change(ring, mht_scans=depth)
    results, delayed = run(ring, SCANS[12:])
    keys = [d.key for r in before for d in r.delayed] + [d.key for d in delayed]
    assert keys == [r.tracks.key for r in [*before, *results]]
    assert len(ring.manager.state.generations) == depth - 1
    assert ring.manager.state.table.detection_numbers.shape[1] == depth


def test_a_scan_given_up_leaves_the_tracks_predicted_and_the_past_complete():
    ring = trees()
    results = [ring.process(scan) for scan in SCANS[:10]]
    ring.manager.admit(SCANS[10])
    ring.manager.open()
    tracks, report = ring.manager.give_up()
    told = list(ring.manager.delayed)
    assert report.outcome == "gave_up"
    assert tracks.track_id.tolist() == results[-1].tracks.track_id.tolist()
    assert (tracks.detection_index == -1).all()
    np.testing.assert_array_equal(tracks.misses, results[-1].tracks.misses)
    later, delayed = run(ring, SCANS[11:20])
    keys = [d.key for r in results for d in r.delayed] + [d.key for d in [*told, *delayed]]
    assert keys == [r.tracks.key for r in results] + [tracks.key] + [r.tracks.key for r in later]
    for tracks in delayed:
        assert_no_detection_twice(tracks)


def test_degraded_scans_grow_the_trees_by_kinematics_alone():
    ring, alone = trees(attribute_term="bayes"), trees(attribute_term="none")
    for scan in SCANS[:20]:
        ring.manager.admit(scan)
        opened = ring.manager.open()
        opened.predictions.settings = dataclasses.replace(
            opened.predictions.settings, degraded=True
        )
        evidence, _, _ = answers(ring)
        pairs = gate(opened.scan, opened.predictions)
        associations = ring.associate(opened.scan, opened.predictions, None, pairs)
        tracks, report = ring.manager.close(evidence, None, associations)
        assert report.outcome == "degraded"
        expected = alone.process(scan).tracks
        np.testing.assert_array_equal(tracks.detection_index, expected.detection_index)
        np.testing.assert_array_equal(tracks.mean, expected.mean)


def test_a_gap_ends_the_trees_and_tells_what_is_open():
    ring = trees(max_gap_s=5.0)
    results = [ring.process(scan) for scan in SCANS[:12]]
    late = dataclasses.replace(SCANS[12], stamp_ns=SCANS[12].stamp_ns + 100 * SECOND)
    result = ring.process(late)
    live = results[-1].tracks.track_id.tolist()
    assert result.tracks.deleted_track_id.tolist() == live
    keys = [d.key for r in results for d in r.delayed] + [d.key for d in result.delayed]
    assert keys == [r.tracks.key for r in results]
    assert result.delayed[-1].track_id.tolist() == live
    assert [d.key for d in ring.rest_of_delayed()] == [result.tracks.key]


def test_initial_tracks_end_the_trees_and_the_past_is_told():
    ring = trees()
    results = [ring.process(scan) for scan in SCANS[:12]]
    ring.initialise(initial_tracks(2, stamp_s=500.0))
    keys = [d.key for r in results for d in r.delayed] + [d.key for d in ring.manager.delayed]
    assert keys == [r.tracks.key for r in results]
    assert not ring.manager.state.generations


def test_certain_detection_and_no_clutter_have_an_answer():
    ring = trees(detection_probability=1.0, clutter_density_per_m_rad=0.0)
    for scan in simulated(20, n_targets=3, clutter=3, seed=4):
        result = ring.process(scan)
        assert np.isfinite(ring.manager.state.table.log_score).all()
        assert_no_detection_twice(result.tracks)
    assert len(result.tracks)


def test_a_tentative_track_that_loses_its_detections_to_another_ends_and_leaves_no_past():
    """Two starts may not both be told to have used one detection."""
    ring = trees(confirmation_hits=4, confirmation_scans=6, deletion_misses=2, mht_scans=6)
    results, delayed = run(ring, simulated(60, n_targets=4, clutter=60, seed=6))
    for tracks in delayed:
        assert_no_detection_twice(tracks)
    ids = [set(r.tracks.track_id.tolist()) for r in results]
    gone = [set(r.tracks.deleted_track_id.tolist()) for r in results]
    # Every track that is no longer there was said to have ended.
    for k in range(1, len(results)):
        assert ids[k - 1] - ids[k] == gone[k]


def test_what_a_track_had_when_it_ended_no_other_track_turns_out_to_have_had():
    ring = trees(deletion_misses=1, mht_leaf_probability=0.0, mht_leaves_per_track=30)
    rng, checked = np.random.default_rng(2), 0
    for k in range(60):
        # A crowd: everything is in the gate of everything.
        place = np.array([2000.0, 1000.0]) + rng.normal(0.0, 60.0, (int(rng.integers(1, 7)), 2))
        ring.process(scan_at(k, place))
        state = ring.manager.state
        for generation in state.generations:
            kept = generation.table.detection_numbers[generation.settled, 0]
            kept = kept[kept >= 0]
            checked += len(kept)
            assert not np.isin(state.table.detection_numbers, kept).any()
    assert checked > 10


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["kinematic_log_likelihood", "attribute_log_likelihood"])
def test_an_answer_without_sense_changes_nothing(name, value):
    ring, other = trees(), trees()
    for scan in SCANS[:10]:
        ring.process(scan)
        other.process(scan)
    ring.manager.admit(SCANS[10])
    ring.manager.open()
    evidence, scores, associations = answers(ring)
    wrong = getattr(associations, name).copy()
    wrong[0] = value
    with pytest.raises(Inconsistent, match="log likelihood"):
        ring.manager.close(evidence, scores, dataclasses.replace(associations, **{name: wrong}))
    # Asked again, the stages answer well.
    tracks, _ = ring.manager.close(evidence, scores, associations)
    assert_same(tracks, other.process(SCANS[10]).tracks)
    assert_same(ring.manager.state, other.manager.state)
