"""The answer to a problem of association, as ``gda-tracker associate`` prints it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from gda_tracker.association.xmap.problem import Problem
from gda_tracker.association.xmap.solution import Solution
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def answer(problem: Problem, solution: Solution, top: int) -> dict[str, Any]:
    """Solution as an object for JSON, with the ``top`` most probable associations.

    Indices count from 0. Numbers keep all their digits.
    """
    model, bias = problem.model, solution.bias
    # The posterior is of what comes on top of the mean biases.
    means = problem.bias_means
    absolute = None if bias.mean is None else bias.mean + means
    relative = bias.relative_mean + means - means[bias.reference]
    sensors = model.sensor_of
    index = np.arange(len(sensors)) - model.first[sensors]
    shared = np.argwhere(np.triu(sensors[:, None] != sensors))
    found: dict[str, Any] = {
        "method": solution.method,
        "covered": solution.covered,
        "associations": [
            {"objects": _objects(labels, sensors, index, len(model.sizes)), "probability": share}
            for labels, share in zip(
                solution.labels[:top], solution.probability[:top].tolist(), strict=True
            )
        ],
        "pairs": [
            {
                "a": [int(sensors[i]), int(index[i])],
                "b": [int(sensors[j]), int(index[j])],
                "pair_probability": float(solution.pairs[i, j]),
            }
            for i, j in shared.tolist()
        ],
        "bias": _gaussians(absolute, bias.covariance, len(model.sizes)),
        "relative_bias": {
            "reference": bias.reference,
            "sensors": _gaussians(relative, bias.relative_covariance, len(model.sizes)),
        },
    }
    if problem.prior_covariance_estimated:
        found["prior_covariance"] = model.prior_covariance.tolist()
    return found


def answer_json(found: dict[str, Any]) -> str:
    """Text of an answer, an association or a pair a line; numbers read back as the same."""

    def text(value: Any) -> str:
        return json.dumps(value, allow_nan=False)

    lines = []
    for key, value in found.items():
        if isinstance(value, list):
            entries = ",\n".join(f"    {text(entry)}" for entry in value)
            lines.append(f"  {text(key)}: [\n{entries}\n  ]" if value else f"  {text(key)}: []")
        else:
            lines.append(f"  {text(key)}: {text(value)}")
    return "{\n" + ",\n".join(lines) + "\n}"


def _objects(
    labels: IntArray, sensors: IntArray, index: IntArray, n_sensors: int
) -> list[list[int | None]]:
    objects: list[list[int | None]] = [[None] * n_sensors for _ in range(int(labels.max()) + 1)]
    for label, sensor, place in zip(labels.tolist(), sensors.tolist(), index.tolist(), strict=True):
        objects[label][sensor] = place
    return objects


def _gaussians(
    mean: FloatArray | None, covariance: FloatArray | None, n_sensors: int
) -> list[dict[str, Any] | None]:
    """Mean and covariance per sensor, null where they are unknown."""
    if mean is None or covariance is None:
        return [None] * n_sensors
    return [
        {"mean": m.tolist(), "covariance": c.tolist()} if np.isfinite(m).all() else None
        for m, c in zip(mean, covariance, strict=True)
    ]
