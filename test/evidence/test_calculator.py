"""The calculator from text to names, probabilities and entropy, against ``evidencelib``."""

import json
import math

import evidencelib
import numpy as np
import pytest

from gda_tracker.evidence.calculator import solve
from gda_tracker.evidence.frames import (
    constrained_model,
    element_name,
    free_model,
    hyper_power_set,
    parse_element,
)
from gda_tracker.evidence.problem import RULES, read_problem
from gda_tracker.evidence.rules import TotalConflictError

PROBLEMS_PER_RULE = 40


def random_problem(random, rule):
    """A problem on two to four elements with up to two constraints, and its model."""
    names = tuple("ABCD"[: random.integers(2, 5)])
    elements = hyper_power_set(len(names)).tolist()
    model, empty = free_model(names), []
    for mask in random.permutation(elements)[: random.integers(0, 3)].tolist():
        # dsmc of evidencelib is for the free model; and a constraint must leave something.
        if rule != "dsmc" and model.alive & ~mask:
            empty.append(element_name(names, mask))
            model = constrained_model(names, empty)
    # evidencelib has a place for the mass of dead elements under the hybrid rule alone.
    allowed = [mask for mask in elements if rule == "dsmh" or mask & model.alive]
    sources = []
    for _ in range(1 if rule in ("discount", "pignistic") else random.integers(2, 4)):
        focal = random.permutation(allowed)[: random.integers(1, 6)].tolist()
        masses = random.dirichlet(np.ones(len(focal))).tolist()
        named = [element_name(names, mask) for mask in focal]
        sources.append(dict(zip(named, masses, strict=True)))
    problem = {"frame": names, "model": {"empty": empty}, "sources": sources, "rule": rule}
    if rule == "discount":
        problem["reliability"] = random.random()
    return problem, model


def by_evidencelib(problem, rule):
    """Their body of evidence and its conflict."""
    names, empty = problem["frame"], problem["model"]["empty"]
    free, model = evidencelib.Frame.dsmt(names), evidencelib.Frame.hybrid(names, empty=empty)
    first, *others = [(free if rule == "dsmh" else model).mass(s) for s in problem["sources"]]
    if rule == "pignistic":
        return first, first.conflict
    if rule == "discount":
        return first.discount(problem["reliability"]), first.conflict
    conflict = first.conjunctive(*others, model=model).conflict
    if rule == "dsmh":
        return first.dsmh(*others, model=model), conflict
    return getattr(first, rule)(*others), conflict


@pytest.mark.parametrize("rule", RULES)
def test_random_problems_agree_with_evidencelib(rule):
    random = np.random.default_rng(RULES.index(rule))
    solved = 0
    for _ in range(PROBLEMS_PER_RULE):
        problem, model = random_problem(random, rule)
        try:
            expected, conflict = by_evidencelib(problem, rule)
        except evidencelib.exceptions.TotalConflictError:
            with pytest.raises(TotalConflictError):
                solve(read_problem(json.dumps(problem)))
            continue
        solved += 1
        (found,) = solve(read_problem(json.dumps(problem)))
        assert found.conflict == pytest.approx(conflict, abs=1e-12)
        assert found.pignistic == pytest.approx(expected.pignistic(), abs=1e-12)
        parts = [p for p in expected.pignistic_regions().values() if p > 0]
        entropy = -sum(p * math.log(p) for p in parts)
        assert found.entropy_nats == pytest.approx(entropy, abs=1e-12)
        if rule == "pignistic":
            assert found.result == found.pignistic
            continue
        # Names differ where a model merges elements: each must read as the same Venn parts.
        theirs, ours = (
            {parse_element(model.names, name) & model.alive: mass for name, mass in named}
            for named in (
                ((str(element), mass) for element, mass in expected.items()),
                found.result.items(),
            )
        )
        assert len(ours) == len(found.result)
        assert ours == pytest.approx(theirs, abs=1e-12)
    assert solved > PROBLEMS_PER_RULE // 2


def test_names_are_the_canonical_ones_in_column_order():
    problem = {
        "frame": ["A", "B", "C"],
        "model": {"empty": ["A&C"]},
        "sources": [{"A|B|C": 0.25, "(A|B)&C": 0.25, "C&B|A": 0.25, "C": 0.25}],
        "rule": "discount",
        "reliability": 1,
    }
    (found,) = solve(read_problem(json.dumps(problem)))
    # (A|B)&C is B&C where A&C is empty.
    assert list(found.result) == ["C", "B&C", "A|B&C", "A|B|C"]
