"""ASTERIX of an air traffic control radar: a capture (pcap, pcapng) or a file of data blocks."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.adapters.radar_frames import recording_of_frames
from gda_tracker.io.asterix.packets import is_capture, is_raw, read_datagrams
from gda_tracker.io.asterix.reader import (
    AsterixReader,
    first_day,
    parse_source,
    sensor_name,
    source_name,
)
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.parameters import ParameterError
from gda_tracker.vocabulary.recordings import Recording

LOOK_BYTES = 1 << 18


def recognises(path: Path) -> bool:
    """Tell whether this is a capture, or data blocks of category 034 or 048."""
    start = first_bytes(path, LOOK_BYTES)
    return bool(start) and (is_capture(start) or is_raw(start, path.stat().st_size))


def by_radar(path: Path) -> dict[str, list[RadarFrame]]:
    """Return the turns of each radar in a file by SAC/SIC, that with most plots first.

    Raises
    ------
    RecordingError
        If the file cannot be read, or has no target report.
    """
    return _read(path, AsterixReader(), Counter())


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read the turns of a radar; without one named in ``options`` there must be only one.

    Raises
    ------
    RecordingError
        If the file cannot be read, the radar is not in it, or a preset or parameter does not fit.
    """
    declared = options.radar_input or {}
    radar = options.topic or declared.get("asterix_source") or None
    try:
        wanted = None if radar is None else source_name(parse_source(radar))
        reader = AsterixReader(first_day=first_day(declared.get("asterix_date") or ""))
    except ParameterError as error:
        raise RecordingError(str(error)) from error
    packets: Counter[str] = Counter()
    turns = _read(path, reader, packets)
    known = ", ".join(turns)
    if wanted is None and len(turns) > 1:
        raise RecordingError(f"{path}: several radars; choose with --topic: {known}")
    if wanted is not None and wanted not in turns:
        raise RecordingError(f"{path}: radar {wanted}: allowed is one of {known}")
    name = wanted or next(iter(turns))
    found = recording_of_frames(path, path.stem, turns[name], options)
    found.notes.insert(0, f"radar {name} (SAC/SIC), {reader.plots[parse_source(name)]} plots")
    left_out = reader.counts + packets
    if left_out:
        text = ", ".join(f"{count} {why}" for why, count in sorted(left_out.items()))
        found.warnings.append(f"left out of the file: {text}")
    return found


def _read(path: Path, reader: AsterixReader, packets: Counter[str]) -> dict[str, list[RadarFrame]]:
    found: dict[str, list[RadarFrame]] = {}
    try:
        for payload, received_ns in read_datagrams(path, packets):
            for frame in reader.take(payload, received_ns):
                found.setdefault(frame.sensor_id, []).append(frame)
    except UserError as error:
        raise RecordingError(str(error)) from error
    for frame in reader.flush():
        found.setdefault(frame.sensor_id, []).append(frame)
    if not reader.plots:
        counted = ", ".join(f"{n} {why}" for why, n in sorted((reader.counts + packets).items()))
        raise RecordingError(
            f"{path}: no target report of ASTERIX category 048"
            + (f"; left out: {counted}" if counted else "")
        )
    ranked = reader.plots.most_common()
    return {source_name(source): found.get(sensor_name(source), []) for source, _ in ranked}


ADAPTER = Adapter(
    name="asterix",
    description="ASTERIX categories 048 and 034: a capture (pcap, pcapng) or raw data blocks",
    recognises=recognises,
    load=load,
    by_radar=by_radar,
)
