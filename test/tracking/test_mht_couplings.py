"""Hypothesis trees with shared detections: every joint history, weight and probability."""

import numpy as np
import pytest
from group_histories import Radar, joint_scan, predicted
from scipy.stats import chi2
from tracking_examples import SECOND, initial_tracks

from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.mht import compounds as compounds_module
from gda_tracker.tracking.mht import shared_branches, threes
from gda_tracker.tracking.mht.compounds import coupled_global_hypothesis
from gda_tracker.tracking.mht.couplings import components, coupled_tracks, together
from gda_tracker.tracking.mht.growth import ranks
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

RADAR = Radar(2.0, 3.0, 15.0, 0.005, 0.9, 0.8, 2e-4, chi2.ppf(0.99, 2), (60.0, 0.03))
UNPRUNED = {"mht_scans": 60, "mht_leaf_probability": 0.0, "mht_leaves_per_track": 10_000}


def ring_of(radar=RADAR, **more):
    manager = {
        "decision": "mht",
        "attribute_term": "none",
        "initiation": "labelled",
        "range_std_m": radar.range_std,
        "azimuth_std_rad": radar.azimuth_std,
        "filter": "cv",
        "process_noise_std_mps2": radar.process_noise,
        "detection_probability": radar.p_d,
        "clutter_density_per_m_rad": radar.clutter,
        "gate_probability": 0.99,
        "deletion_misses": 0,
        "resolution_range_m": radar.resolution[0],
        "resolution_azimuth_rad": radar.resolution[1],
        "unresolved_detection_probability": radar.p_group,
    }
    return Ring({"track_manager": manager | more})


def case(seed, n, n_scans, most):
    rng = np.random.default_rng(seed)
    mean = np.zeros((n, 4))
    mean[:, :2] = [3000.0, 1000.0] + rng.normal(0.0, 40.0, (n, 2))
    mean[:, 2:] = rng.normal(0.0, 10.0, (n, 2))
    covariance = np.tile(np.diag([400.0, 400.0, 60.0, 60.0]), (n, 1, 1))
    scans = []
    for k in range(1, n_scans + 1):
        count = int(rng.integers(1, most + 1))
        place = mean[rng.integers(0, n, count), :2] + k * RADAR.dt_s * mean[:, 2:].mean(axis=0)
        place = place + rng.normal(0.0, 25.0, (count, 2))
        scans.append(np.stack([np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])], axis=1))
    return mean, covariance, scans


def fed(ring, mean, covariance, scans):
    ring.initialise(initial_tracks(len(mean), mean=mean, covariance=covariance))
    for k, scan in enumerate(scans, 1):
        stamp = round((10.0 + k * RADAR.dt_s) * SECOND)
        result = ring.process(Detections("radar", stamp, scan[:, 0], scan[:, 1]))
    return result


def joint_histories(mean, covariance, scans, together=True, threes=False):
    """Log weights and states of all joint histories.

    That a group gave nothing changes no state: ``together`` it is one history with two misses.
    """
    level = [(0.0, (), list(zip(mean, covariance, strict=True)))]
    for scan in scans:
        following = {}
        for weight, key, states in level:
            moved = [predicted(x, p, RADAR) for x, p in states]
            for more, detection, groups, after in joint_scan(moved, scan, RADAR, threes):
                shared = frozenset(pair for pair, j in groups.items() if j >= 0 or not together)
                name = (*key, (detection, shared))
                total = np.logaddexp(following.get(name, (-np.inf,))[0], weight + more)
                following[name] = (total, name, after)
        level = list(following.values())
    return level


@pytest.mark.parametrize(("n_scans", "most"), [(1, 3), (2, 2), (3, 1)])
def test_two_tracks_have_every_joint_history(monkeypatch, n_scans, most):
    monkeypatch.setattr(shared_branches, "MOST_EVENTS", 10_000)
    monkeypatch.setattr(compounds_module, "MOST_COMPOUNDS", 10_000_000)
    shared = 0
    for seed in range(4):
        mean, covariance, scans = case(seed, 2, n_scans, most)
        known = joint_histories(mean, covariance, scans)
        ring = ring_of(**UNPRUNED)
        fed(ring, mean, covariance, scans)
        table, couplings = ring.manager.state.table, ring.manager.state.couplings
        track = ranks(table.track_id)
        coupled = coupled_tracks(couplings, table.hypothesis_id, track)
        assert [(pair.first, pair.second) for pair in coupled] == [(0, 1)]
        rows = [np.flatnonzero(track == t) for t in (0, 1)]
        scores = [table.log_score[r] for r in rows]
        total = scores[0][:, None] + scores[1] + coupled[0].log_factor
        # All of them, with their weights.
        weights = np.sort([one[0] for one in known])
        np.testing.assert_allclose(np.sort(total[total > -np.inf]), weights, atol=1e-8)
        # The best one, and its states.
        best = max(known, key=lambda one: one[0])
        chosen = np.flatnonzero(table.chosen)
        for row, (x, p) in zip(chosen, best[2], strict=True):
            np.testing.assert_allclose(table.mean[row], x, rtol=1e-9)
            np.testing.assert_allclose(table.covariance[row], p, rtol=1e-6, atol=1e-6)
        shared += any(pairs for one in known for _, pairs in one[1])
        # The probability of every leaf, named by its state.
        _, probability, _ = coupled_global_hypothesis(
            table.log_score, track, table.detection_numbers, np.zeros(0, dtype=np.int64), coupled
        )
        share = np.exp(np.array([one[0] for one in known]) - weights[-1])
        share /= share.sum()
        for t in (0, 1):
            states = np.array([one[2][t][0] for one in known])
            for row in rows[t]:
                same = np.abs(states - table.mean[row]).max(axis=1) < 1e-6
                twins = np.abs(table.mean[rows[t]] - table.mean[row]).max(axis=1) < 1e-6
                assert share[same].sum() == pytest.approx(
                    probability[rows[t]][twins].sum(), abs=1e-6
                )
            assert probability[rows[t]].sum() == pytest.approx(1.0)
    assert shared


@pytest.mark.parametrize(("n_scans", "most", "seeds"), [(1, 2, 3), (2, 1, 2)])
def test_three_tracks_have_every_joint_history(monkeypatch, n_scans, most, seeds):
    for name in ("MOST_PAIRS", "MOST_COMPOUNDS"):
        monkeypatch.setattr(compounds_module, name, 10_000_000)
    for module, name in ((threes, "MOST_PARENTS"), (threes, "MOST_EVENTS_OF_THREE")):
        monkeypatch.setattr(module, name, 10_000_000)
    monkeypatch.setattr(shared_branches, "MOST_EVENTS", 10_000)
    of_three = 0
    for seed in range(seeds):
        mean, covariance, scans = case(50 + seed, 3, n_scans, most)
        known = joint_histories(mean, covariance, scans, together=False, threes=True)
        of_three += sum(any(len(g) == 3 for _, groups in one[1] for g in groups) for one in known)
        ring = ring_of(**UNPRUNED)
        fed(ring, mean, covariance, scans)
        table = ring.manager.state.table
        track = ranks(table.track_id)
        coupled = coupled_tracks(ring.manager.state.couplings, table.hypothesis_id, track)
        _, found = compounds_module.compounds(
            (0, 1, 2), coupled, table.log_score, track, table.detection_numbers
        )
        # That a group of three or two gave nothing changes no state, but is a branch.
        weights = np.sort([one[0] for one in known])
        np.testing.assert_allclose(np.sort(found), weights, atol=1e-7)
        best = max(known, key=lambda one: one[0])
        chosen = np.flatnonzero(table.chosen)
        for row, (x, p) in zip(chosen, best[2], strict=True):
            np.testing.assert_allclose(table.mean[row], x, rtol=1e-9)
            np.testing.assert_allclose(table.covariance[row], p, rtol=1e-6, atol=1e-6)
    assert of_three


def test_couplings_end_after_the_window():
    mean, covariance, scans = case(1, 2, 2, 2)
    ring = ring_of(mht_scans=3)
    fed(ring, mean, covariance, scans)
    assert len(ring.manager.state.couplings)
    # They part: each has its own detections, kilometres away from the other's.
    for k in range(3, 12):
        table = ring.manager.state.table
        states = table.mean[table.chosen][:, :2] + [[60.0 * k, 0.0], [-60.0 * k, 0.0]]
        scan = np.stack([np.hypot(*states.T), np.arctan2(states[:, 1], states[:, 0])], axis=1)
        stamp = round((10.0 + k * 8.0) * SECOND)
        ring.process(Detections("radar", stamp, scan[:, 0], scan[:, 1]))
    assert not len(ring.manager.state.couplings)
    assert sorted(ring.manager.tracks().track_id) == [1, 2]


def test_a_checkpoint_goes_on_bit_for_bit(tmp_path):
    mean, covariance, scans = case(2, 3, 6, 2)
    whole, first = ring_of(), ring_of()
    expected = fed(whole, mean, covariance, scans)
    fed(first, mean, covariance, scans[:3])
    assert len(first.manager.state.couplings)
    checkpoint.save(first.manager, tmp_path / "state")
    second = ring_of()
    assert checkpoint.load(second.manager, tmp_path / "state")
    for k, scan in enumerate(scans[3:], 4):
        stamp = round((10.0 + k * RADAR.dt_s) * SECOND)
        result = second.process(Detections("radar", stamp, scan[:, 0], scan[:, 1]))
    for name in ("mean", "covariance", "hits", "detection_index"):
        np.testing.assert_array_equal(getattr(result.tracks, name), getattr(expected.tracks, name))
    for name in ("first", "second", "log_factor"):
        np.testing.assert_array_equal(
            getattr(second.manager.state.couplings, name),
            getattr(whole.manager.state.couplings, name),
        )


def test_a_scan_without_an_answer_leaves_shared_detections_be():
    mean, covariance, scans = case(1, 2, 2, 1)
    ring = ring_of()
    fed(ring, mean, covariance, scans)
    chosen = ring.manager.state.table.select(ring.manager.state.table.chosen)
    stamp = round(20.0 * SECOND)
    ring.manager.admit(Detections("radar", stamp, scans[0][:, 0], scans[0][:, 1]))
    ring.manager.open()
    tracks, _ = ring.manager.give_up()
    assert tracks.track_id.tolist() == [1, 2]
    after = ring.manager.state.table
    numbers = after.detection_numbers[after.chosen]
    np.testing.assert_array_equal(numbers[:, 1:], chosen.detection_numbers[:, :-1])
    assert len(ring.manager.state.couplings)


def test_a_track_that_ends_leaves_its_partner_what_they_shared():
    mean, covariance, scans = case(1, 2, 2, 1)
    ring = ring_of(deletion_misses=2)
    fed(ring, mean, covariance, scans)
    for k in range(3, 9):
        table = ring.manager.state.table
        if table.track_id[table.chosen].tolist() != [1, 2]:
            break
        # Detections go on with the first track alone, far from the second's next place.
        own = table.mean[table.chosen][0, :2] + [150.0 * k, 0.0]
        stamp = round((10.0 + k * 4.0) * SECOND)
        ring.process(
            Detections("radar", stamp, np.array([np.hypot(*own)]), np.arctan2([own[1]], [own[0]]))
        )
    state = ring.manager.state
    live = set(state.table.track_id.tolist())
    assert live <= {1, 2}
    assert len(live) < 2
    assert not len(state.couplings)
    assert (state.table.track_id[state.table.chosen] == sorted(live)).all()


def test_at_most_three_tracks_are_coupled():
    assert together([(0, 1), (1, 2), (2, 3), (3, 4)]) == [True, True, False, True]
    assert sorted(components([(0, 1), (3, 4), (1, 2)])) == [(0, 1, 2), (3, 4)]


def test_only_detections_that_are_near_are_weighed_for_groups_of_three(monkeypatch):
    mean, covariance, scans = case(0, 3, 1, 2)
    rng = np.random.default_rng(1)
    far = np.stack([rng.uniform(4000.0, 30_000.0, 300), rng.uniform(-3.0, 3.0, 300)], axis=1)
    weighed, likelihood = [], threes.three_log_likelihood

    def counted(measurements, *args):
        weighed.append(np.unique(args[-1]))
        return likelihood(measurements, *args)

    monkeypatch.setattr(threes, "three_log_likelihood", counted)
    scores = []
    for scan in (scans[0], np.concatenate([scans[0], far])):
        ring = ring_of(**UNPRUNED)
        fed(ring, mean, covariance, [scan])
        scores.append(np.sort(ring.manager.state.table.log_score))
        assert weighed[-1].tolist() == list(range(len(scans[0])))
    np.testing.assert_allclose(scores[1], scores[0])
