"""Where the rules of combination move the product of a tuple of focal elements.

A tuple X1..Xk has one focal element of each source. It meets in X1 & ... & Xk, reduced by the
model, and is *dead* if nothing of that is left. By rule its product of masses goes

``dsmc``
    to the intersection on the free lattice, whatever the model says (classic DSm rule);
``dempster``
    to the intersection; what dead tuples lose is made up by normalisation;
``disjunctive``
    to the union of the elements, reduced by the model;
``yager``
    to the intersection, of dead tuples to total ignorance;
``dubois_prade``
    to the intersection, of dead tuples to the union of the elements;
``dsmh``
    as ``dubois_prade``, but where all elements are dead to the union of their u(Xi), and if that
    is dead too to total ignorance (hybrid DSm rule, terms S1, S3 in union form, S2);
``pcr5``, ``pcr6``
    to the intersection; of dead tuples back to their distinct surviving elements, weighted by the
    product (PCR5) or the sum (PCR6) of the masses that the tuple puts on each; where none survives
    as ``dsmh``.

Elements that a model merges are one element: a source's masses on them are added before a rule
looks at them. It only matters for PCR. Dead elements stay what they are on the free lattice.

This is the one place that knows the rules; :mod:`gda_tracker.evidence.combination` (one problem)
and :mod:`gda_tracker.evidence.batches` (arrays of pairs) carry them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from math import prod

import numpy as np

from gda_tracker.evidence.frames import Model, union_of_atoms
from gda_tracker.vocabulary.arrays import BoolArray, MaskArray

RULES = ("dsmc", "dsmh", "dempster", "disjunctive", "yager", "dubois_prade", "pcr5", "pcr6")
PROPORTIONAL_RULES = ("pcr5", "pcr6")

# 8 million tuples take some hundred megabytes while they are looked at. All 7579 x 7579 pairs of
# the elements of a frame of five are more; two sources on all 166 elements of four are far less.
MAX_TUPLES = 1 << 23


class NothingAliveError(ValueError):
    """All elements of a tuple are dead and the rule knows no place for its product."""


def check_rule(rule: str) -> str:
    """Return the name of a rule; ``ValueError`` for one that is not in ``RULES``."""
    if rule not in RULES:
        raise ValueError(f"rule = {rule!r}: allowed is one of {', '.join(RULES)}")
    return rule


@dataclass(frozen=True, slots=True)
class Destinations:
    """Where the products of all T = E1 x ... x Ek tuples go, the last source varying fastest.

    Attributes
    ----------
    target
        (T,) masks: an element as reduced by the model (``dsmc``: of the free lattice), 0 where the
        product goes to no single one.
    dead
        (T,) whether nothing is left of the intersection; the sum of these products is the conflict.
    shared
        (T,) whether the product is shared by two or more surviving elements (PCR).
    homeless
        (T,) whether all elements are dead and the rule has no place for the product (Dubois-Prade's
        and the disjunctive rule).
    """

    target: MaskArray
    dead: BoolArray
    shared: BoolArray
    homeless: BoolArray


def destinations(rule: str, model: Model, columns: Sequence[MaskArray]) -> Destinations:
    """Where a rule moves the product of each tuple of focal elements.

    Parameters
    ----------
    rule
        One of ``RULES``.
    model
        The model.
    columns
        (Es,) focal elements of each source: masks of the free model, or as reduced by the model if
        they survive (not under ``dsmc``).

    Raises
    ------
    ValueError
        For an unknown rule, no source, or more than ``MAX_TUPLES`` tuples.
    NothingAliveError
        If the model has no Venn part.
    """
    check_rule(rule)
    if not model.alive:
        raise NothingAliveError("a model without any Venn part: nothing can be believed")
    if not len(columns):
        raise ValueError("no sources: allowed is one or more")
    sizes = [len(column) for column in columns]
    if prod(sizes) > MAX_TUPLES:
        raise ValueError(
            f"sources with {' x '.join(map(str, sizes))} focal elements: allowed are up to "
            f"{MAX_TUPLES} tuples, more do not fit into memory"
        )
    elements = [np.asarray(column, dtype=np.uint32) for column in columns]
    alive = np.uint32(model.alive)
    meet = _over_tuples(np.bitwise_and, elements)
    dead = (meet & alive) == 0
    union = _over_tuples(np.bitwise_or, elements) & alive
    shared = homeless = np.zeros(dead.shape, dtype=np.bool_)
    if rule == "dsmc":
        target = meet
    elif rule == "disjunctive":
        target, homeless = union, union == 0
    elif rule == "dempster":
        target = meet & alive
    elif rule == "yager":
        target = np.where(dead, alive, meet & alive)
    elif rule == "dubois_prade":
        target, homeless = np.where(dead, union, meet & alive), union == 0
    elif rule == "dsmh":
        nowhere = np.where(union == 0, _ignorance(model, elements), union)
        target = np.where(dead, nowhere, meet & alive)
    else:
        # Of survivors alone the intersection is their union only if all are one element.
        lone = _over_tuples(np.bitwise_and, [np.where(x & alive, x, alive) for x in elements])
        shared = dead & (union != 0) & ((lone & alive) != union)
        nowhere = np.where(union == 0, _ignorance(model, elements), union)
        target = np.where(dead, nowhere, meet & alive)
        target[shared] = 0
    return Destinations(target, dead, shared, homeless)


def _over_tuples(operation: np.ufunc, elements: Sequence[MaskArray]) -> MaskArray:
    return np.asarray(reduce(operation.outer, elements), dtype=np.uint32).reshape(-1)


def _ignorance(model: Model, elements: Sequence[MaskArray]) -> MaskArray:
    """Union of the u(Xi) of each tuple, total ignorance where that is dead (S2)."""
    alive = np.uint32(model.alive)
    atoms = [
        np.array([union_of_atoms(model.size, mask) for mask in column.tolist()], dtype=np.uint32)
        for column in elements
    ]
    union = _over_tuples(np.bitwise_or, atoms) & alive
    return np.where(union == 0, alive, union)
