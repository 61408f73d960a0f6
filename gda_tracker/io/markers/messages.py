"""Updates of layers as ``visualization_msgs/MarkerArray``."""

from __future__ import annotations

import math
from typing import Any

from gda_tracker.io.fields import make_header
from gda_tracker.io.markers.layers import Update
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.io.markers.shapes import TEXT, Shape

# Values of visualization_msgs/Marker.action.
ADD, DELETE, DELETE_ALL = 0, 2, 3
NANOSECONDS = 1_000_000_000


def marker_array(update: Update, parameters: MarkerParameters) -> Any:
    """Return an update as ``MarkerArray``: deletions first, then what is shown.

    Every marker has the stamp and the frame of the scan, so that viewers place it where it was
    then.

    Raises
    ------
    MessageError
        If the stamp does not fit.
    """
    from builtin_interfaces.msg import Duration
    from visualization_msgs.msg import Marker, MarkerArray

    header = make_header(update.stamp_ns, update.frame_id)
    seconds, nanoseconds = divmod(round(parameters.lifetime_s * NANOSECONDS), NANOSECONDS)
    lifetime = Duration(sec=seconds, nanosec=nanoseconds)
    found = []
    if update.anew:
        found.append(Marker(header=header, action=DELETE_ALL))
    for namespace, number in update.gone:
        found.append(Marker(header=header, ns=namespace, id=number, action=DELETE))
    for shape in update.shapes:
        marker = _marker(shape, parameters.height_m)
        marker.header, marker.lifetime = header, lifetime
        found.append(marker)
    return MarkerArray(markers=found)


def _marker(shape: Shape, height_m: float) -> Any:
    from geometry_msgs.msg import Point
    from visualization_msgs.msg import Marker

    marker = Marker(ns=shape.namespace, id=shape.number, type=shape.kind, action=ADD)
    at, turn = marker.pose.position, marker.pose.orientation
    at.x, at.y, at.z = (float(value) for value in shape.position)
    turn.z, turn.w = math.sin(0.5 * shape.yaw_rad), math.cos(0.5 * shape.yaw_rad)
    size, colour = marker.scale, marker.color
    size.x, size.y, size.z = (float(value) for value in shape.scale)
    colour.r, colour.g, colour.b, colour.a = (float(value) for value in shape.colour)
    marker.points = [Point(x=x, y=y, z=height_m) for x, y in shape.points.tolist()]
    if shape.kind == TEXT:
        marker.text = shape.text
    return marker
