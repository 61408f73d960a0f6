import numpy as np
import pytest
from dictionary_rules import assert_same, from_row
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.evidence.combination import combine
from gda_tracker.evidence.decisions import generalised_pignistic
from gda_tracker.evidence.frames import (
    element_name,
    free_model,
    hyper_power_set,
    parse_element,
    shafer_model,
    total_ignorance,
)
from gda_tracker.evidence.refinement import Refinement

SIZES, TYPES = ("VS", "S", "B"), ("FA", "F", "C")
CHAPTER = Refinement(SIZES, TYPES, {"VS": "FA", "S": "F", "B": "C"})
NAMES, ONTO = ("a", "b", "c"), ("p", "q", "r", "s")
seeds = st.integers(0, 2**32 - 1)


def random_refinement(random):
    """Three elements onto any elements of four, together all of them."""
    elements = hyper_power_set(4)
    while True:
        images = random.choice(elements, 3).tolist()
        if images[0] | images[1] | images[2] == total_ignorance(4):
            texts = [element_name(ONTO, mask) for mask in images]
            return Refinement(NAMES, ONTO, dict(zip(NAMES, texts, strict=True)))


def random_masses(random, rows):
    focal = random.permutation(hyper_power_set(3))[: random.integers(1, 6)]
    return focal, random.dirichlet(np.ones(len(focal)), rows)


def test_the_chapters_hyper_power_set_goes_name_by_name():
    rename = dict(zip(SIZES, TYPES, strict=True))
    for mask in hyper_power_set(3).tolist():
        text = element_name(SIZES, mask)
        expected = "|".join("&".join(rename[x] for x in t.split("&")) for t in text.split("|"))
        assert CHAPTER.element_name(text) == expected
        assert CHAPTER.element(mask) == mask


def test_order_of_the_frames_is_of_no_account():
    other = Refinement(SIZES, ("C", "FA", "F"), {"B": "C", "VS": "FA", "S": "F"})
    assert other.element_name("VS|S&B") == "FA|C&F"


def test_a_history_seen_in_both_frames_of_the_chapter():
    focal = np.array([parse_element(SIZES, t) for t in ("VS", "S&B", "VS|S|B")], dtype=np.uint32)
    onto, masses = CHAPTER.carry(focal, np.array([[0.5, 0.3, 0.2]]))
    probability = generalised_pignistic(shafer_model(TYPES), onto, masses)
    # F & C is impossible: its 0.3 is F or C.
    np.testing.assert_allclose(probability, [[0.5 + 0.2 / 3, 0.15 + 0.2 / 3, 0.15 + 0.2 / 3]])


def test_masses_that_meet_are_added():
    coarse = Refinement(
        ("tiny", "small", "big"), ("F", "C"), {"tiny": "F", "small": "F", "big": "C"}
    )
    onto, masses = coarse.carry(
        np.array([0b1010101, 0b1100110, 0b1111000]), np.array([0.2, 0.3, 0.5])
    )
    assert [element_name(("F", "C"), mask) for mask in onto] == ["F", "C"]
    np.testing.assert_allclose(masses, [0.5, 0.5])
    assert coarse.carry_source({0b1010101: 0.2, 0b1100110: 0.8}) == {0b101: 1.0}


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_unions_and_intersections_go_along_and_mass_is_kept(seed):
    random = np.random.default_rng(seed)
    refinement = random_refinement(random)
    x, y = random.choice(hyper_power_set(3), 2).tolist()
    assert refinement.element(x & y) == refinement.element(x) & refinement.element(y)
    assert refinement.element(x | y) == refinement.element(x) | refinement.element(y)
    assert refinement.element(total_ignorance(3)) == total_ignorance(4)
    focal, masses = random_masses(random, 4)
    _, carried = refinement.carry(focal, masses)
    np.testing.assert_allclose(carried.sum(axis=1), 1.0, atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_the_classic_rule_before_or_after(seed):
    random = np.random.default_rng(seed)
    refinement = random_refinement(random)
    sources = []
    for _ in range(2):
        focal, masses = random_masses(random, 1)
        sources.append(dict(zip(focal.tolist(), masses[0].tolist(), strict=True)))
    before = refinement.carry_source(combine("dsmc", free_model(NAMES), sources).masses)
    carried = [refinement.carry_source(source) for source in sources]
    after = combine("dsmc", free_model(ONTO), carried).masses
    assert_same(
        from_row(ONTO, list(before), list(before.values())),
        from_row(ONTO, list(after), list(after.values())),
    )


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"VS": "FA", "S": "F"}, "refinement of VS, S: allowed is each of VS, S, B once"),
        ({"VS": "FA", "S": "F", "B": "C", "X": "C"}, "refinement of VS, S, B, X: allowed"),
        ({}, "refinement of nothing: allowed"),
        ({"VS": "FA", "S": "F", "B": "X"}, "element 'X': unknown; allowed are FA, F, C"),
        (
            {"VS": "FA", "S": "FA", "B": "C"},
            "nothing maps onto F; allowed is a mapping that covers",
        ),
    ],
)
def test_faulty_mappings_are_named(mapping, message):
    with pytest.raises(ValueError, match=message):
        Refinement(SIZES, TYPES, mapping)
    with pytest.raises(ValueError, match="mask 0x1: allowed are elements"):
        CHAPTER.element(1)
