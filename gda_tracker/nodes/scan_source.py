"""Node ``scan_source``: publishes a simulated scenario with truth, or plays a recording.

It waits for the answer to every scan (``scan_reports``): at most ``credits`` scans are unanswered,
and an unanswered one is sent again, so nothing is lost however slow the ring or whatever restarts.
A statement is sent when all scans before it are answered, and the next scan when it is.
"""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gda_tracker_msgs import msg

from gda_tracker.io.messages import (
    detections_to_message,
    scan_report_from_message,
    scan_truth_to_message,
    statement_report_from_message,
    statement_to_message,
    tracks_from_message,
    tracks_to_message,
)
from gda_tracker.nodes.base import RingNode, spin_node
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.simulation.playback import Playback, of_recording, of_scenario
from gda_tracker.vocabulary.scans import ScanReport
from gda_tracker.vocabulary.statements import StatementReport
from gda_tracker.vocabulary.tracks import Tracks

TICK_S = 0.05


@dataclass(frozen=True)
class ScanSourceParameters:
    """What to play and how fast."""

    input: str = parameter(
        "crossing_targets",
        "name or file of a scenario, or a recording (bag folder, file of an adapter)",
        live=False,
    )
    adapter: str = parameter("auto", "adapter that reads the recording", live=False)
    runs: int = parameter(1, "Monte Carlo runs of a scenario", minimum=1, live=False)
    seed: int = parameter(1, "seed of the simulation", minimum=0, live=False)
    method: str = parameter(
        "map/bayes/cv", "method of the tracker that the labelled tracks are made for", live=False
    )
    rate: float = parameter(
        0.0,
        "speed relative to the recording's own time; 0: as fast as the ring completes scans",
        minimum=0.0,
        live=False,
    )
    credits: int = parameter(
        1,
        "scans that may be unanswered; below the tracker's queue_depth, above what its "
        "reorder_window_s holds",
        minimum=1,
        live=False,
    )
    resend_period_s: float = parameter(
        1.0, "an unanswered scan is sent again after", unit="s", minimum=0.1, live=False
    )
    start_timeout_s: float = parameter(
        60.0, "wait for a track manager at most", unit="s", minimum=0.0, live=False
    )


@dataclass(slots=True)
class _Sent:
    message: Any
    sent_at: float


@dataclass(slots=True)
class Progress:
    """How far the playing has come; ``reports`` has every answer, in order.

    ``tracks`` has the tracks of every answered scan, by sensor and stamp, if the source collects
    them.
    """

    total: int = 0
    sent: int = 0
    answered: int = 0
    reports: list[ScanReport] = field(default_factory=list)
    tracks: dict[tuple[str, int], Tracks] = field(default_factory=dict)
    statement_reports: list[StatementReport] = field(default_factory=list)


class ScanSourceNode(RingNode):
    """``detections``, ``statements``, ``initial_tracks`` and ``truth`` out, the reports in.

    Parameters
    ----------
    plays
        What to play; by default what the parameters name.
    collect
        Listen to ``tracks`` too, and take a scan as answered only when its tracks have come:
        nothing is missed while subscriptions are still being matched.
    ready
        Asked before the first scan: whether whoever wants to hear all of them does.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | None = None,
        plays: list[Playback] | None = None,
        collect: bool = False,
        ready: Callable[[], bool] = lambda: True,
        **options: Any,
    ) -> None:
        super().__init__("scan_source", ScanSourceParameters, parameters, **options)
        p = self.parameters
        if plays is None:
            plays = load_playbacks(p.input, p.adapter, p.runs, p.seed, p.method)
        self._plays = deque(plays)
        self._collect, self._ready = collect, ready
        self._play: Playback | None = None
        self._position = 0
        self._waiting: dict[tuple[str, int], _Sent] = {}
        self._said: dict[tuple[str, int], _Sent] = {}
        self._said_until = -1
        self._speaks = any(play.statements for play in plays)
        self._reported: dict[tuple[str, int], ScanReport] = {}
        self._initial: tuple[int, Any, float] | None = None
        self._sequence = 0
        self._play_started = 0.0
        self._begun_at: float | None = None
        self.progress = Progress(total=sum(len(play.detections) for play in plays))
        self.finished = False
        self.exit_code = 0
        self.error = ""

    def open_topics(self) -> None:
        """Open the topics."""
        self._detections = self.advertise(msg.DetectionArray, "detections", stream())
        self._truth = self.advertise(msg.ScanTruth, "truth", stream(1000))
        self._initial_tracks = self.advertise(msg.TrackArray, "initial_tracks", latched())
        self._statements = self.advertise(msg.Statement, "statements", stream())
        self.subscribe(
            msg.StatementReport, "statement_reports", self._on_statement_report, stream(1000)
        )
        self.subscribe(msg.ScanReport, "scan_reports", self._on_report, stream(1000))
        if self._collect:
            self.subscribe(msg.TrackArray, "tracks", self._on_tracks, stream(1000))
        self.create_timer(TICK_S, self._tick, clock=self._steady)

    # --- what goes out ----------------------------------------------------------------------------

    def _tick(self) -> None:
        if not self.active or self.finished:
            return
        now = self.seconds()
        if self._begun_at is None:
            self._begun_at = now
        if not self._matched():
            late = now - self._begun_at > self.parameters.start_timeout_s
            if self.progress.sent == 0 and late:
                self._stop("no track_manager found: is the ring running in this domain?", 1)
            return
        for sent in self._waiting.values():
            if now - sent.sent_at > self.parameters.resend_period_s:
                self.counters["resent"] += 1
                sent.sent_at = now
                self._detections.publish(sent.message)
        for sent in self._said.values():
            if now - sent.sent_at > self.parameters.resend_period_s:
                self.counters["statement_resent"] += 1
                sent.sent_at = now
                self._statements.publish(sent.message)
        if self._initial is not None and now - self._initial[2] > self.parameters.resend_period_s:
            self._initial = (*self._initial[:2], now)
            self._initial_tracks.publish(self._initial[1])
        self._fill()

    def _matched(self) -> bool:
        """Whether both directions to the track manager are up."""
        heard = not self._speaks or (
            self._statements.get_subscription_count() > 0
            and self.count_publishers("statement_reports") > 0
        )
        return (
            (heard and (self.progress.sent > 0 or self._ready()))
            and self._detections.get_subscription_count() > 0
            and self.count_publishers("scan_reports") > 0
        )

    def _fill(self) -> None:
        """Send as many scans as credits and rate allow."""
        while not self.finished:
            if self._play is None and not self._next_play():
                return
            play = self._play
            if play is None or self._initial is not None:
                return
            if self._position == len(play.detections):
                if self._waiting:
                    return
                self._play = None
                continue
            if len(self._waiting) >= self.parameters.credits or not self._due(play):
                return
            if not self._say(play):
                return
            self._send(play)

    def _say(self, play: Playback) -> bool:
        """Say what comes before the next scan; return whether all of it has been answered."""
        if self._said_until < self._position:
            statements = play.said_before(self._position)
            if statements and self._waiting:
                return False
            self._said_until = self._position
            for statement in statements:
                message = statement_to_message(statement)
                identity = (statement.source, statement.sequence)
                self._said[identity] = _Sent(message, self.seconds())
                self._statements.publish(message)
        return not self._said

    def _due(self, play: Playback) -> bool:
        rate = self.parameters.rate
        if rate == 0.0:
            return True
        first = play.detections[0].stamp_ns
        elapsed = (play.detections[self._position].stamp_ns - first) / 1e9
        return self.seconds() - self._play_started >= elapsed / rate

    def _next_play(self) -> bool:
        if not self._plays:
            self._stop("", 0)
            return False
        self._play = self._plays.popleft()
        self._position, self._said_until = 0, -1
        self._play_started = self.seconds()
        if self._play.initial is not None:
            # A fresh identity: the tracker starts anew even if the same tracks are played again.
            initial = replace(self._play.initial, system_uuid=uuid.uuid4().bytes)
            message = tracks_to_message(initial)
            self._initial = (initial.key.stamp_ns, message, self.seconds())
            self._initial_tracks.publish(message)
        return True

    def _send(self, play: Playback) -> None:
        detections = play.detections[self._position]
        if play.truth is not None:
            self._truth.publish(scan_truth_to_message(play.truth[self._position]))
        self._sequence += 1
        message = detections_to_message(replace(detections, sequence=self._sequence))
        self._waiting[(detections.sensor_id, detections.stamp_ns)] = _Sent(message, self.seconds())
        self._detections.publish(message)
        self._position += 1
        self.progress.sent += 1

    # --- what comes back --------------------------------------------------------------------------

    def _on_report(self, message: Any) -> None:
        report = scan_report_from_message(message)
        if report.outcome == "initialised" or report.reason.startswith("initial_tracks"):
            if self._initial is not None and report.key.stamp_ns == self._initial[0]:
                self._initial = None
                if report.outcome == "rejected":
                    self._stop(f"initial tracks rejected: {report.reason}", 1)
                self._fill()
            return
        key = (report.key.sensor_id, report.key.stamp_ns)
        if key not in self._waiting:
            return
        self._reported.setdefault(key, report)
        self._answer(key)

    def _on_statement_report(self, message: Any) -> None:
        report = statement_report_from_message(message)
        if self._said.pop((report.source, report.sequence), None) is not None:
            self.progress.statement_reports.append(report)
            self._fill()

    def _on_tracks(self, message: Any) -> None:
        tracks = tracks_from_message(message)
        key = (tracks.key.sensor_id, tracks.key.stamp_ns)
        if key in self._waiting:
            self.progress.tracks[key] = tracks
            self._answer(key)

    def _answer(self, key: tuple[str, int]) -> None:
        """Take a scan as answered once all that is expected has come."""
        report = self._reported.get(key)
        if report is None:
            return
        if self._collect and report.outcome != "rejected" and key not in self.progress.tracks:
            return
        del self._waiting[key], self._reported[key]
        self.progress.answered += 1
        self.progress.reports.append(report)
        self._fill()

    def _stop(self, error: str, code: int) -> None:
        self.finished, self.exit_code, self.error = True, code, error
        if error:
            self.get_logger().error(error)

    def figures(self) -> dict[str, Any]:
        """How far it has come."""
        p = self.progress
        return {"scans": p.total, "sent": p.sent, "answered": p.answered}


def load_playbacks(name: str, adapter: str, runs: int, seed: int, method: str) -> list[Playback]:
    """Load a scenario or a recording for playing; errors are :class:`ParameterError`."""
    from gda_tracker.io.adapters import is_recording, load_recording
    from gda_tracker.simulation.scenarios import load_scenario, shipped_scenarios

    try:
        is_scenario = name in shipped_scenarios() or (
            Path(name).suffix in (".yaml", ".yml") and not is_recording(name)
        )
        if adapter == "auto" and is_scenario:
            return of_scenario(load_scenario(name), runs, seed, method)
        return [of_recording(load_recording(name, adapter))]
    except (OSError, ValueError) as error:
        raise ParameterError(f"parameter input = {name!r}: {error}") from error


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(ScanSourceNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
