"""How ``gda-tracker run`` runs: the stages and the nodes beside them, in one process or many."""

from __future__ import annotations

import sys
import time
from importlib import import_module
from typing import NamedTuple

from gda_tracker.commands.options import (
    MARKERS,
    RADAR_INPUT,
    SET_VALUED_TRACKER,
    TRACK_EVENTS,
    TRACK_FORMATIONS,
    TRACK_OUTPUT,
    Parameters,
)

RESTART_WINDOW_S = 60.0
RESTARTS_ALLOWED = 5


class NodeBeside(NamedTuple):
    """A node beside the ring: its name, that of its class, and what users call it."""

    name: str
    maker: str
    what: str


# In the order in which they start; their modules bear their names. A node runs if there are
# parameters of it, be they none.
BESIDE = (
    NodeBeside(RADAR_INPUT, "RadarInputNode", "the radar input"),
    NodeBeside(TRACK_OUTPUT, "TrackOutputNode", "the track output"),
    NodeBeside(MARKERS, "MarkersNode", "the markers"),
    NodeBeside(SET_VALUED_TRACKER, "SetValuedTrackerNode", "the set-valued tracker"),
    NodeBeside(TRACK_EVENTS, "TrackEventsNode", "the events"),
    NodeBeside(TRACK_FORMATIONS, "TrackFormationsNode", "the formations"),
)


def _wanted(parameters: Parameters) -> list[NodeBeside]:
    return [node for node in BESIDE if node.name in parameters]


def _beside_the_ring(parameters: Parameters, **options: object) -> list[object]:
    return [
        getattr(import_module(f"gda_tracker.nodes.{node.name}"), node.maker)(
            parameters[node.name], **options
        )
        for node in _wanted(parameters)
    ]


def _recorder(parameters: Parameters, bag: str | None, **options: object) -> list[object]:
    if not bag:
        return []
    from gda_tracker.io.track_outputs import FORMATS
    from gda_tracker.nodes.recorder import RecorderNode

    of_output = parameters.get(TRACK_OUTPUT, {})
    also = [
        f"{of_output[name]}={kind}" for name, (kind, _) in FORMATS.items() if of_output.get(name)
    ]
    if MARKERS in parameters:
        from gda_tracker.io.markers.parameters import marker_topics

        also += marker_topics()
    return [RecorderNode({"bag": bag, "also": also}, **options)]


def what_runs(parameters: Parameters) -> str:
    """Say in words which nodes these parameters start."""
    return " and ".join(["four nodes", *(node.what for node in _wanted(parameters))])


def _waits(parameters: Parameters) -> str:
    topic = parameters.get(RADAR_INPUT, {}).get("input_topic", "detections")
    return f"waiting for {topic}; Ctrl-C ends"


def run_in_one_process(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    """Run all nodes in this process until Ctrl-C; ``remap`` are ROS arguments for each."""
    from gda_tracker.nodes.runner import Nodes, stage_nodes

    arguments = ["--ros-args", *remap] if remap else None

    def make(**options: object) -> list[object]:
        return [
            *stage_nodes(parameters, **options),
            *_beside_the_ring(parameters, **options),
            *_recorder(parameters, bag, **options),
        ]

    with Nodes(make, arguments=arguments) as nodes:
        print(f"gda-tracker run: {what_runs(parameters)} in one process, {_waits(parameters)}")
        sys.stdout.flush()
        nodes.spin_until(lambda: not nodes.context.ok())
    return 0


def run_in_processes(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    """Run a process for each node until Ctrl-C, and start again what ends; 1 if one stays down."""
    from gda_tracker.nodes.runner import STAGES, Nodes, RingProcesses

    restarts: list[float] = []

    def watch() -> None:
        for stage, process in list(ring.processes.items()):
            code = process.poll()
            if code is None:
                continue
            now = time.monotonic()
            restarts[:] = [t for t in restarts if now - t < RESTART_WINDOW_S] + [now]
            if code == 2 or len(restarts) > RESTARTS_ALLOWED:
                raise _GivenUp(f"node {stage} ended with code {code}")
            print(
                f"gda-tracker run: node {stage} ended with code {code}, restarted", file=sys.stderr
            )
            ring.start(stage)

    stages = (*STAGES, *(node.name for node in _wanted(parameters)))
    with RingProcesses(parameters, arguments=remap, stages=stages) as ring:
        print(f"gda-tracker run: {len(stages)} processes, {_waits(parameters)}")
        sys.stdout.flush()
        try:
            if bag:
                arguments = ["--ros-args", *remap] if remap else None
                with Nodes(
                    lambda **options: _recorder(parameters, bag, **options), arguments=arguments
                ) as nodes:
                    nodes.spin_until(lambda: not nodes.context.ok(), watch=watch)
            else:
                while True:
                    watch()
                    time.sleep(0.2)
        except _GivenUp as error:
            print(f"gda-tracker run: {error}", file=sys.stderr)
            return 1
    return 0


class _GivenUp(RuntimeError):
    """A node does not stay up."""
