"""ASTERIX by UDP for the node ``radar_input``, and for a look at what comes."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

from gda_tracker.errors import UserError
from gda_tracker.io.asterix.decoding import require_library
from gda_tracker.io.asterix.reader import AsterixReader, parse_source
from gda_tracker.io.asterix.udp import UdpSocket
from gda_tracker.io.radar.frames import RadarFrame

# Silence after which an unfinished turn goes out as it is; longer than any turn between two
# messages of a radar that works.
SILENCE_S = 15.0
LOOK_PERIOD_S = 0.02
# What is left out because it is not meant for this, not because it is broken.
NOT_BROKEN = ("other_category", "other_radar", "no_detection", "test_target")


class AsterixListener:
    """A socket and a reader: datagrams in, one frame for each turn of the antenna.

    Parameters
    ----------
    url
        ``udp://HOST:PORT``.
    source
        SAC/SIC of the radar to listen to; empty: the one whose plot comes first.

    Raises
    ------
    UserError
        If the address or source is not allowed, or the library is missing.
    """

    def __init__(self, url: str, source: str = "") -> None:
        wanted = parse_source(source) if source else None
        self._reader = AsterixReader(wanted, first_radar_only=True)
        self._socket = UdpSocket(url)
        try:
            require_library()  # takes seconds, in which datagrams wait at the socket
        except UserError:
            self._socket.close()
            raise
        self._counted: Counter[str] = Counter()
        self._heard_at: float | None = None
        self.datagrams = 0
        self.broken = ""  # what of that left out last was broken

    def frames(self, now_ns: int, steady_s: float) -> Iterator[RadarFrame]:
        """Yield the turns that are complete by now.

        Parameters
        ----------
        now_ns
            Unix time, which says the day.
        steady_s
            Steady time, which says for how long nothing came.
        """
        before = self.datagrams
        for payload in self._socket.waiting():
            self.datagrams += 1
            yield from self._reader.take(payload, now_ns)
        if self.datagrams > before:
            self._heard_at = steady_s
        elif self._heard_at is not None and steady_s - self._heard_at > SILENCE_S:
            self._heard_at = None
            yield from self._reader.flush()

    def left_out(self) -> Counter[str]:
        """Return what was left out since the last call, by reason."""
        new = self._reader.counts - self._counted
        self._counted = self._reader.counts.copy()
        broken = {why: count for why, count in new.items() if why not in NOT_BROKEN}
        self.broken = ", ".join(f"{count} {why}" for why, count in broken.items())
        return new

    def rest(self) -> Iterator[RadarFrame]:
        """Yield the turns that are not complete."""
        yield from self._reader.flush()

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


def listen(url: str, wait_s: float, seconds: float) -> Iterator[RadarFrame]:
    """Return the turns of the first radar that come within some seconds of the first datagram.

    What is there at the end goes as it is.

    Raises
    ------
    UserError
        If nothing comes within ``wait_s``.
    """
    listener = AsterixListener(url)
    found: list[RadarFrame] = []
    try:
        begun, first = time.monotonic(), None
        while first is None or time.monotonic() - first < seconds:
            found += listener.frames(time.time_ns(), time.monotonic())
            if first is None and listener.datagrams:
                first = time.monotonic()
            if first is None and time.monotonic() - begun > wait_s:
                raise UserError(f"{url}: no datagram within {wait_s:g} s")
            time.sleep(LOOK_PERIOD_S)
        found += listener.rest()
    finally:
        listener.close()
    return iter(found)
