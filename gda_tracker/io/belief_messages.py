"""The ring's inner messages: evidence, predictions, attribute scores, associations.

Every ``..._to_message`` makes a message of ``gda_tracker_msgs``; every ``..._from_message`` reads
one and raises :class:`~gda_tracker.io.fields.MessageError` if the sizes of its fields contradict
each other. Values come back bit for bit; arrays are read-only views (see
:mod:`gda_tracker.io.fields`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.io.extent_messages import extents_from_message, extents_to_message
from gda_tracker.io.fields import (
    MessageError,
    bools_from_field,
    bools_to_field,
    floats_from_field,
    floats_to_field,
    indices_from_field,
    indices_to_field,
    int32_from_field,
    int32_to_field,
    int64_from_field,
    int64_to_field,
    masks_from_field,
    masks_to_field,
    require_size,
    reshape,
)
from gda_tracker.io.group_fields import (
    RESOLUTION_SETTINGS,
    group_candidates_from_message,
    groups_from_message,
    groups_to_message,
    resolution_from_message,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import (
    BELIEF_ROW,
    NO_ROW,
    Associations,
    AssociationSettings,
    Predictions,
)

STATE_SIZE = 4  # of a message without components: x, y, vx, vy


def _names(field: Any) -> tuple[str, ...]:
    return tuple(str(name) for name in field)


def _floats(message: Any, name: str, *shape: int) -> FloatArray:
    values = floats_from_field(getattr(message, name))
    return require_size(values, *shape, name) if len(shape) == 1 else reshape(values, shape, name)


def _pair_detections(message: Any, hypothesis: Int32Array) -> Int32Array:
    return require_size(int32_from_field(message.detection), len(hypothesis), "detection")


def evidence_to_message(evidence: Evidence) -> Any:
    """Return an ``Evidence`` message."""
    from gda_tracker_msgs.msg import Evidence as Message

    message = Message(key=key_to_message(evidence.key))
    message.frame = [str(name) for name in evidence.frame]
    message.focal = masks_to_field(evidence.focal)
    message.masses = floats_to_field(evidence.masses)
    message.class_names = [str(name) for name in evidence.class_names]
    message.log_class_likelihood = floats_to_field(evidence.log_class_likelihood)
    message.class_probability = floats_to_field(evidence.class_probability)
    message.informative = bools_to_field(evidence.informative)
    return message


def evidence_from_message(message: Any) -> Evidence:
    """Return the evidence in an ``Evidence`` message; n is the size of ``informative``."""
    informative = bools_from_field(message.informative)
    focal = masks_from_field(message.focal)
    class_names = _names(message.class_names)
    count, classes = len(informative), len(class_names)
    return Evidence(
        key=key_from_message(message.key),
        frame=_names(message.frame),
        focal=focal,
        masses=_floats(message, "masses", count, len(focal)),
        class_names=class_names,
        log_class_likelihood=_floats(message, "log_class_likelihood", count, classes),
        class_probability=_floats(message, "class_probability", count, classes),
        informative=informative,
    )


def predictions_to_message(predictions: Predictions) -> Any:
    """Return a ``Predictions`` message.

    Raises
    ------
    MessageError
        If a motion model's number is not in 0 ... 255.
    """
    from gda_tracker_msgs.msg import Predictions as Message

    settings = predictions.settings
    message = Message(key=key_to_message(predictions.key))
    message.decision = str(settings.decision)
    message.attribute_term = str(settings.attribute_term)
    message.missed_track_hypotheses = str(settings.missed_track_hypotheses)
    message.gate_probability = float(settings.gate_probability)
    message.clutter_density = float(settings.clutter_density)
    message.degraded = bool(settings.degraded)
    message.history_policy = str(settings.history_policy)
    if settings.history_policy == "forgetting":
        message.forgetting_factor = [float(settings.forgetting_factor)]
    if settings.resolution_range_m > 0.0:
        message.resolution = [float(getattr(settings, name)) for name in RESOLUTION_SETTINGS]
    message.hypothesis_id = int64_to_field(predictions.hypothesis_id)
    message.parent_id = int64_to_field(predictions.parent_id)
    message.track_id = int64_to_field(predictions.track_id)
    message.detection_probability = floats_to_field(predictions.detection_probability)
    message.component_start = int32_to_field(predictions.component_start)
    message.component_weight = floats_to_field(predictions.component_weight)
    message.component_model = indices_to_field(predictions.component_model, "component_model")
    message.component_mean = floats_to_field(predictions.component_mean)
    message.component_covariance = floats_to_field(predictions.component_covariance)
    message.frame = [str(name) for name in predictions.frame]
    message.focal = masks_to_field(predictions.focal)
    message.masses = floats_to_field(predictions.masses)
    message.class_names = [str(name) for name in predictions.class_names]
    message.class_probability = floats_to_field(predictions.class_probability)
    if predictions.window_kind.size:
        message.window_focal = masks_to_field(predictions.window_focal)
        message.window_kind = indices_to_field(predictions.window_kind, "window_kind")
        message.window_masses = floats_to_field(predictions.window_masses)
        message.window_log_class_likelihood = floats_to_field(
            predictions.window_log_class_likelihood
        )
    if predictions.extents is not None:
        extents_to_message(predictions.extents, message)
    if len(predictions.strength_shape):
        message.strength_shape = floats_to_field(predictions.strength_shape)
        message.strength_scale = floats_to_field(predictions.strength_scale)
        message.signal_threshold = float(settings.signal_threshold)
        message.clutter_strength = float(settings.clutter_strength)
    message.group_candidate = bools_to_field(predictions.group_candidate)
    return message


def predictions_from_message(message: Any) -> Predictions:
    """Return the predictions in a ``Predictions`` message.

    Without components the state dimension is not in the message: it comes back as 4.

    Raises
    ------
    MessageError
        If sizes contradict each other, or a row of a window is of an unknown kind.
    """
    hypothesis_id = int64_from_field(message.hypothesis_id)
    component_weight = floats_from_field(message.component_weight)
    focal = masks_from_field(message.focal)
    class_names = _names(message.class_names)
    hypotheses, components = len(hypothesis_id), len(component_weight)
    mean = floats_from_field(message.component_mean)
    state_size = max(len(mean) // components, 1) if components else STATE_SIZE
    model = indices_from_field(message.component_model)
    strengths = _strengths_from_message(message, hypotheses)
    return Predictions(
        key=key_from_message(message.key),
        settings=AssociationSettings(
            decision=str(message.decision),
            attribute_term=str(message.attribute_term),
            missed_track_hypotheses=str(message.missed_track_hypotheses),
            gate_probability=float(message.gate_probability),
            clutter_density=float(message.clutter_density),
            degraded=bool(message.degraded),
            history_policy=str(message.history_policy) or "none",
            forgetting_factor=_optional_float(message, "forgetting_factor", 1.0),
            # Of bags from before there were strengths these are not numbers.
            signal_threshold=float(message.signal_threshold) if strengths else 0.0,
            clutter_strength=float(message.clutter_strength) if strengths else 0.0,
            **resolution_from_message(message),
        ),
        hypothesis_id=hypothesis_id,
        parent_id=require_size(int64_from_field(message.parent_id), hypotheses, "parent_id"),
        track_id=require_size(int64_from_field(message.track_id), hypotheses, "track_id"),
        detection_probability=_floats(message, "detection_probability", hypotheses),
        component_start=_component_start(message, hypotheses, components),
        component_weight=component_weight,
        component_model=require_size(model, components, "component_model"),
        component_mean=reshape(mean, (components, state_size), "component_mean"),
        component_covariance=_floats(
            message, "component_covariance", components, state_size, state_size
        ),
        frame=_names(message.frame),
        focal=focal,
        masses=_floats(message, "masses", hypotheses, len(focal)),
        class_names=class_names,
        class_probability=_floats(message, "class_probability", hypotheses, len(class_names)),
        **_window_from_message(message, hypotheses, len(class_names)),
        extents=extents_from_message(message, hypotheses),
        **strengths,
        group_candidate=group_candidates_from_message(message, hypotheses),
    )


def _optional_float(message: Any, name: str, missing: float) -> float:
    values = floats_from_field(getattr(message, name))
    return float(require_size(values, 1, name)[0]) if len(values) else missing


def _window_from_message(message: Any, hypotheses: int, classes: int) -> dict[str, Any]:
    """Return the fields of a window; none for a message without one."""
    kind = indices_from_field(message.window_kind)
    if not len(kind):
        for name in ("window_focal", "window_masses", "window_log_class_likelihood"):
            if len(getattr(message, name)):
                raise MessageError(f"{name} has elements, window_kind has none")
        return {}
    if kind.max() > BELIEF_ROW:
        raise MessageError(f"window_kind holds {kind.max()}: allowed is {NO_ROW} to {BELIEF_ROW}")
    rows = len(kind) // max(hypotheses, 1)
    focal = masks_from_field(message.window_focal)
    return {
        "window_focal": focal,
        "window_kind": reshape(kind, (hypotheses, rows), "window_kind"),
        "window_masses": _floats(message, "window_masses", hypotheses, rows, len(focal)),
        "window_log_class_likelihood": _floats(
            message, "window_log_class_likelihood", hypotheses, rows, classes
        ),
    }


def _strengths_from_message(message: Any, hypotheses: int) -> dict[str, Any]:
    """Return the fields of signal strength; none for a message without."""
    names = ("strength_shape", "strength_scale")
    if not any(len(getattr(message, name)) for name in names):
        return {}
    return {name: _floats(message, name, hypotheses) for name in names}


def _component_start(message: Any, hypotheses: int, components: int) -> Int32Array:
    start = require_size(
        int32_from_field(message.component_start), hypotheses + 1, "component_start"
    )
    if start[0] != 0 or start[-1] != components or np.any(start[1:] < start[:-1]):
        raise MessageError(f"component_start does not rise from 0 to {components}")
    return start


def attribute_scores_to_message(scores: AttributeScores) -> Any:
    """Return an ``AttributeScores`` message."""
    from gda_tracker_msgs.msg import AttributeScores as Message

    message = Message(key=key_to_message(scores.key))
    message.attribute_term = str(scores.attribute_term)
    message.has_distance = bool(scores.has_distance)
    message.hypothesis = int32_to_field(scores.hypothesis)
    message.detection = int32_to_field(scores.detection)
    message.distance = floats_to_field(scores.distance)
    message.log_likelihood = floats_to_field(scores.log_likelihood)
    message.conflict = floats_to_field(scores.conflict)
    message.informative = bools_to_field(scores.informative)
    message.clutter_log_likelihood = floats_to_field(scores.clutter_log_likelihood)
    message.frame = [str(name) for name in scores.frame]
    message.focal = masks_to_field(scores.focal)
    message.masses = floats_to_field(scores.masses)
    message.class_names = [str(name) for name in scores.class_names]
    message.class_probability = floats_to_field(scores.class_probability)
    message.updated_hypothesis = int32_to_field(scores.updated_hypothesis)
    message.updated_masses = floats_to_field(scores.updated_masses)
    message.updated_class_probability = floats_to_field(scores.updated_class_probability)
    return message


def attribute_scores_from_message(message: Any) -> AttributeScores:
    """Return the scores in an ``AttributeScores`` message; P is the size of ``hypothesis``."""
    hypothesis = int32_from_field(message.hypothesis)
    focal = masks_from_field(message.focal)
    class_names = _names(message.class_names)
    pairs = len(hypothesis)
    informative = bools_from_field(message.informative)
    updated = int32_from_field(message.updated_hypothesis)
    return AttributeScores(
        key=key_from_message(message.key),
        attribute_term=str(message.attribute_term),
        has_distance=bool(message.has_distance),
        hypothesis=hypothesis,
        detection=_pair_detections(message, hypothesis),
        distance=_floats(message, "distance", pairs),
        log_likelihood=_floats(message, "log_likelihood", pairs),
        conflict=_floats(message, "conflict", pairs),
        informative=require_size(informative, pairs, "informative"),
        clutter_log_likelihood=floats_from_field(message.clutter_log_likelihood),
        frame=_names(message.frame),
        focal=focal,
        masses=_floats(message, "masses", pairs, len(focal)),
        class_names=class_names,
        class_probability=_floats(message, "class_probability", pairs, len(class_names)),
        updated_hypothesis=updated,
        updated_masses=_floats(message, "updated_masses", len(updated), len(focal)),
        updated_class_probability=_floats(
            message, "updated_class_probability", len(updated), len(class_names)
        ),
    )


def associations_to_message(associations: Associations) -> Any:
    """Return an ``Associations`` message.

    Raises
    ------
    MessageError
        If an engine's number is not in 0 ... 255.
    """
    from gda_tracker_msgs.msg import Associations as Message

    message = Message(key=key_to_message(associations.key))
    message.decision = str(associations.decision)
    message.attribute_term = str(associations.attribute_term)
    message.degraded = bool(associations.degraded)
    message.hypothesis = int32_to_field(associations.hypothesis)
    message.detection = int32_to_field(associations.detection)
    for name in _PAIR_FLOATS:
        setattr(message, name, floats_to_field(getattr(associations, name)))
    message.chosen = bools_to_field(associations.chosen)
    message.cluster = int32_to_field(associations.cluster)
    message.assigned_detection = int32_to_field(associations.assigned_detection)
    message.cluster_engine = indices_to_field(associations.cluster_engine, "cluster_engine")
    message.cluster_converged = bools_to_field(associations.cluster_converged)
    message.engine_names = [str(name) for name in associations.engine_names]
    groups_to_message(associations, message)
    return message


_PAIR_FLOATS = (
    "mahalanobis_squared",
    "kinematic_log_likelihood",
    "attribute_log_likelihood",
    "p_kinematic",
    "p_attribute",
    "p_generalised",
    "joint_marginal",
)


def associations_from_message(message: Any) -> Associations:
    """Return the decision in an ``Associations`` message; P is the size of ``hypothesis``."""
    hypothesis = int32_from_field(message.hypothesis)
    pairs = len(hypothesis)
    cluster_engine = indices_from_field(message.cluster_engine)
    converged = bools_from_field(message.cluster_converged)
    return Associations(
        key=key_from_message(message.key),
        decision=str(message.decision),
        attribute_term=str(message.attribute_term),
        degraded=bool(message.degraded),
        hypothesis=hypothesis,
        detection=_pair_detections(message, hypothesis),
        chosen=require_size(bools_from_field(message.chosen), pairs, "chosen"),
        cluster=require_size(int32_from_field(message.cluster), pairs, "cluster"),
        assigned_detection=int32_from_field(message.assigned_detection),
        cluster_engine=cluster_engine,
        cluster_converged=require_size(converged, len(cluster_engine), "cluster_converged"),
        engine_names=_names(message.engine_names),
        **{name: _floats(message, name, pairs) for name in _PAIR_FLOATS},
        **groups_from_message(message),
    )
