"""``gda-tracker inspect``: what a radar's topic, bag or file holds, and the parameters for it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.io.asterix.udp import is_udp
from gda_tracker.io.radar.file_kinds import DETECTIONS
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.io.radar.inspection import inspect_frames
from gda_tracker.io.radar.inspection_report import report
from gda_tracker.io.radar.recommendation import Recommendation, recommend, recommended_yaml

Frames = Iterator[RadarFrame]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "source", metavar="SOURCE", help="bag, file, live topic, or udp://HOST:PORT (ASTERIX)"
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="of a bag: this topic only; of ASTERIX: this radar, SAC/SIC"
    )
    parser.add_argument(
        "--yaml", type=Path, metavar="FILE", help="write parameters that fit, ready to run"
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=3.0,
        metavar="S",
        help="of a live topic: look for this long (default: 3)",
    )
    parser.add_argument(
        "--wait",
        type=float,
        default=10.0,
        metavar="S",
        help="for a live topic: wait at most this long for its first message (default: 10)",
    )


def run(args: argparse.Namespace) -> int:
    """Look, print, and write the parameters."""
    sources, ending = _sources(args)
    found: list[Recommendation] = []
    for name, frames in sources:
        one = recommend(inspect_frames(name, frames))
        if not one.inspection.kind:
            print(f"{name}: no message")
            continue
        print(report(one) + "\n")
        found.append(one)
    for line in ending:
        print(line)
    if not found:
        raise UserError(f"{args.source}: nothing of a radar to inspect")
    if args.yaml:
        if len(found) > 1:
            names = ", ".join(one.inspection.source for one in found)
            raise UserError(f"--yaml: several topics; choose one with --topic: {names}")
        args.yaml.write_text(recommended_yaml(found[0]), encoding="utf-8")
        print(f"parameters: {args.yaml}")
    print(_what_next(args, found[0]))
    return 0


def _what_next(args: argparse.Namespace, found: Recommendation) -> str:
    """Return the command that tracks."""
    if found.inspection.kind == DETECTIONS:
        return f"next: gda-tracker replay {args.source}"
    if not found.usable:
        return "next: name the fields in a parameter file (docs/radars.md)"
    if args.yaml:
        given = f"--params {args.yaml}"
    elif found.preset and not found.changes:
        given = f"--preset {found.preset}"
    else:
        return f"next: gda-tracker inspect {args.source} --yaml FILE"
    if not Path(args.source).exists():
        return f"next: gda-tracker run --input {args.source} {given}"
    topic = f" --topic {args.topic}" if args.topic else ""
    return f"next: gda-tracker replay {args.source}{topic} {given}"


def _sources(args: argparse.Namespace) -> tuple[Iterator[tuple[str, Frames]], list[str]]:
    """What to look at, by name, and lines about the rest."""
    path = Path(args.source)
    if not path.exists():
        if args.topic:
            raise UserError(
                f"--topic {args.topic}: allowed with bags and ASTERIX only, {path} does not exist"
            )
        return iter([(args.source, _live(args))]), []
    from gda_tracker.io.adapters import ADAPTERS, guess_adapter

    adapter = ADAPTERS[guess_adapter(path)]
    if adapter.name == "bag":
        return _of_bag(path, args.topic)
    if adapter.by_radar is not None:
        return _of_radars(path, adapter.by_radar(path), args.topic)
    if args.topic:
        raise UserError(
            f"--topic {args.topic}: allowed with bags and ASTERIX only, {path} is {adapter.name}"
        )
    if adapter.frames is not None:
        return iter([(str(path), adapter.frames(path))]), []
    return iter([(str(path), _of_detections(path, adapter.name))]), []


def _of_bag(path: Path, topic: str | None) -> tuple[Iterator[tuple[str, Frames]], list[str]]:
    """Frames of each radar topic, and a line for each other topic."""
    from gda_tracker.io.adapters.radar_bag import bag_frames, chosen_topic, radar_topics
    from gda_tracker.io.bags import Bag

    bag = Bag(path)
    if bag.damage:
        print(f"warning: {path} is damaged: {bag.damage}", file=sys.stderr)
    topics = [chosen_topic(bag, topic)] if topic else radar_topics(bag)
    others = [item for item in bag.topics.values() if item.name not in topics]
    if topic:
        others = []
    lines = [f"other topics of {path}:"] if others else []
    lines += [f"  {item.name}: {item.type}, {item.message_count} messages" for item in others]
    if not topics:
        from gda_tracker.io.adapters.bag import DETECTIONS_TYPE

        if any(item.type == DETECTIONS_TYPE for item in others):
            return iter([(str(path), _of_detections(path, "bag"))]), [*lines, ""]

    def warn(text: str) -> None:
        print(f"warning: {text}", file=sys.stderr)

    return ((name, bag_frames(path, name, warn)) for name in topics), [*lines, ""] if lines else []


def _of_radars(
    path: Path, turns: dict[str, list[RadarFrame]], radar: str | None
) -> tuple[Iterator[tuple[str, Frames]], list[str]]:
    """Frames of each radar of a recording, or of the one asked for."""
    if radar is not None and radar not in turns:
        raise UserError(f"{path}: radar {radar}: allowed is one of {', '.join(turns)}")
    names = list(turns) if radar is None else [radar]
    return ((f"{path} {name}", iter(turns[name])) for name in names), []


def _of_detections(path: Path, adapter: str) -> Frames:
    """Frames of a recording whose meaning is in itself."""
    from gda_tracker.io.adapters import load_recording
    from gda_tracker.io.radar.frames import frame_of_detections

    for scan in load_recording(path, adapter).detections:
        yield frame_of_detections(scan)


def _live(args: argparse.Namespace) -> Frames:
    """Frames of a topic that is published now."""
    if not args.seconds > 0.0 or not args.wait >= 0.0:
        raise UserError(
            f"--seconds {args.seconds}, --wait {args.wait}: allowed are numbers > 0 and >= 0"
        )
    if is_udp(args.source):
        from gda_tracker.nodes.asterix_listener import listen as listen_udp

        return listen_udp(args.source, args.wait, args.seconds)
    from gda_tracker.nodes.topic_listener import listen

    return listen(args.source, args.wait, args.seconds)
