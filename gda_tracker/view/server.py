"""Serves the page, its data and its commands; docs/view.md explains what they are."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from gda_tracker.parameters import ParameterError, specifications
from gda_tracker.view.conversation import Conversation, Encoder, RequestError
from gda_tracker.view.desk import Answer, Desk, desk_json, parsed, table_of
from gda_tracker.view.fuzzy_sets import fuzzy_sets_json
from gda_tracker.view.guard import LOCAL, guard
from gda_tracker.view.history import History
from gda_tracker.view.player import Player

STATIC = Path(str(files("gda_tracker.view"))) / "static"
LARGEST_REQUEST = 64 * 1024
COMMANDS = ("play", "pause", "step", "restart", "rate")


def plot_library() -> Path:
    """File of the plot library, served from its Python package: no internet is needed.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    try:
        folder = Path(str(files("plotly"))) / "package_data"
    except ModuleNotFoundError as error:
        raise ImportError(
            "the page needs plotly: pip install 'gda_tracker[view]'", name="plotly"
        ) from error
    return folder / "plotly.min.js"


class Server:
    """The page of one history.

    Parameters
    ----------
    history
        What is shown.
    desk
        The parameters.
    status
        What is played, as :meth:`Player.status`.
    player
        What the commands act on; ``None`` for a ring that runs elsewhere.
    host
        Address to bind to.
    port
        Port, 0: any that is free.
    allow_changes
        Whether those who look may change parameters and steer the replay.
    """

    def __init__(
        self,
        history: History,
        desk: Desk,
        status: Callable[[], dict[str, Any]],
        *,
        player: Player | None = None,
        host: str = "127.0.0.1",
        port: int = 0,
        allow_changes: bool = True,
    ) -> None:
        self.history, self.host, self.port = history, host, port
        self._desk, self._status, self._player = desk, status, player
        self._allow_changes = allow_changes
        self._encoder = Encoder(history, self._full_status)
        self._conversations: set[Conversation] = set()
        self._sockets: set[web.WebSocketResponse] = set()
        self._library = plot_library()

    # --- life -----------------------------------------------------------------------------------

    async def run(self, ready: Callable[[str], None], until: Callable[[], bool]) -> None:
        """Serve until ``until``; ``ready`` is told the address of the page."""
        loop = asyncio.get_running_loop()

        def changed() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended before the player
                loop.call_soon_threadsafe(self._changed)

        self.history.listen(changed)
        runner = web.AppRunner(self._application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            site = web.TCPSite(runner, self.host, self.port)
            await site.start()
            self.port = runner.addresses[0][1]
            name = f"[{self.host}]" if ":" in self.host else self.host
            ready(f"http://{name}:{self.port}/")
            while not until():
                await asyncio.sleep(0.1)
        finally:
            for socket in list(self._sockets):
                await socket.close()
            await runner.cleanup()

    def _application(self) -> web.Application:
        application = web.Application(
            middlewares=[guard(self.host in LOCAL)], client_max_size=LARGEST_REQUEST
        )
        application.add_routes(
            [
                web.get("/", self._page),
                web.get("/live", self._live),
                web.get("/api/parameters", self._parameters),
                web.post("/api/parameters", self._change),
                web.get("/api/fuzzy_sets", self._sets),
                web.post("/api/control", self._control),
                web.get("/library/plotly.min.js", self._plotly),
                web.static("/static", STATIC),
            ]
        )
        return application

    def _changed(self) -> None:
        for conversation in self._conversations:
            conversation.changed()

    def _full_status(self) -> dict[str, Any]:
        return {
            **self._status(),
            "allow_changes": self._allow_changes,
            "browsers": len(self._conversations),
        }

    # --- what is asked for ----------------------------------------------------------------------

    async def _page(self, _: web.Request) -> web.StreamResponse:
        return web.FileResponse(STATIC / "index.html")

    async def _plotly(self, _: web.Request) -> web.StreamResponse:
        return web.FileResponse(self._library)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(heartbeat=20.0, max_msg_size=LARGEST_REQUEST)
        await socket.prepare(request)
        conversation = Conversation(self._encoder, self.history, socket.send_str)
        self._conversations.add(conversation)
        self._sockets.add(socket)
        answering = asyncio.ensure_future(conversation.run())
        answering.add_done_callback(_report)
        try:
            async for message in socket:
                if message.type == WSMsgType.TEXT:
                    conversation.ask(message.data)
        except RequestError as error:
            await socket.close(code=1008, message=str(error).encode()[:120])
        finally:
            self._conversations.discard(conversation)
            self._sockets.discard(socket)
            answering.cancel()
        return socket

    async def _parameters(self, _: web.Request) -> web.StreamResponse:
        values = await asyncio.to_thread(self._desk.values)
        return web.json_response(
            {"allow_changes": self._allow_changes, "parameters": desk_json(values)}
        )

    async def _sets(self, _: web.Request) -> web.StreamResponse:
        """The fuzzy sets, ``null`` as long as the fuzzifier does not answer."""
        values = await asyncio.to_thread(self._desk.values)
        if "rcs_fuzzifier" not in values:
            return web.json_response(None)
        return web.json_response(await asyncio.to_thread(fuzzy_sets_json, values["rcs_fuzzifier"]))

    async def _change(self, request: web.Request) -> web.StreamResponse:
        """Change one parameter or several of a node: ``{"node": ..., "values": {name: text}}``."""
        self._need_permission()
        asked = await _object(request)
        node, values = asked.get("node"), asked.get("values")
        if not isinstance(node, str) or not isinstance(values, dict) or not values:
            raise web.HTTPBadRequest(text="allowed is {node: text, values: {name: value}}")
        answer = await self._answer(node, values)
        words = ", ".join(f"{name} = {value}" for name, value in values.items())
        said = "accepted" if answer.accepted else f"refused: {answer.reason}"
        self.history.notice(f"{node}: {words}: {said}")
        return web.json_response(
            {
                "accepted": answer.accepted,
                "reason": answer.reason,
                "acts_from_scan": answer.acts_from_scan,
            }
        )

    async def _answer(self, node: str, values: dict[str, Any]) -> Answer:
        try:
            known = specifications(table_of(node))
            unknown = [name for name in values if name not in known]
            if unknown:
                return Answer(False, f"parameter {unknown[0]}: unknown")
            read = {name: parsed(known[name], value) for name, value in values.items()}
        except ParameterError as error:
            return Answer(False, str(error))
        return await asyncio.to_thread(self._desk.change, node, read)

    async def _control(self, request: web.Request) -> web.StreamResponse:
        """Steer the replay: ``{"command": "play"}``, ``{"command": "rate", "value": 2}``."""
        self._need_permission()
        asked = await _object(request)
        command, player = asked.get("command"), self._player
        if command not in COMMANDS:
            raise web.HTTPBadRequest(text=f"command: allowed are {', '.join(COMMANDS)}")
        if player is None:
            raise web.HTTPConflict(text="the ring runs elsewhere and is not steered from here")
        try:
            if command == "rate":
                await asyncio.to_thread(player.set_rate, float(asked.get("value", "nan")))
            else:
                await asyncio.to_thread(getattr(player, command))
        except (ParameterError, TypeError, ValueError) as error:
            raise web.HTTPBadRequest(text=str(error)) from error
        return web.json_response({"done": command})

    def _need_permission(self) -> None:
        if not self._allow_changes:
            raise web.HTTPForbidden(
                text="read only: gda-tracker view was started with --host and without "
                "--allow-changes"
            )


async def _object(request: web.Request) -> dict[str, Any]:
    """Return the JSON object that was sent.

    Only as ``application/json``, which a form of another site cannot send.
    """
    if request.content_type != "application/json":
        raise web.HTTPUnsupportedMediaType(text="allowed is application/json")
    try:
        found = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise web.HTTPBadRequest(text=f"no JSON: {error}") from error
    if not isinstance(found, dict):
        raise web.HTTPBadRequest(text="allowed is a JSON object")
    return found


def _report(task: asyncio.Future[None]) -> None:
    """Say when answering has failed for another reason than that the browser has gone."""
    if task.cancelled():
        return
    error = task.exception()
    if error is not None and not isinstance(error, ConnectionError):
        print(f"gda-tracker view: {type(error).__name__}: {error}", file=sys.stderr)
