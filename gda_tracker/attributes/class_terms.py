"""Attribute term whose histories are class probabilities (Mahler 2011, (93) and (94))."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import isqrt

import numpy as np

from gda_tracker.attributes.bayes import class_update, forget
from gda_tracker.attributes.pair_beliefs import NO_FOCAL, PairBeliefs, Pairs
from gda_tracker.evidence.frames import MAX_ELEMENTS
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, empty_floats
from gda_tracker.vocabulary.beliefs import Evidence

# How far a column of transition probabilities may be from a sum of one.
SUM_TOLERANCE = 1e-6
# Classes are tied to the elements of a frame.
CLASS_COUNTS = range(2, MAX_ELEMENTS + 1)


def fuse_classes(pairs: Pairs) -> PairBeliefs:
    """Term ``bayes``: class prediction (93), then Bayes' rule (94); no masses, no distance.

    The conflict of a pair is the mass of the measurement on focal elements that are disjoint, on
    Shafer's model, from the class of the predicted history; its mean over the classes.

    Raises
    ------
    ValueError
        For a class transition of another number of classes than the evidence's.
    """
    evidence, detection = pairs.evidence, pairs.detection
    untouched = history = pairs.history_class_probability
    if pairs.forgetting_factor < 1.0:
        history = forget(history, pairs.forgetting_factor)
    if pairs.class_transition is not None:
        fault = fault_of_transition(pairs.class_transition, evidence.class_names)
        if fault:
            raise ValueError(fault)
        history = history @ pairs.class_transition.T
    posterior, log_likelihood = class_update(history, evidence.log_class_likelihood[detection])
    # Class probabilities are masses on the elements: agreement is the plausibility of the class.
    plausible = evidence.masses @ _compatibility(len(evidence.frame), evidence.focal.tobytes())
    conflict = np.maximum(1.0 - np.add.reduce(history * plausible[detection], axis=1), 0.0)
    informative = evidence.informative[detection]
    if not informative.all():
        posterior = np.where(informative[:, None], posterior, untouched)
        log_likelihood = np.where(informative, log_likelihood, 0.0)
        conflict = np.where(informative, conflict, 0.0)
    n = len(detection)
    return PairBeliefs(
        focal=NO_FOCAL,
        masses=empty_floats(n, 0),
        class_probability=posterior,
        distance=np.zeros(n),
        log_likelihood=log_likelihood,
        conflict=conflict,
        informative=informative,
    )


def class_history(
    classes: FloatArray,
    log_class_likelihood: FloatArray,
    class_transition: FloatArray | None,
    predicted: BoolArray,
) -> FloatArray:
    """Class probabilities (R, C) after one more detection each, as :func:`fuse_classes` has them.

    ``log_class_likelihood`` (R, C) is that of the detections; ``predicted`` (R,) is False for a
    first detection, before which no class can have changed.
    """
    if class_transition is not None:
        classes = np.where(predicted[:, None], classes @ class_transition.T, classes)
    return class_update(classes, log_class_likelihood)[0]


def fault_of_transition(class_transition: FloatArray | None, class_names: Sequence[str]) -> str:
    """Say why a class transition (K, K) does not go with these classes, or return an empty text."""
    count = len(class_names)
    if class_transition is None or len(class_transition) == count:
        return ""
    return (
        f"parameter class_transition = {class_transition.size} numbers: allowed are "
        f"{count * count} for the {count} classes {', '.join(class_names)}, or none"
    )


@lru_cache(maxsize=16)
def _compatibility(size: int, focal: bytes) -> FloatArray:
    """(F, k) one where a focal element and an element of the frame meet on Shafer's model."""
    masks = np.frombuffer(focal, dtype=np.uint32)
    alone = np.array([1 << ((1 << element) - 1) for element in range(size)], dtype=np.uint32)
    return ((masks[:, None] & alone[None, :]) != 0).astype(np.float64)


def class_prior(evidence: Evidence) -> FloatArray:
    """Class prior (C,) behind the evidence of a scan with at least one detection.

    A detection's class probabilities are proportional to prior times likelihood; the likelihood is
    taken out again at the detection that says least, where nothing is lost to rounding.
    """
    likelihood = evidence.log_class_likelihood
    row = int(np.argmin(np.ptp(likelihood, axis=1)))
    with np.errstate(divide="ignore"):
        log_prior = np.log(evidence.class_probability[row]) - likelihood[row]
    prior = np.exp(log_prior - log_prior.max())
    return np.asarray(prior / prior.sum())


def transition_matrix(class_transition: Sequence[float]) -> FloatArray | None:
    """Matrix (C, C) of a list of transition probabilities, ``None`` for an empty list.

    Parameters
    ----------
    class_transition
        p(c | c') row by row: in row c and column c' the probability that class c' has become class
        c (Mahler 2011, (93)).

    Raises
    ------
    ValueError
        If the list is not that of a square matrix of numbers >= 0 whose columns have the sum 1, for
        as many classes as a frame may have elements.
    """
    if not len(class_transition):
        return None
    values = np.array(class_transition, dtype=np.float64)
    size = isqrt(len(values))
    if size not in CLASS_COUNTS or size * size != len(values):
        raise ValueError(f"{len(values)} numbers, not as many as in a square matrix of the classes")
    matrix = values.reshape(size, size)
    if not (matrix >= 0.0).all():
        raise ValueError("a number that is not >= 0")
    sums = matrix.sum(axis=0)
    if not (np.abs(sums - 1.0) <= SUM_TOLERANCE).all():
        raise ValueError(f"columns with the sums {', '.join(f'{s:g}' for s in sums)}, not 1")
    matrix /= sums
    matrix.flags.writeable = False
    return matrix
