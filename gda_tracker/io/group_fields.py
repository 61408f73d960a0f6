"""Fields of the ring's inner messages about targets that the sensor may not have resolved."""

from __future__ import annotations

from typing import Any

from gda_tracker.io.fields import (
    bools_from_field,
    bools_to_field,
    floats_from_field,
    floats_to_field,
    int32_from_field,
    int32_to_field,
    require_size,
)
from gda_tracker.vocabulary.arrays import BoolArray
from gda_tracker.vocabulary.hypotheses import Associations

RESOLUTION_SETTINGS = (
    "resolution_range_m",
    "resolution_azimuth_rad",
    "unresolved_detection_probability",
)
_INDICES = ("group_first", "group_second", "group_detection")
_FLOATS = ("group_unresolved", "group_log_likelihood", "group_marginal")


def resolution_from_message(message: Any) -> dict[str, float]:
    """Settings of a ``Predictions`` message; none for a sensor that resolves all."""
    values = floats_from_field(message.resolution)
    if not len(values):
        return {}
    values = require_size(values, len(RESOLUTION_SETTINGS), "resolution")
    return dict(zip(RESOLUTION_SETTINGS, values.tolist(), strict=True))


def group_candidates_from_message(message: Any, hypotheses: int) -> BoolArray:
    """Marks of a ``Predictions`` message: (H,), or none."""
    marks = bools_from_field(message.group_candidate)
    return require_size(marks, hypotheses, "group_candidate") if len(marks) else marks


def groups_to_message(associations: Associations, message: Any) -> None:
    """Write the events of groups into an ``Associations`` message."""
    for name in _INDICES:
        setattr(message, name, int32_to_field(getattr(associations, name)))
    for name in _FLOATS:
        setattr(message, name, floats_to_field(getattr(associations, name)))
    message.group_chosen = bools_to_field(associations.group_chosen)


def groups_from_message(message: Any) -> dict[str, Any]:
    """Events of groups in an ``Associations`` message; E is the size of ``group_first``."""
    events = len(message.group_first)
    found: dict[str, Any] = {
        name: require_size(int32_from_field(getattr(message, name)), events, name)
        for name in _INDICES
    }
    for name in _FLOATS:
        found[name] = require_size(floats_from_field(getattr(message, name)), events, name)
    marks = bools_from_field(message.group_chosen)
    return found | {"group_chosen": require_size(marks, events, "group_chosen")}
