from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gda_tracker.association.cluster_marginals import EngineLimits, cluster_marginals
from gda_tracker.association.clustering import find_clusters
from gda_tracker.association.errors import AssociationInputError
from gda_tracker.association.generalised import (
    attribute_probability,
    attribute_weights,
    joint_weights,
    kinematic_weights,
    most_pairs,
)

examples = settings(derandomize=True, deadline=None, max_examples=50)

LIMITS = EngineLimits()
gates = st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(0, 2**32))


def pairs_of(gate):
    return tuple(index.astype(np.int32) for index in np.nonzero(gate))


def attribute_term(distance, missed, informative=None, limits=LIMITS):
    """P_a (H, n), NaN outside the gate, of distances (H, n) that are NaN outside the gate."""
    distance = np.asarray(distance, dtype=np.float64)
    h, n = distance.shape
    hypothesis, detection = pairs_of(~np.isnan(distance))
    clusters = find_clusters(hypothesis, detection, h, n)
    known = np.ones(n, dtype=bool) if informative is None else np.asarray(informative, dtype=bool)
    weights = attribute_weights(
        clusters, distance[hypothesis, detection], known[detection], missed, h, n
    )
    found = cluster_marginals(clusters, [weights], limits)
    p_a = np.full((h, n), np.nan)
    p_a[hypothesis, detection] = attribute_probability(
        clusters, found.marginals[0], known[detection]
    )
    return p_a


# Two tracks, two observations: tables 14.2 and 14.3.
DISTANCE = np.array([[0.2, 0.7], [0.5, 0.3]])


def test_table_14_3_as_printed():
    d = DISTANCE
    alone = d.sum()  # H_2 to H_5
    both, crossed = d[0, 0] * d[1, 1], d[0, 1] * d[1, 0]  # H_6, H_7; H_1 has weight 0
    total = alone + both + crossed
    expected = np.array([[d[0, 0] + both, d[0, 1] + crossed], [d[1, 0] + crossed, d[1, 1] + both]])
    np.testing.assert_allclose(
        attribute_term(d, "table_14_3"), 1.0 - expected / total, rtol=0, atol=1e-14
    )


def test_partial_hypotheses_weigh_nothing_beside_fuller_ones():
    both, crossed = 0.2 * 0.3, 0.7 * 0.5
    straight = both / (both + crossed)
    expected = 1.0 - np.array([[straight, 1.0 - straight], [1.0 - straight, straight]])
    np.testing.assert_allclose(attribute_term(DISTANCE, "zero"), expected, rtol=0, atol=1e-14)


def test_a_track_is_missed_where_no_hypothesis_is_fuller():
    # Three tracks, but two of them see detection 0 only: at most two pairs, and every hypothesis
    # with two pairs counts.
    d = np.array([[0.1, 0.2, 0.4], [0.3, np.nan, np.nan], [0.6, np.nan, np.nan]])
    weights = {(1, 1): 0.3 * 0.2, (1, 2): 0.3 * 0.4, (2, 1): 0.6 * 0.2, (2, 2): 0.6 * 0.4}
    total = sum(weights.values())
    expected = np.array(
        [
            [0.0, weights[1, 1] + weights[2, 1], weights[1, 2] + weights[2, 2]],
            [weights[1, 1] + weights[1, 2], np.nan, np.nan],
            [weights[2, 1] + weights[2, 2], np.nan, np.nan],
        ]
    )
    np.testing.assert_allclose(attribute_term(d, "zero"), 1.0 - expected / total, atol=1e-14)


@examples
@given(gates, st.sampled_from(["zero", "table_14_3"]), st.booleans())
def test_equals_brute_force(brute_force, drawn, missed, with_zeros):
    h, n, seed = drawn
    rng = np.random.default_rng(seed)
    d = rng.uniform(0.01, 1.4, (h, n))
    if with_zeros:
        d[rng.random((h, n)) < 0.3] = 0.0
    gate = rng.random((h, n)) < 0.6
    gate[0] = True  # one cluster, with every detection in it
    gate[:, 0] = True
    assume(gate.sum() > 1)
    with np.errstate(divide="ignore"):
        log_d = np.where(gate, np.log(d), -np.inf)
    on_gate = np.where(gate, 0.0, -np.inf)
    idle = np.zeros(h), np.zeros(n)
    fullest = brute_force(on_gate, *idle).most_pairs
    least = fullest if missed == "zero" else 1
    expected = brute_force(log_d, *idle, least_assigned=least)
    if not expected.feasible and missed == "zero":
        expected = brute_force(on_gate, *idle, least_assigned=least)
    found = attribute_term(np.where(gate, d, np.nan), missed)
    np.testing.assert_allclose(found[gate], 1.0 - expected.marginals[gate], rtol=0, atol=1e-12)


def test_all_fullest_hypotheses_of_weight_zero_count_the_same():
    # Detection 0 fits both tracks with distance 0: every full hypothesis has a factor 0.
    d = np.array([[0.0, 0.4], [0.0, 0.9]])
    np.testing.assert_allclose(attribute_term(d, "zero"), 0.5)


def test_table_14_3_without_any_weight_is_neutral():
    assert (attribute_term(np.zeros((2, 2)), "table_14_3") == 1.0).all()


@pytest.mark.parametrize("missed", ["zero", "table_14_3"])
@pytest.mark.parametrize("distance", [0.0, 0.3, 1.4])
def test_a_single_pair_carries_no_information(missed, distance):
    assert attribute_term([[distance]], missed)[0, 0] == 1.0


@pytest.mark.parametrize("missed", ["zero", "table_14_3"])
def test_tiny_distances_keep_their_ratio(missed):
    # Z - 1 by subtraction would lose all digits here.
    d = 1e-17 * np.array([[1.0, 3.0]])
    np.testing.assert_allclose(attribute_term(d, missed), [[0.75, 0.25]], rtol=1e-12)


class TestUnknownAttribute:
    """A detection without RCS neither attracts nor repels."""

    @pytest.mark.parametrize("missed", ["zero", "table_14_3"])
    def test_nothing_known_leaves_the_kinematics_alone(self, missed):
        p_a = attribute_term(np.zeros((2, 3)), missed, informative=[False] * 3)
        assert (p_a == 1.0).all()

    @pytest.mark.parametrize("missed", ["zero", "table_14_3"])
    @pytest.mark.parametrize("distance", [0.01, 0.9])
    def test_one_track_weighs_unknown_and_known_alike(self, missed, distance):
        # However well or badly the known detection fits, the unknown one is at no advantage. Its
        # own distance, 0, would give it P_a = 1 and the known one 0.
        p_a = attribute_term([[distance, 0.0]], missed, informative=[True, False])
        assert p_a[0, 0] == pytest.approx(p_a[0, 1], rel=1e-14)

    @pytest.mark.parametrize("missed", ["zero", "table_14_3"])
    def test_tracks_that_differ_in_nothing_known_share_it_alike(self, missed):
        p_a = attribute_term([[0.3, 0.0], [0.3, 0.0]], missed, informative=[True, False])
        np.testing.assert_allclose(p_a, p_a[0, 0], rtol=1e-14)

    def test_it_goes_to_the_track_that_the_known_detection_leaves(self):
        # The known detection fits track 0; the unknown one has no preference of its own.
        p_a = attribute_term([[0.1, 0.0], [0.9, 0.0]], "zero", informative=[True, False])
        np.testing.assert_allclose(p_a, [[0.9, 0.1], [0.1, 0.9]], rtol=1e-14)

    def test_takes_the_mean_of_the_known_pairs_of_its_own_cluster(self):
        far = np.nan
        d = np.array([[0.2, 0.6, 0.0, far], [far, far, far, 1.3]])
        p_a = attribute_term(d, "zero", informative=[True, True, False, True])
        np.testing.assert_allclose(p_a[0, :3], 1.0 - np.array([0.2, 0.6, 0.4]) / 1.2, rtol=1e-14)
        assert p_a[1, 3] == 1.0

    def test_other_clusters_are_untouched(self):
        far = np.nan
        d = np.array([[0.2, 0.6, far, far], [far, far, 0.0, 0.0]])
        p_a = attribute_term(d, "zero", informative=[True, True, False, False])
        np.testing.assert_allclose(p_a[0, :2], [0.75, 0.25], rtol=1e-14)
        assert (p_a[1, 2:] == 1.0).all()


@examples
@given(gates)
def test_most_pairs_is_the_largest_matching(brute_force, drawn):
    h, n, seed = drawn
    gate = np.random.default_rng(seed).random((h, n)) < 0.4
    clusters = find_clusters(*pairs_of(gate), h, n)
    for cluster, found in enumerate(most_pairs(clusters)):
        mine = np.zeros((h, n), dtype=bool)
        hypothesis, detection = pairs_of(gate)
        inside = clusters.pair_cluster == cluster
        mine[hypothesis[inside], detection[inside]] = True
        everything = brute_force(np.where(mine, 0.0, -np.inf), np.zeros(h), np.zeros(n))
        assert found == everything.most_pairs


def test_unknown_reading_is_refused():
    clusters = find_clusters(*pairs_of(np.ones((1, 1))), 1, 1)
    with pytest.raises(AssociationInputError, match="zero, table_14_3"):
        attribute_weights(clusters, np.ones(1), np.ones(1, dtype=bool), "ignore", 1, 1)


@pytest.mark.parametrize(
    ("detection_probability", "clutter_density"), [(1.0, 1e-6), (0.9, 0.0), (1.0, 0.0)]
)
def test_impossible_scans_are_the_limit_of_improbable_ones(detection_probability, clutter_density):
    # Two tracks and one detection, then one track and two detections: with P_d = 1 or beta = 0 no
    # joint hypothesis has weight.
    gate = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 1]])
    hypothesis, detection = pairs_of(gate)
    log_g = np.array([-9.0, -10.0, -8.0, -8.5])
    clusters = find_clusters(hypothesis, detection, 3, 3)

    def p_k(p_d, beta):
        weights = kinematic_weights(hypothesis, log_g, np.full(3, p_d), beta, 3)
        return cluster_marginals(clusters, [weights], LIMITS).marginals[0]

    tiny = 1e-13
    np.testing.assert_allclose(
        p_k(detection_probability, clutter_density),
        p_k(min(detection_probability, 1.0 - tiny), max(clutter_density, tiny * 1e-4)),
        rtol=0,
        atol=1e-6,
    )


@examples
@given(gates, st.floats(-30.0, 30.0))
def test_the_unit_of_the_attribute_does_not_matter(drawn, log_unit):
    h, n, seed = drawn
    rng = np.random.default_rng(seed)
    gate = rng.random((h, n)) < 0.7
    assume(gate.any())
    hypothesis, detection = pairs_of(gate)
    clusters = find_clusters(hypothesis, detection, h, n)
    kinematic = kinematic_weights(
        hypothesis, rng.normal(-9, 2, len(hypothesis)), np.full(h, 0.9), 1e-5, n
    )
    log_l, clutter = rng.normal(size=len(hypothesis)), rng.normal(size=n)
    # A detection's likelihoods all carry the unit of its attribute, the clutter's too.
    unit = log_unit * rng.random(n)
    here, there = (
        cluster_marginals(clusters, [joint_weights(kinematic, *arguments)], LIMITS).marginals
        for arguments in ((log_l, clutter), (log_l + unit[detection], clutter + unit))
    )
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-11)


def test_several_weightings_at_once_equal_one_by_one():
    rng = np.random.default_rng(5)
    gate = rng.random((20, 25)) < 0.03
    hypothesis, detection = pairs_of(gate)
    p = len(hypothesis)
    clusters = find_clusters(hypothesis, detection, 20, 25)
    assert len(clusters) > 3
    kinematic = kinematic_weights(hypothesis, rng.normal(-9, 2, p), np.full(20, 0.9), 1e-5, 25)
    joint = joint_weights(kinematic, rng.normal(size=p), rng.normal(size=25))
    attribute = attribute_weights(
        clusters, rng.uniform(0, 1, p), np.ones(p, dtype=bool), "zero", 20, 25
    )
    layers = [kinematic, joint, attribute]
    together = cluster_marginals(clusters, layers, LIMITS).marginals
    for layer, marginals in zip(layers, together, strict=True):
        alone = cluster_marginals(clusters, [layer], LIMITS).marginals[0]
        np.testing.assert_allclose(alone, marginals, rtol=0, atol=1e-14)


@pytest.mark.parametrize("missed", ["zero", "table_14_3"])
def test_loopy_attribute_term_is_close_to_the_exact_one(missed):
    rng = np.random.default_rng(6)
    d = np.full((7, 8), np.nan)
    for i in range(7):
        d[i, i : i + 2] = rng.uniform(0.1, 1.0, 2)
    approximate = attribute_term(d, missed, limits=EngineLimits(max_exact_size=1, iterations=2000))
    np.testing.assert_allclose(approximate, attribute_term(d, missed), rtol=0, atol=1e-3)
