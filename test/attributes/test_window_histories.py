"""History windows in the fusion stage: against brute force, hypothesis by hypothesis."""

from dataclasses import replace

import numpy as np
import pytest
from attribute_examples import predictions_of, scan_of
from dictionary_rules import assert_same, combine, from_row, project, reduced, shafer_parts
from fusion_examples import CLASSES, FRAME, all_pairs, columns, stage

from gda_tracker.attributes.class_terms import class_prior
from gda_tracker.attributes.fusion import fuse_pairs
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS, RULE_OF_TERM
from gda_tracker.attributes.window_histories import Windows, window_histories
from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.vocabulary.hypotheses import BELIEF_ROW, EVIDENCE_ROW

TERMS = [term for term in ATTRIBUTE_TERMS if term != "none"]
THETA = total_ignorance(3)
TRANSITION = np.array([[1.0, 0.0, 0.1], [0.0, 0.7, 0.2], [0.0, 0.3, 0.7]])


@pytest.fixture(scope="module")
def fuzzifier():
    return RcsFuzzifier(RcsFuzzifierParameters(class_prior=[0.2, 0.3, 0.5]))


@pytest.fixture(scope="module")
def evidence(fuzzifier):
    """Five detections, the fourth without an RCS."""
    return fuzzifier(scan_of([0.15, 1.0, 6.0, np.nan, 2.5]))


@pytest.fixture(scope="module")
def past(fuzzifier):
    """Evidence of many earlier detections."""
    return fuzzifier(scan_of(np.random.default_rng(3).gamma(2.0, 1.0, 200)))


def windows_of(past, lengths, rows, beliefs=()):
    """Windows with so many rows of the past, the oldest of some being a belief."""
    focal = columns(["S", "B", "VS", "VS|S|B", "S&B", "VS&S&B"])
    random = np.random.default_rng(len(lengths) + rows)
    count, classes = len(lengths), len(past.class_names)
    kind = np.zeros((count, rows), dtype=np.int32)
    masses = np.zeros((count, rows, len(focal)))
    likelihood = np.zeros((count, rows, classes))
    place = [focal.tolist().index(mask) for mask in past.focal.tolist()]
    for h, length in enumerate(lengths):
        for row in range(rows - length, rows):
            chosen = random.integers(len(past.masses))
            kind[h, row] = EVIDENCE_ROW
            masses[h, row, place] = past.masses[chosen]
            likelihood[h, row] = past.log_class_likelihood[chosen]
        if h in beliefs:  # without the class that it rules out
            kind[h, rows - length] = BELIEF_ROW
            masses[h, rows - length] = random.dirichlet(np.ones(len(focal)))
            likelihood[h, rows - length] = [
                -np.inf,
                *np.log(random.dirichlet(np.ones(classes - 1))),
            ]
    return Windows(focal, kind, masses, likelihood)


def classes_by_hand(windows, h, prior, transition):
    """Mahler 2011, (93) and (94), in probabilities, one row after the other."""
    probability = prior
    begun = False
    for kind, row in zip(windows.kind[h], windows.log_class_likelihood[h], strict=True):
        if kind == BELIEF_ROW:
            probability, begun = np.exp(row), True
        elif kind == EVIDENCE_ROW:
            predicted = transition @ probability if begun else probability
            joint = predicted * np.exp(row)
            probability, begun = joint / joint.sum(), True
    return probability


def masses_by_dictionaries(term, windows, h):
    """The rule of a term on dictionaries, one row after the other."""
    alive = shafer_parts(FRAME)
    rows = [
        from_row(FRAME, windows.focal, windows.masses[h, row])
        for row in np.flatnonzero(windows.kind[h])
    ]
    history = rows.pop(0) if rows else from_row(FRAME, [THETA], [1.0])
    if term != "dsm_classic":
        history, rows = project(FRAME, history, alive), [reduced(row, alive) for row in rows]
    for row in rows:
        history, _ = combine(RULE_OF_TERM[term], FRAME, alive, [history, row])
    return history


def dictionary_of(term, focal, row):
    """Masses as the term means them: on Shafer's model for all but classic DSm."""
    found = from_row(FRAME, focal, row)
    if term == "dsm_classic":
        return found
    return project(FRAME, found, shafer_parts(FRAME))


def predictions_with(term, windows, policy="window"):
    count, rows = windows.kind.shape
    predictions = predictions_of(
        term,
        count,
        frame=FRAME,
        focal=columns(["VS", "S", "B", "VS|S|B"]),
        masses=np.random.default_rng(count).dirichlet(np.ones(4), count).reshape(count, 4),
        class_names=CLASSES,
        class_probability=np.random.default_rng(count).dirichlet(np.ones(3), count),
        window_focal=windows.focal if rows else np.zeros(0, dtype=np.uint32),
        window_kind=windows.kind,
        window_masses=windows.masses if rows else np.zeros((count, 0, 0)),
        window_log_class_likelihood=windows.log_class_likelihood,
    )
    predictions.settings = replace(predictions.settings, history_policy=policy)
    return predictions


# --- the histories ------------------------------------------------------------------------------


@pytest.mark.parametrize("term", DISTANCE_TERMS)
@pytest.mark.parametrize("rows", [1, 2, 5])
def test_masses_are_those_of_one_row_after_the_other(past, term, rows):
    """Full windows, shorter ones, empty ones; with and without a belief as the oldest row."""
    lengths = [rows, rows, max(rows - 1, 0), 1, 0, rows]
    windows = windows_of(past, lengths, rows, beliefs=(1, 3))
    prior = np.array([0.2, 0.3, 0.5])
    focal, masses, classes = window_histories(term, FRAME, windows, prior)
    for h in range(len(lengths)):
        found = dictionary_of(term, focal, masses[h])
        assert_same(found, masses_by_dictionaries(term, windows, h))
    np.testing.assert_array_equal(classes, np.tile(prior, (len(lengths), 1)))


@pytest.mark.parametrize("transition", [None, TRANSITION])
def test_classes_are_those_of_one_row_after_the_other(past, transition):
    windows = windows_of(past, [4, 4, 3, 1, 1, 0], 4, beliefs=(1, 3))
    prior = np.array([0.2, 0.3, 0.5])
    focal, masses, classes = window_histories("bayes", FRAME, windows, prior, transition)
    assert (len(focal), masses.shape) == (0, (6, 0))
    matrix = np.eye(3) if transition is None else transition
    for h in range(6):
        expected = classes_by_hand(windows, h, prior, matrix)
        np.testing.assert_allclose(classes[h], expected, rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("term", TERMS)
def test_each_window_is_fused_by_itself(past, term):
    """Rows of other hypotheses change nothing but rounding."""
    lengths = [3, 0, 2, 1, 3]
    windows = windows_of(past, lengths, 3, beliefs=(2,))
    prior = np.array([0.2, 0.3, 0.5])
    focal, masses, classes = window_histories(term, FRAME, windows, prior)
    for h in range(len(lengths)):
        one = Windows(
            windows.focal,
            windows.kind[h : h + 1],
            windows.masses[h : h + 1],
            windows.log_class_likelihood[h : h + 1],
        )
        alone = window_histories(term, FRAME, one, prior)
        assert_same(
            from_row(FRAME, focal, masses[h]) if len(focal) else {},
            from_row(FRAME, alone[0], alone[1][0]) if len(focal) else {},
        )
        np.testing.assert_allclose(alone[2][0], classes[h], rtol=1e-12)


# --- the stage ----------------------------------------------------------------------------------


@pytest.mark.parametrize("term", TERMS)
def test_pairs_meet_the_history_of_their_window(past, evidence, term):
    """The same as the stage makes of predictions whose beliefs are these histories."""
    windows = windows_of(past, [4, 2, 0, 4], 4, beliefs=(1,))
    predictions = predictions_with(term, windows)
    hypothesis, detection = all_pairs(4, 5)
    known = detection != 3
    scores = stage()(predictions, evidence, hypothesis[known], detection[known])
    histories = window_histories(term, FRAME, windows, class_prior(evidence))
    expected = fuse_pairs(
        term,
        FRAME,
        histories[0],
        histories[1][hypothesis[known]],
        histories[2][hypothesis[known]],
        evidence,
        detection[known],
    )
    for name in ("masses", "class_probability", "distance", "log_likelihood", "conflict"):
        np.testing.assert_allclose(getattr(scores, name), getattr(expected, name), atol=1e-14)
    np.testing.assert_array_equal(scores.focal, expected.focal)


@pytest.mark.parametrize("term", TERMS)
def test_a_window_of_one_detection_is_that_detection(past, evidence, term):
    windows = windows_of(past, [0, 0], 0)
    predictions = predictions_with(term, windows)
    hypothesis, detection = all_pairs(2, 5)
    scores = stage()(predictions, evidence, hypothesis, detection)
    known = detection != 3
    if term == "bayes":
        expected = evidence.class_probability[detection]
        found = scores.class_probability
        np.testing.assert_allclose(found[known], expected[known], rtol=1e-9)
        return
    for row in np.flatnonzero(known):
        found = from_row(FRAME, scores.focal, scores.masses[row])
        expected = from_row(FRAME, evidence.focal, evidence.masses[detection[row]])
        assert_same(found, expected)
    np.testing.assert_allclose(scores.conflict, 0.0, atol=1e-15)


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("rows", [0, 3])
def test_an_unknown_attribute_leaves_the_belief_and_not_the_shorter_window(
    past, evidence, term, rows
):
    windows = windows_of(past, [rows, rows, 0], rows, beliefs=(0,) if rows else ())
    predictions = predictions_with(term, windows)
    hypothesis, detection = all_pairs(3, 5)
    scores = stage()(predictions, evidence, hypothesis, detection)
    unknown = np.flatnonzero(detection == 3)
    for name in ("distance", "log_likelihood", "conflict"):
        np.testing.assert_array_equal(getattr(scores, name)[unknown], 0.0)
    assert not scores.informative[unknown].any()
    for row in unknown:
        h = hypothesis[row]
        if term == "bayes":
            found, expected = scores.class_probability[row], predictions.class_probability[h]
            np.testing.assert_array_equal(found, expected)
        else:
            assert_same(
                dictionary_of(term, scores.focal, scores.masses[row]),
                dictionary_of(term, predictions.focal, predictions.masses[h]),
            )
    # The other pairs do not notice.
    known = detection != 3
    apart = stage()(predictions, evidence, hypothesis[known], detection[known])
    for name in ("distance", "log_likelihood", "conflict", "class_probability"):
        np.testing.assert_allclose(getattr(scores, name)[known], getattr(apart, name), atol=1e-14)


def test_an_unknown_attribute_of_a_hypothesis_without_belief(past, evidence):
    predictions = predictions_with("dsm_classic", windows_of(past, [2], 2))
    predictions.focal = np.zeros(0, dtype=np.uint32)
    predictions.masses = np.zeros((1, 0))
    scores = stage()(predictions, evidence, *all_pairs(1, 5))
    assert_same(from_row(FRAME, scores.focal, scores.masses[3]), from_row(FRAME, [THETA], [1.0]))


@pytest.mark.parametrize("policy", ["none", "forgetting"])
def test_windows_act_with_their_policy_alone(past, evidence, policy):
    windows = windows_of(past, [4, 2], 4)
    scores = stage()(predictions_with("dsm_classic", windows, policy), evidence, *all_pairs(2, 5))
    bare = predictions_with("dsm_classic", windows_of(past, [0, 0], 0), policy)
    expected = stage()(bare, evidence, *all_pairs(2, 5))
    np.testing.assert_array_equal(scores.masses, expected.masses)


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_windows_of_other_classes_or_of_no_pairs(past, evidence, term):
    predictions = predictions_with(term, windows_of(past, [2, 2], 2))
    none = np.zeros(0, dtype=np.int32)
    assert len(stage()(predictions, evidence, none, none).distance) == 0
    predictions.class_names = ("false_alarm", "bird", "cargo")
    scores = stage()(predictions, evidence, *all_pairs(2, 5))
    foreign = stage()(predictions_of(term, 2), evidence, *all_pairs(2, 5))
    np.testing.assert_array_equal(scores.masses, foreign.masses)
    np.testing.assert_array_equal(scores.class_probability, foreign.class_probability)


def test_the_inputs_are_left_as_they_are(past, evidence):
    for term in TERMS:
        windows = windows_of(past, [3, 1], 3, beliefs=(1,))
        predictions = predictions_with(term, windows)
        before = [values.copy() for values in (windows.kind, windows.masses, predictions.masses)]
        scores = stage()(predictions, evidence, *all_pairs(2, 5))
        scores.masses[:] = -1.0
        after = (windows.kind, windows.masses, predictions.masses)
        for old, new in zip(before, after, strict=True):
            np.testing.assert_array_equal(old, new)
