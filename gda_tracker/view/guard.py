"""Who may use the page: no other web site that happens to be open in the same browser.

A page of somebody else's can make a browser send requests to this machine, and by a name that it
lets point here (DNS rebinding) also read the answers. Such requests give themselves away by the
host they name, or by the origin they state.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

LOCAL = ("127.0.0.1", "localhost", "::1")

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
        "frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def guard(local_only: bool) -> Middleware:
    """Return the middleware; ``local_only``: the server is not open to other machines."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        host = urlsplit(f"//{request.host}").hostname
        if local_only and host not in LOCAL:
            raise web.HTTPForbidden(text=f"host {host}: allowed are {', '.join(LOCAL)}")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text=f"origin {origin}: allowed is the page's own")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    return check
