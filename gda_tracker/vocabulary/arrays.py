"""Array types of the vocabulary."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Int32Array: TypeAlias = NDArray[np.int32]
BoolArray: TypeAlias = NDArray[np.bool_]
MaskArray: TypeAlias = NDArray[np.uint32]


def empty_floats(*shape: int) -> FloatArray:
    """Return a float64 array of zeros of the given shape, () meaning (0,).

    Arrays without elements are shared: there is nothing in them to change, and every message and
    table has many.
    """
    shape = shape or (0,)
    return _without_elements(shape) if 0 in shape else np.zeros(shape, dtype=np.float64)


@lru_cache(maxsize=4096)
def _without_elements(shape: tuple[int, ...]) -> FloatArray:
    return np.zeros(shape, dtype=np.float64)
