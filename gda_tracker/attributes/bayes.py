"""Class probabilities by Bayes' rule, in logs (Mahler 2011, section 7)."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

_LOWEST = np.finfo(np.float64).min


def _weights(
    class_probability: FloatArray, log_class_likelihood: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint weights (..., C) scaled by their largest, their sum (...) and the log of the scale."""
    joint = np.log(class_probability) + log_class_likelihood
    # The limit keeps -inf - (-inf) out of rows in which nothing is possible.
    scale = np.maximum(np.maximum.reduce(joint, axis=-1), _LOWEST)
    weight = np.exp(joint - scale[..., None])
    return weight, np.add.reduce(weight, axis=-1), scale


def log_class_mixture(
    class_probability: FloatArray, log_class_likelihood: FloatArray
) -> FloatArray:
    """Log likelihood of an attribute: log sum_c P(c | history) f(attribute | c).

    Parameters
    ----------
    class_probability
        (..., C) P(c | history).
    log_class_likelihood
        (..., C) log f(attribute | c), broadcast against it.

    Returns
    -------
    array
        (...) the first factor of (88) in Mahler 2011; -inf where no class of the history can give
        the attribute.
    """
    with np.errstate(divide="ignore"):
        _, total, scale = _weights(class_probability, log_class_likelihood)
        return np.asarray(scale + np.log(total))


def class_update(
    class_probability: FloatArray, log_class_likelihood: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Update class probabilities by an attribute (Mahler 2011, (94)).

    Arguments are those of :func:`log_class_mixture`, whose result is the second one here. The first
    one is P(c | history, attribute); where no class of the history can give the attribute it is the
    history.
    """
    with np.errstate(divide="ignore"):
        weight, total, scale = _weights(class_probability, log_class_likelihood)
        log_likelihood = scale + np.log(total)
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
