"""Features of a cluster: noise (5.22), missing values (5.34), angles off by pi (6.3).

Each is a density over its value; here stand ratios to the densities of proper values alone,
P_d^s(w), so that missing values need no case of their own: they have precision zero. Logarithms
throughout.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import i0e

from gda_tracker.association.xmap.model import GAUSSIAN, FeatureModel
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

LOG_TWO_PI = float(np.log(2.0 * np.pi))


def log_feature_density(
    model: FeatureModel, sensors: tuple[int, ...], values: FloatArray, kind: int
) -> FloatArray:
    """Log P^alpha(w | t) of clusters with these sensors (Ferry 2010, 5.16 with 5.22, 5.34, 6.3).

    Parameters
    ----------
    sensors
        The k sensors of the clusters.
    values : (k, ...)
        NaN: missing.
    kind
        Index of the object type t.
    """
    at = list(sensors)
    proper = np.isfinite(values)
    obeys = model.obeys_model[at, kind]
    ratio = _ModelRatio(model, at, kind, values, proper)
    single = [ratio(np.array([j])) for j in range(len(at))]
    total = np.full(values.shape[1:], -np.inf)
    for size in range(len(at) + 1):
        for chosen in combinations(range(len(at)), size):
            rest = [j for j in range(len(at)) if j not in chosen]
            share = float(np.prod(obeys[list(chosen)]) * np.prod(1.0 - obeys[rest]))
            if share == 0.0:
                continue
            term = np.full(values.shape[1:], np.log(share))
            # Noise is distributed as all values of the sensor are (5.21).
            for j in rest:
                term += single[j]
            if len(chosen) == 1:
                term += single[chosen[0]]
            elif chosen:
                term += ratio(np.array(chosen))
            total = np.logaddexp(total, term)
    return np.asarray(total + _log_single_densities(model, at, kind, values, proper).sum(axis=0))


class _ModelRatio:
    """log of P_mu^alpha' (5.34) over the product of P_d^s(w) of its proper values."""

    def __init__(
        self,
        model: FeatureModel,
        at: list[int],
        kind: int,
        values: FloatArray,
        proper: BoolArray,
    ) -> None:
        self._model, self._at, self._kind = model, at, kind
        shape = (len(at), *(1,) * (values.ndim - 1))
        with np.errstate(divide="ignore"):
            present, absent = (
                np.log(
                    np.where(
                        proper,
                        declared[at, kind].reshape(shape),
                        missing[at, kind].reshape(shape),
                    )
                )
                for declared, missing in (
                    (model.declared_if_present, model.missing_if_present),
                    (model.declared_if_absent, model.missing_if_absent),
                )
            )
            self._log_exists = np.log(model.exists[kind])
            self._log_lacks = np.log1p(-model.exists[kind])
        self._present, self._absent = present, absent
        self._precision = np.where(proper, model.std[at, kind].reshape(shape) ** -2.0, 0.0)
        self._values = np.where(proper, values, 0.0)
        if model.kind == GAUSSIAN:
            self._values = np.where(proper, values - model.prior_mean[kind], 0.0)

    def __call__(self, chosen: np.ndarray) -> FloatArray:
        present = self._log_exists + self._present[chosen].sum(axis=0)
        if len(chosen) > 1:
            gaussian = self._model.kind == GAUSSIAN
            present = present + (self._gaussian(chosen) if gaussian else self._von_mises(chosen))
        absent = self._log_lacks + self._absent[chosen].sum(axis=0)
        return np.asarray(np.logaddexp(present, absent))

    def _gaussian(self, chosen: np.ndarray) -> FloatArray:
        """Values of one feature over values of a feature each, prior N(0, prior_std^2)."""
        precision, value = self._precision[chosen], self._values[chosen]
        prior = self._model.prior_std[self._kind] ** -2.0
        together = prior + precision.sum(axis=0)
        apart = prior + precision
        quadratic = (precision * value).sum(axis=0) ** 2 / together
        quadratic -= ((precision * value) ** 2 / apart).sum(axis=0)
        logarithm = np.log(together / prior) - np.log(apart / prior).sum(axis=0)
        return np.asarray(0.5 * (quadratic - logarithm))

    def _von_mises(self, chosen: np.ndarray) -> FloatArray:
        """(6.3) with (6.4): which of the values are off by pi? The (2 pi)^-1 cancel.

        A set of jumps and its complement turn all by pi and have the same Bessel function.
        """
        concentration = self._precision[chosen]
        vectors = concentration * np.exp(1j * self._values[chosen])
        jump = self._model.jump_probability[np.array(self._at)[chosen], self._kind]
        total = np.full(vectors.shape[1:], -np.inf)
        for pattern in range(1 << (len(chosen) - 1)):
            jumped = np.array([pattern >> j & 1 for j in range(len(chosen))], dtype=np.bool_)
            share = np.where(jumped, jump, 1.0 - jump).prod()
            share += np.where(jumped, 1.0 - jump, jump).prod()
            if share > 0.0:
                sign = np.where(jumped, -1.0, 1.0)
                length = np.abs(np.tensordot(sign, vectors, axes=1))
                total = np.logaddexp(total, np.log(share) + _log_i0(length))
        return np.asarray(total - _log_i0(concentration).sum(axis=0))


def _log_i0(x: FloatArray) -> FloatArray:
    return np.asarray(np.log(i0e(x)) + x)


def _log_single_densities(
    model: FeatureModel, at: list[int], kind: int, values: FloatArray, proper: BoolArray
) -> FloatArray:
    """Log P_d^s(w) (5.32) of each value, 0 where it is missing."""
    if model.kind != GAUSSIAN:
        return np.where(proper, -LOG_TWO_PI, 0.0)
    shape = (len(at), *(1,) * (values.ndim - 1))
    variance = (model.std[at, kind] ** 2 + model.prior_std[kind] ** 2).reshape(shape)
    square = (np.where(proper, values, 0.0) - model.prior_mean[kind]) ** 2 / variance
    return np.asarray(np.where(proper, -0.5 * (LOG_TWO_PI + np.log(variance) + square), 0.0))
