"""Best and k best global hypotheses: against enumeration, integer programming and themselves."""

import doctest

import numpy as np
import pytest
from leaf_examples import (
    chain_leaves,
    clusters_by_search,
    compatible,
    enumerate_all,
    random_leaves,
)

from gda_tracker.association import global_hypotheses, leaf_pruning
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.global_hypotheses import (
    LOG_VANISHING,
    SearchLimits,
    best_global_hypothesis,
    k_best_global_hypotheses,
)
from gda_tracker.association.leaves import best
from gda_tracker.association.leaves.search import Found

NARROW = SearchLimits(first_width=1, second_width=1, width=1)
"""Little is proven by dynamic programming with it: integer programming has to answer."""
PRICED = SearchLimits(first_width=1, second_width=1, width=1000, nodes=0)
HOPELESS = SearchLimits(first_width=1, second_width=1, width=1, price_rounds=0, nodes=0)
ENGINE_LIMITS = (SearchLimits(), PRICED, NARROW)


def draw(seed):
    random = np.random.default_rng(seed)
    return random_leaves(
        random,
        n_tracks=int(random.integers(1, 6)),
        most_leaves=5,
        window=int(random.integers(1, 4)),
        per_scan=int(random.integers(1, 6)),
        all_missed=bool(random.random() < 0.5),
    )


def dense(seed, n_tracks=7, most_leaves=30, **options):
    random = np.random.default_rng(seed)
    return random_leaves(random, n_tracks, most_leaves, window=4, per_scan=n_tracks, **options)


def check_consistent(found, log_score, track, used):
    """The fields of an answer agree with each other and with the leaves."""
    rows = found.leaf[found.leaf >= 0]
    np.testing.assert_array_equal(found.chosen.nonzero()[0], np.sort(rows))
    np.testing.assert_array_equal(track[rows], found.track[found.leaf >= 0])
    assert compatible(used, rows)
    np.testing.assert_array_equal(found.optimal, found.gap <= 0.0)
    dropped = LOG_VANISHING * len(found.dropped)
    assert found.log_weight == pytest.approx(log_score[rows].sum() + dropped, rel=1e-12)


@pytest.mark.parametrize("seed", range(120))
def test_best_equals_enumeration(seed):
    log_score, track, used = draw(seed)
    clusters = enumerate_all(log_score, track, used)
    heaviest = sum(hypotheses[0][0] for _, hypotheses in clusters)
    for limits in ENGINE_LIMITS:
        found = best_global_hypothesis(log_score, track, used, limits=limits)
        check_consistent(found, log_score, track, used)
        assert found.optimal.all()
        assert found.log_weight == pytest.approx(heaviest, rel=1e-12, abs=1e-9)
        assert [found.track[found.cluster == c].tolist() for c in range(len(clusters))] == [
            tracks for tracks, _ in clusters
        ]


@pytest.mark.parametrize("seed", range(60))
def test_an_unproven_answer_is_flagged_and_its_gap_holds(seed):
    log_score, track, used = draw(seed)
    heaviest = sum(hypotheses[0][0] for _, hypotheses in enumerate_all(log_score, track, used))
    found = best_global_hypothesis(log_score, track, used, limits=HOPELESS)
    check_consistent(found, log_score, track, used)
    assert (
        -1e-9 <= heaviest - found.log_weight <= found.gap.sum() + 1e-6 * len(found.dropped) + 1e-9
    )


def test_some_answers_stay_unproven_without_work():
    flags = [best_global_hypothesis(*draw(s), limits=HOPELESS).optimal.all() for s in range(30)]
    assert 0 < sum(flags) < 30


def test_every_engine_answers():
    names = {
        name
        for seed in range(40)
        for limits in ENGINE_LIMITS
        for name in best_global_hypothesis(*draw(seed), limits=limits).engine
    }
    assert names == {
        "independent",
        "dynamic_programming",
        "priced_dynamic_programming",
        "integer_programming",
    }


@pytest.mark.parametrize("seed", range(6))
def test_engines_agree_on_dense_clusters(seed):
    leaves = dense(seed, misses=0.1)
    weights = []
    for limits in (SearchLimits(first_width=20000), *ENGINE_LIMITS):
        found = best_global_hypothesis(*leaves, limits=limits)
        check_consistent(found, *leaves)
        assert found.optimal.all()
        weights.append(found.log_weight)
    np.testing.assert_allclose(weights, weights[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("k", [1, 3, 20])
def test_k_best_equal_enumeration(seed, k):
    log_score, track, used = draw(seed)
    clusters = enumerate_all(log_score, track, used)
    for limits in (SearchLimits(), PRICED):
        found = k_best_global_hypotheses(log_score, track, used, k, limits=limits)
        for ours, (tracks, hypotheses) in zip(found, clusters, strict=True):
            assert ours.optimal
            assert ours.gap == 0.0
            assert ours.track.tolist() == tracks
            expected = [log_weight for log_weight, _ in hypotheses[:k]]
            np.testing.assert_allclose(ours.log_weight, expected, rtol=1e-12, atol=1e-9)
            assert (np.diff(ours.log_weight) <= 1e-9).all()
            assert len(np.unique(ours.leaf, axis=0)) == len(ours.leaf)
            for log_weight, rows in zip(ours.log_weight, ours.leaf, strict=True):
                kept = rows[rows >= 0]
                assert compatible(used, kept)
                assert track[kept].tolist() == ours.track[rows >= 0].tolist()
                dropped = LOG_VANISHING * (rows < 0).sum()
                assert log_weight == pytest.approx(log_score[kept].sum() + dropped, abs=1e-9)


@pytest.mark.parametrize("seed", range(60))
def test_a_narrow_beam_drops_no_track_of_a_feasible_cluster(seed):
    log_score, track, used = draw(seed)
    clusters = enumerate_all(log_score, track, used)
    found = k_best_global_hypotheses(log_score, track, used, 4, limits=NARROW)
    for ours, (_, hypotheses) in zip(found, clusters, strict=True):
        feasible = None not in hypotheses[0][1]
        assert feasible == (ours.leaf >= 0).all()
        expected = [log_weight for log_weight, _ in hypotheses[:4]]
        if ours.optimal:
            np.testing.assert_allclose(ours.log_weight, expected, rtol=1e-12, atol=1e-9)
        elif len(ours.log_weight) == 4:
            missed = expected[-1] - ours.log_weight[-1]
            assert missed <= ours.gap + 1e-6
        else:
            assert ours.gap == np.inf


@pytest.mark.parametrize("seed", range(10))
def test_where_beams_find_nothing_integer_programming_finds_one(seed, monkeypatch):
    def lost(stages, k, width, budget, closing=None):
        none = np.zeros(0, dtype=np.int64)
        options = np.zeros((0, stages.n_steps), dtype=np.int64)
        return Found(none, np.zeros(0), options, np.zeros(len(stages.clusters)))

    log_score, track, used = draw(seed)
    clusters = enumerate_all(log_score, track, used)
    monkeypatch.setattr(best, "search", lost)
    found = best_global_hypothesis(log_score, track, used)
    assert found.optimal.all()
    expected = sum(hypotheses[0][0] for _, hypotheses in clusters)
    assert found.log_weight == pytest.approx(expected, rel=1e-9, abs=1e-6)
    for ours, (_, hypotheses) in zip(
        k_best_global_hypotheses(log_score, track, used, 2), clusters, strict=True
    ):
        assert ours.log_weight == pytest.approx([hypotheses[0][0]], rel=1e-9, abs=1e-6)
        assert not ours.optimal
        assert ours.gap == np.inf


def test_k_best_of_a_dense_cluster_agree_for_both_widths():
    leaves = dense(3, n_tracks=5, most_leaves=20)
    wide = k_best_global_hypotheses(*leaves, 50, limits=SearchLimits(first_width=10**6))
    usual = k_best_global_hypotheses(*leaves, 50)
    for a, b in zip(wide, usual, strict=True):
        assert a.optimal
        assert b.optimal
        np.testing.assert_allclose(a.log_weight, b.log_weight, atol=1e-9)
        np.testing.assert_array_equal(a.leaf, b.leaf)


@pytest.mark.parametrize("seed", range(20))
def test_order_and_numbers_do_not_matter(seed):
    random = np.random.default_rng(seed)
    log_score, track, used = draw(seed) if seed % 2 else dense(seed)
    order = random.permutation(len(log_score))
    new_ids = random.permutation(1000)
    scans = random.permutation(used.shape[1])
    numbers = random.choice(10**12, int(used.max(initial=0)) + 1, replace=False)
    renamed = np.where(used >= 0, numbers[used], -1)[order][:, scans]
    found = best_global_hypothesis(log_score, track, used)
    again = best_global_hypothesis(log_score[order], new_ids[track[order]], renamed)
    np.testing.assert_array_equal(again.chosen, found.chosen[order])
    assert again.log_weight == pytest.approx(found.log_weight, rel=1e-12)


def test_repeated_calls_are_equal_bit_for_bit():
    leaves = dense(1, n_tracks=9, most_leaves=40)
    for limits in ENGINE_LIMITS:
        first, second = (best_global_hypothesis(*leaves, limits=limits) for _ in range(2))
        np.testing.assert_array_equal(first.leaf, second.leaf)
        assert first.log_weight == second.log_weight
        assert first.engine == second.engine


def test_a_long_chain_needs_no_wide_beam():
    """Neighbours compete, so that hundreds of detections are contested but few are open."""
    leaves = chain_leaves(np.random.default_rng(5), 60)
    found = best_global_hypothesis(*leaves)
    check_consistent(found, *leaves)
    assert found.optimal.tolist() == [True]
    packed = best_global_hypothesis(*leaves, limits=NARROW)
    assert packed.log_weight == pytest.approx(found.log_weight, abs=1e-6)


def test_huge_spreads_of_scores():
    log_score = np.array([0.0, -2000.0, 0.0, -1999.0])
    found = best_global_hypothesis(log_score, [1, 1, 2, 2], [[5], [-1], [5], [-1]])
    assert found.log_weight == -1999.0
    assert found.leaf.tolist() == [0, 3]


def test_dropping_is_the_last_resort_and_may_be_forbidden():
    leaves = [1.0, 2.0, 9.0], [1, 2, 3], [[5], [5], [6]]
    found = best_global_hypothesis(*leaves)
    assert found.dropped.tolist() == [1]
    assert found.leaf.tolist() == [-1, 1, 2]
    assert best_global_hypothesis(*leaves, log_dropped=[0.0, -9.0, 0.0]).dropped.tolist() == [1]
    assert best_global_hypothesis(*leaves, log_dropped=[-9.0, 3.0, 50.0]).dropped.tolist() == [2]
    assert best_global_hypothesis(*leaves, log_dropped=[-np.inf, -9.0, 0]).dropped.tolist() == [2]
    with pytest.raises(NoFeasibleHypothesis, match="1 clusters"):
        best_global_hypothesis(*leaves, log_dropped=-np.inf)
    alone = best_global_hypothesis([-np.inf, 1.0], [1, 2], [[-1], [-1]], log_dropped=-3.0)
    assert alone.dropped.tolist() == [1]
    assert alone.log_weight == -2.0
    with pytest.raises(NoFeasibleHypothesis, match="track 1"):
        best_global_hypothesis([-np.inf, 1.0], [1, 2], [[-1], [-1]], log_dropped=-np.inf)


def test_no_leaves():
    found = best_global_hypothesis([], [], np.zeros((0, 8), dtype=int))
    assert found.log_weight == 0.0
    assert found.engine == ()
    assert k_best_global_hypotheses([], [], np.zeros((0, 8), dtype=int), 3) == ()


def test_leaves_without_a_window_are_independent():
    found = best_global_hypothesis([1.0, 2.0, 3.0], [4, 4, 2], np.zeros((3, 0), dtype=int))
    assert found.leaf.tolist() == [2, 1]
    assert found.engine == ("independent", "independent")


def test_clusters_are_numbered_by_their_first_track():
    for seed in range(30):
        log_score, track, used = draw(seed)
        found = best_global_hypothesis(log_score, track, used)
        clusters = [found.track[found.cluster == c].tolist() for c in range(len(found.engine))]
        assert clusters == clusters_by_search(track, used)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"log_score": [[1.0, 2.0]]}, "log_score has shape"),
        ({"log_score": [1.0, np.nan]}, "log_score holds nan"),
        ({"log_score": [1.0, np.inf]}, "log_score holds inf"),
        ({"log_score": [1.0, -2e9]}, "log_score holds -2000000000.0"),
        ({"track": [1]}, "track has shape"),
        ({"track": [1.0, 2.0]}, "track has type float64"),
        ({"used": [1, 2]}, "used has shape"),
        ({"used": [[1], [-2]]}, "used holds -2"),
        ({"used": [[0.5], [1.0]]}, "used has type float64"),
        ({"log_dropped": [1.0, 2.0, 3.0]}, "log_dropped has shape"),
        ({"log_dropped": np.nan}, "log_dropped holds nan"),
    ],
)
def test_wrong_arguments_are_named(changes, message):
    arguments = {"log_score": [1.0, 2.0], "track": [1, 2], "used": [[1], [1]]} | changes
    with pytest.raises(AssociationInputError, match=message):
        best_global_hypothesis(**arguments)
    with pytest.raises(AssociationInputError, match=message):
        k_best_global_hypotheses(k=2, **arguments)


def test_k_and_limits_are_checked():
    with pytest.raises(AssociationInputError, match="k = 0"):
        k_best_global_hypotheses([1.0], [1], [[-1]], 0)
    with pytest.raises(ValueError, match="width = 0"):
        SearchLimits(width=0)
    with pytest.raises(ValueError, match="nodes = -1"):
        SearchLimits(nodes=-1)


@pytest.mark.parametrize("module", [global_hypotheses, leaf_pruning])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
