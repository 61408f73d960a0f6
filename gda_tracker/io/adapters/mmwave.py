"""Text frames of a 4-D mmWave radar (github.com/Research-and-Project/mmWave_radar_tracking, MIT).

A folder ``SOT`` with one file a frame, ``8600.txt`` and so on, or the ``.tar.xz`` of it as it
stands. Rows of ten numbers: x to the right, y ahead, z up [m], range [m], azimuth clockwise from
ahead, elevation [rad], range rate [m/s], power [dB], power as the sensor gives it, time [ms].
Files repeat: a frame whose time was there already is left out.
"""

from __future__ import annotations

import io
import lzma
import re
import tarfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.adapters.radar_frames import recording_of_frames
from gda_tracker.io.radar.file_kinds import MMWAVE
from gda_tracker.io.radar.frames import RadarFrame, frame_of_columns
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording

XZ = b"\xfd7zXZ\x00"
FRAME_ID = "radar"
COLUMNS = (
    "x",
    "y",
    "z",
    "range",
    "azimuth",
    "elevation",
    "doppler",
    "power",
    "power_value",
    "timestamp_ms",
)
NAME = re.compile(r"\d+\.txt")
LARGEST_FRAME_BYTES = 1 << 26
ORIGIN = (
    "4-D mmWave radar, one person walking (MIT), github.com/Research-and-Project/"
    "mmWave_radar_tracking"
)


def recognises(path: Path) -> bool:
    """Tell whether the first frame of a folder or an archive is rows of ten numbers."""
    try:
        if path.is_file() and not first_bytes(path, 6).startswith(XZ):
            return False
        _, text = next(_files(path))
        _table("", text)
    except (StopIteration, RecordingError, OSError):
        return False
    return True


def frames(path: Path) -> Iterator[RadarFrame]:
    """Yield the frames in the order of their files, repeated ones included.

    Raises
    ------
    RecordingError
        If a file cannot be read; the message names it.
    """
    for name, text in _files(path):
        table = _table(name, text)
        stamps = np.unique(table[:, -1])
        if len(stamps) != 1 or not 0.0 <= stamps[0] < 1e15:
            raise RecordingError(f"{name}: column 10 is not one time [ms] for all rows")
        columns = dict(zip(COLUMNS[:-1], table.T, strict=False))
        yield frame_of_columns(MMWAVE, round(stamps[0] * 1e6), FRAME_ID, columns)


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read the frames, each stamp once.

    Raises
    ------
    RecordingError
        If the path is not of this kind or a file cannot be read.
    """
    name = path.name.split(".")[0]
    recording = recording_of_frames(path, name, frames(path), options)
    recording.origin = ORIGIN
    return recording


def _files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each frame's file, by number."""
    yield from _of_folder(path) if path.is_dir() else _of_archive(path)


def _of_folder(path: Path) -> Iterator[tuple[str, bytes]]:
    folder = path / "SOT" if (path / "SOT").is_dir() else path
    found = [entry for entry in folder.iterdir() if NAME.fullmatch(entry.name)]
    if not found:
        raise RecordingError(f"{path}: no frame NUMBER.txt in the folder")
    for entry in sorted(found, key=lambda entry: int(entry.stem)):
        yield str(entry), entry.read_bytes()


def _of_archive(path: Path) -> Iterator[tuple[str, bytes]]:
    try:
        with tarfile.open(path, "r:xz") as archive:
            members = [
                member
                for member in archive
                if member.isfile() and NAME.fullmatch(PurePosixPath(member.name).name)
            ]
            if not members:
                raise RecordingError(f"{path}: no frame NUMBER.txt in the archive")
            for member in sorted(members, key=lambda m: int(PurePosixPath(m.name).stem)):
                file = archive.extractfile(member)
                if file is None or member.size > LARGEST_FRAME_BYTES:
                    raise RecordingError(f"{path}: {member.name} is not a file of a frame")
                yield f"{path}: {member.name}", file.read()
    except (tarfile.TarError, lzma.LZMAError, OSError, EOFError) as error:
        raise RecordingError(f"{path}: not a .tar.xz archive: {error}") from error


def _table(name: str, text: bytes) -> FloatArray:
    """Return the rows (n, 10) of a frame."""
    try:
        table = np.loadtxt(io.BytesIO(text), dtype=np.float64, ndmin=2)
    except (ValueError, UnicodeDecodeError) as error:
        raise RecordingError(f"{name}: not rows of numbers: {error}") from error
    if table.shape[1:] != (len(COLUMNS),) or not len(table):
        raise RecordingError(f"{name}: expected rows of {len(COLUMNS)} numbers")
    return table


ADAPTER = Adapter(
    name="mmwave",
    description="frames NUMBER.txt of a 4-D mmWave radar, a folder or its .tar.xz",
    recognises=recognises,
    load=load,
    frames=frames,
)
