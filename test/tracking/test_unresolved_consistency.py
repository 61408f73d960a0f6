"""Targets that the sensor does not resolve: NEES on matched simulations of many pairs."""

import numpy as np
import pytest
from scipy.stats import chi2
from tracking_examples import SECOND, initial_tracks

from gda_tracker.association.unresolved import resolution_covariance, unresolved_probability
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

HALF_DISTANCES = np.array([60.0, 0.02])
SPREAD = np.diag([25.0, 25.0, 4.0, 4.0])
NOISE = np.array([5.0, 0.002])
P_D, Q = 0.9, 0.3


def matched(pairs, scans, seed):
    """Pairs that fly through each other as the filter believes, and what the radar sees.

    Returns the tracks at first, detections, states (K, 2 pairs, 4) and the share of scans on which
    a pair was one detection.
    """
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(pairs)))
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    mean = np.zeros((pairs, 2, 4))
    mean[..., :2] = 3000.0 + 1500.0 * cells[:pairs, None]
    mean[:, :, 0] += [-60.0, 60.0]
    mean[:, :, 2] = [4.0, -4.0]
    mean = mean.reshape(-1, 4)
    state = mean + rng.multivariate_normal(np.zeros(4), SPREAD, len(mean))
    resolution = resolution_covariance(HALF_DISTANCES)
    states, told, together = [], [], []
    for k in range(scans):
        a = rng.normal(0.0, Q, (len(mean), 2))
        state = np.hstack([state[:, :2] + state[:, 2:] + 0.5 * a, state[:, 2:] + a])
        place = np.stack([np.hypot(*state[:, :2].T), np.arctan2(state[:, 1], state[:, 0])], axis=1)
        place = place.reshape(pairs, 2, 2)
        one = rng.random(pairs) < unresolved_probability(place[:, 0] - place[:, 1], resolution)
        place = np.where(one[:, None, None], place.mean(axis=1, keepdims=True), place)
        seen = rng.random((pairs, 2)) < P_D
        seen[:, 1] &= ~one
        found = place[seen] + rng.normal(0.0, NOISE, (seen.sum(), 2))
        told.append(Detections("radar", (11 + k) * SECOND, found[:, 0], found[:, 1]))
        states.append(state)
        together.append(one.mean())
    spread = np.tile(SPREAD, (len(mean), 1, 1))
    return initial_tracks(len(mean), mean=mean, covariance=spread), told, np.array(states), together


@pytest.mark.parametrize("decision", ["map", "jpda", "mht"])
def test_pairs_that_are_not_resolved_stay_consistent(decision):
    first, scans, states, together = matched(36, 13, 8)
    assert min(together) > 0.2
    assert max(together) > 0.5
    squared = {}
    for told in (True, False):
        manager = {
            "initiation": "labelled",
            "decision": decision,
            "attribute_term": "none",
            "filter": "cv",
            "process_noise_std_mps2": Q,
            "range_std_m": NOISE[0],
            "azimuth_std_rad": NOISE[1],
            "detection_probability": P_D,
            "gate_probability": 0.9999,
            "clutter_density_per_m_rad": 1e-7,
            "deletion_misses": 0,
        }
        if told:
            manager["resolution_range_m"] = HALF_DISTANCES[0]
            manager["resolution_azimuth_rad"] = HALF_DISTANCES[1]
        ring = Ring({"track_manager": manager})
        ring.initialise(first)
        squared[told] = []
        for scan, truth in zip(scans, states, strict=True):
            tracks = ring.process(scan).tracks
            gap = tracks.mean - truth
            solved = np.linalg.solve(tracks.covariance, gap[:, :, None])[:, :, 0]
            squared[told].append(np.sum(gap * solved, axis=1))
    # One value for each pair, whose members' errors hang together: means over pairs and scans.
    found, without = (np.array(squared[told]).mean(axis=0).reshape(-1, 2) for told in (True, False))
    mean = found.mean(axis=1)
    error = mean.std(ddof=1) / np.sqrt(len(mean))
    assert abs(mean.mean() - 4.0) < 2.6 * error
    # Pairs are independent: chi-square, as if two members were one.
    low, high = chi2.ppf([0.005, 0.995], 4 * len(mean)) / len(mean)
    of_scan = np.mean(squared[True], axis=1)
    assert ((of_scan > low) & (of_scan < high)).all()
    # Who does not know of the resolution is far too sure of what the tracks have taken.
    assert without.mean() > 2.0 * mean.mean()
