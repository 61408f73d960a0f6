"""Statements about a track, fused into what is known of its class.

A statement is one more source on the class of a track, heard before the detections of the scan: its
likelihood of class c is the mean of mu(z, c) over the place where the track is predicted to be. The
attribute term takes it in as it would a detection's attribute, as masses that are consonant with
the likelihood (:mod:`gda_tracker.attributes.statement_evidence`). Neither forgetting nor a
transition of the class goes with it: both belong to detections.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.bayes import class_update
from gda_tracker.attributes.pair_beliefs import PairBeliefs
from gda_tracker.attributes.statement_evidence import consonant_masses, union_focal
from gda_tracker.attributes.statement_meaning import Meaning, track_meaning
from gda_tracker.attributes.statement_states import component_rows
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray, MaskArray
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.statements import TRACK, Statement

Fuse = Callable[[MaskArray, FloatArray, FloatArray, Evidence], PairBeliefs]


@dataclass(frozen=True, slots=True)
class Histories:
    """Histories of H hypotheses: ``masses`` (H, E) over ``focal``, ``class_probability`` (H, C).

    ``updated`` are the rows that a statement has changed.
    """

    focal: MaskArray
    masses: FloatArray
    class_probability: FloatArray
    updated: IntArray


def hear_statements(
    statements: tuple[Statement, ...],
    predictions: Predictions,
    evidence: Evidence,
    prior: FloatArray,
    histories: Histories,
    fuse: Fuse,
) -> Histories:
    """Fuse the statements about tracks, one after the other, into the histories.

    Parameters
    ----------
    statements
        Those of the scan.
    predictions
        H hypotheses.
    evidence
        Evidence of the scan: its frame and classes.
    prior
        (C,) class prior.
    histories
        As the predictions have them; no column and no class where nothing is known yet.
    fuse
        Fuses H histories (focal, masses, class probabilities) with H rows of evidence.
    """
    names = evidence.class_names
    for statement in statements:
        if statement.about != TRACK:
            continue
        meaning = track_meaning(statement, names)
        about = predictions.track_id == statement.track_id
        if not meaning.speaks_of_class or not about.any():
            continue
        likelihood = np.ones((len(predictions), len(names)))
        likelihood[about] = mean_over_components(meaning, predictions, np.flatnonzero(about))
        heard = fuse(
            histories.focal,
            histories.masses,
            histories.class_probability,
            _evidence(evidence, prior, likelihood, about),
        )
        updated = np.union1d(histories.updated, np.flatnonzero(about))
        histories = Histories(heard.focal, heard.masses, heard.class_probability, updated)
    return histories


def mean_over_components(meaning: Meaning, predictions: Predictions, rows: IntArray) -> FloatArray:
    """Mean of mu(., c) (R, C) over the predicted places of hypotheses ``rows`` (R,)."""
    owner, each = component_rows(predictions.component_start, rows)
    value = meaning.expectation(
        predictions.component_mean[each, :2], predictions.component_covariance[each, :2, :2]
    )
    mean = np.zeros((len(rows), value.shape[1]))
    np.add.at(mean, owner, predictions.component_weight[each, None] * value)
    return mean


def _evidence(
    evidence: Evidence, prior: FloatArray, likelihood: FloatArray, about: BoolArray
) -> Evidence:
    """What a statement says of each hypothesis, in the form of evidence on detections."""
    log_likelihood = np.log(likelihood)
    return Evidence(
        key=evidence.key,
        frame=evidence.frame,
        focal=union_focal(len(evidence.frame)),
        masses=consonant_masses(likelihood),
        class_names=evidence.class_names,
        log_class_likelihood=log_likelihood,
        class_probability=class_update(
            np.repeat(prior[None], len(likelihood), axis=0), log_likelihood
        )[0],
        informative=about,
    )
