"""A single-threaded executor that costs a message little.

The executor of rclpy gathers all entities of all nodes anew for every callback, builds a wait set
for them and wakes itself up twice after each: more than half a millisecond of processor time per
message where a node has a dozen services. This one keeps its wait set while the entities stay the
same, and runs everything that is ready after one wait.
"""

from __future__ import annotations

from typing import Any

from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription
from rclpy.task import Task

NS_PER_S = 1_000_000_000


class LeanExecutor(Executor):
    """Runs callbacks in the thread that calls :meth:`spin_once`, which callbacks must not do.

    Timers and subscriptions are served straight away and in this order; services, clients, guard
    conditions and waitables, which are rare, by the means of the base class.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        self._stale = True
        super().__init__(context=context)
        self._wait_set: Any = None
        self._timers: list[Any] = []
        self._subscriptions: list[Any] = []
        # Groups of rare entities: their kind in the wait set, who they are, how they are served.
        self._rare: list[tuple[str, list[tuple[Any, Any]], Any]] = []
        self._waitables: list[tuple[Any, Any]] = []

    def add_node(self, node: Any) -> bool:
        """Add a node; returns whether it was new."""
        self._stale = True
        return bool(super().add_node(node))

    def remove_node(self, node: Any) -> None:
        """Remove a node."""
        self._stale = True
        super().remove_node(node)

    def wake(self) -> None:
        """Take new entities into account; called where one was created or destroyed."""
        self._stale = True
        super().wake()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready, at most ``timeout_sec`` [s], and run all of it.

        Raises
        ------
        ExternalShutdownException
            If the context was shut down meanwhile.
        """
        self._run_tasks()
        if self._is_shutdown:
            return
        if not self._context.ok():
            raise ExternalShutdownException()
        wait_set = self._fill_wait_set()
        wait_set.wait(-1 if timeout_sec is None else max(int(timeout_sec * NS_PER_S), 0))
        if self._is_shutdown:
            return
        if not self._context.ok():
            raise ExternalShutdownException()
        # What is ready is noted before the first callback, which may create or destroy entities.
        rare = [
            (entity, node, take)
            for kind, members, take in self._rare
            if (ready := wait_set.get_ready_entities(kind))
            for entity, node in members
            if entity.handle.pointer in ready
        ]
        waitables = [item for item in self._waitables if item[0].is_ready(wait_set)]
        timers = wait_set.get_ready_entities("timer")
        subscriptions = wait_set.get_ready_entities("subscription")
        if timers:
            for timer in [t for t in self._timers if t.handle.pointer in timers]:
                self._serve_timer(timer)
        if subscriptions:
            for item in [s for s in self._subscriptions if s.handle.pointer in subscriptions]:
                self._serve_subscription(item)
        for entity, node, take in rare:
            self._run(self._make_handler(entity, node, take))
        for waitable, node in waitables:
            self._run(self._make_handler(waitable, node, self._take_waitable))

    def _fill_wait_set(self) -> Any:
        """The wait set with all entities in it; it must be filled before every wait."""
        while True:
            if self._stale:
                self._gather()
            try:
                return self._add_entities()
            except rclpy_implementation.InvalidHandle:
                self._stale = True

    def _gather(self) -> None:
        """List the entities of all nodes and make a wait set of their number."""
        self._stale = False
        nodes = list(self.get_nodes())
        self._timers = [timer for node in nodes for timer in node.timers]
        self._subscriptions = [item for node in nodes for item in node.subscriptions]
        services = [(service, node) for node in nodes for service in node.services]
        clients = [(client, node) for node in nodes for client in node.clients]
        guards = [(guard, node) for node in nodes for guard in node.guards]
        self._rare = [
            ("service", services, self._take_service),
            ("client", clients, self._take_client),
            ("guard_condition", guards, self._take_guard_condition),
        ]
        self._waitables = [(waitable, node) for node in nodes for waitable in node.waitables]
        counts = [
            len(self._subscriptions),
            len(guards) + 2,
            len(self._timers),
            len(clients),
            len(services),
            0,
        ]
        for waitable, _ in self._waitables:
            more = waitable.get_num_entities()
            for i, name in enumerate(
                ("subscriptions", "guard_conditions", "timers", "clients", "services", "events")
            ):
                counts[i] += getattr(more, f"num_{name}")
        with self._context.handle:
            self._wait_set = rclpy_implementation.WaitSet(*counts, self._context.handle)

    def _add_entities(self) -> Any:
        wait_set = self._wait_set
        wait_set.clear_entities()
        for item in self._subscriptions:
            wait_set.add_subscription(item.handle)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        services, clients, guards = (members for _, members, _ in self._rare)
        for service, _ in services:
            wait_set.add_service(service.handle)
        for client, _ in clients:
            wait_set.add_client(client.handle)
        for guard, _ in guards:
            wait_set.add_guard_condition(guard.handle)
        for guard in (self._guard, self._sigint_gc):
            wait_set.add_guard_condition(guard.handle)
        for waitable, _ in self._waitables:
            waitable.add_to_wait_set(wait_set)
        return wait_set

    def _serve_timer(self, timer: Any) -> None:
        try:
            with timer.handle:
                # One that was cancelled meanwhile is in the wait set, but not ready.
                if not timer.handle.is_timer_ready():
                    return
                timer.handle.call_timer()
        except rclpy_implementation.InvalidHandle:
            return  # an earlier callback destroyed it
        timer.callback()

    def _serve_subscription(self, subscription: Any) -> None:
        try:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except rclpy_implementation.InvalidHandle:
            return
        if taken is None:
            return
        if subscription._callback_type is Subscription.CallbackType.MessageOnly:
            subscription.callback(taken[0])
        else:
            subscription.callback(*taken)

    def _run_tasks(self) -> None:
        """Run what was handed to :meth:`create_task`, e.g. the callbacks of futures."""
        if not self._tasks:
            return
        with self._tasks_lock:
            tasks = [task for task, _, _ in self._tasks]
        for task in tasks:
            if not task.executing() and not task.done():
                self._run(task)
        with self._tasks_lock:
            self._tasks = [
                item for item in self._tasks if not item[0].done() and not item[0].cancelled()
            ]

    @staticmethod
    def _run(task: Task) -> None:
        task()
        if task.done() and task.exception() is not None:
            raise task.exception()
