"""Bags of what radars publish: ``PointCloud2``, ``RadarScan``, ``RadarTracks``."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.io.adapters.adapter import InputOptions, RecordingError
from gda_tracker.io.adapters.radar_frames import MAX_NAMED, recording_of_frames
from gda_tracker.io.bags import Bag, BagError, read_bag
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.messages import RADAR_TYPES, frame_of_message
from gda_tracker.io.radar.odometry_messages import take_odometry
from gda_tracker.io.radar.parameter_groups.motion import ODOMETRY_TYPES
from gda_tracker.io.transform_messages import TF_STATIC_TOPIC, TF_TOPIC, take_transforms
from gda_tracker.kinematics.odometry_buffer import OdometryBuffer
from gda_tracker.kinematics.transform_buffer import TransformBuffer
from gda_tracker.vocabulary.recordings import Recording

Report = Callable[[str], None]


def radar_topics(bag: Bag) -> list[str]:
    """Return the topics of a bag whose type is one of a radar's, by name."""
    return sorted(topic.name for topic in bag.topics.values() if topic.type in RADAR_TYPES)


def chosen_topic(bag: Bag, topic: str | None) -> str:
    """Return the topic asked for, or the only one of a radar.

    Raises
    ------
    RecordingError
        If there is none or more than one, or the one asked for is not a radar's.
    """
    found = radar_topics(bag)
    if topic is not None:
        name = topic if topic in bag.topics else f"/{topic}"
        if name in found:
            return name
        kind = f" ({bag.topics[name].type})" if name in bag.topics else ""
        raise RecordingError(
            f"{bag.path}: topic {topic}{kind}: allowed is one of "
            f"{', '.join(found or sorted(bag.topics))}"
        )
    if len(found) != 1:
        what = "several topics of radars" if found else "no topic of a radar"
        raise RecordingError(
            f"{bag.path}: {what}; choose with --topic: {', '.join(found) or ', '.join(RADAR_TYPES)}"
        )
    return found[0]


def bag_frames(
    path: Path, topic: str, report: Report, received: bool = False
) -> Iterator[RadarFrame]:
    """Yield the frames of a topic; messages that cannot be read are reported.

    ``received`` takes the time of recording in place of the messages' own stamps.

    Raises
    ------
    RecordingError
        If nothing can be read.
    """
    left_out = 0
    try:
        for number, record in enumerate(read_bag(path, [topic], report=report)):
            stamp_ns = record.stamp_ns if received else None
            try:
                yield frame_of_message(record.message(), record.type, stamp_ns)
            except UserError as error:
                left_out += 1
                if left_out <= MAX_NAMED:
                    report(f"message {number} on {topic} is left out: {error}")
    except BagError as error:
        raise RecordingError(str(error)) from error
    if left_out > MAX_NAMED:
        report(f"{left_out - MAX_NAMED} more messages on {topic} are left out")


def bag_transforms(bag: Bag, report: Report) -> TransformBuffer:
    """Return all transforms of a bag, whatever their time.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    # Everything is there before the first scan, so nothing need be forgotten.
    buffer = TransformBuffer(keep_s=math.inf)
    counts: Counter[str] = Counter()
    topics = [name for name in (TF_TOPIC, TF_STATIC_TOPIC) if name in bag.topics]
    try:
        for record in read_bag(bag.path, topics, report=report) if topics else ():
            take_transforms(buffer, record.message(), record.topic == TF_STATIC_TOPIC, counts)
    except BagError as error:
        raise RecordingError(str(error)) from error
    for reason, text in (
        ("tf_refused", "transforms were refused: names, stamp or rotation are none"),
        ("tf_jumped_back", "times the clock stepped back on /tf; what came before is forgotten"),
    ):
        if counts[reason]:
            report(f"{counts[reason]} {text}")
    return buffer


def bag_odometry(bag: Bag, parameters: RadarInputParameters, report: Report) -> OdometryBuffer:
    """Return all odometry of a bag on the topic that the parameters name.

    Raises
    ------
    RecordingError
        If there is no such topic, it is of another type, or the bag cannot be read.
    """
    wanted = parameters.odometry_topic
    name = wanted if wanted in bag.topics else f"/{wanted}"
    kind = bag.topics[name].type if name in bag.topics else ""
    if kind not in ODOMETRY_TYPES:
        there = sorted(t.name for t in bag.topics.values() if t.type in ODOMETRY_TYPES)
        raise RecordingError(
            f"{bag.path}: parameter odometry_topic = {wanted!r}"
            f"{f' ({kind})' if kind else ''}: allowed is one of "
            f"{', '.join(there) or 'none: no topic of ' + ', '.join(ODOMETRY_TYPES)}"
        )
    buffer = OdometryBuffer(keep_s=math.inf)
    counts: Counter[str] = Counter()
    try:
        for record in read_bag(bag.path, [name], report=report):
            take_odometry(buffer, record.message(), kind, parameters, counts)
    except BagError as error:
        raise RecordingError(str(error)) from error
    for reason, text in (
        ("odometry_refused", "reports of odometry were refused: frame, stamp or numbers are none"),
        ("odometry_unknown_frame", "reports of odometry were refused: they are of another frame"),
        ("odometry_jumped_back", "times the clock of the odometry stepped back; what came before "
         "is forgotten"),
    ):  # fmt: skip
        if counts[reason]:
            report(f"{counts[reason]} {text}")
    return buffer


def load_radar_bag(bag: Bag, options: InputOptions) -> Recording:
    """Make a recording of a radar's topic.

    Raises
    ------
    RecordingError
        If the topic, the preset or its parameters do not fit.
    """
    topic = chosen_topic(bag, options.topic)
    warnings: list[str] = []
    received = (options.radar_input or {}).get("stamp_source") == "received"
    frames = bag_frames(bag.path, topic, warnings.append, received)
    preset = options.preset or bag.notes.get("preset")
    name = bag.notes.get("name", bag.path.stem)
    recording = recording_of_frames(
        bag.path,
        name,
        frames,
        options,
        preset,
        transforms=lambda: bag_transforms(bag, warnings.append),
        odometry=lambda parameters: bag_odometry(bag, parameters, warnings.append),
    )
    recording.warnings[:0] = warnings
    recording.origin = bag.notes.get("origin", "")
    recording.notes.insert(0, f"topic {topic} ({bag.topics[topic].type})")
    return recording
