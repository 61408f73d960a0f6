"""Tracks in the messages of others: ``RadarTracks``, ``Detection3DArray``, ``TrackedObjects``.

Tracks are made in a plane. What the tracker does not know is given out with a variance that says
so: :data:`UNKNOWN_VARIANCE`, for angles that of any direction. Sizes and heights are declared.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.fields import split_stamp
from gda_tracker.io.track_output_parameters import AUTOWARE_LABELS, TrackOutputParameters
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

RADAR_TRACKS = "radar_msgs/msg/RadarTracks"
DETECTIONS_3D = "vision_msgs/msg/Detection3DArray"
TRACKED_OBJECTS = "autoware_perception_msgs/msg/TrackedObjects"

UNKNOWN_VARIANCE = 1e6  # [m2, m2/s2, ...]
UNKNOWN_ANGLE_VARIANCE = math.pi**2  # [rad2]
# 99 % of chi squared with 2 degrees of freedom: a velocity beyond it has a direction.
MOVING_THRESHOLD = 9.21
STATIONARY_BELOW_MPS = 0.5
# Of tracks that come without a probability of existence; of confirmed ones 1.
TENTATIVE_EXISTENCE = 0.5

MakeMessage = Callable[..., Any]


def ros_message(kind: str, **fields: Any) -> Any:
    """Return a message of rclpy; raise ``ImportError`` if its package is not installed here."""
    return message_class(kind)(**fields)


def bag_message(kind: str, **fields: Any) -> Any:
    """Return a message of the rosbags library, which needs no package."""
    from gda_tracker.io.bag_types import type_store

    return type_store().types[kind](**fields)


@dataclass(frozen=True, slots=True)
class _Object:
    """One track, as the formats need it.

    ``position`` (2,), ``velocity`` (2,) with covariances (2, 2) and ``cross`` (2, 2) between them;
    ``yaw_variance`` is that of any direction unless it ``moves`` for certain.
    """

    track_id: int
    existence: float
    position: FloatArray
    position_covariance: FloatArray
    velocity: FloatArray
    velocity_covariance: FloatArray
    yaw: float
    yaw_variance: float
    moves: bool
    classes: dict[str, float]


def _objects(tracks: Tracks, p: TrackOutputParameters) -> list[_Object]:
    found = []
    names = tracks.class_names
    for row in range(len(tracks)):
        confirmed = bool(tracks.status[row] == CONFIRMED)
        if not (confirmed or p.tentative):
            continue
        size = tracks.mean.shape[1]
        v = slice(size // 2, size // 2 + 2)
        mean, covariance = tracks.mean[row], tracks.covariance[row]
        velocity, spread = mean[v], covariance[v, v]
        speed = float(np.hypot(*velocity))
        moves = bool(velocity @ np.linalg.solve(spread, velocity) > MOVING_THRESHOLD)
        across = np.array([-velocity[1], velocity[0]])
        found.append(
            _Object(
                int(tracks.track_id[row]),
                _existence(float(tracks.existence_probability[row]), confirmed),
                mean[:2],
                covariance[:2, :2],
                velocity,
                spread,
                math.atan2(velocity[1], velocity[0]) if moves else 0.0,
                min(float(across @ spread @ across) / speed**4, UNKNOWN_ANGLE_VARIANCE)
                if moves
                else UNKNOWN_ANGLE_VARIANCE,
                moves,
                dict(zip(names, tracks.class_probability[row].tolist(), strict=True))
                if tracks.class_probability.shape[1]
                else {},
            )
        )
    return found


def _existence(known: float, confirmed: bool) -> float:
    """Probability of existence of a track; where the tracker tells none, by its status."""
    if math.isfinite(known):
        return known
    return 1.0 if confirmed else TENTATIVE_EXISTENCE


def _header(tracks: Tracks, make: MakeMessage) -> Any:
    seconds, nanoseconds = split_stamp(tracks.key.stamp_ns)
    stamp = make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=tracks.frame_id)


def _vector(make: MakeMessage, kind: str, x: float, y: float, z: float = 0.0) -> Any:
    return make(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=float(z))


def _size(make: MakeMessage, p: TrackOutputParameters) -> Any:
    return _vector(make, "Vector3", *p.object_size_m)


def _uuid(tracks: Tracks, track_id: int, make: MakeMessage) -> Any:
    """Identity of a track: the same for the same system and id, different for all others."""
    made = uuid.uuid5(uuid.UUID(bytes=tracks.system_uuid), str(track_id))
    value = np.frombuffer(made.bytes, dtype=np.uint8)
    return make("unique_identifier_msgs/msg/UUID", uuid=value)


def _pose(o: _Object, p: TrackOutputParameters, make: MakeMessage) -> Any:
    half = 0.5 * o.yaw
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
    return make(
        "geometry_msgs/msg/Pose",
        position=_vector(make, "Point", *o.position, p.height_m),
        orientation=make("geometry_msgs/msg/Quaternion", **turn),
    )


def _pose_with_covariance(o: _Object, p: TrackOutputParameters, make: MakeMessage) -> Any:
    """Pose with its covariance (6, 6) over x, y, z and turns about x, y, z [m2, rad2]."""
    covariance = np.diag([0.0, 0.0, p.height_std_m**2, *[UNKNOWN_ANGLE_VARIANCE] * 3])
    covariance[:2, :2] = o.position_covariance
    covariance[5, 5] = o.yaw_variance
    return make(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=_pose(o, p, make),
        covariance=covariance.ravel(),
    )


def radar_tracks(
    tracks: Tracks, parameters: TrackOutputParameters, make: MakeMessage = ros_message
) -> Any:
    """Return tracks as ``radar_msgs/RadarTracks``, in the tracking frame.

    ``make(type, **fields)`` makes messages of one library, see :func:`ros_message`.
    """
    numbers = parameters.mapping("radar_classes")

    def upper(xy: FloatArray, z: float) -> FloatArray:
        """Six numbers xx, xy, xz, yy, yz, zz of a covariance."""
        return np.array([xy[0, 0], xy[0, 1], 0.0, xy[1, 1], 0.0, z], dtype=np.float32)

    unknown = upper(UNKNOWN_VARIANCE * np.eye(2), UNKNOWN_VARIANCE)
    found = []
    for o in _objects(tracks, parameters):
        likely = max(o.classes, key=o.classes.__getitem__, default="")
        found.append(
            make(
                "radar_msgs/msg/RadarTrack",
                uuid=_uuid(tracks, o.track_id, make),
                position=_vector(make, "Point", *o.position, parameters.height_m),
                velocity=_vector(make, "Vector3", *o.velocity),
                acceleration=_vector(make, "Vector3", 0.0, 0.0),
                size=_size(make, parameters),
                classification=int(numbers.get(likely, 0)),
                position_covariance=upper(o.position_covariance, parameters.height_std_m**2),
                velocity_covariance=upper(o.velocity_covariance, UNKNOWN_VARIANCE),
                acceleration_covariance=unknown,
                size_covariance=unknown,
            )
        )
    return make(RADAR_TRACKS, header=_header(tracks, make), tracks=found)


def detections_3d(
    tracks: Tracks, parameters: TrackOutputParameters, make: MakeMessage = ros_message
) -> Any:
    """Return tracks as ``vision_msgs/Detection3DArray``: a hypothesis per class, ``id`` the track.

    A track whose classes are not known has one hypothesis without a name.
    """
    texts = parameters.mapping("vision_classes")
    header, found = _header(tracks, make), []
    for o in _objects(tracks, parameters):
        pose = _pose_with_covariance(o, parameters, make)
        results = [
            make(
                "vision_msgs/msg/ObjectHypothesisWithPose",
                hypothesis=make(
                    "vision_msgs/msg/ObjectHypothesis",
                    class_id=texts.get(name, name),
                    score=float(probability),
                ),
                pose=pose,
            )
            for name, probability in (o.classes or {"": 1.0}).items()
        ]
        box = make(
            "vision_msgs/msg/BoundingBox3D",
            center=_pose(o, parameters, make),
            size=_size(make, parameters),
        )
        found.append(
            make(
                "vision_msgs/msg/Detection3D",
                header=header,
                results=results,
                bbox=box,
                id=str(o.track_id),
            )
        )
    return make(DETECTIONS_3D, header=header, detections=found)


def tracked_objects(
    tracks: Tracks, parameters: TrackOutputParameters, make: MakeMessage = ros_message
) -> Any:
    """Return tracks as ``autoware_perception_msgs/TrackedObjects``.

    The twist is along the object's own axes. Where the velocity has no certain direction the
    orientation is none and the axes are those of the tracking frame.
    """
    labels = {
        name: AUTOWARE_LABELS[label]
        for name, label in parameters.mapping("autoware_classes").items()
    }
    found = []
    for o in _objects(tracks, parameters):
        by_label: dict[int, float] = {}
        for name, probability in (o.classes or {"": 1.0}).items():
            label = labels.get(name, AUTOWARE_LABELS["UNKNOWN"])
            by_label[label] = by_label.get(label, 0.0) + probability
        kinematics = make(
            "autoware_perception_msgs/msg/TrackedObjectKinematics",
            pose_with_covariance=_pose_with_covariance(o, parameters, make),
            twist_with_covariance=_twist_with_covariance(o, make),
            acceleration_with_covariance=make(
                "geometry_msgs/msg/AccelWithCovariance",
                accel=_screw(make, "Accel", np.zeros(2)),
                covariance=np.diag(np.full(6, UNKNOWN_VARIANCE)).ravel(),
            ),
            orientation_availability=2 if o.moves else 0,
            is_stationary=not o.moves and float(np.hypot(*o.velocity)) < STATIONARY_BELOW_MPS,
        )
        shape = make(
            "autoware_perception_msgs/msg/Shape",
            type=0,  # a bounding box
            footprint=make("geometry_msgs/msg/Polygon", points=[]),
            dimensions=_size(make, parameters),
        )
        found.append(
            make(
                "autoware_perception_msgs/msg/TrackedObject",
                object_id=_uuid(tracks, o.track_id, make),
                existence_probability=o.existence,
                classification=[
                    make(
                        "autoware_perception_msgs/msg/ObjectClassification",
                        label=label,
                        probability=float(probability),
                    )
                    for label, probability in by_label.items()
                ],
                kinematics=kinematics,
                shape=shape,
            )
        )
    return make(TRACKED_OBJECTS, header=_header(tracks, make), objects=found)


def _screw(make: MakeMessage, kind: str, linear: FloatArray) -> Any:
    return make(
        f"geometry_msgs/msg/{kind}",
        linear=_vector(make, "Vector3", *linear),
        angular=_vector(make, "Vector3", 0.0, 0.0),
    )


def _twist_with_covariance(o: _Object, make: MakeMessage) -> Any:
    """Velocity along the object's own axes, with its covariance (6, 6)."""
    cosine, sine = math.cos(o.yaw), math.sin(o.yaw)
    to_object = np.array([[cosine, sine], [-sine, cosine]])
    covariance = np.diag(np.full(6, UNKNOWN_VARIANCE))
    covariance[:2, :2] = to_object @ o.velocity_covariance @ to_object.T
    return make(
        "geometry_msgs/msg/TwistWithCovariance",
        twist=_screw(make, "Twist", to_object @ o.velocity),
        covariance=covariance.ravel(),
    )


# Format by the parameter that names its topic: type of the message, and how it is made.
FORMATS: dict[str, tuple[str, Callable[..., Any]]] = {
    "radar_tracks": (RADAR_TRACKS, radar_tracks),
    "detections_3d": (DETECTIONS_3D, detections_3d),
    "tracked_objects": (TRACKED_OBJECTS, tracked_objects),
}
