"""Further attributes at the door: a bad value becomes unknown, is counted, touches nothing else."""

import math
from collections import Counter

import numpy as np
import pytest
from door_examples import NOISE, detections_of
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.tracking.door import Rejected, validate

NAN, INF = math.nan, math.inf
NAMES = ("length_m", "esm_class")


def admit(detections):
    return validate(detections, NOISE, "map", 5000)


def with_attributes(values, valid=None, names=NAMES, **fields):
    return detections_of(
        attribute_names=names,
        attribute_values=None if values is None else np.array(values),
        attribute_valid=None if valid is None else np.array(valid),
        **fields,
    )


def test_good_attributes_go_through_unchanged():
    values = np.array([[1.0, 2.0, 3.0], [0.0, -1.0, 7.0]])
    detections = with_attributes(values)
    scan, counts = admit(detections)
    assert scan.attribute_names == NAMES
    np.testing.assert_array_equal(scan.attribute_values, values)
    assert scan.attribute_valid.all()
    assert counts == Counter()
    detections.attribute_values[:] = 9.0
    np.testing.assert_array_equal(scan.attribute_values, values)


def test_a_scan_without_attributes():
    scan, _ = admit(detections_of())
    assert scan.attribute_names == ()
    assert scan.attribute_values is None
    assert scan.attribute_valid is None


def test_values_that_are_no_numbers_are_unknown_and_counted():
    scan, counts = admit(
        with_attributes(
            [[NAN, 2.0, INF], [1.0, NAN, 2.0]],
            [[True, True, True], [True, False, False]],
        )
    )
    assert len(scan) == 3
    np.testing.assert_array_equal(scan.attribute_values, [[0.0, 2.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(
        scan.attribute_valid, [[False, True, False], [True, False, False]]
    )
    # What was marked as not valid is unknown, not a fault.
    assert counts == Counter({"attribute_not_finite": 2})


def test_attributes_follow_the_detections_that_stay():
    scan, counts = admit(
        with_attributes([[1.0, NAN, 3.0], [4.0, 5.0, 6.0]], range_m=np.array([900.0, NAN, 1100.0]))
    )
    assert scan.source_index.tolist() == [0, 2]
    np.testing.assert_array_equal(scan.attribute_values, [[1.0, 3.0], [4.0, 6.0]])
    # The value of a detection that is left out is not counted beside it.
    assert counts == Counter({"not_finite": 1})


def test_no_detections():
    empty = {"range_m": np.zeros(0), "azimuth_rad": np.zeros(0), "rcs_m2": None}
    for values in (np.zeros((2, 0)), np.zeros(0)):
        scan, _ = admit(with_attributes(values, **empty))
        assert scan.attribute_values.shape == (2, 0)
        assert scan.attribute_valid.shape == (2, 0)


@pytest.mark.parametrize(
    ("reason", "fields"),
    [
        ("array_length_mismatch", {"values": [[1.0, 2.0], [1.0, 2.0]]}),
        ("array_length_mismatch", {"values": [1.0, 2.0, 3.0, 4.0, 5.0]}),
        ("array_length_mismatch", {"values": [[1.0, 2.0, 3.0]]}),
        ("array_length_mismatch", {"values": None}),
        ("array_length_mismatch", {"values": np.ones((2, 3)), "valid": [[True] * 3]}),
        ("array_length_mismatch", {"values": np.ones((2, 3)), "names": ()}),
        ("malformed_array", {"values": [["a", "b", "c"]] * 2}),
        ("bad_attribute_names", {"values": np.ones((2, 3)), "names": ("length_m", "length_m")}),
        ("bad_attribute_names", {"values": np.ones((2, 3)), "names": ("length_m", "")}),
        ("bad_attribute_names", {"values": np.ones((2, 3)), "names": ("length_m", 7)}),
        ("bad_attribute_names", {"values": np.ones((2, 3)), "names": "ab"}),
        ("bad_attribute_names", {"values": np.ones((2, 3)), "names": None}),
        (
            "bad_attribute_names",
            {"values": np.ones((65, 3)), "names": tuple(f"a{i}" for i in range(65))},
        ),
    ],
)
def test_attributes_that_do_not_fit_reject_the_scan(reason, fields):
    with pytest.raises(Rejected) as rejection:
        admit(with_attributes(**fields))
    assert str(rejection.value) == reason


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.floats(), st.integers(0, 2), st.integers(0, 1), st.booleans())
def test_a_bad_value_touches_nothing_else(value, column, row, valid):
    values, flags = np.arange(6.0).reshape(2, 3), np.ones((2, 3), dtype=bool)
    before, _ = admit(with_attributes(values, flags))
    values[row, column], flags[row, column] = value, valid
    after, counts = admit(with_attributes(values, flags))
    untouched = np.ones((2, 3), dtype=bool)
    untouched[row, column] = False
    for name in ("attribute_values", "attribute_valid"):
        np.testing.assert_array_equal(
            getattr(after, name)[untouched], getattr(before, name)[untouched]
        )
    for name in ("range_m", "azimuth_rad", "rcs_m2", "rcs_valid", "noise_covariance"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert np.isfinite(after.attribute_values).all()
    assert counts["attribute_not_finite"] == int(valid and not math.isfinite(value))
