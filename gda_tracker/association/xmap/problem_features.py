"""The feature model of a problem file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gda_tracker.association.xmap.json_values import ProblemError, Value
from gda_tracker.association.xmap.model import GAUSSIAN, VON_MISES, FeatureModel
from gda_tracker.vocabulary.arrays import FloatArray

_OPTIONAL = ("obeys_model", "declared_if_present", "declared_if_absent")


def read_feature_model(root: Value, types: list[str], n_sensors: int) -> FeatureModel | None:
    """Read the feature model; ``None`` if the problem has none.

    A sensor whose entry is null has no feature: its values are missing and say nothing. The same
    goes for missing values of a sensor that does not state ``declared_if_present``.
    """
    if not root.has("feature_model"):
        return None
    value = root["feature_model"].object(("kind", "sensors"), ("exists", "prior_mean", "prior_std"))
    kind = value["kind"].choice((GAUSSIAN, VON_MISES))
    gaussian = kind == GAUSSIAN
    if gaussian:
        value.object(("kind", "sensors", "prior_mean", "prior_std"), ("exists",))
    else:
        value.object(("kind", "sensors"), ("exists",))
    exists = _per_type(value, "exists", types, 1.0)
    rows: dict[str, list[FloatArray]] = {}
    for sensor in value["sensors"].entries("sensors or null", n_sensors):
        for name, row in _sensor(sensor, types, gaussian).items():
            rows.setdefault(name, []).append(row)
    _check_existence(value, exists, rows, n_sensors)
    zero, one = np.zeros(len(types)), np.ones(len(types))
    return FeatureModel(
        kind=kind,
        exists=exists,
        prior_mean=_per_type(value, "prior_mean", types, None, _any) if gaussian else zero,
        prior_std=_per_type(value, "prior_std", types, None, _positive) if gaussian else one,
        **{name: np.stack(entries) for name, entries in rows.items()},
    )


def _sensor(sensor: Value, types: list[str], gaussian: bool) -> dict[str, FloatArray]:
    zero, one = np.zeros(len(types)), np.ones(len(types))
    row = {
        "obeys_model": one,
        "declared_if_present": one,
        "declared_if_absent": one,
        "missing_if_present": one,
        "missing_if_absent": one,
        "std": one,
        "jump_probability": zero,
    }
    if sensor.is_null():
        return row
    sensor.object(("std",), _OPTIONAL if gaussian else (*_OPTIONAL, "jump_probability"))
    row["std"] = _per_type(sensor, "std", types, None, _positive)
    row["obeys_model"] = _per_type(sensor, "obeys_model", types, 1.0)
    row["jump_probability"] = _per_type(sensor, "jump_probability", types, 0.0)
    if sensor.has("declared_if_present"):
        row["declared_if_present"] = _per_type(sensor, "declared_if_present", types, 1.0)
        row["declared_if_absent"] = _per_type(sensor, "declared_if_absent", types, 0.0)
        row["missing_if_present"] = 1.0 - row["declared_if_present"]
        row["missing_if_absent"] = 1.0 - row["declared_if_absent"]
    elif sensor.has("declared_if_absent"):
        raise sensor["declared_if_absent"].fault("allowed only beside declared_if_present")
    return row


def _check_existence(
    value: Value, exists: FloatArray, rows: dict[str, list[FloatArray]], n_sensors: int
) -> None:
    """A feature that may be absent needs sensors that say how they react to that."""
    if (exists == 1.0).all():
        return
    for sensor in range(n_sensors):
        entry = value["sensors"][sensor]
        if not entry.is_null() and not entry.has("declared_if_present"):
            raise ProblemError(
                f"{entry.path}.declared_if_present: missing; needed where exists is below 1"
            )


Condition = tuple[str, Callable[[float], bool]]
_probability: Condition = ("a number from 0 to 1", lambda p: 0.0 <= p <= 1.0)
_positive: Condition = ("a number > 0", lambda x: x > 0.0)
_any: Condition = ("a number", lambda x: True)


def _per_type(
    parent: Value,
    key: str,
    types: list[str],
    default: float | None,
    condition: Condition = _probability,
) -> FloatArray:
    """One number for all types, or an object with one for each."""
    if default is not None and not parent.has(key):
        return np.full(len(types), default)
    value = parent[key]
    if isinstance(value.content, dict) and types != [""]:
        value.object(types)
        return np.array([value[name].number(*condition) for name in types])
    return np.full(len(types), value.number(*condition))
