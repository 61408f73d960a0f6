"""Turns of an antenna: which plots make one scan.

The azimuths that come in, of plots, of sectors' edges and of North, are unwound into an angle that
grows without end; turn n is what lies between n and n + 1 times 360 degrees. So plots that come a
little before or after the north marker belong to the right turn, and a lost marker changes nothing.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

from gda_tracker.io.asterix.decoding import (
    NORTH_MARKER,
    SECTOR_CROSSING,
    Report,
    ServiceMessage,
    TargetReport,
)

# A turn is complete when the antenna is so far into the next one: plots come late.
COMPLETE_AFTER_DEG = 45.0
# Without a known period: a plot may be so late, less with every second since the last one. After
# four seconds the antenna has moved on for certain (15 turns a minute, the slowest in use 5).
LATEST_DEG, LATER_DEG_PER_S, MOVED_ON_DEG = -90.0, 23.0, 20.0
# Periods that a radar may have.
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 0.5, 60.0
# So many periods of silence, or a step back by so many, start anew; without a known period so long.
SILENT_PERIODS, SILENT_S = 1.5, 30.0
PERIODS_KEPT = 5


@dataclass(slots=True)
class Turn:
    """One turn: target reports with their times, and when it began and ended, where known [ns]."""

    plots: list[tuple[int, TargetReport]] = field(default_factory=list)
    begin_ns: int | None = None
    end_ns: int | None = None

    def stamp_ns(self, period_s: float | None) -> int:
        """Time of the middle of the turn, by North where known, else between its plots."""
        half = None if period_s is None else round(0.5e9 * period_s)
        if self.begin_ns is not None and self.end_ns is not None:
            return (self.begin_ns + self.end_ns) // 2
        if self.begin_ns is not None and half is not None:
            return self.begin_ns + half
        if self.end_ns is not None and half is not None:
            return self.end_ns - half
        times = [stamp for stamp, _ in self.plots]
        return (min(times) + max(times)) // 2


class Turns:
    """Sorts the reports of one radar into turns."""

    def __init__(self) -> None:
        self.period_s: float | None = None
        self.told_period = False
        self._serves = False
        self._intervals: deque[float] = deque(maxlen=PERIODS_KEPT)
        self._restart()

    def _restart(self) -> None:
        self._open: dict[int, Turn] = {}
        self._released: int | None = None
        self._angle: float | None = None  # unwound azimuth of the antenna, at the time below
        self._angle_ns = 0
        self._latest_ns: int | None = None
        self._north_ns: int | None = None

    def add(self, report: Report, stamp_ns: int, counts: Counter[str]) -> Iterator[Turn]:
        """Take a report of this time; yield the turns that are complete with it.

        A plot of a turn that was complete already is counted as ``late_plot`` and left out. After a
        silence, or a step back in time (``time_jump``), what was begun goes out and all begins
        anew.
        """
        latest = self._latest_ns
        silent_s = SILENT_S if self.period_s is None else SILENT_PERIODS * self.period_s
        if latest is not None and abs(stamp_ns - latest) > silent_s * 1e9:
            counts["time_jump"] += 1
            yield from self.flush()
        self._latest_ns = stamp_ns if self._latest_ns is None else max(stamp_ns, self._latest_ns)
        if isinstance(report, TargetReport):
            turn = math.floor(self._unwound(report.azimuth_deg, stamp_ns) / 360.0)
            if self._released is not None and turn <= self._released:
                counts["late_plot"] += 1
                return
            self._turn(turn).plots.append((stamp_ns, report))
        else:
            self._service(report, stamp_ns)
        yield from self._complete()

    def flush(self) -> Iterator[Turn]:
        """Yield what is there, complete or not, and begin anew."""
        found = [self._open[turn] for turn in sorted(self._open) if self._open[turn].plots]
        self._restart()
        yield from found

    def _turn(self, turn: int) -> Turn:
        return self._open.setdefault(turn, Turn())

    def _service(self, report: ServiceMessage, stamp_ns: int) -> None:
        self._serves = True
        period = report.rotation_period_s
        if period is not None and SHORTEST_PERIOD_S <= period <= LONGEST_PERIOD_S:
            self.period_s, self.told_period = period, True
        if report.kind == SECTOR_CROSSING and report.azimuth_deg is not None:
            self._unwound(report.azimuth_deg, stamp_ns)
        if report.kind != NORTH_MARKER:
            return
        self._measure_period(stamp_ns)
        turn = round(self._unwound(0.0, stamp_ns) / 360.0)
        for number, is_end in ((turn, False), (turn - 1, True)):
            if self._released is None or number > self._released:
                if is_end and number not in self._open and self._released is None:
                    continue  # before the recording began
                one = self._turn(number)
                if is_end:
                    one.end_ns = stamp_ns
                else:
                    one.begin_ns = stamp_ns

    def _measure_period(self, north_ns: int) -> None:
        """Take the median of the last intervals between north markers, unless the radar says it."""
        before, self._north_ns = self._north_ns, north_ns
        if before is None or self.told_period:
            return
        interval = 1e-9 * (north_ns - before)
        if SHORTEST_PERIOD_S <= interval <= LONGEST_PERIOD_S:
            self._intervals.append(interval)
            self.period_s = median(self._intervals)

    def _unwound(self, azimuth_deg: float, stamp_ns: int) -> float:
        """Return an azimuth [deg] with the turns before it, and move the antenna on."""
        if self._angle is None:
            self._angle, self._angle_ns = azimuth_deg, stamp_ns
            return azimuth_deg
        elapsed_s = 1e-9 * (stamp_ns - self._angle_ns)
        if self.period_s is not None:
            expected = self._angle + 360.0 * elapsed_s / self.period_s
            angle = azimuth_deg + 360.0 * round((expected - azimuth_deg) / 360.0)
        else:
            least = min(LATEST_DEG + LATER_DEG_PER_S * max(elapsed_s, 0.0), MOVED_ON_DEG)
            angle = self._angle + (azimuth_deg - self._angle - least) % 360.0 + least
        if angle > self._angle:
            self._angle, self._angle_ns = angle, stamp_ns
        return angle

    def _complete(self) -> Iterator[Turn]:
        if self._angle is None or not self._open:
            return
        until = math.floor((self._angle - COMPLETE_AFTER_DEG) / 360.0)  # turns before this one
        begin = min(self._open) if self._released is None else self._released + 1
        for turn in range(begin, until):
            one = self._open.pop(turn, Turn())
            self._released = turn
            # A turn without plots is a scan too, if the radar says that it turned.
            if one.plots or (self._serves and one.begin_ns is not None):
                yield one
