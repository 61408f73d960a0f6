"""Messages of bags that were recorded with an earlier definition of our types.

An earlier definition lacks fields: what it has is here too, under the same name and with the same
type, and every field that is new is an array, a text or a float. Its messages are brought to the
present definition with the new fields empty, floats NaN, which stands for "not measured".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from gda_tracker.io import bag_types

Upgrade = Callable[[bytes], bytes]
_NOT_MEASURED: dict[str, Any] = {"string": "", "float64": math.nan}


@lru_cache(maxsize=64)
def upgrade_from(kind: str, definition: str) -> Upgrade | None:
    """Return what turns bytes of a recorded definition of ``kind`` into bytes of the present one.

    ``None`` if the recorded definition is not an earlier one.
    """
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    present, earlier = bag_types.type_store(), get_typestore(Stores.ROS2_JAZZY)
    try:
        types = get_types_from_msg(definition, kind)
        earlier.register({name: types[name] for name in types if name not in earlier.fielddefs})
    except TypesysError:
        return None
    if not _is_earlier(kind, earlier, present):
        return None

    def upgrade(data: bytes) -> bytes:
        message = bag_types.deserialized(earlier, data, kind)
        return bytes(present.serialize_cdr(_upgraded(message, kind, present), kind))

    return upgrade


def _is_earlier(kind: str, earlier: Any, present: Any) -> bool:
    from rosbags.interfaces import Nodetype

    if kind not in earlier.fielddefs or kind not in present.fielddefs:
        return False
    old, new = dict(earlier.fielddefs[kind][1]), dict(present.fielddefs[kind][1])
    for name, description in old.items():
        nested = _nested_type(description)
        if new.get(name) != description:
            return False
        if nested and not _is_earlier(nested, earlier, present):
            return False
    added = [new[name] for name in new if name not in old]
    return all(
        node == Nodetype.SEQUENCE or (node == Nodetype.BASE and detail[0] in _NOT_MEASURED)
        for node, detail in added
    )


def _nested_type(description: Any) -> str:
    """Name of the message type of a field or of its elements, or nothing."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        node, detail = detail[0]
    return str(detail) if node == Nodetype.NAME else ""


def _upgraded(message: Any, kind: str, present: Any) -> Any:
    values = {}
    for name, description in present.fielddefs[kind][1]:
        nested = _nested_type(description)
        if not hasattr(message, name):
            values[name] = _empty(description)
        elif not nested:
            values[name] = getattr(message, name)
        elif isinstance(value := getattr(message, name), list | tuple):
            values[name] = [_upgraded(item, nested, present) for item in value]
        else:
            values[name] = _upgraded(value, nested, present)
    return present.types[kind](**values)


def _empty(description: Any) -> Any:
    from rosbags.interfaces import Nodetype

    node, detail = description
    if node == Nodetype.BASE:
        return _NOT_MEASURED[detail[0]]
    element, element_type = detail[0]
    if element == Nodetype.NAME or element_type[0] == "string":
        return []
    dtype = {"byte": "uint8", "char": "uint8"}.get(element_type[0], element_type[0])
    return np.zeros(0, dtype=dtype)
