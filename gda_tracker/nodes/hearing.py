"""Inputs that have heard nothing although somebody publishes: their subscriptions are made anew.

When a node is killed and comes back, Fast DDS 2.14 now and then counts it as matched and sends it
nothing, for ever: seen about once in a hundred kills, with the publisher of another process that
had lived on. A new subscription makes the publisher look at its readers again. Only inputs that
have heard nothing at all since they were opened are touched, and only those whose messages come
again until they are answered: in the tests recorders with two subscriptions, the former and the new
one, at times heard nothing of a topic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

FIRST_WAIT_S = 3.0
# With doubled waits the last trial is a minute and a half after the publisher was seen. A topic
# that is merely silent, as that of statements, is left alone from then on.
MOST_RENEWALS = 5


class Hearing:
    """One input of a node.

    Parameters
    ----------
    create
        Makes a subscription with the callback that it is given.
    destroy
        Destroys one.
    callback
        What is called with each message.
    publishers
        Identities of those who publish on the topic now.
    """

    def __init__(
        self,
        create: Callable[[Callable[[Any], None]], Any],
        destroy: Callable[[Any], Any],
        callback: Callable[[Any], None],
        publishers: Callable[[], frozenset[bytes]],
    ) -> None:
        self._create, self._destroy, self._callback = create, destroy, callback
        self._list_publishers = publishers
        self._publishers: frozenset[bytes] = frozenset()
        self._wait_s, self._trials, self._due_at = FIRST_WAIT_S, 0, 0.0
        self._trying: list[Any] = []  # subscriptions that have heard nothing yet, the oldest first
        self._hearing: Any = None  # the one that has
        self._subscribe()

    def _subscribe(self) -> None:
        made: list[Any] = []

        def receive(message: Any) -> None:
            if self._hearing is None:
                self._hearing = made[0]
            # What the others hear as well, until they are destroyed, is the same.
            if self._hearing is made[0]:
                self._callback(message)

        made.append(self._create(receive))
        self._trying.append(made[0])

    def check(self, now: float) -> bool:
        """Subscribe anew if it is time [s]; return whether it was.

        The former subscription stays until one of the two hears something, and that one is kept.
        """
        if self._hearing is not None:
            for item in self._trying:
                if item is not self._hearing:
                    self._destroy(item)
            self._trying.clear()
            return False
        publishers = self._list_publishers()
        if publishers != self._publishers:
            self._publishers = publishers
            self._wait_s, self._trials, self._due_at = FIRST_WAIT_S, 0, now + FIRST_WAIT_S
        if not publishers or self._trials == MOST_RENEWALS or now < self._due_at:
            return False
        self._trials += 1
        self._wait_s *= 2.0
        self._due_at = now + self._wait_s
        if len(self._trying) > 1:
            self._destroy(self._trying.pop(0))
        self._subscribe()
        return True

    def close(self) -> None:
        """Destroy what is left."""
        for item in self._trying:
            self._destroy(item)
        if self._hearing is not None and self._hearing not in self._trying:
            self._destroy(self._hearing)
        self._trying.clear()
        self._hearing = None
