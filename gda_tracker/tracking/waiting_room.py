"""The waiting room: admitted scans in time order, and what counts as late or as a jump of time."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from dataclasses import dataclass, field, replace

from gda_tracker.tracking.door import Rejected
from gda_tracker.vocabulary.scans import Scan, ScanKey

# A sensor that stepped back and whose scans are late so often, in order, has another time axis.
LATE_IN_A_ROW = 3


@dataclass(slots=True, order=True)
class Waiting:
    """A scan that waits: ``admitted_at`` [s], detections received, and those left out by reason."""

    generation: int
    stamp_ns: int
    arrival: int
    scan: Scan = field(compare=False)
    admitted_at: float = field(compare=False)
    received: int = field(compare=False)
    counts: Counter[str] = field(compare=False)


@dataclass(frozen=True)
class ReorderWindow:
    """How long a scan waits for earlier ones that may still be on their way.

    A scan is ripe when a scan ``window_ns`` newer has come, or one at least as new from each of
    ``sensors``, if any are named. It is all measurement time, so the order in which scans are
    opened does not depend on how they travelled, as long as they are late by less than the window.
    """

    window_ns: int = 0
    sensors: tuple[str, ...] = ()
    capacity: int = 100


class WaitingRoom:
    """A bounded queue of admitted scans in time order.

    A stamp that lies more than ``time_jump_s`` before the newest admitted one starts a new
    generation: the time axis was reset (a bag loops), and so will be the tracks. Less than that is
    ``late`` if a later scan was opened already. A sensor that steps back and goes on from there in
    order is not late: its third such scan starts a new generation too, so that short bags may loop.
    """

    def __init__(self) -> None:
        self._queue: list[Waiting] = []
        self._arrivals = itertools.count()
        self.generation = 0
        self.newest_ns: int | None = None
        # Stamp of the scan opened last, and the sensors whose scans of that stamp were opened.
        self._opened_ns: int | None = None
        self._opened_sensors: tuple[str, ...] = ()
        # Newest stamp by sensor, and the stamp up to which scans have waited long enough.
        self._newest_of: dict[str, int] = {}
        self._released: tuple[int, int] | None = None
        # Stamp that came last by sensor, and how many of its late scans came in order since it
        # stepped back.
        self._arrived_of: dict[str, int] = {}
        self._late_in_a_row: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._queue)

    def content(self) -> list[Waiting]:
        """Return what waits, in time order."""
        return sorted(self._queue)

    def begin(self, stamp_ns: int, sensors: tuple[str, ...]) -> None:
        """Start the time axis as if the scans of ``sensors`` at ``stamp_ns`` had been opened."""
        self.newest_ns = self._opened_ns = stamp_ns
        self._opened_sensors = sensors

    def move_in(self, other: WaitingRoom) -> int:
        """Take over from ``other`` what is not late here; return how many scans stay behind."""
        before = len(self)
        for waiting in sorted(other._queue):
            if waiting.generation == other.generation and not self._late(waiting.scan.key):
                arrival = next(self._arrivals)
                self._push(replace(waiting, generation=self.generation, arrival=arrival))
        return len(other) - (len(self) - before)

    def ripe(self, order: ReorderWindow) -> bool:
        """Whether the earliest scan may be opened."""
        if not self._queue:
            return False
        head = self._queue[0]
        if order.window_ns == 0 or len(self._queue) >= order.capacity:
            return True
        if head.generation != self.generation:
            return True  # nothing of the former time axis comes any more
        if self._released is not None and (head.generation, head.stamp_ns) <= self._released:
            return True
        assert self.newest_ns is not None
        if self.newest_ns - head.stamp_ns >= order.window_ns:
            return True
        newest = self._newest_of
        return bool(order.sensors) and all(
            sensor in newest and newest[sensor] >= head.stamp_ns for sensor in order.sensors
        )

    def release(self, admitted_until: float = math.inf) -> bool:
        """Make ripe what was admitted until then, with all that is earlier; say whether any is."""
        found = [(w.generation, w.stamp_ns) for w in self._queue if w.admitted_at <= admitted_until]
        self._released = max(found, default=None)
        return bool(found)

    def holds(self, sensor_id: str, stamp_ns: int) -> bool:
        """Whether a scan of this sensor and stamp waits already."""
        return any(
            w.stamp_ns == stamp_ns and w.scan.key.sensor_id == sensor_id for w in self._queue
        )

    def check_time(self, key: ScanKey, time_jump_s: float) -> int:
        """Return the generation that the scan belongs to; raise ``Rejected('late')``."""
        before = self._arrived_of.get(key.sensor_id)
        self._arrived_of[key.sensor_id] = key.stamp_ns
        if self.newest_ns is not None and key.stamp_ns < self.newest_ns - round(time_jump_s * 1e9):
            return self.generation + 1
        if not self._late(key):
            self._late_in_a_row.pop(key.sensor_id, None)
            return self.generation
        run = self._late_in_a_row.get(key.sensor_id, 0)
        if before is not None and key.stamp_ns < before:
            run = 1
        elif run and key.stamp_ns != before:
            run += 1
        if run >= LATE_IN_A_ROW:
            return self.generation + 1
        self._late_in_a_row[key.sensor_id] = run
        raise Rejected("late")

    def _late(self, key: ScanKey) -> bool:
        """Whether a later scan was opened, or the sensor's own one of that stamp."""
        if self._opened_ns is None:
            return False
        if key.stamp_ns == self._opened_ns:
            return key.sensor_id in self._opened_sensors
        return key.stamp_ns < self._opened_ns

    def put(
        self, scan: Scan, generation: int, admitted_at: float, received: int, counts: Counter[str]
    ) -> None:
        """Add a scan; its generation comes from :meth:`check_time`."""
        if generation != self.generation:
            self.generation, self.newest_ns = generation, None
            self._opened_ns, self._opened_sensors = None, ()
            self._newest_of, self._late_in_a_row = {}, {}
        arrival = next(self._arrivals)
        self._push(
            Waiting(generation, scan.key.stamp_ns, arrival, scan, admitted_at, received, counts)
        )

    def _push(self, waiting: Waiting) -> None:
        stamp_ns = waiting.stamp_ns
        self.newest_ns = stamp_ns if self.newest_ns is None else max(self.newest_ns, stamp_ns)
        sensor_id = waiting.scan.key.sensor_id
        self._newest_of[sensor_id] = max(self._newest_of.get(sensor_id, stamp_ns), stamp_ns)
        heapq.heappush(self._queue, waiting)

    def take(self) -> Waiting:
        """Take the earliest scan out."""
        waiting = heapq.heappop(self._queue)
        if waiting.generation == self.generation:
            same_time = waiting.stamp_ns == self._opened_ns
            others = self._opened_sensors if same_time else ()
            self._opened_ns = waiting.stamp_ns
            self._opened_sensors = (*others, waiting.scan.key.sensor_id)
        return waiting
