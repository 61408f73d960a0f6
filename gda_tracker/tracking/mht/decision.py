"""Which leaves are true: the best global hypothesis, and how probable each leaf is."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.global_hypotheses import best_global_hypothesis
from gda_tracker.association.leaf_probabilities import leaf_probabilities
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


def global_hypothesis(
    log_score: FloatArray, track: IntArray, detection_numbers: IntArray, optional: IntArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Choose one leaf for every track, for optional ones one at most.

    Parameters
    ----------
    log_score, track
        (L,) scores and ranks of the tracks, 0 to T - 1.
    detection_numbers
        (L, W) detections used, -1 for none.
    optional
        Ranks of the tracks that may be absent, at a score of zero.

    Returns
    -------
    chosen, probability : (L,)
        The leaves of the best global hypothesis, and the probability of each over all of them.
    absent
        (O,) The probability that each of the optional tracks is absent.
    """
    count, width = detection_numbers.shape
    if len(optional):
        # An absent track is a leaf that uses no detection.
        absent = np.full((len(optional), width), -1, dtype=np.int64)
        log_score = np.concatenate([log_score, np.zeros(len(optional))])
        track = np.concatenate([track, optional])
        detection_numbers = np.concatenate([detection_numbers, absent])
    best = best_global_hypothesis(log_score, track, detection_numbers)
    found = leaf_probabilities(log_score, track, detection_numbers, best=best)
    return best.chosen[:count], found.probability[:count], found.probability[count:]
