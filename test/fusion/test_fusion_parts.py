"""Motion, fusion rules, class beliefs, ids and association: worked values, properties, others."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association.xmap.problem import read_problem
from gda_tracker.association.xmap.solution import solve
from gda_tracker.fusion.association import associate, changes_of_company, combined_biases
from gda_tracker.fusion.biases import Biases, absorb, bias_unknowns, biases_of, forget, votes
from gda_tracker.fusion.class_beliefs import (
    class_likelihoods,
    class_probabilities,
    common_classes,
)
from gda_tracker.fusion.combination import covariance_intersection, fuse_independent
from gda_tracker.fusion.identities import continue_identities
from gda_tracker.fusion.motion import (
    new_information,
    predict,
    predict_information,
    scan_noise_covariance,
    tracker_noise_covariance,
    transition,
    white_noise_covariance,
)
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.fusion.snapshot import Snapshot
from gda_tracker.parameters import ParameterError, from_mapping

SEEDS = st.integers(0, 10_000)


def covariances(rng, *shape, size=4):
    root = rng.standard_normal((*shape, size, size + 2)) * [[30.0], [30.0], [5.0], [5.0]][:size]
    return root @ np.swapaxes(root, -1, -2)


# --- motion


@given(seed=SEEDS)
@settings(max_examples=30, deadline=None)
def test_the_equivalent_measurement_is_what_the_filter_was_given(seed):
    rng = np.random.default_rng(seed)
    prior = covariances(rng, 3)
    mean = rng.standard_normal((3, 4)) * 1e4
    measure = rng.standard_normal((2, 4))
    noise = covariances(rng, size=2)
    z = rng.standard_normal((3, 2)) * 100.0 + mean @ measure.T
    gain = prior @ measure.T @ np.linalg.inv(measure @ prior @ measure.T + noise)
    updated = mean + np.einsum("nij,nj->ni", gain, z - mean @ measure.T)
    left = prior - gain @ measure @ prior
    information, vector, clipped = new_information((mean, prior), (updated, left))
    expected = measure.T @ np.linalg.inv(noise) @ measure
    scale = np.abs(np.linalg.inv(left)).max()
    np.testing.assert_allclose(information, np.tile(expected, (3, 1, 1)), atol=1e-6 * scale)
    wanted = z @ np.linalg.inv(noise) @ measure
    assert np.abs(vector - wanted).max() < 1e-6 * np.abs(wanted).max() + 1e-6 * scale * 1e4
    assert not clipped.any()


def test_what_grew_less_certain_than_its_model_says_tells_nothing():
    mean = np.array([[100.0, 200.0, 3.0, 4.0]])
    prior = np.diag([100.0, 100.0, 1.0, 1.0])[None]
    reported = np.diag([50.0, 200.0, 1.0, 1.0])[None]
    information, vector, clipped = new_information(
        (mean, prior), (mean + [[10, 20, 0, 0]], reported)
    )
    assert clipped.tolist() == [True]
    # Along x 1/50 - 1/100; the measurement is 100 + 10 times 100 / (100 - 50).
    np.testing.assert_allclose(information[0], np.diag([0.01, 0.0, 0.0, 0.0]), atol=1e-15)
    np.testing.assert_allclose(vector[0], [0.01 * 120.0, 0.0, 0.0, 0.0], atol=1e-12)
    same = new_information((mean, prior), (mean, prior))
    assert not same[0].any()
    assert not same[1].any()


@given(seed=SEEDS, dt=st.floats(0.01, 30.0), density=st.sampled_from([0.0, 3.0]))
@settings(max_examples=30, deadline=None)
def test_prediction_of_information_is_that_of_covariances(seed, dt, density):
    rng = np.random.default_rng(seed)
    covariance, mean = covariances(rng, 2), rng.standard_normal((2, 4)) * 100.0
    inverse = np.linalg.inv(covariance)
    step = np.full(2, dt)
    expected = predict(mean, covariance, step, white_noise_covariance(step, density))
    half = predict_information(inverse, np.einsum("nij,nj->ni", inverse, mean), dt / 2, density)
    information, vector = predict_information(*half, dt / 2, density)
    found = np.linalg.inv(information)
    np.testing.assert_allclose(found, expected[1], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", found, vector), expected[0], rtol=1e-6, atol=1e-5
    )


def test_a_position_alone_is_predicted_though_its_information_is_singular():
    information = np.diag([0.01, 0.01, 0.0, 0.0])[None]
    vector = np.array([[1.0, 2.0, 0.0, 0.0]])
    predicted, shifted = predict_information(information, vector, 2.0, 0.0)
    # Known is x - 2 vx = 100.
    direction = np.array([1.0, 0.0, -2.0, 0.0])
    np.testing.assert_allclose(predicted[0, 0], 0.01 * direction)
    np.testing.assert_allclose(shifted[0], [1.0, 2.0, -2.0, -4.0])


def test_a_tracker_that_made_several_steps_was_not_pushed_all_the_way_at_once():
    step = transition(np.array([2.0]))[0]
    one = scan_noise_covariance(np.array([2.0]), 3.0)[0]
    np.testing.assert_array_equal(tracker_noise_covariance(2.0, 2.0, 3.0), one)
    several = np.zeros((4, 4))
    for _ in range(6):
        several = step @ several @ step.T + one
    found = tracker_noise_covariance(12.0, 2.0, 3.0)
    np.testing.assert_allclose(found, several, rtol=0.01)
    # In one step it would be six times as much.
    at_once = scan_noise_covariance(np.array([12.0]), 3.0)[0]
    assert at_once[2, 2] == pytest.approx(6.0 * several[2, 2])


# --- fusion rules


def test_two_scalars_like_tracks_by_hand():
    mean = np.array([[[0.0, 0.0, 0.0, 0.0], [10.0, 5.0, 2.0, 1.0]]])
    covariance = np.stack([np.eye(4), 4.0 * np.eye(4)])[None]
    there = np.ones((1, 2), dtype=bool)
    fused, spread = fuse_independent(mean, covariance, there)
    np.testing.assert_allclose(fused[0], [2.0, 1.0, 0.4, 0.2])
    np.testing.assert_allclose(spread[0], 0.8 * np.eye(4))
    for rule in (fuse_independent, covariance_intersection):
        alone = rule(mean, covariance, np.array([[False, True]]))
        np.testing.assert_allclose(alone[0][0], mean[0, 1])
        np.testing.assert_allclose(alone[1][0], 4.0 * np.eye(4))


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_covariance_intersection_is_never_too_sure_and_knows_no_order(seed):
    """Whatever the errors' correlation: P less the true covariance is positive semidefinite."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    joint = covariances(rng, size=4)
    mix = rng.standard_normal((4 * n, 4 * n))
    joint = mix @ np.kron(np.eye(n), joint) @ mix.T
    blocks = joint.reshape(n, 4, n, 4).swapaxes(1, 2)
    own = np.stack([blocks[k, k] for k in range(n)])
    mean, there = rng.standard_normal((1, n, 4)), np.ones((1, n), dtype=bool)
    fused, spread = covariance_intersection(mean, own[None], there)
    shares = np.stack(
        [
            covariance_intersection(np.eye(4)[axis] * (np.arange(n) == k)[None, :, None],
                                    own[None], there)[0][0]
            for k in range(n) for axis in range(4)
        ]
    )  # fmt: skip
    weight = shares.reshape(n, 4, 4).transpose(0, 2, 1)  # error = sum of weight_k error_k
    np.testing.assert_allclose(weight.sum(axis=0), np.eye(4), atol=1e-6)
    true = np.einsum("kij,kljm,lnm->in", weight, blocks, weight)
    assert np.linalg.eigvalsh(spread[0] - true).min() > -1e-8 * np.abs(true).max()
    order = rng.permutation(n)
    again = covariance_intersection(mean[:, order], own[None, order], there)
    np.testing.assert_allclose(again[0], fused, rtol=1e-6, atol=1e-8)


# --- biases


def test_votes_come_of_two_radars_alone_and_can_be_forgotten():
    unknowns = bias_unknowns([0.0, -1.0], 2)
    assert unknowns.reference == -1
    assert bias_unknowns([], 2).reference == 0
    information, vector = np.zeros((2, 6, 6)), np.zeros((2, 6))
    sure = np.tile(np.diag([0.01, 0.04, 1.0, 1.0]), (2, 1, 1))
    seen = np.array([[500.0, 600.0, 1.0, 2.0]] * 2)
    absorb(information, vector, np.arange(2), (sure, seen @ sure[0]), unknowns, 1)
    inner, outer = votes(information, vector)
    np.testing.assert_allclose(inner, 0.0, atol=1e-15)
    np.testing.assert_allclose(outer, 0.0, atol=1e-12)
    shifted = seen[:1] + [300.0, -100.0, 0.0, 0.0]
    absorb(information, vector, np.array([0]), (sure[:1], shifted @ sure[0]), unknowns, 0)
    inner, outer = votes(information, vector)
    # Both know as much: the variance of the difference is twice theirs.
    np.testing.assert_allclose(inner[0], np.diag([0.005, 0.02]))
    found = biases_of(unknowns, unknowns.prior + inner[0], outer[0])
    np.testing.assert_allclose(found.mean, [[0.0, 0.0], [300.0, -100.0]], rtol=1e-6)
    less = votes(*forget(information, vector, 0.25))
    np.testing.assert_allclose(less[0], 0.25 * inner, atol=1e-15)
    np.testing.assert_allclose(less[1], 0.25 * outer, atol=1e-12)


def test_a_prior_of_several_parts_counts_once():
    prior = Biases(np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([np.zeros((2, 2)), np.eye(2)]))
    # Each part learnt a measurement with variance one: 14 and 6.
    parts = [
        Biases(np.array([[0.0, 0.0], [m, 0.0]]), np.array([np.zeros((2, 2)), 0.5 * np.eye(2)]))
        for m in (12.0, 8.0)
    ]
    found = combined_biases(parts, prior)
    np.testing.assert_allclose(found.mean[1], [10.0, 0.0])
    np.testing.assert_allclose(found.covariance[1], np.eye(2) / 3.0)
    np.testing.assert_allclose(combined_biases([], prior).mean, prior.mean)


# --- classes, ids


def test_beliefs_become_likelihoods():
    names = [("false_alarm", "fighter", "cargo"), ("false_alarm", "cargo", "boat"), ()]
    classes = common_classes(names)
    assert classes == ("fighter", "cargo", "boat")
    belief = np.array([[0.5, 0.4, 0.1], [1.0, 0.0, 0.0], [0.0, np.nan, 1.0], [0.0, -1.0, 2.0]])
    found = class_likelihoods(belief, names[0], classes, {"fighter": 2.0}, 1.0)
    # .4 / (2/3) and .1 / (1/3), the mean .5; the largest is one. The others tell nothing.
    np.testing.assert_allclose(found[0], [1.0, 0.5, 0.5 / 0.6])
    np.testing.assert_allclose(found[1:], 1.0)
    half = class_likelihoods(belief, names[0], classes, {"fighter": 2.0}, 0.5)
    np.testing.assert_allclose(half[0], [1.0, 0.75, 0.5 + 0.25 / 0.6])
    assert class_likelihoods(np.zeros((2, 0)), (), classes, {}, 1.0).tolist() == [[1.0] * 3] * 2
    share = class_probabilities(np.log([[0.2, 0.4]]), np.array([0.5, 0.5]))
    np.testing.assert_allclose(share, [[1 / 3, 2 / 3]])


def test_ids_go_to_the_group_with_most_of_the_tracks():
    groups = np.array([0, 0, 1, 2, 2, 3])
    company = np.array([7, 7, 7, 5, 3, -1])
    found, next_id = continue_identities(groups, company, 9)
    assert found.tolist() == [7, 9, 3, 10]
    assert next_id == 11
    assert continue_identities(np.zeros(0, int), np.zeros(0, int), 4)[1] == 4


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_no_id_is_given_twice(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    groups = np.unique(rng.integers(0, 6, n), return_inverse=True)[1].reshape(-1)
    company = rng.integers(-1, 5, n)
    found, next_id = continue_identities(groups, company, 5)
    assert len(set(found.tolist())) == len(found)
    assert (found >= 0).all()
    assert (found < next_id).all()
    for group, identity in enumerate(found):
        assert identity >= 5 or identity in company[groups == group]


def test_changes_of_company_are_pairs_of_different_radars():
    labels = np.array([[0, 1, 0, 1], [0, 1, 1, 0], [0, 1, 2, 3]])
    radar, company = np.array([0, 0, 1, 1]), np.array([4, 5, 4, -1])
    assert changes_of_company(labels, radar, company).tolist() == [0, 2, 1]


# --- association


def snapshot_of(seed, sizes=(3, 2), shift=(300.0, -200.0), spread=2000.0):
    rng = np.random.default_rng(seed)
    radar = np.repeat([0, 1], sizes)
    x = rng.standard_normal((max(sizes), 4)) * [spread, spread, 20.0, 20.0]
    mean = np.concatenate([x[: sizes[0]], x[: sizes[1]] + [*shift, 0.0, 0.0]])
    covariance = covariances(rng, len(radar)) + np.eye(4)
    mean = mean + np.einsum("mij,mj->mi", np.linalg.cholesky(covariance),
                            rng.standard_normal(mean.shape))  # fmt: skip
    likelihood = rng.uniform(0.1, 1.0, (len(radar), 2))
    return Snapshot(
        radar, np.arange(len(radar)), mean, covariance, likelihood,
        np.full(len(radar), 0.9), np.full(len(radar), -1),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_associations_are_those_of_the_problem_as_a_file(seed):
    snapshot = snapshot_of(seed, spread=500.0)
    prior = Biases(
        np.array([[20.0, -10.0], [-250.0, 150.0]]),
        np.array([np.diag([400.0, 900.0]), [[160000.0, 3e4], [3e4, 90000.0]]]),
    )
    parameters = TrackFusionParameters(region_std_m=900.0, speed_std_mps=40.0, switching_odds=1.0)
    found = associate(snapshot, parameters, prior, np.array([0.3, 0.7]))
    sensors = []
    for radar in (0, 1):
        rows = (snapshot.radar == radar).nonzero()[0]
        bias = np.diag([0.0, 0.0, 1e-6, 1e-6])
        bias[:2, :2] = prior.covariance[radar]
        sensors.append(
            {
                "measurements": [
                    {
                        "position": snapshot.mean[row].tolist(),
                        "covariance": snapshot.covariance[row].tolist(),
                        "type_call": f"call_{row}",
                    }
                    for row in rows
                ],
                "bias_mean": [*prior.mean[radar], 0.0, 0.0],
                "bias_covariance": bias.tolist(),
                "detection_probability": 0.9,
                "expected_false_alarms": 0.1,
            }
        )
    # A classifier with a call for every track; what it never calls makes the rows sum to one.
    confusion = [
        {
            name: {
                **{
                    f"call_{row}": 0.1 * snapshot.likelihood[row, kind]
                    for row in (snapshot.radar == radar).nonzero()[0]
                },
                "nothing": 1.0 - 0.1 * snapshot.likelihood[snapshot.radar == radar, kind].sum(),
            }
            for kind, name in enumerate(("a", "b"))
        }
        for radar in (0, 1)
    ]
    problem = read_problem(
        json.dumps(
            {
                "sensors": sensors,
                "prior": {"kind": "log_diffuse"},
                "prior_covariance": np.diag([810000.0, 810000.0, 1600.0, 1600.0]).tolist(),
                "types": {"prior": {"a": 0.3, "b": 0.7}, "confusion": confusion},
            }
        )
    )
    expected = solve(problem.model, problem.data)
    np.testing.assert_allclose(found.probability, expected.probability[:10], rtol=1e-7)
    assert (found.labels == expected.labels[:10]).all()
    np.testing.assert_allclose(found.pairs, expected.pairs + np.eye(5), atol=1e-9)
    mean = expected.bias.mean + problem.bias_means
    np.testing.assert_allclose(found.biases.mean, mean[:, :2], rtol=1e-6, atol=1e-6)
    size = np.bincount(found.chosen)
    for label, probability in enumerate(found.cluster_probability):
        inside = found.chosen == label
        if size[label] == 2:
            i, j = inside.nonzero()[0]
            assert probability == pytest.approx(found.pairs[i, j])
        else:
            row = inside.argmax()
            assert probability == pytest.approx(1.0 - (found.pairs[row].sum() - 1.0), abs=1e-9)


def test_parts_that_are_far_apart_are_solved_alone_to_the_same_end():
    snapshot = snapshot_of(5, sizes=(4, 4), spread=20_000.0)
    parameters = TrackFusionParameters()
    classes = np.array([0.5, 0.5])
    mean = np.array([[0.0, 0.0], [-300.0, 200.0]])
    known = Biases(mean, np.array([np.zeros((2, 2)), 25.0 * np.eye(2)]))
    apart = associate(snapshot, parameters, known, classes)
    wide = Biases(mean, np.array([np.zeros((2, 2)), 1e5 * np.eye(2)]))
    together = associate(snapshot, parameters, wide, classes)
    for found in (apart, together):
        assert found.chosen.tolist() == [0, 1, 2, 3, 0, 1, 2, 3]
        assert found.chosen_probability > 0.999
        assert found.probability.sum() == pytest.approx(1.0, abs=1e-3)
    # What was known of the bias beforehand counts once, whatever the number of parts.
    inverse = np.linalg.inv(together.biases.covariance[1]) - np.eye(2) / 1e5 + np.eye(2) / 25.0
    np.testing.assert_allclose(apart.biases.covariance[1], np.linalg.inv(inverse), rtol=0.02)


# --- parameters


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"radars": ["a"]}, "parameter radars = ['a']: allowed are 2 to 8 names that differ"),
        ({"radars": ["a", "a"]}, "names that differ"),
        ({"tracks_topics": ["x"]}, "parameter tracks_topics = ['x']: allowed are 0 or 2 entries"),
        ({"tracks_topics": ["x", "x"]}, "allowed are topics that differ"),
        ({"bias_std_m": [-0.5, 0.0]}, "allowed are numbers >= 0, and -1"),
        ({"bias_std_m": [1.0]}, "allowed are 0 or 2 entries"),
        ({"alignment": "poses"}, "parameter radar_poses = []: allowed are 6 entries"),
        ({"track_probability": []}, "allowed are 1 or 2 entries"),
        ({"late_after_s": 20.0}, "allowed is at most silent_after_s = 15"),
        ({"class_belief_prior": ["a"]}, "'a', allowed are entries class=number"),
        ({"class_belief_prior": ["a=0"]}, "'a=0', allowed are entries class=number"),
    ],
)
def test_what_is_not_allowed_is_said_in_a_line(values, text):
    with pytest.raises(ParameterError) as caught:
        from_mapping(TrackFusionParameters, values)
    assert text in str(caught.value)
