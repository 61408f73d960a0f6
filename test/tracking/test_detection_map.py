"""Estimated detection probability: Beta counts, fields that are known, and the ring around them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import beta
from tracking_examples import SECOND, assert_same, initial_tracks, ring_of, simulated

from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.looks import PRIOR_LOOKS, DetectionMap, observe, probabilities
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

ESTIMATED = {"detection_probability_map": "estimated", "attribute_term": "none"}
NEVER = 1e12


def one_cell(hits, misses, memory=NEVER):
    """A map after looks at one place."""
    known, place = DetectionMap(), np.full(1, 900.0)
    for hit, miss in zip(hits, misses, strict=True):
        known = observe(
            known, "a", place, np.full(1, 0.2), np.full(1, hit), np.full(1, miss), memory
        )
    return known


def estimate(known, range_m=900.0, azimuth=0.2, sensor="a", given=0.6, gate=1.0):
    return probabilities(known, sensor, np.array([range_m]), np.array([azimuth]), given, gate)[0]


def test_a_cell_is_the_mean_of_its_beta_distribution():
    known = one_cell([1, 0, 0.7, 1], [0, 1, 0.1, 0])
    expected = beta.mean(PRIOR_LOOKS * 0.6 + 2.7, PRIOR_LOOKS * 0.4 + 1.1)
    assert estimate(known) == pytest.approx(expected)


def test_nothing_is_known_elsewhere_and_of_other_sensors():
    known = one_cell([1] * 50, [0] * 50)
    assert estimate(known) > 0.9
    for other in ({"azimuth": 2.0}, {"range_m": 1e5}, {"range_m": 100.0}, {"sensor": "b"}):
        assert estimate(known, **other) == 0.6


def test_the_gate_does_not_count_as_a_miss():
    known = one_cell([0.9 * 0.8] * 4000, [1.0 - 0.9 * 0.8] * 4000)
    assert estimate(known, gate=0.9) == pytest.approx(0.8, abs=1e-3)
    assert estimate(one_cell([1] * 4000, [0] * 4000), gate=0.9) == 0.999


def test_looks_fade():
    known = one_cell([1.0] * 100 + [0.0] * 100, [0.0] * 100 + [1.0] * 100, memory=20.0)
    assert estimate(known) < 0.2
    row = known.hits + known.misses
    assert row.sum() == pytest.approx(20.0, rel=0.01)


def test_a_longer_grid_loses_no_look():
    known = one_cell([1, 0, 1], [0, 1, 0])
    none = np.zeros(1)
    known = observe(known, "a", np.full(1, 50_000.0), np.full(1, 0.2), none, none, NEVER)
    assert known.extent_m[0] > 50_000.0
    assert (known.hits.sum(), known.misses.sum()) == pytest.approx((2.0, 1.0))


def field_scans(rng, n_scans, low, high, targets=24):
    """Targets that circle slowly, seen with ``low`` on the left and ``high`` on the right."""
    start = np.linspace(-np.pi, np.pi, targets, endpoint=False) + 0.1
    for k in range(n_scans):
        azimuth = start + 0.002 * k
        seen = rng.random(targets) < np.where(np.cos(azimuth) > 0.0, high, low)
        n = rng.poisson(5)
        yield Detections(
            "radar",
            round(k * 1e9),
            np.append(3000.0 + rng.normal(0.0, 10.0, seen.sum()), rng.uniform(500.0, 4000.0, n)),
            np.append(
                azimuth[seen] + rng.normal(0.0, 0.001, seen.sum()), rng.uniform(-np.pi, np.pi, n)
            ),
        )


@pytest.mark.parametrize("decision", ["jpda"])
def test_a_field_of_probabilities_is_found(decision):
    rng = np.random.default_rng(2)
    ring = ring_of(
        **ESTIMATED,
        decision=decision,
        detection_probability=0.8,
        deletion_misses=12,
        clutter_density_per_m_rad=3e-4,
        max_speed_mps=20.0,
    )
    for scan in field_scans(rng, 90, 0.6, 0.95):
        result = ring.process(scan)
    told, mean = result.predictions.detection_probability, result.predictions.component_mean
    right = mean[:, 0] > 600.0
    left = mean[:, 0] < -600.0
    assert told[right].mean() == pytest.approx(0.95, abs=0.03)
    # Lost targets and detections of others: a bias that this test bounds.
    assert told[left].mean() == pytest.approx(0.6, abs=0.07)


@pytest.mark.parametrize("decision", ["gda", "mht"])
def test_a_checkpoint_keeps_the_map(decision, tmp_path):
    scans = simulated(16)
    ring = ring_of(**ESTIMATED, decision=decision)
    for scan in scans[:9]:
        ring.process(scan)
    assert ring.manager.state.looks.hits.sum() > 0.0
    save(ring.manager, tmp_path / "state")
    other = ring_of(**ESTIMATED, decision=decision)
    assert load(other.manager, tmp_path / "state")
    for scan in scans[9:]:
        assert_same(ring.process(scan).tracks, other.process(scan).tracks)


def test_two_sources_of_one_probability_are_refused():
    with pytest.raises(ParameterError, match=r"detection_probability_map = 'estimated'.*strength"):
        TrackManagerParameters(signal_strength="swerling_1", detection_probability_map="estimated")


@pytest.mark.parametrize("decision", ["map", "jpda"])
def test_members_of_a_group_are_seen(decision):
    """Two targets that give one detection on every scan are detected, not missed every time."""
    place = np.array([[3000.0, 1000.0], [3010.0, 1000.0]])
    mean = np.hstack([place, np.zeros((2, 2))])
    manager = {
        **ESTIMATED,
        "decision": decision,
        "initiation": "labelled",
        "filter": "cv",
        "process_noise_std_mps2": 0.1,
        "range_std_m": 5.0,
        "azimuth_std_rad": 0.002,
        "detection_probability": 0.8,
        "clutter_density_per_m_rad": 1e-7,
        "deletion_misses": 0,
        "resolution_range_m": 200.0,
        "resolution_azimuth_rad": 0.1,
    }
    ring = Ring({"track_manager": manager})
    ring.initialise(initial_tracks(2, mean=mean))
    middle = place.mean(axis=0)
    range_m, azimuth = np.array([np.hypot(*middle)]), np.array([np.arctan2(middle[1], middle[0])])
    for k in range(40):
        ring.process(Detections("radar", (11 + k) * SECOND, range_m, azimuth))
    looks = ring.manager.state.looks
    assert looks.hits.sum() > 0.95 * (looks.hits.sum() + looks.misses.sum())
