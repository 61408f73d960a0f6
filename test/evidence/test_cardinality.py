import evidencelib
import numpy as np
import pytest

from gda_tracker.evidence.cardinality import dsm_cardinality, elements
from gda_tracker.evidence.frames import (
    constrained_model,
    element_name,
    free_model,
    hyper_power_set,
    parse_element,
    shafer_model,
)

NAMES = ("A", "B", "C", "D")


@pytest.mark.parametrize(
    ("size", "free", "shafer"), [(1, 1, 1), (2, 4, 3), (3, 18, 7), (4, 166, 15)]
)
def test_counts_on_the_free_and_on_shafers_model(size, free, shafer):
    # With the empty set 5, 19, 167 and 2^n.
    assert len(elements(free_model(NAMES[:size]))) == free
    assert len(elements(shafer_model(NAMES[:size]))) == shafer


@pytest.mark.parametrize(
    ("empty", "count"),
    [
        (["A&B&C"], 17),  # of the models in Dezert and Smarandache, volume 1, chapter 4
        (["A&B"], 12),
        (["(A|B)&C"], 9),
        (["A"], 4),
        (["A|B"], 1),
    ],
)
def test_counts_under_constraints(empty, count):
    model = constrained_model(NAMES[:3], empty)
    found = elements(model)
    assert len(found) == len(np.unique(found)) == count
    theirs = evidencelib.Frame.hybrid(NAMES[:3], empty=empty)
    assert len(theirs.elements()) == count + 1


def test_dsm_cardinality_of_the_free_model():
    model = free_model(NAMES[:3])
    found = [
        dsm_cardinality(model, parse_element(model.names, text))
        for text in ("A&B&C", "A&B", "A&(B|C)", "A&B|A&C|B&C", "A", "A|B&C", "A|B", "A|B|C")
    ]
    assert found == [1, 2, 3, 4, 4, 5, 6, 7]


def test_dsm_cardinality_under_constraints_agrees_with_evidencelib():
    empty = ["A&B", "C&D"]
    model, frame = constrained_model(NAMES, empty), evidencelib.Frame.hybrid(NAMES, empty=empty)
    for mask in hyper_power_set(4).tolist():
        theirs = frame.proposition(element_name(NAMES, mask))
        assert dsm_cardinality(model, mask) == len(theirs.regions)
        reduced = mask & model.alive
        if reduced:
            assert dsm_cardinality(model, reduced) == len(theirs.regions)
