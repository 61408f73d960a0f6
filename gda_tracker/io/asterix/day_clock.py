"""Times of day made times: the day is that of reception, or goes on from the last message.

ASTERIX says seconds since midnight UTC and no date. A time of day is taken on the day on which it
is closest to the reference, at most twelve hours away, so midnight rolls over in both directions: a
late message of before midnight still belongs to the day before.
"""

from __future__ import annotations

from datetime import UTC, date, datetime

DAY_NS = 86_400 * 10**9


class DayClock:
    """Dates of one recording or listener.

    Parameters
    ----------
    first_day
        Day of the first message where no time of reception is known; by default 1970-01-01, so that
        times count from midnight.
    """

    def __init__(self, first_day: date | None = None) -> None:
        start = datetime(1970, 1, 1, tzinfo=UTC)
        if first_day is not None:
            start = datetime(first_day.year, first_day.month, first_day.day, tzinfo=UTC)
        self._first_day_ns = round(start.timestamp()) * 10**9
        self._last_ns: int | None = None

    def stamp_ns(self, time_ns: int, received_ns: int | None = None) -> int:
        """Return Unix time [ns] of a time of day [ns], which is less than a day."""
        reference = self._last_ns if received_ns is None else received_ns
        if reference is None:
            stamp = self._first_day_ns + time_ns
        else:
            # Rounded down, so that exactly half a day away counts as later.
            days = (reference - time_ns + DAY_NS // 2 - 1) // DAY_NS
            stamp = days * DAY_NS + time_ns
        self._last_ns = stamp
        return stamp
