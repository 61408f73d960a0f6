"""Scenes of several sensors with the truth of who measured what (Ferry 2010, 6.2, Appendix C).

The numbers of measurements are given. An association is drawn from its probability without data,
then types, positions, calls and features of its objects; so priors on the number of objects and on
biases may be diffuse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gda_tracker.association.xmap.model import (
    GAUSSIAN,
    FeatureModel,
    SensorData,
    SensorModel,
)
from gda_tracker.association.xmap.object_density import detection_pattern_probability
from gda_tracker.association.xmap.scoring import Structure
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class CovarianceGenerator:
    """How the error covariances of measurements are drawn (Ferry 2010, 6.2).

    A Wishart matrix with mean ``baseline`` and ``degrees`` degrees of freedom, times exp(x) with x
    normal of variance log ``scale``.

    Attributes
    ----------
    baseline : (r, d, d)
    degrees : (r,)
    scale : (r,)
    """

    baseline: FloatArray
    degrees: IntArray
    scale: FloatArray

    def draw(self, sensor_of: IntArray, scenes: int, rng: np.random.Generator) -> FloatArray:
        """Covariances (M, B, d, d)."""
        dimension = self.baseline.shape[1]
        root = np.linalg.cholesky(self.baseline / self.degrees[:, None, None])
        drawn = np.empty((len(sensor_of), scenes, dimension, dimension))
        for place, sensor in enumerate(sensor_of.tolist()):
            normal = rng.standard_normal((scenes, dimension, int(self.degrees[sensor])))
            factor = root[sensor] @ normal
            width = np.sqrt(np.log(self.scale[sensor]))
            scale = np.exp(width * rng.standard_normal(scenes))
            drawn[place] = factor @ np.swapaxes(factor, 1, 2) * scale[:, None, None]
        return drawn


FERRY_6_2 = CovarianceGenerator(
    baseline=np.array(
        [
            [[5.0, 1.0], [1.0, 7.0]],
            [[6.0, -3.0], [-3.0, 4.0]],
            [[7.0, 5.0], [5.0, 4.0]],
        ]
    ),
    degrees=np.array([10, 10, 10]),
    scale=np.array([2.0, 3.0, 4.0]),
)
"""The generator of the paper's calibration."""


class Scenes(NamedTuple):
    """Simulated scenes: the data and the index (B,) of the true association."""

    data: SensorData
    truth: IntArray


def association_prior(model: SensorModel, structure: Structure) -> FloatArray:
    """(A,) probability of each association given the numbers of measurements alone (C.4, C.5)."""
    pattern = detection_pattern_probability(model, structure.clusters.members).sum(axis=1)
    weight = structure.log_count + structure.clusters.incidence @ np.log(pattern)
    share = np.exp(weight - weight.max())
    return np.asarray(share / share.sum())


def expected_objects_by_type(model: SensorModel, structure: Structure) -> FloatArray:
    """E[n_D(t) | n] (T,): expected number of seen objects of each type (Ferry 2010, C.7)."""
    joint = detection_pattern_probability(model, structure.clusters.members)
    by_type = joint / joint.sum(axis=1, keepdims=True)
    return np.asarray(
        association_prior(model, structure) @ (structure.clusters.incidence @ by_type)
    )


def simulate_scenes(
    model: SensorModel,
    labels: IntArray,
    structure: Structure,
    generator: CovarianceGenerator,
    scenes: int,
    rng: np.random.Generator,
) -> Scenes:
    """Draw scenes of the model with the associations ``labels`` (A, M).

    Positions are centred as the paper has it: each sensor with a diffuse bias for itself, the
    others together.
    """
    truth = rng.choice(len(labels), size=scenes, p=association_prior(model, structure))
    mine = labels[truth].T  # (M, B)
    types = _draw_types(model, mine, rng)
    data = SensorData(
        positions=np.zeros((len(mine), scenes, len(model.prior_covariance))),
        covariances=generator.draw(model.sensor_of, scenes, rng),
        calls=_draw_calls(model, mine, types, rng),
        features=_draw_features(model, mine, types, rng),
    )
    data.positions[:] = _draw_positions(model, mine, data.covariances, rng)
    return Scenes(data, truth)


def _draw_types(model: SensorModel, labels: IntArray, rng: np.random.Generator) -> IntArray:
    """Type (M, B) of each label's object given which sensors see it (C.6)."""
    n_measurements, scenes = labels.shape
    members = np.full((n_measurements, scenes, len(model.sizes)), -1)
    column = np.arange(scenes)
    for place, sensor in enumerate(model.sensor_of.tolist()):
        members[labels[place], column, sensor] = 0
    joint = detection_pattern_probability(model, members.reshape(-1, len(model.sizes)))
    return _categories(joint.reshape(n_measurements, scenes, -1), rng)


def _categories(weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw an index of the last axis with probability proportional to the weight."""
    share = np.cumsum(weight, axis=-1)
    level = rng.random(share.shape[:-1]) * share[..., -1]
    return np.asarray((share <= level[..., None]).sum(axis=-1))


def _draw_positions(
    model: SensorModel, labels: IntArray, covariances: FloatArray, rng: np.random.Generator
) -> FloatArray:
    n_measurements, scenes = labels.shape
    dimension = len(model.prior_covariance)
    root = np.linalg.cholesky(model.prior_covariance)
    objects = rng.standard_normal((n_measurements, scenes, dimension)) @ root.T
    noise = np.linalg.cholesky(covariances) @ rng.standard_normal((*labels.shape, dimension, 1))
    positions = objects[labels, np.arange(scenes)] + noise[..., 0]
    sensor_of = model.sensor_of
    finite = [s for s, b in enumerate(model.bias_covariances) if b is not None]
    for sensor, covariance in enumerate(model.bias_covariances):
        mine = sensor_of == sensor
        if covariance is None:
            if mine.any():
                positions[mine] -= positions[mine].mean(axis=0)
        elif covariance.any():
            bias = rng.multivariate_normal(np.zeros(dimension), covariance, size=scenes)
            positions[mine] -= bias
    together = np.isin(sensor_of, finite)
    if together.any():
        positions[together] -= positions[together].mean(axis=0)
    return positions


def _draw_calls(
    model: SensorModel, labels: IntArray, types: IntArray, rng: np.random.Generator
) -> IntArray:
    scenes = np.arange(labels.shape[1])
    return np.stack(
        [
            _categories(model.types.confusion[sensor][types[labels[place], scenes]], rng)
            for place, sensor in enumerate(model.sensor_of.tolist())
        ]
    )


def _draw_features(
    model: SensorModel, labels: IntArray, types: IntArray, rng: np.random.Generator
) -> FloatArray:
    """Feature (M, B) of each measurement, NaN where it is missing (5.18, 5.28, 5.29, 6.3)."""
    feature = model.feature
    if feature is None:
        return np.full(labels.shape, np.nan)
    scenes = np.arange(labels.shape[1])
    exists = rng.random(labels.shape) < feature.exists[types]
    state = _states(feature, types, rng)
    values = np.empty(labels.shape)
    for place, sensor in enumerate(model.sensor_of.tolist()):
        label = labels[place]
        kind = types[label, scenes]
        # Noise is the value of another object of the type: distributed alike, of no relation.
        noise = rng.random(len(scenes)) >= feature.obeys_model[sensor, kind]
        other = rng.random(len(scenes)) < feature.exists[kind]
        here = np.where(noise, other, exists[label, scenes])
        chance = np.where(
            here,
            feature.declared_if_present[sensor, kind],
            feature.declared_if_absent[sensor, kind],
        )
        declared = rng.random(len(scenes)) < chance
        # A value for an object without the feature is distributed as those with it (5.33).
        own = here & ~noise
        source = np.where(own, state[label, scenes], _states(feature, kind, rng))
        values[place] = np.where(declared, _measured(feature, sensor, kind, source, rng), np.nan)
    return values


def _states(feature: FeatureModel, types: IntArray, rng: np.random.Generator) -> FloatArray:
    if feature.kind == GAUSSIAN:
        normal = rng.standard_normal(types.shape)
        return np.asarray(feature.prior_mean[types] + feature.prior_std[types] * normal)
    return np.asarray(rng.uniform(0.0, 2.0 * np.pi, types.shape))


def _measured(
    feature: FeatureModel,
    sensor: int,
    kind: IntArray,
    state: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    std = feature.std[sensor, kind]
    if feature.kind == GAUSSIAN:
        return np.asarray(state + std * rng.standard_normal(len(state)))
    jump = rng.random(len(state)) < feature.jump_probability[sensor, kind]
    angle = rng.vonmises(state, std**-2.0) + np.where(jump, np.pi, 0.0)
    return np.asarray(np.mod(angle, 2.0 * np.pi))
