"""Terms with masses: by hand, against dictionaries, from one term to another."""

from dataclasses import replace

import numpy as np
import pytest
from attribute_examples import KEY, predictions_of, scan_of
from dictionary_rules import NoAnswer, assert_same, atom, combine, from_row, reduced, shafer_parts
from dictionary_rules import pignistic as dictionary_pignistic
from dictionary_rules import project as dictionary_project
from fusion_examples import CLASSES, EIGHT, FRAME, all_pairs, columns, forgetful, histories, stage
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS, RULE_OF_TERM
from gda_tracker.evidence.frames import element_name, hyper_power_set, shafer_model
from gda_tracker.vocabulary.beliefs import Evidence

ON_SHAFER = tuple(term for term in DISTANCE_TERMS if term != "dsm_classic")
FOUR = ("VS", "S", "B", "XL")


@pytest.fixture(scope="module")
def fuzzifier():
    return RcsFuzzifier(RcsFuzzifierParameters())


@pytest.fixture(scope="module")
def evidence(fuzzifier):
    """Five detections, the fourth without an RCS."""
    return fuzzifier(scan_of([0.15, 1.0, 6.0, np.nan, 2.5]))


def measured(masses, focal, frame=FRAME, random=None):
    """Evidence of detections with given masses; the likelihoods of the classes do not matter."""
    n, k = len(masses), len(frame)
    likelihood = np.zeros((n, k)) if random is None else random.normal(size=(n, k))
    return Evidence(
        key=KEY,
        frame=frame,
        focal=focal,
        masses=np.asarray(masses, dtype=np.float64),
        class_names=tuple(f"class_{i}" for i in range(k)),
        log_class_likelihood=likelihood,
        class_probability=np.full((n, k), 1.0 / k),
        informative=np.ones(n, dtype=np.bool_),
    )


def believed(term, evidence, focal, masses):
    """Predictions with given masses, in the frame and the classes of the evidence."""
    h, k = len(masses), len(evidence.class_names)
    return predictions_of(
        term,
        h,
        frame=evidence.frame,
        focal=focal,
        masses=np.asarray(masses, dtype=np.float64),
        class_names=evidence.class_names,
        class_probability=np.full((h, k), 1.0 / k),
    )


def named(scores, row=0):
    """Masses of a candidate by the names of the elements on the model of its term."""
    model = None if scores.attribute_term == "dsm_classic" else shafer_model(scores.frame)
    return {
        element_name(scores.frame, mask, model): mass
        for mask, mass in zip(scores.focal.tolist(), scores.masses[row].tolist(), strict=True)
        if mass
    }


# --- by hand ------------------------------------------------------------------------------------


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


# History S .6, ignorance .4; measurements S .2, B .8, then S .5, ignorance .5.
TWO_SCANS = {
    "dsm_classic": [
        ({"S": 0.2, "B": 0.32, "S&B": 0.48}, 0.48),
        ({"S": 0.2, "B": 0.16, "S&B": 0.64}, 0.64),
    ],
    "dempster": [
        ({"S": 0.2 / 0.52, "B": 0.32 / 0.52}, 0.48),
        ({"S": 5 / 9, "B": 4 / 9}, 0.16 / 0.52),
    ],
    "yager": [
        ({"S": 0.2, "B": 0.32, "VS|S|B": 0.48}, 0.48),
        ({"S": 0.44, "B": 0.16, "VS|S|B": 0.40}, 0.16),
    ],
    "dsm_hybrid": [
        ({"S": 0.2, "B": 0.32, "S|B": 0.48}, 0.48),
        ({"S": 0.44, "B": 0.16, "S|B": 0.40}, 0.16),
    ],
    "pcr5": [
        ({"S": 0.2 + 0.48 * 0.6 / 1.4, "B": 0.32 + 0.48 * 0.8 / 1.4}, 0.48),
        # From S 14.2/35, B 20.8/35; 10.4/35 on B & S is shared as 20.8/35 to 17.5/35.
        (
            {
                "S": 14.2 / 35 + 10.4 / 35 * 17.5 / 38.3,
                "B": 10.4 / 35 + 10.4 / 35 * 20.8 / 38.3,
            },
            10.4 / 35,
        ),
    ],
}
TWO_SCANS["dubois_prade"] = TWO_SCANS["dsm_hybrid"]
TWO_SCANS["pcr6"] = TWO_SCANS["pcr5"]


@pytest.mark.parametrize("term", DISTANCE_TERMS)
def test_two_scans_by_hand(term):
    focal = columns(["VS", "S", "B", "VS|S|B"])
    evidence = measured([[0, 0.2, 0.8, 0], [0, 0.5, 0, 0.5]], focal)
    predictions = believed(term, evidence, focal, [[0, 0.6, 0, 0.4]])
    before = {"S": 0.6, "VS|S|B": 0.4}
    for row, (expected, conflict) in enumerate(TWO_SCANS[term]):
        pair = np.zeros(1, dtype=np.int32), np.full(1, row, dtype=np.int32)
        scores = stage()(predictions, evidence, *pair)
        assert named(scores) == pytest.approx(expected, abs=1e-12)
        assert scores.conflict[0] == pytest.approx(conflict, abs=1e-12)
        moved = [expected.get(x, 0) - before.get(x, 0) for x in expected.keys() | before.keys()]
        assert scores.distance[0] == pytest.approx(np.linalg.norm(moved), abs=1e-12)
        predictions = believed(term, evidence, scores.focal, scores.masses)
        before = expected


TOTAL_CONFLICT = {
    "dsm_classic": {"S&B": 1.0},
    "dsm_hybrid": {"S|B": 1.0},
    "dempster": {"B": 1.0},
    "yager": {"VS|S|B": 1.0},
    "dubois_prade": {"S|B": 1.0},
    "pcr5": {"S": 0.5, "B": 0.5},
    "pcr6": {"S": 0.5, "B": 0.5},
}


@pytest.mark.parametrize("term", DISTANCE_TERMS)
def test_total_conflict(term):
    """One pair in total conflict beside one that is not: each gets what is its due."""
    focal = columns(["S", "B"])
    evidence = measured([[1, 0], [0, 1]], focal)
    scores = stage()(believed(term, evidence, focal, [[0, 1]]), evidence, *all_pairs(1, 2))
    assert named(scores) == TOTAL_CONFLICT[term]
    assert named(scores, 1) == {"B": 1.0}
    assert scores.conflict.tolist() == [1.0, 0.0]
    moved = {**TOTAL_CONFLICT[term], "B": TOTAL_CONFLICT[term].get("B", 0.0) - 1.0}
    assert scores.distance.tolist() == pytest.approx([np.linalg.norm(list(moved.values())), 0.0])


def test_dempster_in_total_conflict_keeps_a_history_of_several_elements(fuzzifier):
    evidence = fuzzifier(scan_of([100.0, 1.0]))  # beyond the histograms: surely big
    predictions = believed("dempster", evidence, columns(["VS", "S"]), [[0.3, 0.7]])
    scores = stage()(predictions, evidence, *all_pairs(1, 2))
    assert scores.conflict[0] == 1.0
    assert scores.distance[0] == 0.0
    assert scores.distance[1] > 0.0
    found = from_row(FRAME, scores.focal, scores.masses[0])
    assert_same(found, {atom(FRAME, "VS"): 0.3, atom(FRAME, "S"): 0.7})


# --- against dictionaries -----------------------------------------------------------------------


def candidate_of(term, frame, history, measurement):
    """History on the model of the term, candidate and conflict, from dictionaries."""
    alive = shafer_parts(frame)
    if term == "dsm_classic":
        return history, *combine("dsmc", frame, alive, [history, measurement])
    history = dictionary_project(frame, history, alive)
    measurement = reduced(measurement, alive)
    try:
        return history, *combine(RULE_OF_TERM[term], frame, alive, [history, measurement])
    except NoAnswer:
        return history, history, 1.0


@pytest.mark.parametrize("frame", [("A", "B"), FRAME, FOUR])
@pytest.mark.parametrize("term", DISTANCE_TERMS)
@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_terms_agree_with_dictionaries(term, frame, seed):
    """Any history of the free model, of any term before it, and any measurement that may be."""
    random = np.random.default_rng(seed)
    alive = shafer_parts(frame)
    every = hyper_power_set(len(frame))
    possible = [m for m in every.tolist() if m & shafer_model(frame).alive]
    focal = random.choice(every, min(len(every), 6), replace=False).astype(np.uint32)
    reported = random.permutation(possible)[: random.integers(1, 5)].astype(np.uint32)
    evidence = measured(random.dirichlet(np.ones(len(reported)), 3), reported, frame, random)
    predictions = believed(term, evidence, focal, random.dirichlet(np.ones(len(focal)), 2))
    hypothesis, detection = all_pairs(2, 3)
    scores = stage()(predictions, evidence, hypothesis, detection)
    for row, (i, j) in enumerate(zip(hypothesis, detection, strict=True)):
        history, candidate, conflict = candidate_of(
            term,
            frame,
            from_row(frame, predictions.focal, predictions.masses[i]),
            from_row(frame, evidence.focal, evidence.masses[j]),
        )
        found = from_row(frame, scores.focal, scores.masses[row])
        if term != "dsm_classic":
            found = reduced(found, alive)
        assert_same(found, candidate)
        assert scores.conflict[row] == pytest.approx(conflict, abs=1e-12)
        elements = candidate.keys() | history.keys()
        distance = sum((candidate.get(x, 0) - history.get(x, 0)) ** 2 for x in elements) ** 0.5
        assert scores.distance[row] == pytest.approx(distance, abs=1e-12)
        before, after = (
            [
                dictionary_pignistic(
                    dictionary_project(frame, masses, alive), alive, atom(frame, name)
                )
                for name in frame
            ]
            for masses in (history, candidate)
        )
        np.testing.assert_allclose(scores.class_probability[row], after, atol=1e-12)
        likelihood = np.exp(evidence.log_class_likelihood[j])
        assert scores.log_likelihood[row] == pytest.approx(np.log(before @ likelihood), abs=1e-12)


# --- what follows from the model ----------------------------------------------------------------


@pytest.mark.parametrize(("one", "other"), [("pcr5", "pcr6"), ("dsm_hybrid", "dubois_prade")])
def test_two_names_of_one_recursion(evidence, one, other):
    """Two sources on Shafer's model without dead focal elements leave no difference."""
    found = [stage()(histories(term), evidence, *all_pairs(4, 5)) for term in (one, other)]
    for name in ("focal", "masses", "distance", "log_likelihood", "conflict"):
        np.testing.assert_array_equal(*(getattr(scores, name) for scores in found))


@pytest.mark.parametrize("term", DISTANCE_TERMS)
def test_only_the_conjunctive_terms_forget_the_order_of_the_detections(term):
    focal = columns(["VS", "S", "B", "VS|S|B"])
    random = np.random.default_rng(8)
    evidence = measured(random.dirichlet(np.ones(4), 4), focal)
    ends = []
    for order in (range(4), reversed(range(4))):
        predictions = predictions_of(term, 1)
        for row in order:
            pair = np.zeros(1, dtype=np.int32), np.full(1, row, dtype=np.int32)
            scores = stage()(predictions, evidence, *pair)
            predictions = believed(term, evidence, scores.focal, scores.masses)
        ends.append(scores.masses[0])
    apart = np.abs(ends[0] - ends[1]).max()
    if term in ("dsm_classic", "dempster"):
        assert apart < 1e-15
    else:
        assert apart > 0.01


def test_columns_of_a_history_stay_from_scan_to_scan(evidence):
    """Once a history is closed under its rule its columns are those of its successors."""
    four, unions = ["VS", "S", "B", "VS|S|B"], ["VS|S", "VS|B", "S|B"]
    expected = {term: set(four) for term in DISTANCE_TERMS}
    expected["dsm_classic"] = set(EIGHT)
    expected["dsm_hybrid"] = expected["dubois_prade"] = {*four, *unions}
    for term in DISTANCE_TERMS:
        predictions = predictions_of(term, 3, frame=FRAME, class_names=CLASSES)
        predictions.class_probability = np.tile([0.0, 0.5, 0.5], (3, 1))
        seen = []
        for _ in range(4):
            scores = stage()(predictions, evidence, *all_pairs(3, 5))
            seen.append(scores.focal.tolist())
            predictions.focal, predictions.masses = scores.focal, scores.masses[:3]
            predictions.class_probability = scores.class_probability[:3]
        assert {element_name(FRAME, mask) for mask in seen[0]} == expected[term]
        assert seen == [seen[0]] * 4


# --- a change of term ---------------------------------------------------------------------------


@pytest.mark.parametrize("second", ATTRIBUTE_TERMS)
@pytest.mark.parametrize("first", ATTRIBUTE_TERMS)
def test_a_change_of_term(evidence, first, second):
    """The candidates of one term are histories of any other, and of the first one again."""
    hypothesis, detection = all_pairs(4, 5)
    predictions = histories(first)
    rows = np.arange(len(hypothesis), dtype=np.int32)
    history = [from_row(FRAME, predictions.focal, row) for row in predictions.masses[hypothesis]]
    for term in (first, second, first, second):
        scores = stage()(predictions, evidence, hypothesis, detection)
        if term in DISTANCE_TERMS:
            for row in np.flatnonzero(detection != 3):
                before, candidate, _ = candidate_of(
                    term,
                    FRAME,
                    history[row],
                    from_row(FRAME, evidence.focal, evidence.masses[detection[row]]),
                )
                found = from_row(FRAME, scores.focal, scores.masses[row])
                if term != "dsm_classic":
                    found = reduced(found, shafer_parts(FRAME))
                assert_same(found, candidate)
        np.testing.assert_allclose(scores.class_probability.sum(axis=1), 1.0, atol=1e-12)
        assert np.isfinite(scores.log_likelihood).all()
        # Terms without masses leave those that there were.
        if term in DISTANCE_TERMS:
            focal, masses = scores.focal, scores.masses
        else:
            focal, masses = predictions.focal, predictions.masses[hypothesis]
        hypothesis = rows
        predictions = replace(
            predictions_of(second if term == first else first, len(rows)),
            frame=FRAME,
            focal=focal,
            masses=masses,
            class_names=CLASSES,
            class_probability=scores.class_probability,
        )
        history = [from_row(FRAME, focal, row) for row in masses]


@pytest.mark.parametrize("term", ON_SHAFER)
def test_a_change_from_the_free_model_keeps_what_was_believed(evidence, term):
    hypothesis, detection = all_pairs(4, 5)
    scores = stage()(histories("dsm_classic"), evidence, hypothesis, detection)
    follow = histories(term, len(hypothesis))
    follow.focal, follow.masses = scores.focal, scores.masses
    unknown = np.full(len(hypothesis), 3, dtype=np.int32)
    rows = np.arange(len(hypothesis), dtype=np.int32)
    kept = stage()(follow, evidence, rows, unknown)
    np.testing.assert_allclose(kept.class_probability, scores.class_probability, atol=1e-12)


# --- forgetting ---------------------------------------------------------------------------------


@pytest.mark.parametrize("term", DISTANCE_TERMS)
def test_forgetting_discounts_the_history_before_it_is_fused(fuzzifier, term):
    """The same as the history that was discounted by hand."""
    evidence = fuzzifier(scan_of([0.15, 1.0, 6.0, 2.5]))
    texts = ["VS", "S", "B", "VS|S|B"]
    predictions = histories(term, texts=texts)
    discounted = histories(term, texts=texts)
    discounted.masses = 0.8 * discounted.masses
    discounted.masses[:, 3] += 0.2
    pairs = all_pairs(4, 4)
    scores = stage()(forgetful(predictions, 0.8), evidence, *pairs)
    by_hand = stage()(discounted, evidence, *pairs)
    for name in ("focal", "masses", "distance", "log_likelihood", "conflict"):
        np.testing.assert_allclose(getattr(scores, name), getattr(by_hand, name), atol=1e-14)


def test_forgetting_keeps_the_distance_alive(fuzzifier):
    """Without it the history drifts into the total intersection and no detection moves it."""
    evidence = fuzzifier(scan_of([1.0]))
    distance = {}
    for factor in (1.0, 0.7):
        predictions = predictions_of("dsm_classic", 1, frame=FRAME, class_names=CLASSES)
        predictions.class_probability = np.array([[0.0, 0.5, 0.5]])
        for _ in range(25):
            pair = np.zeros(1, dtype=np.int32)
            scores = stage()(forgetful(predictions, factor), evidence, pair, pair)
            predictions.focal, predictions.masses = scores.focal, scores.masses
        distance[factor] = scores.distance[0]
    assert distance[1.0] < 0.02
    assert distance[0.7] > 0.1
