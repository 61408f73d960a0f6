"""One frame of a radar: named fields of N points and a stamp, whatever it came from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from gda_tracker.errors import UserError
from gda_tracker.io.radar.conversion import RadarScan, detections_of_fields
from gda_tracker.io.radar.ego_motion import SensorVelocity, estimate_sensor_velocity
from gda_tracker.io.radar.file_kinds import DETECTIONS
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.sensor_pose import SensorPose, sensor_pose
from gda_tracker.kinematics.odometry_buffer import OdometryBuffer
from gda_tracker.kinematics.transform_buffer import TransformBuffer
from gda_tracker.parameters import ParameterError
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections

Fields = dict[str, FloatArray]
ReadFields = Callable[[Iterable[str], Mapping[str, str]], Fields]


@dataclass(frozen=True, slots=True)
class RadarFrame:
    """What a radar published at once.

    ``kind`` is the type of the message, or the kind of file. ``types`` are the declared types of
    the fields by name, in their order; ``read`` returns those asked for, (N,) float64 each, read as
    the types given in place of the declared ones. It raises a
    :class:`~gda_tracker.errors.UserError` where the frame contradicts itself. ``sensor_id`` is the
    name that the radar gives itself, if any; it takes the place of the parameter.
    ``attributes`` are fields that are passed on as further attributes unless the parameters name
    others.
    """

    kind: str
    stamp_ns: int
    frame_id: str
    types: Mapping[str, str]
    read: ReadFields
    sensor_id: str = ""
    attributes: tuple[str, ...] = ()


def frame_of_columns(
    kind: str,
    stamp_ns: int,
    frame_id: str,
    columns: Fields,
    sensor_id: str = "",
    attributes: tuple[str, ...] = (),
) -> RadarFrame:
    """Return a frame of columns (N,) that are read already, e.g. of a text file.

    Types in place of the declared ones change nothing: the fields are numbers.
    """

    def read(names: Iterable[str], overrides: Mapping[str, str]) -> Fields:
        return {name: columns[name] for name in names}

    return RadarFrame(
        kind, stamp_ns, frame_id, dict.fromkeys(columns, "number"), read, sensor_id, attributes
    )


def quantities_of_frame(frame: RadarFrame, parameters: RadarInputParameters) -> Fields:
    """Return the fields of a frame by quantity, those of further attributes by their own name.

    Raises
    ------
    UserError
        If a field that the parameters name is not there, or cannot be read.
    """
    present = list(frame.types)
    by_quantity = parameters.fields_of(present)
    wanted = set(by_quantity.values())
    for field in parameters.attributes.values():
        if field not in present:
            raise ParameterError(
                f"parameter attribute_fields: {field}, but the fields are {', '.join(present)}"
            )
        if by_quantity.get(field, field) != field:
            raise ParameterError(
                f"parameter attribute_fields: {field} is also the name of a quantity that "
                f"field_names takes from {by_quantity[field]}"
            )
        wanted.add(field)
    overrides = {name: kind for name, kind in parameters.type_overrides.items() if name in wanted}
    found = frame.read([name for name in present if name in wanted], overrides)
    return {
        **{field: found[field] for field in parameters.attributes.values()},
        **{quantity: found[field] for quantity, field in by_quantity.items()},
    }


def detections_of_frame(
    frame: RadarFrame,
    parameters: RadarInputParameters,
    sequence: int = 0,
    transforms: TransformBuffer | None = None,
    pose: SensorPose | None = None,
    odometry: OdometryBuffer | None = None,
) -> RadarScan:
    """Make detections of a frame, as ``detections_of_fields`` does of fields.

    ``transforms`` and ``odometry`` are needed if the parameters take pose or speed of the radar
    from them, unless the ``pose`` is known already.

    Raises
    ------
    UserError
        If there is no position among the fields, a field that the parameters name is not there,
        the frame contradicts itself, or the radar's pose is not known.
    """
    if pose is None:
        pose = sensor_pose(parameters, transforms, frame.frame_id, frame.stamp_ns, odometry)
    if frame.attributes and not parameters.attribute_fields:
        named = [f"{name}={name}" for name in frame.attributes]
        parameters = replace(parameters, attribute_fields=named)
    fields = quantities_of_frame(frame, parameters)
    found = detections_of_fields(fields, parameters, frame.stamp_ns, frame.frame_id, sequence, pose)
    if frame.sensor_id:
        found.detections.sensor_id = frame.sensor_id
    return found


def sensor_velocity(
    frames: Iterable[RadarFrame], parameters: RadarInputParameters
) -> SensorVelocity | None:
    """Estimate the radar's own velocity from some frames, each for itself; return the median one.

    ``None`` without range rates, or with too few points in every frame.
    """
    every = replace(
        parameters,
        pose_source="declared",
        sensor_speed_mps=0.0,
        sensor_speed_left_mps=0.0,
        sensor_motion="declared",
        moving_above_mps=0.0,
        cluster_distance_m=0.0,
    )
    found = []
    for frame in frames:
        try:
            scan = detections_of_frame(frame, every).detections
        except UserError:
            continue  # whoever reads the frame for its detections hears of it
        if scan.range_rate_mps is None:
            continue
        one = estimate_sensor_velocity(scan.azimuth_rad, scan.elevation_rad, scan.range_rate_mps)
        if one is not None:
            found.append(one)
    if not found:
        return None
    return sorted(found, key=lambda one: (one.ahead_mps, one.left_mps))[len(found) // 2]


def frame_of_detections(scan: Detections) -> RadarFrame:
    """Return detections as a frame, with the fields that were measured; RCS in m2."""
    columns = {
        "range": scan.range_m,
        "azimuth": scan.azimuth_rad,
        "elevation": scan.elevation_rad,
        "range_rate": scan.range_rate_mps,
        "rcs": scan.rcs_m2,
    }
    measured = {name: values for name, values in columns.items() if values is not None}
    if scan.attribute_values is not None:
        measured.update(zip(scan.attribute_names, scan.attribute_values, strict=True))
    return frame_of_columns(DETECTIONS, scan.stamp_ns, scan.frame_id, measured)
