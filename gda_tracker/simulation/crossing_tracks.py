"""Three crossing tracks, after figure 1 of Stirling & Thompson 1991.

The figure gives no numbers. Here as there the targets go from left to right, tracks 1 and 3 are
close together at the beginning and part, and tracks 1 and 2 all but meet at sample ten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth

SENSOR_ID = "radar"
FRAME_ID = "map"
CLUTTER = -1
# x, y [m], vx, vy [m/s] at the first sample; the radar stands at the origin.
FIRST_STATES = (
    (-2400.0, 10600.0, 100.0, -25.0),
    (-2400.0, 9500.0, 100.0, 30.0),
    (-2400.0, 10850.0, 100.0, 15.0),
)
MARGIN_M = 800.0


@dataclass(frozen=True)
class CrossingTracks:
    """What is simulated: times, noise, misses, false alarms (``clutter``, mean per scan)."""

    samples: int = 25
    period_s: float = 2.0
    range_std_m: float = 30.0
    azimuth_std_rad: float = 0.003
    detection_probability: float = 1.0
    clutter: float = 0.0
    speed_noise_mps: float = 1.0

    def region_m(self) -> tuple[float, float, float, float]:
        """West, east, south and north border of the false alarms: about all tracks."""
        first = np.array(FIRST_STATES)
        last = first[:, :2] + first[:, 2:] * self.period_s * (self.samples - 1)
        both = np.concatenate([first[:, :2], last])
        west, south = (both.min(axis=0) - MARGIN_M).tolist()
        east, north = (both.max(axis=0) + MARGIN_M).tolist()
        return west, east, south, north

    def clutter_density_per_m_rad(self) -> float:
        """False alarms per scan, metre of range and radian, in the middle of the region."""
        west, east, south, north = self.region_m()
        distance = np.hypot((west + east) / 2.0, (south + north) / 2.0)
        return float(self.clutter * distance / ((east - west) * (north - south)))


def simulate_crossing_tracks(
    model: CrossingTracks, seed: int
) -> tuple[list[Detections], list[ScanTruth]]:
    """Simulate the scans of a radar; the same seed gives the same scans.

    The true velocities take a random step of ``speed_noise_mps`` per sample and component. The
    first sample has every target.
    """
    rng = np.random.default_rng(seed)
    states = _states(model, rng)
    detections, truth = [], []
    for k in range(model.samples):
        seen = rng.random(len(FIRST_STATES)) < (model.detection_probability if k else 1.0)
        position = states[k, seen, :2]
        false = _false_alarms(model, rng)
        count = len(position)
        noise = rng.standard_normal((count, 2)) * (model.range_std_m, model.azimuth_std_rad)
        polar = _polar(np.concatenate([position, false]))
        polar[:count] += noise
        source = np.append(np.flatnonzero(seen) + 1, np.full(len(false), CLUTTER))
        order = rng.permutation(len(source))
        stamp_ns = round(k * model.period_s * 1e9)
        detections.append(
            Detections(
                sensor_id=SENSOR_ID,
                stamp_ns=stamp_ns,
                range_m=polar[order, 0],
                azimuth_rad=polar[order, 1],
                frame_id=FRAME_ID,
                sequence=k + 1,
            )
        )
        truth.append(
            ScanTruth(
                sensor_id=SENSOR_ID,
                stamp_ns=stamp_ns,
                target_id=np.arange(1, len(FIRST_STATES) + 1, dtype=np.int32),
                target_state=states[k],
                source_id=source[order].astype(np.int32),
                frame_id=FRAME_ID,
            )
        )
    return detections, truth


def _states(model: CrossingTracks, rng: np.random.Generator) -> FloatArray:
    """States (samples, targets, 4)."""
    states = np.empty((model.samples, len(FIRST_STATES), 4))
    states[0] = FIRST_STATES
    for k in range(1, model.samples):
        before = states[k - 1]
        step = model.speed_noise_mps * rng.standard_normal((len(before), 2))
        states[k, :, 2:] = before[:, 2:] + step
        states[k, :, :2] = before[:, :2] + model.period_s * (before[:, 2:] + step / 2.0)
    return states


def _false_alarms(model: CrossingTracks, rng: np.random.Generator) -> FloatArray:
    west, east, south, north = model.region_m()
    count = rng.poisson(model.clutter)
    return np.stack([rng.uniform(west, east, count), rng.uniform(south, north, count)], axis=1)


def _polar(position: FloatArray) -> FloatArray:
    x, y = position[:, 0], position[:, 1]
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)


def set_valued_preset(model: CrossingTracks) -> dict[str, float]:
    """Parameters of the set-valued tracker that suit the radar and the targets of ``model``."""
    return {
        "range_std_m": model.range_std_m,
        "azimuth_std_rad": model.azimuth_std_rad,
        "detection_probability": min(model.detection_probability, 0.98),
        "clutter_density_per_m_rad": max(model.clutter_density_per_m_rad(), 1e-6),
        "process_noise_std_mps2": 1.0,
        "initial_position_radius_m": 1500.0,
        "initial_position_std_m": 70.0,
        "initial_speed_radius_mps": 150.0,
        "initial_speed_std_mps": 50.0,
    }


def ring_preset(model: CrossingTracks) -> dict[str, dict[str, float]]:
    """Parameters of the ring that tell it the same as :func:`set_valued_preset`."""
    own = set_valued_preset(model)
    names = (
        "range_std_m",
        "azimuth_std_rad",
        "detection_probability",
        "clutter_density_per_m_rad",
        "process_noise_std_mps2",
    )
    return {
        "track_manager": {
            **{name: own[name] for name in names},
            "max_speed_mps": own["initial_speed_radius_mps"],
        }
    }
