"""Rules of combination for any number of sources, one problem at a time.

A source is a mapping from elements of the free model (Venn bitmasks of
:mod:`gda_tracker.evidence.frames`) to masses that sum to one; any number of sources is fused
*jointly* under a model. The rules are those of :mod:`gda_tracker.evidence.destinations`. This is
the calculator: sums are rounded once. Arrays of pairs are the work of
:mod:`gda_tracker.evidence.batches`.

>>> from gda_tracker.evidence.frames import element_name, parse_element, shafer_model
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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from math import fsum, isfinite, prod

import numpy as np

from gda_tracker.evidence.destinations import RULES, Destinations, NothingAliveError, destinations
from gda_tracker.evidence.frames import (
    Model,
    element_name,
    free_element,
    sort_elements,
    total_ignorance,
)
from gda_tracker.evidence.rules import TotalConflictError
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

__all__ = [
    "RULES",
    "Combined",
    "NothingAliveError",
    "TotalConflictError",
    "combine",
    "discount",
    "reduce_source",
]

# How far the masses of a source may be from one in sum. Nothing is rescaled.
SUM_TOLERANCE = 1e-6


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
        that is negative or not finite, masses that do not sum to one, or more tuples of focal
        elements than memory allows.
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
    bodies = [_checked(model, source, index) for index, source in enumerate(sources)]
    if rule != "dsmc":
        bodies = [reduce_source(model, body) for body in bodies]
    moves = destinations(rule, model, [np.array(list(body), dtype=np.uint32) for body in bodies])
    masses = [np.array(list(body.values())) for body in bodies]
    amounts = reduce(np.multiply.outer, masses).reshape(-1)
    if moves.homeless.any():
        raise NothingAliveError(_no_place(rule, model, bodies, int(np.argmax(moves.homeless))))

    terms = _by_target(moves, amounts)
    if moves.shared.any():
        _share(rule, model, bodies, moves.shared, terms)
    sums = {mask: fsum(parts) for mask, parts in terms.items()}
    if rule == "dempster":
        sums = _normalised(sums, moves, bodies)
    return Combined(_positive(sums), conflict=fsum(amounts[moves.dead].tolist()))


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
    return _positive(discounted)


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
        free = free_element(model, int(mask))
        if mass > 0.0:
            body[free] = body.get(free, 0.0) + mass
    total = fsum(body.values())
    if abs(total - 1.0) > SUM_TOLERANCE:
        raise ValueError(f"source {index}: masses sum to {total:.9g}, allowed is 1")
    return body


def _positive(masses: Mapping[int, float]) -> dict[int, float]:
    return {mask: masses[mask] for mask in sort_elements(masses).tolist() if masses[mask] > 0.0}


def _by_target(moves: Destinations, amounts: FloatArray) -> dict[int, list[float]]:
    terms: dict[int, list[float]] = {}
    for mask, amount in zip(moves.target.tolist(), amounts.tolist(), strict=True):
        if mask:
            terms.setdefault(mask, []).append(amount)
    return terms


def _no_place(rule: str, model: Model, bodies: Sequence[Mapping[int, float]], index: int) -> str:
    choice = np.unravel_index(index, [len(body) for body in bodies])
    elements = (list(body)[chosen] for body, chosen in zip(bodies, choice, strict=True))
    names = ", ".join(element_name(model.names, mask) for mask in elements)
    return (
        f"{names}: all dead on the model, and rule {rule!r} has no place for their mass; "
        "dsmh, pcr5, pcr6 and yager have"
    )


def _share(
    rule: str,
    model: Model,
    bodies: Sequence[Mapping[int, float]],
    shared: BoolArray,
    terms: dict[int, list[float]],
) -> None:
    """Give the products of dead tuples back to their distinct surviving elements."""
    weigh = prod if rule == "pcr5" else fsum
    choices = product(*(body.items() for body in bodies))
    for choice, is_shared in zip(choices, shared.tolist(), strict=True):
        amount = prod(mass for _, mass in choice)
        # An underflow leaves weights of zero, and nothing to share.
        if not is_shared or amount == 0.0:
            continue
        masses: dict[int, list[float]] = {}
        for element, mass in choice:
            if element & model.alive:
                masses.setdefault(element & model.alive, []).append(mass)
        weights = {element: weigh(values) for element, values in masses.items()}
        total = fsum(weights.values())
        for element, weight in weights.items():
            terms.setdefault(element, []).append(amount * (weight / total))


def _normalised(
    sums: Mapping[int, float], moves: Destinations, bodies: Sequence[Mapping[int, float]]
) -> dict[int, float]:
    """Divide by what is not in conflict; a sum of the rest, as 1 - K would lose its digits."""
    if not sums:
        raise TotalConflictError("total conflict: all products of the sources' masses contradict")
    rest = fsum(sums.values())
    if rest >= sys.float_info.min:
        return {mask: mass / rest for mask, mass in sums.items()}
    # The products underflow; rational numbers do not.
    exact = dict.fromkeys(sums, Fraction(0))
    tuples = product(*(body.values() for body in bodies))
    for mask, masses in zip(moves.target.tolist(), tuples, strict=True):
        if mask:
            exact[mask] += prod(map(Fraction, masses))
    whole = sum(exact.values())
    return {mask: float(mass / whole) for mask, mass in exact.items()}
