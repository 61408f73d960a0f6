"""A server in a thread of its own."""

from __future__ import annotations

import asyncio
import threading
from contextlib import contextmanager

from gda_tracker.view.server import Server

TIMEOUT_S = 20.0


@contextmanager
def serving(player, **options):
    """Serve a player; yields the address of the page."""
    server = Server(player.history, player, player.status, player=player, **options)
    found, stop, up = [], threading.Event(), threading.Event()

    def ready(address):
        found.append(address)
        up.set()

    def run():
        asyncio.run(server.run(ready, stop.is_set))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert up.wait(TIMEOUT_S)
        yield found[0]
    finally:
        stop.set()
        thread.join(TIMEOUT_S)
        player.close()
    assert not thread.is_alive()
