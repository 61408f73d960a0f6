"""Stone Soup's trackers on our scans: the peer that benchmarks compare with.

Extended Kalman filter with nearly constant velocity, polar measurements of a sensor that may move,
Mahalanobis gate, global nearest neighbour by 2-D assignment or joint probabilistic data association
(efficient hypothesis management, EHM2), initiation from several detections by nearest neighbour
(https://stonesoup.readthedocs.io). Stone Soup is imported when a tracker is built, nowhere else.
"""

from __future__ import annotations

import datetime
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.vocabulary.scans import Detections, ScanKey
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

VERSION = "1.9.1"
INSTALL = f"Stone Soup is not installed: pip install 'stonesoup=={VERSION}' (the extra 'benchmark')"
EPOCH = datetime.datetime(2000, 1, 1)


def available() -> bool:
    """Whether Stone Soup can be imported."""
    try:
        import stonesoup  # noqa: F401
    except ImportError:
        return False
    return True


@dataclass(frozen=True)
class PeerSettings:
    """Settings of the peer.

    ``process_noise`` [m2/s3] is the spectral density of the acceleration. ``prior_speed_std`` [m/s]
    is what a new track knows of its speed. ``gate_probability`` sets the gate, which is also the
    cost of a missed detection. ``minimum_points`` confirm a track. With ``kdtree_distance`` > 0 a
    k-d tree offers only the detections within that distance in (azimuth [rad], range [m]), so in
    effect in range. ``joint_probabilities`` takes JPDA in place of the GNN; it needs the detection
    probability and the clutter density [1/(m rad)].
    """

    range_std_m: float
    azimuth_std_rad: float
    process_noise: float
    prior_speed_std: float
    gate_probability: float
    minimum_points: int = 3
    tentative_deletion_misses: int = 2
    deletion_misses: int = 4
    kdtree_distance: float = 0.0
    joint_probabilities: bool = False
    detection_probability: float = 0.9
    clutter_density: float = 0.0


def track(
    detections: Sequence[Detections], settings: PeerSettings
) -> tuple[list[Tracks], list[float]]:
    """Run Stone Soup over a recording.

    Returns
    -------
    tracks, cpu_s
        Per scan the confirmed tracks, and the CPU time that the tracker took for it. Making Stone
        Soup's detections from ours and reading its tracks is not counted.
    """
    scans = [_detection_set(d, settings) for d in detections]
    tracker = iter(_tracker(iter(scans), settings))
    ids: dict[str, int] = {}
    found: list[Tracks] = []
    cpu_s: list[float] = []
    for one in detections:
        begin = time.process_time()
        _, live = next(tracker)
        cpu_s.append(time.process_time() - begin)
        found.append(_read_tracks(one, live, ids))
    return found, cpu_s


def _detection_set(detections: Detections, settings: PeerSettings) -> tuple[Any, set[Any]]:
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    from stonesoup.types.angle import Bearing
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection

    # Our azimuth, counter-clockwise from x, is Stone Soup's bearing of the state (x, vx, y, vy).
    model = CartesianToBearingRange(
        ndim_state=4,
        mapping=(0, 2),
        noise_covar=np.diag([settings.azimuth_std_rad**2, settings.range_std_m**2]),
        translation_offset=np.reshape(detections.sensor_position_m[:2], (2, 1)),
    )
    stamp = EPOCH + datetime.timedelta(microseconds=detections.stamp_ns / 1000)
    return stamp, {
        Detection(StateVector([Bearing(azimuth), r]), timestamp=stamp, measurement_model=model)
        for azimuth, r in zip(detections.azimuth_rad, detections.range_m, strict=True)
    }


def _tracker(scans: Iterator[Any], settings: PeerSettings) -> Any:
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    predictor = ExtendedKalmanPredictor(
        CombinedLinearGaussianTransitionModel([ConstantVelocity(settings.process_noise)] * 2)
    )
    updater = ExtendedKalmanUpdater(measurement_model=None)
    gate = math.sqrt(gate_threshold(settings.gate_probability))
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=gate)

    def associator() -> Any:
        if not settings.kdtree_distance:
            return GNNWith2DAssignment(hypothesiser)
        from stonesoup.dataassociator.tree import DetectionKDTreeGNN2D

        return DetectionKDTreeGNN2D(
            hypothesiser,
            predictor=predictor,
            updater=updater,
            max_distance=settings.kdtree_distance,
        )

    variance = settings.prior_speed_std**2
    initiator = MultiMeasurementInitiator(
        prior_state=GaussianState(np.zeros((4, 1)), np.diag([0.0, variance, 0.0, variance])),
        deleter=UpdateTimeStepsDeleter(settings.tentative_deletion_misses),
        data_associator=associator(),
        updater=updater,
        min_points=settings.minimum_points,
    )
    parts = {
        "initiator": initiator,
        "deleter": UpdateTimeStepsDeleter(settings.deletion_misses),
        "detector": scans,
        "updater": updater,
    }
    if not settings.joint_probabilities:
        return MultiTargetTracker(data_associator=associator(), **parts)
    associations = _joint_probabilities(predictor, updater, settings)
    return MultiTargetMixtureTracker(data_associator=associations, **parts)


def _joint_probabilities(predictor: Any, updater: Any, settings: PeerSettings) -> Any:
    from stonesoup.dataassociator.probability import JPDAwithEHM2
    from stonesoup.dataassociator.tree import DetectionKDTreeMixIn
    from stonesoup.hypothesiser.probability import PDAHypothesiser

    hypothesiser = PDAHypothesiser(
        predictor,
        updater,
        clutter_spatial_density=settings.clutter_density,
        prob_detect=settings.detection_probability,
        prob_gate=settings.gate_probability,
    )
    if not settings.kdtree_distance:
        return JPDAwithEHM2(hypothesiser)
    with_tree = type("KDTreeJPDAwithEHM2", (DetectionKDTreeMixIn, JPDAwithEHM2), {})
    return with_tree(
        hypothesiser, predictor=predictor, updater=updater, max_distance=settings.kdtree_distance
    )


def _read_tracks(detections: Detections, live: set[Any], ids: dict[str, int]) -> Tracks:
    """Confirmed tracks in our vocabulary; ids count up by first appearance."""
    states = []
    for one in live:
        x, vx, y, vy = np.asarray(one.state_vector, dtype=np.float64).ravel()
        states.append((ids.setdefault(one.id, len(ids) + 1), x, y, vx, vy))
    states.sort()
    n = len(states)
    return Tracks(
        key=ScanKey(0, detections.sensor_id, detections.stamp_ns),
        track_id=np.array([s[0] for s in states], dtype=np.int64),
        status=np.full(n, CONFIRMED, dtype=np.int64),
        mean=np.array([s[1:] for s in states], dtype=np.float64).reshape(n, 4),
    )
