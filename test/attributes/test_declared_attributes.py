"""The RCS fuzzifier with further attributes, declared by parameters."""

import numpy as np
import pytest
from attribute_examples import FOUR, scan_of
from scipy import stats

from gda_tracker.attributes.fusion import class_prior, fuse_pairs
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.rcs import density
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.evidence.frames import element_name, total_ignorance
from gda_tracker.parameters import ParameterError, from_mapping

DECLARED = {
    **FOUR,
    "attribute_names": ["length_m", "radial_speed_mps"],
    "attribute_models": ["lognormal", "trapezoid"],
    "attribute_numbers": [
        *(1.5, 0.5, 15.0, 0.3, 40.0, 0.3),
        *(0, 0, 350, 400, 0, 0, 30, 60, 0, 0, 350, 400, 0, 0, 220, 280),
    ],
    "attribute_unknown_classes": ["length_m/false_alarm"],
}


def fuzzifier(**changes):
    return RcsFuzzifier(from_mapping(RcsFuzzifierParameters, changes))


def with_length(rcs_m2, length_m, **fields):
    length_m = np.asarray(length_m, dtype=float)
    known = np.isfinite(length_m)
    return scan_of(
        rcs_m2,
        attribute_names=("colour", "length_m"),
        attribute_values=np.stack([np.ones(len(known)), np.where(known, length_m, 0.0)]),
        attribute_valid=np.stack([np.ones(len(known), dtype=bool), known]),
        **fields,
    )


def test_without_declared_attributes_those_of_the_scan_are_ignored():
    alone, other = (
        fuzzifier()(scan_of([1.0, 2.0])),
        fuzzifier()(with_length([1.0, 2.0], [3.0, 4.0])),
    )
    for name in ("focal", "masses", "log_class_likelihood", "class_probability", "informative"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(other, name))


def test_log_likelihoods_of_the_attributes_add():
    rcs_m2, length_m = np.array([0.1, 2.0, 5.0]), np.array([2.0, 18.0, 30.0])
    rate = np.array([-20.0, 200.0, -250.0])
    evidence = fuzzifier(**DECLARED)(with_length(rcs_m2, length_m, range_rate_mps=rate))
    length = stats.lognorm.pdf(length_m[:, None], [0.5, 0.3, 0.3], scale=[1.5, 15.0, 40.0])
    speed = [[1.0, 1.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0], [1.0, 0.0, 1.0, 0.5]]
    wanted = (
        density(rcs_m2[:, None], FOUR["class_rcs_mean_m2"], FOUR["class_rcs_swerling"])
        * np.hstack([length.mean(axis=1, keepdims=True), length])
        * speed
    )
    # What no drone does is as good as impossible, not quite.
    np.testing.assert_allclose(
        np.exp(evidence.log_class_likelihood), wanted, rtol=1e-11, atol=1e-200
    )
    weight = wanted * [0.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(
        evidence.class_probability, weight / weight.sum(axis=1, keepdims=True), atol=1e-14
    )


def test_masses_of_two_attributes_by_hand():
    """RCS and length of one detection: each product where the classic rule puts it."""
    stage = fuzzifier(**DECLARED, attribute_rule="dsm_classic")
    rcs_m2, length_m = 1.0, 12.0
    evidence = stage(with_length([rcs_m2], [length_m]))
    grades = stage.membership(np.array([rcs_m2]))[0]
    grades = grades / grades.sum()
    length = stats.lognorm.pdf(length_m, [0.5, 0.3, 0.3], scale=[1.5, 15.0, 40.0])
    length = length / length.sum()
    found = {
        element_name(evidence.frame, mask): mass
        for mask, mass in zip(evidence.focal, evidence.masses[0], strict=True)
    }
    # F & (FA|F) = F; D & (FA|F) = FA&D|D&F.
    np.testing.assert_allclose(found["FA"], grades[0], rtol=1e-12)
    np.testing.assert_allclose(found["F"], grades[2] * length[1], rtol=1e-9)
    np.testing.assert_allclose(found["FA&D|D&F"], grades[1] * length[1], rtol=1e-9)
    np.testing.assert_allclose(sum(found.values()), 1.0, atol=1e-14)


def test_an_unknown_radar_cross_section_leaves_the_other_attributes():
    stage = fuzzifier(**DECLARED)
    evidence = stage(with_length([np.nan, np.nan, 1.0], [15.0, np.nan, np.nan]))
    assert evidence.informative.tolist() == [True, False, True]
    assert evidence.class_probability[0].argmax() == 2
    np.testing.assert_array_equal(evidence.class_probability[1], stage.prior)
    everything = evidence.focal == total_ignorance(4)
    assert evidence.masses[1][everything] == 1.0


@pytest.mark.parametrize("rule", ["dsm_classic", "dempster"])
def test_absent_attributes_change_nothing_but_the_columns(rule):
    with_rule = {**DECLARED, "attribute_rule": rule}
    plain, other = fuzzifier(**FOUR), fuzzifier(**with_rule)
    scan = scan_of([0.1, np.nan, 3.0])
    one, two = plain(scan), other(scan)
    columns = [two.focal.tolist().index(mask) for mask in one.focal.tolist()]
    np.testing.assert_allclose(two.masses[:, columns], one.masses, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(np.delete(two.masses, columns, axis=1), 0.0)
    for name in ("log_class_likelihood", "class_probability", "informative"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_an_own_column_goes_before_the_range_rate():
    stage = fuzzifier(**DECLARED)
    fields = {"range_rate_mps": np.array([100.0])}
    named = scan_of(
        [np.nan],
        attribute_names=("radial_speed_mps",),
        attribute_values=np.array([[10.0]]),
        attribute_valid=np.array([[True]]),
        **fields,
    )
    assert stage(scan_of([np.nan], **fields)).class_probability[0, 1] < 1e-100
    assert stage(named).class_probability[0, 1] == pytest.approx(1.0 / 3.0)


def test_reliability_of_the_radar_cross_section():
    values = scan_of([0.1, 4.0])
    full, half, none = (fuzzifier(rcs_reliability=r)(values) for r in (1.0, 0.5, 0.0))
    np.testing.assert_allclose(half.masses[:, :3], 0.5 * full.masses[:, :3])
    np.testing.assert_allclose(half.masses[:, 3], 0.5)
    likelihood = np.exp(full.log_class_likelihood)
    np.testing.assert_allclose(
        np.exp(half.log_class_likelihood),
        0.5 * likelihood + 0.5 * likelihood.mean(axis=1, keepdims=True),
    )
    assert not none.informative.any()
    np.testing.assert_array_equal(none.masses, [[0, 0, 0, 1]] * 2)
    np.testing.assert_array_equal(none.log_class_likelihood, 0.0)


def test_values_out_of_range_are_counted_by_attribute():
    stage = fuzzifier(**DECLARED, attribute_minimum=[0.5, 0.0], attribute_maximum=[100.0, 500.0])
    stage(with_length([1.0, 1e9, np.nan], [0.1, -4.0, np.nan], range_rate_mps=np.zeros(3)))
    # What is not known is not counted; the RCS that is no number comes marked as valid here.
    assert stage.counters == {"rcs_m2_out_of_range": 2, "length_m_out_of_range": 2}


def test_fusion_finds_the_prior_behind_the_evidence():
    """Also where every detection all but excludes a class."""
    prior = [0.1, 0.2, 0.3, 0.4]
    stage = fuzzifier(**{**DECLARED, "class_prior": prior})
    evidence = stage(with_length([0.1, 2.0], [1.4, 16.0], range_rate_mps=np.array([390.0, -390.0])))
    assert np.ptp(evidence.log_class_likelihood, axis=1).min() == 500.0
    np.testing.assert_allclose(class_prior(evidence), prior, rtol=1e-9)


@pytest.mark.parametrize("rule", ["dsm_classic", "dempster"])
@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_fusion_takes_evidence_on_unions_and_intersections(term, rule):
    stage = fuzzifier(**DECLARED, attribute_reliability=[0.9, 0.9], attribute_rule=rule)
    rate = np.array([20.0, -200.0])
    evidence = stage(with_length([0.1, 2.0], [1.4, 16.0], range_rate_mps=rate))
    history = fuse_pairs(
        term,
        evidence.frame,
        evidence.focal,
        evidence.masses,
        evidence.class_probability,
        evidence,
        np.array([0, 1], dtype=np.int32),
    )
    assert np.isfinite(history.log_likelihood).all()
    if term == "none":
        return
    assert history.class_probability.argmax(axis=1).tolist() == [1, 2]
    np.testing.assert_allclose(history.class_probability.sum(axis=1), 1.0, atol=1e-12)
    if history.masses.size:
        np.testing.assert_allclose(history.masses.sum(axis=1), 1.0, atol=1e-12)


ONE = {
    "attribute_names": ["length_m"],
    "attribute_models": ["gaussian"],
    "attribute_numbers": [1.0, 1.0, 5.0, 2.0, 30.0, 9.0],
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"attribute_names": ["a", "a"]}, "attribute_names = .*: allowed is at most 8 names that"),
        ({"attribute_names": [""]}, "attribute_names = .*: allowed is at most 8 names that differ"),
        ({"attribute_names": list("abcdefghi")}, "attribute_names = .*: allowed is at most 8"),
        ({"attribute_names": ["rcs_m2"]}, "attribute_names = .*: allowed is names other than rcs"),
        ({"attribute_models": []}, "attribute_models = .*one entry per attribute, 1 in all"),
        (
            {"attribute_models": ["triangle"]},
            "attribute_models = .*: allowed is a list, each one of gaussian, lognormal, trapezoid",
        ),
        (
            {"attribute_numbers": [1.0, 1.0, 5.0]},
            "attribute_numbers = .*: allowed is a list of 6 numbers, 2 for each of 3 classes of",
        ),
        (
            {"attribute_numbers": [1.0, 1.0, 5.0, -2.0, 30.0, 9.0]},
            "attribute_numbers = .*: allowed is for length_m, gaussian: a mean and a standard dev",
        ),
        (
            {"attribute_models": ["confusion_matrix"], "attribute_numbers": [0.4] * 9},
            "attribute_numbers = .*: allowed is for length_m, confusion_matrix: chances",
        ),
        (
            {"attribute_unknown_classes": ["length_m/drone"]},
            "attribute_unknown_classes = .*a list of attribute/class, length_m/false_alarm, length",
        ),
        (
            {"attribute_unknown_classes": ["length_m/false_alarm", "length_m/cargo"]},
            "attribute_unknown_classes = .*: allowed is pairs that leave two classes",
        ),
        ({"attribute_reliability": [1.5]}, "attribute_reliability = .*each a number >= 0 and <= 1"),
        (
            {"attribute_reliability": [1.0, 1.0]},
            "attribute_reliability = .*one entry per attribute",
        ),
        ({"attribute_minimum": [1.0, 1.0]}, "attribute_minimum = .*one entry per attribute"),
        (
            {"attribute_minimum": [5.0], "attribute_maximum": [5.0]},
            r"attribute_maximum = \[5.0\]: allowed is numbers > attribute_minimum = \[5.0\]",
        ),
        ({"attribute_rule": "pcr5"}, "attribute_rule = 'pcr5': allowed is one of dsm_classic"),
        ({"rcs_reliability": -0.1}, "rcs_reliability = -0.1: allowed is a number >= 0 and <= 1"),
        ({"attribute_names": []}, "attribute_models = .*one entry per attribute, 0 in all"),
    ],
)
def test_wrong_declarations_are_named_in_one_line(changes, message):
    with pytest.raises(ParameterError, match=message) as error:
        from_mapping(RcsFuzzifierParameters, {**ONE, **changes})
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_numbers_without_an_attribute_are_refused():
    with pytest.raises(ParameterError, match="attribute_numbers = .*a list of 0 numbers"):
        from_mapping(RcsFuzzifierParameters, {"attribute_numbers": [1.0]})
