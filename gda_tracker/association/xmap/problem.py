"""A problem of association as JSON, the file of ``gda-tracker associate``.

The whole schema stands in docs/cross-sensor-association.md. Nothing is mended on the way: a problem
is taken as it stands or refused with one line that names path, value and what is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from gda_tracker.association.xmap.json_values import ProblemError, Value
from gda_tracker.association.xmap.model import (
    COUNT_PRIORS,
    POISSON,
    CountPrior,
    FeatureModel,
    ObjectTypes,
    SensorData,
    SensorModel,
)
from gda_tracker.association.xmap.problem_features import read_feature_model
from gda_tracker.association.xmap.two_sensors import estimated_prior_covariance
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

EXAMPLES = ("ferry_6_1",)

_SUM_TOLERANCE = 1e-9
_SENSOR = ("measurements", "bias_covariance", "detection_probability")
_MAX_DIMENSION = 12


@dataclass(frozen=True)
class Problem:
    """What is known and what was measured.

    Attributes
    ----------
    model, data
        The positions have their sensor's mean bias added already.
    bias_means : (r, d)
        Mean bias beta_0 of each sensor.
    prior_covariance_estimated
        Whether V_0 was estimated from the positions (3.16), for want of one in the file.
    """

    model: SensorModel
    data: SensorData
    bias_means: FloatArray
    prior_covariance_estimated: bool


def example(name: str) -> str:
    """Return the text of an example problem, one of ``EXAMPLES``."""
    if name not in EXAMPLES:
        raise ProblemError(f"example {name!r}: allowed are {', '.join(EXAMPLES)}")
    return files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8")


def read_problem(text: str | bytes) -> Problem:
    """Read a problem from the text of a JSON file.

    Raises
    ------
    ProblemError
        If it is not JSON, or anything in it is not as allowed.
    """
    root = Value.read(text).object(
        ("sensors", "prior"), ("prior_covariance", "types", "feature_model")
    )
    sensors = [
        sensor.object(_SENSOR, ("bias_mean", "expected_false_alarms"))
        for sensor in root["sensors"].entries("sensors")
    ]
    if len(sensors) < 2:
        raise ProblemError(f"sensors: a list of {len(sensors)}; allowed are 2 or more sensors")
    type_names, types_value = _type_names(root)
    calls = _called_names(root, type_names, len(sensors))
    feature = read_feature_model(root, type_names, len(sensors))
    positions, covariances, sizes = _positions(sensors)
    dimension = positions.shape[1]
    biases = tuple(_bias(sensor, dimension) for sensor in sensors)
    bias_means = np.stack([_bias_mean(sensor, dimension) for sensor in sensors])
    positions = positions + np.repeat(bias_means, sizes, axis=0)
    estimated = not root.has("prior_covariance") or root["prior_covariance"].is_null()
    if estimated:
        prior_covariance = _estimated(positions, np.repeat(np.arange(len(sizes)), sizes))
    else:
        prior_covariance = root["prior_covariance"].covariance(dimension)
    model = SensorModel(
        sizes=sizes,
        prior_covariance=prior_covariance,
        bias_covariances=biases,
        types=ObjectTypes(
            prior=_type_prior(types_value, type_names),
            detection=np.stack([_detection(sensor, type_names) for sensor in sensors]),
            confusion=_confusion(types_value, type_names, calls),
        ),
        count_prior=_count_prior(root["prior"]),
        expected_false_alarms=np.array([_false_alarms(sensor) for sensor in sensors]),
        feature=feature,
    )
    _check_seen(model)
    data = SensorData(
        positions, covariances, _read_calls(sensors, calls), _read_features(root, sensors, feature)
    )
    return Problem(model, data, bias_means, estimated)


def _positions(sensors: list[Value]) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    positions, covariances, sizes = [], [], []
    dimension = None
    for sensor in sensors:
        count = 0
        for entry in sensor["measurements"].entries("measurements"):
            measurement = entry.object(("position", "covariance"), ("type_call", "feature"))
            position = measurement["position"].vector(dimension)
            if len(position) > _MAX_DIMENSION:
                raise measurement["position"].fault(f"allowed are 1 to {_MAX_DIMENSION} numbers")
            dimension = len(position)
            positions.append(position)
            covariances.append(measurement["covariance"].covariance(dimension))
            count += 1
        sizes.append(count)
    if not positions:
        raise ProblemError("sensors: no measurements; allowed is 1 or more in all")
    return np.stack(positions), np.stack(covariances), tuple(sizes)


def _bias(sensor: Value, dimension: int) -> FloatArray | None:
    value = sensor["bias_covariance"]
    return None if value.is_null() else value.covariance(dimension, zero_allowed=True)


def _bias_mean(sensor: Value, dimension: int) -> FloatArray:
    if not sensor.has("bias_mean"):
        return np.zeros(dimension)
    return sensor["bias_mean"].vector(dimension)


def _estimated(positions: FloatArray, sensor_of: IntArray) -> FloatArray:
    try:
        return estimated_prior_covariance(positions, sensor_of)
    except ValueError as error:
        raise ProblemError(f"prior_covariance: missing, and {error}") from None


def _count_prior(value: Value) -> CountPrior:
    value.object(("kind",), ("mean",))
    kind = value["kind"].choice(COUNT_PRIORS)
    if kind != POISSON:
        if value.has("mean"):
            raise value["mean"].fault(f"allowed only with kind {POISSON}")
        return CountPrior(kind)
    value.object(("kind", "mean"))
    return CountPrior(kind, value["mean"].number("a number > 0", lambda x: x > 0.0))


def _false_alarms(sensor: Value) -> float:
    if not sensor.has("expected_false_alarms"):
        return 0.0
    return sensor["expected_false_alarms"].number("a number >= 0", lambda x: x >= 0.0)


def _type_names(root: Value) -> tuple[list[str], Value | None]:
    if not root.has("types"):
        return [""], None
    types = root["types"].object(("prior",), ("confusion",))
    return types["prior"].names("an object {type: probability}"), types


def _type_prior(types: Value | None, names: list[str]) -> FloatArray:
    if types is None:
        return np.ones(1)
    prior = np.array([types["prior"][name].probability() for name in names])
    _check_sum(types["prior"], prior)
    return prior


def _check_sum(value: Value, shares: FloatArray) -> None:
    if abs(shares.sum() - 1.0) > _SUM_TOLERANCE:
        raise ProblemError(
            f"{value.path}: probabilities sum to {float(shares.sum())!r}; allowed is 1 within 1e-9"
        )


def _detection(sensor: Value, names: list[str]) -> FloatArray:
    value = sensor["detection_probability"]
    if isinstance(value.content, dict):
        if names == [""]:
            raise value.fault("allowed is a number, or an object with types in the problem")
        value.object(names)
        return np.array([value[name].probability() for name in names])
    number = value.number("a number > 0 and < 1", lambda p: 0.0 < p < 1.0)
    return np.full(len(names), number)


def _check_seen(model: SensorModel) -> None:
    for sensor, alone in enumerate(model.seen_by_one):
        if alone <= 0.0:
            raise ProblemError(
                f"sensors[{sensor}].detection_probability: no object can be seen by this sensor "
                "alone; allowed are probabilities with which some type is, so > 0 here and < 1 "
                "at the others"
            )


def _called_names(root: Value, names: list[str], n_sensors: int) -> list[list[str]]:
    """Names that each sensor may call; none for a sensor that calls no types."""
    if not root.has("types") or not root["types"].has("confusion"):
        return [[] for _ in range(n_sensors)]
    called: list[list[str]] = []
    for matrix in root["types"]["confusion"].entries("confusion matrices or null", n_sensors):
        if matrix.is_null():
            called.append([])
            continue
        matrix.object(names)
        seen: dict[str, None] = {}
        for name in names:
            seen.update(dict.fromkeys(matrix[name].names("an object {called type: probability}")))
        called.append(list(seen))
    return called


def _confusion(
    types: Value | None, names: list[str], calls: list[list[str]]
) -> tuple[FloatArray, ...]:
    matrices = []
    for sensor, called in enumerate(calls):
        if not called:
            matrices.append(np.ones((len(names), 1)))
            continue
        assert types is not None
        matrix = np.zeros((len(names), len(called)))
        for row, name in enumerate(names):
            entry = types["confusion"][sensor][name]
            for call in entry.content:
                matrix[row, called.index(call)] = entry[call].probability()
            _check_sum(entry, matrix[row])
        matrices.append(matrix)
    return tuple(matrices)


def _read_calls(sensors: list[Value], calls: list[list[str]]) -> IntArray:
    found = []
    for sensor, called in zip(sensors, calls, strict=True):
        for measurement in sensor["measurements"].entries("measurements"):
            if not called:
                if measurement.has("type_call"):
                    raise measurement["type_call"].fault(
                        "allowed only for a sensor with a matrix in types.confusion"
                    )
                found.append(0)
                continue
            if not measurement.has("type_call"):
                raise ProblemError(
                    f"{measurement.path}.type_call: missing; allowed are {', '.join(called)}"
                )
            found.append(called.index(measurement["type_call"].choice(called)))
    return np.array(found, dtype=np.int64)


def _read_features(root: Value, sensors: list[Value], feature: FeatureModel | None) -> FloatArray:
    found = []
    for number, sensor in enumerate(sensors):
        measured = feature is not None and not root["feature_model"]["sensors"][number].is_null()
        for measurement in sensor["measurements"].entries("measurements"):
            if not measured:
                if measurement.has("feature"):
                    raise measurement["feature"].fault(
                        "allowed only for a sensor with a model in feature_model.sensors"
                    )
                found.append(np.nan)
                continue
            if not measurement.has("feature"):
                raise ProblemError(
                    f"{measurement.path}.feature: missing; allowed is a number or null"
                )
            value = measurement["feature"]
            found.append(np.nan if value.is_null() else value.number("a number or null"))
    return np.array(found)
