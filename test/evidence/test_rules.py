import evidencelib
import numpy as np
import pytest
from dictionary_rules import assert_same, conjunctive, dempster, from_row
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.evidence import rules
from gda_tracker.evidence.frames import (
    element_name,
    free_model,
    hyper_power_set,
    parse_element,
    shafer_model,
    singletons,
    total_ignorance,
)

NAMES = ("a", "b", "c", "d")


def columns(names, texts):
    return np.array([parse_element(names, text) for text in texts], dtype=np.uint32)


def fuse(names, first, second, rule=rules.conjunctive, model=free_model):
    """Fuse two bodies of evidence given as {element: mass}; the result by canonical names."""
    table = rules.conjunction_table(model(names), columns(names, first), columns(names, second))
    history = table.embed(np.array([list(first.values())]))
    masses, conflict = rule(table, history, np.array([list(second.values())]))
    fused = {
        element_name(names, mask): mass
        for mask, mass in zip(table.focal, masses[0], strict=True)
        if mass
    }
    return fused, conflict[0]


def random_masses(size, seed, focal=None, rows=5):
    """Rows of masses over a random choice of elements of the free model."""
    random = np.random.default_rng(seed)
    elements = hyper_power_set(size)
    if focal is None:
        focal = random.permutation(elements)[: random.integers(1, 7)]
    masses = random.dirichlet(np.ones(len(focal)), rows) * (random.random((rows, len(focal))) < 0.7)
    masses[:, 0] += 1.0 - masses.sum(axis=1)
    return np.array(focal, dtype=np.uint32), masses


def combine(model, first, second, rule=rules.conjunctive):
    table = rules.conjunction_table(model, first[0], second[0])
    return table.focal, rule(table, table.embed(first[1]), second[1])[0]


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


def test_classic_rule_on_two_elements():
    fused, conflict = fuse(("A", "B"), {"A": 0.6, "B": 0.3, "A|B": 0.1}, {"A": 0.5, "A|B": 0.5})
    # A: .6*.5 + .6*.5 + .1*.5, B: .3*.5, A&B: .3*.5, A|B: .1*.5
    assert fused == pytest.approx({"A": 0.65, "B": 0.15, "A&B": 0.15, "A|B": 0.05})
    assert conflict == pytest.approx(0.15)


def test_classic_rule_on_zadehs_example():
    # Dezert and Smarandache: meningitis, contusion, tumour; two doctors nearly exclude a tumour.
    names, e1, e2 = ("M", "C", "T"), 0.1, 0.2
    first, second = {"M": 1 - e1, "T": e1}, {"C": 1 - e2, "T": e2}
    fused, conflict = fuse(names, first, second)
    assert fused == pytest.approx(
        {"M&C": 0.9 * 0.8, "M&T": 0.9 * 0.2, "C&T": 0.1 * 0.8, "T": 0.1 * 0.2}
    )
    assert conflict == pytest.approx(1 - e1 * e2)
    fused, conflict = fuse(names, first, second, rules.dempster, shafer_model)
    assert fused == pytest.approx({"T": 1.0})
    assert conflict == pytest.approx(1 - e1 * e2)


def test_classic_rule_on_intersections_and_unions():
    names = ("VS", "S", "B")
    fused, conflict = fuse(names, {"VS&S": 0.4, "S|B": 0.6}, {"B": 0.3, "VS|S": 0.7})
    assert fused == pytest.approx({"VS&S&B": 0.12, "VS&S": 0.28, "B": 0.18, "S|VS&B": 0.42})
    # VS & S is empty on Shafer's model, whatever meets it; S is left of (S|B) & (VS|S).
    assert conflict == pytest.approx(0.4)


def test_dempster_on_two_elements():
    first, second = {"A": 0.6, "A|B": 0.4}, {"B": 0.5, "A|B": 0.5}
    fused, conflict = fuse(("A", "B"), first, second, rules.dempster, shafer_model)
    assert conflict == pytest.approx(0.3)
    assert fused == pytest.approx({"A": 0.3 / 0.7, "B": 0.2 / 0.7, "A|B": 0.2 / 0.7})


def test_dempster_in_total_conflict_keeps_the_history_only_if_told_so():
    model = shafer_model(("A", "B"))
    focal = columns(model.names, ["A", "B", "A|B"])
    table = rules.conjunction_table(model, focal, focal)
    history = np.array([[1.0, 0.0, 0.0], [0.5, 0.0, 0.5], [0.0, 1.0, 0.0]])
    measurement = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    with pytest.raises(rules.TotalConflictError, match=r"pairs \[0, 2\]"):
        rules.dempster(table, history, measurement)
    masses, conflict = rules.dempster(table, history, measurement, keep_history=True)
    np.testing.assert_array_equal(masses, [[1, 0, 0], [0, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(conflict, [1.0, 0.5, 1.0])


def test_dempster_works_with_a_tiny_rest():
    # 1 - K would be zero here; the rest itself is not.
    first, second = {"A": 1 - 1e-200, "B": 1e-200}, {"B": 1.0}
    fused, conflict = fuse(("A", "B"), first, second, rules.dempster, shafer_model)
    assert fused == {"B": 1.0}
    assert conflict == 1.0


@settings(deadline=None, max_examples=30)
@given(seeds, sizes)
def test_classic_rule_agrees_with_dictionaries(seed, size):
    names = NAMES[:size]
    first, second = random_masses(size, seed), random_masses(size, seed + 1)
    model = free_model(names)
    table = rules.conjunction_table(model, first[0], second[0])
    masses, conflict = rules.conjunctive(table, table.embed(first[1]), second[1])
    for row in range(len(masses)):
        a = from_row(names, first[0], first[1][row])
        b = from_row(names, second[0], second[1][row])
        fused = conjunctive(a, b)
        assert_same(from_row(names, table.focal, masses[row]), fused)
        alive = {frozenset([name]) for name in names}
        assert conflict[row] == pytest.approx(
            sum(m for x, m in fused.items() if not x & alive), abs=1e-12
        )


@settings(deadline=None, max_examples=30)
@given(seeds, sizes)
def test_dempster_agrees_with_dictionaries(seed, size):
    names, model = NAMES[:size], shafer_model(NAMES[:size])
    random = np.random.default_rng(seed)
    # Elements that Shafer's model knows: unions of the frame's elements.
    unions = [
        np.bitwise_or.reduce(
            np.array([m for i, m in enumerate(singletons(size)) if chosen >> i & 1])
        )
        for chosen in range(1, 2**size)
    ]
    first = random_masses(size, seed, random.permutation(unions)[:4])
    second = random_masses(size, seed + 1, random.permutation(unions)[:4])
    table = rules.conjunction_table(model, first[0], second[0])
    history = table.embed(first[1])
    masses, conflict = rules.dempster(table, history, second[1], keep_history=True)
    for row in range(len(masses)):
        expected, k = dempster(
            names,
            from_row(names, first[0], first[1][row]),
            from_row(names, second[0], second[1][row]),
        )
        found = from_row(names, table.focal & np.uint32(model.alive), masses[row])
        if expected is None:
            expected = from_row(names, table.focal & np.uint32(model.alive), history[row])
        assert_same(found, expected)
        assert conflict[row] == pytest.approx(k, abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 4))
def test_rules_agree_with_evidencelib(seed, size):
    names = NAMES[:size]
    for model, frame, rule, theirs in (
        (free_model(names), evidencelib.Frame.dsmt(names), rules.conjunctive, "dsmc"),
        (shafer_model(names), evidencelib.Frame.dst(names), rules.dempster, "dempster"),
    ):
        focal = [*singletons(size), total_ignorance(size)]
        first, second = random_masses(size, seed, focal), random_masses(size, seed + 1, focal)
        first[1][:, -1] += 0.01  # no total conflict
        first[1][:] /= first[1].sum(axis=1, keepdims=True)
        fused_focal, fused = combine(model, first, second, rule)
        for row in range(len(fused)):
            a, b = (
                frame.mass(
                    {
                        element_name(names, mask): mass
                        for mask, mass in zip(source[0], source[1][row], strict=True)
                    }
                )
                for source in (first, second)
            )
            expected = getattr(a, theirs)(b)
            for mask, mass in zip(fused_focal, fused[row], strict=True):
                assert mass == pytest.approx(expected.mass(element_name(names, mask)), abs=1e-9)


@settings(deadline=None, max_examples=30)
@given(seeds, sizes)
def test_masses_sum_to_one_and_the_rule_is_commutative(seed, size):
    first, second = random_masses(size, seed), random_masses(size, seed + 1)
    model = free_model(NAMES[:size])
    focal, masses = combine(model, first, second)
    np.testing.assert_allclose(masses.sum(axis=1), 1.0, atol=1e-12)
    assert (masses >= 0).all()
    again, swapped = combine(model, second, first)
    np.testing.assert_array_equal(again, focal)
    np.testing.assert_allclose(swapped, masses, atol=1e-14)


@settings(deadline=None, max_examples=30)
@given(seeds, sizes)
def test_classic_rule_is_associative(seed, size):
    model = free_model(NAMES[:size])
    a, b, c = (random_masses(size, seed + i) for i in range(3))
    left_focal, left = combine(model, combine(model, a, b), c)
    right_focal, right = combine(model, a, combine(model, b, c))
    for row in range(len(left)):
        assert_same(
            from_row(model.names, left_focal, left[row]),
            from_row(model.names, right_focal, right[row]),
        )


@settings(deadline=None, max_examples=30)
@given(seeds, sizes)
def test_ignorance_changes_nothing(seed, size):
    vacuous = np.array([total_ignorance(size)], dtype=np.uint32), np.ones((5, 1))
    model, first = free_model(NAMES[:size]), random_masses(size, seed)
    table = rules.conjunction_table(model, first[0], vacuous[0])
    history = table.embed(first[1])
    masses, _ = rules.conjunctive(table, history, vacuous[1])
    np.testing.assert_array_equal(masses, history)


def test_dempster_reads_a_history_of_the_free_model_through_the_projection():
    names = ("A", "B")
    fused, conflict = fuse(
        names, {"A&B": 1.0}, {"A": 0.4, "A|B": 0.6}, rules.dempster, shafer_model
    )
    assert fused == pytest.approx({"A": 0.4, "A|B": 0.6})
    assert conflict == 0.0


def test_columns_of_a_table_are_closed_and_known_by_mask():
    names = ("VS", "S", "B")
    focal = columns(names, ["VS", "S", "B", "VS|S|B"])
    table = rules.conjunction_table(free_model(names), focal, focal)
    again = rules.conjunction_table(free_model(names), table.focal, focal)
    np.testing.assert_array_equal(again.focal, table.focal)
    assert again.embedding is None
    assert len(table.focal) == 8
    on_shafer = rules.conjunction_table(shafer_model(names), focal, focal)
    np.testing.assert_array_equal(on_shafer.focal, focal)


@settings(deadline=None, max_examples=30)
@given(seeds, st.floats(0, 1))
def test_discounting_moves_mass_to_ignorance(seed, factor):
    model, (focal, masses) = free_model(NAMES[:3]), random_masses(3, seed)
    table = rules.conjunction_table(model, focal, focal)
    history = table.embed(masses)
    discounted = rules.discount(table, history, factor)
    np.testing.assert_allclose(discounted.sum(axis=1), 1.0, atol=1e-12)
    others = np.arange(len(table.focal)) != table.ignorance
    np.testing.assert_allclose(discounted[:, others], factor * history[:, others])


def test_a_mask_outside_the_hyper_power_set_is_named():
    focal = columns(("A", "B"), ["A"])
    with pytest.raises(ValueError, match="mask 0x1: allowed are elements"):
        rules.conjunction_table(free_model(("A", "B")), np.array([1], dtype=np.uint32), focal)


def test_no_pairs():
    model = free_model(("A", "B"))
    table = rules.conjunction_table(model, columns(model.names, ["A"]), columns(model.names, ["B"]))
    masses, conflict = rules.conjunctive(table, table.embed(np.zeros((0, 1))), np.zeros((0, 1)))
    assert masses.shape == (0, 4)
    assert conflict.shape == (0,)
