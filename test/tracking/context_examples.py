"""Vehicles on a road with bends that move as the filter believes, and what is seen of them."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.context import Lane
from gda_tracker.kinematics.lane_motion import OF_WIDTH, LaneCourse, offset_motion
from gda_tracker.vocabulary import Detections

SECOND = 1_000_000_000
WIDTH_M, CORRELATION_S, ACCELERATION = 12.0, 10.0, 0.5
POINTS = [[500.0, 0.0], [1500.0, 0.0], [2200.0, 700.0], [3400.0, 700.0]]
MAP = f"lanes: [{{name: road, width_m: {WIDTH_M}, margin_m: 5, points_m: {POINTS}}}]\n"
NOISE = {"range_std_m": 10.0, "azimuth_std_rad": 0.01}


def keepers(n, scans, seed, start=(50.0, 600.0), std=OF_WIDTH * WIDTH_M):
    """States (scans, n, 4) of vehicles on the road, a scan each second."""
    rng = np.random.default_rng(seed)
    course = LaneCourse((Lane("road", np.array(POINTS), WIDTH_M, 5.0),), CORRELATION_S)
    state = np.column_stack(
        [
            rng.uniform(*start, n),
            rng.normal(0.0, std, n),
            rng.normal(15.0, 1.0, n),
            rng.normal(0.0, std / CORRELATION_S, n),
        ]
    )
    aside, aside_noise = offset_motion(1.0, CORRELATION_S)
    ahead_noise = ACCELERATION**2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    found = []
    for _ in range(scans):
        piece = np.clip(np.searchsorted(course.way, state[:, 0], side="right") - 1, 0, None)
        t = course.along[piece]
        left = np.stack([-t[:, 1], t[:, 0]], axis=1)
        place = course.start[piece] + (state[:, 0] - course.way[piece])[:, None] * t
        place += state[:, 1:2] * left
        found.append(np.hstack([place, state[:, 2:3] * t + state[:, 3:] * left]))
        state[:, 1::2] = state[:, 1::2] @ aside.T + rng.multivariate_normal(
            [0.0, 0.0], std**2 * aside_noise, n
        )
        state[:, 0] += state[:, 2]
        state[:, 0::2] += rng.multivariate_normal([0.0, 0.0], ahead_noise, n)
    return np.array(found)


def parallel(shifts):
    """The map of copies of the road, each shifted to the North."""
    lanes = [
        f"  - {{name: road {k}, width_m: {WIDTH_M}, margin_m: 5, points_m: "
        f"{[[x, float(y + shift)] for x, y in POINTS]}}}"
        for k, shift in enumerate(shifts)
    ]
    return "\n".join(["lanes:", *lanes, ""])


def seen(states, seed, first_s=0, missed=0.1, azimuth_std_rad=NOISE["azimuth_std_rad"]):
    """Scans of the states (K, n, 4), a second apart; some are missed."""
    rng = np.random.default_rng(seed)
    scans = []
    for k, state in enumerate(states):
        there = rng.random(len(state)) >= missed
        distance = np.hypot(*state[:, :2].T) + rng.normal(0.0, NOISE["range_std_m"], len(state))
        azimuth = np.arctan2(state[:, 1], state[:, 0])
        azimuth += rng.normal(0.0, azimuth_std_rad, len(state))
        scans.append(Detections("radar", (first_s + k) * SECOND, distance[there], azimuth[there]))
    return scans


def settings(path, **changes):
    """Parameters of the track manager for them."""
    return {
        "decision": "map",
        "attribute_term": "none",
        "filter": "cv",
        "process_noise_std_mps2": ACCELERATION,
        "gate_probability": 0.99999,
        "clutter_density_per_m_rad": 1e-9,
        "detection_probability": 0.9,
        **NOISE,
        "context_file": str(path),
        **changes,
    }


def squared_errors(tracks, truth):
    """Normalised squared errors of tracks whose rows are those of the truth."""
    gap = tracks.mean - truth
    solved = np.linalg.solve(tracks.covariance, gap[:, :, None])[:, :, 0]
    return np.sum(gap * solved, axis=1)
