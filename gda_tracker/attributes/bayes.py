"""Class probabilities by Bayes' rule, in logs (Mahler 2011, section 7)."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

_LOWEST = np.finfo(np.float64).min


def class_mixture(
    class_probability: FloatArray, log_class_likelihood: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Update class probabilities by an attribute, and say how well it fitted.

    Parameters
    ----------
    class_probability
        (..., C) P(c | history).
    log_class_likelihood
        (..., C) log f(attribute | c), broadcast against it.

    Returns
    -------
    posterior, log_likelihood
        (..., C) P(c | history, attribute) (Mahler 2011, (94)) and (...) log of
        sum_c P(c | history) f(attribute | c) (Mahler 2011, (88)). Where no class of the history can
        give the attribute the log likelihood is -inf and the posterior is the history.
    """
    with np.errstate(divide="ignore"):
        joint = np.log(class_probability) + log_class_likelihood
        # The limit keeps -inf - (-inf) out of rows in which nothing is possible.
        top = np.maximum(joint.max(axis=-1), _LOWEST)
        weight = np.exp(joint - top[..., None])
        total = weight.sum(axis=-1)
        log_likelihood = top + np.log(total)
    possible = total > 0.0
    if possible.all():
        return weight / total[..., None], log_likelihood
    posterior = weight / np.where(possible, total, 1.0)[..., None]
    return np.where(possible[..., None], posterior, class_probability), log_likelihood


def forget(class_probability: FloatArray, factor: float) -> FloatArray:
    """Class prediction (Mahler 2011, (93)): with probability 1 - factor the class is drawn anew.

    It is drawn uniformly among the classes that the history holds possible, so that a track does
    not become a false alarm by forgetting.
    """
    possible = class_probability > 0.0
    count = np.maximum(possible.sum(axis=-1, keepdims=True), 1)
    return factor * class_probability + (1.0 - factor) * possible / count
