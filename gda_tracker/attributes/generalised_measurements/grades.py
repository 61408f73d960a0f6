"""Combination of memberships, whatever they are memberships in: places, values or classes.

For a statement on the class of a target the memberships of the classes, arrays (..., C), are the
likelihoods f(Theta | c) themselves: Bayes' rule and the joint likelihood (Mahler 2011, (88), (94))
take their logarithms.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def rule_grade(antecedent: FloatArray, consequent: FloatArray) -> FloatArray:
    """Membership of an inference rule g => g': min(g, g') + (1 - g)/2, elementwise.

    (Mahler 2011, (33), with g for the printed g' in the second term.)

    Examples
    --------
    "If it snorkels it is a diesel boat": classes diesel snorkelling, diesel submerged, nuclear.

    >>> rule_grade(np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0, 0.0])).tolist()
    [1.0, 0.5, 0.5]
    """
    return np.asarray(np.minimum(antecedent, consequent) + 0.5 * (1.0 - antecedent))


def mixture_grade(weights: FloatArray, grades: FloatArray) -> FloatArray:
    """Membership (...) of a fuzzy Dempster-Shafer statement: sum over l of w_l g_l.

    Parameters
    ----------
    weights
        (..., L) mass of each focal set.
    grades
        (..., L) membership in each focal set, broadcast against it. (Mahler 2011, (32))
    """
    return np.asarray((weights * grades).sum(axis=-1))
