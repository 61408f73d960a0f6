"""What processes that share work need: cores, one thread each, Ctrl-C where it can be handled."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from gda_tracker.threads import THREAD_VARIABLES

# The ring makes many small objects, and no cycles worth looking for after every 700 of them.
GARBAGE_THRESHOLD = 100_000


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def garbage_left() -> Iterator[None]:
    """Look for garbage rarely."""
    before = gc.get_threshold()
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def interrupt_held() -> Iterator[None]:
    """Hold Ctrl-C back for a moment; a process that starts meanwhile leaves it to its parent.

    Submitting a task starts the workers. They inherit the blocked signal before their first line of
    Python, so that none of them dies of an interruption that is the parent's to handle.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start_worker() -> None:
    """Do not outlive the parent, however it ends; look for garbage rarely."""
    gc.freeze()
    gc.set_threshold(GARBAGE_THRESHOLD)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def one_thread_per_worker() -> Iterator[None]:
    """Let child processes use one thread each in linear algebra: runs take the cores."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
