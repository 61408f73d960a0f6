"""Scans, predictions and random states for the tests of kinematics."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.kinematics.sensor_models import PolarMeasurements
from gda_tracker.vocabulary import AssociationSettings, Predictions, Scan, ScanKey

KEY = ScanKey(7, "radar", 1_000_000_000)
LEVEL = (0.0, 0.0, 0.0, 1.0)


def quaternion(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    """Unit quaternion (x, y, z, w) of a turn by ``angle`` about ``axis``."""
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.append(math.sin(angle / 2) * unit, math.cos(angle / 2))


def scan_of(
    range_m,
    azimuth_rad,
    covariance,
    position=(0.0, 0.0, 0.0),
    orientation=LEVEL,
    elevation_rad=None,
    time_offset_s=None,
) -> Scan:
    """Admitted scan; ``covariance`` is (d, d) for all or (n, d, d)."""
    range_m = np.atleast_1d(np.asarray(range_m, dtype=float))
    n = len(range_m)
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim == 2:
        covariance = np.tile(covariance, (n, 1, 1))

    def column(values):
        return None if values is None else np.broadcast_to(np.asarray(values, float), (n,)).copy()

    return Scan(
        key=KEY,
        frame_id="map",
        sensor_position_m=np.array(position, dtype=float),
        sensor_orientation_xyzw=np.array(orientation, dtype=float),
        source_index=np.arange(n, dtype=np.int32),
        range_m=range_m,
        azimuth_rad=column(azimuth_rad),
        noise_covariance=covariance,
        rcs_m2=np.zeros(n),
        rcs_valid=np.zeros(n, dtype=bool),
        elevation_rad=column(elevation_rad),
        time_offset_s=column(time_offset_s),
    )


def predictions_of(
    mean, covariance, gate_probability=0.99, component_start=None, weight=None
) -> Predictions:
    """Predictions of single Gaussians, or of mixtures when ``component_start`` is given."""
    mean = np.asarray(mean, dtype=float)
    k = len(mean)
    if component_start is None:
        component_start = np.arange(k + 1)
    h = len(component_start) - 1
    return Predictions(
        key=KEY,
        settings=AssociationSettings(gate_probability=gate_probability),
        hypothesis_id=np.arange(1, h + 1),
        parent_id=np.zeros(h, dtype=np.int64),
        track_id=np.arange(1, h + 1),
        detection_probability=np.full(h, 0.9),
        component_start=np.asarray(component_start, dtype=np.int32),
        component_weight=np.ones(k) if weight is None else np.asarray(weight, dtype=float),
        component_model=np.zeros(k, dtype=np.int32),
        component_mean=mean,
        component_covariance=np.asarray(covariance, dtype=float),
    )


def random_states(
    rng: np.random.Generator, count: int, size: int = 4, spread_m: float = 300.0
) -> tuple[np.ndarray, np.ndarray]:
    """States 5 to 50 km from the origin with full random covariances."""
    angle, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(5e3, 5e4, count)
    mean = rng.normal(0.0, 150.0, (count, size))
    mean[:, 0], mean[:, 1] = distance * np.cos(angle), distance * np.sin(angle)
    scale = np.array([spread_m] * (size // 2) + [spread_m / 10.0] * (size // 2))
    root = rng.normal(size=(count, size, size)) * scale[:, None]
    return mean, root @ root.transpose(0, 2, 1) + np.diag((0.1 * scale) ** 2)


def random_measurements(
    rng: np.random.Generator, count: int, offsets: bool = False
) -> PolarMeasurements:
    """Measurements with correlated range and azimuth noise."""
    root = rng.normal(size=(count, 2, 2)) * np.array([[40.0], [0.005]])
    return PolarMeasurements(
        rng.uniform(4e3, 6e4, count),
        rng.uniform(-np.pi, np.pi, count),
        root @ root.transpose(0, 2, 1) + np.diag([10.0**2, 0.001**2]),
        rng.normal(0.0, 1e3, 2),
        rng.uniform(-1.0, 1.0, count) if offsets else None,
    )
