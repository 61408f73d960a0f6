"""Estimated clutter density in the manager, with the real stages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracking_examples import assert_same, moving, ring_of, scan_at, simulated

from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.clutter import densities, densities_of_hypotheses
from gda_tracker.vocabulary import CONFIRMED, Detections

FAR_M, PER_SCAN = 4096.0 * 0.999, 120
TRUTH = PER_SCAN / (FAR_M * 2.0 * math.pi)


def estimated(**track_manager):
    return ring_of(clutter_density="estimated", attribute_term="none", **track_manager)


def cluttered(rng, stamp_s, position):
    """One exact detection of the position among false alarms all around."""
    n = rng.poisson(PER_SCAN)
    return Detections(
        "radar",
        round(stamp_s * 1e9),
        np.append(rng.uniform(0.0, FAR_M, n), np.hypot(*position)),
        np.append(rng.uniform(-math.pi, math.pi, n), np.arctan2(position[1], position[0])),
    )


@pytest.mark.parametrize("told", [0.01, 100.0])
def test_the_density_that_association_is_told_converges(told):
    """Told 100 times too much or too little, the manager finds the truth around its tracks."""
    rng = np.random.default_rng(4)
    ring = estimated(
        clutter_density_per_m_rad=told * TRUTH,
        clutter_memory_scans=100.0,
        extraction="sequential",
        max_speed_mps=15.0,
    )
    found = []
    for k in range(300):
        turn = 0.004 * k
        result = ring.process(cluttered(rng, k, 2000.0 * np.array([np.cos(turn), np.sin(turn)])))
        found.append(result.predictions.settings.clutter_density)
        expected = densities_of_hypotheses(
            ring.manager.state.clutter,
            result.scan,
            result.predictions.component_mean,
            ring.manager.parameters,
        )
        assert len(expected) == len(result.predictions)
    assert found[0] == told * TRUTH
    # The floor under empty cells, a fifth of a scan of what was told, stays: .2 x 100 / 100.
    assert np.mean(found[-50:]) == pytest.approx(TRUTH * (1.0 + 0.002 * told), rel=0.15)


def test_the_density_is_that_of_the_scans_before_at_the_predicted_states():
    ring, maps = estimated(clutter_density_per_m_rad=1e-3), []
    for scan in simulated(n_scans=20, clutter=20):
        before = ring.manager.state.clutter
        result = ring.process(scan)
        mean = result.predictions.component_mean
        if len(mean):
            local = densities(
                before,
                "radar",
                np.hypot(mean[:, 0], mean[:, 1]),
                np.arctan2(mean[:, 1], mean[:, 0]),
                1e-3,
                50.0,
            )
            told = result.predictions.settings.clutter_density
            assert told == pytest.approx(np.exp(np.log(local).mean()))
            maps.append(np.ptp(local))
    assert max(maps) > 0.0  # tracks in cells of different density


def test_states_are_looked_up_where_the_sensor_sees_them():
    ring = estimated(clutter_density_per_m_rad=1e-3)
    position = np.array([5000.0, -2000.0, 0.0])
    for k in range(3):
        scan = scan_at(k, [[700.0, 70.0], [690.0, 90.0]], sensor_position_m=position)
        result = ring.process(scan)
    state, p = ring.manager.state, ring.manager.parameters
    mean = np.array([[5690.0, -1910.0, 0.0, 0.0], [690.0, 90.0, 0.0, 0.0]])
    near, far = densities_of_hypotheses(state.clutter, result.scan, mean, p)
    assert far == 1e-3  # beyond the grid of this sensor
    assert near > 1e-3


def test_detections_of_confirmed_tracks_are_no_clutter():
    ring = estimated()
    counts = []
    for k in range(6):
        result = ring.process(scan_at(k, [moving(k)]))
        counts.append(float(ring.manager.state.clutter.count.sum()))
        confirmed = bool((result.tracks.status == CONFIRMED).any())
        before = counts[-2] if k else 0.0
        assert counts[-1] == pytest.approx(0.98 * before + (0.0 if confirmed else 1.0))
    assert confirmed


def test_a_given_density_is_left_alone():
    ring = ring_of(clutter_density_per_m_rad=3e-4)
    for scan in simulated(n_scans=6):
        assert ring.process(scan).predictions.settings.clutter_density == 3e-4
    assert ring.manager.state.clutter.sensor_ids == ()


def test_a_scan_given_up_is_not_counted():
    ring = estimated()
    ring.process(scan_at(0, [moving(0)]))
    before = ring.manager.state.clutter
    ring.manager.admit(scan_at(1, [moving(1)]))
    ring.manager.open()
    ring.manager.give_up()
    assert_same(ring.manager.state.clutter, before)


def test_a_restart_goes_on_bit_for_bit(tmp_path):
    scans = simulated(n_scans=24, clutter=8)
    options = {"extraction": "sequential", "clutter_density_per_m_rad": 1e-3}
    whole, first, second = (estimated(**options) for _ in range(3))
    for scan in scans[:12]:
        whole.process(scan)
        first.process(scan)
    save(first.manager, tmp_path / "state")
    assert load(second.manager, tmp_path / "state")
    assert_same(second.manager.state.clutter, whole.manager.state.clutter)
    for scan in scans[12:]:
        assert_same(whole.process(scan).tracks, second.process(scan).tracks)
    assert_same(second.manager.state.clutter, whole.manager.state.clutter)
