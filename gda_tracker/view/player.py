"""Plays a recording or scenario through the ring, with pause, step and changes while it runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

from gda_tracker.association.associate import Associator
from gda_tracker.attributes.fusion import AttributeFusion
from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import ParameterError, specifications
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.ring import Ring, RingResult, stage_parameters
from gda_tracker.view.desk import Answer, Parameters, table_of, with_defaults
from gda_tracker.view.history import History
from gda_tracker.view.picture import picture_of
from gda_tracker.vocabulary.tracks import Tracks

LONGEST_WAIT_S = 60.0
FASTEST = 0.0


class Player:
    """A thread that takes scan after scan round the ring and puts their pictures into a history.

    Parameters
    ----------
    play
        What to play, with at least one scan.
    parameters
        ``{node: {name: value}}`` to begin with.
    history
        Where the pictures go.
    rate
        Times the recorded speed; 0: as fast as it goes.
    playing
        Whether it plays at once, or waits for :meth:`play` or :meth:`step`.
    formations
        Follow formations with these parameters.
    """

    def __init__(
        self,
        play: Playback,
        parameters: Parameters,
        history: History,
        rate: float = 1.0,
        playing: bool = True,
        formations: FormationParameters | None = None,
    ) -> None:
        self.name, self.total = play.name, len(play.detections)
        self.history = history
        self.error = ""
        self._play, self._rate, self._playing = play, rate, playing
        self._parameters = with_defaults(parameters)
        self._formation_parameters = formations
        self._steps = 0
        self._closing = False
        # Held while a scan goes round, so that whatever changes does so between two scans.
        self._changed = threading.Condition(threading.RLock())
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)
        self._begin()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and wait for it."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    # --- what those who look may ask for ------------------------------------------------------

    def play(self) -> None:
        """Go on."""
        self._set(playing=True)

    def pause(self) -> None:
        """Stop after the scan that is on its way."""
        self._set(playing=False)

    def step(self) -> None:
        """Take one scan round, then stand."""
        with self._changed:
            self._playing = False
            self._steps += 1
            self._changed.notify_all()
        self.history.touch()

    def set_rate(self, rate: float) -> None:
        """Play at ``rate`` times the recorded speed, 0: as fast as it goes."""
        if not 0.0 <= rate < float("inf"):
            raise ParameterError(f"rate = {rate!r}: allowed is a number >= 0")
        self._set(rate=rate)

    def restart(self) -> None:
        """Begin again at the first scan, with the parameters as they are now."""
        with self._changed:
            self.history.clear()
            self._begin()
            self._changed.notify_all()
        self.history.notice("started again from the first scan, with the parameters as they are")

    def status(self) -> dict[str, Any]:
        """What the page shows of the player."""
        return {
            "mode": "replay",
            "source": self.name,
            "playing": self._playing and not self.finished,
            "finished": self.finished,
            "rate": self._rate,
            "position": self._position,
            "total": self.total,
            "error": self.error,
        }

    @property
    def finished(self) -> bool:
        """Whether all scans have been played."""
        return self._position >= self.total

    # --- parameters ---------------------------------------------------------------------------

    def values(self) -> Parameters:
        """Values that hold from the next scan on, by node and name."""
        with self._changed:
            return {node: dict(values) for node, values in self._parameters.items()}

    def change(self, node: str, values: Mapping[str, Any]) -> Answer:
        """Change parameters of a stage from the next scan on, all or none.

        Refused with the same reasons as by the nodes: an unknown name, a value that is not allowed,
        values that do not go together, a parameter that is fixed at start-up.
        """
        with self._changed:
            try:
                known = specifications(table_of(node))
                merged = {**self._parameters, node: {**self._parameters[node], **values}}
                tables = stage_parameters(merged)
            except ParameterError as error:
                return Answer(False, str(error))
            fixed = [name for name in values if not known[name].live]
            if fixed:
                return Answer(
                    False, f"parameter {fixed[0]} is fixed at start-up: give it with --params"
                )
            self._parameters = merged
            if node == "track_manager":
                self._ring.manager.set_parameters(tables[node])
            elif node == "rcs_fuzzifier":
                self._ring.fuzzifier = RcsFuzzifier(tables[node])
            elif node == "attribute_fusion":
                self._ring.fusion = AttributeFusion(tables[node])
            else:
                self._ring.associate = Associator(tables[node])
            return Answer(True, acts_from_scan=self.history.newest + 1)

    # --- the thread ---------------------------------------------------------------------------

    def _set(self, playing: bool | None = None, rate: float | None = None) -> None:
        with self._changed:
            self._playing = self._playing if playing is None else playing
            self._rate = self._rate if rate is None else rate
            self._changed.notify_all()
        self.history.touch()

    def _begin(self) -> None:
        self._ring = Ring(self._parameters)
        self._position, self._steps = 0, 0
        self._previous: Tracks | None = None
        follow = self._formation_parameters
        self._formations = None if follow is None else FormationTracker(follow)
        self._due = 0.0
        if self._play.initial is not None:
            self._ring.initialise(self._play.initial)

    def _run(self) -> None:
        try:
            while self._wait_for_turn():
                pass
        except Exception as error:  # whatever it is, those who look shall read it
            self.error = f"{type(error).__name__}: {error}"
            self.history.notice(f"the replay has ended with an error: {self.error}")
            raise

    def _wait_for_turn(self) -> bool:
        """Wait until the next scan is due and take it round; return whether to go on."""
        with self._changed:
            while True:
                if self._closing:
                    return False
                wait: float | None = None
                if not self.finished and (self._steps or self._playing):
                    wait = 0.0 if self._steps or self._rate == FASTEST else self._until_due()
                    if wait <= 0.0:
                        break
                self._changed.wait(wait)
            self._steps = max(self._steps - 1, 0)
            self._next_scan()
        return True

    def _until_due(self) -> float:
        """Time until the next scan at the rate [s]."""
        return min(self._due - time.monotonic(), LONGEST_WAIT_S)

    def _next_scan(self) -> None:
        position = self._position
        scans = self._play.detections
        for statement in self._play.said_before(position):
            self._ring.say(statement)
        results = self._ring.feed(scans[position])
        self._position = position + 1
        if self.finished:
            results += self._ring.finish()
        else:
            gap_s = (scans[position + 1].stamp_ns - scans[position].stamp_ns) * 1e-9
            self._due = time.monotonic() + max(gap_s, 0.0) / (self._rate or 1.0)
        for result in results:
            self._show(result)
        if not results:
            self.history.touch()

    def _show(self, result: RingResult) -> None:
        picture = picture_of(result, self._previous)
        report = result.report
        if picture is None:
            self.history.notice(
                f"scan of {report.key.sensor_id} at {report.key.stamp_ns} ns was rejected: "
                f"{report.reason}"
            )
            return
        self._previous = result.tracks
        if self._formations is not None and result.tracks is not None:
            picture.formations = self._formations.take(
                result.tracks, result.scan, result.predictions
            )
        self.history.add(picture)
