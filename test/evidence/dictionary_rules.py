"""Rules of combination on dictionaries and sets of sets: a second implementation, slow and plain.

A Venn part is the frozenset of the elements it is inside of, a focal element the frozenset of its
parts.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations, product
from math import prod

import numpy as np


def all_parts(names):
    sizes = range(1, len(names) + 1)
    return [frozenset(part) for size in sizes for part in combinations(names, size)]


def atom(names, name):
    return frozenset(part for part in all_parts(names) if name in part)


def from_mask(names, mask):
    """Element of a bitmask: bit s - 1 is the part inside the elements whose bits are set in s."""
    return frozenset(
        frozenset(name for i, name in enumerate(names) if (bit + 1) >> i & 1)
        for bit in range(2 ** len(names) - 1)
        if mask >> bit & 1
    )


def from_row(names, focal, row):
    """Dictionary of the masses that are not zero."""
    result = defaultdict(float)
    for mask, mass in zip(np.asarray(focal).tolist(), np.asarray(row).tolist(), strict=True):
        if mass:
            result[from_mask(names, mask)] += mass
    return dict(result)


def conjunctive(first, second):
    result = defaultdict(float)
    for a, mass_a in first.items():
        for b, mass_b in second.items():
            result[a & b] += mass_a * mass_b
    return dict(result)


def shafer_parts(names):
    return frozenset(frozenset([name]) for name in names)


def reduced(masses, alive):
    result = defaultdict(float)
    for element, mass in masses.items():
        result[element & alive] += mass
    return dict(result)


def dempster(names, first, second):
    """Masses on Shafer's model and the conflict; ``None`` for masses in total conflict."""
    alive = shafer_parts(names)
    fused = conjunctive(reduced(first, alive), reduced(second, alive))
    conflict = fused.pop(frozenset(), 0.0)
    rest = sum(fused.values())
    return ({x: m / rest for x, m in fused.items()} if rest else None), conflict


def union_of_atoms(names, element):
    terms = [p for p in element if not any(q < p for q in element)]
    named = frozenset().union(*terms)
    return frozenset().union(*(atom(names, name) for name in named))


def project(names, masses, alive):
    result = defaultdict(float)
    for element, mass in masses.items():
        target = element & alive or union_of_atoms(names, element) & alive or alive
        result[target] += mass
    return dict(result)


def pignistic(masses, alive, event):
    return sum(m * len(x & event & alive) / len(x & alive) for x, m in masses.items())


class NoAnswer(Exception):
    """The rule says nothing about these sources."""


def combine(rule, names, alive, sources):
    """Any rule on any number of sources, and the mass of the dead tuples.

    ``sources`` are dictionaries over sets of parts of the free model; the outcome is over sets of
    parts that are alive, under dsmc over sets of parts of the free model.
    """
    result, conflict = defaultdict(float), 0.0
    if rule.startswith("pcr"):
        sources = [merged(source, alive) for source in sources]
    for choice in product(*(source.items() for source in sources)):
        amount = prod(mass for _, mass in choice)
        meet = frozenset.intersection(*(x for x, _ in choice))
        union = frozenset.union(*(x for x, _ in choice))
        dead = not meet & alive
        conflict += amount if dead else 0.0
        if rule == "dsmc":
            result[meet] += amount
        elif rule == "disjunctive":
            if not union & alive:
                raise NoAnswer
            result[union & alive] += amount
        elif not dead:
            result[meet & alive] += amount
        elif rule == "yager":
            result[alive] += amount
        elif rule == "dubois_prade":
            if not union & alive:
                raise NoAnswer
            result[union & alive] += amount
        elif rule != "dempster":
            if not union & alive:
                atoms = frozenset.union(*(union_of_atoms(names, x) for x, _ in choice))
                result[atoms & alive or alive] += amount
            elif rule == "dsmh":
                result[union & alive] += amount
            else:
                share(rule, alive, choice, amount, result)
    if rule == "dempster":
        rest = sum(result.values())
        if not rest:
            raise NoAnswer
        result = {x: m / rest for x, m in result.items()}
    return dict(result), conflict


def merged(masses, alive):
    """Elements that a model merges as one; dead ones as they are."""
    result = defaultdict(float)
    for element, mass in masses.items():
        result[element & alive or element] += mass
    return dict(result)


def share(rule, alive, choice, amount, result):
    survivors = {x & alive for x, _ in choice} - {frozenset()}
    weight = {}
    for survivor in survivors:
        masses = [mass for x, mass in choice if x & alive == survivor]
        weight[survivor] = prod(masses) if rule == "pcr5" else sum(masses)
    for survivor in survivors:
        result[survivor] += amount * weight[survivor] / sum(weight.values())


def assert_same(found, expected, tolerance=1e-12):
    for element in found.keys() | expected.keys():
        assert abs(found.get(element, 0.0) - expected.get(element, 0.0)) <= tolerance, element
