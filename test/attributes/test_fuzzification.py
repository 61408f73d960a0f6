import numpy as np
import pytest
from attribute_examples import FOUR, KEY, scan_of

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.rcs import density, log_density
from gda_tracker.evidence.frames import element_name
from gda_tracker.parameters import ParameterError, from_mapping, to_mapping


def fuzzifier(**changes):
    return RcsFuzzifier(from_mapping(RcsFuzzifierParameters, changes))


def test_evidence_of_known_radar_cross_sections():
    stage = fuzzifier()
    rcs_m2 = np.array([0.02, 0.4, 1.1, 5.0, 25.0])
    evidence = stage(scan_of(rcs_m2))
    assert evidence.key == KEY
    assert evidence.frame == ("VS", "S", "B")
    assert [element_name(evidence.frame, mask) for mask in evidence.focal] == [
        "VS",
        "S",
        "B",
        "VS|S|B",
    ]
    np.testing.assert_allclose(evidence.masses.sum(axis=1), 1.0, atol=1e-15)
    np.testing.assert_array_equal(evidence.masses[:, 3], 0.0)
    # Measurement belief: the grades, normalised to one.
    grades = stage.membership(rcs_m2)
    np.testing.assert_allclose(
        evidence.masses[:, :3], grades / grades.sum(axis=1, keepdims=True), atol=1e-15
    )
    assert evidence.masses[:, :3].argmax(axis=1).tolist() == [0, 0, 1, 2, 2]
    np.testing.assert_allclose(
        evidence.log_class_likelihood, log_density(rcs_m2[:, None], [0.3, 1.2, 4.0], [2, 3, 3])
    )
    assert evidence.informative.all()


def test_class_probability_is_the_prior_updated_by_the_densities():
    stage = fuzzifier(class_prior=[0.2, 0.2, 0.6])
    rcs_m2 = np.array([0.1, 1.0, 8.0])
    weight = np.array([0.2, 0.2, 0.6]) * density(rcs_m2[:, None], [0.3, 1.2, 4.0], [2, 3, 3])
    np.testing.assert_allclose(
        stage(scan_of(rcs_m2)).class_probability,
        weight / weight.sum(axis=1, keepdims=True),
        rtol=1e-12,
    )


def test_by_default_a_track_is_no_false_alarm():
    for stage in (fuzzifier(), fuzzifier(class_prior=[])):
        np.testing.assert_array_equal(stage.prior, [0.0, 0.5, 0.5])
        assert (stage(scan_of([0.01, 3.0])).class_probability[:, 0] == 0.0).all()


@pytest.mark.parametrize("rcs_m2", [np.nan, np.inf, -np.inf, 0.0, -2.0, 1e-9, 1e7])
def test_a_radar_cross_section_out_of_range_is_unknown(rcs_m2):
    evidence = fuzzifier()(scan_of([rcs_m2, 1.0]))
    assert evidence.informative.tolist() == [False, True]
    np.testing.assert_array_equal(evidence.masses[0], [0, 0, 0, 1])
    np.testing.assert_array_equal(evidence.log_class_likelihood[0], 0.0)
    np.testing.assert_array_equal(evidence.class_probability[0], [0.0, 0.5, 0.5])
    alone = fuzzifier()(scan_of([1.0]))
    np.testing.assert_array_equal(evidence.masses[1], alone.masses[0])


def test_an_invalid_radar_cross_section_is_unknown_whatever_its_value():
    evidence = fuzzifier()(scan_of([1.0, 1.0], [False, True]))
    assert evidence.informative.tolist() == [False, True]
    np.testing.assert_array_equal(evidence.masses[0], [0, 0, 0, 1])


def test_the_valid_range_is_a_parameter():
    evidence = fuzzifier(rcs_min_m2=0.5, rcs_max_m2=2.0)(scan_of([0.4, 0.5, 2.0, 2.1]))
    assert evidence.informative.tolist() == [False, True, True, False]


@pytest.mark.parametrize("membership", ["histogram", "density"])
@pytest.mark.parametrize("n", [0, 1, 7])
def test_shapes_and_types(membership, n):
    evidence = fuzzifier(membership=membership, **FOUR)(scan_of(np.linspace(0.01, 9.0, n)))
    for array, shape in (
        (evidence.masses, (n, 5)),
        (evidence.log_class_likelihood, (n, 4)),
        (evidence.class_probability, (n, 4)),
    ):
        assert array.shape == shape
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
    assert evidence.informative.shape == (n,)
    assert evidence.informative.dtype == np.bool_
    assert evidence.focal.dtype == np.uint32


def test_the_scan_is_left_as_it_is():
    scan = scan_of([np.nan, 1.0])
    fuzzifier()(scan)
    np.testing.assert_array_equal(scan.rcs_m2, [np.nan, 1.0])
    assert scan.rcs_valid.all()


def test_detections_do_not_influence_each_other():
    rcs_m2 = np.array([0.1, np.nan, 2.0, 40.0])
    stage, order = fuzzifier(), np.array([2, 0, 3, 1])
    one, other = stage(scan_of(rcs_m2)), stage(scan_of(rcs_m2[order]))
    np.testing.assert_array_equal(one.masses[order], other.masses)
    np.testing.assert_array_equal(one.class_probability[order], other.class_probability)


def test_density_membership_is_the_bayesian_share_of_each_class():
    rcs_m2 = np.array([0.2, 2.0])
    evidence = fuzzifier(membership="density")(scan_of(rcs_m2))
    share = density(rcs_m2[:, None], [0.3, 1.2, 4.0], [2, 3, 3])
    np.testing.assert_allclose(
        evidence.masses[:, :3], share / share.sum(axis=1, keepdims=True), rtol=1e-12
    )


def test_extreme_values_stay_finite():
    stage = fuzzifier(class_rcs_mean_m2=[1e-6, 1.0, 1e9], membership="density")
    evidence = stage(scan_of([1e-6, 1e6]))
    for array in (evidence.masses, evidence.log_class_likelihood, evidence.class_probability):
        assert np.isfinite(array).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"class_labels": ["VS", "S", "B|C"]}, "class_labels = .*: allowed is names that differ"),
        ({"class_labels": ["VS", "S", "S"]}, "class_labels = .*: allowed is names that differ"),
        ({"class_labels": ["VS", "S"]}, "class_labels = .*one entry per class, 3 in all"),
        ({"class_rcs_mean_m2": [0.3, 1.2]}, "class_rcs_mean_m2 = .*one entry per class, 3 in all"),
        ({"class_rcs_mean_m2": [0.3, -1.2, 4.0]}, "class_rcs_mean_m2 = .*each a number >= 1e-06"),
        ({"class_rcs_swerling": [2, 3, 5]}, "class_rcs_swerling = .*>= 1 and <= 4"),
        ({"class_rcs_swerling": [2, 3]}, "class_rcs_swerling = .*one entry per class, 3 in all"),
        ({"class_names": ["a", "b", "a"]}, "class_names = .*: allowed is 2 to 4 names that differ"),
        ({"class_names": ["a"]}, "class_names = .*: allowed is 2 to 4 names"),
        ({"class_names": list("abcde")}, "class_names = .*: allowed is 2 to 4 names"),
        ({"class_prior": [0.5, 0.5]}, "class_prior = .*one entry per class, 3 in all, or an empty"),
        ({"class_prior": [0.0, 0.0, 0.0]}, "class_prior = .*sum > 0"),
        ({"class_prior": [-1.0, 1.0, 1.0]}, "class_prior = .*each a number >= 0"),
        (
            {"membership": "triangle"},
            "membership = 'triangle': allowed is one of histogram, density",
        ),
        ({"rcs_min_m2": 5.0, "rcs_max_m2": 2.0}, "rcs_max_m2 = 2.0: allowed is a number > rcs_min"),
        ({"histogram_bin_width_m2": 1e-9}, "histogram_bin_width_m2 = 1e-09: .*1 to 100000 bins"),
        ({"histogram_bin_width_m2": 31.0}, "histogram_bin_width_m2 = 31.0: .*1 to 100000 bins"),
        ({"class_mean": [1.0]}, "parameter class_mean: unknown"),
    ],
)
def test_wrong_parameters_are_named_in_one_line(changes, message):
    with pytest.raises(ParameterError, match=message) as error:
        from_mapping(RcsFuzzifierParameters, changes)
    assert "\n" not in str(error.value)


def test_values_out_of_range_are_refused_without_a_mapping_too():
    with pytest.raises(ParameterError, match="class_rcs_mean_m2"):
        RcsFuzzifierParameters(class_rcs_mean_m2=[0.3, -1.2, 4.0])


def test_parameters_go_through_a_mapping_unchanged():
    parameters = from_mapping(RcsFuzzifierParameters, FOUR)
    assert from_mapping(RcsFuzzifierParameters, to_mapping(parameters)) == parameters
    assert parameters.prior == [0.0, 1 / 3, 1 / 3, 1 / 3]
