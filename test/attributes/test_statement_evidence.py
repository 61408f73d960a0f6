"""Statements about places in the evidence, and about tracks in the histories."""

import doctest

import numpy as np
import pytest
from attribute_examples import FOUR, scan_of
from fusion_examples import CLASSES, all_pairs, histories, stage
from hypothesis import given, settings
from hypothesis import strategies as st
from statement_examples import BOX, piece, rule, said

from gda_tracker.attributes import statement_evidence
from gda_tracker.attributes.attribute_evidence import ATTRIBUTE_RULES
from gda_tracker.attributes.bayes import class_update
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.statement_evidence import consonant_masses, union_focal
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.evidence.frames import parse_element, total_ignorance
from gda_tracker.parameters import from_mapping
from gda_tracker.vocabulary import StatementRegion

BUOY = StatementRegion("gaussian", centre_m=(1000.0, 0.0), covariance_m2=(100.0, 0.0, 0.0, 100.0))


def test_examples_in_docstrings():
    failed, tried = doctest.testmod(statement_evidence)
    assert tried
    assert not failed


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.lists(st.floats(1e-6, 1.0), min_size=2, max_size=4))
def test_consonant_masses_have_the_likelihood_as_plausibility(grades):
    masses = consonant_masses(np.array([grades]))[0]
    assert (masses >= 0.0).all()
    assert masses.sum() == pytest.approx(1.0)
    for element, grade in enumerate(grades):
        plausible = sum(m for s, m in enumerate(masses) if (s + 1) >> element & 1)
        assert plausible == pytest.approx(grade / max(grades))


def test_columns_are_unions():
    names = ("VS", "S", "B")
    wanted = ["VS", "S", "VS|S", "B", "VS|B", "S|B", "VS|S|B"]
    assert union_focal(3).tolist() == [parse_element(names, text) for text in wanted]


def at(azimuth, **fields):
    """A scan of detections at a range of 1 km, some 1 m sharp."""
    azimuth = np.asarray(azimuth)
    scan = scan_of(np.full(len(azimuth), 2.0), **fields)
    scan.azimuth_rad = azimuth
    scan.noise_covariance = np.tile(np.diag([1.0, 1e-6]), (len(azimuth), 1, 1))
    return scan


def fuzzifier(**changes):
    return RcsFuzzifier(from_mapping(RcsFuzzifierParameters, changes))


@pytest.mark.parametrize("rule_name", ATTRIBUTE_RULES)
@pytest.mark.parametrize("classes", [{}, FOUR], ids=["three", "four"])
def test_a_place_speaks_of_the_detections_there_alone(rule_name, classes):
    stage_of = fuzzifier(attribute_rule=rule_name, **classes)
    statement = said("fuzzy", "place", piece(BUOY, fighter=1.0, cargo=0.1))
    silent = stage_of(at([0.0, 0.3, 1.0]))
    heard = stage_of(at([0.0, 0.3, 1.0], statements=(statement,)))
    fighter, cargo = (heard.class_names.index(name) for name in ("fighter", "cargo"))
    # Elsewhere bit for bit the same.
    for name in ("log_class_likelihood", "class_probability", "informative"):
        one, other = getattr(heard, name), getattr(silent, name)
        assert one[1:].tobytes() == other[1:].tobytes()
    columns = [heard.focal.tolist().index(mask) for mask in silent.focal.tolist()]
    assert np.ascontiguousarray(heard.masses[1:, columns]).tobytes() == silent.masses[1:].tobytes()
    # There, by the likelihood of the noisy place.
    membership = np.sqrt(100.0 / 101.0 * 100.0 / 101.0)
    ratio = heard.log_class_likelihood - silent.log_class_likelihood
    expected = np.log((1 - membership * 0.9) / 1.0)
    assert ratio[0, cargo] - ratio[0, fighter] == pytest.approx(expected, rel=1e-4)
    assert ratio[0, 0] == pytest.approx(ratio[0, fighter])  # of clutter it says nothing
    assert heard.class_probability[0, fighter] > silent.class_probability[0, fighter]
    np.testing.assert_allclose(heard.masses.sum(axis=1), 1.0)
    total = total_ignorance(len(heard.frame))
    left, before = (e.masses[0, e.focal == total].sum() for e in (heard, silent))
    assert left <= before + 1e-12


def test_a_detection_of_unknown_rcs_knows_what_was_said():
    statement = said("fuzzy", "place", piece(BOX, fighter=1.0))
    where = StatementRegion("box", low_m=(900.0, -10.0), high_m=(1100.0, 10.0))
    statement = said("fuzzy", "place", piece(where, fighter=1.0))
    evidence = fuzzifier()(at([0.0, 0.0], valid=[False, True], statements=(statement,)))
    assert evidence.informative.all()
    np.testing.assert_allclose(evidence.class_probability[0], [0.0, 1.0, 0.0], atol=1e-5)


def test_a_false_alarm_that_is_named_is_meant():
    where = StatementRegion("box", low_m=(900.0, -10.0), high_m=(1100.0, 10.0))
    statement = said("region", "place", piece(where, false_alarm=1.0))
    silent = fuzzifier()(at([0.0]))
    evidence = fuzzifier()(at([0.0], statements=(statement,)))
    ratio = (evidence.log_class_likelihood - silent.log_class_likelihood)[0]
    assert ratio[0] - ratio[1] == pytest.approx(np.log(1e6), rel=1e-6)


def test_unknown_classes_are_vacuous_and_counted():
    stage_of = fuzzifier()
    statement = said("fuzzy", "place", piece(BUOY, zeppelin=1.0, fighter=0.1))
    silent, heard = stage_of(at([0.0])), stage_of(at([0.0], statements=(statement,)))
    assert heard.masses.tobytes() == silent.masses.tobytes()
    assert stage_of.counters["statement_of_unknown_class"] == 1


def test_two_statements_add_up_in_any_order():
    one = said("fuzzy", "place", piece(BUOY, fighter=1.0, cargo=0.5))
    two = rule("place", BUOY, cargo=1.0)
    stage_of = fuzzifier()
    a = stage_of(at([0.0], statements=(one, two)))
    b = stage_of(at([0.0], statements=(two, one)))
    np.testing.assert_allclose(a.log_class_likelihood, b.log_class_likelihood, rtol=1e-12)
    np.testing.assert_allclose(a.masses, b.masses, rtol=1e-12, atol=1e-15)


# --- tracks


def scored(term, *statements, n=2, h=4):
    predictions = histories(term, h)
    evidence = fuzzifier()(at(np.linspace(0.0, 0.3, n), statements=statements))
    return predictions, evidence, stage()(predictions, evidence, *all_pairs(h, n), statements)


FIGHTER = said("fuzzy", "track", piece(fighter=1.0, cargo=0.05), track_id=2)


@pytest.mark.parametrize("term", [t for t in ATTRIBUTE_TERMS if t != "none"])
def test_a_statement_changes_the_history_of_its_track_alone(term):
    predictions, _, silent = scored(term)
    _, evidence, heard = scored(term, FIGHTER)
    assert heard.updated_hypothesis.tolist() == [2]
    assert silent.updated_hypothesis.tolist() == []
    others = heard.hypothesis != 2
    np.testing.assert_allclose(
        heard.log_likelihood[others], silent.log_likelihood[others], rtol=1e-12
    )
    fighter = CLASSES.index("fighter")
    assert (
        heard.class_probability[~others, fighter] > silent.class_probability[~others, fighter]
    ).all()
    if term == "bayes":
        prior = predictions.class_probability[2]
        posterior, _ = class_update(prior, np.log([1e-6, 1.0, 0.05 * (1 - 1e-6) + 1e-6]))
        np.testing.assert_allclose(heard.updated_class_probability[0], posterior, rtol=1e-9)
        # And the pairs are what Bayes' rule makes of that history.
        candidate, log_likelihood = class_update(posterior, evidence.log_class_likelihood)
        np.testing.assert_allclose(heard.log_likelihood[~others], log_likelihood, rtol=1e-9)
        np.testing.assert_allclose(heard.class_probability[~others], candidate, rtol=1e-9)
    else:
        assert term in DISTANCE_TERMS
        np.testing.assert_allclose(heard.updated_masses.sum(axis=1), 1.0)
        assert heard.updated_masses.shape == (1, len(heard.focal))


def test_without_an_attribute_term_nothing_changes():
    _, _, silent = scored("none")
    _, _, heard = scored("none", FIGHTER)
    assert heard.updated_hypothesis.tolist() == []
    assert heard.class_probability.tobytes() == silent.class_probability.tobytes()


@pytest.mark.parametrize("term", ["dsm_classic", "pcr5", "bayes"])
def test_without_detections_the_history_is_heard_all_the_same(term):
    _, _, heard = scored(term, FIGHTER, n=0)
    assert heard.updated_hypothesis.tolist() == [2]
    fighter = CLASSES.index("fighter")
    assert heard.updated_class_probability[0, fighter] > 0.5
