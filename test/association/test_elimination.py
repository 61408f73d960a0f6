from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association.elimination import CLOSE, OPEN, PAIR, find_elimination

examples = settings(derandomize=True, deadline=None, max_examples=80)
gates = st.tuples(st.integers(1, 12), st.integers(1, 12), st.floats(0, 1), st.integers(0, 2**32))


def check(order, step, element, steps, elements):
    """Every pair once, while both nodes are open; every node opened and closed once."""
    frontier, closed, paired, widest, kept = [], [], [], 0, 0
    for kind, number, bit, other in order.actions:
        if kind == OPEN:
            assert number not in frontier
            assert number not in closed
            frontier.append(number)
        elif kind == PAIR:
            assert {frontier[bit], frontier[other]} == {step[number], steps + element[number]}
            paired.append(number)
            widest = max(widest, len(frontier))
            kept += 2 ** (len(frontier) - 2)
        else:
            assert kind == CLOSE
            assert frontier.pop(bit) == number
            closed.append(number)
    assert frontier == []
    assert sorted(closed) == list(range(steps + elements))
    assert sorted(paired) == list(range(len(step)))
    assert (order.width, order.memory) == (widest, kept)


@examples
@given(gates)
def test_every_pair_has_its_turn_while_both_nodes_are_open(drawn):
    n, m, share, seed = drawn
    step, element = np.nonzero(np.random.default_rng(seed).random((n, m)) < share)
    order = find_elimination(step, element, n, m, math.inf)
    check(order, step, element, n, m)


@pytest.mark.parametrize("reach", [2, 3, 4, 7])
def test_a_chain_of_any_length_is_narrow(reach, chain):
    for n in (10, 50, 200):
        log_weight = chain(np.random.default_rng([n, reach]), n, reach, 1.0)[0]
        step, element = np.nonzero(log_weight > -np.inf)
        order = find_elimination(step, element, *log_weight.shape, math.inf)
        check(order, step, element, *log_weight.shape)
        assert order.width <= reach + 3


def test_stars_and_trees_take_two_open_nodes():
    # One track with 30 measurements, and turned; the private ones are closed at once.
    for place in ((np.zeros(30, int), np.arange(30)), (np.arange(30), np.zeros(30, int))):
        assert find_elimination(*place, place[0][-1] + 1, place[1][-1] + 1, math.inf).width == 2


def test_a_bound_is_kept():
    step, element = np.nonzero(np.ones((10, 10)))
    order = find_elimination(step, element, 10, 10, math.inf)
    assert order.width == 11
    assert find_elimination(step, element, 10, 10, order.operations) is not None
    assert find_elimination(step, element, 10, 10, 0.9 * order.operations) is None
    everything = np.nonzero(np.ones((80, 90)))
    assert find_elimination(*everything, 80, 90, math.inf) is None


def test_the_same_gates_give_the_same_order(chain):
    log_weight = chain(np.random.default_rng(1), 30, 4, 1.0)[0]
    place = np.nonzero(log_weight > -np.inf)
    first, again = (find_elimination(*place, 30, 33, math.inf) for _ in range(2))
    assert first == again
