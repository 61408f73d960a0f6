"""Ctrl-C where it can be handled, and SIGTERM like it.

SIGTERM is what ``docker stop``, systemd and ``timeout`` send. Nodes in a context of their own have
no handlers of rclpy, so that without this it would end the process on the spot: a bag would lack
its index and its metadata.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# What shells report: 128 and the number of the signal.
INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM

# The lists of those who note interruptions at present, the innermost last.
_noting: list[list[bool]] = []


@contextmanager
def interrupt_noted() -> Iterator[list[bool]]:
    """Note Ctrl-C in the list instead of raising at once, for places where it can be handled.

    Raised anywhere, it may leave half a message in a bag, or a lock of the futures taken, and the
    pool waits for it for ever. Where the process ignores Ctrl-C it still does.
    """
    noted: list[bool] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted  # signals are the main thread's
        return
    before = signal.getsignal(signal.SIGINT)
    # None: a handler of another language, such as that of rclpy, which knows what to do.
    ours = before is not None and before is not signal.SIG_IGN
    if ours:
        signal.signal(signal.SIGINT, lambda *_: noted.append(True))
    _noting.append(noted)
    try:
        yield noted
    finally:
        _noting.pop()
        if ours:
            signal.signal(signal.SIGINT, before)


@contextmanager
def terminated_as_interrupted() -> Iterator[list[bool]]:
    """Hand SIGTERM on as Ctrl-C; yield a list that has an entry once it came.

    So it does what Ctrl-C does, also where that is noted, held back or handled otherwise. Only the
    first one counts: ``timeout`` sends two, and the second shall not cut off what the first began.
    """
    came: list[bool] = []
    if threading.current_thread() is not threading.main_thread():
        yield came  # signals are the main thread's
        return

    def hand_on(*_: object) -> None:
        if came:
            return
        came.append(True)
        if callable(signal.getsignal(signal.SIGINT)):
            signal.raise_signal(signal.SIGINT)
        elif _noting:
            # A shell without job control lets its background processes ignore Ctrl-C.
            _noting[-1].append(True)
        else:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, hand_on)
    try:
        yield came
    finally:
        signal.signal(signal.SIGTERM, before)
