"""What the class beliefs of tracks say of a target's class, as likelihoods.

A belief is a posterior: divided by the prior that went into it, it is the likelihood of all that
the radar has measured of the class, and those of several radars multiply.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def common_classes(names: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """All classes of targets that any radar knows; the first name of each is the false alarm."""
    return tuple(dict.fromkeys(name for known in names for name in known[1:]))


def prior_of(classes: Sequence[str], weights: Mapping[str, float]) -> FloatArray:
    """Prior (C,) of the classes; those without a weight count 1."""
    prior = np.array([weights.get(name, 1.0) for name in classes])
    return prior / prior.sum() if len(prior) else np.ones(0)


def class_likelihoods(
    belief: FloatArray,
    known: Sequence[str],
    classes: Sequence[str],
    weights: Mapping[str, float],
    reliability: float,
) -> FloatArray:
    """Likelihoods (M, C) of the classes, the largest of each track about one.

    Parameters
    ----------
    belief : (M, K)
        Class probabilities of tracks over ``known``; the first is the false alarm and left out.
        Rows that are not finite, negative or zero tell nothing.
    classes
        The common classes. Of one that the radar does not know the track tells as much as of its
        own classes on average.
    weights
        Of the prior.
    reliability
        This share counts.
    """
    likelihood = np.ones((len(belief), len(classes)))
    at = [classes.index(name) for name in known[1:]]
    if not at or not len(belief):
        return likelihood
    own = belief[:, 1:]
    with np.errstate(invalid="ignore"):
        sound = np.isfinite(own).all(axis=1) & (own >= 0.0).all(axis=1) & (own.sum(axis=1) > 0.0)
    own = np.where(sound[:, None], own, 1.0)
    prior = np.array([weights.get(name, 1.0) for name in known[1:]])
    prior = prior / prior.sum()
    ratio = own / prior
    likelihood[:] = (ratio @ prior)[:, None]
    likelihood[:, at] = ratio
    likelihood /= likelihood.max(axis=1, keepdims=True)
    likelihood[~sound] = 1.0
    return reliability * likelihood + (1.0 - reliability)


def class_probabilities(log_likelihood: FloatArray, prior: FloatArray) -> FloatArray:
    """Class probabilities (N, C) of targets from the summed log likelihoods of their tracks."""
    if not log_likelihood.size:
        return np.zeros(log_likelihood.shape)
    share = prior * np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))
