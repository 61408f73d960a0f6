import itertools

import numpy as np
import pytest
from dictionary_rules import assert_same, conjunctive, dempster, from_row, reduced, shafer_parts
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from gda_tracker.attributes.attribute_evidence import (
    LARGEST_LOG_RATIO,
    AttributeCombination,
    AttributeEvidence,
    AttributeFuzzifier,
    class_focal,
    mixed_log_likelihood,
)
from gda_tracker.attributes.class_models import CLASS_MODELS
from gda_tracker.evidence.frames import element_name, total_ignorance

FRAME = ("F", "D", "J", "C")
ALL = np.ones(4, dtype=bool)
# Length of a drone, a fighter and a cargo aircraft; nothing is known of false alarms.
LENGTH = np.array([[1.5, 0.5], [15.0, 0.3], [40.0, 0.3]])
NO_FALSE_ALARM = np.array([False, True, True, True])
CALLS = np.array(
    [[0.7, 0.1, 0.1, 0.1], [0.2, 0.8, 0.0, 0.0], [0.1, 0.0, 0.6, 0.3], [0.0, 0.1, 0.3, 0.6]]
)


def calls(reliability=1.0, **limits):
    return AttributeFuzzifier(CLASS_MODELS["confusion_matrix"](CALLS), ALL, reliability, **limits)


def lengths(reliability=1.0, **limits):
    return AttributeFuzzifier(
        CLASS_MODELS["lognormal"](LENGTH), NO_FALSE_ALARM, reliability, **limits
    )


def of(fuzzifier, values):
    values = np.asarray(values, dtype=float)
    return fuzzifier(values, np.ones(len(values), dtype=bool))


def names(focal):
    return [element_name(FRAME, mask) for mask in focal]


def assert_vacuous(evidence, rows=slice(None)):
    everything = evidence.focal == total_ignorance(len(FRAME))
    np.testing.assert_array_equal(evidence.masses[rows][:, everything], 1.0)
    np.testing.assert_array_equal(evidence.masses[rows][:, ~everything], 0.0)
    np.testing.assert_array_equal(evidence.log_class_likelihood[rows], 0.0)
    assert not evidence.informative[rows].any()


# --- one attribute --------------------------------------------------------------------------------


def test_a_call_by_hand():
    found = of(calls(), [0.0, 2.0])
    assert names(found.focal) == ["F", "D", "J", "C", "F|D|J|C"]
    np.testing.assert_allclose(found.masses, [[0.7, 0.2, 0.1, 0.0, 0.0], [0.1, 0.0, 0.6, 0.3, 0.0]])
    np.testing.assert_allclose(
        np.exp(found.log_class_likelihood), [[0.7, 0.2, 0.1, 0.0], [0.1, 0.0, 0.6, 0.3]]
    )
    assert found.informative.all()


def test_a_call_of_reliability_a_half_by_hand():
    found = of(calls(0.5), [0.0])
    np.testing.assert_allclose(found.masses, [[0.35, 0.1, 0.05, 0.0, 0.5]])
    # Half of the likelihood, and half of its mean over the classes, 0.25.
    np.testing.assert_allclose(
        np.exp(found.log_class_likelihood), [[0.475, 0.225, 0.175, 0.125]], rtol=1e-14
    )


def test_a_class_of_which_nothing_is_known():
    found = of(lengths(), [12.0, 1.0])
    assert names(found.focal) == ["F|D", "F|J", "F|C", "F|D|J|C"]
    density = stats.lognorm.pdf(np.array([[12.0], [1.0]]), LENGTH[:, 1], scale=LENGTH[:, 0])
    np.testing.assert_allclose(
        found.masses[:, :3], density / density.sum(axis=1, keepdims=True), rtol=1e-12
    )
    np.testing.assert_allclose(np.exp(found.log_class_likelihood[:, 1:]), density, rtol=1e-12)
    np.testing.assert_allclose(
        np.exp(found.log_class_likelihood[:, 0]), density.mean(axis=1), rtol=1e-12
    )


def test_a_class_of_which_nothing_is_known_keeps_its_probability():
    """With equal probability of the known classes, whatever that of the other one is."""
    prior = np.array([0.4, 0.2, 0.2, 0.2])
    weight = prior * np.exp(of(lengths(0.8), [0.5, 12.0, 90.0]).log_class_likelihood)
    np.testing.assert_allclose(weight[:, 0] / weight.sum(axis=1), 0.4, rtol=1e-12)


@pytest.mark.parametrize("make", [calls, lengths])
def test_reliability_one_is_as_is_and_zero_is_vacuous(make):
    values = [1.0, 2.0, 3.0]
    model = make().model(np.array(values))
    np.testing.assert_array_equal(of(make(), values).log_class_likelihood[:, -3:], model[:, -3:])
    assert_vacuous(of(make(0.0), values))
    # And nearly so next to the ends.
    near_one, near_zero = of(make(1.0 - 1e-13), values), of(make(1e-13), values)
    np.testing.assert_allclose(near_one.masses, of(make(), values).masses, atol=1e-12)
    np.testing.assert_allclose(
        np.exp(near_one.log_class_likelihood),
        np.exp(of(make(), values).log_class_likelihood),
        atol=1e-12,
    )
    np.testing.assert_allclose(near_zero.masses[:, -1], 1.0, atol=1e-12)
    assert np.ptp(near_zero.log_class_likelihood, axis=1).max() < 1e-12


@settings(derandomize=True, deadline=None, max_examples=100)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
    st.floats(0.0, 1.0, exclude_min=True),
    st.lists(st.booleans(), min_size=3, max_size=3),
)
def test_mixed_likelihood_is_the_mixture(logs, reliability, known):
    known = np.array([True, True, *known])
    logs = np.array([[0.0, *logs, -1.0]])[:, : known.sum()]
    mixed = mixed_log_likelihood(logs, known, reliability)
    scaled = np.exp(logs - logs.max())
    wanted = reliability * scaled + (1.0 - reliability) * scaled.mean()
    np.testing.assert_allclose(np.exp(mixed[:, known] - logs.max()), wanted, rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(np.exp(mixed[:, ~known] - logs.max()), scaled.mean(), rtol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 4.0, -1.0, 0.5, 1e300])
def test_a_value_that_is_no_call_is_unknown(value):
    found = of(calls(), [value, 1.0])
    assert found.informative.tolist() == [False, True]
    assert_vacuous(found, slice(0, 1))
    np.testing.assert_array_equal(found.masses[1], of(calls(), [1.0]).masses[0])


def test_a_value_outside_the_limits_or_beyond_all_classes_is_unknown():
    found = of(lengths(minimum=1.0, maximum=50.0), [0.9, 1.0, 50.0, 50.1, -2.0])
    assert found.informative.tolist() == [False, True, True, False, False]
    assert_vacuous(found, ~found.informative)
    grades = CLASS_MODELS["trapezoid"](np.array([[0.0, 0.0, 1.0, 2.0], [1.0, 3.0, 3.0, 4.0]]))
    fuzzifier = AttributeFuzzifier(grades, np.array([True, True]))
    assert of(fuzzifier, [0.5, 4.5]).informative.tolist() == [True, False]


def test_a_value_that_is_not_valid_is_unknown():
    found = calls()(np.array([1.0, 1.0]), np.array([True, False]))
    assert found.informative.tolist() == [True, False]
    assert_vacuous(found, slice(1, 2))


def test_far_values_go_to_the_widest_class_without_underflow():
    found = of(lengths(), [1e-30, 1e30])
    np.testing.assert_allclose(found.masses.sum(axis=1), 1.0, atol=1e-15)
    assert np.isfinite(found.log_class_likelihood[:, 1:]).all()


def test_focal_columns_of_classes():
    assert names(class_focal(ALL)) == ["F", "D", "J", "C", "F|D|J|C"]
    two = class_focal(np.array([True, False, False, True]))
    assert names(two) == ["F|D|J", "D|J|C", "F|D|J|C"]


# --- several attributes ---------------------------------------------------------------------------


def random_evidence(random, known, n=6):
    focal = class_focal(known)
    return AttributeEvidence(
        focal,
        random.dirichlet(np.ones(len(focal)), n),
        random.normal(0.0, 3.0, (n, len(known))),
        np.ones(n, dtype=bool),
    )


def combine(evidence, rule="dsm_classic"):
    return AttributeCombination(FRAME, [item.focal for item in evidence], rule)(evidence)


SOURCES = (ALL, NO_FALSE_ALARM, np.array([True, True, False, True]))


@pytest.mark.parametrize("rule", ["dsm_classic", "dempster"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_attributes_together_are_one_after_the_other(rule, count):
    """Against dictionaries of sets: m1 with m2, the result with m3."""
    random = np.random.default_rng(count)
    evidence = [random_evidence(random, known) for known in SOURCES[:count]]
    found = combine(evidence, rule)
    for row in range(6):
        beliefs = [from_row(FRAME, item.focal, item.masses[row]) for item in evidence]
        got = from_row(FRAME, found.focal, found.masses[row])
        if rule == "dempster":
            alive = shafer_parts(FRAME)
            wanted, got = reduced(beliefs[0], alive), reduced(got, alive)
            for belief in beliefs[1:]:
                wanted, _ = dempster(FRAME, wanted, belief)
        else:
            wanted = beliefs[0]
            for belief in beliefs[1:]:
                wanted = conjunctive(wanted, belief)
        assert_same(got, wanted)
    np.testing.assert_allclose(
        found.log_class_likelihood, sum(item.log_class_likelihood for item in evidence)
    )


@pytest.mark.parametrize("rule", ["dsm_classic", "dempster"])
def test_the_order_of_the_attributes_plays_no_part(rule):
    random = np.random.default_rng(5)
    evidence = [random_evidence(random, known) for known in SOURCES]
    wanted = combine(evidence, rule)
    for order in itertools.permutations(evidence):
        found = combine(order, rule)
        np.testing.assert_array_equal(found.focal, wanted.focal)
        np.testing.assert_allclose(found.masses, wanted.masses, atol=1e-15)
        np.testing.assert_allclose(
            found.log_class_likelihood, wanted.log_class_likelihood, atol=1e-14
        )


@pytest.mark.parametrize("rule", ["dsm_classic", "dempster"])
def test_an_unknown_attribute_changes_nothing(rule):
    known, unknown = of(calls(), [0.0, 1.0, 3.0]), of(lengths(), [np.nan] * 3)
    for both in ([known, unknown], [unknown, known]):
        found = combine(both, rule)
        columns = [found.focal.tolist().index(mask) for mask in known.focal.tolist()]
        # To the bit, but for Dempster's division by a sum of about one.
        tolerance = 0.0 if rule == "dsm_classic" else 1e-15
        np.testing.assert_allclose(found.masses[:, columns], known.masses, rtol=0.0, atol=tolerance)
        np.testing.assert_array_equal(np.delete(found.masses, columns, axis=1), 0.0)
        # -inf of an impossible class is limited.
        np.testing.assert_array_equal(
            found.log_class_likelihood,
            np.maximum(
                known.log_class_likelihood,
                known.log_class_likelihood.max(axis=1, keepdims=True) - LARGEST_LOG_RATIO,
            ),
        )
        np.testing.assert_array_equal(found.informative, True)


def test_attributes_in_total_conflict_leave_ignorance():
    sure = AttributeFuzzifier(CLASS_MODELS["confusion_matrix"](np.eye(4)), ALL)
    evidence = [of(sure, [1.0, 2.0]), of(sure, [3.0, 2.0])]
    found = combine(evidence, "dempster")
    assert found.masses[0].tolist() == (found.focal == total_ignorance(4)).tolist()
    assert names(found.focal[found.masses[1] == 1.0]) == ["J"]
    # Calls that exclude all classes together exclude none.
    np.testing.assert_array_equal(found.log_class_likelihood[0], 0.0)
    np.testing.assert_array_equal(found.log_class_likelihood[1], [-500.0, -500.0, 0.0, -500.0])
    # On the free model a contradiction is an intersection.
    free = combine(evidence, "dsm_classic")
    assert names(free.focal[free.masses[0] == 1.0]) == ["D&C"]


def test_no_class_is_ruled_out_for_ever():
    found = combine([of(calls(), [1.0]), of(calls(), [1.0])])
    assert np.isfinite(found.log_class_likelihood).all()
    assert np.ptp(found.log_class_likelihood) == LARGEST_LOG_RATIO


def test_no_detections():
    found = combine([of(calls(), []), of(lengths(), [])], "dempster")
    assert found.masses.shape == (0, len(found.focal))
    assert found.log_class_likelihood.shape == (0, 4)
