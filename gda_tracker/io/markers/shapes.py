"""Shapes in the tracking plane: what each layer shows of a scan or of tracks, as arrays.

A shape becomes one ``visualization_msgs/Marker``. Its namespace and number tell it from all others
of its layer and stay the same as long as what it shows is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.io.markers.parameters import Colour, MarkerParameters
from gda_tracker.kinematics.extended.ellipses import semi_axes
from gda_tracker.kinematics.measurement_curves import measurement_curves
from gda_tracker.kinematics.measurement_models import locates
from gda_tracker.kinematics.rigid_transforms import rotation_matrix
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.tracking.gates import Gates
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray, empty_floats
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# Values of visualization_msgs/Marker.type.
ARROW, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST, SPHERE_LIST, TEXT = 0, 2, 3, 4, 5, 7, 9
# Okabe and Ito, Color universal design, 2008: told apart by colour-blind people; grey for class 0,
# the false alarm.
PALETTE: tuple[Colour, ...] = (
    (0.60, 0.60, 0.60, 1.0),
    (0.90, 0.62, 0.00, 1.0),
    (0.34, 0.71, 0.91, 1.0),
    (0.00, 0.62, 0.45, 1.0),
    (0.94, 0.89, 0.26, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.84, 0.37, 0.00, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)
# Marker ids have 32 bits, track ids 64. Two tracks alive at once are never so far apart.
LARGEST_NUMBER = 2**31
# A flat ellipse is a cylinder of this share of a track's size in height.
FLAT = 0.02
GATE_POINTS = 48
# Velocities below it have no direction worth an arrow.
SLOWEST_MPS = 1e-3


@dataclass(slots=True)
class Shape:
    """One marker.

    ``kind`` is that of ``Marker.type``; ``position`` (3,) and ``yaw_rad`` are its pose, ``scale``
    its ``Marker.scale``, ``points`` (n, 2) its points in the plane for kinds that have some.
    """

    namespace: str
    number: int
    kind: int
    colour: Colour
    scale: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    points: FloatArray = field(default_factory=lambda: empty_floats(0, 2))
    text: str = ""


def number_of(track_id: int) -> int:
    """Return the marker id of a track."""
    return int(track_id) % LARGEST_NUMBER


def drawable(tracks: Tracks) -> BoolArray:
    """Return which tracks (N,) have a state and a covariance that can be drawn."""
    if not len(tracks):
        return np.zeros(0, dtype=bool)
    size = tracks.mean.shape[1]
    if size < 4:
        return np.zeros(len(tracks), dtype=bool)
    return np.asarray(
        np.isfinite(tracks.mean).all(axis=1)
        & np.isfinite(tracks.covariance[:, :2, :2]).all(axis=(1, 2))
    )


def shown_rows(tracks: Tracks, p: MarkerParameters) -> IntArray:
    """Return the rows of the tracks that are shown."""
    keep = drawable(tracks)
    if not p.show_tentative:
        keep &= tracks.status == CONFIRMED
    return np.flatnonzero(keep)


def velocities(tracks: Tracks) -> FloatArray:
    """Return the velocities (N, 2) [m/s]: the state is all positions, then all velocities."""
    first = tracks.mean.shape[1] // 2
    return tracks.mean[:, first : first + 2]


def ellipses(covariance: FloatArray, probability: float) -> tuple[FloatArray, FloatArray]:
    """Return semi-axes (N, 2) [m], the longer first, and directions (N,) [rad] of the longer.

    They enclose the probability of two-dimensional Gaussians with covariances (N, 2, 2): the
    squared Mahalanobis distance on the edge is -2 log(1 - probability), the quantile of chi squared
    with two degrees of freedom.
    """
    value, vector = np.linalg.eigh(covariance)
    reach = math.sqrt(-2.0 * math.log1p(-probability))
    axes = reach * np.sqrt(np.maximum(value[:, ::-1], 0.0))
    return axes, np.arctan2(vector[:, 1, 1], vector[:, 0, 1])


def colours(tracks: Tracks, p: MarkerParameters) -> list[Colour]:
    """Return the colour of each track."""
    tentative, confirmed = p.colour("tentative_colour"), p.colour("confirmed_colour")
    of_class = p.colours_of_classes()
    by_class = [
        of_class.get(name, PALETTE[index % len(PALETTE)])
        for index, name in enumerate(tracks.class_names)
    ]
    likely = likely_classes(tracks)
    found = []
    for row, track_id in enumerate(tracks.track_id.tolist()):
        if tracks.status[row] != CONFIRMED:
            found.append(tentative)
        elif p.colour_by == "track":
            found.append(PALETTE[1 + track_id % (len(PALETTE) - 1)])
        elif p.colour_by == "class" and likely[row] >= 0:
            found.append(by_class[likely[row]])
        else:
            found.append(confirmed)
    return found


def likely_classes(tracks: Tracks) -> list[int]:
    """Return the most probable class of each track, -1 where none is known."""
    known = tracks.class_probability
    if not known.shape[1]:
        return [-1] * len(tracks)
    sound = np.isfinite(known).all(axis=1)
    return [int(c) if ok else -1 for c, ok in zip(known.argmax(axis=1), sound, strict=True)]


# --- of a scan ------------------------------------------------------------------------------------


def detection_positions(scan: Scan) -> FloatArray:
    """Return where the detections (n, 2) [m] lie in the tracking plane, NaN where that is unknown.

    A sensor with a model of its own may measure a bearing or a difference of ranges alone.
    """
    if not locates(scan):
        return np.full((len(scan), 2), np.nan)
    return cartesian_positions(polar_measurements(scan))[0]


def detections(scan: Scan, number: int, p: MarkerParameters) -> list[Shape]:
    """Return the detections of a scan as one shape, none if there are none.

    Those that are no places are lines: rays, circles, ellipses, branches of hyperbolas.
    """
    if not locates(scan):
        return _curves(scan, number, p)
    position = detection_positions(scan)
    position = position[np.isfinite(position).all(axis=1)]
    if not len(position):
        return []
    size = p.scale * p.detection_size_m
    kind, name = SPHERE_LIST, scan.key.sensor_id
    colour = p.colour("detection_colour")
    return [Shape(name, number, kind, colour, (size, size, size), points=position)]


def _curves(scan: Scan, number: int, p: MarkerParameters) -> list[Shape]:
    points = measurement_curves(scan, p.curve_farthest_m)
    points = points[np.isfinite(points).all(axis=(1, 2))]
    if not len(points):
        return []
    # A list of lines: each from one point to the next.
    lines = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2)
    width, name = p.scale * p.line_width_m, scan.key.sensor_id
    colour = p.colour("detection_colour")
    return [Shape(name, number, LINE_LIST, colour, (width, 0.0, 0.0), points=lines)]


def sensor(scan: Scan, p: MarkerParameters) -> list[Shape]:
    """Return where the sensor of a scan is and looks: an arrow along its x axis, and its name."""
    x, y, z = (float(v) for v in scan.sensor_position_m)
    ahead = rotation_matrix(np.asarray(scan.sensor_orientation_xyzw, dtype=np.float64))[:2, 0]
    if not np.isfinite([x, y, z, *ahead]).all():
        return []
    size, name = p.scale * p.track_size_m, scan.key.sensor_id
    yaw, colour = math.atan2(ahead[1], ahead[0]), p.colour("sensor_colour")
    position = (x, y, p.height_m)
    above = (x, y, p.height_m + size)
    text = p.scale * p.label_size_m
    return [
        Shape(name, 0, ARROW, colour, (2.0 * size, 0.4 * size, 0.4 * size), position, yaw),
        Shape(name, 1, TEXT, colour, (0.0, 0.0, text), above, text=name),
    ]


def gate_lines(gates: Gates, sensor_xy_m: FloatArray, p: MarkerParameters) -> list[Shape]:
    """Return the edges of the gates of a scan."""
    colour, width = p.colour("gate_colour"), p.scale * p.line_width_m
    sound = np.isfinite(gates.covariance).all(axis=(1, 2))
    sound &= np.isfinite(gates.range_m) & np.isfinite(gates.azimuth_rad)
    kept = Gates(
        gates.track_id[sound],
        gates.range_m[sound],
        gates.azimuth_rad[sound],
        gates.covariance[sound],
        gates.threshold,
    )
    return [
        Shape("gates", number_of(track), LINE_STRIP, colour, (width, 0.0, 0.0), points=edge)
        for track, edge in zip(
            kept.track_id.tolist(), kept.outlines(sensor_xy_m, GATE_POINTS), strict=True
        )
    ]


def associations(scan: Scan, tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    """Return lines from the tracks after a scan to the detections that they took."""
    rows = shown_rows(tracks, p)
    taken = tracks.detection_index[rows]
    order = np.argsort(scan.source_index, kind="stable")
    sources = scan.source_index[order]
    place = np.searchsorted(sources, taken)
    there = place < len(sources)
    there[there] = sources[place[there]] == taken[there]
    if not there.any():
        return []
    if not locates(scan):
        return []
    ends = detection_positions(scan)[order[place[there]]]
    lines = np.stack([tracks.mean[rows[there], :2], ends], axis=1).reshape(-1, 2)
    width = p.scale * p.line_width_m
    name, colour = scan.key.sensor_id, p.colour("association_colour")
    return [Shape(name, 0, LINE_LIST, colour, (width, 0.0, 0.0), points=lines)]


# --- of tracks ------------------------------------------------------------------------------------


def _namespaces(tracks: Tracks) -> list[str]:
    """Namespace of each track: viewers switch tentative and confirmed ones on and off by it."""
    return ["confirmed" if status == CONFIRMED else "tentative" for status in tracks.status]


def track_spheres(tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    """Return a sphere for each track; tentative ones are half as large.

    Of extended objects it is a flat disc, the ellipse of the object as large as it is.
    """
    colour, name = colours(tracks, p), _namespaces(tracks)
    if len(tracks.extent_weight):
        return _extents(tracks, p)
    found = []
    for row in shown_rows(tracks, p).tolist():
        size = p.scale * p.track_size_m * (1.0 if name[row] == "confirmed" else 0.5)
        x, y = tracks.mean[row, :2].tolist()
        number = number_of(tracks.track_id[row])
        at = (x, y, p.height_m)
        found.append(Shape(name[row], number, SPHERE, colour[row], (size, size, size), at))
    return found


def _extents(tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    colour, name = colours(tracks, p), _namespaces(tracks)
    axes, yaw = semi_axes(tracks.extent)
    flat = FLAT * p.scale * p.track_size_m
    found = []
    for row in shown_rows(tracks, p).tolist():
        x, y = tracks.mean[row, :2].tolist()
        size = (max(2.0 * axes[row, 0], flat), max(2.0 * axes[row, 1], flat), flat)
        number, at = number_of(tracks.track_id[row]), (x, y, p.height_m)
        found.append(Shape(name[row], number, CYLINDER, colour[row], size, at, float(yaw[row])))
    return found


def velocity_arrows(tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    """Return an arrow from each track to where it will be in ``velocity_s``."""
    colour, name = colours(tracks, p), _namespaces(tracks)
    velocity = velocities(tracks)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    width = 0.25 * p.scale * p.track_size_m
    found = []
    for row in shown_rows(tracks, p).tolist():
        if speed[row] < SLOWEST_MPS:
            continue
        x, y = tracks.mean[row, :2].tolist()
        number, length = number_of(tracks.track_id[row]), float(speed[row]) * p.velocity_s
        yaw = math.atan2(velocity[row, 1], velocity[row, 0])
        at, size = (x, y, p.height_m), (length, width, width)
        found.append(Shape(name[row], number, ARROW, colour[row], size, at, yaw))
    return found


def covariance_ellipses(tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    """Return the ellipse of each track that holds it with ``ellipse_probability``."""
    rows = shown_rows(tracks, p)
    if not len(rows):
        return []
    axes, yaw = ellipses(tracks.covariance[rows][:, :2, :2], p.ellipse_probability)
    colour, name = colours(tracks, p), _namespaces(tracks)
    flat = FLAT * p.scale * p.track_size_m
    found = []
    for i, row in enumerate(rows.tolist()):
        x, y = tracks.mean[row, :2].tolist()
        # Viewers refuse what has no extent.
        size = (max(2.0 * axes[i, 0], flat), max(2.0 * axes[i, 1], flat), flat)
        number, faint = number_of(tracks.track_id[row]), (*colour[row][:3], p.ellipse_opacity)
        at = (x, y, p.height_m)
        found.append(Shape(name[row], number, CYLINDER, faint, size, at, float(yaw[i])))
    return found


def labels(tracks: Tracks, p: MarkerParameters) -> list[Shape]:
    """Return the number of each track above it, with its most probable class and its speed."""
    colour, name, likely = colours(tracks, p), _namespaces(tracks), likely_classes(tracks)
    speed = np.hypot(*velocities(tracks).T) if len(tracks) else empty_floats()
    height = p.scale * p.label_size_m
    found = []
    for row in shown_rows(tracks, p).tolist():
        x, y = tracks.mean[row, :2].tolist()
        text = str(int(tracks.track_id[row]))
        if likely[row] >= 0:
            share = tracks.class_probability[row, likely[row]]
            text += f" {tracks.class_names[likely[row]]} {share:.2f}"
        text += f"\n{speed[row]:.1f} m/s"
        at = (x, y, p.height_m + p.scale * p.track_size_m + height)
        number = number_of(tracks.track_id[row])
        found.append(Shape(name[row], number, TEXT, colour[row], (0.0, 0.0, height), at, text=text))
    return found
