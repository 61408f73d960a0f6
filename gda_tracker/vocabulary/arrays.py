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


def empty_floats(*shape: int) -> FloatArray:
    """Return a float64 array of zeros of the given shape, () meaning (0,)."""
    return np.zeros(shape or (0,), dtype=np.float64)
