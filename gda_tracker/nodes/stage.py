"""The common base of the three stateless stages."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gda_tracker.io.messages import MessageError
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode
from gda_tracker.nodes.figures import Recent
from gda_tracker.nodes.qualities import latched
from gda_tracker.nodes.scan_table import Inputs, ScanTable
from gda_tracker.nodes.services import offer


@dataclass(frozen=True)
class Input:
    """One input topic of a stage: its message and how to read it."""

    topic: str
    message: type
    read: Callable[[Any], Any]


class StageNode(RingNode):
    """A stateless stage: collects its inputs by scan key, computes, publishes.

    Subclasses set ``inputs``, ``output_topic``, ``output_message``, ``write`` and implement
    :meth:`compute`.
    """

    inputs: tuple[Input, ...]
    output_topic: str
    output_message: type
    write: Callable[[Any], Any]

    def __init__(
        self, name: str, table: type, parameters: Mapping[str, Any] | None = None, **options: Any
    ) -> None:
        super().__init__(name, table, parameters, **options)
        self._table_of_scans = ScanTable(
            tuple(i.topic for i in self.inputs), self.counters, self.complete
        )
        self._publisher: Any = None
        self._answered = 0
        self._latency = Recent()
        self.use_parameters(self.parameters)
        offer(self, "reset", self._reset)

    def _reset(self) -> str:
        """Forget the scans whose inputs are not complete; there is no other state."""
        return f"{self._table_of_scans.clear()} incomplete scans forgotten"

    def complete(self, entry: Inputs) -> bool:
        """Whether the inputs of a scan suffice."""
        return all(item.topic in entry for item in self.inputs)

    def prepare(self, topic: str, entry: Inputs) -> None:
        """Do what can be done before the last input comes, after ``topic`` has come.

        Results go into ``entry`` under names that are no topics.
        """

    def compute(self, entry: Inputs) -> Any:
        """Compute the output from the inputs; a pure function of them and the parameters."""
        raise NotImplementedError

    def note(self, entry: Inputs, answer: Any) -> None:
        """Note figures for diagnostics, after the answer has gone."""

    def open_topics(self) -> None:
        """Open the latched topics."""
        self._publisher = self.advertise(self.output_message, self.output_topic, latched())
        for item in self.inputs:
            self.subscribe(
                item.message, item.topic, lambda m, item=item: self._receive(item, m), latched()
            )

    def _receive(self, item: Input, message: Any) -> None:
        begun = time.perf_counter()
        try:
            value = item.read(message)
        except MessageError as error:
            self.drop(f"malformed_{item.topic}", str(error))
            return
        entry = self._table_of_scans.put(item.topic, value.key, value)
        if entry is None:
            self._prepare_early(item.topic, self._table_of_scans.peek(value.key))
            return
        try:
            answer = self.compute(entry)
            output = type(self).write(answer)
        except STAGE_ERRORS as error:
            self.drop("failed", f"{type(error).__name__}: {error}")
            self.get_logger().debug(traceback.format_exc())
            return
        self._publisher.publish(output)
        self._answered += 1
        # From the last input to the answer; what the stage waits for others does not count.
        self._latency.note(time.perf_counter() - begun)
        self.note(entry, answer)

    def _prepare_early(self, topic: str, entry: Inputs | None) -> None:
        if entry is None:
            return
        try:
            self.prepare(topic, entry)
        except STAGE_ERRORS:
            # The same error comes again when the stage computes, and is counted there.
            self.get_logger().debug(traceback.format_exc())

    def figures(self) -> dict[str, Any]:
        """Count of answers, and how long they took."""
        return {"answered": self._answered, **self._latency.milliseconds("latency")}
