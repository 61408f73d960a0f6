"""Rules of combination for any number of sources, one problem at a time.

A source is a mapping from elements of the free model (Venn bitmasks of
:mod:`gda_tracker.attributes.frames`) to masses that sum to one; any number of sources is fused
*jointly* under a model. Every rule looks at each tuple X1..Xk of focal elements, one of each
source, with the product of their masses, and says where that product goes. X1..Xk meet in
X1 & ... & Xk, reduced by the model; the tuple is *dead* if nothing of that is left.

``dsmc``
    To the intersection on the free lattice, whatever the model says (classic DSm rule).
``dempster``
    To the intersection; what dead tuples lose is made up by normalisation.
``disjunctive``
    To the union of the elements, reduced by the model.
``yager``
    To the intersection, of dead tuples to total ignorance.
``dubois_prade``
    To the intersection, of dead tuples to the union of the elements.
``dsmh``
    As ``dubois_prade``, but where all elements are dead to the union of their u(Xi), and if that
    is dead too to total ignorance (hybrid DSm rule, terms S1, S3 in union form, S2).
``pcr5``, ``pcr6``
    To the intersection; of dead tuples back to their distinct surviving elements, weighted by the
    product (PCR5) or the sum (PCR6) of the masses that the tuple puts on each; where none survives
    as ``dsmh``.

Elements that a model merges are one element: a source's masses on them are added before a rule
looks at them. It only matters for PCR. Dead elements stay what they are on the free lattice.

This module is the calculator: Python floats, each sum rounded once. Arrays of pairs are the work of
:mod:`gda_tracker.attributes.batches`, which looks up the same destinations.

>>> from gda_tracker.attributes.frames import element_name, parse_element, shafer_model
>>> names = ("A", "B")
>>> shafer = shafer_model(names)
>>> a, b, both = (parse_element(names, text) for text in ("A", "B", "A|B"))
>>> fused = combine("pcr5", shafer, [{a: 0.6, both: 0.4}, {b: 0.3, both: 0.7}])
>>> {element_name(names, mask, shafer): round(mass, 2) for mask, mass in fused.masses.items()}
{'A': 0.54, 'B': 0.18, 'A|B': 0.28}
>>> round(fused.conflict, 2)
0.18
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from math import fsum, isfinite, prod
from operator import and_, or_

from gda_tracker.attributes.frames import (
    Model,
    check_element,
    element_name,
    sort_elements,
    total_ignorance,
    union_of_atoms,
    upward_closure,
)
from gda_tracker.attributes.rules import TotalConflictError

__all__ = [
    "RULES",
    "Combined",
    "NothingAliveError",
    "TotalConflictError",
    "combine",
    "destination",
    "discount",
    "reduce_source",
]

RULES = ("dsmc", "dsmh", "dempster", "disjunctive", "yager", "dubois_prade", "pcr5", "pcr6")
PROPORTIONAL_RULES = ("pcr5", "pcr6")

# How far the masses of a source may be from one in sum. Nothing is rescaled.
SUM_TOLERANCE = 1e-6


class NothingAliveError(ValueError):
    """All elements of a product are dead and the rule knows no place for it."""


@dataclass(frozen=True)
class Combined:
    """Outcome of a rule of combination.

    Attributes
    ----------
    masses
        Positive masses by element in column order (``sort_elements``); elements are reduced by the
        model, under ``dsmc`` they are those of the free lattice.
    conflict
        K: sum of the products of masses of all dead tuples, under every rule, ``dsmc`` and
        ``disjunctive`` too; 0 on the free model. It says how much the sources contradict each other
        (or the model), not what became of it.
    """

    masses: dict[int, float]
    conflict: float


def check_rule(rule: str) -> str:
    """Return the name of a rule; ``ValueError`` for one that is not in ``RULES``."""
    if rule not in RULES:
        raise ValueError(f"rule = {rule!r}: allowed is one of {', '.join(RULES)}")
    return rule


def destination(rule: str, model: Model, elements: Sequence[int]) -> int:
    """Where a rule moves the product of a tuple of focal elements.

    Parameters
    ----------
    rule
        One of ``RULES``.
    model
        The model.
    elements
        Elements X1..Xk of the free model, or as reduced by the model if they survive.

    Returns
    -------
    int
        Mask of an element, 0 if the product goes to no single one: under Dempster's rule it is
        taken out, under PCR it is shared by the surviving elements, under Dubois-Prade's and the
        disjunctive rule all elements are dead, which these rules do not foresee.
    """
    alive = model.alive
    meet = reduce(and_, elements)
    if rule == "dsmc":
        return meet
    if rule == "disjunctive":
        return reduce(or_, elements) & alive
    if meet & alive:
        return meet & alive
    survivors = reduce(or_, elements) & alive
    if rule == "yager":
        return alive
    if rule == "dubois_prade" or (rule == "dsmh" and survivors):
        return survivors
    if rule == "dempster" or survivors:
        return 0
    # S2 of the hybrid DSm rule: nothing is left of any element.
    atoms = reduce(or_, (union_of_atoms(model.size, mask) for mask in elements)) & alive
    return atoms or alive


def combine(rule: str, model: Model, sources: Sequence[Mapping[int, float]]) -> Combined:
    """Fuse one or more sources jointly under a model.

    Parameters
    ----------
    rule
        One of ``RULES``. ``dsmh``, ``pcr5`` and ``pcr6`` are not associative: to fuse three sources
        at once is another rule than to fuse two and then the third.
    model
        The model; sources stay on the free lattice, whatever it is.
    sources
        Masses by Venn bitmask, each source summing to one. A mask that is an element only as
        reduced by the model (of an earlier outcome) stands for the smallest element that reduces
        to it, total ignorance for itself.

    Raises
    ------
    ValueError
        For an unknown rule, no source, a mask that is no element of the hyper-power set, a mass
        that is negative or not finite, or masses that do not sum to one.
    TotalConflictError
        Under ``dempster`` if all tuples are dead.
    NothingAliveError
        If all elements of a tuple are dead under ``dubois_prade`` and ``disjunctive``, which have
        no place for its product, or if nothing at all is alive in the model.

    Notes
    -----
    Tchamova et al. 2004, 14.3.2; Smarandache and Dezert (editors), Advances and Applications of
    DSmT, volumes 1 (DSmC, DSmH, Dubois-Prade, Yager) and 2 (PCR5, PCR6). PCR5 and PCR6 differ from
    three sources on.
    """
    check_rule(rule)
    if not model.alive:
        raise NothingAliveError("a model without any Venn part: nothing can be believed")
    if not sources:
        raise ValueError("no sources: allowed is one or more")
    bodies = [_checked(model, source, index) for index, source in enumerate(sources)]
    if rule != "dsmc":
        bodies = [reduce_source(model, body) for body in bodies]

    terms: dict[int, list[float]] = {}
    conflicts: list[float] = []
    for elements, masses in _tuples(bodies):
        amount = prod(masses)
        if not reduce(and_, elements) & model.alive:
            conflicts.append(amount)
        target = destination(rule, model, elements)
        if target:
            terms.setdefault(target, []).append(amount)
        elif rule in PROPORTIONAL_RULES:
            _share(_WEIGHT[rule], model, elements, masses, terms)
        elif rule != "dempster":
            names = ", ".join(element_name(model.names, mask) for mask in elements)
            raise NothingAliveError(
                f"{names}: all dead on the model, and rule {rule!r} has no place for their mass; "
                "dsmh, pcr5, pcr6 and yager have"
            )
    sums = {mask: fsum(parts) for mask, parts in terms.items()}
    if rule == "dempster":
        sums = _normalised(model, sums, bodies)
    order = sort_elements(sums).tolist()
    return Combined(
        masses={mask: sums[mask] for mask in order if sums[mask] > 0.0}, conflict=fsum(conflicts)
    )


def discount(source: Mapping[int, float], reliability: float, model: Model) -> dict[int, float]:
    """Discounting: m'(A) = reliability m(A), the rest goes to total ignorance (Shafer 1976).

    Parameters
    ----------
    source
        Masses by element, as in :func:`combine`.
    reliability
        1 changes nothing, 0 leaves total ignorance.
    model
        The model. Elements stay on the free lattice; :func:`reduce_source` reduces them.

    Returns
    -------
    dict
        Positive masses by element of the free model, in column order.

    Raises
    ------
    ValueError
        For masses as in :func:`combine` or a reliability outside 0 to 1.
    """
    if not 0.0 <= reliability <= 1.0:
        raise ValueError(f"reliability = {reliability}: allowed is 0 to 1")
    body = _checked(model, source, 0)
    discounted = {mask: reliability * mass for mask, mass in body.items()}
    ignorance = total_ignorance(model.size)
    discounted[ignorance] = fsum((discounted.get(ignorance, 0.0), 1.0, -reliability))
    order = sort_elements(discounted).tolist()
    return {mask: discounted[mask] for mask in order if discounted[mask] > 0.0}


def reduce_source(model: Model, source: Mapping[int, float]) -> dict[int, float]:
    """Masses of a source with its surviving elements reduced by the model and merged.

    Dead elements keep their mask of the free lattice, from which u(X) is taken.
    """
    merged: dict[int, list[float]] = {}
    for mask, mass in source.items():
        merged.setdefault(mask & model.alive or mask, []).append(mass)
    return {mask: fsum(masses) for mask, masses in merged.items()}


def _checked(model: Model, source: Mapping[int, float], index: int) -> dict[int, float]:
    """Return the elements with mass of a source, as elements of the free model."""
    body: dict[int, float] = {}
    for mask, value in source.items():
        mass = float(value)
        if not isfinite(mass) or mass < 0.0:
            raise ValueError(
                f"source {index}, mass {mass} of mask {int(mask):#x}: allowed is 0 or more"
            )
        free = _free_element(model, int(mask))
        if mass > 0.0:
            body[free] = body.get(free, 0.0) + mass
    total = fsum(body.values())
    if abs(total - 1.0) > SUM_TOLERANCE:
        raise ValueError(f"source {index}: masses sum to {total:.9g}, allowed is 1")
    return body


def _free_element(model: Model, mask: int) -> int:
    if mask == model.alive:
        return total_ignorance(model.size)
    closed = upward_closure(model.size, mask)
    if mask > 0 and closed & model.alive == mask:
        return closed
    return check_element(model.names, mask)


def _tuples(
    bodies: Sequence[Mapping[int, float]],
) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
    for choice in product(*(body.items() for body in bodies)):
        elements, masses = zip(*choice, strict=True)
        yield elements, masses


_WEIGHT: dict[str, Callable[[Sequence[float]], float]] = {"pcr5": prod, "pcr6": fsum}


def _share(
    weigh: Callable[[Sequence[float]], float],
    model: Model,
    elements: Sequence[int],
    masses: Sequence[float],
    terms: dict[int, list[float]],
) -> None:
    """Give the product of a dead tuple back to its distinct surviving elements."""
    amount = prod(masses)
    if amount == 0.0:  # underflow: weights of zero cannot share it, and nothing is lost
        return
    on: dict[int, list[float]] = {}
    for element, mass in zip(elements, masses, strict=True):
        if element & model.alive:
            on.setdefault(element & model.alive, []).append(mass)
    weights = {element: weigh(values) for element, values in on.items()}
    total = fsum(weights.values())
    for element, weight in weights.items():
        terms.setdefault(element, []).append(amount * (weight / total))


def _normalised(
    model: Model, sums: Mapping[int, float], bodies: Sequence[Mapping[int, float]]
) -> dict[int, float]:
    """Divide by what is not in conflict; a sum of the rest, as 1 - K would lose its digits."""
    rest = fsum(sums.values())
    if rest >= sys.float_info.min:
        return {mask: mass / rest for mask, mass in sums.items()}
    # Products that underflow, or none: rational numbers tell.
    exact: dict[int, Fraction] = {}
    for elements, masses in _tuples(bodies):
        meet = reduce(and_, elements) & model.alive
        if meet:
            exact[meet] = exact.get(meet, Fraction(0)) + prod(map(Fraction, masses))
    if not exact:
        raise TotalConflictError("total conflict: no element of one source meets all the others")
    whole = sum(exact.values())
    return {mask: float(mass / whole) for mask, mass in exact.items()}
