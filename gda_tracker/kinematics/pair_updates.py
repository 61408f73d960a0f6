"""Pairs of state and detection, whatever the scan's sensor measures."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics import gaussian_filters
from gda_tracker.kinematics.measurement_models import compare, expected, observed, update
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.scans import Scan


def updated_pairs(
    scan: Scan, mean: FloatArray, covariance: FloatArray, detection: Int32Array
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update P states with one detection each, without the range rate of a polar sensor.

    Parameters
    ----------
    scan
        With or without a sensor model.
    mean, covariance
        (P, 4), (P, 4, 4).
    detection
        (P,) rows of the scan.

    Returns
    -------
    mean, covariance, log_likelihood
        The updated states, and log N(z; h(x), S) (P,), for range and azimuth without the factor
        1/(2 pi).
    """
    if not scan.sensor_model:
        innovation = innovations(polar_measurements(scan), mean, covariance, detection)
        squared, determinant = innovation.mahalanobis_squared()
        updated = gaussian_filters.update(mean, covariance, innovation)
        return *updated, -0.5 * (squared + np.log(determinant))
    seen = observed(scan)
    of = expected(seen.model, seen.sites, mean, covariance)
    pair = compare(of, seen.value[detection], seen.noise[detection])
    return *update(mean, covariance, pair), pair.log_likelihood()
