"""Scans: what a sensor reports, what is admitted, what is answered, what was true."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, empty_floats
from gda_tracker.vocabulary.extents import ScanCells
from gda_tracker.vocabulary.statements import Statement

IDENTITY_QUATERNION = (0.0, 0.0, 0.0, 1.0)


class ScanKey(NamedTuple):
    """Identity of one scan on its way round the ring."""

    epoch: int
    sensor_id: str
    stamp_ns: int


@dataclass(slots=True)
class Detections:
    """One scan of one sensor as published, before any check; message ``DetectionArray``.

    All arrays are (n,) unless said otherwise; ``None`` stands for "not measured". Standard
    deviations are (n,), (1,) for all, or ``None`` for the tracker's own parameter. ``covariance``
    is (n, d, d) over the measured ones of range, azimuth, elevation, range rate, in this order.
    ``attribute_names`` names A further attributes, with their units; ``attribute_values`` and
    ``attribute_valid`` are (A, n), without the latter all values are known.

    Of sensors with a model other than range and azimuth a quantity that is not measured is NaN, or
    ``None`` where it may be; ``sensor_velocity_mps``, ``reference_position_m`` (a transmitter, a
    second receiver) and ``reference_velocity_mps`` are (3,) or ``None``.
    """

    sensor_id: str
    stamp_ns: int
    range_m: FloatArray
    azimuth_rad: FloatArray
    elevation_rad: FloatArray | None = None
    range_rate_mps: FloatArray | None = None
    rcs_m2: FloatArray | None = None
    rcs_valid: BoolArray | None = None
    range_std_m: FloatArray | None = None
    azimuth_std_rad: FloatArray | None = None
    elevation_std_rad: FloatArray | None = None
    range_rate_std_mps: FloatArray | None = None
    covariance: FloatArray | None = None
    time_offset_s: FloatArray | None = None
    sensor_position_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    sensor_orientation_xyzw: FloatArray = field(
        default_factory=lambda: np.array(IDENTITY_QUATERNION)
    )
    frame_id: str = ""
    sequence: int = 0
    attribute_names: tuple[str, ...] = ()
    attribute_values: FloatArray | None = None
    attribute_valid: BoolArray | None = None
    sensor_velocity_mps: FloatArray | None = None
    reference_position_m: FloatArray | None = None
    reference_velocity_mps: FloatArray | None = None


@dataclass(slots=True)
class Scan:
    """An admitted scan: n valid detections with pose and noise filled in; message ``Scan``.

    ``noise_covariance`` is (n, d, d) over range, azimuth[, elevation][, range rate].
    ``source_index`` (n,) is the row of each detection in the source's ``Detections``.
    ``attribute_values`` (A, n), 0 where unknown, and ``attribute_valid`` (A, n) are there where
    ``attribute_names`` (A) names any. ``statements`` were admitted since the last scan.
    ``sensor_model`` names one of :mod:`gda_tracker.kinematics.measurement_models`, empty for range
    and azimuth; then what it does not measure is NaN, and velocity and reference are there.
    With ``cells`` (of extended objects) a row is a cell, several detections put together:
    ``source_index`` is the one nearest to their centroid.
    ``signal_strength`` (n,) is in mean noise powers, NaN where unknown; ``None`` where it plays no
    part. ``relative_clutter_density`` (n,) is the clutter density where each detection is, over the
    mean one of the sensor; ``None``: the same everywhere.
    """

    key: ScanKey
    frame_id: str
    sensor_position_m: FloatArray
    sensor_orientation_xyzw: FloatArray
    source_index: Int32Array
    range_m: FloatArray
    azimuth_rad: FloatArray
    noise_covariance: FloatArray
    rcs_m2: FloatArray
    rcs_valid: BoolArray
    elevation_rad: FloatArray | None = None
    range_rate_mps: FloatArray | None = None
    time_offset_s: FloatArray | None = None
    attribute_names: tuple[str, ...] = ()
    attribute_values: FloatArray | None = None
    attribute_valid: BoolArray | None = None
    statements: tuple[Statement, ...] = ()
    sensor_model: str = ""
    sensor_velocity_mps: FloatArray | None = None
    reference_position_m: FloatArray | None = None
    reference_velocity_mps: FloatArray | None = None
    cells: ScanCells | None = None
    signal_strength: FloatArray | None = None
    relative_clutter_density: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.range_m)

    @property
    def detections(self) -> int:
        """Number of detections, also where rows are cells."""
        return len(self) if self.cells is None else len(self.cells.member)


@dataclass(slots=True)
class ScanReport:
    """The answer to one ``Detections``; message ``ScanReport``.

    ``outcome`` is ``tracked``, ``degraded``, ``gave_up``, ``initialised`` or ``rejected``;
    ``rejected`` counts, by reason, the detections that were left out of an admitted scan. Of
    extended objects ``cells`` counts the groups of detections (else ``None``), and
    ``partition_probability`` says how probable it is that they belong together like that.
    """

    key: ScanKey
    outcome: str
    reason: str = ""
    repeated: bool = False
    latency_s: float = 0.0
    detections_received: int = 0
    detections_admitted: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    tracks_confirmed: int = 0
    tracks_tentative: int = 0
    queue_length: int = 0
    retries: int = 0
    cells: int | None = None
    partition_probability: float = 1.0


@dataclass(slots=True)
class ScanTruth:
    """What really happened on one scan; message ``ScanTruth``.

    ``source_id`` (n,) names the target behind each detection of the source's ``Detections``, -1 for
    clutter, ``None`` where unknown. ``target_state`` is (T, 4): x, y, vx, vy, NaN where unknown.
    ``target_extent`` (T, 2, 2) [m2] are the ellipses y' X^-1 y = 1, zeros for points.
    """

    sensor_id: str
    stamp_ns: int
    target_id: Int32Array
    target_state: FloatArray = field(default_factory=lambda: empty_floats(0, 4))
    source_id: Int32Array | None = None
    target_class: tuple[str, ...] = ()
    run: int = 0
    frame_id: str = ""
    target_extent: FloatArray | None = None
