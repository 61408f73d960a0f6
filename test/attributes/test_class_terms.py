"""The term bayes: class prediction and Bayes' rule."""

import itertools

import numpy as np
import pytest
from attribute_examples import scan_of
from fusion_examples import all_pairs, forgetful, histories, stage

from gda_tracker.attributes.class_terms import transition_matrix
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.ring import Ring


@pytest.fixture(scope="module")
def fuzzifier():
    return RcsFuzzifier(RcsFuzzifierParameters())


@pytest.fixture(scope="module")
def evidence(fuzzifier):
    """Five detections, the fourth without an RCS."""
    return fuzzifier(scan_of([0.15, 1.0, 6.0, np.nan, 2.5]))


def test_bayes_multiplies_likelihoods(evidence):
    hypothesis, detection = all_pairs(4, 5)
    predictions = histories("bayes")
    scores = stage()(predictions, evidence, hypothesis, detection)
    known = detection != 3
    joint = predictions.class_probability[hypothesis] * np.exp(
        evidence.log_class_likelihood[detection]
    )
    np.testing.assert_allclose(
        scores.class_probability, joint / joint.sum(axis=1, keepdims=True), rtol=1e-12
    )
    np.testing.assert_allclose(scores.log_likelihood[known], np.log(joint.sum(axis=1))[known])
    # Class probabilities as masses: the conflict is what is not on the same element.
    agreement = (predictions.class_probability[hypothesis] * evidence.masses[detection, :3]).sum(1)
    np.testing.assert_allclose(scores.conflict[known], 1 - agreement[known], atol=1e-14)


def test_bayes_forgets_towards_the_possible_classes(evidence):
    predictions = histories("bayes", 1)
    predictions.class_probability = np.array([[0.0, 1e-9, 1.0 - 1e-9]])
    pair = np.zeros(1, dtype=np.int32), np.ones(1, dtype=np.int32)
    scores = stage()(forgetful(predictions, 0.9), evidence, *pair)
    joint = np.array([0.0, 0.05, 0.95]) * np.exp(evidence.log_class_likelihood[1])
    np.testing.assert_allclose(scores.class_probability[0], joint / joint.sum(), rtol=1e-6)
    assert scores.class_probability[0, 0] == 0.0


def test_bayes_recovers_the_class(fuzzifier):
    """Twenty scans of a cargo: its probability ends near one, and the two orders agree."""
    draws = np.random.default_rng(11).gamma(2.0, 2.0, 20)
    ends = []
    for sequence in (draws, draws[::-1]):
        beliefs = np.array([[0.0, 0.5, 0.5]])
        for rcs_m2 in sequence:
            predictions = histories("bayes", 1)
            predictions.class_probability = beliefs
            pair = np.zeros(1, dtype=np.int32)
            beliefs = stage()(
                predictions, fuzzifier(scan_of([rcs_m2])), pair, pair
            ).class_probability
        ends.append(beliefs)
    assert ends[0][0, 2] > 0.99
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)


# --- classes that change ------------------------------------------------------------------------

# Row: the class that it becomes, column: the class that it was.
TRANSITION = [1.0, 0.0, 0.1, 0.0, 0.7, 0.2, 0.0, 0.3, 0.7]


def test_prediction_by_hand(evidence):
    """A fighter becomes a cargo with .3, a cargo a fighter with .2 and nothing with .1."""
    predictions = histories("bayes", 1)
    predictions.class_probability = np.array([[0.0, 0.6, 0.4]])
    pair = np.zeros(1, dtype=np.int32), np.full(1, 2, dtype=np.int32)
    scores = stage(class_transition=TRANSITION)(predictions, evidence, *pair)
    predicted = np.array([0.04, 0.6 * 0.7 + 0.4 * 0.2, 0.6 * 0.3 + 0.4 * 0.7])
    joint = predicted * np.exp(evidence.log_class_likelihood[2])
    np.testing.assert_allclose(scores.class_probability[0], joint / joint.sum(), rtol=1e-12)
    assert scores.log_likelihood[0] == pytest.approx(np.log(joint.sum()), rel=1e-12)


def test_a_snorkelling_submarine(fuzzifier):
    """Big while it snorkels: one that has dived is believed so, and not before it may have."""
    shares = {}
    for name, transition in (("changing", [0.9, 0.5, 0.1, 0.5]), ("never", [])):
        table = RcsFuzzifierParameters(
            class_names=["submerged", "snorkelling"],
            class_rcs_mean_m2=[0.3, 4.0],
            class_rcs_swerling=[2, 3],
            class_labels=["N", "B"],
            class_prior=[0.5, 0.5],
        )
        fuzzify = RcsFuzzifier(table)
        belief = np.array([[0.5, 0.5]])
        for rcs_m2 in [4.0] * 8 + [0.2] * 2:
            predictions = histories("bayes", 1)
            predictions.frame, predictions.class_names = ("N", "B"), tuple(table.class_names)
            predictions.class_probability = belief
            pair = np.zeros(1, dtype=np.int32)
            scores = stage(class_transition=transition)(
                predictions, fuzzify(scan_of([rcs_m2])), pair, pair
            )
            belief = scores.class_probability
        shares[name] = belief[0, 0]
    assert shares["changing"] > 0.9
    assert shares["never"] < 0.01


def test_several_scans_are_the_sum_over_all_class_histories(fuzzifier):
    """Filtering by (93) and (94) against the sum over every sequence of classes."""
    evidence = fuzzifier(scan_of([0.4, 1.0, 3.0, 0.7]))
    prior = np.array([0.2, 0.5, 0.3])
    matrix = np.array(TRANSITION).reshape(3, 3)
    likelihood = np.exp(evidence.log_class_likelihood)
    expected, log_evidence = np.zeros(3), 0.0
    for sequence in itertools.product(range(3), repeat=5):
        weight = prior[sequence[0]]
        for step, (old, new) in enumerate(itertools.pairwise(sequence)):
            weight *= matrix[new, old] * likelihood[step, new]
        expected[sequence[-1]] += weight
    belief = prior[None, :]
    for row in range(4):
        predictions = histories("bayes", 1)
        predictions.class_probability = belief
        pair = np.zeros(1, dtype=np.int32), np.full(1, row, dtype=np.int32)
        scores = stage(class_transition=TRANSITION)(predictions, evidence, *pair)
        belief = scores.class_probability
        log_evidence += scores.log_likelihood[0]
    np.testing.assert_allclose(belief[0], expected / expected.sum(), rtol=1e-12)
    assert log_evidence == pytest.approx(np.log(expected.sum()), rel=1e-12)


def test_no_change_is_no_transition(evidence):
    pairs = all_pairs(4, 5)
    still = stage(class_transition=np.eye(3).ravel().tolist())(histories("bayes"), evidence, *pairs)
    without = stage()(histories("bayes"), evidence, *pairs)
    for name in ("class_probability", "log_likelihood", "conflict"):
        np.testing.assert_allclose(getattr(still, name), getattr(without, name), rtol=1e-12)


def test_an_unknown_attribute_leaves_the_class_as_it_is(evidence):
    predictions = histories("bayes")
    scores = stage(class_transition=TRANSITION)(predictions, evidence, *all_pairs(4, 5))
    np.testing.assert_array_equal(scores.class_probability[3::5], predictions.class_probability)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([0.5, 0.5], "2 numbers, not as many as in a square matrix.*4, 9, 16, 25 numbers"),
        ([1.0], "1 numbers, not as many as in a square matrix"),
        ([1.0, *[0.0] * 5] * 6, "36 numbers, not as many as in a square matrix"),
        ([0.9, 0.1, 0.2, 0.8], "columns with the sums 1.1, 0.9, not 1; allowed are an empty list"),
        ([1.5, 0.0, -0.5, 1.0], "class_transition = .*: allowed is a list, each a number >= 0"),
        ([float("nan")], "class_transition = .*: allowed is a list, each a number >= 0"),
    ],
)
def test_transitions_that_are_none_are_refused(value, message):
    with pytest.raises(ParameterError, match=message):
        stage(class_transition=value)


def test_a_transition_of_other_classes_is_refused(evidence):
    two = [0.9, 0.5, 0.1, 0.5]
    with pytest.raises(ParameterError, match="= 4 numbers: allowed are 9 for the 3 classes f"):
        Ring({"attribute_fusion": {"class_transition": two}})
    # The stage of a node learns of the classes with the first scan.
    with pytest.raises(ValueError, match="4 numbers: allowed are 9 for the 3 classes false_a"):
        stage(class_transition=two)(histories("bayes"), evidence, *all_pairs(4, 5))
    # The other terms do not look at it.
    stage(class_transition=two)(histories("pcr5"), evidence, *all_pairs(4, 5))


def test_columns_that_are_rounded_sum_to_one():
    third = [0.333_333_3, 0.1, 0.0, 0.333_333_3, 0.8, 0.0, 0.333_333_3, 0.1, 1.0]
    np.testing.assert_allclose(transition_matrix(third).sum(axis=0), 1.0, rtol=1e-15)
    assert transition_matrix([]) is None
