"""Sequential extraction: worked values, brute force, and error rates against their thresholds."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.extraction import (
    SequentialTest,
    decide,
    existence_probability,
    followed_increments,
    pair_log_ratios,
    scan_increments,
    sequential_test,
    summed_increments,
    track_log_ratios,
)
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE

P_D, P_G = 0.8, 0.9


def test_thresholds_by_hand():
    """Koch 2014, (4.3), with P_0 = .01 and P_1 = .95: A = .05/.99, B = 95."""
    test = sequential_test(0.01, 0.05)
    assert math.exp(test.log_reject) == pytest.approx(0.05 / 0.99)
    assert math.exp(test.log_accept) == pytest.approx(95.0)


def test_a_track_by_hand():
    """A detection of density .04 in clutter of .001, one with the wrong class, then a miss."""
    p_d, one = np.array([P_D]), np.array([0])
    ratio = pair_log_ratios(np.log([0.04]), 0.001)
    first = followed_increments(p_d, P_G, one, ratio)
    assert math.exp(first[0]) == pytest.approx(0.8 * 40.0)
    # The same detection, whose radar cross section is 5 times as likely from a false alarm.
    ratio = pair_log_ratios(np.log([0.04]), 0.001, np.log([0.1]), np.log([0.5]))
    second = followed_increments(p_d, P_G, one, ratio)
    assert math.exp(second[0]) == pytest.approx(0.8 * 40.0 / 5.0)
    miss = followed_increments(p_d, P_G, np.zeros(0, dtype=int), np.zeros(0))
    assert math.exp(miss[0]) == pytest.approx(1.0 - 0.72)
    total = first + second + miss
    assert math.exp(total[0]) == pytest.approx(32.0 * 6.4 * 0.28)
    assert existence_probability(total)[0] == pytest.approx(57.344 / 58.344)
    assert existence_probability(total, prior=0.1)[0] == pytest.approx(
        57.344 * 0.1 / (57.344 * 0.1 + 0.9)
    )
    # Both detections at once: .28 + .8 (40 + 8).
    both = summed_increments(p_d, P_G, np.array([0, 0]), np.log([40.0, 8.0]))
    assert math.exp(both[0]) == pytest.approx(0.28 + 0.8 * 48.0)


def test_the_increment_is_the_ratio_of_the_likelihoods_of_the_scan():
    """Against p(Z | h1) / p(Z | h0) written out: Poisson clutter in the gate, any origin equal."""
    rng = np.random.default_rng(1)
    density, volume = 0.3, 7.0

    def clutter(count):  # unordered points, uniform in the gate
        expected = density * volume
        return math.exp(-expected) * expected**count / math.factorial(count) / volume**count

    for count in range(5):
        g = rng.uniform(0.01, 0.5, count)  # density of the target's detection at each point
        # g integrates to P_G over the gate; of m points each may be the target's, with 1/m.
        h1 = (1.0 - P_D * P_G) * clutter(count)
        if count:
            h1 += P_D * clutter(count - 1) * g.mean()
        found = summed_increments(
            np.array([P_D]), P_G, np.zeros(count, dtype=int), pair_log_ratios(np.log(g), density)
        )
        assert math.exp(found[0]) == pytest.approx(h1 / clutter(count), rel=1e-12)


rows = st.lists(st.tuples(st.integers(0, 3), st.floats(-700.0, 700.0)), max_size=12)


@given(rows)
def test_branches_add_up_to_the_sum(listed):
    hypothesis = np.array([h for h, _ in listed], dtype=np.int32)
    ratio = np.array([r for _, r in listed])
    p_d = np.array([0.1, 0.5, 0.9, 1.0])
    summed = summed_increments(p_d, P_G, hypothesis, ratio)
    # One branch per gated detection, and one for the miss, per track.
    track = np.concatenate([hypothesis, np.arange(4)])
    branches = followed_increments(p_d[track], P_G, np.arange(len(ratio)), ratio)
    totals = track_log_ratios(track.astype(np.int64), branches)
    np.testing.assert_allclose(totals[len(ratio) :], summed, rtol=1e-12, atol=1e-12)


@given(rows, st.randoms(use_true_random=False))
def test_the_order_of_pairs_does_not_matter(listed, random):
    p_d = np.array([0.1, 0.5, 0.9, 1.0])
    shuffled = list(listed)
    random.shuffle(shuffled)
    one, other = (
        summed_increments(
            p_d, P_G, np.array([h for h, _ in rows], dtype=int), np.array([r for _, r in rows])
        )
        for rows in (listed, shuffled)
    )
    np.testing.assert_allclose(one, other, rtol=1e-12)


def test_limits():
    p_d = np.array([0.5, 1.0])
    pairs = np.array([0, 1])
    # Without clutter every detection is a target's.
    certain = summed_increments(p_d, 1.0, pairs, pair_log_ratios(np.zeros(2), 0.0))
    np.testing.assert_array_equal(certain, [np.inf, np.inf])
    # Without a detection a target that is always seen is not there.
    nothing = summed_increments(p_d, 1.0, np.zeros(0, dtype=int), np.zeros(0))
    np.testing.assert_array_equal(nothing, [math.log(0.5), -np.inf])
    np.testing.assert_array_equal(existence_probability(np.array([np.inf, -np.inf])), [1.0, 0.0])


def test_the_decision_confirms_holds_and_ends():
    test = SequentialTest(math.log(0.1), math.log(20.0))
    status = np.array([TENTATIVE, TENTATIVE, TENTATIVE, CONFIRMED, CONFIRMED, CONFIRMED])
    ratio = np.log([20.1, 19.9, 0.09, 1.0, 300.0, 0.1])
    new, held, ended = decide(status, np.arange(6), ratio, test)
    np.testing.assert_array_equal(
        new, [CONFIRMED, TENTATIVE, TENTATIVE, CONFIRMED, CONFIRMED, CONFIRMED]
    )
    np.testing.assert_array_equal(ended, [False, False, True, False, False, True])
    np.testing.assert_allclose(np.exp(held), [20.0, 19.9, 0.09, 1.0, 20.0, 0.1])
    new, held, ended = decide(np.zeros(1, dtype=int), np.zeros(1), np.array([np.inf]), test)
    assert (new[0], held[0], ended[0]) == (CONFIRMED, test.log_accept, False)
    assert all(len(part) == 0 for part in decide(status[:0], status[:0], ratio[:0], test))


def test_branches_are_judged_together():
    test = SequentialTest(math.log(0.1), math.log(20.0))
    track = np.array([7, 5, 7, 5])
    ratio = np.log([15.0, 0.04, 10.0, 0.05])
    status, held, ended = decide(np.full(4, TENTATIVE), track, ratio, test)
    np.testing.assert_array_equal(status, [CONFIRMED, TENTATIVE, CONFIRMED, TENTATIVE])
    np.testing.assert_array_equal(ended, [False, True, False, True])
    np.testing.assert_allclose(np.exp(held), [12.0, 0.04, 8.0, 0.05])


DENSITY = np.full(3, 0.01)


def scan_of(assigned, pairs, track_id=(1, 2, 3)):
    """Predictions and associations of three tracks; ``pairs`` are (hypothesis, detection, g)."""
    settings = SimpleNamespace(gate_probability=P_G)
    predictions = SimpleNamespace(
        track_id=np.array(track_id),
        detection_probability=np.full(3, P_D),
        settings=settings,
    )
    associations = SimpleNamespace(
        hypothesis=np.array([p[0] for p in pairs], dtype=np.int32),
        detection=np.array([p[1] for p in pairs], dtype=np.int32),
        kinematic_log_likelihood=np.log([p[2] for p in pairs]),
        assigned_detection=np.array(assigned, dtype=np.int32),
        degraded=False,
        group_chosen=np.zeros(0, dtype=bool),
    )
    return predictions, associations


def test_a_detection_of_another_track_does_not_speak():
    pairs = [(0, 0, 0.5), (0, 1, 0.2), (1, 0, 0.4), (1, 2, 0.1), (2, 2, 0.3)]
    predictions, associations = scan_of([0, -1, 2], pairs)
    found = np.exp(scan_increments(predictions, None, associations, DENSITY))
    # Track 1: its own detection 0 and the free one 1. Track 2: both taken by others.
    np.testing.assert_allclose(found, [0.28 + 0.8 * 70.0, 0.28, 0.28 + 0.8 * 30.0])
    # Twice the clutter around track 1 makes its detections half as good.
    dense = np.exp(scan_increments(predictions, None, associations, DENSITY * [2.0, 1.0, 1.0]))
    np.testing.assert_allclose(dense, [0.28 + 0.8 * 35.0, 0.28, 0.28 + 0.8 * 30.0])
    # Branches of one track do not take from each other.
    predictions, associations = scan_of([0, -1, 2], pairs, track_id=(1, 1, 3))
    found = np.exp(scan_increments(predictions, None, associations, DENSITY))
    np.testing.assert_allclose(found, [0.28 + 0.8 * 70.0, 0.28 + 0.8 * 40.0, 0.28 + 0.8 * 30.0])


def test_attributes_speak_as_far_as_they_were_asked():
    predictions, associations = scan_of([0, -1, -1], [(0, 1, 0.5), (1, 0, 0.4)])
    scores = SimpleNamespace(
        log_likelihood=np.log([0.2, 0.6]), clutter_log_likelihood=np.log([0.3, 0.1])
    )
    found = np.exp(scan_increments(predictions, scores, associations, DENSITY))
    np.testing.assert_allclose(found, [0.28 + 0.8 * 50.0 * 2.0, 0.28, 0.28])
    associations.degraded = True
    alone = np.exp(scan_increments(predictions, scores, associations, DENSITY))
    np.testing.assert_allclose(alone, [0.28 + 0.8 * 50.0, 0.28, 0.28])
    associations.degraded, associations.assigned_detection = False, np.full(3, -1)
    found = np.exp(scan_increments(predictions, scores, associations, DENSITY))
    np.testing.assert_allclose(found[1], 0.28 + 0.8 * 40.0 * 2.0)


def error_rate(target, test, p_detection, density, seed, trials=20_000):
    """Share of accepted tests and their mean length, many targets (or none) in their own clutter.

    In units of the innovation: S is the unit matrix, the gate a disc.
    """
    rng = np.random.default_rng(seed)
    gate = -2.0 * math.log(1.0 - P_G)
    ratio, accepted, length = np.zeros(trials), np.zeros(trials, dtype=bool), np.zeros(trials)
    live = np.arange(trials)
    for _ in range(600):
        owner = np.repeat(live, rng.poisson(density * math.pi * gate, len(live)))
        squared = gate * rng.random(len(owner))
        if target:
            own = rng.chisquare(2, len(live))
            inside = (rng.random(len(live)) < p_detection) & (own <= gate)
            owner = np.concatenate([owner, live[inside]])
            squared = np.concatenate([squared, own[inside]])
        pair = pair_log_ratios(-0.5 * squared - math.log(2.0 * math.pi), density)
        p_d = np.full(trials, p_detection)
        ratio[live] += summed_increments(p_d, P_G, owner, pair)[live]
        length[live] += 1
        status, _, ended = decide(np.zeros(trials, dtype=int), np.arange(trials), ratio, test)
        accepted[live] = status[live] == CONFIRMED
        live = live[~ended[live] & ~accepted[live]]
        if not len(live):
            break
    assert len(live) == 0
    return accepted.mean(), length.mean()


@pytest.mark.parametrize(
    ("p_false", "p_missed", "p_detection", "density"),
    [(0.05, 0.1, 0.5, 0.1), (0.01, 0.05, 0.7, 0.05), (0.05, 0.02, 0.9, 0.01)],
)
def test_error_rates_match_the_thresholds(p_false, p_missed, p_detection, density):
    test = sequential_test(p_false, p_missed)
    false, _ = error_rate(False, test, p_detection, density, seed=3)
    found, length = error_rate(True, test, p_detection, density, seed=4)
    missed, noise = 1.0 - found, 3.0 / math.sqrt(20_000)
    # Wald's inequalities, exact for any increments.
    a, b = math.exp(test.log_reject), math.exp(test.log_accept)
    assert false <= found / b + noise * math.sqrt(p_false)
    assert missed <= a * (1.0 - false) + noise * math.sqrt(p_missed)
    assert false + missed <= p_false + p_missed + noise * math.sqrt(p_false + p_missed)
    # Close where a scan carries the ratio only a little: many faint detections per gate.
    faint = length > 10.0
    assert faint == (density >= 0.05)
    for rate, asked in ((false, p_false), (missed, p_missed)):
        assert rate >= (0.6 if faint else 0.25) * asked


def test_the_ratio_has_mean_one_without_a_target():
    """Its increments are a martingale under h0: what Wald's inequalities rest on."""
    rng = np.random.default_rng(8)
    gate, trials, density = -2.0 * math.log(1.0 - P_G), 200_000, 0.2
    owner = np.repeat(np.arange(trials), rng.poisson(density * math.pi * gate, trials))
    squared = gate * rng.random(len(owner))
    pair = pair_log_ratios(-0.5 * squared - math.log(2.0 * math.pi), density)
    factor = np.exp(summed_increments(np.full(trials, P_D), P_G, owner, pair))
    assert factor.mean() == pytest.approx(1.0, abs=4.0 * factor.std() / math.sqrt(trials))


def test_fewer_errors_cost_more_scans():
    lengths = [
        error_rate(True, sequential_test(p, p), 0.5, 0.1, seed=5, trials=4000)[1]
        for p in (0.2, 0.05, 0.01)
    ]
    assert all(short < long for short, long in itertools.pairwise(lengths))


@pytest.mark.parametrize(
    ("p_false", "p_missed"), [(0.0, 0.1), (0.1, 0.0), (0.5, 0.5), (1.0, 0.1), (-0.1, 0.2)]
)
def test_error_probabilities_out_of_range_are_named(p_false, p_missed):
    with pytest.raises(ParameterError, match=f"false_track_probability = {p_false}"):
        sequential_test(p_false, p_missed)


def test_a_prior_out_of_range_is_named():
    with pytest.raises(ValueError, match=r"prior = 1\.0"):
        existence_probability(np.zeros(1), prior=1.0)
