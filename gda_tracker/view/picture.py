"""What there is to see of one scan: detections, gates, tracks and the terms of the decision.

A picture is made of what went round the ring and keeps of it what the page can show; what is large
and not shown (histories of hypotheses, candidate beliefs) is left out.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.formations.found import Formations
from gda_tracker.kinematics.measurement_curves import measurement_curves
from gda_tracker.kinematics.measurement_models import locates
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.tracking.gates import Gates, gates_of
from gda_tracker.tracking.ring import RingResult
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, empty_floats
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, AssociationSettings, Predictions
from gda_tracker.vocabulary.scans import Scan, ScanReport
from gda_tracker.vocabulary.tracks import Tracks

FARTHEST_WITHOUT_TRACKS_M = 20_000.0


@dataclass(slots=True)
class Sightings:
    """n detections in the tracking plane.

    ``range_m``, ``azimuth_rad`` (n,) as seen from the sensor, counter-clockwise from the x axis of
    the tracking frame; ``rcs_m2`` (n,) NaN where unknown; ``range_rate_mps`` (n,) NaN where not
    measured; ``source_index`` (n,) row in the source's ``Detections``. Of a sensor that does not
    locate range and azimuth are NaN, and ``curves`` (n, P, 2) are points [m] on the rays, circles,
    ellipses or hyperbolas of its detections.
    """

    range_m: FloatArray
    azimuth_rad: FloatArray
    rcs_m2: FloatArray
    range_rate_mps: FloatArray
    source_index: Int32Array
    curves: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 2))


@dataclass(slots=True)
class Decision:
    """What the association matrix is made of; candidate beliefs and states are left out."""

    predictions: Predictions
    scores: AttributeScores | None
    associations: Associations


@dataclass(slots=True)
class Picture:
    """One scan as the page shows it.

    ``sensor_xy_m`` (2,) and ``sensor_yaw_rad`` in the tracking frame. ``gates`` and ``decision``
    are ``None`` where the scan was not associated, or where its messages have not come,
    ``formations`` where nobody follows them.
    """

    report: ScanReport
    tracks: Tracks
    sensor_xy_m: FloatArray
    sensor_yaw_rad: float
    sightings: Sightings
    settings: AssociationSettings | None = None
    gates: Gates | None = None
    decision: Decision | None = None
    formations: Formations | None = None

    @property
    def stamp_ns(self) -> int:
        """Time of the scan."""
        return int(self.report.key.stamp_ns)

    @property
    def size_bytes(self) -> int:
        """What its arrays take."""
        return sum(array.nbytes for array in _arrays(self))


def picture_of(result: RingResult, previous: Tracks | None = None) -> Picture | None:
    """Make the picture of a scan; ``None`` for one that was rejected, of which there is nothing.

    ``previous`` are the tracks after the scan before: of the hypotheses of a track, the gate shown
    is that of the one that spoke for it then.
    """
    if result.tracks is None:
        return None
    scan, predictions = result.scan, result.predictions
    picture = Picture(result.report, result.tracks, np.zeros(2), 0.0, _no_sightings())
    if scan is None:
        return picture
    x, y, z, w = (float(value) for value in scan.sensor_orientation_xyzw)
    # The yaw of any attitude: where the sensor's x axis points in the plane.
    picture.sensor_yaw_rad = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    picture.sensor_xy_m = np.array(scan.sensor_position_m[:2])
    picture.sightings = _sightings(scan, result.tracks)
    if predictions is None:
        return picture
    picture.settings = predictions.settings
    picture.gates = gates_of(scan, predictions, previous)
    if result.associations is not None:
        picture.decision = _decision(predictions, result.scores, result.associations)
    return picture


def _no_sightings() -> Sightings:
    none = empty_floats()
    return Sightings(none, none, none, none, np.zeros(0, dtype=np.int32))


def _sightings(scan: Scan, tracks: Tracks) -> Sightings:
    unknown = np.full(len(scan), np.nan)
    rate = scan.range_rate_mps
    sightings = Sightings(
        unknown,
        unknown,
        np.where(scan.rcs_valid, scan.rcs_m2, np.nan),
        unknown if rate is None else rate,
        scan.source_index,
    )
    if locates(scan):
        polar = polar_measurements(scan)
        sightings.range_m, sightings.azimuth_rad = polar.range_m, polar.azimuth_rad
    else:
        sightings.curves = measurement_curves(scan, _farthest(scan, tracks))
    return sightings


def _farthest(scan: Scan, tracks: Tracks) -> float:
    """How far curves are followed [m]: three times as far as there are tracks."""
    gap = tracks.mean[:, :2] - scan.sensor_position_m[:2]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    farthest = float(distance[np.isfinite(distance)].max(initial=0.0))
    return 3.0 * farthest if farthest > 0.0 else FARTHEST_WITHOUT_TRACKS_M


def _decision(
    predictions: Predictions, scores: AttributeScores | None, associations: Associations
) -> Decision:
    """Keep what the terms of the pairs are made of."""
    none, nothing = empty_floats(0, 0), empty_floats()
    kept = dataclasses.replace(
        predictions,
        component_start=np.zeros(0, dtype=np.int32),
        component_weight=nothing,
        component_model=np.zeros(0, dtype=np.int32),
        component_mean=none,
        component_covariance=empty_floats(0, 0, 0),
        masses=none,
        class_probability=none,
        window_kind=np.zeros((0, 0), dtype=np.int32),
        window_masses=empty_floats(0, 0, 0),
        window_log_class_likelihood=empty_floats(0, 0, 0),
    )
    if scores is not None:
        scores = dataclasses.replace(scores, masses=none, class_probability=none)
    return Decision(kept, scores, associations)


def _arrays(value: object) -> list[np.ndarray]:
    """All arrays of a tree of dataclasses."""
    if isinstance(value, np.ndarray):
        return [value]
    if not dataclasses.is_dataclass(value):
        return []
    found: list[np.ndarray] = []
    for item in dataclasses.fields(value):
        found += _arrays(getattr(value, item.name))
    return found
