"""Single scans of Continental radars as YAML, as the Nebula driver's tests print its messages.

A file ``..._detection.yaml`` of an ARS548 or an SRR520 is one scan, a folder of them a recording
in the order of their stamps. Fields get the names that the driver's point clouds have, so that the
same presets hold. Values that the sensor marks as invalid become unknown (NaN).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.adapters.radar_frames import recording_of_frames
from gda_tracker.io.radar.file_kinds import ARS548, SRR520
from gda_tracker.io.radar.frames import RadarFrame, frame_of_columns
from gda_tracker.vocabulary.recordings import Recording

# Names in the message -> in the point cloud.
NAMES = {
    "azimuth_angle": "azimuth",
    "azimuth_angle_std": "azimuth_std",
    "elevation_angle": "elevation",
    "elevation_angle_std": "elevation_std",
}
# Mark in the message -> field in the point cloud that it makes unknown.
INVALID = {
    "invalid_distance": "range",
    "invalid_distance_std": "range_std",
    "invalid_azimuth": "azimuth",
    "invalid_azimuth_std": "azimuth_std",
    "invalid_elevation": "elevation",
    "invalid_elevation_std": "elevation_std",
    "invalid_range_rate": "range_rate",
    "invalid_range_rate_std": "range_rate_std",
}
SUFFIXES = (".yaml", ".yml")
ORIGIN = "Continental radar scan of the Nebula driver's tests (Apache-2.0), github.com/tier4/nebula"

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def recognises(path: Path) -> bool:
    """Tell whether this is a YAML file with a header and detections, or a folder with one."""
    try:
        if path.is_dir():
            return any(_is_scan(entry) for entry in path.iterdir())
    except OSError:
        return False
    return _is_scan(path)


def frames(path: Path) -> Iterator[RadarFrame]:
    """Yield the scans by stamp.

    Raises
    ------
    RecordingError
        If a file cannot be read; the message names it.
    """
    files = [path]
    if path.is_dir():
        files = sorted(entry for entry in path.iterdir() if _is_scan(entry))
        if not files:
            raise RecordingError(f"{path}: no YAML file with detections in the folder")
    yield from sorted((_frame(file) for file in files), key=lambda frame: frame.stamp_ns)


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read one scan, or those of a folder.

    Raises
    ------
    RecordingError
        If a file cannot be read, or a folder has scans of both kinds of radar.
    """
    found = list(frames(path))
    kinds = sorted({frame.kind for frame in found})
    if len(kinds) > 1:
        raise RecordingError(f"{path}: scans of different radars: {', '.join(kinds)}")
    recording = recording_of_frames(path, path.stem, found, options)
    recording.origin = ORIGIN
    return recording


def _is_scan(path: Path) -> bool:
    if path.suffix not in SUFFIXES:
        return False
    start = first_bytes(path, 4096)
    return start.startswith(b"header:") and b"\ndetections:" in start


def _frame(path: Path) -> RadarFrame:
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: {error}") from error
    except yaml.YAMLError as error:
        raise RecordingError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if isinstance(content, dict) and "objects" in content:
        raise RecordingError(f"{path}: the sensor's own objects, not detections")
    try:
        header, entries = content["header"], content["detections"] or []
        stamp = header["stamp"]
        stamp_ns = int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"])
        kind = ARS548 if "ambiguity_free_velocity_max" in content else SRR520
        names = list(entries[0]) if entries else []
        columns = {
            NAMES.get(name, name): np.array([entry[name] for entry in entries], dtype=np.float64)
            for name in names
        }
        frame_id = str(header["frame_id"])
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: not a scan with header and detections: {error}") from error
    for mark, name in INVALID.items():
        if mark in columns:
            columns[name][columns.pop(mark) != 0.0] = np.nan
    return frame_of_columns(kind, stamp_ns, frame_id, columns)


ADAPTER = Adapter(
    name="continental_yaml",
    description="scans of a Continental ARS548 or SRR520 as YAML, a file or a folder",
    recognises=recognises,
    load=load,
    frames=frames,
)
