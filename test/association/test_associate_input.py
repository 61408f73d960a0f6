from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from associate_examples import FAR, assert_consistent, associate, random_stage

from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.association.choices import (
    DECISIONS,
)
from gda_tracker.association.errors import AssociationInputError, PairListMismatch
from gda_tracker.parameters import ParameterError, from_mapping, specifications


@pytest.mark.parametrize("change", ["shorter", "other detection", "other hypothesis", "wider"])
def test_scores_for_other_pairs_are_refused(make_stage_input, change):
    scan, predictions, scores, pairs = make_stage_input(
        np.full((2, 3), -9.0), attribute_term="dsm_classic", distance=np.ones((2, 3))
    )
    if change == "shorter":
        scores.hypothesis, scores.detection = scores.hypothesis[:-1], scores.detection[:-1]
    elif change == "other detection":
        scores.detection[0] = 2
    elif change == "other hypothesis":
        scores.hypothesis[0] = 1
    else:  # the same numbers in another type are the same pairs
        scores.hypothesis = scores.hypothesis.astype(np.int64)
        assert_consistent(associate(scan, predictions, scores, pairs), 2, 3)
        return
    with pytest.raises(PairListMismatch, match="the gate 6"):
        associate(scan, predictions, scores, pairs)


def spoiled(stage, name, value):
    scan, predictions, scores, pairs = stage
    if name == "kinematic":
        pairs.log_likelihood[0] = value
    elif name == "detection_probability":
        predictions.detection_probability[0] = value
    else:
        getattr(scores, name)[0] = value
    return scan, predictions, scores, pairs


@pytest.mark.parametrize("h", [1, 3])
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("kinematic", np.nan, "kinematic log likelihood nan"),
        ("kinematic", np.inf, "kinematic log likelihood inf"),
        ("log_likelihood", np.nan, "attribute log likelihood nan"),
        ("log_likelihood", np.inf, "attribute log likelihood inf"),
        ("clutter_log_likelihood", np.nan, "clutter log likelihood nan"),
        ("clutter_log_likelihood", np.inf, "clutter log likelihood inf"),
        ("distance", np.nan, "attribute distance nan"),
        ("distance", -0.5, "attribute distance -0.5"),
        ("distance", np.inf, "attribute distance inf"),
        ("detection_probability", 1.5, "detection probability 1.5"),
        ("detection_probability", np.nan, "detection probability nan"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_values_without_meaning_are_named(make_stage_input, h, name, value, message):
    stage = make_stage_input(
        np.full((h, 3), -9.0), attribute_term="dsm_classic", distance=np.ones((h, 3))
    )
    for limits in (AssociationParameters(), AssociationParameters(max_exact_size=1)):
        with pytest.raises(AssociationInputError, match=message):
            Associator(limits)(*spoiled(stage, name, value))


@pytest.mark.filterwarnings("error")
def test_impossible_attributes_have_an_answer(make_stage_input):
    # A density of zero, as histograms have in empty bins: for one pair, a whole detection, clutter.
    log_l = np.zeros((2, 3))
    log_l[0, 0] = FAR
    log_l[:, 1] = FAR
    for decision in DECISIONS:
        found = associate(
            *make_stage_input(
                np.full((2, 3), -9.0),
                decision=decision,
                attribute_term="bayes",
                attribute_log_likelihood=log_l,
                clutter_log_likelihood=[0.0, FAR, 0.0],
            )
        )
        assert_consistent(found, 2, 3)
        assert (found.joint_marginal[[0, 1, 4]] == 0.0).all()
        assert not found.chosen[[0, 1, 4]].any() or decision == "gda"
        np.testing.assert_allclose(
            found.joint_marginal.reshape(2, 3)[1, [0, 2]].sum(), 0.9, atol=0.1
        )


def test_scores_of_another_term_or_size_are_refused(make_stage_input):
    stage = make_stage_input(np.full((2, 2), -9.0), attribute_term="bayes")
    stage[2].attribute_term = "dempster"
    with pytest.raises(AssociationInputError, match="'dempster'.*'bayes'"):
        associate(*stage)
    stage = make_stage_input(np.full((2, 2), -9.0), attribute_term="bayes")
    stage[2].clutter_log_likelihood = np.zeros(3)
    with pytest.raises(AssociationInputError, match=r"clutter_log_likelihood has shape \(3,\)"):
        associate(*stage)


def test_unknown_decision_is_refused(make_stage_input):
    with pytest.raises(AssociationInputError, match="'best'.*gda, map, jpda"):
        associate(*make_stage_input([[-9.0]], decision="best"))


def test_the_same_input_gives_the_same_bits(make_stage_input):
    _, stage = random_stage(make_stage_input, 17, attribute_term="dsm_classic")
    one, two = associate(*stage), Associator(AssociationParameters())(*stage)
    for field in dataclasses.fields(one):
        first, second = getattr(one, field.name), getattr(two, field.name)
        if isinstance(first, np.ndarray):
            assert first.tobytes() == second.tobytes()
        else:
            assert first == second


def test_inputs_are_not_changed(make_stage_input):
    _, stage = random_stage(make_stage_input, 23, attribute_term="dsm_classic")
    before = [
        {name: value.copy() for name, value in vars_of(part) if isinstance(value, np.ndarray)}
        for part in stage
    ]
    associate(*stage)
    for part, values in zip(stage, before, strict=True):
        for name, value in values.items():
            np.testing.assert_array_equal(getattr(part, name), value)


def vars_of(part):
    return [(field.name, getattr(part, field.name)) for field in dataclasses.fields(part)]


def test_ties_have_one_answer(make_stage_input):
    stage = make_stage_input(np.full((3, 3), -9.0))
    assigned = associate(*stage).assigned_detection
    for _ in range(3):
        np.testing.assert_array_equal(associate(*stage).assigned_detection, assigned)
    assert sorted(assigned.tolist()) == [0, 1, 2]


def test_a_hundred_tracks(make_stage_input):
    rng = np.random.default_rng(9)
    log_g = np.full((100, 130), FAR)
    log_g[np.arange(100), np.arange(100)] = rng.normal(-9.0, 1.0, 100)
    crowded = rng.random(99) < 0.2
    log_g[np.arange(99)[crowded], np.arange(1, 100)[crowded]] = -9.5
    found = associate(*make_stage_input(log_g))
    assert_consistent(found, 100, 130)
    np.testing.assert_array_equal(found.assigned_detection, np.arange(100))


def test_parameters_are_declared():
    assert set(specifications(AssociationParameters)) == {
        "max_exact_size",
        "coalescence_remedy",
        "belief_propagation_iterations",
        "belief_propagation_tolerance",
    }
    with pytest.raises(ParameterError, match="max_exact_size = 21"):
        from_mapping(AssociationParameters, {"max_exact_size": 21})
