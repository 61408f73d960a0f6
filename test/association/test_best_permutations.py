from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association import best_permutations
from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.association.best_permutations import (
    best_permutation_marginals,
    pattern_count,
)
from gda_tracker.association.choices import (
    BEST_PERMUTATIONS,
    ENGINES,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.joint import joint_marginals

examples = settings(derandomize=True, deadline=None, max_examples=50)
FAR = -np.inf


def of_one(cluster):
    return best_permutation_marginals(*(part[None] for part in cluster))[0]


def by_enumeration(brute_force, cluster):
    """The heaviest hypothesis for each set of tracks and set of measurements, normalised."""
    everything = brute_force(*cluster)
    best = {}
    for hypothesis, log_weight in zip(everything.hypotheses, everything.log_weights, strict=True):
        tracks = frozenset(i for i, j in enumerate(hypothesis) if j >= 0)
        key = tracks, frozenset(hypothesis) - {-1}
        if key not in best or log_weight > best[key][0]:
            best[key] = log_weight, hypothesis
    total = math.fsum(math.exp(value - everything.best) for value, _ in best.values())
    marginals = np.zeros(cluster[0].shape)
    for value, hypothesis in best.values():
        for i, j in enumerate(hypothesis):
            if j >= 0:
                marginals[i, j] += math.exp(value - everything.best) / total
    return marginals


@pytest.mark.parametrize("spread", [1.0, 20.0, 2000.0])
@pytest.mark.parametrize("zeros", [0.0, 0.4])
def test_equals_enumeration(spread, zeros, brute_force, random_cluster):
    rng = np.random.default_rng([int(spread), int(10 * zeros)])
    feasible = 0
    for n, m in [(1, 1), (1, 4), (4, 1), (2, 2), (2, 3), (3, 2), (4, 4), (3, 5), (5, 4)] * 3:
        cluster = random_cluster(rng, n, m, spread, zeros)
        # Idle weights of zero are a limit; a hypothesis without them must be there to compare.
        if not brute_force(*cluster).feasible:
            continue
        feasible += 1
        np.testing.assert_allclose(
            of_one(cluster), by_enumeration(brute_force, cluster), rtol=0, atol=1e-12
        )
    assert feasible > 10


def test_counts_the_patterns_of_the_enumeration(brute_force):
    for n, m in ((1, 1), (2, 3), (4, 4), (5, 3)):
        patterns = {
            (frozenset(i for i, j in enumerate(h) if j >= 0), frozenset(h) - {-1})
            for h in brute_force(np.zeros((n, m)), np.zeros(n), np.zeros(m)).hypotheses
        }
        assert pattern_count(n, m) == len(patterns)


def test_without_permutations_it_is_plain(random_cluster):
    rng = np.random.default_rng(1)
    for n, m in ((1, 5), (5, 1)):
        cluster = random_cluster(rng, n, m, 3.0)
        np.testing.assert_allclose(of_one(cluster), joint_marginals(*cluster), rtol=0, atol=1e-13)
    # A chain of two tracks that share one measurement has one way for every pattern, too.
    cluster = random_cluster(rng, 2, 2, 3.0)
    cluster[0][1, 0] = FAR
    np.testing.assert_allclose(of_one(cluster), joint_marginals(*cluster), rtol=0, atol=1e-13)


def test_two_close_tracks_keep_to_their_own():
    # Either order is nearly as good: JPDA halves every pair, JPDA* takes the better order.
    log_weight = np.log([[0.51, 0.49], [0.49, 0.51]])
    idle = np.full(2, -30.0)
    plain = joint_marginals(log_weight, idle, idle)
    assert 0.45 < plain[0, 1] < plain[0, 0] < 0.55
    np.testing.assert_allclose(of_one((log_weight, idle, idle)), np.eye(2), atol=1e-9)


@examples
@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 2**32))
def test_permuting_tracks_and_measurements_permutes_the_answer(random_cluster, n, m, seed):
    rng = np.random.default_rng(seed)
    log_weight, r, c = random_cluster(rng, n, m, 10.0)
    rows, columns = rng.permutation(n), rng.permutation(m)
    found = of_one((log_weight, r, c))
    assert found.min() >= 0.0
    assert found.sum(axis=1).max() <= 1.0 + 1e-12
    assert found.sum(axis=0).max() <= 1.0 + 1e-12
    moved = of_one((log_weight[np.ix_(rows, columns)], r[rows], c[columns]))
    np.testing.assert_allclose(moved, found[np.ix_(rows, columns)], rtol=0, atol=1e-12)
    turned = of_one((log_weight.T, c, r)).T
    np.testing.assert_allclose(turned, found, rtol=0, atol=1e-12)


def test_batches_go_in_pieces(monkeypatch, random_cluster):
    rng = np.random.default_rng(2)
    drawn = [random_cluster(rng, 3, 4, 5.0, 0.2) for _ in range(9)]
    stacked = [np.array(part) for part in zip(*drawn, strict=True)]
    whole = best_permutation_marginals(*stacked)
    monkeypatch.setattr(best_permutations, "CHUNK_ELEMENTS", 250)
    np.testing.assert_array_equal(best_permutation_marginals(*stacked), whole)


def test_certain_detection_and_no_clutter_is_the_best_permutation(random_cluster):
    log_weight, _, _ = random_cluster(np.random.default_rng(3), 4, 4, 3.0)
    none = np.full(4, FAR)
    found = of_one((log_weight, none, none))
    assert set(found.ravel().tolist()) == {0.0, 1.0}
    np.testing.assert_array_equal(found.sum(axis=0), 1.0)


REMEDY = AssociationParameters(coalescence_remedy="jpda_star")


@pytest.fixture
def scan_of_three_clusters(make_stage_input):
    """Two tracks that compete, one alone, and two that share one detection, by joint likelihood."""
    log_g = np.full((5, 5), FAR)
    log_g[:2, :2] = [[-9.0, -9.1], [-9.3, -9.0]]
    log_g[2, 2] = -9.0
    log_g[3, 3:] = [-9.0, -9.5]
    log_g[4, 3:] = [-9.2, -9.1]

    def make(decision):
        return make_stage_input(
            log_g,
            decision=decision,
            attribute_term="bayes",
            attribute_log_likelihood=np.random.default_rng(4).normal(size=(5, 5)),
            clutter_log_likelihood=np.linspace(-1.0, 1.0, 5),
        )

    return make


def test_the_stage_prunes_only_for_jpda(scan_of_three_clusters, brute_force):
    plain = Associator(AssociationParameters())(*scan_of_three_clusters("jpda"))
    pruned = Associator(REMEDY)(*scan_of_three_clusters("jpda"))
    np.testing.assert_array_equal(pruned.p_kinematic, plain.p_kinematic)
    np.testing.assert_array_equal(pruned.chosen, plain.chosen)
    names = [ENGINES[engine] for engine in pruned.cluster_engine]
    assert names == [BEST_PERMUTATIONS, SUBSET_DYNAMIC_PROGRAMMING, BEST_PERMUTATIONS]
    for decision in ("map", "gda"):
        found = Associator(REMEDY)(*scan_of_three_clusters(decision))
        np.testing.assert_array_equal(found.joint_marginal, plain.joint_marginal)
        assert BEST_PERMUTATIONS not in [ENGINES[engine] for engine in found.cluster_engine]
    # By enumeration of the whole scan: parts without common gates do not disturb each other.
    scan, predictions, scores, pairs = scan_of_three_clusters("jpda")
    log_weight = np.full((5, 5), FAR)
    log_weight[pairs.hypothesis, pairs.detection] = (
        np.log(0.9) + pairs.log_likelihood + scores.log_likelihood
    )
    cluster = log_weight, np.full(5, np.log(0.1)), np.log(1e-6) + scores.clutter_log_likelihood
    everything = brute_force(*cluster).marginals[pairs.hypothesis, pairs.detection]
    np.testing.assert_allclose(plain.joint_marginal, everything, rtol=0, atol=1e-12)
    for rows in (slice(0, 2), slice(2, 3), slice(3, 5)):
        part = cluster[0][rows, rows], cluster[1][rows], cluster[2][rows]
        expected = by_enumeration(brute_force, part)
        mine = np.isin(pairs.hypothesis, np.arange(5)[rows])
        np.testing.assert_allclose(
            pruned.joint_marginal[mine], expected.ravel(), rtol=0, atol=1e-12
        )


def test_beyond_the_bound_plain_jpda_answers_and_says_so(make_stage_input, monkeypatch):
    monkeypatch.setattr(best_permutations, "MAX_PATTERNS", pattern_count(2, 2))
    log_g = np.full((5, 5), FAR)
    log_g[:2, :2] = -9.0
    log_g[2:, 2:] = np.random.default_rng(5).normal(-9.0, 1.0, (3, 3))
    stage = make_stage_input(log_g, decision="jpda")
    found = Associator(REMEDY)(*stage)
    names = [ENGINES[engine] for engine in found.cluster_engine]
    assert names == [BEST_PERMUTATIONS, SUBSET_DYNAMIC_PROGRAMMING]
    plain = Associator(AssociationParameters())(*stage)
    np.testing.assert_array_equal(found.joint_marginal[4:], plain.joint_marginal[4:])
    loopy = Associator(AssociationParameters(coalescence_remedy="jpda_star", max_exact_size=1))
    names = [ENGINES[engine] for engine in loopy(*stage).cluster_engine]
    assert names == [BEST_PERMUTATIONS, LOOPY_BELIEF_PROPAGATION]
