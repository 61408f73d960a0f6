"""The scans of the last while, shared by who makes pictures and who shows them."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from gda_tracker.view.picture import Picture

DEFAULT_SCANS = 1000
MOST_BYTES = 256 * 2**20
NOTICES = 50


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened beside the scans: a parameter changed, a scan rejected."""

    number: int
    scan: int
    text: str


class History:
    """The newest pictures, numbered from 1; the oldest go when they are too many or too large.

    Safe to use from several threads: one that plays or listens, one that serves. Whoever adds never
    waits for whoever looks.

    Parameters
    ----------
    scans
        How many pictures are kept at most, >= 1.
    most_bytes
        How large they may be together; the newest is always kept.

    Attributes
    ----------
    generation
        Rises with every :meth:`clear`: numbers of an earlier one are of other pictures.
    """

    def __init__(self, scans: int = DEFAULT_SCANS, most_bytes: int = MOST_BYTES) -> None:
        self._lock = threading.Lock()
        self._pictures: deque[tuple[Picture, int]] = deque()
        self._scans, self._most_bytes, self._bytes = scans, most_bytes, 0
        self._newest = 0
        self._version = 0
        self.generation = 1
        self._began_ns: int | None = None
        self._notices: deque[Notice] = deque(maxlen=NOTICES)
        self._noticed = 0
        self._listeners: list[Callable[[], None]] = []

    @property
    def newest(self) -> int:
        """Number of the newest picture, 0 before the first."""
        return self._newest

    @property
    def first(self) -> int:
        """Number of the oldest picture that is kept, 0 before the first."""
        with self._lock:
            return self._newest - len(self._pictures) + 1 if self._pictures else 0

    @property
    def version(self) -> int:
        """A number that rises whenever something has changed."""
        return self._version

    def add(self, picture: Picture) -> int:
        """Keep a picture as the newest; return its number."""
        size = picture.size_bytes
        with self._lock:
            self._pictures.append((picture, size))
            self._bytes += size
            self._newest += 1
            if self._began_ns is None:
                self._began_ns = picture.stamp_ns
            while len(self._pictures) > 1 and (
                len(self._pictures) > self._scans or self._bytes > self._most_bytes
            ):
                self._bytes -= self._pictures.popleft()[1]
            number = self._newest
        self.touch()
        return number

    def clear(self) -> None:
        """Forget all pictures: what is played begins anew."""
        with self._lock:
            self._pictures.clear()
            self._bytes, self._newest, self._began_ns = 0, 0, None
            self.generation += 1
        self.touch()

    def notice(self, text: str) -> None:
        """Tell those who look something."""
        with self._lock:
            self._noticed += 1
            self._notices.append(Notice(self._noticed, self._newest, text))
        self.touch()

    def notices(self) -> list[Notice]:
        """The last notices, the newest last."""
        with self._lock:
            return list(self._notices)

    def between(self, first: int, last: int) -> list[tuple[int, Picture]]:
        """Pictures numbered ``first`` to ``last``, as far as they are kept, with their numbers."""
        with self._lock:
            oldest = self._newest - len(self._pictures) + 1
            first, last = max(first, oldest), min(last, self._newest)
            found = itertools.islice(self._pictures, first - oldest, max(last - oldest + 1, 0))
            return [(first + i, picture) for i, (picture, _) in enumerate(found)]

    def seconds(self, picture: Picture) -> float:
        """Time of a picture since the first one [s]."""
        began = self._began_ns
        return 0.0 if began is None else (picture.stamp_ns - began) * 1e-9

    def listen(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` after every change, from the thread that made it; it must not block."""
        self._listeners.append(listener)

    def touch(self) -> None:
        """Say that something has changed."""
        with self._lock:
            self._version += 1
        for listener in self._listeners:
            listener()
