"""Point clouds as drivers publish them, for tests."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def cloud(columns, layout, *, step=None, big=False, height=1, row_padding=0, declared=None):
    """A ``PointCloud2`` without ROS.

    ``columns`` (n,) by field; ``layout`` is a list of (field, type code such as f4, offset).
    ``declared`` gives other type codes than those in which the fields are written.
    """
    order = ">" if big else "<"
    step = step or max(offset + np.dtype(kind).itemsize for _, kind, offset in layout)
    n = len(next(iter(columns.values())))
    width = n // height
    row_step = width * step + row_padding
    data = np.full(height * row_step, 0xA5, dtype=np.uint8)
    for field, kind, offset in layout:
        for i, value in enumerate(columns[field]):
            place = (i // width) * row_step + (i % width) * step + offset
            raw = np.array([value], dtype=order + kind).tobytes()
            data[place : place + len(raw)] = np.frombuffer(raw, dtype=np.uint8)
    fields = [
        SimpleNamespace(
            name=field, offset=offset, datatype=CODES[(declared or {}).get(field, kind)], count=1
        )
        for field, kind, offset in layout
    ]
    return SimpleNamespace(
        width=width,
        height=height,
        fields=fields,
        is_bigendian=big,
        point_step=step,
        row_step=row_step,
        data=data,
    )
