"""Array types of the vocabulary."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Int32Array: TypeAlias = NDArray[np.int32]
BoolArray: TypeAlias = NDArray[np.bool_]
MaskArray: TypeAlias = NDArray[np.uint32]


MOST_SHARED = 4096
_without_elements: dict[tuple[int, ...], FloatArray] = {}


def empty_floats(*shape: int) -> FloatArray:
    """Return a float64 array of zeros of the given shape, () meaning (0,).

    Arrays without elements are shared: there is nothing in them to change, and every message and
    table has many.
    """
    known = _without_elements.get(shape)
    if known is not None:
        return known
    made = np.zeros(shape or 0, dtype=np.float64)
    if not made.size and len(_without_elements) < MOST_SHARED:
        _without_elements[shape] = made
    return made
