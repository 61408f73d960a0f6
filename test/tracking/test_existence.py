"""How probably there is a target behind a track: worked values, enumeration, calibration."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from tracking_examples import assert_same, initial_tracks, moving, ring_of, scan_at, simulated

from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.existence import existence_of_tracks, log_room
from gda_tracker.tracking.extraction import held_between, sequential_test
from gda_tracker.tracking.mht.decision import global_hypothesis
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE, Detections, ScanKey, Tracks

REGION_M, REGION_RAD = (1000.0, 5000.0), 1.0
NOISE = {"range_std_m": 10.0, "azimuth_std_rad": 0.005}
FASTEST_MPS, DETECTED = 20.0, 0.9


# --- what it is made of -------------------------------------------------------------------------


@pytest.mark.parametrize("decision", ["map", "mht"])
@pytest.mark.parametrize("extraction", ["m_of_n", "sequential"])
def test_a_track_by_itself_has_prior_times_likelihood_ratio(decision, extraction):
    """From two detections 11.2 m apart, one second, through hits and misses to the end."""
    rules = {"extraction": extraction, "decision": decision, "filter": "cv"}
    ring = ring_of(
        **rules,
        **NOISE,
        attribute_term="none",
        clutter_density_per_m_rad=1e-4,
        mht_new_target_ratio=0.2,
        max_speed_mps=FASTEST_MPS,
    )
    for k in range(2):
        tracks = ring.process(scan_at(k, [moving(k)])).tracks
    first, second = np.array(moving(0)), np.array(moving(1))
    spread = np.zeros((2, 2))
    for position in (first, second):
        r = math.hypot(*position)
        along = position / r
        across = np.array([-along[1], along[0]])
        spread += 100.0 * np.outer(along, along) + (0.005 * r) ** 2 * np.outer(across, across)
    density = multivariate_normal.pdf(
        second - first, np.zeros(2), spread + FASTEST_MPS**2 / 4.0 * np.eye(2)
    )
    odds = 0.2 * 0.9 * density * math.hypot(*second) / 1e-4
    assert tracks.existence_probability[0] == pytest.approx(odds / (1.0 + odds), rel=1e-9)
    told = [float(tracks.existence_probability[0])]
    for k, visible in enumerate("1110000", 2):
        before = ring.manager.state.table.log_likelihood_ratio
        tracks = ring.process(scan_at(k, [moving(k)] if visible == "1" else [])).tracks
        if not len(tracks):
            break
        ratio = float(ring.manager.state.table.log_likelihood_ratio[0])
        assert tracks.existence_probability[0] == pytest.approx(
            1.0 / (1.0 + math.exp(-math.log(odds) - ratio)), rel=1e-12
        )
        if visible == "0":
            assert ratio - before[0] == pytest.approx(math.log(1.0 - 0.9 * 0.99))
        told.append(float(tracks.existence_probability[0]))
    assert told[0] < told[1] <= told[3]
    assert (np.diff(told[3:]) < 0.0).all()


def test_after_a_gap_the_missed_scans_count():
    options = {"attribute_term": "none", "initiation_memory_scans": 3, "filter": "cv"}
    odds = {}
    for probability in (0.9, 0.6):
        ring = ring_of(**options, decision="map", detection_probability=probability)
        ring.process(scan_at(0, [moving(0)]))
        ring.process(scan_at(1, []))
        ring.process(scan_at(2, [moving(2)]))
        odds[probability] = float(ring.manager.state.table.log_prior_odds[0])
    expected = math.log(0.9 * 0.1) - math.log(0.6 * 0.4)
    assert odds[0.9] - odds[0.6] == pytest.approx(expected)


def test_given_tracks_exist_until_misses_say_otherwise():
    for extraction in ("m_of_n", "sequential"):
        ring = ring_of(
            extraction=extraction,
            initiation="labelled",
            decision="map",
            attribute_term="none",
            filter="cv",
        )
        ring.initialise(initial_tracks(1))
        told = [ring.process(scan_at(11 + k, [])).tracks.existence_probability[0] for k in range(3)]
        accept = sequential_test(0.001, 0.05).log_accept
        for misses, probability in enumerate(told, 1):
            first = 0.0 if extraction == "sequential" else accept
            if misses == 1 and extraction == "sequential":
                assert probability == pytest.approx(1.0, abs=2e-3)
                continue
            held = accept + (misses - (1 if first == 0.0 else 0)) * math.log(1 - 0.9 * 0.99)
            assert probability == pytest.approx(1.0 / (1.0 + math.exp(-held)), rel=1e-9)


def test_the_ratio_is_held_between_the_thresholds():
    test = sequential_test(0.01, 0.05)
    a, b = test.log_reject, test.log_accept
    ratio = np.array([0.0, np.inf, np.inf, b, a, 1.0])
    step = np.array([1.5, -np.inf, -1.0, 9.0, -9.0, np.inf])
    np.testing.assert_allclose(held_between(ratio, step, test), [1.5, a, b - 1.0, b, a, b])


def test_tracks_made_without_it_do_not_know():
    made = Tracks(key=ScanKey(0, "radar", 0), track_id=np.arange(3))
    assert np.isnan(made.existence_probability).all()
    assert len(made.existence_probability) == 3


# --- room among other tracks --------------------------------------------------------------------


def share_with_room(score, track, used, one, mandatory):
    """Share of the weight of the others' hypotheses that fit a leaf of ``one``, on average."""
    tracks = [t for t in range(track[-1] + 1) if t != one]
    options = [[*np.flatnonzero(track == t), *([] if t in mandatory else [None])] for t in tracks]
    own = np.flatnonzero(track == one)
    total = fitting = 0.0
    for choice in itertools.product(*options):
        leaves = [leaf for leaf in choice if leaf is not None]
        numbers = [n for leaf in leaves for n in used[leaf] if n >= 0]
        if len(set(numbers)) < len(numbers):
            continue
        weight = math.exp(sum(score[leaf] for leaf in leaves))
        total += weight
        fitting += weight * sum(
            math.exp(score[leaf])
            for leaf in own
            if not set(used[leaf][used[leaf] >= 0]) & {*numbers}
        )
    return fitting / total / np.exp(score[own]).sum()


def test_room_is_what_enumeration_says():
    rng = np.random.default_rng(3)
    crowded = 0
    for _ in range(40):
        count = int(rng.integers(2, 5))
        track = np.repeat(np.arange(count), 3)
        score = rng.normal(1.0, 2.0, len(track))
        used = rng.integers(0, 5, (len(track), 2))
        used[:, 1] += 5
        used[rng.random(used.shape) < 0.4] = -1
        mandatory = set(np.flatnonzero(rng.random(count) < 0.4).tolist())
        for t in mandatory:
            used[3 * t + 2] = -1  # so that there is a hypothesis with all of them
        optional = np.array([t for t in range(count) if t not in mandatory], dtype=np.int64)
        _, _, absent = global_hypothesis(score, track, used, optional)
        found = log_room(score, track, optional, absent)
        for place, one in enumerate(optional):
            expected = share_with_room(score, track, used, one, mandatory)
            assert math.exp(found[place]) == pytest.approx(expected, rel=1e-7)
            crowded += expected < 0.9
    assert crowded > 20


def test_room_without_weight_or_absence():
    score, track = np.array([-np.inf, 700.0, 1.0]), np.array([0, 1, 2])
    absent = np.array([1.0, 0.0, 1.0])
    found = log_room(score, track, np.array([0, 1, 2]), absent)
    np.testing.assert_array_equal(found, [-np.inf, 0.0, -np.inf])
    assert len(log_room(score, track, np.zeros(0, dtype=np.int64), np.zeros(0))) == 0


def test_a_tentative_track_that_shares_its_detections_is_less_probable():
    """Two starts from one pair of detections and a third one: at least one is not a target's."""
    options = {"attribute_term": "none", "clutter_density_per_m_rad": 1e-3, "extraction": "m_of_n"}
    ring = ring_of(**options, **NOISE, decision="mht", filter="cv", max_speed_mps=60.0)
    x, y = moving(0)
    rooms, old = [], np.zeros(0, dtype=np.int64)
    for k, offsets in enumerate([(-25.0, 25.0), (-20.0, 20.0), (0.0,), (0.0,), (0.0,)]):
        result = ring.process(scan_at(k, [(x + d, y) for d in offsets]))
        table = ring.manager.state.table
        rooms += table.log_room[table.status == TENTATIVE].tolist()
        np.testing.assert_array_equal(table.log_room[np.isin(table.track_id, old)], 0.0)
        old = table.track_id[table.status == CONFIRMED]
        assert (
            (0.0 <= result.tracks.existence_probability)
            & (result.tracks.existence_probability <= 1.0)
        ).all()
        np.testing.assert_array_equal(
            result.tracks.existence_probability, existence_of_tracks(table)[table.chosen]
        )
    assert min(rooms) < -0.1
    assert max(rooms) <= 0.0


def test_a_restart_tells_the_same(tmp_path):
    scans = simulated(n_scans=16, clutter=8)
    rings = [
        ring_of(decision="mht", clutter_density_per_m_rad=8 / 5600.0, max_speed_mps=60.0)
        for _ in range(2)
    ]
    for scan in scans[:9]:
        rings[0].process(scan)
    save(rings[0].manager, tmp_path / "state")
    assert load(rings[1].manager, tmp_path / "state")
    assert_same(rings[0].manager.tracks(), rings[1].manager.tracks())
    for scan in scans[9:]:
        one, other = (ring.process(scan).tracks for ring in rings)
        assert_same(one.existence_probability, other.existence_probability)
    assert np.ptp(one.existence_probability) > 0.0


# --- calibration --------------------------------------------------------------------------------


def world(rng, n_scans, false_alarms, births):
    """Scans of targets that appear anywhere at any time, and where the targets are."""
    position, velocity = np.zeros((0, 2)), np.zeros((0, 2))
    for k in range(n_scans):
        n, false = rng.poisson(births), rng.poisson(false_alarms)
        r, a = rng.uniform(*REGION_M, n), rng.uniform(0.0, REGION_RAD, n)
        speed, course = FASTEST_MPS * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
        position = np.vstack([position + velocity, np.stack([r * np.cos(a), r * np.sin(a)], 1)])
        velocity = np.vstack(
            [velocity, (speed * np.stack([np.cos(course), np.sin(course)])).T.reshape(n, 2)]
        )
        seen = position[rng.random(len(position)) < DETECTED]
        measured_r = np.hypot(*seen.T) + 10.0 * rng.standard_normal(len(seen))
        measured_a = np.arctan2(seen[:, 1], seen[:, 0]) + 0.005 * rng.standard_normal(len(seen))
        yield (
            Detections(
                "radar",
                round((k + 1) * 1e9),
                np.append(measured_r, rng.uniform(*REGION_M, false)),
                np.append(measured_a, rng.uniform(0.0, REGION_RAD, false)),
            ),
            position.copy(),
        )


def stated_and_true(runs, false_alarms, births, **track_manager):
    """Probabilities of existence of young tracks, and whether a target was within 60 m."""
    stated, true = [], []
    for seed in range(runs):
        ring = ring_of(
            **NOISE,
            attribute_term="none",
            filter="cv",
            process_noise_std_mps2=0.5,
            max_speed_mps=FASTEST_MPS,
            clutter_density_per_m_rad=false_alarms / (REGION_M[1] - REGION_M[0]) / REGION_RAD,
            mht_new_target_ratio=births * DETECTED / false_alarms,
            **track_manager,
        )
        for scan, targets in world(np.random.default_rng(seed), 30, false_alarms, births):
            tracks = ring.process(scan).tracks
            young = tracks.hits + tracks.misses <= 4
            gap = np.linalg.norm(tracks.mean[young, None, :2] - targets[None], axis=2)
            stated.append(tracks.existence_probability[young])
            true.append(gap.min(axis=1, initial=np.inf) < 60.0)
    return np.concatenate(stated), np.concatenate(true)


@pytest.mark.parametrize(("decision", "extraction"), [("map", "sequential"), ("mht", "m_of_n")])
def test_of_tracks_with_a_stated_probability_as_many_are_true(decision, extraction):
    """Where the tracker is told the truth about clutter and births; within .1 in every bin.

    A target nearby by chance makes some improbable tracks true: one in twenty-five or so here.
    """
    stated, true = stated_and_true(5, 20.0, 0.5, decision=decision, extraction=extraction)
    assert len(stated) > 500
    assert stated.mean() == pytest.approx(true.mean(), abs=0.06)
    edges = (0.0, 0.05, 0.3, 0.7, 0.95, 1.0 + 1e-9)
    for low, high in itertools.pairwise(edges):
        inside = (stated >= low) & (stated < high)
        count = int(inside.sum())
        assert count > 20
        share, mean = float(true[inside].mean()), float(stated[inside].mean())
        noise = 2.0 * math.sqrt(max(mean * (1.0 - mean), 0.01) / count)
        assert share == pytest.approx(mean, abs=0.07 + noise), (low, high, count)
    # It tells apart: the improbable ones are seldom true, the probable ones nearly always.
    assert true[stated < 0.05].mean() < 0.1
    assert true[stated > 0.95].mean() > 0.95


def test_a_wrong_clutter_density_shows():
    """Told ten times too little clutter, it believes in what is not there."""
    wrong = ring_of(**NOISE, decision="map", filter="cv", clutter_density_per_m_rad=5e-4)
    right = ring_of(**NOISE, decision="map", filter="cv", clutter_density_per_m_rad=5e-3)
    for k in range(2):
        results = [ring.process(scan_at(k, [moving(k)])) for ring in (wrong, right)]
    odds = [float(p / (1.0 - p)) for p in (r.tracks.existence_probability[0] for r in results)]
    assert odds[0] == pytest.approx(10.0 * odds[1])
