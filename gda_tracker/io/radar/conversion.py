"""Fields of a radar, as a table declares them, made detections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.io.radar.clustering import cluster
from gda_tracker.io.radar.ego_motion import estimate_sensor_velocity, static_range_rate
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.sensor_pose import SensorPose, declared_pose, require_elevation
from gda_tracker.parameters import ParameterError
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.scans import Detections

# An estimate of the radar's own speed counts if it makes this share of the points stand still.
LEAST_STATIC_SHARE = 0.5
DEVIATIONS = ("range_std", "azimuth_std", "elevation_std", "range_rate_std")


@dataclass(slots=True)
class RadarScan:
    """Detections of one scan, and what was left out or unknown, by reason.

    ``still`` (N,) says of each point of the input whether it stands still; ``None`` without range
    rate.
    """

    detections: Detections
    counts: Counter[str] = field(default_factory=Counter)
    still: BoolArray | None = None


def detections_of_fields(
    fields: Mapping[str, FloatArray],
    parameters: RadarInputParameters,
    stamp_ns: int,
    frame_id: str = "",
    sequence: int = 0,
    pose: SensorPose | None = None,
) -> RadarScan:
    """Make detections of the fields of N points.

    Parameters
    ----------
    fields
        (N,) by quantity, as :meth:`RadarInputParameters.fields_of` names them, in the radar's own
        units; those of ``parameters.attributes`` by their field.
    parameters
        What they mean.
    stamp_ns, frame_id, sequence
        Of the message.
    pose
        Where the radar is and how it moves; ``None``: as the parameters declare.

    Raises
    ------
    ParameterError
        If there is no position among the fields.
    TiltError
        If the radar measures no elevation and is tilted too far.
    """
    p = parameters
    pose = pose or declared_pose(p)
    counts: Counter[str] = Counter()
    range_m, azimuth, elevation = _position(fields, p)
    n = len(range_m)
    range_rate = over_ground = still = None
    if "range_rate" in fields and p.range_rate_used:
        range_rate = p.range_rate_sign * fields["range_rate"]
        standing = _static_range_rate(range_rate, azimuth, elevation, p, pose, counts)
        over_ground = range_rate - standing
        still = np.abs(over_ground) <= p.moving_above_mps
        range_rate = over_ground if p.range_rate_reference == "ground" else range_rate
    keep = _kept(fields, p, range_m, azimuth, over_ground, counts)
    rcs, known = _radar_cross_section(fields, p, n, counts)
    angle = np.deg2rad(1.0) if p.angle_unit == "deg" else 1.0
    scale = {"range_std": 1.0, "azimuth_std": angle, "elevation_std": angle, "range_rate_std": 1.0}
    deviation = {
        name: scale[name] * np.abs(fields[name][keep]) if name in fields else None
        for name in DEVIATIONS
    }
    if not p.elevation_used:
        elevation = deviation["elevation_std"] = None
    require_elevation(pose, elevation, p.maximum_tilt_deg)
    attributes = p.attributes
    values = np.array([fields[name][keep] for name in attributes.values()]) if attributes else None
    detections = Detections(
        sensor_id=p.sensor_id,
        stamp_ns=stamp_ns,
        range_m=range_m[keep],
        azimuth_rad=azimuth[keep],
        elevation_rad=None if elevation is None else elevation[keep],
        range_rate_mps=None if range_rate is None else range_rate[keep],
        rcs_m2=None if rcs is None else rcs[keep],
        rcs_valid=None if known is None else known[keep],
        range_std_m=deviation["range_std"],
        azimuth_std_rad=deviation["azimuth_std"],
        elevation_std_rad=deviation["elevation_std"],
        range_rate_std_mps=None if range_rate is None else deviation["range_rate_std"],
        time_offset_s=fields["time_offset"][keep] if "time_offset" in fields else None,
        sensor_position_m=pose.transform.translation,
        sensor_orientation_xyzw=pose.transform.rotation,
        frame_id=frame_id,
        sequence=sequence,
        attribute_names=tuple(attributes),
        attribute_values=values,
        attribute_valid=None if values is None else np.isfinite(values),
    )
    if p.cluster_distance_m:
        detections = cluster(
            detections,
            p.cluster_distance_m,
            p.cluster_range_rate_mps,
            p.cluster_minimum_points,
            p.cluster_extent_m,
            p.cluster_range_rate_std_mps,
            counts,
        )
    return RadarScan(detections, counts, still)


def turned(azimuth: FloatArray) -> FloatArray:
    """Return angles [rad] in (-pi, pi]."""
    return np.pi - (np.pi - azimuth) % (2.0 * np.pi)


def _position(
    fields: Mapping[str, FloatArray], p: RadarInputParameters
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Range [m], azimuth [rad] counter-clockwise from x, elevation [rad] or none."""
    polar = "range" in fields and "azimuth" in fields
    cartesian = "x" in fields and "y" in fields
    if p.position_source == "polar" or (p.position_source == "auto" and polar):
        if not polar:
            raise _no_position("range and azimuth", fields)
        unit = np.deg2rad(1.0) if p.angle_unit == "deg" else 1.0
        azimuth = np.deg2rad(p.azimuth_zero_deg) + p.azimuth_sign * unit * fields["azimuth"]
        elevation = unit * fields["elevation"] if "elevation" in fields else None
        return fields["range"], turned(azimuth), elevation
    if not cartesian:
        raise _no_position("x and y, or range and azimuth", fields)
    x, y = fields["x"], fields["y"]
    ground = np.hypot(x, y)
    azimuth = turned(np.arctan2(y, x) - np.deg2rad(p.cartesian_yaw_deg))
    if "z" not in fields:
        return ground, azimuth, None
    # A radar in the plane publishes z = 0: its elevation is not measured.
    z = fields["z"]
    flat = not np.any(z)
    return np.hypot(ground, z), azimuth, None if flat else np.arctan2(z, ground)


def _no_position(needed: str, fields: Mapping[str, FloatArray]) -> ParameterError:
    found = ", ".join(fields) or "none"
    return ParameterError(
        f"no position: {needed} needed, found are {found}; parameter field_names says which fields "
        "they are"
    )


def _static_range_rate(
    range_rate: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray | None,
    p: RadarInputParameters,
    pose: SensorPose,
    counts: Counter[str],
) -> FloatArray:
    """Range rate (n,) of points at rest, by the radar's own speed."""
    if pose.velocity_mps is not None:
        return static_range_rate(azimuth, elevation, *pose.velocity_mps.tolist())
    ahead, left = p.sensor_speed_mps, p.sensor_speed_left_mps
    if p.sensor_motion == "estimated":
        found = estimate_sensor_velocity(azimuth, elevation, range_rate)
        if found is not None and found.share >= LEAST_STATIC_SHARE:
            ahead, left = found.ahead_mps, found.left_mps
        else:
            counts["sensor_motion_unknown"] += 1
    return static_range_rate(azimuth, elevation, ahead, left)


def _kept(
    fields: Mapping[str, FloatArray],
    p: RadarInputParameters,
    range_m: FloatArray,
    azimuth: FloatArray,
    range_rate: FloatArray | None,
    counts: Counter[str],
) -> BoolArray:
    """Which points are passed on; the others are counted by reason."""
    keep = np.ones(len(range_m), dtype=bool)

    def leave_out(bad: BoolArray, reason: str) -> None:
        bad = bad & keep
        if bad.any():
            counts[reason] += int(np.count_nonzero(bad))
            keep[bad] = False

    if p.padding_zeros and {"x", "y", "z"} <= set(fields):
        leave_out((fields["x"] == 0.0) & (fields["y"] == 0.0) & (fields["z"] == 0.0), "padding")
    leave_out(~(np.isfinite(range_m) & np.isfinite(azimuth)), "not_finite")
    if range_rate is not None:
        leave_out(~np.isfinite(range_rate), "not_finite")
    leave_out(range_m < p.minimum_range_m, "too_close")
    leave_out(range_m > p.maximum_range_m, "too_far")
    if "snr" in fields:
        leave_out(~(fields["snr"] >= p.minimum_snr_db), "too_weak")
    if p.moving_above_mps and range_rate is not None:
        leave_out(np.abs(range_rate) <= p.moving_above_mps, "standing_still")
    return keep


def _radar_cross_section(
    fields: Mapping[str, FloatArray], p: RadarInputParameters, n: int, counts: Counter[str]
) -> tuple[FloatArray | None, BoolArray | None]:
    """RCS [m2] and whether it is known; a field that cannot be one is unknown as a whole."""
    if "rcs" not in fields or p.rcs_unit == "none":
        return None, None
    value = p.rcs_scale * fields["rcs"] + p.rcs_offset
    known = np.isfinite(value) & (value >= p.rcs_minimum) & (value <= p.rcs_maximum)
    if p.rcs_unit == "m2":
        known &= value > 0.0
    out_of_range = int(np.count_nonzero(~known))
    if out_of_range:
        counts["rcs_unknown"] += out_of_range
    # Some drivers fill the field with one number. Two equal ones may be chance, ten are not.
    if n >= 10 and np.ptp(fields["rcs"]) == 0.0:
        counts["rcs_all_equal"] += n
        known[:] = False
    with np.errstate(over="ignore"):
        rcs = 10.0 ** (value / 10.0) if p.rcs_unit == "dbsm" else value
    return np.where(known, rcs, 0.0), known
