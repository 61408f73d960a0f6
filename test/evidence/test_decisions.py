import evidencelib
import numpy as np
import pytest
from dictionary_rules import (
    all_parts,
    assert_same,
    atom,
    from_row,
    pignistic,
    project,
    shafer_parts,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from random_evidence import random_model

from gda_tracker.evidence import decisions, rules
from gda_tracker.evidence.frames import (
    constrained_model,
    element_name,
    free_model,
    hyper_power_set,
    parse_element,
    shafer_model,
    singletons,
)

NAMES = ("a", "b", "c", "d")
seeds = st.integers(0, 2**32 - 1)


def columns(names, texts):
    return np.array([parse_element(names, text) for text in texts], dtype=np.uint32)


def random_masses(size, seed, focal=None, rows=4):
    random = np.random.default_rng(seed)
    if focal is None:
        focal = random.permutation(hyper_power_set(size))[: random.integers(1, 8)]
    return np.array(focal, dtype=np.uint32), random.dirichlet(np.ones(len(focal)), rows)


def test_projection_onto_shafers_model_by_hand():
    names = ("FA", "F", "C")
    focal = columns(names, ["F", "F&C", "FA&F|C", "FA&F&C", "FA&C", "F|FA&C"])
    masses = np.array([[0.1, 0.2, 0.3, 0.15, 0.05, 0.2]])
    reduced, moved = decisions.project(shafer_model(names), focal, masses)
    found = {
        element_name(names, mask, shafer_model(names)): mass
        for mask, mass in zip(reduced, moved[0], strict=True)
    }
    # F&C goes to F|C, FA&C to FA|C, all three to all; FA&F|C is C, F|FA&C is F.
    assert found == pytest.approx({"F": 0.3, "F|C": 0.2, "C": 0.3, "FA|F|C": 0.15, "FA|C": 0.05})


def test_an_element_whose_atoms_are_all_dead_becomes_ignorance():
    names = ("A", "B", "C")
    model = constrained_model(names, ["A|B"])
    reduced, moved = decisions.project(model, columns(names, ["A&B", "C"]), np.array([[0.7, 0.3]]))
    assert reduced.tolist() == [model.alive]
    assert moved == pytest.approx(np.ones((1, 1)))


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(1, 4))
def test_projection_agrees_with_dictionaries(seed, size):
    names, (focal, masses) = NAMES[:size], random_masses(size, seed)
    model = shafer_model(names)
    reduced, moved = decisions.project(model, focal, masses)
    for row in range(len(masses)):
        expected = project(names, from_row(names, focal, masses[row]), shafer_parts(names))
        assert_same(from_row(names, reduced, moved[row]), expected)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 4))
def test_projection_is_the_hybrid_rule_of_evidencelib(seed, size):
    # With focal elements that are atoms, fusing on the free model and projecting is the joint rule.
    names, model = NAMES[:size], free_model(NAMES[:size])
    sources = [random_masses(size, seed + i, singletons(size), rows=1) for i in range(3)]
    focal, masses = sources[0]
    for other_focal, other in sources[1:]:
        table = rules.conjunction_table(model, focal, other_focal)
        focal, masses = table.focal, rules.conjunctive(table, table.embed(masses), other)[0]
    reduced, moved = decisions.project(shafer_model(names), focal, masses)
    free, shafer = evidencelib.Frame.dsmt(names), evidencelib.Frame.dst(names)
    theirs = [free.mass(dict(zip(names, row[0].tolist(), strict=True))) for _, row in sources]
    expected = theirs[0].dsmh(*theirs[1:], model=shafer)
    for mask, mass in zip(reduced, moved[0], strict=True):
        name = element_name(names, mask, shafer_model(names))
        assert mass == pytest.approx(expected.mass(name), abs=1e-9)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(1, 4))
def test_pignistic_probabilities_agree_with_dictionaries(seed, size):
    names, (focal, masses) = NAMES[:size], random_masses(size, seed)
    for model, alive in (
        (free_model(names), frozenset(all_parts(names))),
        (shafer_model(names), shafer_parts(names)),
    ):
        found = decisions.generalised_pignistic(model, focal, masses)
        parts = decisions.part_probability(model, focal, masses)
        np.testing.assert_allclose(parts.sum(axis=1), 1.0, atol=1e-12)
        for row in range(len(masses)):
            body = project(names, from_row(names, focal, masses[row]), alive)
            expected = [pignistic(body, alive, atom(names, name)) for name in names]
            np.testing.assert_allclose(found[row], expected, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 3))
def test_pignistic_probabilities_agree_with_evidencelib(seed, size):
    names, (focal, masses) = NAMES[:size], random_masses(size, seed, rows=1)
    model, frame = free_model(names), evidencelib.Frame.dsmt(names)
    theirs = frame.mass(
        {element_name(names, mask): m for mask, m in zip(focal, masses[0], strict=True)}
    )
    found = decisions.generalised_pignistic(model, focal, masses)[0]
    for name, probability in theirs.pignistic().items():
        assert found[names.index(name)] == pytest.approx(probability, abs=1e-9)
    regions = [p for p in theirs.pignistic_regions().values() if p > 0]
    ours = decisions.part_probability(model, focal, masses)[0]
    np.testing.assert_allclose(sorted(ours[ours > 0]), sorted(regions), atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(1, 4))
def test_probabilities_of_disjoint_parts_sum_to_one_on_any_model(seed, size):
    model = random_model(size, np.random.default_rng(seed))
    focal, masses = random_masses(size, seed)
    parts = decisions.part_probability(model, focal, masses)
    assert parts.shape == (len(masses), model.alive.bit_count())
    np.testing.assert_allclose(parts.sum(axis=1), 1.0, atol=1e-12)


def test_belief_and_plausibility_by_hand():
    names = ("A", "B", "C")
    focal = columns(names, ["A", "B|C", "A|B|C", "A&B"])
    masses = np.array([[0.4, 0.2, 0.3, 0.1]])
    asked = columns(names, ["A", "A|B", "C", "A&C"])
    # On the free model C is met by all, A & C too; on Shafer's model A & B is A | B.
    free, shafer = free_model(names), shafer_model(names)
    np.testing.assert_allclose(decisions.belief(free, focal, masses, asked), [[0.5, 0.5, 0, 0]])
    np.testing.assert_allclose(decisions.plausibility(free, focal, masses, asked), [[1, 1, 1, 1]])
    np.testing.assert_allclose(decisions.belief(shafer, focal, masses, asked), [[0.4, 0.5, 0, 0]])
    np.testing.assert_allclose(
        decisions.plausibility(shafer, focal, masses, asked), [[0.8, 1.0, 0.5, 0.0]]
    )


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 4))
def test_belief_and_plausibility_agree_with_evidencelib(seed, size):
    names, (focal, masses) = NAMES[:size], random_masses(size, seed, rows=1)
    model, frame = free_model(names), evidencelib.Frame.dsmt(names)
    theirs = frame.mass(
        {element_name(names, mask): m for mask, m in zip(focal, masses[0], strict=True)}
    )
    asked = np.random.default_rng(seed).choice(hyper_power_set(size), 4)
    texts = [element_name(names, mask) for mask in asked]
    bel = decisions.belief(model, focal, masses, asked)[0]
    pl = decisions.plausibility(model, focal, masses, asked)[0]
    np.testing.assert_allclose(bel, [theirs.belief(text) for text in texts], atol=1e-9)
    np.testing.assert_allclose(pl, [theirs.plausibility(text) for text in texts], atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(1, 4))
def test_probability_lies_between_belief_and_plausibility(seed, size):
    names, (focal, masses) = NAMES[:size], random_masses(size, seed)
    for model in (free_model(names), shafer_model(names)):
        asked = np.array(singletons(size), dtype=np.uint32)
        probability = decisions.generalised_pignistic(model, focal, masses)
        assert (decisions.belief(model, focal, masses, asked) <= probability + 1e-12).all()
        assert (probability <= decisions.plausibility(model, focal, masses, asked) + 1e-12).all()


def test_on_shafers_model_it_is_betp():
    names = ("A", "B", "C")
    focal = columns(names, ["A", "B|C", "A|B|C"])
    found = decisions.generalised_pignistic(shafer_model(names), focal, np.array([[0.5, 0.2, 0.3]]))
    np.testing.assert_allclose(found, [[0.6, 0.2, 0.2]])


def test_on_the_free_model_elements_overlap():
    names = ("A", "B")
    found = decisions.generalised_pignistic(
        free_model(names), columns(names, ["A|B", "A&B"]), np.array([[0.6, 0.4]])
    )
    # A has two of the three parts of A|B, and all of A&B.
    np.testing.assert_allclose(found, [[0.8, 0.8]])


def test_entropy_of_known_beliefs():
    names = ("VS", "S", "B")
    focal = columns(names, ["VS&S&B", "S", "VS|S|B"])
    masses = np.eye(3)
    free = decisions.pignistic_entropy(free_model(names), focal, masses)
    np.testing.assert_allclose(free, [0.0, 2.0, np.log2(7)], atol=1e-12)
    shafer = decisions.pignistic_entropy(shafer_model(names), focal, masses)
    np.testing.assert_allclose(shafer, [np.log2(3), 0.0, np.log2(3)], atol=1e-12)
    in_nats = decisions.pignistic_entropy(free_model(names), focal, masses, base=np.e)
    np.testing.assert_allclose(in_nats, [0.0, np.log(4), np.log(7)], atol=1e-12)


def test_entropy_falls_in_the_first_frame_and_rises_in_the_second():
    """Figure 14.8: histories drift into intersections, which the second frame does not know."""
    names = ("VS", "S", "B")
    focal = columns(names, ["VS", "S", "B"])
    measurement = np.array([[0.2, 0.5, 0.3]])
    history_focal, history = focal, measurement
    entropies = []
    for _ in range(12):
        table = rules.conjunction_table(free_model(names), history_focal, focal)
        history_focal = table.focal
        history, _ = rules.conjunctive(table, table.embed(history), measurement)
        entropies.append(
            [
                decisions.pignistic_entropy(model, history_focal, history)[0]
                for model in (free_model(names), shafer_model(names))
            ]
        )
    change = np.diff(entropies, axis=0)
    assert (change[:, 0] < 0).all()
    assert (change[:, 1] > 0).all()
    assert entropies[-1][0] < 0.3
    assert entropies[-1][1] == pytest.approx(np.log2(3), abs=0.05)
