"""A turning radar that looks at recorded trajectories: what it detects, and how well.

The received power of a target is z = |sqrt(s) exp(j phi) + n|^2 with a random phase, complex noise
n of power 1 and the signal-to-noise ratio s = s1 sigma (R1 / R)^4, where sigma is drawn anew at
each look from the target's Swerling model. It is detected where z exceeds -ln P_FA. So a target
that fluctuates by Swerling 1 is detected with P_FA^(1 / (1 + mean s)), and what is measured of its
RCS, (z - 1) sigma / s, is noisy and, near the threshold, too large: as real radars have it.

Noise of range and azimuth falls with the square root of 2 z, down to a floor (Koch 2014, 2.1.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.rcs import sample
from gda_tracker.simulation.trajectories import Trajectory
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth

CLUTTER = -1
# Share of the resolution below which no noise falls, however strong the echo.
NOISE_FLOOR = 0.1
TRACKING_FRAME = "map"


@dataclass(frozen=True, slots=True)
class SurveillanceRadar:
    """The radar, at the origin of the frame of the trajectories.

    ``snr_at_reference`` is the mean signal-to-noise ratio of 1 m2 at ``reference_range_m``.
    False alarms are Poisson, uniform in range and azimuth, with an exponential RCS. With
    ``elevation`` it measures the elevation too, as well as the azimuth.
    """

    sensor_id: str
    scan_period_s: float
    max_range_m: float
    reference_range_m: float
    snr_at_reference: float
    false_alarm_probability: float
    range_resolution_m: float
    azimuth_resolution_deg: float
    mean_false_alarms_per_scan: float
    clutter_rcs_mean_m2: float
    elevation: bool = False

    @property
    def threshold(self) -> float:
        """Power over which noise alone comes with the probability of a false alarm."""
        return -math.log(self.false_alarm_probability)

    def gain(self, range_m: FloatArray) -> FloatArray:
        """Signal-to-noise ratio of 1 m2 at a range [1/m2]."""
        distance = np.maximum(range_m, 1.0)
        return self.snr_at_reference * (self.reference_range_m / distance) ** 4

    def detection_probability(self, range_m: FloatArray, rcs_mean_m2: FloatArray) -> FloatArray:
        """Chance that a target of Swerling 1 is detected at a range."""
        mean_snr = self.gain(range_m) * rcs_mean_m2
        return self.false_alarm_probability ** (1.0 / (1.0 + mean_snr))

    def noise(self, power: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard deviations of range [m] and azimuth [rad] of echoes of this power."""
        share = np.maximum(1.0 / np.sqrt(2.0 * power), NOISE_FLOOR)
        return self.range_resolution_m * share, math.radians(self.azimuth_resolution_deg) * share


def observe(
    radar: SurveillanceRadar,
    trajectories: Sequence[Trajectory],
    begin_s: float,
    end_s: float,
    seed: int,
    run: int = 0,
) -> tuple[list[Detections], list[ScanTruth]]:
    """Return what the radar detects, one scan a period, and what was there within its range.

    Parameters
    ----------
    radar, trajectories
        Who looks, and at whom. A target that is not known at a time is not there.
    begin_s, end_s
        Time of the first scan, and before which the last one is (Unix time).
    seed, run
        The random numbers.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, run]))
    number = max(math.ceil((end_s - begin_s) / radar.scan_period_s), 0)
    times = begin_s + radar.scan_period_s * np.arange(number, dtype=np.float64)
    states = np.stack([one.states(times) for one in trajectories], axis=1)
    ids = np.array([one.target_id for one in trajectories], dtype=np.int32)
    classes = np.array([one.class_name for one in trajectories])
    means = np.array([one.rcs_mean_m2 for one in trajectories])
    models = np.array([one.swerling for one in trajectories])
    detections, truth = [], []
    for number, time in enumerate(times):
        distance = np.linalg.norm(states[number, :, :3], axis=1)
        there = np.flatnonzero(distance <= radar.max_range_m)  # NaN is not
        stamp_ns = round(time * 1e9)
        scan, source = _scan(
            radar, states[number, there, :3], means[there], models[there], ids[there], rng
        )
        scan.stamp_ns, scan.sequence = stamp_ns, number
        detections.append(scan)
        truth.append(
            ScanTruth(
                sensor_id=radar.sensor_id,
                stamp_ns=stamp_ns,
                target_id=ids[there],
                target_state=states[number, there][:, [0, 1, 3, 4]],
                source_id=source,
                target_class=tuple(classes[there].tolist()),
                run=run,
                frame_id=TRACKING_FRAME,
            )
        )
    return detections, truth


def _scan(
    radar: SurveillanceRadar,
    position_m: FloatArray,
    rcs_mean_m2: FloatArray,
    swerling: IntArray,
    ids: Int32Array,
    rng: np.random.Generator,
) -> tuple[Detections, Int32Array]:
    """One look: detections in random order, and whose each is."""
    n = len(ids)
    true_range = np.linalg.norm(position_m, axis=1)
    gain = radar.gain(true_range)
    snr = gain * sample(rng, rcs_mean_m2, swerling, n)
    # The phase of the target plays no part: that of the noise is as random.
    noise = rng.standard_normal((n, 2)) * math.sqrt(0.5)
    power = (np.sqrt(snr) + noise[:, 0]) ** 2 + noise[:, 1] ** 2
    seen = np.flatnonzero(power > radar.threshold)
    clutter = rng.poisson(radar.mean_false_alarms_per_scan)
    clutter_range = rng.uniform(0.0, radar.max_range_m, clutter)
    clutter_rcs = sample(rng, np.array(radar.clutter_rcs_mean_m2), np.array(1), clutter)
    clutter_power = 1.0 + radar.gain(clutter_range) * clutter_rcs
    flat = math.radians(radar.azimuth_resolution_deg) if radar.elevation else 0.0
    direction = np.arctan2(position_m[seen, 1], position_m[seen, 0])
    height = np.arcsin(position_m[seen, 2] / np.maximum(true_range[seen], 1e-9))
    ranges = np.concatenate([true_range[seen], clutter_range])
    azimuths = np.concatenate([direction, rng.uniform(-math.pi, math.pi, clutter)])
    elevations = np.concatenate([height, flat * rng.uniform(-1.0, 1.0, clutter)])
    rcs = np.concatenate([(power[seen] - 1.0) / gain[seen], clutter_rcs])
    powers = np.maximum(np.concatenate([power[seen], clutter_power]), radar.threshold)
    range_std, angle_std = radar.noise(powers)
    is_target = np.arange(len(ranges)) < len(seen)
    errors = rng.standard_normal((3, len(ranges))) * is_target
    ranges = np.abs(ranges + range_std * errors[0])
    azimuths = math.pi - np.mod(math.pi - azimuths - angle_std * errors[1], 2.0 * math.pi)
    elevations = elevations + angle_std * errors[2]
    source = np.concatenate([ids[seen], np.full(clutter, CLUTTER, dtype=np.int32)])
    order = rng.permutation(len(ranges))
    scan = Detections(
        sensor_id=radar.sensor_id,
        stamp_ns=0,
        range_m=ranges[order],
        azimuth_rad=azimuths[order],
        elevation_rad=elevations[order] if radar.elevation else None,
        rcs_m2=rcs[order],
        rcs_valid=np.ones(len(order), dtype=bool),
        range_std_m=range_std[order],
        azimuth_std_rad=angle_std[order],
        elevation_std_rad=angle_std[order] if radar.elevation else None,
        frame_id=radar.sensor_id,
    )
    return scan, source[order].astype(np.int32)
