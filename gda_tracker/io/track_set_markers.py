"""Track sets as ``visualization_msgs/MarkerArray``: an ellipse per set, a name per track."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gda_tracker.io.fields import make_header
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.track_sets import TrackSetArray
from gda_tracker.vocabulary.tracks import CONFIRMED

ELLIPSES, NAMES = "track_sets", "track_names"
# Okabe and Ito's palette, by track id; red, green, blue.
COLOURS = (
    (0.00, 0.45, 0.70),
    (0.84, 0.37, 0.00),
    (0.00, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.34, 0.71, 0.91),
    (0.90, 0.62, 0.00),
)
# RViz draws nothing of an axis of length 0.
SMALLEST_AXIS_M = 1e-3
HEIGHT_M = 0.05


def position_ellipses(sets: TrackSetArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Half axes and directions of the sets in position.

    Parameters
    ----------
    sets
        N track sets.
    scale
        By how many standard deviations of P the set of means is enlarged.

    Returns
    -------
    half_axes, heading
        (N, 2) [m], the longer one first, and the direction (N,) [rad] of that, of an ellipse with
        the matrix (1 + p) (K K' + scale^2 P / p), p = scale sqrt(tr P / tr K K'): the smallest of
        its kind that holds every mean with its ellipse of ``scale`` standard deviations.
    """
    part = sets.matrix[:, :2]
    shape = part @ part.transpose(0, 2, 1)
    spread = scale**2 * sets.covariance[:, :2, :2]
    own = np.sqrt(np.trace(shape, axis1=1, axis2=2))
    other = np.sqrt(np.trace(spread, axis1=1, axis2=2))
    # Without one of the two the sum is the other.
    both = (own > 0.0) & (other > 0.0)
    ratio = np.where(both, other, 1.0) / np.where(both, own, 1.0)
    ratio = np.clip(ratio, 1e-9, 1e9)
    sum_of_both = np.where(
        both[:, None, None],
        (1.0 + ratio)[:, None, None] * (shape + spread / ratio[:, None, None]),
        shape + spread,
    )
    values, axes = np.linalg.eigh(sum_of_both)
    heading = np.arctan2(axes[:, 1, 1], axes[:, 0, 1])
    return np.sqrt(np.maximum(values[:, ::-1], 0.0)), heading


def markers_of_track_sets(sets: TrackSetArray, scale: float) -> Any:
    """Return a ``MarkerArray``: it first deletes what was drawn before.

    Flat cylinders, the best set of a track more opaque than its others, sets of tracks that are
    not confirmed pale; the name of a track stands at its best set.
    """
    from visualization_msgs.msg import Marker, MarkerArray

    header = make_header(sets.key.stamp_ns, sets.frame_id)
    array = MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    half_axes, heading = position_ellipses(sets, scale)
    for row in range(len(sets)):
        red, green, blue = COLOURS[int(sets.track_id[row]) % len(COLOURS)]
        confirmed = sets.status[row] == CONFIRMED
        best = bool(sets.best[row])
        marker = Marker(header=header, ns=ELLIPSES, id=row, type=Marker.CYLINDER)
        _place(marker, sets.centroid[row])
        marker.pose.orientation.z = math.sin(heading[row] / 2.0)
        marker.pose.orientation.w = math.cos(heading[row] / 2.0)
        marker.scale.x = max(2.0 * float(half_axes[row, 0]), SMALLEST_AXIS_M)
        marker.scale.y = max(2.0 * float(half_axes[row, 1]), SMALLEST_AXIS_M)
        marker.scale.z = HEIGHT_M
        marker.color.r, marker.color.g, marker.color.b = red, green, blue
        marker.color.a = (0.6 if best else 0.3) * (1.0 if confirmed else 0.4)
        array.markers.append(marker)
        if best and confirmed:
            name = Marker(header=header, ns=NAMES, id=row, type=Marker.TEXT_VIEW_FACING)
            _place(name, sets.centroid[row])
            name.pose.orientation.w = 1.0
            name.scale.z = max(float(half_axes[row].max()) / 2.0, 1.0)
            name.color.r, name.color.g, name.color.b, name.color.a = red, green, blue, 1.0
            name.text = str(int(sets.track_id[row]))
            array.markers.append(name)
    return array


def _place(marker: Any, centroid: FloatArray) -> None:
    marker.pose.position.x, marker.pose.position.y = float(centroid[0]), float(centroid[1])
