"""Decisions: from masses on the free model to probabilities and entropies on a model.

Histories stay on the free model; a model (Shafer's, to decide on a class) is applied when a
decision is asked for. That is the hybrid DSm rule as a projection: the mass of an element that the
model empties goes to the union of its atoms (Tchamova et al. 2004, 14.3.2.2). A history can so be
seen in both frames of figure 14.8, on the free model of Theta1 and on Shafer's model of Theta2.

>>> from gda_tracker.evidence.frames import shafer_model
>>> names, focal = ("A", "B"), np.array([0b101, 0b100], dtype=np.uint32)      # A, A&B
>>> generalised_pignistic(shafer_model(names), focal, np.array([[0.5, 0.5]])).tolist()
[[0.75, 0.25]]
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import xlogy

from gda_tracker.evidence.frames import (
    Model,
    singletons,
    sort_elements,
)
from gda_tracker.evidence.rules import move_to_model
from gda_tracker.vocabulary.arrays import FloatArray, MaskArray


def project(model: Model, focal: MaskArray, masses: FloatArray) -> tuple[MaskArray, FloatArray]:
    """Hybrid DSm rule as a projection of masses on the free model onto a model.

    Parameters
    ----------
    model
        The model.
    focal
        (E,) Venn bitmasks, elements of the free model.
    masses
        (..., E) masses.

    Returns
    -------
    focal, masses
        (E',) elements as reduced by the model, without repetition, in the order of
        :func:`~gda_tracker.evidence.frames.sort_elements`, and (..., E') masses; none is lost.
    """
    moved = [move_to_model(model, mask) for mask in np.asarray(focal).tolist()]
    reduced = sort_elements(set(moved))
    column = {mask: index for index, mask in enumerate(reduced.tolist())}
    matrix = np.zeros((len(moved), len(reduced)))
    matrix[np.arange(len(moved)), [column[mask] for mask in moved]] = 1.0
    return reduced, masses @ matrix


def part_probability(model: Model, focal: MaskArray, masses: FloatArray) -> FloatArray:
    """Pignistic probabilities (..., V) of the V Venn parts that exist in the model, in mask order.

    Each focal element shares its mass equally among its parts: they sum to one.
    """
    return masses @ _part_matrix(model, np.asarray(focal, dtype=np.uint32).tobytes())


def generalised_pignistic(model: Model, focal: MaskArray, masses: FloatArray) -> FloatArray:
    """Generalised pignistic probability of the frame's k elements.

    P(A) = sum over X of C(X & A)/C(X) m(X), where C counts the Venn parts that exist (Dezert,
    Smarandache and Daniel 2004). On Shafer's model this is BetP and sums to one; where elements
    overlap it does not.

    Parameters
    ----------
    model
        The model; the mass of elements that are dead on it is moved first, as by :func:`project`.
    focal
        (E,) Venn bitmasks, elements of the free model.
    masses
        (..., E) masses.

    Returns
    -------
    (..., k) array
    """
    return masses @ pignistic_matrix(model, focal)


def pignistic_matrix(model: Model, focal: MaskArray) -> FloatArray:
    """Matrix (E, k) that takes masses to generalised pignistic probabilities."""
    return _pignistic_matrix(model, np.asarray(focal, dtype=np.uint32).tobytes())


def belief(model: Model, focal: MaskArray, masses: FloatArray, elements: MaskArray) -> FloatArray:
    """Belief of elements: the mass of all that is inside of them (Shafer 1976).

    Parameters
    ----------
    model
        The model; the mass of elements that are dead on it is moved first, as by :func:`project`.
    focal
        (E,) Venn bitmasks, elements of the free model.
    masses
        (..., E) masses.
    elements
        (Q,) Venn bitmasks of the elements asked for; of a dead one belief is 0.

    Returns
    -------
    (..., Q) array
    """
    moved, asked = _moved(model, focal), model.reduce(elements)
    return masses @ ((moved[:, None] & asked[None, :]) == moved[:, None]).astype(np.float64)


def plausibility(
    model: Model, focal: MaskArray, masses: FloatArray, elements: MaskArray
) -> FloatArray:
    """Plausibility of elements: the mass of all that meets them (Shafer 1976).

    Arguments and result as of :func:`belief`.
    """
    moved, asked = _moved(model, focal), model.reduce(elements)
    return masses @ ((moved[:, None] & asked[None, :]) != 0).astype(np.float64)


def _moved(model: Model, focal: MaskArray) -> MaskArray:
    return np.array(
        [move_to_model(model, mask) for mask in np.asarray(focal).tolist()], dtype=np.uint32
    )


def pignistic_entropy(
    model: Model, focal: MaskArray, masses: FloatArray, base: float = 2.0
) -> FloatArray:
    """Pignistic entropy (...): -sum of P log P over the model's disjoint parts, in bits by default.

    ``base`` is the base of the logarithm. (Tchamova et al. 2004, figure 14.8)
    """
    probability = part_probability(model, focal, masses)
    return -xlogy(probability, probability).sum(axis=-1) / np.log(base)


@lru_cache(maxsize=128)
def _part_matrix(model: Model, focal: bytes) -> FloatArray:
    moved = [move_to_model(model, mask) for mask in np.frombuffer(focal, np.uint32).tolist()]
    alive = [bit for bit in range(model.alive.bit_length()) if model.alive >> bit & 1]
    matrix = np.array([[mask >> bit & 1 for bit in alive] for mask in moved], dtype=np.float64)
    matrix = matrix.reshape(len(moved), len(alive))
    matrix /= matrix.sum(axis=1, keepdims=True)
    matrix.flags.writeable = False
    return matrix


@lru_cache(maxsize=128)
def _pignistic_matrix(model: Model, focal: bytes) -> FloatArray:
    alive = [bit for bit in range(model.alive.bit_length()) if model.alive >> bit & 1]
    inside = np.array(
        [[mask >> bit & 1 for mask in singletons(model.size)] for bit in alive], dtype=np.float64
    )
    matrix = _part_matrix(model, focal) @ inside
    matrix.flags.writeable = False
    return matrix
