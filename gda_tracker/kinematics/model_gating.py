"""Gating in the measurement space of a sensor with a model of its own."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.measurement_kinds import AZIMUTH
from gda_tracker.kinematics.measurement_models import Expected, Observed, compare, expected
from gda_tracker.kinematics.sensor_models import wrap_angle
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Predictions


def gated_components(
    seen: Observed, predictions: Predictions, threshold: float
) -> tuple[Expected, Int32Array, Int32Array, FloatArray, FloatArray]:
    """Pairs of components and detections inside the gate.

    Parameters
    ----------
    seen
        The measurements.
    predictions
        The hypotheses with their components.
    threshold
        Largest squared Mahalanobis distance: the chi-square quantile of the model's dimension.

    Returns
    -------
    of, component, detection, squared, log_likelihood
        What the components look like; (P,) each of the pairs, by component, then detection. The
        likelihood is in one over the unit of the measurement space.
    """
    of = expected(
        seen.model, seen.sites, predictions.component_mean, predictions.component_covariance
    )
    # Every gated pair passes the test in one quantity alone. Not the rotated range rate, which
    # is never the first.
    gap = seen.value[:, 0] - of.value[:, None, 0]
    if seen.model.quantities[0] == AZIMUTH:
        gap = wrap_angle(gap)
    variance = of.covariance[:, None, 0, 0] + seen.noise[:, 0, 0]
    component, detection = np.nonzero(gap * gap <= threshold * (1.0 + 1e-9) * variance)
    pair = compare(of.select(component), seen.value[detection], seen.noise[detection])
    squared = pair.squared()
    inside = squared <= threshold
    return (
        of,
        component[inside].astype(np.int32),
        detection[inside].astype(np.int32),
        squared[inside],
        pair.log_likelihood()[inside],
    )


def densities(
    of: Expected, seen: Observed, component: Int32Array, detection: Int32Array
) -> tuple[FloatArray, FloatArray]:
    """Squared Mahalanobis distances and log likelihoods of P pairs of component and detection."""
    pair = compare(of.select(component), seen.value[detection], seen.noise[detection])
    return pair.squared(), pair.log_likelihood()
