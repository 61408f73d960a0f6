import itertools

import numpy as np
import pytest
from dictionary_rules import atom, from_mask

from gda_tracker.evidence.frames import (
    check_element,
    check_frame,
    constrained_model,
    element_name,
    free_element,
    free_model,
    hyper_power_set,
    intersection_closure,
    parse_element,
    shafer_model,
    singletons,
    total_ignorance,
    union_of_atoms,
    upward_closure,
)

RCS = ("VS", "S", "B")
# The 18 non-empty elements as the chapter lists them (14.3.2.1).
CHAPTER = """VS; S; B; VS&S&B; VS&S; VS&B; S&B; (VS|S)&B; (VS|B)&S; (S|B)&VS;
    (VS&S)|(VS&B)|(S&B); (VS&S)|B; (VS&B)|S; (S&B)|VS; VS|S; VS|B; S|B; VS|S|B""".split(";")


def closure_of_singletons(size):
    """All unions and intersections of the elements, by trying until nothing new comes."""
    found = set(singletons(size))
    while True:
        new = {a & b for a in found for b in found} | {a | b for a in found for b in found}
        if new <= found:
            return found
        found |= new


@pytest.mark.parametrize(("size", "count"), [(1, 1), (2, 4), (3, 18), (4, 166), (5, 7579)])
def test_size_of_the_hyper_power_set(size, count):
    elements = hyper_power_set(size)
    assert len(elements) == len(np.unique(elements)) == count
    assert elements.dtype == np.uint32


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_hyper_power_set_is_the_closure_of_the_elements(size):
    assert set(hyper_power_set(size).tolist()) == closure_of_singletons(size)


@pytest.mark.parametrize("size", [0, 6])
def test_frames_too_small_or_large(size):
    with pytest.raises(ValueError, match="1 to 5 elements; six have 7828352 unions"):
        hyper_power_set(size)
    with pytest.raises(ValueError, match="allowed are 1 to 5 elements"):
        check_frame([f"E{i}" for i in range(size)])


def test_the_chapter_lists_the_hyper_power_set():
    masks = [parse_element(RCS, text.strip()) for text in CHAPTER]
    assert sorted(masks) == hyper_power_set(3).tolist()


def test_masks_are_sets_of_venn_parts():
    names = ("a", "b", "c", "d")
    for name, mask in zip(names, singletons(4), strict=True):
        assert from_mask(names, mask) == atom(names, name)
        assert parse_element(names, name) == mask
    assert from_mask(names, parse_element(names, "a&b|c")) == (
        atom(names, "a") & atom(names, "b") | atom(names, "c")
    )
    assert len(from_mask(names, total_ignorance(4))) == 15


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_names_and_masks_go_both_ways(size):
    names = tuple("wxyz"[:size])
    written = [element_name(names, mask) for mask in hyper_power_set(size)]
    assert len(set(written)) == len(written)
    assert [parse_element(names, text) for text in written] == hyper_power_set(size).tolist()


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("(VS|S)&B", "VS&B|S&B"),
        ("B | S&VS", "B|VS&S"),
        ("VS|VS&S", "VS"),
        (" ( B ) ", "B"),
        ("B&(S|VS&(B|S))", "VS&B|S&B"),
    ],
)
def test_one_element_has_one_name(text, canonical):
    assert element_name(RCS, parse_element(RCS, text)) == canonical


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("XL", "element 'XL': unknown; allowed are VS, S, B"),
        ("VS&", "a name is missing at the end"),
        ("", "a name is missing at the end"),
        ("|VS", "a name is missing before '|'"),
        ("(VS|S", "a closing parenthesis is missing"),
        ("VS S", "'S' is out of place"),
        ("VS)", "'\\)' is out of place"),
    ],
)
def test_text_that_is_no_element(text, message):
    with pytest.raises(ValueError, match=message) as error:
        parse_element(RCS, text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("mask", [0, 1, -1, 1 << 7, 0b0000011])
def test_masks_that_are_no_elements(mask):
    # Parts inside one element alone are no element: the overlaps belong to it.
    with pytest.raises(ValueError, match="allowed are elements of the hyper-power set"):
        element_name(RCS, mask)


@pytest.mark.parametrize("names", [("a", "a"), ("a", ""), ("a b",), ("a&b",), ("a|b",), ("(a",)])
def test_bad_names(names):
    with pytest.raises(ValueError, match="allowed"):
        check_frame(names)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_shafers_model_leaves_the_power_set(size):
    model = shafer_model([f"E{i}" for i in range(size)])
    left = set(model.reduce(hyper_power_set(size)).tolist()) - {0}
    assert len(left) == 2**size - 1


def test_constraints_of_the_chapter():
    names = ("FA", "F", "C")
    model = constrained_model(names, ["FA&F", "FA&C", "F&C", "FA&F&C"])
    assert model == shafer_model(names)
    for text in ("(FA|F)&C", "(FA|C)&F", "(F|C)&FA", "FA&F|FA&C|F&C"):
        assert parse_element(names, text) & model.alive == 0
    for text, equal in (("FA&F|C", "C"), ("FA&C|F", "F"), ("F&C|FA", "FA")):
        assert element_name(names, parse_element(names, text), model) == equal


def test_survivors_of_a_constraint_merge():
    names = ("A", "B", "C")
    model = constrained_model(names, ["A&C"])
    assert element_name(names, parse_element(names, "(A|B)&C"), model) == "B&C"
    # D^Theta of this model: 12 non-empty elements.
    assert len(set(model.reduce(hyper_power_set(3)).tolist()) - {0}) == 12
    with pytest.raises(ValueError, match="hyper-power set"):
        element_name(names, parse_element(names, "A&C"), model)


def test_forcing_an_element_empty_takes_all_its_parts():
    model = constrained_model(("A", "B"), [parse_element(("A", "B"), "A")])
    assert model.alive == 0b010
    with pytest.raises(ValueError, match="leave one"):
        constrained_model(("A", "B"), ["A|B"])


def test_every_reduced_element_comes_from_its_upward_closure():
    for names, empty in ((("A", "B", "C"), ["A&B"]), (("A", "B", "C", "D"), ["A&C", "B&D"])):
        model = constrained_model(names, empty)
        for mask in model.reduce(hyper_power_set(len(names))).tolist():
            if mask:
                closed = upward_closure(len(names), mask)
                assert closed & model.alive == mask
                assert check_element(names, closed) == closed


def test_union_of_atoms():
    def u(text):
        return element_name(RCS, union_of_atoms(3, parse_element(RCS, text)))

    assert u("VS&S") == "VS|S"
    assert u("B") == "B"
    assert u("VS&S|B") == "VS|S|B"
    assert u("VS&B|S&B") == "VS|S|B"


def test_columns_of_histories_have_a_fixed_order():
    focal = [*singletons(3), total_ignorance(3)]
    expected = ["VS", "S", "B", "VS&S", "VS&B", "S&B", "VS&S&B", "VS|S|B"]
    for order in itertools.permutations(focal):
        closed = intersection_closure(order, free_model(RCS).alive)
        assert [element_name(RCS, mask) for mask in closed] == expected
    on_shafer = intersection_closure(focal, shafer_model(RCS).alive)
    written = [element_name(RCS, mask, shafer_model(RCS)) for mask in on_shafer]
    assert written == ["VS", "S", "B", "VS|S|B"]


def test_elements_reduced_by_a_model_are_known_on_the_free_one():
    shafer = shafer_model(RCS)
    for mask in hyper_power_set(3).tolist():
        assert free_element(shafer, mask) == mask
        reduced = mask & shafer.alive
        if reduced:
            free = free_element(shafer, reduced)
            assert free & shafer.alive == reduced
            # Smallest of the elements that the model merges.
            merged = [m for m in hyper_power_set(3).tolist() if m & shafer.alive == reduced]
            assert free in (np.bitwise_and.reduce(merged), total_ignorance(3))
    dead = constrained_model(RCS, ["VS"])
    assert free_element(dead, dead.alive) == total_ignorance(3)
    for mask in (0, -1, 0b11, 1 << 7):
        with pytest.raises(ValueError, match="allowed are elements of the hyper-power set"):
            free_element(dead, mask)
