"""Services of the nodes: what an operator asks for by hand, done or refused with a reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from std_srvs.srv import Trigger

from gda_tracker.errors import UserError


class Refused(UserError):
    """What a service was asked for cannot be done; the message says why, in one line."""


def offer(node: Any, name: str, act: Callable[[], str]) -> None:
    """Offer the service ``~/name`` (``std_srvs/Trigger``).

    ``act`` does it and says in one line what it has done; a :class:`Refused` becomes the answer
    ``success: false`` with its message. An inactive node refuses.
    """

    def serve(_: Any, response: Any) -> Any:
        try:
            if not node.active:
                raise Refused(f"{node.get_name()} is not active: configure and activate it first")
            response.success, response.message = True, act()
        except Refused as refusal:
            node.counters[f"refused_{name}"] += 1
            response.success, response.message = False, str(refusal)
        log = node.get_logger()
        said = f"{name}: {response.message}"
        log.info(said) if response.success else log.warning(said)
        return response

    node.create_service(Trigger, f"~/{name}", serve)
