"""Detections as a table of text (CSV), one row a detection, the units in the names of the columns.

================  ===============  =================================================================
quantity          columns          notes
================  ===============  =================================================================
time              time_s, time_ms  or stamp_ns; rows of one time, one after the other, are one scan
range             range_m          or range_km, range_nmi
azimuth           azimuth_rad      or azimuth_deg; counter-clockwise from x unless a preset or
                                   parameter says otherwise
elevation         elevation_rad    or elevation_deg; optional
position          x_m, y_m, z_m    in place of range and azimuth; z optional
range rate        range_rate_mps   or range_rate_kmh, range_rate_kn; positive going away; optional
radar cross       rcs_dbsm, rcs_m2 one of them; optional
section
noise             range_std_m, azimuth_std_rad, azimuth_std_deg, elevation_std_rad,
                  elevation_std_deg, range_rate_std_mps; optional
signal to noise   snr_db           optional
others            any              for ``attribute_fields``
================  ===============  =================================================================

An empty cell is unknown. A row with a time and nothing else stands for a scan without detections.
Lines that begin with ``#`` are comments.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.adapters.radar_frames import NO_PRESET, recording_of_frames
from gda_tracker.io.radar.file_kinds import CSV
from gda_tracker.io.radar.frames import RadarFrame, frame_of_columns
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording

FRAME_ID = "radar"
DEGREE = math.pi / 180.0
NAUTICAL_MILE = 1852.0
# Column -> quantity, factor to its unit here (m, rad, m/s, dBsm, dB).
COLUMNS: dict[str, tuple[str, float]] = {
    "range_m": ("range", 1.0),
    "range_km": ("range", 1000.0),
    "range_nmi": ("range", NAUTICAL_MILE),
    "azimuth_rad": ("azimuth", 1.0),
    "azimuth_deg": ("azimuth", DEGREE),
    "elevation_rad": ("elevation", 1.0),
    "elevation_deg": ("elevation", DEGREE),
    "x_m": ("x", 1.0),
    "y_m": ("y", 1.0),
    "z_m": ("z", 1.0),
    "range_rate_mps": ("range_rate", 1.0),
    "range_rate_kmh": ("range_rate", 1.0 / 3.6),
    "range_rate_kn": ("range_rate", NAUTICAL_MILE / 3600.0),
    "rcs_dbsm": ("rcs", 1.0),
    "rcs_m2": ("rcs", math.nan),  # by the logarithm
    "range_std_m": ("range_std", 1.0),
    "azimuth_std_rad": ("azimuth_std", 1.0),
    "azimuth_std_deg": ("azimuth_std", DEGREE),
    "elevation_std_rad": ("elevation_std", 1.0),
    "elevation_std_deg": ("elevation_std", DEGREE),
    "range_rate_std_mps": ("range_rate_std", 1.0),
    "snr_db": ("snr", 1.0),
}
TIMES = {"time_s": 10**9, "time_ms": 10**6, "stamp_ns": 1}
POSITIONS = ({"range", "azimuth"}, {"x", "y"})


def recognises(path: Path) -> bool:
    """Tell whether the first line names a time and a position."""
    if not path.is_file():
        return False
    try:
        text = first_bytes(path, 4096).decode("utf-8-sig")
    except UnicodeDecodeError:
        return False
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    try:
        _check_names(names, "")
    except RecordingError:
        return False
    return True


def frames(path: Path) -> Iterator[RadarFrame]:
    """Yield the scans in the order of the file.

    Raises
    ------
    RecordingError
        If the file is not such a table; the message names the line and what is allowed.
    """
    names, rows = _rows(path)
    time = next(name for name in names if name in TIMES)
    others = [name for name in names if name != time]
    scan: list[list[float]] = []
    stamp_ns = -1
    for line, cells in rows:
        where = f"{path}, line {line}"
        if len(cells) != len(names):
            raise RecordingError(f"{where}: {len(cells)} cells, {len(names)} expected")
        row = dict(zip(names, cells, strict=True))
        own = _stamp(row[time], time, where)
        if own != stamp_ns:
            if stamp_ns >= 0:
                yield _frame(stamp_ns, others, scan)
            scan, stamp_ns = [], own
        numbers = [_number(row[name], name, where) for name in others]
        if not all(math.isnan(number) for number in numbers):
            scan.append(numbers)
    if stamp_ns >= 0:
        yield _frame(stamp_ns, others, scan)


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read the table.

    Raises
    ------
    RecordingError
        If the file is not such a table, or a preset or parameter does not fit.
    """
    # The names of the columns have said what the units are.
    fixed = {"angle_unit": "rad", "rcs_scale": 1.0, "rcs_offset": 0.0}
    names, _ = _rows(path)
    if any(COLUMNS.get(name, ("",))[0] == "rcs" for name in names):
        fixed["rcs_unit"] = "dbsm"
    recording = recording_of_frames(path, path.stem, frames(path), options, NO_PRESET, fixed)
    if recording.preset_name == NO_PRESET:
        recording.preset_name = "default"
    return recording


def _rows(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Return the names of the columns, and the rows with their line numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not a text file: {error}") from error
    lines = (
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    )
    rows = ((number, next(csv.reader([line]))) for number, line in lines)
    _, first = next(rows, (0, []))
    names = [name.strip() for name in first]
    _check_names(names, f"{path}: ")
    return names, rows


def _check_names(names: list[str], where: str) -> None:
    """Raise :class:`RecordingError` unless there is one time, a position and nothing twice."""
    if sum(name in TIMES for name in names) != 1:
        raise RecordingError(
            f"{where}columns {', '.join(names)}: needed is one of {', '.join(TIMES)}"
        )
    quantities = [COLUMNS[name][0] for name in names if name in COLUMNS]
    if not any(position <= set(quantities) for position in POSITIONS):
        raise RecordingError(
            f"{where}columns {', '.join(names)}: needed are range_m (or range_km, range_nmi) and "
            "azimuth_deg (or azimuth_rad), or x_m and y_m"
        )
    fields = [_field(name) for name in names]
    twice = sorted({field for field in fields if fields.count(field) > 1})
    if twice or "" in fields:
        raise RecordingError(f"{where}columns for {', '.join(twice) or 'nothing'}: allowed is one")


def _field(column: str) -> str:
    return COLUMNS[column][0] if column in COLUMNS else column


def _stamp(cell: str, column: str, where: str) -> int:
    """Return the time [ns]; whole numbers exactly."""
    text = cell.strip()
    scale = TIMES[column]
    whole, point, fraction = text.partition(".")
    try:
        if whole.isdigit() and (not point or fraction.isdigit()):
            digits = fraction[:9].ljust(9, "0")
            return int(whole) * scale + int(digits) * scale // 10**9
        stamp = float(text) * scale
    except ValueError:
        stamp = math.nan
    if not 0.0 <= stamp < 2**63:
        raise RecordingError(f"{where}: {column} = {cell!r}: allowed is a number >= 0")
    return round(stamp)


def _number(cell: str, column: str, where: str) -> float:
    text = cell.strip()
    if not text:
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise RecordingError(f"{where}: {column} = {cell!r}: allowed is a number") from None


def _frame(stamp_ns: int, names: list[str], scan: list[list[float]]) -> RadarFrame:
    table = np.array(scan, dtype=np.float64).reshape(len(scan), len(names))
    columns = {
        _field(name): _in_unit(values, name) for name, values in zip(names, table.T, strict=True)
    }
    return frame_of_columns(CSV, stamp_ns, FRAME_ID, columns)


def _in_unit(values: FloatArray, column: str) -> FloatArray:
    if column == "rcs_m2":
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(values > 0.0, 10.0 * np.log10(values), np.nan)
    return values * COLUMNS[column][1] if column in COLUMNS else values


ADAPTER = Adapter(
    name="csv",
    description="table of detections with columns such as time_s, range_m, azimuth_deg, rcs_dbsm",
    recognises=recognises,
    load=load,
    frames=frames,
)
