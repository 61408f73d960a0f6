"""The filter ``imm`` on the table of hypotheses: interacting models of constant velocity.

Every hypothesis is a Gaussian mixture over the models; the table's mean and covariance are its
moments, which is what is published. The models differ in process noise alone.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.gaussian_filters import update
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.range_rate import RangeRates, update_with_range_rate
from gda_tracker.kinematics.sensor_models import PolarMeasurements, innovations
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray


def with_models(table: HypothesisTable, parameters: TrackManagerParameters) -> HypothesisTable:
    """Return hypotheses that are mixtures over the models of the parameters.

    Those of another number of models, or of none, start anew: all models have the moments, and
    the weights are the shares of time that a target spends in each in the long run.
    """
    count, h = len(parameters.imm_process_noise_factors), len(table)
    if table.model_weight.shape[1] == count:
        return table
    sojourn = np.array(parameters.imm_mean_sojourn_s)
    spread = table.copy()
    spread.model_weight = np.tile(sojourn / sojourn.sum(), (h, 1))
    spread.model_mean = np.repeat(table.mean[:, None], count, axis=1)
    spread.model_covariance = np.repeat(table.covariance[:, None], count, axis=1)
    return spread


def without_models(table: HypothesisTable) -> HypothesisTable:
    """Return the hypotheses as single Gaussians, their moments."""
    plain = table.copy()
    plain.model_weight = table.model_weight[:, :0]
    plain.model_mean = table.model_mean[:, :0]
    plain.model_covariance = table.model_covariance[:, :0]
    return plain


def predict_models(
    table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters
) -> HypothesisTable:
    """Return the hypotheses ``dt_s`` [s] later (Koch 2014, (3.28)-(3.35))."""
    table = with_models(table, parameters)
    if not len(table) or dt_s == 0.0:
        return table
    transition, noise = model_matrices(dt_s, parameters)
    switching = switching_matrix(dt_s, parameters)
    weight, mean, covariance = imm.mix(
        table.model_weight, table.model_mean, table.model_covariance, switching
    )
    predicted = table.copy()
    set_models(predicted, weight, *imm.predict(mean, covariance, transition, noise))
    return predicted


def model_matrices(
    dt_s: float, parameters: TrackManagerParameters
) -> tuple[FloatArray, FloatArray]:
    """F and Q (M, s, s) of the models over ``dt_s`` [s]."""
    factors = tuple(parameters.imm_process_noise_factors)
    return _models(dt_s, parameters.process_noise_std_mps2, factors)


def switching_matrix(dt_s: float, parameters: TrackManagerParameters) -> FloatArray:
    """Probabilities (M, M) of the changes of model in ``dt_s`` [s], [j, i] to j from i."""
    return imm.sojourn_transition(dt_s, parameters.imm_mean_sojourn_s)


@lru_cache(maxsize=256)
def _models(
    dt_s: float, process_noise_std_mps2: float, factors: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """F and Q of the models (M, s, s); read-only, since they are cached."""
    made = [constant_velocity(dt_s, factor * process_noise_std_mps2) for factor in factors]
    stacked = np.stack([f for f, _ in made]), np.stack([q for _, q in made])
    for matrices in stacked:
        matrices.flags.writeable = False
    return stacked


def update_models(
    table: HypothesisTable,
    measurements: PolarMeasurements,
    rates: RangeRates | None,
    rows: IntArray,
    detection: Int32Array,
) -> None:
    """Update hypotheses ``rows`` (R,) with detections (R,): each model, and their weights.

    Koch 2014, (3.45)-(3.48).
    """
    count, size = table.model_mean.shape[1:]
    flat_mean = table.model_mean[rows].reshape(-1, size)
    flat_covariance = table.model_covariance[rows].reshape(-1, size, size)
    each = np.repeat(detection, count)
    innovation = innovations(measurements, flat_mean, flat_covariance, each)
    if rates is None:
        squared, determinant = innovation.mahalanobis_squared()
        # Without the factor 1/(2 pi), the same for all models.
        log_likelihood = -0.5 * (squared + np.log(determinant))
        new_mean, new_covariance = update(flat_mean, flat_covariance, innovation)
    else:
        updated = update_with_range_rate(
            flat_mean, flat_covariance, innovation, measurements, rates, each
        )
        log_likelihood = updated.log_likelihood
        new_mean, new_covariance = updated.mean, updated.covariance

    weight = table.model_weight.copy()
    mean, covariance = table.model_mean.copy(), table.model_covariance.copy()
    weight[rows], _ = imm.reweight(table.model_weight[rows], log_likelihood.reshape(-1, count))
    mean[rows] = new_mean.reshape(-1, count, size)
    covariance[rows] = new_covariance.reshape(-1, count, size, size)
    set_models(table, weight, mean, covariance)


def set_models(
    table: HypothesisTable, weight: FloatArray, mean: FloatArray, covariance: FloatArray
) -> None:
    """Give a table its mixtures and their moments."""
    # In one layout, whatever made them: a restarted manager must get the same last bits.
    table.model_weight = np.ascontiguousarray(weight)
    table.model_mean = np.ascontiguousarray(mean)
    table.model_covariance = np.ascontiguousarray(covariance)
    moments = imm.combine(table.model_weight, table.model_mean, table.model_covariance)
    table.mean, table.covariance = (np.ascontiguousarray(part) for part in moments)
