"""Recorded trajectories of ships (AIS) and of a drone (GPS), seen by a simulated radar.

``ais``: a table with the columns ``Time, MMSI, Latitude_degrees, Longitude_degrees, COG_degrees,
SOG_knots``. ``uav``: one with ``time, latitude, longitude, altitude (m)``, a row a second. The
trajectories are real; the radar, its noise, misses, false alarms and the types of the ships, which
the table does not tell, are simulated (docs/simulated-radar.md).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.simulation.geodesy import Geodetic, east_north_up
from gda_tracker.simulation.surveillance_radar import SurveillanceRadar, observe
from gda_tracker.simulation.trajectories import Trajectory, spread_out, without_jumps
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording

AIS_COLUMNS = ("Time", "MMSI", "Latitude_degrees", "Longitude_degrees", "COG_degrees", "SOG_knots")
UAV_COLUMNS = ("time", "latitude", "longitude", "altitude (m)")
KNOT = 1852.0 / 3600.0
# Kinds of ships: name, mean RCS [m2], Swerling model. Each ship gets one by its number in turn.
SHIP_TYPES = (("small_craft", 5.0, 1), ("vessel", 50.0, 1), ("ship", 500.0, 3))
UAV_TYPE = ("uav", 0.02, 1)
# Southsea castle, from which the eastern Solent and the entrance to Portsmouth are seen.
COAST: Geodetic = (50.7780, -1.0885, 0.0)
COASTAL_RADAR = SurveillanceRadar(
    sensor_id="coastal_radar",
    scan_period_s=3.0,
    max_range_m=12_000.0,
    reference_range_m=10_000.0,
    snr_at_reference=0.1,
    false_alarm_probability=1e-5,
    range_resolution_m=30.0,
    azimuth_resolution_deg=1.0,
    mean_false_alarms_per_scan=20.0,
    clutter_rcs_mean_m2=0.5,
)
# South-West of the first position of the drone, at its height.
UAV_RADAR_OFFSET_DEG = (-0.007, -0.010)
UAV_RADAR = SurveillanceRadar(
    sensor_id="drone_radar",
    scan_period_s=1.0,
    max_range_m=3_000.0,
    reference_range_m=1_000.0,
    snr_at_reference=10_000.0,
    false_alarm_probability=1e-5,
    range_resolution_m=10.0,
    azimuth_resolution_deg=1.5,
    mean_false_alarms_per_scan=8.0,
    clutter_rcs_mean_m2=0.01,
    elevation=True,
)
# AIS is sent every 2 to 10 s under way, every three minutes at anchor; receivers stamp it by up to
# some seconds wrong.
AIS_LEAST_GAP_S, AIS_LONGEST_GAP_S, AIS_MAX_SPEED_MPS = 15.0, 200.0, 40.0
UAV_LEAST_GAP_S, UAV_LONGEST_GAP_S, UAV_MAX_SPEED_MPS = 3.0, 10.0, 50.0
# SOG above this stands for "not available" (102.3) or nonsense.
AIS_LARGEST_SOG_KN = 80.0
MATCH_STANDARD_DEVIATIONS = 3.0
ORIGIN = (
    "trajectories from the demonstrations of Stone Soup (MIT, Crown Copyright Dstl and others), "
    "github.com/dstl/Stone-Soup, docs/demos; the radar is simulated"
)


@dataclass(frozen=True, slots=True)
class _Rows:
    """Reports of one target in the order of time."""

    time_s: FloatArray
    position_m: FloatArray
    velocity_mps: FloatArray


def load_ais(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read ships and look at them.

    Raises
    ------
    RecordingError
        If the file is no such table; the message names the line.
    """
    table = _table(path, AIS_COLUMNS, 5)
    number, ships = 0, []
    for name in sorted(set(table.names)):  # by the text of the identity, which goes no further
        number += 1
        rows = _ship(table, name)
        if rows is None:
            continue
        kind, mean, swerling = SHIP_TYPES[number % len(SHIP_TYPES)]
        ships.append(
            Trajectory(
                number,
                kind,
                rows.time_s,
                rows.position_m,
                rows.velocity_mps,
                mean,
                swerling,
                AIS_LONGEST_GAP_S,
            )
        )
    return _recording(path, ships, COASTAL_RADAR, "simulated_coastal_radar", options)


def load_uav(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read a drone's positions and look at it.

    Raises
    ------
    RecordingError
        If the file is no such table; the message names the line.
    """
    table = _table(path, UAV_COLUMNS, 3)
    latitude, longitude, altitude = table.values.T
    origin = (
        float(latitude[0]) + UAV_RADAR_OFFSET_DEG[0],
        float(longitude[0]) + UAV_RADAR_OFFSET_DEG[1],
        float(altitude[0]),
    )
    position = east_north_up(latitude, longitude, altitude, origin)
    rows = _cleaned(table.time_s, position, None, UAV_LEAST_GAP_S, UAV_MAX_SPEED_MPS)
    if rows is None:
        raise RecordingError(f"{path}: fewer than two positions that fit together")
    kind, mean, swerling = UAV_TYPE
    drone = Trajectory(
        1, kind, rows.time_s, rows.position_m, rows.velocity_mps, mean, swerling, UAV_LONGEST_GAP_S
    )
    return _recording(path, [drone], UAV_RADAR, "simulated_drone_radar", options)


def _recording(
    path: Path,
    trajectories: list[Trajectory],
    radar: SurveillanceRadar,
    preset: str,
    options: InputOptions,
) -> Recording:
    if not trajectories:
        raise RecordingError(f"{path}: no trajectory of two positions or more")
    begin_s = min(float(one.time_s[0]) for one in trajectories)
    end_s = max(float(one.time_s[-1]) for one in trajectories)
    detections, truth = observe(radar, trajectories, begin_s, end_s, options.seed, options.run)
    # Three standard deviations of an echo of 10 dB, midway to the largest range.
    cross_range_m = math.radians(radar.azimuth_resolution_deg) * 0.5 * radar.max_range_m
    position_std_m = max(radar.range_resolution_m, cross_range_m) / math.sqrt(2.0 * 10.0)
    ever = {int(i) for one in truth for i in one.target_id}
    number = sum(len(scan.range_m) for scan in detections)
    from_targets = sum(int((one.source_id >= 0).sum()) for one in truth)
    return Recording(
        name=path.stem,
        detections=detections,
        truth=truth,
        preset_name=preset,
        preset=read_preset(preset),
        origin=ORIGIN,
        match_distance_m=MATCH_STANDARD_DEVIATIONS * position_std_m,
        notes=[
            f"simulated radar {radar.sensor_id}, seed {options.seed}: {len(ever)} targets within "
            f"{radar.max_range_m / 1000:g} km, {number} detections in {len(detections)} scans, "
            f"{number - from_targets} of them false alarms"
        ],
    )


# --- tables


@dataclass(slots=True)
class _Table:
    """Rows of a file: name of the target, Unix time, numbers."""

    names: list[str]
    time_s: FloatArray
    values: FloatArray


def _table(path: Path, columns: tuple[str, ...], numbers: int) -> _Table:
    """Read a table; its last ``numbers`` columns but the identity are numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not a text file: {error}") from error
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in columns if name not in (reader.fieldnames or [])]
    if missing:
        raise RecordingError(f"{path}: columns {', '.join(missing)} are missing")
    wanted = [name for name in columns[1:] if name != "MMSI"]
    names, times, values = [], [], []
    for row in reader:
        where = f"{path}, line {reader.line_num}"
        try:
            moment = datetime.fromisoformat((row[columns[0]] or "").strip()).replace(tzinfo=UTC)
            values.append([float(row[name]) for name in wanted])
        except (TypeError, ValueError) as error:
            raise RecordingError(
                f"{where}: expected {', '.join(columns)}, a time such as 2016-01-12 13:02:11 and "
                "numbers"
            ) from error
        names.append(row.get("MMSI") or "")
        times.append(moment.timestamp())
    found = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    if not len(found) or not np.isfinite(found[:, :2]).all():
        raise RecordingError(f"{path}: no rows, or positions that are not finite")
    return _Table(names, np.array(times), found)


def _ship(table: _Table, name: str) -> _Rows | None:
    chosen = np.flatnonzero(np.array(table.names) == name)
    chosen = chosen[np.argsort(table.time_s[chosen], kind="stable")]
    latitude, longitude, course, speed = table.values[chosen].T
    position = east_north_up(latitude, longitude, 0.0, COAST)
    position[:, 2] = 0.0  # on the sea, whatever the curvature of the earth
    known = (speed < AIS_LARGEST_SOG_KN) & (course < 360.0)
    heading = np.radians(course)
    velocity = (speed * KNOT)[:, None] * np.stack(
        [np.sin(heading), np.cos(heading), np.zeros(len(heading))], axis=1
    )
    velocity[~known] = np.nan
    return _cleaned(table.time_s[chosen], position, velocity, AIS_LEAST_GAP_S, AIS_MAX_SPEED_MPS)


def _cleaned(
    time_s: FloatArray,
    position_m: FloatArray,
    velocity_mps: FloatArray | None,
    least_gap_s: float,
    max_speed_mps: float,
) -> _Rows | None:
    """Leave out jumps and reports too close in time; velocities by differences where unknown."""
    rows = without_jumps(time_s, position_m, max_speed_mps)
    rows = rows[spread_out(time_s[rows], least_gap_s)]
    if len(rows) < 2:
        return None
    time_s, position_m = time_s[rows], position_m[rows]
    between = np.gradient(position_m, time_s, axis=0)
    if velocity_mps is None:
        return _Rows(time_s, position_m, between)
    velocity = velocity_mps[rows]
    return _Rows(time_s, position_m, np.where(np.isfinite(velocity), velocity, between))


def _recognises(columns: tuple[str, ...]) -> Callable[[Path], bool]:
    def recognises(path: Path) -> bool:
        if not path.is_file():
            return False
        line = first_bytes(path, 4096).decode("utf-8-sig", errors="replace").partition("\n")[0]
        return set(columns) <= {name.strip() for name in line.split(",")}

    return recognises


AIS = Adapter(
    name="ais",
    description="AIS reports of ships as a table, seen by a simulated coastal radar",
    recognises=_recognises(AIS_COLUMNS),
    load=load_ais,
)
UAV = Adapter(
    name="uav",
    description="positions of a drone as a table, seen by a simulated radar",
    recognises=_recognises(UAV_COLUMNS),
    load=load_uav,
)
