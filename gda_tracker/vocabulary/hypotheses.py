"""Hypotheses: where the tracks are expected, and which detection each one gets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.extents import PredictedExtents
from gda_tracker.vocabulary.scans import ScanKey

# What is carried on of a track's attribute history.
HISTORY_POLICIES = ("none", "forgetting", "window")

# Kinds of rows in a history window: none yet, the evidence of a detection, a belief that was there
# before the window was (of initial tracks, or when the policy changed).
NO_ROW, EVIDENCE_ROW, BELIEF_ROW = 0, 1, 2


@dataclass(slots=True, frozen=True)
class AssociationSettings:
    """The settings that hold for one scan; they travel in ``Predictions``.

    ``clutter_density`` has the unit 1/(m rad): detections per measurement volume that belong to no
    track. ``degraded``: the track manager has given up the attribute scores; kinematics alone
    decide. ``history_policy`` is one of ``HISTORY_POLICIES``; ``forgetting_factor``, the share of
    the history kept at each detection with a known attribute, goes with ``forgetting``; how long
    the window is shows in the predictions' arrays. ``signal_threshold`` lambda and
    ``clutter_strength`` c, in mean noise powers, go with the strengths of ``Predictions``.
    ``resolution_range_m`` and ``resolution_azimuth_rad`` are the distances at which half of the
    pairs of targets are resolved, 0 for a sensor that resolves all;
    ``unresolved_detection_probability`` goes with them.
    """

    decision: str = "gda"
    attribute_term: str = "none"
    missed_track_hypotheses: str = "zero"
    gate_probability: float = 0.99
    clutter_density: float = 1e-6
    degraded: bool = False
    history_policy: str = "none"
    forgetting_factor: float = 1.0
    signal_threshold: float = 0.0
    clutter_strength: float = 0.0
    resolution_range_m: float = 0.0
    resolution_azimuth_rad: float = 0.0
    unresolved_detection_probability: float = 0.0


@dataclass(slots=True)
class Predictions:
    """H hypotheses predicted to the time of the scan; message ``Predictions``.

    A hypothesis is a Gaussian mixture: components ``component_start[h]`` to ``component_start[h +
    1]`` of ``component_weight`` (K,), ``component_mean`` (K, s) [m, m/s] and
    ``component_covariance`` (K, s, s); the state is all positions, then all velocities. ``masses``
    (H, E) over ``focal`` and ``class_probability`` (H, C) are the attribute histories.

    With the history policy ``window`` of W detections, and else empty: the last W - 1 rows of
    evidence of each hypothesis, the newest last, missing ones first. ``window_kind`` (H, W - 1)
    says what a row is (``NO_ROW``, ``EVIDENCE_ROW``, ``BELIEF_ROW``); ``window_masses`` (H, W - 1,
    F) over the Venn bitmasks ``window_focal`` (F,) and ``window_log_class_likelihood`` (H, W - 1,
    C) are those of ``Evidence``; of a ``BELIEF_ROW`` the latter are log class probabilities.

    ``extents`` are there where hypotheses are extended objects.

    Where signal strength counts on this scan, and else empty: ``strength_shape`` and
    ``strength_scale`` (H,) of the inverse Gamma density of 1 + mean strength
    (:mod:`gda_tracker.kinematics.signal_strength`), on which ``detection_probability`` rests.

    ``group_candidate`` (H,) marks the hypotheses that may share a detection with another one's; no
    entries where the sensor resolves all.
    """

    key: ScanKey
    settings: AssociationSettings
    hypothesis_id: IntArray
    parent_id: IntArray
    track_id: IntArray
    detection_probability: FloatArray
    component_start: Int32Array
    component_weight: FloatArray
    component_model: Int32Array
    component_mean: FloatArray
    component_covariance: FloatArray
    frame: tuple[str, ...] = ()
    focal: MaskArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    class_names: tuple[str, ...] = ()
    class_probability: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    window_focal: MaskArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    window_kind: Int32Array = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int32))
    window_masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 0))
    window_log_class_likelihood: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 0))
    extents: PredictedExtents | None = None
    strength_shape: FloatArray = field(default_factory=empty_floats)
    strength_scale: FloatArray = field(default_factory=empty_floats)
    group_candidate: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    def __len__(self) -> int:
        return len(self.hypothesis_id)


@dataclass(slots=True)
class Associations:
    """The decision on one scan for P gated pairs of H hypotheses; message ``Associations``.

    Per pair (P,): ``kinematic_log_likelihood`` [log 1/(m rad)], with the ratio of the signal's
    strength where that counts, ``p_kinematic`` P_k (14.4.1), ``p_attribute`` P_a = 1 - P'_a
    (14.4.2), ``p_generalised`` P_k P_a, ``joint_marginal`` from the joint kinematic and attribute
    likelihood (decision ``jpda``: after the coalescence remedy), ``chosen``.
    ``assigned_detection`` (H,) is the row in the scan or -1. ``cluster_engine`` (G,) indexes
    ``engine_names``; ``cluster_converged`` (G,) is False where an approximate engine did not
    settle.

    Of targets that the sensor may not have resolved, and else empty, E events (E,): the hypotheses
    ``group_first`` and ``group_second`` of two tracks gave the one detection ``group_detection``
    between them, or none (-1). ``group_unresolved`` is the probability P_u that the two are not
    resolved, ``group_log_likelihood`` [log 1/(m rad)] that of the detection, ``group_marginal`` the
    probability of the event, ``group_chosen`` marks those decided for; a chosen event gives its
    detection to both, and none of their pairs is chosen.
    """

    key: ScanKey
    decision: str
    attribute_term: str
    degraded: bool
    hypothesis: Int32Array
    detection: Int32Array
    mahalanobis_squared: FloatArray
    kinematic_log_likelihood: FloatArray
    attribute_log_likelihood: FloatArray
    p_kinematic: FloatArray
    p_attribute: FloatArray
    p_generalised: FloatArray
    joint_marginal: FloatArray
    chosen: BoolArray
    cluster: Int32Array
    assigned_detection: Int32Array
    cluster_engine: Int32Array
    cluster_converged: BoolArray
    engine_names: tuple[str, ...]
    group_first: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    group_second: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    group_detection: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    group_unresolved: FloatArray = field(default_factory=empty_floats)
    group_log_likelihood: FloatArray = field(default_factory=empty_floats)
    group_marginal: FloatArray = field(default_factory=empty_floats)
    group_chosen: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
