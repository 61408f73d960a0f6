"""Datagrams of one or more radars made frames, one a turn of the antenna."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from datetime import date

import numpy as np

from gda_tracker.io.asterix.day_clock import DayClock
from gda_tracker.io.asterix.decoding import QUANTITIES, Source, TargetReport, decode
from gda_tracker.io.asterix.turns import Turn, Turns
from gda_tracker.io.radar.file_kinds import ASTERIX
from gda_tracker.io.radar.frames import RadarFrame, frame_of_columns
from gda_tracker.parameters import ParameterError


def source_name(source: Source) -> str:
    """Name of a radar by its codes of area and identification, as ``25/201``."""
    return f"{source[0]}/{source[1]}"


def sensor_name(source: Source) -> str:
    """Name of a radar in messages, as ``sac25_sic201``."""
    return f"sac{source[0]}_sic{source[1]}"


def parse_source(text: str) -> Source:
    """Return the codes in ``SAC/SIC``.

    Raises
    ------
    ParameterError
        If it is something else.
    """
    area, slash, identification = text.partition("/")
    if slash and area.isdecimal() and identification.isdecimal():
        codes = (int(area), int(identification))
        if max(codes) <= 255:
            return codes
    raise ParameterError(
        f"asterix_source = {text!r}: allowed is SAC/SIC, two numbers up to 255, e.g. 25/201"
    )


def first_day(text: str) -> date | None:
    """Return the day in ``2026-11-22``, ``None`` for an empty text.

    Raises
    ------
    ParameterError
        If it is something else.
    """
    try:
        return date.fromisoformat(text) if text else None
    except (TypeError, ValueError) as error:
        raise ParameterError(
            f"parameter asterix_date = {text!r}: allowed is a date such as 2026-11-22"
        ) from error


class AsterixReader:
    """Takes datagrams, gives frames.

    Parameters
    ----------
    source
        Only this radar's; by default all.
    first_radar_only
        Without ``source``: only that of the radar whose plot comes first.
    first_day
        Of messages whose time of reception is not known.

    Attributes
    ----------
    counts : Counter
        What was left out, by reason; see :func:`~gda_tracker.io.asterix.decoding.decode`, and
        ``other_radar`` (reports), ``late_plot``, ``time_jump``.
    plots : Counter
        Target reports by source, those of other radars too.
    """

    def __init__(
        self,
        source: Source | None = None,
        first_radar_only: bool = False,
        first_day: date | None = None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.plots: Counter[Source] = Counter()
        self._source = source
        self._first_radar_only = first_radar_only
        self._clock = DayClock(first_day)
        self._turns: dict[Source, Turns] = {}

    def take(self, payload: bytes, received_ns: int | None = None) -> Iterator[RadarFrame]:
        """Take a datagram received at this time, if known; yield the frames complete with it."""
        for report in decode(payload, self.counts):
            is_plot = isinstance(report, TargetReport)
            if is_plot:
                self.plots[report.source] += 1
                if self._source is None and self._first_radar_only:
                    self._source = report.source
            stamp_ns = self._clock.stamp_ns(report.time_ns, received_ns)
            if self._source is not None and report.source != self._source:
                self.counts["other_radar"] += 1
                continue
            turns = self._turns.setdefault(report.source, Turns())
            for turn in turns.add(report, stamp_ns, self.counts):
                yield _frame(report.source, turn, turns.period_s)

    def flush(self) -> Iterator[RadarFrame]:
        """Yield what is left of unfinished turns."""
        for source, turns in self._turns.items():
            for turn in turns.flush():
                yield _frame(source, turn, turns.period_s)


def _frame(source: Source, turn: Turn, period_s: float | None) -> RadarFrame:
    stamp_ns = turn.stamp_ns(period_s)
    plots = [plot for _, plot in turn.plots]
    columns = {
        "range": np.array([plot.range_m for plot in plots], dtype=np.float64),
        "azimuth": np.deg2rad([plot.azimuth_deg for plot in plots]),
        "time_offset": 1e-9 * np.array([time - stamp_ns for time, _ in turn.plots], np.float64),
    }
    for name in QUANTITIES:
        columns[name] = np.array([plot.values[name] for plot in plots], dtype=np.float64)
    name = sensor_name(source)
    return frame_of_columns(ASTERIX, stamp_ns, name, columns, name, QUANTITIES)
