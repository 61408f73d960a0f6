"""Bags: topics of ``DetectionArray``, and of ``ScanTruth`` where the truth is known.

A bag without ``DetectionArray`` may hold what a radar published, see
:mod:`gda_tracker.io.adapters.radar_bag`. A bag may name its preset and its origin in its notes
(``custom_data`` of ``metadata.yaml``).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.adapters.radar_bag import load_radar_bag, radar_topics
from gda_tracker.io.bag_types import MissingLibraryError
from gda_tracker.io.bags import Bag, BagError, BagRecord, BagTopic, BagWriter, read_bag
from gda_tracker.io.fields import MessageError
from gda_tracker.io.parameter_files import ParameterFileError, read_preset
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth

DETECTIONS_TYPE = "gda_tracker_msgs/msg/DetectionArray"
TRUTH_TYPE = "gda_tracker_msgs/msg/ScanTruth"
STATEMENT_TYPE = "gda_tracker_msgs/msg/Statement"
READ_TYPES = (DETECTIONS_TYPE, TRUTH_TYPE, STATEMENT_TYPE)
MAGIC = (b"\x89MCAP0\r\n", b"SQLite format 3\x00")
MAX_NAMED = 5  # messages left out that are named one by one


def recognises(path: Path) -> bool:
    """Tell whether this is a folder with bag files, an MCAP file or an sqlite3 file."""
    if path.is_dir():
        return any(
            entry.name == "metadata.yaml" or entry.suffix in (".mcap", ".db3")
            for entry in path.iterdir()
        )
    return first_bytes(path, 16).startswith(MAGIC)


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read detections and statements in the order they were recorded, and their truth.

    With ``options.topic``, or without a topic of detections, what a radar published is read.

    A scan or statement that was sent again is taken once. A damaged bag is read as far as it goes;
    what was wrong is in ``warnings`` of the result.

    Raises
    ------
    RecordingError
        If the bag cannot be read or holds no detections.
    """
    try:
        bag = Bag(path)
    except (BagError, MissingLibraryError) as error:
        raise RecordingError(str(error)) from error
    topics = [topic for topic in bag.topics.values() if topic.type in READ_TYPES]
    known = {topic.name for topic in topics if topic.type == DETECTIONS_TYPE}
    if options.topic is not None and options.topic not in known:
        return load_radar_bag(bag, options)
    if not known and radar_topics(bag):
        return load_radar_bag(bag, options)
    if not known:
        found = ", ".join(sorted(bag.topics)) or "none"
        raise RecordingError(f"{path}: no topic of type {DETECTIONS_TYPE}; its topics are {found}")
    if options.topic is not None:
        topics = [
            topic for topic in topics if topic.name == options.topic or topic.name not in known
        ]
    recording = Recording(name=bag.notes.get("name", path.stem), detections=[])
    recording.origin = bag.notes.get("origin", "")
    _take_preset(recording, bag.notes.get("preset"))
    truth = _read(path, {topic.name for topic in topics}, recording)
    if any((scan.sensor_id, scan.stamp_ns) in truth for scan in recording.detections):
        recording.truth = _truth_per_scan(recording, truth)
    return recording


def _take_preset(recording: Recording, name: str | None) -> None:
    if name is None:
        return
    try:
        recording.preset, recording.preset_name = read_preset(name), name
    except ParameterFileError as error:
        recording.warnings.append(f"{error}; the defaults are used")


def _read(path: Path, topics: set[str], recording: Recording) -> dict[tuple[str, int], ScanTruth]:
    from gda_tracker.io.messages import (
        detections_from_message,
        scan_truth_from_message,
        statement_from_message,
    )

    truth: dict[tuple[str, int], ScanTruth] = {}
    seen: dict[tuple[str, int], int] = {}
    said: set[tuple[str, int]] = set()
    repeated = 0
    left_out: list[str] = []
    for number, record in enumerate(_records(path, topics, recording)):
        try:
            if record.type == TRUTH_TYPE:
                entry = scan_truth_from_message(record.message())
                truth.setdefault((entry.sensor_id, entry.stamp_ns), entry)
                continue
            if record.type == STATEMENT_TYPE:
                statement = statement_from_message(record.message())
                identity = (statement.source, statement.sequence)
                if identity not in said:
                    said.add(identity)
                    recording.statements.append((len(recording.detections), statement))
                continue
            scan = detections_from_message(record.message())
        except (MessageError, BagError) as error:
            left_out.append(f"message {number} on {record.topic} is left out: {error}")
            continue
        key = (scan.sensor_id, scan.stamp_ns)
        if key in seen:
            repeated += 1
            continue
        seen[key] = number
        recording.detections.append(scan)
    recording.warnings += left_out[:MAX_NAMED]
    if len(left_out) > MAX_NAMED:
        recording.warnings.append(f"{len(left_out) - MAX_NAMED} more messages are left out")
    if repeated:
        recording.warnings.append(f"{repeated} scans were sent again and are taken once")
    if not recording.detections:
        raise RecordingError(
            f"{path}: no scan could be read" + "".join(f"; {w}" for w in left_out[:1])
        )
    return truth


def _records(path: Path, topics: set[str], recording: Recording) -> Iterator[BagRecord]:
    try:
        yield from read_bag(path, topics, report=recording.warnings.append)
    except BagError as error:
        raise RecordingError(str(error)) from error


def _truth_per_scan(
    recording: Recording, truth: dict[tuple[str, int], ScanTruth]
) -> list[ScanTruth]:
    """One truth per scan; where the bag has none, states that are unknown (NaN)."""
    found = [truth.get((scan.sensor_id, scan.stamp_ns)) for scan in recording.detections]
    missing = sum(entry is None for entry in found)
    if missing:
        recording.warnings.append(f"{missing} of {len(found)} scans have no truth")
    identifiers = np.unique(np.concatenate([entry.target_id for entry in truth.values()]))
    return [
        _unknown(scan, identifiers) if entry is None else entry
        for scan, entry in zip(recording.detections, found, strict=True)
    ]


def _unknown(scan: Detections, identifiers: Any) -> ScanTruth:
    return ScanTruth(
        sensor_id=scan.sensor_id,
        stamp_ns=scan.stamp_ns,
        target_id=identifiers.astype(np.int32),
        target_state=np.full((len(identifiers), 4), np.nan),
    )


def write_recording(path: str | Path, recording: Recording, preset: str | None = None) -> None:
    """Write a recording as a bag that :func:`load` reads back exactly.

    Every message is stamped with the time of its scan, so the bag depends on the recording alone.

    Parameters
    ----------
    path
        Folder of the bag; must not exist.
    recording
        What to write; of its preset only the name is kept.
    preset
        Name of a shipped preset that suits the sensor.

    Raises
    ------
    BagError
        If the bag cannot be written.
    MissingLibraryError
        If the rosbags library is not installed.
    """
    from gda_tracker.io.messages import (
        detections_to_message,
        scan_truth_to_message,
        statement_to_message,
    )

    topics = [BagTopic("/detections", DETECTIONS_TYPE, depth=100)]
    if recording.truth is not None:
        topics.append(BagTopic("/truth", TRUTH_TYPE, depth=100))
    if recording.statements:
        topics.append(BagTopic("/statements", STATEMENT_TYPE, depth=100))
    notes = {"name": recording.name, "origin": recording.origin}
    if preset is not None:
        notes["preset"] = preset
    with BagWriter(path, topics, notes) as bag:
        for index, scan in enumerate(recording.detections):
            for number, statement in recording.statements:
                if number == index:
                    bag.write("/statements", statement_to_message(statement), scan.stamp_ns)
            bag.write("/detections", detections_to_message(scan), scan.stamp_ns)
            if recording.truth is not None:
                truth = recording.truth[index]
                bag.write("/truth", scan_truth_to_message(truth), scan.stamp_ns)


ADAPTER = Adapter(
    name="bag",
    description="rosbag2 folder, .mcap or .db3 file with DetectionArray messages or a radar's",
    recognises=recognises,
    load=load,
)
