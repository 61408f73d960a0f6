"""Solves a problem of evidence: the calculator behind ``gda-tracker fuse``.

>>> from gda_tracker.evidence.problem import read_problem
>>> zadeh = read_problem('{"frame": ["M", "C", "T"], "model": "shafer", "rule": "dempster",'
...                      ' "sources": [{"M": 0.9, "T": 0.1}, {"C": 0.9, "T": 0.1}]}')
>>> solve(zadeh)[0].result
{'T': 1.0}
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.evidence.combination import (
    NothingAliveError,
    combine,
    discount,
    reduce_source,
)
from gda_tracker.evidence.decisions import generalised_pignistic, pignistic_entropy
from gda_tracker.evidence.frames import (
    Model,
    element_name,
    free_model,
    sort_elements,
    upward_closure,
)
from gda_tracker.evidence.problem import Problem, ProblemError


@dataclass(frozen=True)
class Solution:
    """What a rule makes of the sources.

    Attributes
    ----------
    result
        Masses > 0 by element name, as the model sees the elements; what is dead on the model and
        still has mass (rules ``dsmc`` and ``discount``) goes by its name on the free model. For
        ``pignistic`` the probability of each of the frame's elements.
    conflict
        K, the mass of the products of focal elements that are empty on the model, under every
        rule; for a single source the mass of its elements that are.
    pignistic
        Generalised pignistic probability of each of the frame's elements on the model. Where
        elements overlap they sum to more than one.
    entropy_nats
        Pignistic entropy over the disjoint parts of the model, natural logarithm.
    """

    result: dict[str, float]
    conflict: float
    pignistic: dict[str, float]
    entropy_nats: float


def solve(problem: Problem) -> list[Solution]:
    """Solve a problem: one solution, or with ``discount`` one per source, in their order.

    Raises
    ------
    TotalConflictError
        If Dempster's rule has no answer.
    ProblemError
        If the rule has no place for the mass of elements that are dead on the model.
    """
    model, rule = problem.model, problem.rule
    if rule == "pignistic":
        (source,) = problem.sources
        transformed = _solution(model, source, _dead_mass(model, source))
        return [replace(transformed, result=transformed.pignistic)]
    if rule == "discount":
        assert problem.reliability is not None  # the reader asks for it
        discounted = [discount(source, problem.reliability, model) for source in problem.sources]
        return [_solution(model, source, _dead_mass(model, source)) for source in discounted]
    try:
        combined = combine(rule, model, problem.sources)
    except NothingAliveError as error:
        raise ProblemError(str(error)) from None
    if rule == "dsmc":
        return [_solution(model, combined.masses, combined.conflict, free_model(model.names))]
    return [_solution(model, combined.masses, combined.conflict)]


def _solution(
    model: Model, masses: Mapping[int, float], conflict: float, seen_by: Model | None = None
) -> Solution:
    """Name the elements, as ``seen_by`` or the model sees them, and decide on the model."""
    # Elements that the model merges have one name.
    seen = reduce_source(seen_by or model, masses)
    # Decisions want elements of the free model, and an order that does not depend on the rule.
    focal = sort_elements(upward_closure(model.size, mask) for mask in seen)
    closed = {upward_closure(model.size, mask): mass for mask, mass in seen.items()}
    column = np.array([closed[mask] for mask in focal.tolist()])
    return Solution(
        result={_name(seen_by or model, mask): closed[mask] for mask in focal.tolist()},
        conflict=conflict,
        pignistic=dict(
            zip(model.names, generalised_pignistic(model, focal, column).tolist(), strict=True)
        ),
        # Adding zero makes -0.0, the entropy of what is certain, 0.0.
        entropy_nats=float(pignistic_entropy(model, focal, column, base=math.e)) + 0.0,
    )


def _name(model: Model, mask: int) -> str:
    return element_name(model.names, mask, model if mask & model.alive else None)


def _dead_mass(model: Model, source: Mapping[int, float]) -> float:
    return math.fsum(mass for mask, mass in source.items() if not mask & model.alive)
