"""``gda-tracker replay`` through the four nodes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from gda_tracker.commands.options import MARKERS, Parameters, node_of_file
from gda_tracker.commands.progress import progress_bar
from gda_tracker.commands.replay_summary import Answers
from gda_tracker.errors import UserError
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.vocabulary.statements import StatementReport

if TYPE_CHECKING:
    from gda_tracker.evaluation.rounds import Heard
    from gda_tracker.nodes.ring_listener import RingListenerNode

STALL_TIMEOUT_S = 60.0
DIAGNOSTICS_TIMEOUT_S = 3.0


def credits_needed(play: Playback, parameters: Parameters) -> int:
    """How many scans must be on the way so that the reorder window never holds them all."""
    manager = stage_parameters(parameters)["track_manager"]
    if not manager.reorder_window_s:
        return 1
    stamps = np.sort([detections.stamp_ns for detections in play.detections])
    newer = np.searchsorted(stamps, stamps + round(manager.reorder_window_s * 1e9), side="right")
    return int(min((newer - np.arange(len(stamps))).max() + 2, manager.queue_depth))


def through_the_nodes(
    play: Playback,
    parameters: Parameters,
    args: argparse.Namespace,
    said: list[StatementReport],
    heard: list[Heard],
) -> Answers:
    """Play through four processes in a domain of their own.

    Parameters
    ----------
    play, parameters
        What to play, and ``{node: {name: value}}``.
    args
        Of the command.
    said, heard
        Taken up: the answers to statements and, with ``--report``, what the stages tell.

    Raises
    ------
    UserError
        If a node ends, or no scan is answered for a minute.
    """
    from gda_tracker.nodes.runner import Nodes, RingProcesses, private_environment, use_environment
    from gda_tracker.nodes.scan_source import ScanSourceNode

    environment = private_environment(args.domain)
    use_environment(environment)

    def make(**options: object) -> list[object]:
        settings = {"rate": args.rate, "credits": credits_needed(play, parameters)}
        others: list[object] = []
        if args.report:
            from gda_tracker.nodes.ring_listener import RingListenerNode

            listeners.append(RingListenerNode(**options))
            others += listeners
            options["ready"] = listeners[0].heard_diagnostics
        source = ScanSourceNode(settings, plays=[play], collect=True, **options)
        options.pop("ready", None)
        if args.bag:
            from gda_tracker.nodes.recorder import RecorderNode

            recorded: dict[str, object] = {"bag": str(args.bag)}
            if args.markers:
                from gda_tracker.io.markers.parameters import marker_topics
                from gda_tracker.nodes.markers import MarkersNode

                others.append(MarkersNode(node_of_file(args.params, MARKERS) or {}, **options))
                recorded["also"] = marker_topics()
            others.append(RecorderNode(recorded, **options))
        return [source, *others]

    listeners: list[RingListenerNode] = []
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(make) as nodes,
        progress_bar(len(play.detections), "scans") as bar,
    ):
        source = nodes.nodes[0]
        stalled = _Stall()

        def watch() -> None:
            bar(source.progress.answered)
            failure = ring.failed() or stalled.after(source.progress.answered, args.rate)
            if failure:
                raise UserError(failure)

        nodes.spin_until(lambda: source.finished, watch=watch)
        bar(source.progress.answered)
        if source.error:
            raise UserError(source.error)
        for listener in listeners:
            # The figures of the last scans come with the next diagnostics, within a second.
            listener.forget_diagnostics()
            nodes.spin_until(listener.heard_diagnostics, DIAGNOSTICS_TIMEOUT_S)
            heard.append(listener.heard(source.progress.reports))
        progress = source.progress
        said += progress.statement_reports
    return [
        (report, progress.tracks.get((report.key.sensor_id, report.key.stamp_ns)))
        for report in progress.reports
    ]


class _Stall:
    """Says when nothing has been answered for too long."""

    def __init__(self) -> None:
        self._answered, self._since = -1, 0.0

    def after(self, answered: int, rate: float) -> str:
        import time

        now = time.monotonic()
        if answered != self._answered:
            self._answered, self._since = answered, now
        if rate == 0.0 and now - self._since > STALL_TIMEOUT_S:
            return f"no scan was answered for {STALL_TIMEOUT_S:.0f} s"
        return ""
