from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from associate_examples import FAR, TERMS, assert_consistent, associate, examples, random_stage
from hypothesis import assume, given
from hypothesis import strategies as st

from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.association.choices import (
    DECISIONS,
    ENGINES,
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.joint import joint_marginals


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize("attribute_term", TERMS)
@examples
@given(st.integers(0, 2**32))
def test_answers_are_consistent(make_stage_input, decision, attribute_term, seed):
    log_g, stage = random_stage(
        make_stage_input, seed, decision=decision, attribute_term=attribute_term
    )
    assert_consistent(associate(*stage), *log_g.shape)


@examples
@given(st.integers(0, 2**32))
def test_p_k_and_joint_marginal_are_those_of_the_whole_scan(make_stage_input, seed):
    # Clusters are independent: the marginals of the undivided scan are the same.
    p_d, beta = 0.9, 1e-5
    log_g, stage = random_stage(
        make_stage_input,
        seed,
        attribute_term="dsm_classic",
        detection_probability=p_d,
        clutter_density=beta,
    )
    _, _, scores, pairs = stage
    h, n = log_g.shape
    found = associate(*stage)
    idle_track = np.full(h, np.log(1 - p_d))
    place = pairs.hypothesis, pairs.detection
    whole = joint_marginals(np.log(p_d) + log_g, idle_track, np.full(n, np.log(beta)))
    np.testing.assert_allclose(found.p_kinematic, whole[place], rtol=0, atol=1e-12)
    log_l = np.zeros((h, n))
    log_l[place] = scores.log_likelihood
    whole = joint_marginals(
        np.log(p_d) + log_g + log_l, idle_track, np.log(beta) + scores.clutter_log_likelihood
    )
    np.testing.assert_allclose(found.joint_marginal, whole[place], rtol=0, atol=1e-12)


class TestTerms:
    log_g = np.array([[-8.0, -8.2], [-8.1, -8.3]])
    distance = np.array([[0.9, 0.2], [0.1, 0.8]])
    log_l = np.array([[-3.0, 0.0], [0.0, -3.0]])

    def test_gda_with_distance(self, make_stage_input):
        found = associate(
            *make_stage_input(self.log_g, attribute_term="dsm_classic", distance=self.distance)
        )
        straight = 0.9 * 0.8 / (0.9 * 0.8 + 0.2 * 0.1)
        np.testing.assert_allclose(
            found.p_attribute, [1 - straight, straight, straight, 1 - straight], rtol=1e-12
        )
        assert found.assigned_detection.tolist() == [1, 0]
        assert found.attribute_term == "dsm_classic"
        assert not found.degraded
        # Without a likelihood the joint marginal is that of the kinematics.
        np.testing.assert_array_equal(found.joint_marginal, found.p_kinematic)

    def test_reading_of_missed_tracks_comes_from_the_settings(self, make_stage_input):
        by_reading = [
            associate(
                *make_stage_input(
                    self.log_g,
                    attribute_term="dsm_classic",
                    distance=self.distance,
                    missed_track_hypotheses=reading,
                )
            ).p_attribute
            for reading in ("zero", "table_14_3")
        ]
        assert np.abs(by_reading[0] - by_reading[1]).min() > 0.01

    def test_gda_with_none(self, make_stage_input):
        found = associate(*make_stage_input(self.log_g))
        assert (found.p_attribute == 1.0).all()
        np.testing.assert_array_equal(found.p_generalised, found.p_kinematic)
        assert found.assigned_detection.tolist() == [0, 1]

    def test_gda_serves_as_many_tracks_as_the_gates_allow(self, make_stage_input):
        # Infinite cost outside the gate: improbable pairs are taken before a track is left without.
        # one.
        log_g = [[-5.0, -14.0], [-14.0, FAR]]
        assert associate(*make_stage_input(log_g)).assigned_detection.tolist() == [1, 0]
        by_weight = associate(*make_stage_input(log_g, decision="map"))
        assert by_weight.assigned_detection.tolist() == [0, -1]

    def test_gda_with_bayes_takes_p_k_of_the_joint_likelihood(self, make_stage_input):
        found = associate(
            *make_stage_input(
                self.log_g, attribute_term="bayes", attribute_log_likelihood=self.log_l
            )
        )
        np.testing.assert_array_equal(found.p_kinematic, found.joint_marginal)
        assert (found.p_attribute == 1.0).all()
        assert found.assigned_detection.tolist() == [1, 0]
        np.testing.assert_array_equal(found.attribute_log_likelihood, self.log_l.ravel())

    @pytest.mark.parametrize("attribute_term", ["bayes", "dsm_classic"])
    def test_map_takes_the_likelihood_of_any_term(self, make_stage_input, attribute_term):
        found = associate(
            *make_stage_input(
                self.log_g,
                decision="map",
                attribute_term=attribute_term,
                distance=self.distance.T,  # speaks against the likelihood, and is not asked
                attribute_log_likelihood=self.log_l,
            )
        )
        assert found.assigned_detection.tolist() == [1, 0]
        assert (found.p_attribute == 1.0).all()
        assert (found.joint_marginal != found.p_kinematic).all()

    def test_map_leaves_to_clutter_what_clutter_explains(self, make_stage_input):
        found = associate(
            *make_stage_input(
                [[-9.0]],
                decision="map",
                attribute_term="bayes",
                attribute_log_likelihood=[[-7.0]],
                clutter_log_likelihood=[1.0],
            )
        )
        assert found.assigned_detection.tolist() == [-1]
        kinematic = associate(*make_stage_input([[-9.0]], decision="map"))
        assert kinematic.assigned_detection.tolist() == [0]


@examples
@given(st.integers(0, 2**32), st.sampled_from(TERMS))
def test_map_is_the_best_joint_hypothesis(make_stage_input, brute_force, seed, attribute_term):
    p_d, beta = 0.8, 3e-5
    log_g, stage = random_stage(
        make_stage_input,
        seed,
        decision="map",
        attribute_term=attribute_term,
        detection_probability=p_d,
        clutter_density=beta,
    )
    _, _, scores, pairs = stage
    h, n = log_g.shape
    assume(h * n <= 16)  # enumeration takes long
    log_l = np.zeros((h, n))
    log_l[pairs.hypothesis, pairs.detection] = scores.log_likelihood
    expected = brute_force(
        np.log(p_d) + log_g + log_l,
        np.full(h, np.log(1 - p_d)),
        np.log(beta) + scores.clutter_log_likelihood,
    )
    assigned = tuple(associate(*stage).assigned_detection.tolist())
    weight = expected.log_weights[expected.hypotheses.index(assigned)]
    assert weight == pytest.approx(expected.best, abs=1e-9)


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize("attribute_term", TERMS)
@examples
@given(st.integers(0, 2**32))
def test_the_order_of_hypotheses_and_detections_does_not_matter(
    make_stage_input, decision, attribute_term, seed
):
    rng = np.random.default_rng(seed)
    h, n = rng.integers(1, 6, 2)
    log_g = np.where(rng.random((h, n)) < 0.6, rng.normal(-9.0, 1.5, (h, n)), FAR)
    distance, log_l = rng.uniform(0.05, 1.2, (h, n)), rng.normal(size=(h, n))
    clutter, informative = rng.normal(size=n), rng.random(n) < 0.7
    if attribute_term == "none":
        log_l, clutter = 0.0 * log_l, 0.0 * clutter
    rows, columns = rng.permutation(h), rng.permutation(n)

    def answer(rows, columns):
        found = associate(
            *make_stage_input(
                log_g[np.ix_(rows, columns)],
                decision=decision,
                attribute_term=attribute_term,
                distance=distance[np.ix_(rows, columns)],
                attribute_log_likelihood=log_l[np.ix_(rows, columns)],
                clutter_log_likelihood=clutter[columns],
                informative=informative[columns],
            )
        )
        place = rows[found.hypothesis], columns[found.detection]
        matrices = np.full((3, h, n), np.nan)
        for matrix, values in zip(
            matrices, (found.p_generalised, found.joint_marginal, found.chosen), strict=True
        ):
            matrix[place] = values
        return matrices

    straight, permuted = answer(np.arange(h), np.arange(n)), answer(rows, columns)
    np.testing.assert_allclose(permuted[:2], straight[:2], rtol=0, atol=1e-12)
    # Two assignments may have the same sum of P_gen, e.g. where a P_a is 0; then either is right.
    total = np.nansum(straight[0] * straight[2]), np.nansum(permuted[0] * permuted[2])
    if decision == "gda":
        assert total[0] == pytest.approx(total[1], abs=1e-12)
    else:
        np.testing.assert_array_equal(permuted[2], straight[2])


@examples
@given(st.integers(0, 2**32), st.sampled_from(DECISIONS), st.floats(-20.0, 20.0))
def test_the_unit_of_rcs_changes_nothing(make_stage_input, seed, decision, log_unit):
    log_g, stage = random_stage(make_stage_input, seed, decision=decision, attribute_term="bayes")
    scan, predictions, scores, pairs = stage
    other = dataclasses.replace(
        scores,
        log_likelihood=scores.log_likelihood + log_unit,
        clutter_log_likelihood=scores.clutter_log_likelihood + log_unit,
    )
    found, again = associate(*stage), associate(scan, predictions, other, pairs)
    np.testing.assert_allclose(again.p_generalised, found.p_generalised, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(again.assigned_detection, found.assigned_detection)


@pytest.mark.parametrize("attribute_term", ["dsm_classic", "bayes"])
@pytest.mark.parametrize("decision", DECISIONS)
def test_unknown_rcs_leaves_the_decision_to_the_kinematics(
    make_stage_input, decision, attribute_term
):
    rng = np.random.default_rng(1)
    for _ in range(20):
        log_g = rng.normal(-9.0, 1.5, (3, 4))
        unknown = {"attribute_term": attribute_term, "informative": [False] * 4}
        found = associate(*make_stage_input(log_g, decision=decision, **unknown))
        alone = associate(*make_stage_input(log_g, decision=decision))
        np.testing.assert_array_equal(found.assigned_detection, alone.assigned_detection)
        np.testing.assert_array_equal(found.p_generalised, alone.p_generalised)


@pytest.mark.parametrize("distance", [0.02, 0.5, 1.2])
def test_one_unknown_rcs_neither_attracts_nor_repels(make_stage_input, distance):
    # One track, one detection with and one without RCS. However the known one fits, the nearer one
    # is taken, as without any attribute.
    for log_g in ([[-8.0, -8.1]], [[-8.1, -8.0]]):
        alone = associate(*make_stage_input(log_g))
        found = associate(
            *make_stage_input(
                log_g,
                attribute_term="dsm_classic",
                distance=[[distance, 0.0]],
                informative=[True, False],
            )
        )
        np.testing.assert_array_equal(found.assigned_detection, alone.assigned_detection)
        ratio = found.p_generalised / alone.p_generalised
        assert ratio[0] == pytest.approx(ratio[1], rel=1e-12)


def test_without_scores_the_answer_is_degraded_and_kinematic(make_stage_input):
    log_g = [[-8.0, -9.0], [-8.5, -8.2]]
    for decision in DECISIONS:
        scan, predictions, _, pairs = make_stage_input(
            log_g, decision=decision, attribute_term="dsm_classic", distance=np.eye(2)
        )
        found = associate(scan, predictions, None, pairs)
        alone = associate(*make_stage_input(log_g, decision=decision))
        assert found.degraded
        assert found.attribute_term == "none"
        assert (found.attribute_log_likelihood == 0.0).all()
        np.testing.assert_array_equal(found.p_generalised, alone.p_generalised)
        np.testing.assert_array_equal(found.assigned_detection, alone.assigned_detection)


def test_detection_probability_is_per_hypothesis(make_stage_input):
    found = associate(
        *make_stage_input([[-9.0], [-9.0]], detection_probability=[0.95, 0.2], decision="map")
    )
    assert found.p_kinematic[0] > 10 * found.p_kinematic[1]
    assert found.assigned_detection.tolist() == [0, -1]
    never = associate(*make_stage_input([[-9.0], [-9.0]], detection_probability=[0.5, 0.0]))
    assert never.p_kinematic[1] == 0.0


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize(
    ("detection_probability", "clutter_density"), [(1.0, 0.0), (1.0, 1e-6), (0.9, 0.0)]
)
def test_certain_detection_and_no_clutter_have_an_answer(
    make_stage_input, decision, detection_probability, clutter_density
):
    rng = np.random.default_rng(3)
    for h, n in ((1, 1), (1, 3), (3, 1), (2, 4), (4, 2), (3, 3)):
        log_g = rng.normal(-9.0, 1.0, (h, n))
        found = associate(
            *make_stage_input(
                log_g,
                decision=decision,
                detection_probability=detection_probability,
                clutter_density=clutter_density,
            )
        )
        assert_consistent(found, h, n)
        # Under mht the track manager chooses.
        assert found.chosen.sum() == (0 if decision == "mht" else min(h, n))


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (2, 0), (2, 3)])
def test_nothing_gated(make_stage_input, decision, shape):
    stage = make_stage_input(np.full(shape, FAR), decision=decision, attribute_term="dsm_classic")
    for scores in (stage[2], None):
        found = associate(stage[0], stage[1], scores, stage[3])
        assert_consistent(found, *shape)
        assert (found.assigned_detection == -1).all()
        assert len(found.cluster_engine) == len(found.cluster_converged) == 0


def big_stage(make_stage_input, **settings):
    """Chain of 14 tracks, one cluster, beside a pair of its own."""
    log_g = np.full((15, 16), FAR)
    rng = np.random.default_rng(2)
    for i in range(14):
        log_g[i, i : i + 2] = rng.normal(-9.0, 1.0, 2)
    log_g[14, 15] = -9.0
    return make_stage_input(log_g, **settings)


@pytest.mark.parametrize("attribute_term", TERMS)
def test_large_clusters_say_which_engine_answered(make_stage_input, attribute_term):
    rng = np.random.default_rng(4)
    stage = big_stage(
        make_stage_input,
        attribute_term=attribute_term,
        distance=rng.uniform(0.1, 1.0, (15, 16)),
        attribute_log_likelihood=0.1 * rng.normal(size=(15, 16)),
    )
    approximate = Associator(AssociationParameters(max_exact_size=1))(*stage)
    exact = associate(*stage)
    for found, engine in (
        (approximate, LOOPY_BELIEF_PROPAGATION),
        (exact, FRONTIER_DYNAMIC_PROGRAMMING),
    ):
        names = [found.engine_names[index] for index in found.cluster_engine]
        assert names == [engine, SUBSET_DYNAMIC_PROGRAMMING]
        assert found.cluster_converged.all()
    # The chain has no cycle: loopy belief propagation is exact there.
    np.testing.assert_allclose(approximate.p_generalised, exact.p_generalised, rtol=0, atol=1e-3)
    np.testing.assert_array_equal(approximate.assigned_detection, exact.assigned_detection)


def test_an_engine_that_does_not_settle_says_so(make_stage_input):
    stage = big_stage(make_stage_input)
    parameters = AssociationParameters(max_exact_size=1, belief_propagation_iterations=1)
    found = Associator(parameters)(*stage)
    assert found.cluster_converged.tolist() == [False, True]


def test_max_exact_size_of_one_is_obeyed(make_stage_input):
    log_g = np.full((3, 3), FAR)
    log_g[:2, :2], log_g[2, 2] = -9.0, -9.0
    found = Associator(AssociationParameters(max_exact_size=1))(*make_stage_input(log_g))
    assert found.cluster_engine.tolist() == [
        ENGINES.index(LOOPY_BELIEF_PROPAGATION),
        ENGINES.index(SUBSET_DYNAMIC_PROGRAMMING),
    ]
