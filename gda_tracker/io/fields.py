"""Fields of messages <-> arrays, stamps and scalars: the only place where types are cast.

Message classes do not check their fields unless told so, and a field of the wrong Python type then
corrupts data. Everything that goes into a message therefore passes through a function of this file.

Arrays that come out are **read-only views** of the message's own memory (no copy): a stage that
needs to change one copies it. They keep the message's buffer alive and are not affected when a
field of the message is assigned again.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray, MaskArray

NANOSECONDS = 1_000_000_000
LARGEST_STAMP_NS = (2**31 - 1) * NANOSECONDS + NANOSECONDS - 1

_TYPE_CODES = {
    np.dtype(np.float64): "d",
    np.dtype(np.int32): "i",
    np.dtype(np.int64): "q",
    np.dtype(np.uint32): "I",
    np.dtype(np.uint8): "B",
}


class MessageError(ValueError):
    """A message cannot be made or read; ``reason`` is one line that names the field."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def _to_field(values: ArrayLike | None, dtype: type) -> array.array:
    field = array.array(_TYPE_CODES[np.dtype(dtype)])
    if values is not None:
        # array.array(code, values) converts element by element: 50 times slower
        field.frombytes(np.ascontiguousarray(values, dtype=dtype).tobytes())
    return field


def floats_to_field(values: ArrayLike | None) -> array.array:
    """Return the elements, row-major, for a ``float64[]`` field; ``None`` gives an empty one."""
    return _to_field(values, np.float64)


def int32_to_field(values: ArrayLike | None) -> array.array:
    """Return the elements for an ``int32[]`` field; ``None`` gives an empty one."""
    return _to_field(values, np.int32)


def int64_to_field(values: ArrayLike | None) -> array.array:
    """Return the elements for an ``int64[]`` field; ``None`` gives an empty one."""
    return _to_field(values, np.int64)


def masks_to_field(values: ArrayLike | None) -> array.array:
    """Return the elements for a ``uint32[]`` field; ``None`` gives an empty one."""
    return _to_field(values, np.uint32)


def bools_to_field(values: ArrayLike | None) -> array.array:
    """Return truth values as 0 and 1 for a ``uint8[]`` field; ``None`` gives an empty one."""
    return _to_field(None if values is None else np.asarray(values, dtype=bool), np.uint8)


def indices_to_field(values: NDArray[np.integer], name: str) -> array.array:
    """Return small indices for a ``uint8[]`` field.

    Raises
    ------
    MessageError
        If one is not in 0 ... 255.
    """
    values = np.asarray(values)
    if values.size and (values.min() < 0 or values.max() > 255):
        wrong = values[(values < 0) | (values > 255)][0]
        raise MessageError(f"{name} holds {wrong}: allowed is 0 to 255")
    return _to_field(values, np.uint8)


def _from_field(field: Any, dtype: type) -> NDArray[Any]:
    if isinstance(field, np.ndarray):  # fixed-size fields, and every field of the rosbags library
        values = field.astype(dtype, copy=False).view()
    else:
        values = np.frombuffer(field, dtype=dtype)
    values.flags.writeable = False
    return values


def floats_from_field(field: Any) -> FloatArray:
    """Return a ``float64[]`` or ``float64[N]`` field as a read-only array (n,)."""
    return _from_field(field, np.float64)


def int32_from_field(field: Any) -> Int32Array:
    """Return an ``int32[]`` field as a read-only array (n,)."""
    return _from_field(field, np.int32)


def int64_from_field(field: Any) -> IntArray:
    """Return an ``int64[]`` field as a read-only array (n,)."""
    return _from_field(field, np.int64)


def masks_from_field(field: Any) -> MaskArray:
    """Return a ``uint32[]`` field as a read-only array (n,)."""
    return _from_field(field, np.uint32)


def indices_from_field(field: Any) -> Int32Array:
    """Return a ``uint8[]`` field as an int32 array (n,)."""
    return _from_field(field, np.uint8).astype(np.int32)


def bools_from_field(field: Any) -> BoolArray:
    """Return a ``uint8[]`` field as truth values (n,); everything but 0 is true."""
    return _from_field(field, np.uint8) != 0


def require_size(values: NDArray[Any], size: int, name: str) -> NDArray[Any]:
    """Return ``values`` (n,) if it has ``size`` elements.

    Raises
    ------
    MessageError
        If it has not.
    """
    if len(values) != size:
        raise MessageError(f"{name} has {len(values)} elements, {size} expected")
    return values


def reshape(values: NDArray[Any], shape: tuple[int, ...], name: str) -> NDArray[Any]:
    """Return row-major elements (n,) in the given shape.

    Raises
    ------
    MessageError
        If the number of elements does not fit.
    """
    size = 1
    for length in shape:
        size *= length
    if len(values) != size:
        times = " x ".join(str(length) for length in shape)
        raise MessageError(f"{name} has {len(values)} elements, {times} expected")
    return values.reshape(shape)


def unsigned(value: int, bits: int, name: str) -> int:
    """Return a count for an unsigned field.

    Raises
    ------
    MessageError
        If it is negative or needs more bits.
    """
    number = int(value)
    if not 0 <= number < 1 << bits:
        raise MessageError(f"{name} = {number}: allowed is 0 to {(1 << bits) - 1}")
    return number


def signed(value: int, bits: int, name: str) -> int:
    """Return a number for a signed field.

    Raises
    ------
    MessageError
        If it needs more bits.
    """
    number = int(value)
    limit = 1 << (bits - 1)
    if not -limit <= number < limit:
        raise MessageError(f"{name} = {number}: allowed is {-limit} to {limit - 1}")
    return number


def split_stamp(stamp_ns: int, name: str = "stamp") -> tuple[int, int]:
    """Return seconds and nanoseconds of ``builtin_interfaces/Time`` for a stamp [ns], exactly.

    Raises
    ------
    MessageError
        If the stamp is negative or beyond what 31 bits of seconds hold (year 2038).
    """
    stamp_ns = int(stamp_ns)
    if not 0 <= stamp_ns <= LARGEST_STAMP_NS:
        raise MessageError(f"{name} = {stamp_ns} ns: allowed is 0 to {LARGEST_STAMP_NS} ns")
    return divmod(stamp_ns, NANOSECONDS)


def stamp_to_time(stamp_ns: int, name: str = "stamp") -> Any:
    """Return a stamp [ns] as ``builtin_interfaces/Time``; errors as :func:`split_stamp`."""
    from builtin_interfaces.msg import Time

    seconds, nanoseconds = split_stamp(stamp_ns, name)
    return Time(sec=seconds, nanosec=nanoseconds)


def stamp_from_time(time: Any, name: str = "stamp") -> int:
    """Return a ``builtin_interfaces/Time`` as a stamp [ns], exactly.

    Raises
    ------
    MessageError
        If the seconds are negative or the nanoseconds make a second or more.
    """
    seconds, nanoseconds = int(time.sec), int(time.nanosec)
    if seconds < 0 or not 0 <= nanoseconds < NANOSECONDS:
        raise MessageError(
            f"{name} = {seconds} s and {nanoseconds} ns: allowed is sec >= 0, nanosec < 1000000000"
        )
    return seconds * NANOSECONDS + nanoseconds


def make_header(stamp_ns: int, frame_id: str) -> Any:
    """Return a ``std_msgs/Header``; errors as :func:`split_stamp`."""
    from std_msgs.msg import Header

    return Header(stamp=stamp_to_time(stamp_ns, "header.stamp"), frame_id=str(frame_id))
