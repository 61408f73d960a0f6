"""Hypothesis probabilities against enumeration, with the formulas of the source written out."""

from __future__ import annotations

import doctest
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association import generalised_measurements
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.generalised_measurements import (
    global_distance_squared,
    joint_log_weights,
    log_hypothesis_probability,
    log_hypothesis_weight,
    log_joint_likelihood,
    most_probable_assignment,
)
from gda_tracker.association.joint import joint_marginals
from gda_tracker.attributes.generalised_measurements import (
    Box,
    Everything,
    FuzzyDempsterShafer,
    GaussianShaped,
    Rule,
    Sector,
    Statements,
    log_association_likelihood,
    log_clutter_likelihood,
)

examples = settings(derandomize=True, deadline=None, max_examples=25)
sizes = st.tuples(st.integers(1, 4), st.integers(1, 4))
seeds = st.integers(0, 2**32 - 1)
LOW, HIGH = np.full(2, -10.0), np.full(2, 10.0)


def hypotheses(n, m):
    """All maps of tracks to measurements, -1 for none, no measurement twice."""
    for theta in itertools.product(range(-1, m), repeat=n):
        used = [j for j in theta if j >= 0]
        if len(used) == len(set(used)):
            yield theta


def weight_by_the_book(theta, likelihood, detection, clutter_rate, clutter):
    """p_D^n_theta (1 - p_D)^(n - n_theta) prod lambda c(Theta_j) prod l(Theta_theta(i) | i)."""
    n, m = likelihood.shape
    assigned = [(i, j) for i, j in enumerate(theta) if j >= 0]
    weight = detection ** len(assigned) * (1.0 - detection) ** (n - len(assigned))
    for j in range(m):
        if j not in theta:
            weight *= clutter_rate * clutter[j]
    for i, j in assigned:
        weight *= likelihood[i, j]
    return weight


def random_statements(random, count):
    """Statements of many kinds, ``count`` of them."""
    kinds = []
    for _ in range(count):
        centre = random.normal(scale=4.0, size=(1, 2))
        shape = np.diag(random.uniform(0.2, 9.0, 2))[None]
        fuzzy = GaussianShaped(centre, shape)
        box = Box(centre - random.uniform(0.5, 4.0, 2), centre + random.uniform(0.5, 4.0, 2))
        sector = Sector(centre, [random.uniform(-3.0, 3.0)], [random.uniform(0.2, 3.0)])
        belief = FuzzyDempsterShafer([[0.5, 0.3, 0.2]], (fuzzy, sector, Everything(1, 2)))
        rule = Rule(box, Box(centre - 2.0, centre + 2.0))
        kinds.append((fuzzy, box, sector, belief, rule)[random.integers(5)])
    return Statements(tuple(kinds))


def random_scan(seed, n, m):
    """Log likelihoods (n, m) and clutter log likelihoods (m,) of random tracks and statements."""
    random = np.random.default_rng(seed)
    statements = random_statements(random, m)
    mean = random.normal(scale=4.0, size=(n, 2))
    factor = random.normal(size=(n, 2, 2))
    covariance = factor @ factor.swapaxes(1, 2) + 0.2 * np.eye(2)
    return (
        log_association_likelihood(statements, mean, covariance, None, 0.3 * np.eye(2)),
        log_clutter_likelihood(statements, LOW, HIGH),
    )


@examples
@given(seeds, sizes, st.sampled_from([0.3, 0.9, 0.99]), st.sampled_from([0.0, 0.1, 3.0]))
def test_map_and_probabilities_equal_enumeration(seed, size, detection, clutter_rate):
    n, m = size
    log_likelihood, log_clutter = random_scan(seed, n, m)
    weights = joint_log_weights(log_likelihood, detection, clutter_rate, log_clutter)
    thetas = list(hypotheses(n, m))
    by_the_book = np.array(
        [
            weight_by_the_book(
                theta, np.exp(log_likelihood), detection, clutter_rate, np.exp(log_clutter)
            )
            for theta in thetas
        ]
    )
    total = by_the_book.sum()
    if total == 0.0:  # more measurements than tracks, and no false alarms
        with pytest.raises(NoFeasibleHypothesis):
            most_probable_assignment(weights)
        return
    probability = by_the_book / total
    np.testing.assert_allclose(
        np.exp(log_hypothesis_probability(weights, thetas)), probability, atol=1e-12
    )
    assert tuple(most_probable_assignment(weights)) == thetas[int(probability.argmax())]
    marginals = np.zeros((n, m))
    for theta, share in zip(thetas, probability, strict=True):
        for i, j in enumerate(theta):
            if j >= 0:
                marginals[i, j] += share
    np.testing.assert_allclose(joint_marginals(*weights), marginals, atol=1e-12)


@examples
@given(seeds, st.integers(1, 4), st.integers(0, 2))
def test_perfect_detection_is_a_choice_among_injections(seed, n, more):
    # (12), (49)-(52): every track has a measurement, the rest is clutter.
    m = n + more
    log_likelihood, log_clutter = random_scan(seed, n, m)
    weights = joint_log_weights(log_likelihood, 1.0, 0.7, log_clutter)
    injections = list(itertools.permutations(range(m), n))
    value = np.array(
        [
            math.prod(math.exp(log_likelihood[i, j]) for i, j in enumerate(chi))
            * math.prod(0.7 * math.exp(log_clutter[j]) for j in range(m) if j not in chi)
            for chi in injections
        ]
    )
    np.testing.assert_allclose(
        np.exp(log_hypothesis_probability(weights, injections)), value / value.sum(), atol=1e-12
    )
    assert tuple(most_probable_assignment(weights)) == injections[int(value.argmax())]
    missing = np.full(n, -1)
    assert log_hypothesis_weight(weights, missing) == -np.inf
    assert global_distance_squared(weights, missing) == np.inf


@examples
@given(seeds, st.integers(1, 4), st.integers(0, 2))
def test_distance_of_fuzzy_statements_with_perfect_detection(seed, n, more):
    # (67), transposed as it must be; (65), (66) for equal C. Clutter is the same for all.
    random = np.random.default_rng(seed)
    m = n + more
    centre, mean = random.normal(scale=3.0, size=(m, 2)), random.normal(scale=3.0, size=(n, 2))
    covariance = np.array([np.diag(random.uniform(0.5, 4.0, 2)) for _ in range(n)])
    own = np.array([np.diag(random.uniform(0.5, 4.0, 2)) for _ in range(m)])
    injections = np.array(list(itertools.permutations(range(m), n)))

    def both_distances(shape):
        log_likelihood = log_association_likelihood(GaussianShaped(centre, shape), mean, covariance)
        weights = joint_log_weights(log_likelihood, 1.0, 0.5, np.full(m, -2.0))
        constant = -2.0 * (m - n) * (np.log(0.5) - 2.0)
        mahalanobis, determinants = np.zeros(len(injections)), np.zeros(len(injections))
        for row, chi in enumerate(injections):
            for i, j in enumerate(chi):
                total, gap = shape[j] + covariance[i], centre[j] - mean[i]
                mahalanobis[row] += gap @ np.linalg.solve(total, gap)
                determinants[row] += np.log(np.linalg.det(total) / np.linalg.det(shape[j]))
        found = global_distance_squared(weights, injections) - constant
        return weights, found, mahalanobis, determinants

    _, found, mahalanobis, determinants = both_distances(own)
    np.testing.assert_allclose(found, mahalanobis + determinants, rtol=1e-10, atol=1e-10)
    weights, found, mahalanobis, determinants = both_distances(np.tile(own[:1], (m, 1, 1)))
    np.testing.assert_allclose(determinants, determinants[0], rtol=1e-12)
    probability = np.exp(-0.5 * (mahalanobis - mahalanobis.min()))
    np.testing.assert_allclose(
        np.exp(log_hypothesis_probability(weights, injections)),
        probability / probability.sum(),
        atol=1e-12,
    )


def test_equal_shapes_of_fuzzy_dempster_shafer_statements():
    # (84): with p_D = 1 and one C for all focal sets the determinants cancel.
    random = np.random.default_rng(11)
    centre, mean = random.normal(size=(2, 3, 2)), random.normal(size=(3, 2))
    covariance = np.array([np.diag(random.uniform(0.5, 4.0, 2)) for _ in range(3)])
    shape, weight = np.array([[2.0, 0.5], [0.5, 1.0]]), random.dirichlet(np.ones(2), 3)
    statement = FuzzyDempsterShafer(
        weight, tuple(GaussianShaped(c, np.tile(shape, (3, 1, 1))) for c in centre)
    )
    log_likelihood = log_association_likelihood(statement, mean, covariance)
    weights = joint_log_weights(log_likelihood, 1.0, 0.0, np.zeros(3))
    orders = list(itertools.permutations(range(3)))
    value = np.zeros(6)
    for row, chi in enumerate(orders):
        factors = []
        for i, j in enumerate(chi):
            inverse = np.linalg.inv(shape + covariance[i])
            gaps = centre[:, j] - mean[i]
            factors.append(
                sum(
                    w * np.exp(-0.5 * g @ inverse @ g) for w, g in zip(weight[j], gaps, strict=True)
                )
            )
        value[row] = math.prod(factors)
    np.testing.assert_allclose(
        np.exp(log_hypothesis_probability(weights, orders)), value / value.sum(), rtol=1e-11
    )


@examples
@given(seeds, sizes)
def test_place_and_class_factorise(seed, size):
    # (86)-(92) against the double sum over classes, inside each hypothesis.
    n, m = size
    random = np.random.default_rng(seed)
    log_kinematic = random.normal(scale=2.0, size=(n, m))
    belief = random.dirichlet(np.ones(3), n)
    class_likelihood = random.uniform(0.01, 1.0, (m, 3))
    joint = log_joint_likelihood(log_kinematic, belief, np.log(class_likelihood))
    for i in range(n):
        for j in range(m):
            wanted = math.exp(log_kinematic[i, j]) * sum(
                class_likelihood[j, c] * belief[i, c] for c in range(3)
            )
            assert math.exp(joint[i, j]) == pytest.approx(wanted, rel=1e-12)
    if m < n:
        return
    # (92): with p_D = 1 and constant clutter the probabilities multiply.
    injections = list(itertools.permutations(range(m), n))
    parts = [
        joint_log_weights(values, 1.0, 0.5, np.zeros(m))
        for values in (joint, log_kinematic, joint - log_kinematic)
    ]
    both, place, kind = (np.exp(log_hypothesis_probability(part, injections)) for part in parts)
    np.testing.assert_allclose(both, place * kind / (place * kind).sum(), rtol=1e-10, atol=1e-13)


@examples
@given(seeds, sizes)
def test_names_of_tracks_and_measurements_do_not_matter(seed, size):
    n, m = size
    random = np.random.default_rng(seed)
    log_likelihood, log_clutter = random_scan(seed, n, m)
    detection = random.uniform(0.1, 0.95, n)
    weights = joint_log_weights(log_likelihood, detection, 0.4, log_clutter)
    i, j = random.permutation(n), random.permutation(m)
    turned = joint_log_weights(log_likelihood[i][:, j], detection[i], 0.4, log_clutter[j])
    np.testing.assert_allclose(
        joint_marginals(*turned), joint_marginals(*weights)[i][:, j], atol=1e-13
    )
    chosen = np.append(j, -1)[most_probable_assignment(turned)]
    assert chosen.tolist() == most_probable_assignment(weights)[i].tolist()


def test_a_vague_statement_decides_nothing_but_its_own_existence():
    # It is as likely for every track, and for clutter: the odds are those of p_D and lambda.
    statements = Everything(1, 2)
    log_likelihood = log_association_likelihood(statements, np.zeros((2, 2)), [np.eye(2)] * 2)
    clutter = log_clutter_likelihood(statements, LOW, HIGH)
    weights = joint_log_weights(log_likelihood, 0.5, 2.0, clutter)
    # Weights: clutter 0.25 * 2, each track 0.25.
    np.testing.assert_allclose(joint_marginals(*weights), [[0.25], [0.25]])


def test_a_human_statement_changes_an_association():
    # Two tracks cross; the radar's two detections lie so that the exchange is a little likelier.
    mean = np.array([[0.0, 30.0], [0.0, -30.0]])
    covariance = np.tile(3600.0 * np.eye(2), (2, 1, 1))
    detections = np.array([[0.0, -10.0], [0.0, 10.0]])
    radar_noise = 900.0 * np.eye(2)
    # A radar detection is a sharp fuzzy statement: the same engine takes it.
    shape = 1e-6 * np.eye(2)
    radar = GaussianShaped(detections, np.tile(shape, (2, 1, 1)))
    place = log_association_likelihood(radar, mean, covariance, None, radar_noise)
    clutter = log_clutter_likelihood(radar, np.full(2, -1000.0), np.full(2, 1000.0))
    silent = joint_log_weights(place, 0.9, 0.01, clutter)
    assert most_probable_assignment(silent).tolist() == [1, 0]
    # "The one in the south is a fighter, I think": detection 0 is a fighter with grade 0.9.
    belief = np.array([[0.8, 0.2], [0.1, 0.9]])  # fighter, cargo
    statement = np.array([[0.9, 0.2], [1.0, 1.0]])  # nothing was said of detection 1
    false_alarm = np.log([0.5, 1.0])
    told = joint_log_weights(
        log_joint_likelihood(place, belief, np.log(statement)), 0.9, 0.01, clutter + false_alarm
    )
    assert most_probable_assignment(told).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"log_likelihood": np.zeros(2)}, r"allowed is \(n, m\)"),
        ({"log_likelihood": np.full((2, 3), np.nan)}, "log_likelihood has NaN"),
        ({"detection_probability": 1.5}, "from 0 to 1"),
        ({"detection_probability": [0.5, 0.5, 0.5]}, "detection_probability has the shape"),
        ({"clutter_rate": -1.0}, "clutter_rate = -1"),
        ({"clutter_rate": math.nan}, "clutter_rate = nan"),
        ({"log_clutter_likelihood": np.zeros(2)}, "log_clutter_likelihood has the shape"),
        ({"log_clutter_likelihood": np.full(3, np.inf)}, "log_clutter_likelihood has NaN"),
    ],
)
def test_bad_weights_are_refused(change, match):
    good = {
        "log_likelihood": np.zeros((2, 3)),
        "detection_probability": 0.9,
        "clutter_rate": 1.0,
        "log_clutter_likelihood": np.zeros(3),
    }
    with pytest.raises(AssociationInputError, match=match):
        joint_log_weights(**{**good, **change})


@pytest.mark.parametrize(
    ("assignment", "match"),
    [
        ([0], "shape"),
        ([0.0, 1.0], "integers"),
        ([0, 3], "allowed are -1 and 0 to 2"),
        ([-2, 0], "allowed are -1"),
        ([1, 1], "one track at most"),
    ],
)
def test_bad_assignments_are_refused(assignment, match):
    weights = joint_log_weights(np.zeros((2, 3)), 0.9, 1.0, np.zeros(3))
    with pytest.raises(AssociationInputError, match=match):
        log_hypothesis_weight(weights, assignment)


def test_nothing_feasible_has_no_probability():
    weights = joint_log_weights(np.full((1, 1), -np.inf), 1.0, 0.0, np.zeros(1))
    with pytest.raises(NoFeasibleHypothesis):
        log_hypothesis_probability(weights, [0])
    with pytest.raises(NoFeasibleHypothesis):
        most_probable_assignment(weights)


def test_the_example_of_a_human_statement_is_true():
    result = doctest.testmod(generalised_measurements)
    assert result.attempted > 20
    assert result.failed == 0
