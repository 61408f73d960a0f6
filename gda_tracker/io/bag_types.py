"""Message types for bags, by the rosbags library: definitions, hashes, messages without ROS.

The definitions of our own messages are read from the ``.msg`` files that come with the package, so
a bag can be read and checked on a machine without ROS.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np

from gda_tracker.io.foreign_types import FOREIGN_MESSAGES, definition, package_of
from gda_tracker.resources import resource

PACKAGE = "gda_tracker_msgs"
_INSTALL = "pip install gda_tracker[bags]"
# Bytes that may stand behind a message.
MOST_BEHIND = 64


class MissingLibraryError(ImportError):
    """A library that only this use needs is not installed; the message names the command."""


def require_rosbags() -> None:
    """Raise :class:`MissingLibraryError` unless the rosbags library can be imported."""
    try:
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        raise MissingLibraryError(f"bags need the rosbags library: {_INSTALL}") from error


def new_type_store(without: Collection[str] = ()) -> Any:
    """Return a rosbags type store with the types of ROS 2 Jazzy and our own.

    Those of :data:`~gda_tracker.io.foreign_types.FOREIGN_MESSAGES` are in it too, but for the
    packages ``without``, of which a bag brings others.

    Raises
    ------
    MissingLibraryError
        If the rosbags library is not installed.
    """
    require_rosbags()
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted(resource("msg_schemas", "msg").glob("*.msg")):
        text = path.read_text(encoding="utf-8")
        types.update(get_types_from_msg(text, f"{PACKAGE}/msg/{path.stem}"))
    for kind in FOREIGN_MESSAGES:
        if package_of(kind) not in without:
            types.update(get_types_from_msg(definition(kind), kind))
    store.register(types)
    return store


@lru_cache(maxsize=1)
def type_store() -> Any:
    """Return the shared type store, see :func:`new_type_store`."""
    return new_type_store()


@lru_cache(maxsize=256)
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of a type of the shared store, as rosidl computes it.

    Raises
    ------
    KeyError
        If the type is unknown.
    """
    return str(type_store().hash_rihs01(type_name))


def type_name(message: Any) -> str:
    """Return the type of a message of rclpy or of rosbags, e.g. ``gda_tracker_msgs/msg/Scan``."""
    name = getattr(type(message), "__msgtype__", None)
    if name is not None:
        return str(name)
    return f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"


def message_class(type_name: str) -> Any:
    """Return the rclpy class of a type name; raise ``ImportError`` if it is not built here."""
    import importlib

    package, _, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def serialize(message: Any) -> bytes:
    """Return a message of rclpy or of rosbags as CDR bytes that depend on its content alone.

    The middleware's own serialiser leaves whatever stood in memory between the fields; here the
    gaps are zero, so equal messages give equal bytes.
    """
    store, name = type_store(), type_name(message)
    return bytes(store.serialize_cdr(_store_message(message, name, store), name))


def _store_message(message: Any, name: str, store: Any) -> Any:
    if hasattr(type(message), "__msgtype__"):
        return message
    values = {
        field: _store_value(getattr(message, field, None), description, store)
        for field, description in store.fielddefs[name][1]
    }
    return store.types[name](**values)


def _store_value(value: Any, description: Any, store: Any) -> Any:
    from rosbags.interfaces import Nodetype

    kind, detail = description
    if kind == Nodetype.NAME:
        return _store_message(value, detail, store)
    if kind == Nodetype.BASE:
        if value is None:  # the placeholder field of a message without fields
            return 0
        return value[0] if isinstance(value, bytes) else value
    element, _ = detail
    if element[0] == Nodetype.NAME:
        return [_store_message(item, element[1], store) for item in value]
    if element[1][0] == "string":
        return list(value)
    if len(value) and isinstance(value[0], bytes):
        value = [item[0] for item in value]
    dtype = {"byte": "uint8", "char": "uint8"}.get(element[1][0], element[1][0])
    return np.ascontiguousarray(value, dtype=dtype)


def deserialized(store: Any, data: bytes, kind: str) -> Any:
    """Return a message in the rosbags library's own class.

    ``rclpy.serialization.serialize_message`` may leave some bytes behind the message, which the
    library takes for a mistake; DDS sends none.

    Raises
    ------
    rosbags.serde.SerdeError
        If the bytes are not a message of this type.
    """
    from rosbags.serde import SerdeError

    try:
        return store.deserialize_cdr(data, kind)
    except SerdeError:
        for behind in range(4, MOST_BEHIND + 1, 4):
            with suppress(SerdeError):
                return store.deserialize_cdr(data[:-behind], kind)
        raise
