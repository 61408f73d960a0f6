"""Values of a JSON file with their path in it: every fault is one line with path, value, allowed.

>>> Value.read('{"a": [1, "x"]}')["a"][1].number("a number > 0", lambda x: x > 0)
Traceback (most recent call last):
gda_tracker.association.xmap.json_values.ProblemError: a[1] = 'x': allowed is a number > 0
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.vocabulary.arrays import FloatArray


class ProblemError(UserError):
    """The problem cannot be read or solved; the message names the fault and what is allowed."""


@dataclass(frozen=True)
class Value:
    """A value and where it stands, as ``sensors[0].measurements[1].position``."""

    path: str
    content: Any

    @staticmethod
    def read(text: str | bytes) -> Value:
        """Read the text of a JSON file."""
        try:
            return Value("", json.loads(text, object_pairs_hook=_object))
        except ProblemError:
            raise
        except RecursionError:
            raise ProblemError("not a problem: its JSON is nested too deeply") from None
        except ValueError as error:  # syntax, encoding, a number of too many digits
            raise ProblemError(f"not JSON: {error}") from None

    def fault(self, allowed: str) -> ProblemError:
        """Error with path, value and what is allowed."""
        return ProblemError(f"{self.path or 'problem'} = {show(self.content)}: {allowed}")

    def __getitem__(self, key: str | int) -> Value:
        if isinstance(key, int):
            return Value(f"{self.path}[{key}]", self.content[key])
        return Value(self._of(key), self.content[key])

    def _of(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def has(self, key: str) -> bool:
        """Whether the object has the key."""
        return key in self.content

    def is_null(self) -> bool:
        """Whether it is null."""
        return self.content is None

    def object(self, required: Sequence[str], optional: Sequence[str] = ()) -> Value:
        """Return itself if it is an object with these keys and no others."""
        keys = ", ".join((*required, *optional))
        if not isinstance(self.content, dict):
            raise self.fault(f"allowed is an object with {keys}")
        for key in self.content:
            if key not in required and key not in optional:
                raise ProblemError(f"{self._of(key)}: unknown key; allowed are {keys}")
        for key in required:
            if key not in self.content:
                raise ProblemError(f"{self._of(key)}: missing; needed are {', '.join(required)}")
        return self

    def names(self, allowed: str) -> list[str]:
        """Keys of an object that has at least one."""
        if not isinstance(self.content, dict) or not self.content:
            raise self.fault(f"allowed is {allowed}")
        return list(self.content)

    def entries(self, allowed: str, length: int | None = None) -> Iterator[Value]:
        """Entries of a list, which may be empty where no length is asked for."""
        wanted = f"allowed is a list of {'' if length is None else f'{length} '}{allowed}"
        if not isinstance(self.content, list):
            raise self.fault(wanted)
        if length is not None and len(self.content) != length:
            raise ProblemError(f"{self.path}: a list of {len(self.content)}; {wanted}")
        return (self[k] for k in range(len(self.content)))

    def choice(self, allowed: Sequence[str]) -> str:
        """One of some words."""
        if not isinstance(self.content, str) or self.content not in allowed:
            raise self.fault(f"allowed are {', '.join(allowed)}")
        return self.content

    def number(
        self, allowed: str = "a number", holds: Callable[[float], bool] = math.isfinite
    ) -> float:
        """A finite number that fulfils a condition."""
        # A bool is an int to Python, not to JSON; NaN and Infinity are read though JSON has none.
        number = self.content
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise self.fault(f"allowed is {allowed}")
        try:
            real = float(number)
        except OverflowError:
            raise self.fault(f"allowed is {allowed}") from None
        if not math.isfinite(real) or not holds(real):
            raise self.fault(f"allowed is {allowed}")
        return real

    def probability(self) -> float:
        """A number from 0 to 1."""
        return self.number("a number from 0 to 1", lambda p: 0.0 <= p <= 1.0)

    def vector(self, length: int | None = None) -> FloatArray:
        """List of numbers."""
        vector = np.array([entry.number() for entry in self.entries("numbers", length)])
        if not len(vector):
            raise self.fault("allowed is a list of 1 or more numbers")
        return vector

    def covariance(self, dimension: int, zero_allowed: bool = False) -> FloatArray:
        """A symmetric, positive definite matrix; or of zeros, where that is allowed."""
        rows = [row.vector(dimension) for row in self.entries("rows", dimension)]
        matrix = np.stack(rows)
        allowed = "allowed is a symmetric, positive definite matrix"
        if zero_allowed:
            allowed += ", zeros (none) or null (diffuse)"
            if not matrix.any():
                return matrix
        if np.abs(matrix - matrix.T).max() > SYMMETRY_TOLERANCE * np.abs(matrix).max():
            raise self.fault(allowed)
        matrix = 0.5 * (matrix + matrix.T)
        scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        # What the scales of the axes hide is seen in the correlations.
        if not (scale > 0.0).all():
            raise self.fault(allowed)
        if np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() < SMALLEST_EIGENVALUE:
            raise self.fault(allowed)
        return matrix


SYMMETRY_TOLERANCE = 1e-9
SMALLEST_EIGENVALUE = 1e-12


def show(value: Any) -> str:
    """Write a value of the file in one line that is not too long."""
    shortener = reprlib.Repr()
    shortener.maxstring = shortener.maxother = shortener.maxlong = 60
    return shortener.repr(value)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ProblemError(f"{show(key)}: stands twice in one object; allowed is once")
        result[key] = value
    return result
