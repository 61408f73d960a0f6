"""Every live parameter of ``track_formations`` changes what is said of a formation."""

from functools import lru_cache

import numpy as np
import pytest
from formation_examples import live, predictions_of, scan_of, states_of

from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import specifications

CASES = {
    "largest_number": 3,
    "overcount_probability": 1e-100,
    "undercount_probability": 0.3,
    "number_change_s": 0.0,
    "together_distance_m": 200.0,
    "apart_distance_m": 5000.0,
    "together_speed_mps": 1.0,
    "apart_speed_mps": 18.0,
    "false_split_probability": 0.4,
    "false_merge_probability": 0.4,
    "spread_std_m": 1000.0,
    "uniform_share": 1.0,
    "resolution_range_m": 300.0,
    "resolution_azimuth_rad": 0.05,
    "independence_factor": 15.0,
}
# Neither goes without the other.
RESOLUTION = {"resolution_range_m": 100.0, "resolution_azimuth_rad": 0.01}

DISTANCES = {"together_distance_m": 500.0, "apart_distance_m": 1000.0}
SPEEDS = ("together_speed_mps", "apart_speed_mps")

# Pairs need some samples, of which there is one each third scan.
COVARIANCE = np.diag([150.0**2, 150.0**2, 100.0, 100.0])
STEP_S = 20.0


@lru_cache
def said(slip=8.0, **parameters):
    """Of three tracks one parts from the others; there are false detections and misses."""
    table = {**DISTANCES, **parameters}
    tracker = FormationTracker(FormationParameters(**table))
    found = []
    for k in range(26):
        time_s = STEP_S * k
        now = states_of([[-300.0, 2e4], [300.0, 2e4], [900.0 if k < 16 else 1300.0, 2e4]])
        now[2, 2] = slip
        seen = np.array([True, k % 5 > 0, k % 4 > 0])
        index = np.where(seen, np.cumsum(seen) - 1, -1)
        places = now[seen, :2]
        if k % 7 == 0:
            places = np.vstack([places, [250.0 + 20.0 * k, 20_100.0]])
        told = tracker.take(
            live(time_s, [1, 2, 3], now, detection=index, covariance=COVARIANCE),
            scan_of(time_s, places),
            predictions_of(time_s, [1, 2, 3], now),
        )
        found += [
            (one.track_ids.tolist(), one.number, one.number_probabilities.tolist())
            for one in told.formations
        ]
        found += [(e.kind, e.formation_id) for e in told.events]
    return found


def test_every_live_parameter_has_a_case():
    live_ones = {name for name, item in specifications(FormationParameters).items() if item.live}
    assert live_ones == set(CASES)


@pytest.mark.parametrize("name", CASES)
def test_a_change_shows_in_the_formations(name):
    others = dict(RESOLUTION) if name in RESOLUTION else {}
    if name == "overcount_probability":
        others["undercount_probability"] = 0.45  # else it is that which takes longest
    if name in SPEEDS:
        others["slip"] = 15.0
    assert said(**{**others, name: CASES[name]}) != said(**others)
