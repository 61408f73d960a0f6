"""Classes that change over time: Markov prediction (Mahler 2011, (93))."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

SUM_TOLERANCE = 1e-9
"""How far a column of transition probabilities may be from a sum of one."""


def class_prediction(class_probability: FloatArray, transition: FloatArray) -> FloatArray:
    """Predict class probabilities by one step of a Markov chain (Mahler 2011, (93)).

    The update that follows is :func:`gda_tracker.attributes.bayes.class_update`, (94).

    Parameters
    ----------
    class_probability
        (..., C) P(c' | history).
    transition
        (C, C) or (..., C, C) p(c | c') in row c and column c': columns have the sum 1.

    Returns
    -------
    array
        (..., C) P(c | history) a step later.

    Raises
    ------
    ValueError
        If the shapes do not fit or a column of ``transition`` is no probability distribution.

    Examples
    --------
    A submarine, submerged or snorkelling. It begins to snorkel with probability 0.1 in a step, and
    ends with 0.5.

    >>> transition = np.array([[0.9, 0.5], [0.1, 0.5]])
    >>> class_prediction(np.array([[1.0, 0.0], [0.2, 0.8]]), transition).round(3).tolist()
    [[0.9, 0.1], [0.58, 0.42]]
    """
    check_transition(transition)
    if class_probability.shape[-1:] != transition.shape[-1:]:
        raise ValueError(
            f"class_probability has the shape {class_probability.shape}: allowed is "
            f"(..., {transition.shape[-1]}), the classes of transition"
        )
    return np.asarray((transition * class_probability[..., None, :]).sum(axis=-1))


def check_transition(transition: FloatArray) -> None:
    """Raise ValueError unless every column of (..., C, C) is a probability distribution."""
    if transition.ndim < 2 or transition.shape[-1] != transition.shape[-2]:
        raise ValueError(f"transition has the shape {transition.shape}: allowed is (..., C, C)")
    columns = transition.sum(axis=-2)
    if not (transition >= 0.0).all() or not (np.abs(columns - 1.0) <= SUM_TOLERANCE).all():
        raise ValueError(
            f"transition = {transition.tolist()}: allowed are numbers >= 0 with the sum 1 in each "
            "column"
        )
