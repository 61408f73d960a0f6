"""Updates of layers straight to the bytes of a ``visualization_msgs/MarkerArray``.

A marker has fifty fields and trails have thousands of points; built as objects, a hundred tracks
take longer to show than to track. The form is plain CDR (XCDR1), little endian, which the ROS 2
middlewares write and read; publishers take it in place of a message.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from gda_tracker.io.fields import split_stamp
from gda_tracker.io.markers.layers import NANOSECONDS, Update
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.io.markers.shapes import Shape

# Values of visualization_msgs/Marker.action.
ADD, DELETE, DELETE_ALL = 0, 2, 3
ENCAPSULATION = b"\x00\x01\x00\x00"  # plain CDR, little endian
# Position, orientation and scale, then the colour and the lifetime.
_POSE_AND_SCALE = struct.Struct("<10d")
_LOOK = struct.Struct("<4fiI")
# What every deletion has in common: numbers that viewers do not look at.
_NOTHING = Shape("", 0, 0, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def marker_array(update: Update, parameters: MarkerParameters) -> bytes:
    """Return an update as a serialised ``MarkerArray``: deletions first, then what is shown.

    Every marker has the stamp and the frame of the scan, so that viewers place it where it was
    then.

    Raises
    ------
    MessageError
        If the stamp does not fit.
    """
    head = struct.pack("<iI", *split_stamp(update.stamp_ns, "header.stamp")) + _text(
        update.frame_id
    )
    look = divmod(round(parameters.lifetime_s * NANOSECONDS), NANOSECONDS)
    out = bytearray()
    count = int(update.anew) + len(update.gone) + len(update.shapes)
    out += struct.pack("<I", count)
    if update.anew:
        _put(out, head, _NOTHING, DELETE_ALL, (0, 0), 0.0)
    for namespace, number in update.gone:
        gone = Shape(namespace, number, 0, _NOTHING.colour, _NOTHING.scale)
        _put(out, head, gone, DELETE, (0, 0), 0.0)
    for shape in update.shapes:
        _put(out, head, shape, ADD, look, parameters.height_m)
    return ENCAPSULATION + bytes(out)


def _align(out: bytearray, size: int) -> None:
    out += bytes(-len(out) % size)


def _text(value: str) -> bytes:
    encoded = value.encode() + b"\x00"
    return struct.pack("<I", len(encoded)) + encoded


def _put(
    out: bytearray,
    head: bytes,
    shape: Shape,
    action: int,
    lifetime: tuple[int, int],
    height_m: float,
) -> None:
    """Append one ``Marker``; alignment counts from behind the encapsulation."""
    _align(out, 4)
    out += head
    _align(out, 4)
    out += _text(shape.namespace)
    _align(out, 4)
    out += struct.pack("<3i", shape.number, shape.kind, action)
    _align(out, 8)
    half = 0.5 * shape.yaw_rad
    turn = (0.0, 0.0, math.sin(half), math.cos(half))
    out += _POSE_AND_SCALE.pack(*shape.position, *turn, *shape.scale)
    out += _LOOK.pack(*shape.colour, *lifetime)
    # frame_locked, padding, number of points.
    out += struct.pack("<B3xI", 0, len(shape.points))
    if len(shape.points):
        _align(out, 8)
        points = np.full((len(shape.points), 3), height_m, dtype="<f8")
        points[:, :2] = shape.points
        out += points.tobytes()
    # Colours of the points, texture_resource; the texture: header, format, data; uv_coordinates.
    out += struct.pack("<I", 0)
    for value in ("", None, "", ""):
        _align(out, 4)
        out += struct.pack("<iI", 0, 0) if value is None else _text(value)
    _align(out, 4)
    out += struct.pack("<2I", 0, 0)
    out += _text(shape.text)
    # mesh_resource, mesh_file: its name and data; mesh_use_embedded_materials.
    for _ in range(2):
        _align(out, 4)
        out += _text("")
    _align(out, 4)
    out += struct.pack("<IB", 0, 0)
