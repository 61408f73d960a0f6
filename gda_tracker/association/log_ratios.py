"""Log likelihood ratios of one scan against false alarms: what leaves of a tree collect."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array


def log_ratios(
    hypothesis: Int32Array,
    detection: Int32Array,
    kinematic_log_likelihood: FloatArray,
    attribute_log_likelihood: FloatArray | None,
    clutter_log_likelihood: FloatArray | None,
    detection_probability: FloatArray,
    clutter_density: float,
) -> tuple[FloatArray, FloatArray]:
    """Log likelihood ratios of one scan: each pair, and each hypothesis without a detection.

    A pair: log P_D g_ij l_ij / (beta f(attribute | false alarm)), a miss: log (1 - P_D). Weights of
    zero (P_D = 1, beta = 0) are taken as vanishing ones.

    Parameters
    ----------
    hypothesis, detection : (P,)
    kinematic_log_likelihood : (P,)
        log g_ij [log 1/(m rad)].
    attribute_log_likelihood : (P,) or None
    clutter_log_likelihood : (n,) or None
        Per detection, in the unit of the attribute's.
    detection_probability : (H,)
    clutter_density : float
        beta [1/(m rad)].

    Returns
    -------
    pair, miss : (P,), (H,)
    """
    with np.errstate(divide="ignore"):
        log_clutter = max(float(np.log(clutter_density)), LOG_VANISHING)
        log_detected = np.maximum(np.log(detection_probability), LOG_VANISHING)
        miss = np.maximum(np.log1p(-detection_probability), LOG_VANISHING)
    pair = log_detected[hypothesis] + kinematic_log_likelihood - log_clutter
    if attribute_log_likelihood is not None and clutter_log_likelihood is not None:
        clutter = np.maximum(clutter_log_likelihood, LOG_VANISHING)
        pair = pair + (attribute_log_likelihood - clutter[detection])
    return pair, miss
