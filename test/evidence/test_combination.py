import numpy as np
import pytest
from dictionary_rules import NoAnswer, assert_same, from_mask
from dictionary_rules import combine as combine_sets
from hypothesis import given, settings
from hypothesis import strategies as st
from random_evidence import NAMES, masks, problem, random_source, survivors

from gda_tracker.evidence.combination import (
    RULES,
    NothingAliveError,
    TotalConflictError,
    combine,
    discount,
    reduce_source,
)
from gda_tracker.evidence.frames import (
    Model,
    constrained_model,
    element_name,
    free_model,
    hyper_power_set,
    shafer_model,
    total_ignorance,
)

CONSERVING = ("dsmc", "dsmh", "dempster", "yager", "pcr5", "pcr6")
seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


def fuse(rule, model, *sources):
    """Fuse sources given as {element: mass}; the outcome by canonical names, and the conflict."""
    fused = combine(rule, model, [masks(model.names, source) for source in sources])
    reading = None if rule == "dsmc" else model
    named = {element_name(model.names, m, reading): mass for m, mass in fused.masses.items()}
    return named, fused.conflict


def by_sets(names, fused):
    return {from_mask(names, mask): mass for mask, mass in fused.items()}


def test_zadehs_example():
    # Meningitis, contusion, tumour: two doctors who agree only that a tumour is unlikely.
    model = shafer_model(("M", "C", "T"))
    first, second = {"M": 0.99, "T": 0.01}, {"C": 0.99, "T": 0.01}
    conflict = 0.9801 + 2 * 0.0099
    expected = {
        "dsmc": {"M&C": 0.9801, "M&T": 0.0099, "C&T": 0.0099, "T": 0.0001},
        "dempster": {"T": 1.0},
        "yager": {"T": 0.0001, "M|C|T": conflict},
        "dubois_prade": {"M|C": 0.9801, "M|T": 0.0099, "C|T": 0.0099, "T": 0.0001},
        "dsmh": {"M|C": 0.9801, "M|T": 0.0099, "C|T": 0.0099, "T": 0.0001},
        "disjunctive": {"M|C": 0.9801, "M|T": 0.0099, "C|T": 0.0099, "T": 0.0001},
        "pcr5": {"M": 0.499851, "C": 0.499851, "T": 0.000298},
        "pcr6": {"M": 0.499851, "C": 0.499851, "T": 0.000298},
    }
    for rule in RULES:
        found, k = fuse(rule, model, first, second)
        assert found == pytest.approx(expected[rule], abs=1e-12), rule
        assert k == pytest.approx(conflict, abs=1e-15)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        # Smarandache and Dezert, volume 2, chapter 1: K = 0.18 to A and B as 2 to 1.
        ({"A": 0.6, "A|B": 0.4}, {"B": 0.3, "A|B": 0.7}, {"A": 0.54, "B": 0.18, "A|B": 0.28}),
        (
            {"A": 0.6, "A|B": 0.4},
            {"A": 0.2, "B": 0.3, "A|B": 0.5},
            {"A": 0.62, "B": 0.18, "A|B": 0.2},
        ),
        (
            # 0.24 is lost in all: 0.18 to A and B as 2 to 1, 0.06 as 2 to 3.
            {"A": 0.6, "B": 0.3, "A|B": 0.1},
            {"A": 0.2, "B": 0.3, "A|B": 0.5},
            {"A": 0.44 + 0.12 + 0.024, "B": 0.27 + 0.06 + 0.036, "A|B": 0.05},
        ),
    ],
)
def test_book_examples_of_pcr5(first, second, expected):
    for rule in ("pcr5", "pcr6"):
        found, _ = fuse(rule, shafer_model(("A", "B")), first, second)
        assert found == pytest.approx(expected, abs=1e-12)


def test_pcr5_and_pcr6_differ_from_three_sources_on():
    model = shafer_model(("A", "B"))
    sources = {"A": 0.6, "B": 0.4}, {"A": 0.3, "B": 0.7}, {"A": 0.2, "B": 0.8}
    dead = [
        ((0.6, 0.3), (0.8,)),
        ((0.6, 0.2), (0.7,)),
        ((0.3, 0.2), (0.4,)),
        ((0.6,), (0.7, 0.8)),
        ((0.3,), (0.4, 0.8)),
        ((0.2,), (0.4, 0.7)),
    ]
    for rule, weigh in (("pcr5", np.prod), ("pcr6", np.sum)):
        expected = 0.6 * 0.3 * 0.2
        for on_a, on_b in dead:
            share = weigh(on_a) / (weigh(on_a) + weigh(on_b))
            expected += np.prod(on_a) * np.prod(on_b) * share
        found, k = fuse(rule, model, *sources)
        assert found == pytest.approx({"A": expected, "B": 1 - expected}, abs=1e-12)
        assert k == pytest.approx(1 - 0.036 - 0.224, abs=1e-12)


def test_hybrid_rule_jointly_and_by_projection_are_two_rules():
    model = shafer_model(("A", "B", "C"))
    a, ignorance, b = {"A": 1.0}, {"A|B|C": 1.0}, {"B": 1.0}
    assert fuse("dsmh", model, a, ignorance, b) == ({"A|B|C": 1.0}, 1.0)
    classic, _ = fuse("dsmc", model, a, ignorance, b)
    assert classic == {"A&B": 1.0}
    assert fuse("dsmh", model, classic) == ({"A|B": 1.0}, 1.0)


def test_terms_of_the_hybrid_rule():
    names = ("A", "B", "C")
    model = constrained_model(names, ["A&B", "C"])
    cases = [
        ({"A|C": 1.0}, {"A": 1.0}, {"A": 1.0}),  # S1: alive
        ({"A&B": 1.0}, {"C": 1.0}, {"A|B": 1.0}),  # S2: u(A & B) = A | B, u(C) is dead
        ({"C": 1.0}, {"C": 1.0}, {"A|B": 1.0}),  # S2: to total ignorance
        ({"A": 1.0}, {"B": 1.0}, {"A|B": 1.0}),  # S3
        ({"A": 1.0}, {"C": 1.0}, {"A": 1.0}),  # S3: C adds nothing
        ({"A&B&C": 1.0}, {"B": 1.0}, {"B": 1.0}),  # S3, not u(A & B & C)
    ]
    for first, second, expected in cases:
        assert fuse("dsmh", model, first, second)[0] == expected


def test_hybrid_example_with_an_element_found_empty():
    # Smarandache and Dezert, volume 1, chapter 4: the third suspect has an alibi (C is empty).
    model = constrained_model(("A", "B", "C"), ["C", "A&B"])
    first, second = (
        {"A": 0.1, "B": 0.4, "C": 0.2, "A|B": 0.3},
        {"A": 0.5, "B": 0.1, "C": 0.3, "A|B": 0.1},
    )
    found, k = fuse("dsmh", model, first, second)
    # A: .1*.5 + .1*.1 + .3*.5, with C to A: .1*.3 + .2*.5; B: .4*.1 + .4*.1 + .3*.1, .4*.3 + .2*.1
    # A|B: .3*.1, with C .3*.3 + .2*.1, conflict .1*.1 + .4*.5, C with C .2*.3
    assert found == pytest.approx({"A": 0.34, "B": 0.25, "A|B": 0.41}, abs=1e-12)
    assert k == pytest.approx(0.13 + 0.14 + 0.11 + 0.21 + 0.06, abs=1e-12)


def test_dead_elements_have_no_voice_in_pcr():
    model = constrained_model(("A", "B", "C"), ["A&B", "A&C", "B&C", "C"])
    found, k = fuse("pcr5", model, {"A": 0.5, "C": 0.5}, {"B": 0.4, "C": 0.6})
    # A with B .2 as 5 to 4, A with C .3 to A, C with B .2 to B, C with C .3 to ignorance.
    expected = {"A": 0.2 * 5 / 9 + 0.3, "B": 0.2 * 4 / 9 + 0.2, "A|B": 0.3}
    assert found == pytest.approx(expected, abs=1e-12)
    assert k == pytest.approx(1.0)


def test_pcr_takes_elements_that_a_model_merges_as_one():
    model = shafer_model(("A", "B", "C"))
    split, _ = fuse("pcr5", model, {"A": 0.3, "A|B&C": 0.3, "B": 0.4}, {"A": 0.2, "B": 0.8})
    whole, _ = fuse("pcr5", model, {"A": 0.6, "B": 0.4}, {"A": 0.2, "B": 0.8})
    assert split == pytest.approx(whole, abs=1e-15)


def test_the_chapters_update_of_a_history():
    # 14.3.2.1: history over the hyper-power set, measurement over the elements of Theta1.
    names = ("VS", "S", "B")
    history = {"VS": 0.5, "VS&S": 0.2, "(VS|B)&S": 0.1, "VS|S|B": 0.2}
    found, _ = fuse("dsmc", free_model(names), history, {"VS": 0.2, "S": 0.7, "B": 0.1})
    expected = {
        "VS": 0.5 * 0.2 + 0.2 * 0.2,
        "S": 0.2 * 0.7,
        "B": 0.2 * 0.1,
        "VS&S": 0.5 * 0.7 + 0.2 * 0.9 + 0.1 * 0.2,
        "VS&B": 0.5 * 0.1,
        "VS&S|S&B": 0.1 * 0.7,
        "S&B": 0.1 * 0.1,
        "VS&S&B": 0.2 * 0.1,
    }
    assert found == pytest.approx(expected, abs=1e-12)


def test_total_conflict_has_no_answer_under_dempster():
    model = shafer_model(("A", "B"))
    with pytest.raises(TotalConflictError, match="all products of the sources. masses contradict"):
        fuse("dempster", model, {"A": 1.0}, {"B": 1.0})


def test_dempster_works_with_products_that_underflow():
    model = shafer_model(("A", "B"))
    first, second = {"A": 1.0, "B": 1e-200}, {"B": 1e-200, "A|B": 3e-200, "A": 0.0}
    with pytest.raises(ValueError, match="source 1: masses sum to 4e-200"):
        fuse("dempster", model, first, second)
    sources = {"A": 1.0, "B": 1e-200}, {"B": 1.0, "A": 1e-200}, {"A|B": 1.0}
    assert fuse("dempster", model, *sources)[0] == pytest.approx({"A": 0.5, "B": 0.5})
    rare = {"A": 1.0, "B": 1e-200}, {"C": 1.0, "B": 3e-200}, {"C": 1.0, "B": 1e-200}
    assert fuse("dempster", shafer_model(("A", "B", "C")), *rare)[0] == {"B": 1.0}


@pytest.mark.parametrize("rule", ["dubois_prade", "disjunctive"])
def test_rules_without_a_place_for_dead_elements_say_so(rule):
    model = shafer_model(("A", "B"))
    with pytest.raises(
        NothingAliveError, match=f"A&B, A&B: all dead on the model, and rule '{rule}'"
    ):
        fuse(rule, model, {"A&B": 0.5, "A": 0.5}, {"A&B": 1.0})
    assert fuse(rule, model, {"A&B": 1.0}, {"B": 1.0})[0] == {"B": 1.0}


@pytest.mark.parametrize("rule", RULES)
def test_a_model_without_parts_is_refused(rule):
    with pytest.raises(NothingAliveError, match="model without any Venn part"):
        combine(rule, Model(("A",), 0), [{1: 1.0}])


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({0b101: 0.5, 0b110: -0.1, 0b111: 0.6}, r"source 0, mass -0.1 of mask 0x6: allowed is 0"),
        ({0b101: float("nan")}, "mass nan of mask 0x5"),
        ({0b101: 0.9}, "source 0: masses sum to 0.9, allowed is 1"),
        ({0b001: 1.0}, "mask 0x1: allowed are elements of the hyper-power set"),
        ({0b1101: 1.0}, "mask 0xd: allowed are elements"),
        ({0: 1.0}, "mask 0x0: allowed are elements"),
        ({}, "source 0: masses sum to 0, allowed is 1"),
    ],
)
def test_faulty_sources_are_named(source, message):
    with pytest.raises(ValueError, match=message):
        combine("dsmc", free_model(("A", "B")), [source])


def test_unknown_rule_and_no_source():
    model = free_model(("A", "B"))
    with pytest.raises(ValueError, match="rule = 'bayes': allowed is one of dsmc, dsmh"):
        combine("bayes", model, [{0b101: 1.0}])
    with pytest.raises(ValueError, match="no sources: allowed is one or more"):
        combine("dsmc", model, [])


def test_an_outcome_can_be_a_source():
    model = shafer_model(("A", "B"))
    first = combine("yager", model, [masks(model.names, {"A": 0.6, "B": 0.4})] * 2)
    assert list(first.masses) == [0b01, 0b10, 0b11]
    again = combine("yager", model, [first.masses, {0b111: 1.0}])
    assert again.masses == first.masses
    assert combine("dsmc", model, [first.masses]).masses.keys() == {0b101, 0b110, 0b111}


def test_discounting():
    model = shafer_model(("A", "B"))
    source = masks(model.names, {"A": 0.4, "A&B": 0.1, "A|B": 0.5})
    discounted = discount(source, 0.8, model)
    assert discounted == pytest.approx({0b101: 0.32, 0b100: 0.08, 0b111: 0.6})
    assert reduce_source(model, discounted) == pytest.approx({0b001: 0.32, 0b100: 0.08, 0b011: 0.6})
    assert discount(source, 1.0, model) == source
    assert discount(source, 0.0, model) == {0b111: 1.0}
    for reliability in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="reliability = .*: allowed is 0 to 1"):
            discount(source, reliability, model)


@settings(deadline=None, max_examples=60)
@given(seeds, sizes, st.sampled_from(RULES))
def test_agrees_with_sets(seed, size, rule):
    model, sources = problem(seed, size)
    names, alive = model.names, from_mask(model.names, model.alive)
    try:
        expected, k = combine_sets(rule, names, alive, [by_sets(names, s) for s in sources])
    except NoAnswer:
        with pytest.raises((TotalConflictError, NothingAliveError)):
            combine(rule, model, sources)
        return
    found = combine(rule, model, sources)
    assert_same(by_sets(names, found.masses), expected)
    assert found.conflict == pytest.approx(k, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(seeds, sizes, st.sampled_from(RULES))
def test_mass_is_conserved_and_the_order_of_sources_is_of_no_account(seed, size, rule):
    model, sources = problem(seed, size, alive=rule not in CONSERVING)
    try:
        fused = combine(rule, model, sources)
    except TotalConflictError:
        return
    assert sum(fused.masses.values()) == pytest.approx(1.0, abs=1e-12)
    assert min(fused.masses.values()) > 0.0
    again = combine(rule, model, sources[::-1])
    assert again.masses == pytest.approx(fused.masses, abs=1e-14)
    assert again.conflict == pytest.approx(fused.conflict, abs=1e-14)


@settings(deadline=None, max_examples=40)
@given(seeds, sizes)
def test_classic_rule_is_associative(seed, size):
    model, sources = problem(seed, size, sources=3)
    left = combine("dsmc", model, [combine("dsmc", model, sources[:2]).masses, sources[2]])
    assert left.masses == pytest.approx(combine("dsmc", model, sources).masses, abs=1e-14)


@settings(deadline=None, max_examples=40)
@given(seeds, sizes, st.integers(1, 3))
def test_hybrid_rule_is_dubois_prade_where_no_focal_element_is_dead(seed, size, count):
    random, model = np.random.default_rng(seed), shafer_model(NAMES[:size])
    sources = [random_source(size, random, survivors(model)) for _ in range(count)]
    assert combine("dsmh", model, sources) == combine("dubois_prade", model, sources)


@settings(deadline=None, max_examples=40)
@given(seeds, sizes, st.sampled_from(["pcr5", "pcr6", "dsmh", "yager", "dempster"]))
def test_of_sources_that_agree_all_rules_are_the_conjunctive_one(seed, size, rule):
    model, _ = problem(seed, size)
    random = np.random.default_rng(seed)
    # All focal elements have one Venn part that exists: no tuple is dead.
    part = np.uint32(model.alive & -model.alive)
    common = hyper_power_set(size)[(hyper_power_set(size) & part) != 0]
    sources = [random_source(size, random, common) for _ in range(2)]
    fused, free = combine(rule, model, sources), combine("dsmc", model, sources)
    assert fused.conflict == 0.0
    assert fused.masses == pytest.approx(reduce_source(model, free.masses), abs=1e-14)


@settings(deadline=None, max_examples=40)
@given(seeds, sizes, st.sampled_from(["dsmc", "dempster", "pcr5", "pcr6"]))
def test_a_vacuous_source_is_neutral(seed, size, rule):
    model, sources = problem(seed, size, sources=1, alive=True)
    vacuous = {total_ignorance(size): 1.0}
    fused = combine(rule, model, [*sources, vacuous])
    alone = sources[0] if rule == "dsmc" else reduce_source(model, sources[0])
    assert fused.masses == pytest.approx(alone, abs=1e-14)
    assert fused.conflict == 0.0
