"""Objectives: which are told, which results nothing beats, which one is chosen."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tuning_examples import case_of

from gda_tracker.parameters import ParameterError
from gda_tracker.tuning.objectives import (
    OBJECTIVES,
    choose,
    pareto_front,
    parse_objectives,
    values_of,
)

GOSPA, COMPLETENESS = OBJECTIVES["gospa"], OBJECTIVES["completeness"]
PAIR = (GOSPA, COMPLETENESS)


def test_names_are_read_and_what_the_truth_does_not_tell_is_refused():
    partial = case_of([[(0.0, 0.0)]])
    complete = case_of([[(0.0, 0.0)]], [[1]], partial=False)
    names = ["gospa", "false-tracks", "purity", "gospa"]
    found = parse_objectives(names, [complete])
    assert [objective.name for objective in found] == ["gospa", "false_tracks", "purity"]
    with pytest.raises(ParameterError, match="--complete-truth"):
        parse_objectives(["false_tracks"], [complete, partial])
    with pytest.raises(ParameterError, match="source of each detection"):
        parse_objectives(["purity"], [partial])
    with pytest.raises(ParameterError, match="--objective speed: allowed is one of gospa"):
        parse_objectives(["speed"], [partial])


def test_values_come_in_the_order_of_the_objectives():
    assert values_of(PAIR, {"completeness": 0.5, "gospa_m": 3.0}) == [3.0, 0.5]
    with pytest.raises(ValueError, match="GOSPA cannot be told"):
        values_of(PAIR, {"completeness": 0.5, "gospa_m": None})


ROWS = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), max_size=9)


@given(ROWS)
def test_the_front_is_what_nothing_beats(rows):
    front = pareto_front(PAIR, rows)

    def beats(a, b):
        return a != b and a[0] <= b[0] and a[1] >= b[1]

    unbeaten = {row for row in rows if not any(beats(other, row) for other in rows)}
    assert {rows[place] for place in front} == unbeaten
    assert len(front) == len(unbeaten)
    for place in front:
        assert rows.index(rows[place]) == place


@given(st.tuples(st.integers(0, 4), st.integers(0, 4)), ROWS)
def test_what_is_chosen_is_worse_in_nothing_and_best_in_the_first(baseline, rows):
    place = choose(PAIR, baseline, rows)
    allowed = [r for r in rows if r[0] <= baseline[0] and r[1] >= baseline[1] and r != baseline]
    if place is None:
        assert not allowed
        return
    assert rows[place] in allowed
    assert (rows[place][0], -rows[place][1]) == min((r[0], -r[1]) for r in allowed)


def test_better_in_one_and_worse_in_another_is_not_chosen():
    assert choose(PAIR, (3.0, 0.5), [(1.0, 0.4), (2.9, 0.5)]) == 1
    assert choose(PAIR, (3.0, 0.5), [(1.0, 0.4), (3.0, 0.5)]) is None
    assert choose([COMPLETENESS], (0.5,), [(0.4,), (0.7,), (0.6,)]) == 1


def test_directions_and_units():
    for objective, value in itertools.product(OBJECTIVES.values(), (1.0,)):
        assert objective.direction == ("minimize" if objective.sign == 1 else "maximize")
        assert objective.format(value).startswith("1.000")
    assert GOSPA.format(0.5, signed=True) == "+0.500 m"
