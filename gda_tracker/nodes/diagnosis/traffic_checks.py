"""What is wrong with what comes: stamps, clocks, frames, rates, silence."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING, Finding
from gda_tracker.nodes.diagnosis.graph_checks import ACTIVE
from gda_tracker.nodes.diagnosis.look import RADAR_INPUT
from gda_tracker.nodes.diagnosis.observation import (
    NS_PER_S,
    Message,
    Observation,
    by_sensor,
    offset_s,
)
from gda_tracker.nodes.runner import STAGES

# A clock that is off by more is no delay of processing.
LARGEST_OFFSET_S = 1.0
# Beyond this it is another time: a recording, a simulation, or the time since power-on.
EPOCH_OFFSET_S = 86_400.0
LARGEST_SENSOR_DIFFERENCE_S = 0.5
# A pause of so many periods is a gap.
LONG_PAUSE = 8.0
DAY_S = 86_400.0


def traffic_findings(seen: Observation) -> list[Finding]:
    """Judge the messages."""
    found = [*_clock(seen)]
    for topic in seen.inputs:
        messages = seen.heard.get(topic, [])
        found += _silence(seen, topic)
        for sensor, own in by_sensor(messages).items():
            subject = f"{topic} ({sensor})" if sensor else topic
            found += _stamps(subject, own)
            found += _frames(seen, subject, own)
            found += _rate(subject, own)
    found += _sensors(seen)
    return [*found, *_answers(seen)]


def _clock(seen: Observation) -> Iterator[Finding]:
    simulated = sorted(name for name, used in seen.sim_time.items() if used)
    real = sorted(name for name, used in seen.sim_time.items() if not used)
    if simulated and not seen.clocks:
        yield Finding(
            WARNING,
            "clock_missing",
            "/clock",
            f"nobody publishes it, and {', '.join(simulated)} use simulated time",
            "their clock stands at 0: stamp_source received, diagnostics and frames get time 0",
            "ros2 bag play --clock, or ros2 param set "
            f"{seen.node(simulated[0])} use_sim_time false",
        )
    if simulated and real:
        yield Finding(
            WARNING,
            "clock_mixed",
            "use_sim_time",
            f"is true for {', '.join(simulated)}, false for {', '.join(real)}",
            "the nodes live in different times",
            f"ros2 param set {seen.node(real[0])} use_sim_time true, or false for all",
        )


def _silence(seen: Observation, topic: str) -> Iterator[Finding]:
    if not seen.publishers(topic) or seen.heard.get(topic) or topic in seen.unreadable:
        return
    if topic not in seen.heard:
        return  # of a type that nobody can use: said elsewhere
    if topic == seen.topic("detections") and len(seen.inputs) > 1:
        source = seen.inputs[0]
        if not seen.heard.get(source):
            return
    nodes = ", ".join(sorted({endpoint.node for endpoint in seen.publishers(topic)}))
    yield Finding(
        ERROR,
        "no_messages",
        topic,
        f"{nodes} publishes it, and nothing came within {seen.seconds:g} s",
        "the publisher is silent, or found but not heard: other user or container without shared "
        "memory in common, a firewall, a killed process",
        f"ros2 topic hz {topic}; if that is silent, look at {nodes}; else all nodes with "
        "FASTDDS_DEFAULT_PROFILES_FILE=params/fastdds_udp.xml",
    )


# --- stamps ---------------------------------------------------------------------------------------


def _stamps(subject: str, messages: list[Message]) -> Iterator[Finding]:
    stamps = np.array([message.stamp_ns for message in messages], dtype=np.int64)
    if (stamps == 0).all():
        yield Finding(
            ERROR,
            "stamp_unset",
            subject,
            "all stamps are 0",
            "the measurement time is the only clock of the tracker: without it there is no speed",
            "gda-tracker params set stamp_source=received, or mend the driver",
        )
        return
    steps = np.diff(stamps)
    if (steps < 0).any():
        yield Finding(
            ERROR,
            "stamp_backwards",
            subject,
            f"stamps step back {np.count_nonzero(steps < 0)} times, by up to "
            f"{-steps.min() / NS_PER_S:.3f} s",
            "such scans are rejected as late, or reset all tracks (time_jump_s)",
            "one publisher per sensor (ros2 topic info -v); a looped bag without --loop; a driver "
            "out of order: gda-tracker params set reorder_window_s=0.2",
        )
    if len(steps) and (steps == 0).mean() > 0.5:
        yield Finding(
            ERROR,
            "stamp_stands",
            subject,
            "stamps stand still",
            "scans of the same stamp are taken for repetitions of one scan",
            "gda-tracker params set stamp_source=received, or mend the driver's clock",
        )
    yield from _epoch(subject, offset_s(messages))


def _epoch(subject: str, offset: float) -> Iterator[Finding]:
    if abs(offset) <= LARGEST_OFFSET_S:
        return
    ahead = "behind" if offset > 0 else "ahead of"
    size = abs(offset)
    if size > EPOCH_OFFSET_S:
        yield Finding(
            NOTE,
            "stamp_epoch",
            subject,
            f"stamps are {size / DAY_S:.1f} days {ahead} the clock",
            "tracks do not mind (a recording, or a sensor that counts from power-on); frames, "
            "statements and other sensors of the real time do not fit to them",
            "ros2 bag play --clock and use_sim_time true for all nodes; for a live sensor "
            "gda-tracker params set stamp_source=received",
        )
        return
    yield Finding(
        WARNING,
        "stamp_offset",
        subject,
        f"stamps are {size:.1f} s {ahead} the clock",
        "sensors whose clocks differ make two tracks of one target, and frames are looked up at "
        "the wrong time",
        "chronyc tracking (or PTP) on the sensor's host; gda-tracker params set "
        "stamp_source=received",
    )


def _sensors(seen: Observation) -> Iterator[Finding]:
    """Whether the clocks of several sensors agree."""
    offsets = {
        sensor: offset_s(messages)
        for sensor, messages in by_sensor(seen.heard.get(seen.topic("detections"), [])).items()
        if any(message.stamp_ns for message in messages)
    }
    if len(offsets) < 2:
        return
    first, last = min(offsets, key=offsets.__getitem__), max(offsets, key=offsets.__getitem__)
    difference = offsets[last] - offsets[first]
    if difference > LARGEST_SENSOR_DIFFERENCE_S:
        yield Finding(
            WARNING,
            "sensor_clocks_differ",
            seen.topic("detections"),
            f"the stamps of {last} are {difference:.3f} s behind those of {first}",
            "scans arrive out of the order of their stamps: they are late, or a target is in two "
            "places",
            "chronyc tracking (or PTP) on both hosts; if it is the time of processing: "
            f"gda-tracker params set reorder_window_s={1.5 * difference:.1g}",
        )


# --- frames, rate ---------------------------------------------------------------------------------


def _frames(seen: Observation, subject: str, messages: list[Message]) -> Iterator[Finding]:
    frames = sorted({message.frame_id for message in messages})
    if frames == [""]:
        yield Finding(
            WARNING,
            "frame_unset",
            subject,
            "frame_id is empty",
            "nobody can tell where the sensor stands: displays show nothing, its pose is not found",
            "set the frame_id in the driver's parameters",
        )
        return
    if len(frames) > 1:
        yield Finding(
            WARNING,
            "frame_changes",
            subject,
            f"comes in several frames: {', '.join(frame or '(empty)' for frame in frames)}",
            "one sensor stands in one frame; two publishers share the topic",
            "ros2 topic info -v; one topic, or one sensor_id, per sensor",
        )
    target = seen.parameters.get("track_manager", {}).get("tracking_frame")
    if not seen.transforms or not target:
        return
    reached = connected(seen.transforms, str(target))
    for frame in frames:
        if frame and frame.lstrip("/") not in reached:
            yield Finding(
                WARNING,
                "frame_unknown",
                subject,
                f"frame {frame} is not connected with the tracking frame {target}",
                "displays cannot show the detections beside the tracks",
                f"ros2 run tf2_ros static_transform_publisher --frame-id {target} "
                f"--child-frame-id {frame}, with the mounting pose",
            )


def connected(transforms: list[tuple[str, str]], frame: str) -> set[str]:
    """Return the frames that can be reached from a frame, itself included."""
    reached, ahead = {frame}, [frame]
    while ahead:
        here = ahead.pop()
        for pair in transforms:
            if here in pair:
                other = pair[1] if pair[0] == here else pair[0]
                if other not in reached:
                    reached.add(other)
                    ahead.append(other)
    return reached


def _rate(subject: str, messages: list[Message]) -> Iterator[Finding]:
    pauses = np.diff([message.arrived_s for message in messages])
    if len(pauses) < 5:
        return
    usual, longest = float(np.median(pauses)), float(pauses.max())
    if longest > max(LONG_PAUSE * usual, 0.5):
        yield Finding(
            NOTE,
            "gaps",
            subject,
            f"comes every {usual:.3f} s, but once nothing came for {longest:.2f} s",
            "a gap is a miss for every track",
            "top, on this host and the sensor's; a lossy network: ros2 topic hz there and here",
        )


# --- answers --------------------------------------------------------------------------------------


def _answers(seen: Observation) -> Iterator[Finding]:
    """Whether what goes in comes out."""
    detections = seen.topic("detections")
    heard = len(seen.heard.get(detections, []))
    whole = all(seen.copies(name) == 1 and seen.states.get(name) == ACTIVE for name in STAGES)
    if heard and not seen.reports and whole:
        manager = seen.last.get(seen.node("track_manager"))
        deaf = manager is not None and manager.values.get("input_age_s") == "none"
        yield Finding(
            ERROR,
            "not_answered",
            detections,
            f"{heard} scans came, none was answered within {seen.seconds:g} s",
            "the track_manager does not hear what is heard here"
            if deaf
            else "a stage does not answer, or the first scan waits for initial_tracks",
            "restart the track_manager; FASTDDS_DEFAULT_PROFILES_FILE=params/fastdds_udp.xml for "
            "all nodes"
            if deaf
            else "gda-tracker doctor --json shows the diagnostics; gda-tracker params get "
            "initiation",
        )
    queues = [report.queue_length for report in seen.reports]
    period = seen.rate_hz(detections)
    if len(queues) >= 6 and period is not None and min(queues[-3:]) > max(queues[:3]) + 2:
        latency = float(np.median([report.latency_s for report in seen.reports]))
        yield Finding(
            WARNING,
            "too_slow",
            seen.node("track_manager"),
            f"scans come at {period:.1f} Hz, {queues[-1]} wait, each is answered after "
            f"{latency:.2f} s",
            "the queue fills up, then scans are rejected",
            "gda-tracker params set mht_leaves_per_track=3 (or decision=map); leave out weak "
            "detections (minimum_snr_db) and those that stand still (moving_above_mps)",
        )
    if RADAR_INPUT in seen.states and seen.states[RADAR_INPUT] == ACTIVE and seen.inputs:
        source = seen.inputs[0]
        if len(seen.heard.get(source, [])) > 2 and not heard:
            yield Finding(
                ERROR,
                "no_detections",
                seen.node(RADAR_INPUT),
                f"{source} comes, and no detections come of it",
                "all messages are dropped; the counters of the node say why",
                f"gda-tracker inspect {source} --yaml my_radar.yaml",
            )
