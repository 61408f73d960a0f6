"""Fields of ``sensor_msgs/PointCloud2``, whatever their order, types, padding and byte order.

Works on messages of rclpy and of the rosbags library alike, and imports neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.vocabulary.arrays import FloatArray

# sensor_msgs/PointField
DATATYPES = {
    1: "int8",
    2: "uint8",
    3: "int16",
    4: "uint16",
    5: "int32",
    6: "uint32",
    7: "float32",
    8: "float64",
}
TYPE_NAMES = tuple(DATATYPES.values())
LARGEST_CLOUD_BYTES = 1 << 28


class PointCloudError(UserError):
    """A point cloud contradicts itself; the message names the field and what is wrong."""


def field_types(message: Any) -> dict[str, str]:
    """Return name and declared type of each field; a field of k > 1 numbers as ``type[k]``."""
    found = {}
    for field in message.fields:
        kind = DATATYPES.get(int(field.datatype), f"datatype {int(field.datatype)}")
        count = int(field.count) or 1
        found[str(field.name)] = kind if count == 1 else f"{kind}[{count}]"
    return found


def read_fields(
    message: Any, names: Iterable[str], type_overrides: Mapping[str, str] | None = None
) -> dict[str, FloatArray]:
    """Read fields of a ``PointCloud2``.

    Parameters
    ----------
    message
        With ``width``, ``height``, ``fields``, ``is_bigendian``, ``point_step``, ``row_step`` and
        ``data``.
    names
        The fields wanted, one number each; of longer ones the first.
    type_overrides
        Types in place of the declared ones, by field: some drivers declare what is not true.

    Returns
    -------
    dict
        By name (n,) float64, n = width times height, as they stand in the message: NaN stays NaN.

    Raises
    ------
    PointCloudError
        If a field does not exist or has an unknown type, reaches beyond the point, or the data is
        shorter than width, height and steps say.
    """
    overrides = type_overrides or {}
    width, height = int(message.width), int(message.height)
    step, row_step = int(message.point_step), int(message.row_step)
    n = width * height
    declared = {str(field.name): field for field in message.fields}
    if min(width, height, step, row_step) < 0 or n * step > LARGEST_CLOUD_BYTES:
        raise PointCloudError(f"point cloud of {width} x {height} points of {step} bytes each")
    places = {name: _place(name, declared, overrides, step) for name in names}
    if n == 0:
        return {name: np.zeros(0) for name in places}
    # Drivers leave row_step 0 in clouds of one row.
    if height > 1 and row_step < width * step:
        raise PointCloudError(f"row_step = {row_step}: a row has {width} points of {step} bytes")
    row_step = row_step if height > 1 else width * step
    data = np.frombuffer(bytes(message.data), dtype=np.uint8)
    needed = (height - 1) * row_step + width * step
    if len(data) < needed:
        raise PointCloudError(f"data has {len(data)} bytes, {needed} are needed for {n} points")
    order = ">" if message.is_bigendian else "<"
    found = {}
    for name, (offset, kind) in places.items():
        values: np.ndarray = np.ndarray(
            (height, width),
            dtype=np.dtype(kind).newbyteorder(order),
            buffer=data,
            offset=offset,
            strides=(row_step, step),
        )
        found[name] = values.astype(np.float64).reshape(n)
    return found


def _place(
    name: str, declared: Mapping[str, Any], overrides: Mapping[str, str], step: int
) -> tuple[int, str]:
    """Offset and type of a field."""
    if name not in declared:
        raise PointCloudError(
            f"field {name!r} is not in the point cloud; its fields are {', '.join(declared)}"
        )
    field = declared[name]
    kind = overrides.get(name) or DATATYPES.get(int(field.datatype))
    if kind is None or kind not in TYPE_NAMES:
        raise PointCloudError(
            f"field {name!r}: type {kind or int(field.datatype)!r}, allowed is one of "
            f"{', '.join(TYPE_NAMES)}"
        )
    offset = int(field.offset)
    if offset < 0 or offset + np.dtype(kind).itemsize > step:
        raise PointCloudError(
            f"field {name!r}: {kind} at byte {offset} reaches beyond the point of {step} bytes"
        )
    return offset, kind


def point_cloud_of_columns(
    columns: Mapping[str, FloatArray],
    types: Mapping[str, str],
    stamp_ns: int,
    frame_id: str,
    offsets: Mapping[str, int] | None = None,
    point_step: int = 0,
) -> Any:
    """Return a ``PointCloud2`` of the rosbags library, to be written into a bag.

    Parameters
    ----------
    columns
        (n,) by field.
    types
        Type of each field in the data, by field.
    stamp_ns, frame_id
        Of the header.
    offsets
        First byte of each field in a point; by default one after the other.
    point_step
        Bytes of a point; by default as few as needed.

    Raises
    ------
    PointCloudError
        If a value does not fit its field, or a field the point.
    """
    from gda_tracker.io.bag_types import type_store
    from gda_tracker.io.fields import split_stamp

    if offsets is None:
        sizes = [np.dtype(types[name]).itemsize for name in columns]
        offsets = dict(zip(columns, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))
    end = max(offsets[name] + np.dtype(types[name]).itemsize for name in columns)
    step = point_step or end
    if end > step:
        raise PointCloudError(f"point_step = {step}: allowed is at least {end}")
    n = len(next(iter(columns.values())))
    layout = np.dtype(
        {
            "names": list(columns),
            "formats": [np.dtype(types[name]).newbyteorder("<") for name in columns],
            "offsets": [offsets[name] for name in columns],
            "itemsize": step,
        }
    )
    points = np.zeros(n, dtype=layout)
    for name, values in columns.items():
        kind = np.dtype(types[name])
        if kind.kind in "iu" and len(values):
            limits = np.iinfo(kind)
            if not (limits.min <= np.min(values) and np.max(values) <= limits.max):
                raise PointCloudError(f"field {name!r}: a value that is no {types[name]}")
        points[name] = values
    store = type_store().types
    codes = {kind: code for code, kind in DATATYPES.items()}
    seconds, nanoseconds = split_stamp(stamp_ns)
    time = store["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return store["sensor_msgs/msg/PointCloud2"](
        header=store["std_msgs/msg/Header"](stamp=time, frame_id=frame_id),
        height=1,
        width=n,
        fields=[
            store["sensor_msgs/msg/PointField"](
                name=name, offset=offsets[name], datatype=codes[types[name]], count=1
            )
            for name in columns
        ],
        is_bigendian=False,
        point_step=step,
        row_step=n * step,
        data=np.frombuffer(points.tobytes(), dtype=np.uint8).copy(),
        is_dense=True,
    )
