"""The filters ``imm`` and ``gpb2`` on the table of hypotheses: several motion models.

Every hypothesis is a Gaussian mixture over the models, in their common state
(:mod:`gda_tracker.kinematics.model_sets`). The table's mean and covariance are its moments in
position and velocity, which is what is published; the other stages see position and velocity of
each component, since no measurement is of anything else.

With ``gpb2`` a predicted hypothesis has a component for every pair of models, the earlier and the
present one, until the scan is closed (:func:`merge_pairs`).
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.gaussian_filters import update
from gda_tracker.kinematics.model_sets import HEAD, follow_head
from gda_tracker.kinematics.motion_models import CV, GPB2
from gda_tracker.kinematics.range_rate import RangeRates, update_with_range_rate
from gda_tracker.kinematics.sensor_models import PolarMeasurements, innovations
from gda_tracker.tracking.context_models import predict_keepers, with_keepers
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameter_groups.motion import ACCELERATION, PER_SCAN
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray


def has_models(parameters: TrackManagerParameters) -> bool:
    """Whether hypotheses are mixtures over motion models."""
    return parameters.filter != CV or bool(parameters.courses.names)


def with_models(
    table: HypothesisTable, parameters: TrackManagerParameters, stamp_ns: int | None = None
) -> HypothesisTable:
    """Return hypotheses that are mixtures over the models of the parameters.

    Those of other models, or of none, start anew: all models have the moments, and the weights are
    the shares of time that a target spends in each in the long run. ``stamp_ns`` is the time of the
    states, for those that have a plan.
    """
    if parameters.courses.names:
        return with_keepers(table, _long_run_shares(parameters), stamp_ns, parameters)
    models, h = parameters.model_set, len(table)
    if table.models == models.names and table.model_weight.shape[1] == len(models):
        return table
    mean, covariance = models.extended(table.mean, table.covariance)
    spread = table.copy()
    spread.models = models.names
    spread.model_weight = np.tile(_long_run_shares(parameters), (h, 1))
    spread.model_mean = np.repeat(mean[:, None], len(models), axis=1)
    spread.model_covariance = np.repeat(covariance[:, None], len(models), axis=1)
    return spread


def _long_run_shares(parameters: TrackManagerParameters) -> FloatArray:
    """Share of time (M,) that a target spends in each model."""
    if parameters.filter == CV:
        return np.ones(1)
    if parameters.imm_switching != PER_SCAN:
        sojourn = np.array(parameters.imm_mean_sojourn_s)
        return np.asarray(sojourn / sojourn.sum(), dtype=np.float64)
    # From equal shares, by ever more scans: also where a model is never left, or the chain turns
    # in circles (half of the scans are not counted).
    count = len(parameters.imm_process_noise_factors)
    lazy = 0.5 * (np.eye(count) + _per_scan(parameters))
    shares = np.linalg.matrix_power(lazy, 2**20) @ np.full(count, 1.0 / count)
    return np.asarray(shares / shares.sum(), dtype=np.float64)


def without_models(table: HypothesisTable) -> HypothesisTable:
    """Return the hypotheses as single Gaussians, their moments."""
    plain = table.copy()
    plain.models = ()
    plain.model_weight = table.model_weight[:, :0]
    plain.model_mean = table.model_mean[:, :0, : table.mean.shape[1]]
    plain.model_covariance = table.model_covariance[:, :0, : table.mean.shape[1]]
    plain.model_covariance = plain.model_covariance[..., : table.mean.shape[1]]
    return plain


def predict_models(
    table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters, stamp_ns: int = 0
) -> HypothesisTable:
    """Return the hypotheses ``dt_s`` [s] later (Koch 2014, (3.28)-(3.35)).

    ``stamp_ns`` is the time predicted to.
    """
    table = with_models(table, parameters, stamp_ns - round(dt_s * 1e9))
    if not len(table) or dt_s == 0.0:
        return table
    if parameters.courses.names:
        predicted = table.copy()
        switching = np.ones((1, 1))
        if parameters.filter != CV:
            switching = switching_matrix(table, dt_s, parameters)
        shares = _long_run_shares(parameters)
        mixture = predict_keepers(table, switching, shares, dt_s, stamp_ns, parameters)
        set_models(predicted, *mixture)
        return predicted
    models = parameters.model_set
    switching = switching_matrix(table, dt_s, parameters)
    transition, noise = models.matrices(dt_s)
    weight, mean, covariance = table.model_weight, table.model_mean, table.model_covariance
    predicted = table.copy()
    if parameters.filter == GPB2:
        moved, slope = models.moved_pairs(mean, dt_s)
        pairs = np.broadcast_to(noise[:, None], (len(models), *noise.shape))
        weight, _, covariance = imm.branch(
            weight, mean, covariance, switching, *_for_each_row(slope, pairs)
        )
        h, s = len(table), models.size
        set_models(
            predicted,
            weight.reshape(h, -1),
            moved.reshape(h, -1, s),
            covariance.reshape(h, -1, s, s),
        )
        return predicted
    weight, mean, covariance = imm.mix(weight, mean, covariance, switching)
    if models.turns:
        moved, transition = models.moved(mean, dt_s)
        _, covariance = imm.predict(mean, covariance, transition, noise)
    else:
        moved, covariance = imm.predict(mean, covariance, transition, noise)
    set_models(predicted, weight, moved, covariance)
    return predicted


def _for_each_row(slope: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and Q of pairs with a first axis for the hypotheses, as ``imm.branch`` wants them."""
    return (slope if slope.ndim == 5 else slope[None]), noise[None]


def merge_pairs(table: HypothesisTable) -> None:
    """Give hypotheses over pairs of models, of ``gpb2``, one component for each model again."""
    count, columns = len(table.models), table.model_weight.shape[1]
    if columns == count:
        return
    h, s = len(table), table.model_mean.shape[2]
    set_models(
        table,
        *imm.merge_branches(
            table.model_weight.reshape(h, count, count),
            table.model_mean.reshape(h, count, count, s),
            table.model_covariance.reshape(h, count, count, s, s),
        ),
    )


def switching_matrix(
    table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters
) -> FloatArray:
    """Probabilities of the changes of model in ``dt_s`` [s], entry [j, i] to j from i.

    (M, M), or (H, M, M) if they depend on the acceleration of the hypotheses, which are those
    before the step (Koch 2014, (2.12)).
    """
    if dt_s > 0.0 and parameters.imm_switching == PER_SCAN:
        return _per_scan(parameters)
    sojourn = imm.sojourn_transition(dt_s, parameters.imm_mean_sojourn_s)
    if dt_s == 0.0 or parameters.imm_switching != ACCELERATION:
        return sojourn
    return imm.acceleration_dependent_transition(
        (sojourn[0, 0], sojourn[1, 1]),
        table.model_mean[:, :, HEAD : HEAD + 2],
        parameters.imm_switching_acceleration_mps2,
    )


def _per_scan(parameters: TrackManagerParameters) -> FloatArray:
    """The probabilities given, [j, i] to j from i, columns summing to one."""
    count = len(parameters.imm_process_noise_factors)
    given = np.array(parameters.imm_transition).reshape(count, count)
    return np.asarray((given / given.sum(axis=1, keepdims=True)).T, dtype=np.float64)


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
    whole_mean = table.model_mean[rows].reshape(-1, size)
    whole_covariance = table.model_covariance[rows].reshape(-1, size, size)
    flat_mean, flat_covariance = whole_mean[:, :HEAD], whole_covariance[:, :HEAD, :HEAD]
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

    if size > HEAD:
        new_mean, new_covariance = follow_head(
            whole_mean, whole_covariance, new_mean, new_covariance
        )
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
    moments = imm.combine(
        table.model_weight,
        table.model_mean[..., :HEAD],
        table.model_covariance[..., :HEAD, :HEAD],
    )
    table.mean, table.covariance = (np.ascontiguousarray(part) for part in moments)
