"""One part of the demo: scans through four processes, scored, recorded, supervised."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gda_tracker.commands.options import Parameters
from gda_tracker.evaluation.summary import Run, pair_with_truth
from gda_tracker.simulation.playback import Playback

# Longest waits: for four processes to come up and find each other, for the answer to one scan, and
# for the last messages to reach the recorder and the evaluator.
START_TIMEOUT_S = 40.0
STALL_TIMEOUT_S = 20.0
DRAIN_TIMEOUT_S = 10.0
# Every node publishes diagnostics once a second; who has been silent for longer hangs.
SILENCE_S = 3.0

# Who publishes what, in the order of the ring.
PUBLISHERS = {
    "scans": "track_manager",
    "predictions": "track_manager",
    "evidence": "rcs_fuzzifier",
    "attribute_scores": "attribute_fusion",
    "associations": "association",
    "tracks": "track_manager",
    "scan_reports": "track_manager",
}
# How many listen to the source: the track manager, the recorder, the evaluator.
LISTENERS = {"detections": 2, "initial_tracks": 3, "truth": 2}
PER_SCAN_TOPICS = ("detections", "truth", *PUBLISHERS)


class DemoError(RuntimeError):
    """The demo cannot go on; the message is one line and names the node or file."""


@dataclass(frozen=True)
class Part:
    """One part of the demo: what is played, with which parameters, and how it is scored.

    ``plays`` have a truth for every scan. ``match_distance_m`` is how far a track may be from a
    target that it follows.
    """

    title: str
    method: str
    plays: list[Playback]
    parameters: Parameters
    match_distance_m: float
    truth_is_partial: bool

    @property
    def scans(self) -> int:
        """Number of scans in all."""
        return sum(len(play.detections) for play in self.plays)


@dataclass(frozen=True)
class Played:
    """What came out of a part: scored runs, latency of each scan [ms], scans that were lost."""

    part: Part
    runs: list[Run]
    latency_ms: list[float]
    lost_scans: int
    recorded: Mapping[str, int]
    seconds: float


def play_part(
    part: Part, bag: Path, environment: Mapping[str, str], show: Callable[[int], None]
) -> Played:
    """Play a part through four processes.

    Parameters
    ----------
    part
        What to play.
    bag
        Folder of the bag to record, which must not exist.
    environment
        Environment of the processes; this process must have its transport variables too.
    show
        Is told the number of scans answered so far.

    Raises
    ------
    DemoError
        If a process ends, does not come up or does not answer; the message names it.
    """
    from gda_tracker.nodes.evaluator import EvaluatorNode
    from gda_tracker.nodes.recorder import RecorderNode
    from gda_tracker.nodes.runner import Nodes, RingProcesses
    from gda_tracker.nodes.scan_source import ScanSourceNode

    scoring = {
        "match_distance_m": part.match_distance_m,
        "truth_is_partial": part.truth_is_partial,
    }

    def make(**options: Any) -> list[Any]:
        # The source starts only when the others are listening.
        return [
            ScanSourceNode({"autostart": False}, plays=part.plays, **options),
            RecorderNode({"bag": str(bag)}, **options),
            EvaluatorNode(scoring, **options),
        ]

    began = time.monotonic()
    with RingProcesses(part.parameters, environment) as ring, Nodes(make) as nodes:
        source, recorder, evaluator = nodes.nodes
        source.trigger_configure()
        life = _SignsOfLife(recorder)

        def alive() -> None:
            if failure := ring.failed():
                raise DemoError(failure)

        def listening() -> bool:
            # A node whose diagnostics arrive has found all readers of this process: they were made
            # known to it in order, that of the diagnostics last.
            return not _unmatched(source, recorder, evaluator) and life.all_heard()

        if not nodes.spin_until(listening, START_TIMEOUT_S, alive):
            missing = ", ".join(_unmatched(source, recorder, evaluator) or life.unheard())
            raise DemoError(f"not up after {START_TIMEOUT_S:.0f} s: {missing}")
        source.trigger_activate()
        stall = _Stall()

        def watch() -> None:
            alive()
            show(source.progress.answered)
            if stall.lasts(source.progress.answered):
                silent = life.silent() or [silent_stage(_counts(recorder))]
                raise DemoError(
                    f"{' and '.join(f'node {name}' for name in silent)} does not answer: no scan "
                    f"was completed for {STALL_TIMEOUT_S:.0f} s"
                )

        nodes.spin_until(lambda: source.finished, watch=watch)
        if source.error:
            raise DemoError(source.error)
        show(source.progress.answered)

        def drained() -> bool:
            tracks, truth = evaluator.collected()
            counts = _counts(recorder)
            return min(len(tracks), len(truth), *counts.values()) >= part.scans

        nodes.spin_until(drained, DRAIN_TIMEOUT_S, alive)
        tracks, truth = evaluator.collected()
        reports = [r for r in source.progress.reports if r.outcome == "tracked"]
        tracked = sum((r.key.sensor_id, r.key.stamp_ns) in tracks for r in reports)
        return Played(
            part=part,
            runs=pair_with_truth(tracks, truth),
            latency_ms=[1e3 * report.latency_s for report in reports if report.latency_s > 0.0],
            lost_scans=part.scans - tracked,
            recorded=_counts(recorder),
            seconds=time.monotonic() - began,
        )


def silent_stage(counts: Mapping[str, int]) -> str:
    """Name the node to blame if all are alive, from how often each topic was heard.

    All stages answer every scan once, also when it is sent again: the first in the order of the
    ring that was heard less often than the scans did not answer. If there is none, the track
    manager did not go on.
    """
    scans = counts["scans"]
    late = [topic for topic in PUBLISHERS if counts[topic] < scans and topic != "scan_reports"]
    return PUBLISHERS[late[0]] if late and scans else "track_manager"


def _counts(recorder: Any) -> dict[str, int]:
    """How often each topic that has one message a scan was recorded."""
    return {
        topic: recorder.counters[f"recorded {recorder.resolve_topic_name(topic)}"]
        for topic in PER_SCAN_TOPICS
    }


def _unmatched(source: Any, recorder: Any, evaluator: Any) -> list[str]:
    """Links that are not up yet: nodes of the ring that are not heard, or do not hear."""
    from gda_tracker.nodes.recorder import TOPICS_BESIDE

    missing: dict[str, None] = {}
    heard = [*source.subscriptions, *recorder.subscriptions, *evaluator.subscriptions]
    for subscription in heard:
        topic = subscription.topic_name.rpartition("/")[2]
        if topic not in TOPICS_BESIDE and not subscription.get_publisher_count():
            missing[f"node {PUBLISHERS.get(topic, 'scan_source')}"] = None
    for publisher in source.publishers:
        expected = LISTENERS.get(publisher.topic_name.rpartition("/")[2], 0)
        if publisher.get_subscription_count() < expected:
            missing["node track_manager"] = None
    return list(missing)


class _SignsOfLife:
    """When each node of the ring was last heard on ``/diagnostics``."""

    def __init__(self, node: Any) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._heard = dict.fromkeys(dict.fromkeys(PUBLISHERS.values()), time.monotonic())
        self._unheard = dict.fromkeys(self._heard)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            name = status.name.rpartition("/")[2]
            if name in self._heard:
                self._heard[name] = time.monotonic()
                self._unheard.pop(name, None)

    def all_heard(self) -> bool:
        """Whether every node has been heard at least once."""
        return not self._unheard

    def unheard(self) -> list[str]:
        """Nodes that have never been heard."""
        return [f"node {name}" for name in self._unheard]

    def silent(self) -> list[str]:
        """Nodes that have been silent for too long."""
        now = time.monotonic()
        return [name for name, heard in self._heard.items() if now - heard > SILENCE_S]


class _Stall:
    """Says when nothing has been answered for too long."""

    def __init__(self) -> None:
        self._answered, self._since = -1, 0.0

    def lasts(self, answered: int) -> bool:
        now = time.monotonic()
        if answered != self._answered:
            self._answered, self._since = answered, now
        return now - self._since > STALL_TIMEOUT_S
