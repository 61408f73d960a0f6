"""What the strength of a signal adds to the likelihood of a pair, target against clutter.

Koch 2014, (2.49): the scan's likelihood is sum_j s(z_j) / c(z_j) N(z_j; H x, S) + rho_F (1 - P_D),
where s(z), the density of a target's strengths, has P_D as its integral above the threshold. All
stages form P_D g / rho_F and 1 - P_D from the kinematic density g and the detection probability of
a hypothesis. So g is multiplied by s(z) / (P_D c(z)), the ratio of the densities *given a
detection*, and P_D stays what it is: P_D g then has s(z) once and P_D nowhere.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.signal_strength import Strengths, log_clutter_density
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan


def log_detected_ratio(
    strengths: Strengths, signal: FloatArray, lambda_: float, clutter: float = 0.0
) -> FloatArray:
    """Log ratio (N,) of the densities of a detection's strength, from a target and from clutter.

    Both are of strengths above the threshold: the target's is a (b + lambda)^a / (b + z)^(a + 1).

    Parameters
    ----------
    strengths
        (N,) what is known of 1 + mean strength.
    signal
        (N,) strengths of the detections [mean noise powers] >= lambda; NaN is unknown, ratio 1.
    lambda_, clutter
        Threshold, and mean strength of false detections.
    """
    a, b = strengths.shape, strengths.scale
    log_target = np.log(a / (b + signal)) - a * np.log1p((signal - lambda_) / (b + lambda_))
    ratio = log_target - log_clutter_density(signal, lambda_, clutter)
    return np.where(np.isnan(signal), 0.0, ratio)


def pair_log_ratio(
    scan: Scan, predictions: Predictions, hypothesis: Int32Array, detection: Int32Array
) -> FloatArray | None:
    """Log ratio (P,) of pairs; ``None`` where signal strength plays no part on the scan."""
    if scan.signal_strength is None or not len(predictions.strength_shape):
        return None
    known = Strengths(
        predictions.strength_shape[hypothesis], predictions.strength_scale[hypothesis]
    )
    settings = predictions.settings
    return log_detected_ratio(
        known,
        scan.signal_strength[detection],
        settings.signal_threshold,
        settings.clutter_strength,
    )
