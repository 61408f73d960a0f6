"""Sequential extraction in the manager, with the real stages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracking_examples import assert_same, initial_tracks, moving, ring_of, scan_at, simulated

from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.extraction import scan_increments, sequential_test
from gda_tracker.vocabulary import CONFIRMED, Detections

CLUTTER_PER_SCAN = 30
NOISE = {
    "range_std_m": 10.0,
    "azimuth_std_rad": 0.005,
    "max_speed_mps": 20.0,
    "process_noise_std_mps2": 0.5,
    "attribute_term": "none",
    # False alarms are spread over 4 km and 1 rad.
    "clutter_density_per_m_rad": CLUTTER_PER_SCAN / 4000.0,
}


def sequential(**track_manager):
    return ring_of(extraction="sequential", **track_manager)


def noisy(rng, stamp_s, positions):
    """Noisy detections of the positions among false alarms."""
    positions = np.asarray(positions).reshape(-1, 2)
    n, false = len(positions), rng.poisson(CLUTTER_PER_SCAN)
    r = np.hypot(*positions.T) + 10.0 * rng.standard_normal(n)
    a = np.arctan2(positions[:, 1], positions[:, 0]) + 0.005 * rng.standard_normal(n)
    return Detections(
        "radar",
        round(stamp_s * 1e9),
        np.append(r, rng.uniform(1000.0, 5000.0, false)),
        np.append(a, rng.uniform(0.0, 1.0, false)),
    )


def test_the_ratio_of_a_track_follows_the_scans():
    """Start, confirmation, misses down from B to A, end: each step from the associations."""
    ring = sequential(attribute_term="bayes", clutter_density_per_m_rad=1e-4)
    test = sequential_test(0.001, 0.05)
    expected, story = None, ""
    for k, visible in enumerate("1111100000"):
        result = ring.process(scan_at(k, [moving(k)] if visible == "1" else []))
        table = ring.manager.state.table
        if expected is not None and len(result.predictions):
            step = scan_increments(
                result.predictions, result.scores, result.associations, np.array([1e-4])
            )
            if visible == "0":
                assert step[0] == pytest.approx(math.log(1.0 - 0.9 * 0.99))
            expected = min(expected + step[0], test.log_accept)
        if len(table):
            expected = 0.0 if expected is None else expected
            assert table.log_likelihood_ratio[0] == pytest.approx(expected, abs=1e-12)
        story += "tC"[table.status[0]] if len(table) else "-"
        ended = len(result.tracks.deleted_track_id) > 0
        assert ended == story.endswith("C-")
        if ended:
            assert expected <= test.log_reject
            break
    # From B = 950 to A = .05 it takes five misses of log .109 each.
    assert story == "-tCCCCCCC-"


def test_clutter_alone_confirms_no_more_tracks_than_allowed():
    started = confirmed = 0
    for seed in range(5):
        rng = np.random.default_rng(seed)
        ring = sequential(**NOISE, false_track_probability=0.05)
        ids, good = set(), set()
        for k in range(50):
            tracks = ring.process(noisy(rng, k, [])).tracks
            ids |= set(tracks.track_id.tolist())
            good |= set(tracks.track_id[tracks.status == CONFIRMED].tolist())
        started, confirmed = started + len(ids), confirmed + len(good)
    assert started > 800
    bound = 0.05 / 0.95
    assert confirmed / started <= bound + 3.0 * math.sqrt(bound / started)
    assert confirmed > 0  # else the test of the bound would be empty


def test_targets_in_clutter_are_extracted_and_given_up_when_they_leave():
    rng = np.random.default_rng(6)
    start = np.array([[x, y] for x in (1500.0, 2200.0, 2900.0) for y in (400.0, 900.0, 1400.0)])
    velocity = rng.uniform(-8.0, 8.0, start.shape)
    ring = sequential(**NOISE)
    covered = np.zeros((40, len(start)), dtype=bool)
    for k in range(40):
        position = start + k * velocity
        seen = rng.random(len(start)) < 0.9
        live = ring.process(noisy(rng, k, position[seen])).tracks
        mean = live.mean[live.status == CONFIRMED, :2]
        gap = np.linalg.norm(position[:, None] - mean[None], axis=2)
        covered[k] = gap.min(axis=1, initial=np.inf) < 60.0
    assert covered[20:].mean() > 0.95
    for k in range(40, 65):
        live = ring.process(noisy(rng, k, [])).tracks
    left = live.mean[live.status == CONFIRMED, :2]
    gone = start + 64 * velocity
    near = np.linalg.norm(gone[:, None] - left[None], axis=2).min(axis=1, initial=np.inf) < 60.0
    assert near.sum() <= 1


def test_attributes_hasten_or_hinder():
    """A radar cross section that speaks for a target confirms sooner than one of clutter."""
    stories = {}
    for rcs in (4.0, 0.05):
        ring = sequential(
            attribute_term="bayes", clutter_density_per_m_rad=0.05, false_track_probability=1e-6
        )
        stories[rcs] = [
            float(ring.manager.state.table.log_likelihood_ratio[0])
            for k in range(5)
            if ring.process(scan_at(k, [moving(k)], rcs=rcs)) and len(ring.manager.state.table)
        ]
    assert stories[4.0][1] > stories[0.05][1] + 1.0


def test_given_tracks_exist_and_never_end_if_asked():
    ring = sequential(initiation="labelled", deletion_misses=0, clutter_density_per_m_rad=1e-4)
    ring.initialise(initial_tracks(2))
    for k in range(11, 40):
        tracks = ring.process(scan_at(k, [])).tracks
        assert len(tracks) == 2
        assert (tracks.status == CONFIRMED).all()
    assert (
        ring.manager.state.table.log_likelihood_ratio < sequential_test(0.001, 0.05).log_reject
    ).all()
    ring = sequential(initiation="labelled", deletion_misses=1, clutter_density_per_m_rad=1e-4)
    ring.initialise(initial_tracks(2))
    # Only 0 has a meaning here: one miss does not end a track.
    assert len(ring.process(scan_at(11, [])).tracks) == 2


def test_a_scan_given_up_does_not_count():
    ring = sequential(clutter_density_per_m_rad=1e-4)
    for k in range(4):
        ring.process(scan_at(k, [moving(k)]))
    before = ring.manager.state.table.log_likelihood_ratio.copy()
    ring.manager.admit(scan_at(4, [moving(4)]))
    ring.manager.open()
    ring.manager.give_up()
    assert_same(ring.manager.state.table.log_likelihood_ratio, before)


def test_a_restart_goes_on_bit_for_bit(tmp_path):
    scans = simulated(n_scans=24, clutter=8)
    options = {"clutter_density_per_m_rad": 8 / 5600.0, "false_track_probability": 0.01}
    whole, first, second = (sequential(**options) for _ in range(3))
    for scan in scans[:12]:
        whole.process(scan)
        first.process(scan)
    save(first.manager, tmp_path / "state")
    assert load(second.manager, tmp_path / "state")
    assert_same(
        second.manager.state.table.log_likelihood_ratio,
        whole.manager.state.table.log_likelihood_ratio,
    )
    for scan in scans[12:]:
        one, other = whole.process(scan).tracks, second.process(scan).tracks
        assert_same(one.mean, other.mean)
        assert_same(one.status, other.status)
        assert_same(one.track_id, other.track_id)
    assert np.ptp(whole.manager.state.table.log_likelihood_ratio) > 0.0


def test_the_error_probabilities_are_checked():
    with pytest.raises(ParameterError, match="sum < 1"):
        sequential(false_track_probability=0.6, missed_track_probability=0.6)
