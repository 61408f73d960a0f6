"""SIGTERM ends a command as Ctrl-C does, once, wherever Ctrl-C is handled."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager

import pytest

from gda_tracker.cli import main
from gda_tracker.commands import fuse
from gda_tracker.termination import interrupt_noted, terminated_as_interrupted


@contextmanager
def interrupts(handler):
    """Treat Ctrl-C like this meanwhile."""
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def terminate():
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_the_first_one_interrupts_and_the_second_is_ignored(handler):
    before = signal.getsignal(signal.SIGTERM)
    with interrupts(handler), terminated_as_interrupted() as came:
        with pytest.raises(KeyboardInterrupt):
            terminate()
        terminate()
        assert came == [True]
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_where_interruptions_are_noted_it_is(handler):
    with interrupts(handler), terminated_as_interrupted():
        with interrupt_noted() as outer, interrupt_noted() as inner:
            terminate()
        assert (outer, inner) == ([], [True])
        assert signal.getsignal(signal.SIGINT) is handler


def test_where_interruptions_are_ignored_they_still_are():
    with interrupts(signal.SIG_IGN), interrupt_noted() as noted:
        os.kill(os.getpid(), signal.SIGINT)
    assert noted == []


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["ctrl-c", "sigterm"]
)
def test_status_of_a_command(number, status, monkeypatch, capsys):
    with interrupts(signal.default_int_handler):
        monkeypatch.setattr(fuse, "run", lambda _: os.kill(os.getpid(), number))
        assert main(["fuse", "--example"]) == status
    assert capsys.readouterr().err == "gda-tracker fuse: stopped\n"
