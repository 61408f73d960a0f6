"""One browser: it asks for what it wants to see next, and is told when there is something new.

The browser asks again when it has drawn. So a slow one sees fewer scans, never late ones, and
nobody waits for it. A request is

    {"want": number of a scan or null for the newest, "have": number of the scan it shows,
     "track": id of the selected track or null, "past": scans before it that are still seen,
     "fresh": whether something was asked for by hand}
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

from gda_tracker.view.encoding import past_json, scan_json
from gda_tracker.view.history import History
from gda_tracker.view.matrix import matrix_json
from gda_tracker.view.series import track_json

MOST_PAST = 100
# Between two answers to one browser, but for what was asked for by hand.
SHORTEST_PERIOD_S = 0.03
KEPT = 4  # scans as text, for several browsers that look at the same one


class Encoder:
    """Answers to requests; the text of the last few scans is made once for all browsers."""

    def __init__(self, history: History, status: Callable[[], dict[str, Any]]) -> None:
        self._history, self._status = history, status
        self._texts: dict[tuple[int, int], str] = {}

    def answer(self, request: dict[str, Any]) -> str:
        """Return the answer to a request as JSON text."""
        history = self._history
        status = {
            **self._status(),
            "generation": history.generation,
            "first": history.first,
            "newest": history.newest,
            "notices": [[n.number, n.scan, n.text] for n in history.notices()],
        }
        parts = {"status": json.dumps(status)}
        want = request["want"]
        found = history.between(*[history.newest if want is None else want] * 2)
        if found and (request["fresh"] or want is None):
            at, picture = found[0]
            parts["scan"] = self._scan(at)
            first = at - request["past"]
            if request["have"] is not None and request["have"] < at:
                first = max(first, request["have"] + 1)
            parts["past"] = json.dumps(
                [past_json(n, p) for n, p in history.between(max(first, 1), at - 1)]
            )
            parts["matrix"] = json.dumps(matrix_json(picture, request["track"]))
            if request["track"] is not None:
                parts["track"] = json.dumps(track_json(history, request["track"], at))
        return "{" + ",".join(f'"{name}":{text}' for name, text in parts.items()) + "}"

    def _scan(self, at: int) -> str:
        # The stamp too: after a new start the same numbers are of other scans.
        picture = self._history.between(at, at)[0][1]
        key = (at, id(picture))
        if key not in self._texts:
            while len(self._texts) >= KEPT:
                self._texts.pop(next(iter(self._texts)))
            self._texts[key] = json.dumps(scan_json(self._history, at, picture), allow_nan=False)
        return self._texts[key]


class RequestError(ValueError):
    """A request is not well formed; the message says what is allowed."""


def read_request(text: str) -> dict[str, Any]:
    """Return a request with everything in it, checked.

    Raises
    ------
    RequestError
        If it is not well formed.
    """
    try:
        found = json.loads(text)
    except ValueError as error:
        raise RequestError(f"no JSON: {error}") from None
    if not isinstance(found, dict):
        raise RequestError("allowed is an object")
    request: dict[str, Any] = {"fresh": bool(found.get("fresh", False))}
    for name in ("want", "have", "track"):
        value = found.get(name)
        if value is not None and (not isinstance(value, int) or isinstance(value, bool)):
            raise RequestError(f"{name} = {value!r}: allowed is an integer or null")
        request[name] = value
    past = found.get("past", 0)
    if not isinstance(past, int) or not 0 <= past <= MOST_PAST:
        raise RequestError(f"past = {past!r}: allowed is an integer >= 0 and <= {MOST_PAST}")
    return {**request, "past": past}


class Conversation:
    """Answers the newest request of one browser as soon as there is something to say.

    Parameters
    ----------
    encoder
        Makes the answers.
    history
        What is looked at; ``changed`` must be called, in this thread, after it has changed.
    send
        Sends one text and returns when the browser's connection has taken it.
    """

    def __init__(self, encoder: Encoder, history: History, send: Callable[[str], Any]) -> None:
        self._encoder, self._history, self._send = encoder, history, send
        self._request: dict[str, Any] | None = None
        self._told = -1
        self._wake = asyncio.Event()

    def ask(self, text: str) -> None:
        """Take a request; an older one that was not answered yet is dropped."""
        request = read_request(text)
        if self._request is not None and self._request["fresh"]:
            request["fresh"] = True
        self._request = request
        self._wake.set()

    def changed(self) -> None:
        """Hear that the history has changed."""
        self._wake.set()

    async def run(self) -> None:
        """Answer until cancelled."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            request, version = self._request, self._history.version
            if request is None or (not request["fresh"] and version == self._told):
                continue
            self._request, self._told = None, version
            await self._send(self._encoder.answer(request))
            await asyncio.sleep(SHORTEST_PERIOD_S)
