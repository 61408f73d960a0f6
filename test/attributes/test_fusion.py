from dataclasses import replace

import numpy as np
import pytest
from attribute_examples import KEY, predictions_of, scan_of
from dictionary_rules import assert_same, from_row
from fusion_examples import CLASSES, FRAME, all_pairs, forgetful, histories, stage

from gda_tracker.attributes.fusion import class_prior, fuse_pairs
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.vocabulary import ScanKey


@pytest.fixture(scope="module")
def fuzzifier():
    return RcsFuzzifier(RcsFuzzifierParameters())


@pytest.fixture(scope="module")
def evidence(fuzzifier):
    """Five detections, the fourth without an RCS."""
    return fuzzifier(scan_of([0.15, 1.0, 6.0, np.nan, 2.5]))


# --- what every term answers ------------------------------------------------------------------


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
@pytest.mark.parametrize(("h", "n"), [(4, 5), (4, 0), (0, 5), (0, 0)])
def test_shapes_types_and_layout(fuzzifier, term, h, n):
    scan_evidence = fuzzifier(scan_of(np.linspace(0.1, 5.0, n)))
    hypothesis, detection = all_pairs(h, n)
    for predictions in (histories(term, h), predictions_of(term, h)):
        scores = stage()(predictions, scan_evidence, hypothesis, detection)
        pairs, width = h * n, len(scores.focal)
        assert scores.key == KEY
        assert scores.attribute_term == term
        assert scores.has_distance is (term in DISTANCE_TERMS)
        assert (scores.frame, scores.class_names) == (FRAME, CLASSES)
        assert (width > 0) is (term in DISTANCE_TERMS)
        for array, shape, kind in (
            (scores.hypothesis, (pairs,), np.int32),
            (scores.detection, (pairs,), np.int32),
            (scores.distance, (pairs,), np.float64),
            (scores.log_likelihood, (pairs,), np.float64),
            (scores.conflict, (pairs,), np.float64),
            (scores.informative, (pairs,), np.bool_),
            (scores.clutter_log_likelihood, (n,), np.float64),
            (scores.focal, (width,), np.uint32),
            (scores.masses, (pairs, width), np.float64),
            (scores.class_probability, (pairs, 3), np.float64),
        ):
            assert array.shape == shape
            assert array.dtype == kind
            assert array.flags.c_contiguous
            assert array.dtype == np.bool_ or np.isfinite(array).all()
        np.testing.assert_allclose(scores.class_probability.sum(axis=1), 1.0, atol=1e-12)
        if width:
            np.testing.assert_allclose(scores.masses.sum(axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_permuted_pairs_give_permuted_scores(evidence, term):
    hypothesis, detection = all_pairs(4, 5)
    order = np.random.default_rng(5).permutation(len(hypothesis))
    one = stage()(histories(term), evidence, hypothesis, detection)
    other = stage()(histories(term), evidence, hypothesis[order], detection[order])
    for name in ("distance", "log_likelihood", "conflict", "masses", "class_probability"):
        np.testing.assert_allclose(
            getattr(one, name)[order], getattr(other, name), atol=1e-14, rtol=1e-14
        )
    np.testing.assert_array_equal(one.informative[order], other.informative)


@pytest.mark.parametrize("forgetting_factor", [1.0, 0.7])
@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_an_unknown_attribute_leaves_the_history_and_scores_nothing(
    evidence, term, forgetting_factor
):
    hypothesis, detection = all_pairs(4, 5)
    # The columns of Shafer's model carry no intersections for dempster to project.
    predictions = histories(term, texts=["VS", "S", "B", "VS|S|B"])
    scores = stage()(forgetful(predictions, forgetting_factor), evidence, hypothesis, detection)
    unknown = detection == 3
    assert not scores.informative[unknown].any()
    for array in (scores.distance, scores.log_likelihood, scores.conflict):
        np.testing.assert_array_equal(array[unknown], 0.0)
    assert scores.clutter_log_likelihood[3] == 0.0
    if term in DISTANCE_TERMS:
        for row in np.flatnonzero(unknown):
            assert_same(
                from_row(FRAME, scores.focal, scores.masses[row]),
                from_row(FRAME, predictions.focal, predictions.masses[hypothesis[row]]),
                tolerance=0.0,
            )
    else:
        np.testing.assert_array_equal(
            scores.class_probability[unknown], predictions.class_probability
        )
    if term != "none":
        assert scores.informative[~unknown].all()
        assert (scores.log_likelihood[~unknown] != 0.0).all()


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_the_inputs_are_left_as_they_are(evidence, term):
    predictions = histories(term)
    masses, beliefs = predictions.masses.copy(), predictions.class_probability.copy()
    measured = evidence.masses.copy(), evidence.log_class_likelihood.copy()
    scores = stage()(forgetful(predictions, 0.5), evidence, *all_pairs(4, 5))
    scores.masses[:] = -1.0
    scores.class_probability[:] = -1.0
    scores.clutter_log_likelihood[:] = -1.0
    np.testing.assert_array_equal(predictions.masses, masses)
    np.testing.assert_array_equal(predictions.class_probability, beliefs)
    np.testing.assert_array_equal(evidence.masses, measured[0])
    np.testing.assert_array_equal(evidence.log_class_likelihood, measured[1])


def test_wrong_term_and_foreign_evidence_are_refused(evidence):
    with pytest.raises(ValueError, match="attribute_term = 'pcr7': allowed is one of none, dsm_c"):
        stage()(histories("pcr7"), evidence, *all_pairs(4, 5))
    predictions = histories("bayes")
    predictions.key = ScanKey(3, "radar", 1)
    with pytest.raises(ValueError, match="for predictions of"):
        stage()(predictions, evidence, *all_pairs(4, 5))


def test_an_unknown_history_policy_is_refused(evidence):
    predictions = histories("bayes")
    predictions.settings = replace(predictions.settings, history_policy="oblivion")
    with pytest.raises(ValueError, match="'oblivion': allowed is one of none, forgetting, window"):
        stage()(predictions, evidence, *all_pairs(4, 5))


def test_a_forgetting_factor_acts_with_its_policy_alone(evidence):
    predictions = histories("dsm_classic")
    predictions.settings = replace(predictions.settings, forgetting_factor=0.3)
    scores = stage()(predictions, evidence, *all_pairs(4, 5))
    expected = stage()(histories("dsm_classic"), evidence, *all_pairs(4, 5))
    np.testing.assert_array_equal(scores.masses, expected.masses)


def test_without_attribute_nothing_is_scored_and_beliefs_pass(evidence):
    hypothesis, detection = all_pairs(4, 5)
    predictions = histories("none")
    scores = stage()(predictions, evidence, hypothesis, detection)
    assert not scores.informative.any()
    for array in (scores.distance, scores.log_likelihood, scores.clutter_log_likelihood):
        np.testing.assert_array_equal(array, 0.0)
    np.testing.assert_array_equal(
        scores.class_probability, predictions.class_probability[hypothesis]
    )


# --- histories of another frame -----------------------------------------------------------------


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
@pytest.mark.parametrize("changed", ["frame", "class_names", "nothing_yet"])
def test_histories_of_another_frame_count_as_vacuous(evidence, term, changed):
    hypothesis, detection = all_pairs(4, 5)
    fresh = stage()(predictions_of(term, 4), evidence, hypothesis, detection)
    predictions = histories(term)
    if changed == "frame":
        predictions.frame = ("VS", "S", "XL")
    elif changed == "class_names":
        predictions.class_names = ("false_alarm", "drone", "cargo")
    else:
        predictions = predictions_of(term, 4)
    scores = stage()(predictions, evidence, hypothesis, detection)
    for name in ("distance", "log_likelihood", "masses", "class_probability"):
        np.testing.assert_array_equal(getattr(scores, name), getattr(fresh, name))
    if term == "bayes":
        np.testing.assert_allclose(
            scores.class_probability, evidence.class_probability[detection], rtol=1e-12
        )
    if term in DISTANCE_TERMS:
        for row, j in enumerate(detection):
            assert_same(
                from_row(FRAME, scores.focal, scores.masses[row]),
                from_row(FRAME, evidence.focal, evidence.masses[j]),
            )


@pytest.mark.parametrize("prior", [[0.0, 0.5, 0.5], [0.1, 0.2, 0.7]])
def test_the_prior_is_found_behind_the_evidence(prior):
    stage_with_prior = RcsFuzzifier(RcsFuzzifierParameters(class_prior=prior))
    for rcs_m2 in ([1.0], [500.0, 0.3, 1e5], [np.nan, 3.0]):
        found = class_prior(stage_with_prior(scan_of(rcs_m2)))
        np.testing.assert_allclose(found, prior, rtol=1e-9)


def test_two_scans_make_a_first_history(fuzzifier):
    """Labelled initiation: the first scan's evidence is the history, the second one is fused."""
    first, second = fuzzifier(scan_of([0.9, 5.0])), fuzzifier(scan_of([1.3, 3.0]))
    rows = np.arange(2, dtype=np.int32)
    for term in (*DISTANCE_TERMS, "bayes"):
        beliefs = fuse_pairs(
            term, first.frame, first.focal, first.masses, first.class_probability, second, rows
        )
        assert beliefs.class_probability.argmax(axis=1).tolist() == [1, 2]
        if term == "bayes":
            joint = np.array([0, 0.5, 0.5]) * np.exp(
                first.log_class_likelihood + second.log_class_likelihood
            )
            np.testing.assert_allclose(
                beliefs.class_probability, joint / joint.sum(axis=1, keepdims=True), rtol=1e-12
            )
        else:
            np.testing.assert_allclose(beliefs.masses.sum(axis=1), 1.0, atol=1e-12)


def test_frames_of_two_and_four_elements():
    for k in (2, 4):
        table = RcsFuzzifierParameters(
            class_names=[f"class_{i}" for i in range(k)],
            class_rcs_mean_m2=[0.3 * 3**i for i in range(k)],
            class_rcs_swerling=[2] + [3] * (k - 1),
            class_labels=[f"L{i}" for i in range(k)],
            class_prior=[],
        )
        evidence = RcsFuzzifier(table)(scan_of([0.1, 1.0, 9.0]))
        hypothesis, detection = all_pairs(2, 3)
        for term in ATTRIBUTE_TERMS:
            predictions = predictions_of(term, 2)
            for _ in range(3):
                scores = stage()(predictions, evidence, hypothesis, detection)
                predictions.frame, predictions.class_names = scores.frame, scores.class_names
                predictions.focal, predictions.masses = scores.focal, scores.masses[[0, 5]]
                predictions.class_probability = scores.class_probability[[0, 5]]
            every_union = 2**k - 1
            columns_expected = {
                **dict.fromkeys(DISTANCE_TERMS, k + 1),
                "dsm_classic": 2**k,
                "dsm_hybrid": every_union,
                "dubois_prade": every_union,
            }
            assert len(scores.focal) == columns_expected.get(term, 0)
            np.testing.assert_allclose(scores.class_probability.sum(axis=1), 1.0, atol=1e-12)


def test_ten_thousand_pairs_are_the_same_as_one_by_one(fuzzifier):
    random = np.random.default_rng(2)
    evidence = fuzzifier(scan_of(random.gamma(2.0, 1.0, 200)))
    hypothesis = np.sort(random.integers(0, 100, 10_000)).astype(np.int32)
    detection = random.integers(0, 200, 10_000).astype(np.int32)
    for term in ATTRIBUTE_TERMS:
        predictions = histories(term, 100)
        scores = stage()(predictions, evidence, hypothesis, detection)
        for row in (0, 4321, 9999):
            alone = stage()(
                predictions, evidence, hypothesis[row : row + 1], detection[row : row + 1]
            )
            for name in ("distance", "log_likelihood", "conflict", "masses", "class_probability"):
                np.testing.assert_allclose(
                    getattr(scores, name)[row], getattr(alone, name)[0], rtol=1e-12, atol=1e-14
                )
