"""Nodes that spin in a thread while a test calls a command, and the command itself."""

from __future__ import annotations

import threading
from contextlib import contextmanager

from gda_tracker.cli import main
from gda_tracker.nodes.runner import Nodes


@contextmanager
def spinning(make, domain, arguments=None):
    """Spin nodes in a thread of their own; give them to the test."""
    with Nodes(make, domain, arguments) as nodes, spinning_on(nodes):
        yield nodes


@contextmanager
def spinning_on(nodes):
    """Spin nodes that are there in a thread."""
    done = threading.Event()
    thread = threading.Thread(target=nodes.spin_until, args=(done.is_set,))
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def call(*arguments):
    """Run the command line in this process, also where it ends by itself."""
    try:
        return main([str(a) for a in arguments])
    except SystemExit as end:
        return end.code
