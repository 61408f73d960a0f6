"""A small bounded table of scans whose inputs are not complete yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from gda_tracker.vocabulary.scans import ScanKey

CAPACITY = 4

Inputs = dict[str, Any]


class ScanTable:
    """Collects the inputs of a stage by scan key.

    A stage runs when all inputs of a key are there. After that the key starts anew, so that a
    repeated scan is answered again. What is dropped is counted: ``older_epoch`` (an earlier track
    manager's), ``incomplete`` (a later scan was completed first), ``overflow`` (more than
    ``capacity`` keys).

    Parameters
    ----------
    inputs
        Names of the inputs.
    counters
        Where drops are counted.
    complete
        Says whether the inputs so far suffice; by default all names must be there.
    """

    def __init__(
        self,
        inputs: tuple[str, ...],
        counters: Counter[str],
        complete: Callable[[Inputs], bool] | None = None,
        capacity: int = CAPACITY,
    ) -> None:
        self._inputs = inputs
        self._counters = counters
        self._complete = complete or (lambda entry: len(entry) == len(inputs))
        self._capacity = capacity
        self._entries: dict[ScanKey, Inputs] = {}
        self._answered: ScanKey | None = None
        self._epoch = 0

    def __len__(self) -> int:
        return len(self._entries)

    def clear(self) -> int:
        """Forget what is not complete; return how many keys that were."""
        left = len(self._entries)
        self._drop(list(self._entries), "reset")
        return left

    def peek(self, key: ScanKey) -> Inputs | None:
        """Return what has come so far for a key that is not complete."""
        return self._entries.get(key)

    def put(self, name: str, key: ScanKey, value: Any) -> Inputs | None:
        """Add one input; return all inputs of the key once they are complete."""
        if name not in self._inputs:
            raise KeyError(f"input {name}: unknown; allowed are {', '.join(self._inputs)}")
        if key.epoch < self._epoch:
            self._counters["older_epoch"] += 1
            return None
        if key.epoch > self._epoch:
            self._drop(list(self._entries), "older_epoch")
            self._epoch, self._answered = key.epoch, None
        entry = self._entries.setdefault(key, {})
        entry[name] = value
        if self._complete(entry):
            # Keys that came before this one will never be completed: one scan is open at a time.
            earlier = list(self._entries)
            self._drop(earlier[: earlier.index(key)], "incomplete")
            del self._entries[key]
            self._answered = key
            return entry
        if len(self._entries) > self._capacity:
            self._drop([next(iter(self._entries))], "overflow")
        return None

    def _drop(self, keys: list[ScanKey], reason: str) -> None:
        for key in keys:
            del self._entries[key]
            if key != self._answered:  # left-overs of a repeated answer are no loss
                self._counters[reason] += 1
