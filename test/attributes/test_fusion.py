import numpy as np
import pytest
from attribute_examples import KEY, predictions_of, scan_of
from dictionary_rules import assert_same, atom, conjunctive, dempster, from_row, shafer_parts
from dictionary_rules import pignistic as dictionary_pignistic
from dictionary_rules import project as dictionary_project
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes.frames import element_name, parse_element
from gda_tracker.attributes.fusion import (
    AttributeFusion,
    AttributeFusionParameters,
    class_prior,
    fuse_pairs,
)
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.vocabulary import ScanKey

FRAME, CLASSES = ("VS", "S", "B"), ("false_alarm", "fighter", "cargo")
EIGHT = ["VS", "S", "B", "VS&S", "VS&B", "S&B", "VS&S&B", "VS|S|B"]
MASS_TERMS = ("dsm_classic", "dempster")


@pytest.fixture(scope="module")
def fuzzifier():
    return RcsFuzzifier(RcsFuzzifierParameters())


@pytest.fixture(scope="module")
def evidence(fuzzifier):
    """Five detections, the fourth without an RCS."""
    return fuzzifier(scan_of([0.15, 1.0, 6.0, np.nan, 2.5]))


def stage(**changes):
    return AttributeFusion(from_mapping(AttributeFusionParameters, changes))


def columns(texts, frame=FRAME):
    return np.array([parse_element(frame, text) for text in texts], dtype=np.uint32)


def histories(term, h=4, texts=EIGHT, seed=1):
    """Predictions with histories that have seen several scans."""
    random = np.random.default_rng(seed)
    return predictions_of(
        term,
        h,
        frame=FRAME,
        focal=columns(texts),
        masses=random.dirichlet(np.ones(len(texts)), h),
        class_names=CLASSES,
        class_probability=np.hstack([np.zeros((h, 1)), random.dirichlet(np.ones(2), h)]),
    )


def all_pairs(h, n):
    return (
        np.repeat(np.arange(h, dtype=np.int32), n),
        np.tile(np.arange(n, dtype=np.int32), h),
    )


# --- what every term answers ------------------------------------------------------------------


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
@pytest.mark.parametrize(("h", "n"), [(4, 5), (4, 0), (0, 5), (0, 0)])
def test_shapes_types_and_layout(fuzzifier, term, h, n):
    scan_evidence = fuzzifier(scan_of(np.linspace(0.1, 5.0, n)))
    hypothesis, detection = all_pairs(h, n)
    for predictions in (histories(term, h), predictions_of(term, h)):
        scores = stage()(predictions, scan_evidence, hypothesis, detection)
        pairs, width = h * n, {"dsm_classic": 8, "dempster": 4}.get(term, 0)
        assert scores.key == KEY
        assert scores.attribute_term == term
        assert scores.has_distance is (term in DISTANCE_TERMS)
        assert (scores.frame, scores.class_names) == (FRAME, CLASSES)
        width = len(scores.focal) if term == "dempster" else width
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
    scores = stage(forgetting_factor=forgetting_factor)(
        predictions, evidence, hypothesis, detection
    )
    unknown = detection == 3
    assert not scores.informative[unknown].any()
    for array in (scores.distance, scores.log_likelihood, scores.conflict):
        np.testing.assert_array_equal(array[unknown], 0.0)
    assert scores.clutter_log_likelihood[3] == 0.0
    if term in MASS_TERMS:
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
    scores = stage(forgetting_factor=0.5)(predictions, evidence, *all_pairs(4, 5))
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


def test_wrong_forgetting_factor_is_named():
    with pytest.raises(ParameterError, match="forgetting_factor = 1.5: allowed is a number >= 0"):
        stage(forgetting_factor=1.5)


# --- the terms with masses ----------------------------------------------------------------------


def test_classic_term_on_one_pair_by_hand(evidence):
    predictions = predictions_of(
        "dsm_classic",
        1,
        frame=FRAME,
        focal=columns(["S", "VS|S|B"]),
        masses=np.array([[0.6, 0.4]]),
        class_names=CLASSES,
        class_probability=np.array([[0.0, 0.5, 0.5]]),
    )
    pair = np.zeros(1, dtype=np.int32), np.full(1, 4, dtype=np.int32)
    scores = stage()(predictions, evidence, *pair)
    vs, s, b, _ = evidence.masses[4]
    expected = [0.4 * vs, 0.6 * s + 0.4 * s, 0.4 * b, 0.6 * vs, 0, 0.6 * b, 0, 0]
    assert [element_name(FRAME, mask) for mask in scores.focal] == EIGHT
    np.testing.assert_allclose(scores.masses[0], expected, atol=1e-15)
    history = np.array([0, 0.6, 0, 0, 0, 0, 0, 0.4])
    assert scores.distance[0] == pytest.approx(np.linalg.norm(np.array(expected) - history))
    assert scores.conflict[0] == pytest.approx(0.6 * (vs + b))
    # BetP of the history on Shafer's model: S .6 + .4/3, the others .4/3.
    probability = np.array([0.4 / 3, 0.6 + 0.4 / 3, 0.4 / 3])
    assert scores.log_likelihood[0] == pytest.approx(
        np.log(probability @ np.exp(evidence.log_class_likelihood[4]))
    )
    # BetP of the candidate: VS & S counts for VS and S alike.
    np.testing.assert_allclose(
        scores.class_probability[0],
        [0.4 * vs + 0.3 * vs, s + 0.3 * vs + 0.3 * b, 0.4 * b + 0.3 * b],
        atol=1e-15,
    )
    assert scores.clutter_log_likelihood[4] == evidence.log_class_likelihood[4, 0]


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_terms_with_masses_agree_with_dictionaries(fuzzifier, seed):
    random = np.random.default_rng(seed)
    evidence = fuzzifier(scan_of(random.gamma(1.5, 1.5, 4)))
    hypothesis, detection = all_pairs(3, 4)
    alive = shafer_parts(FRAME)
    for term in MASS_TERMS:
        predictions = histories(term, 3, seed=seed)
        scores = stage()(predictions, evidence, hypothesis, detection)
        for row, (i, j) in enumerate(zip(hypothesis, detection, strict=True)):
            history = from_row(FRAME, predictions.focal, predictions.masses[i])
            measured = from_row(FRAME, evidence.focal, evidence.masses[j])
            found = from_row(FRAME, scores.focal, scores.masses[row])
            if term == "dsm_classic":
                candidate = conjunctive(history, measured)
            else:
                history = dictionary_project(FRAME, history, alive)
                candidate, conflict = dempster(FRAME, history, measured)
                found = {x & alive: m for x, m in found.items()}
                assert scores.conflict[row] == pytest.approx(conflict, abs=1e-12)
            assert_same(found, candidate)
            elements = candidate.keys() | history.keys()
            distance = sum((candidate.get(x, 0) - history.get(x, 0)) ** 2 for x in elements) ** 0.5
            assert scores.distance[row] == pytest.approx(distance, abs=1e-12)
            betp = [
                dictionary_pignistic(
                    dictionary_project(FRAME, candidate, alive), alive, atom(FRAME, name)
                )
                for name in FRAME
            ]
            np.testing.assert_allclose(scores.class_probability[row], betp, atol=1e-12)


def test_dempster_in_total_conflict_keeps_the_history(fuzzifier):
    evidence = fuzzifier(scan_of([100.0, 1.0]))  # beyond the histograms: surely big
    predictions = predictions_of(
        "dempster",
        1,
        frame=FRAME,
        focal=columns(["VS", "S"]),
        masses=np.array([[0.3, 0.7]]),
        class_names=CLASSES,
        class_probability=np.array([[0.0, 0.5, 0.5]]),
    )
    scores = stage()(predictions, evidence, *all_pairs(1, 2))
    assert scores.conflict[0] == 1.0
    assert scores.distance[0] == 0.0
    assert scores.distance[1] > 0.0
    found = from_row(FRAME, scores.focal, scores.masses[0])
    assert_same(found, {atom(FRAME, "VS"): 0.3, atom(FRAME, "S"): 0.7})


def test_columns_of_a_history_stay_from_scan_to_scan(evidence):
    for term, names in (("dsm_classic", EIGHT), ("dempster", ["VS", "S", "B", "VS|S|B"])):
        predictions = predictions_of(term, 3, frame=FRAME, class_names=CLASSES)
        predictions.class_probability = np.tile([0.0, 0.5, 0.5], (3, 1))
        for _ in range(4):
            scores = stage()(predictions, evidence, *all_pairs(3, 5))
            written = [element_name(FRAME, mask) for mask in scores.focal]
            # A vacuous history against singletons already closes under intersection.
            assert written == names
            predictions.focal, predictions.masses = scores.focal, scores.masses[:3]
            predictions.class_probability = scores.class_probability[:3]


def test_a_change_of_term_keeps_what_was_believed(evidence):
    hypothesis, detection = all_pairs(4, 5)
    predictions = histories("dsm_classic")
    scores = stage()(predictions, evidence, hypothesis, detection)
    # The candidates become the histories of dempster, which sees them on Shafer's model.
    follow = histories("dempster", len(hypothesis))
    follow.focal, follow.masses = scores.focal, scores.masses
    unknown = np.full(len(hypothesis), 3, dtype=np.int32)
    rows = np.arange(len(hypothesis), dtype=np.int32)
    kept = stage()(follow, evidence, rows, unknown)
    np.testing.assert_allclose(kept.class_probability, scores.class_probability, atol=1e-12)


def test_forgetting_discounts_the_history_before_it_is_fused(evidence):
    pair = np.zeros(1, dtype=np.int32), np.full(1, 2, dtype=np.int32)
    forgetful, faithful = (
        stage(forgetting_factor=f)(histories("dsm_classic", 1), evidence, *pair) for f in (0.8, 1.0)
    )
    fresh = stage()(predictions_of("dsm_classic", 1), evidence, *pair)
    np.testing.assert_allclose(
        forgetful.masses, 0.8 * faithful.masses + 0.2 * fresh.masses, atol=1e-14
    )


def test_forgetting_keeps_the_distance_alive(fuzzifier):
    """Without it the history drifts into the total intersection and no detection moves it."""
    evidence = fuzzifier(scan_of([1.0]))
    distance = {}
    for factor in (1.0, 0.7):
        predictions = predictions_of("dsm_classic", 1, frame=FRAME, class_names=CLASSES)
        predictions.class_probability = np.array([[0.0, 0.5, 0.5]])
        for _ in range(25):
            pair = np.zeros(1, dtype=np.int32)
            scores = stage(forgetting_factor=factor)(predictions, evidence, pair, pair)
            predictions.focal, predictions.masses = scores.focal, scores.masses
        distance[factor] = scores.distance[0]
    assert distance[1.0] < 0.02
    assert distance[0.7] > 0.1


# --- the other terms ------------------------------------------------------------------------------


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
    scores = stage(forgetting_factor=0.9)(predictions, evidence, *pair)
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
    if term in MASS_TERMS:
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
    for term in ("dsm_classic", "dempster", "bayes"):
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
            columns_expected = {"dsm_classic": 2**k, "dempster": k + 1}.get(term, 0)
            assert len(scores.focal) == columns_expected
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
