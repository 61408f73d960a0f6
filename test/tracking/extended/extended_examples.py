"""Ellipses that move, seen by a radar: several detections each."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.extended.ellipses import extent_of
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

AXES = np.array([[10.0, 3.0], [5.0, 2.0]])
START = np.array([[100.0, -50.0], [130.0, 50.0]])
VELOCITY = np.array([[0.0, 5.0], [0.5, -4.0]])
RATES = np.array([12.0, 6.0])
TOLD = {
    "extended_objects": "random_matrix",
    "attribute_term": "none",
    "filter": "cv",
    "extraction": "sequential",
    "process_noise_std_mps2": 0.05,
    "max_speed_mps": 15.0,
    "clutter_density_per_m_rad": 2e-2,
    "detection_probability": 0.95,
    "gate_probability": 0.9999,
    "range_std_m": 0.5,
    "azimuth_std_rad": 0.005,
    "cell_least_distance_m": 2.0,
    "cell_largest_distance_m": 12.0,
    "extent_radius_m": 6.0,
    "extent_memory_s": 1e6,
    "detection_rate_memory_s": 1e6,
}

QUIET = {"decision": "map", "filter": "cv", "range_std_m": 0.5, "azimuth_std_rad": 0.005}


def ring_of(**changes) -> Ring:
    """A ring that is told of extended objects."""
    return Ring({"track_manager": {**TOLD, **changes}})


def truth_at(stamp_s):
    """Centres (2, 2) and matrices (2, 2, 2)."""
    course = np.arctan2(VELOCITY[:, 1], VELOCITY[:, 0])
    return START + stamp_s * VELOCITY, extent_of(AXES, course)


def scans(count=20, seed=0, clutter=3.0) -> list[Detections]:
    """One scan a second; reflections are normal, a quarter of the extent, as in the filter."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(count):
        centre, extent = truth_at(float(k))
        points = [rng.uniform([60.0, -80.0], [200.0, 80.0], (rng.poisson(clutter), 2))]
        for place, matrix, rate in zip(centre, extent, RATES, strict=True):
            n = rng.poisson(rate) * (rng.random() < 0.95)
            points.append(rng.multivariate_normal(place, 0.25 * matrix, n))
        xy = np.concatenate(points)[rng.permutation(sum(map(len, points)))]
        noise = rng.standard_normal((2, len(xy)))
        made.append(
            Detections(
                "radar",
                (k + 1) * 1_000_000_000,
                np.hypot(*xy.T) + 0.5 * noise[0],
                np.arctan2(xy[:, 1], xy[:, 0]) + 0.005 * noise[1],
                rcs_m2=np.arange(len(xy), dtype=float),
            )
        )
    return made
