"""Declarative parameters: types, bounds, suggestions, and errors of one line."""

import math
from array import array
from dataclasses import dataclass, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.parameters import (
    ParameterError,
    Specification,
    from_mapping,
    parameter,
    specifications,
    to_mapping,
)
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.ring import STAGE_TABLES


@dataclass(frozen=True)
class Example:
    share: float = parameter(0.5, "a share", minimum=0.0, maximum=1.0)
    speed: float = parameter(
        3.0, "a speed", unit="m/s", minimum=0.0, minimum_excluded=True, live=False
    )
    count: int = parameter(4, "a count", minimum=1, maximum=10, advanced=True)
    free: int = parameter(0, "any integer")
    switch: bool = parameter(True, "a switch")
    word: str = parameter("a", "a word", choices=("a", "b"))
    text: str = parameter("", "any text")
    means: list[float] = parameter([1.0, 2.0], "some means", unit="m2", minimum=0.0)
    names: list[str] = parameter(["x"], "some names")
    steps: list[int] = parameter([1], "some steps", minimum=0)

    def __post_init__(self):
        if len(self.means) < len(self.names):
            raise ParameterError(f"parameter means = {self.means}: allowed is one per name")


def error_of(**values):
    with pytest.raises(ParameterError) as error:
        from_mapping(Example, values)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_missing_values_take_their_defaults():
    example = from_mapping(Example, {})
    assert example == Example()
    assert to_mapping(example) == {
        "share": 0.5,
        "speed": 3.0,
        "count": 4,
        "free": 0,
        "switch": True,
        "word": "a",
        "text": "",
        "means": [1.0, 2.0],
        "names": ["x"],
        "steps": [1],
    }
    assert from_mapping(Example, to_mapping(example)) == example


def test_defaults_of_lists_are_not_shared():
    from_mapping(Example, {}).means.append(9.0)
    assert from_mapping(Example, {}).means == [1.0, 2.0]
    assert specifications(Example)["means"].default == [1.0, 2.0]


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("share", 1, 1.0),
        ("share", 0, 0.0),
        ("share", np.float32(0.25), 0.25),
        ("share", np.int64(1), 1.0),
        ("count", 3.0, 3),
        ("count", np.int32(3), 3),
        ("count", np.float64(3.0), 3),
        ("free", -(2**63) + 1, -(2**63) + 1),
        ("free", 2**53 + 1, 2**53 + 1),
        ("switch", False, False),
        ("word", "b", "b"),
        ("means", [3, 4.5], [3.0, 4.5]),
        ("means", (3, 4), [3.0, 4.0]),
        ("means", np.array([3.0, 4.0]), [3.0, 4.0]),
        ("means", array("d", [3.0, 4.0]), [3.0, 4.0]),
        ("steps", array("q", [3, 4]), [3, 4]),
        ("steps", [2.0], [2]),
        ("steps", [], []),
    ],
)
def test_values_come_out_in_the_declared_type(name, value, expected):
    got = getattr(from_mapping(Example, {name: value}), name)
    assert got == expected
    assert type(got) is type(expected)
    if isinstance(got, list):
        assert [type(g) for g in got] == [type(e) for e in expected]


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("share", -0.001, "a number >= 0 and <= 1"),
        ("share", 1.001, "a number >= 0 and <= 1"),
        ("share", math.nan, "a number >= 0 and <= 1"),
        ("share", "0.5", "a number >= 0 and <= 1"),
        ("share", True, "a number >= 0 and <= 1"),
        ("share", None, "a number >= 0 and <= 1"),
        ("share", [0.5], "a number >= 0 and <= 1"),
        ("share", 1j, "a number >= 0 and <= 1"),
        pytest.param("share", 10**400, "a number >= 0 and <= 1", id="share-huge"),
        ("speed", 0.0, "a number > 0 [m/s]"),
        ("speed", math.inf, "a number > 0 [m/s]"),
        ("count", 0, "an integer >= 1 and <= 10"),
        ("count", 11, "an integer >= 1 and <= 10"),
        ("count", 2.5, "an integer >= 1 and <= 10"),
        ("count", math.inf, "an integer >= 1 and <= 10"),
        ("count", False, "an integer >= 1 and <= 10"),
        ("free", 2**63, "an integer"),
        pytest.param("free", 10**400, "an integer", id="free-huge"),
        ("switch", 1, "true or false"),
        ("switch", "true", "true or false"),
        ("word", "c", "one of a, b"),
        ("word", 1, "one of a, b"),
        ("text", 5, "a text"),
        ("means", 3.0, "a list, each a number >= 0 [m2]"),
        ("means", "12", "a list, each a number >= 0 [m2]"),
        ("means", [1.0, -1.0], "a list, each a number >= 0 [m2]"),
        ("means", [1.0, math.nan], "a list, each a number >= 0 [m2]"),
        ("means", [[1.0]], "a list, each a number >= 0 [m2]"),
        ("means", {1.0: 2.0}, "a list, each a number >= 0 [m2]"),
        ("means", {1.0, 2.0}, "a list, each a number >= 0 [m2]"),
        ("names", ["a", 3], "a list, each a text"),
        ("names", b"ab", "a list, each a text"),
    ],
)
def test_errors_name_the_parameter_its_value_and_what_is_allowed(name, value, allowed):
    text = error_of(**{name: value})
    assert text.startswith(f"parameter {name} = {value!r}"[:60])
    assert text.endswith(f": allowed is {allowed}")


def test_a_long_value_stays_one_line():
    text = error_of(means=np.full((40, 40), -1.0))
    assert len(text) < 250
    assert text.startswith("parameter means = array([[-1., -1.,")
    text = error_of(word="two\nlines " * 50)
    assert len(text) < 250


@pytest.mark.parametrize(
    ("name", "hint"),
    [("shar", ", did you mean share?"), ("mean", ", did you mean means?"), ("zzz", ""), (3, "")],
)
def test_an_unknown_name_is_an_error_with_a_suggestion(name, hint):
    with pytest.raises(ParameterError) as error:
        from_mapping(Example, {name: 1})
    assert str(error.value) == (
        f"parameter {name}: unknown{hint}; allowed are count, free, means, names, share, speed, "
        "steps, switch, text, word"
    )


@pytest.mark.parametrize("values", [None, 3, "share", ["share"]])
def test_what_is_no_mapping_is_an_error(values):
    with pytest.raises(ParameterError, match="allowed are names with values"):
        from_mapping(Example, values)


def test_combinations_are_checked_by_the_table_itself():
    text = error_of(names=["a", "b", "c"])
    assert text == "parameter means = [1.0, 2.0]: allowed is one per name"


def test_specifications_hold_what_was_declared():
    found = specifications(Example)
    assert list(found) == [f.name for f in fields(Example)]
    assert found["speed"] == Specification(
        name="speed",
        kind=float,
        default=3.0,
        description="a speed",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
    )
    assert found["count"].advanced
    assert found["word"].choices == ("a", "b")
    assert found["steps"].is_list
    assert found["steps"].element_kind is int


anything = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(),
        st.text(max_size=5),
        st.binary(max_size=3),
        st.complex_numbers(),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=2), inner, max_size=2)
    ),
    max_leaves=5,
)


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.sampled_from([f.name for f in fields(Example)]), anything)
def test_any_value_is_refused_in_one_line_or_taken_in_its_type(name, value):
    try:
        example = from_mapping(Example, {name: value})
    except ParameterError as error:
        text = str(error)
    else:
        text = ""
    if text:
        assert text.startswith(f"parameter {name} = ") or name == "names"
        assert "\n" not in text
        return
    found = specifications(Example)[name]
    got = getattr(example, name)
    for element in got if found.is_list else [got]:
        assert type(element) is found.element_kind
    assert found.check(got) == got


# --- the tables of the four nodes


@pytest.mark.parametrize("node", STAGE_TABLES)
def test_the_tables_of_the_nodes_are_complete_and_their_defaults_allowed(node):
    table = STAGE_TABLES[node]
    found = specifications(table)
    assert list(found) == [f.name for f in fields(table)]
    assert found
    for specification in found.values():
        assert specification.description
        assert specification.check(specification.default) == specification.default
        assert specification.allowed
    assert to_mapping(from_mapping(table, {})) == {n: s.default for n, s in found.items()}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"confirmation_hits": 5, "confirmation_scans": 4},
            "parameter confirmation_hits = 5: allowed is at most confirmation_scans = 4",
        ),
        (
            {"queue_depth": 200},
            "parameter detections_depth = 100: allowed is at least queue_depth = 200",
        ),
        (
            {"detection_probability": 1.5},
            "parameter detection_probability = 1.5: allowed is a number",
        ),
        ({"gate_probability": 1.0}, "parameter gate_probability = 1.0: allowed is a number > 0"),
        ({"decision": "best"}, "parameter decision = 'best': allowed is one of gda, map"),
        (
            {"gate_probabilty": 0.9},
            "parameter gate_probabilty: unknown, did you mean gate_probability?",
        ),
    ],
)
def test_the_track_manager_refuses_in_one_line(values, message):
    with pytest.raises(ParameterError) as error:
        from_mapping(TrackManagerParameters, values)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "values",
    [
        {"detection_probability": 1.0, "clutter_density_per_m_rad": 0.0},
        {"confirmation_hits": 2, "confirmation_scans": 2},
        {"deletion_misses": 0, "tentative_deletion_misses": 0},
    ],
)
def test_the_edges_of_the_track_manager_are_allowed(values):
    assert to_mapping(from_mapping(TrackManagerParameters, values)).items() >= values.items()
