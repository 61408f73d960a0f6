"""What statements do to the hypotheses when a scan is closed."""

from __future__ import annotations

import numpy as np

from gda_tracker.attributes.statement_states import Rows, hear, region_meanings
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import set_models
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.statements import Statement


def update_heard_states(
    table: HypothesisTable,
    predicted: HypothesisTable,
    statements: tuple[Statement, ...],
    with_classes: bool,
) -> None:
    """Multiply the states by what was said of where their tracks are, after the detections.

    Parameters
    ----------
    table
        After the detections and the beliefs of the scan; changed.
    predicted
        The same hypotheses before.
    statements
        Those of the scan.
    with_classes
        Whether the attribute has spoken; if not, parts on classes have no effect.
    """
    class_names = table.class_names if with_classes else ()
    meanings = region_meanings(statements, class_names)
    if not meanings or not len(table):
        return
    count = max(len(class_names), 1)
    same = bool(class_names) and predicted.class_names == class_names
    prior = predicted.class_probability if same else np.full((len(table), count), 1.0 / count)
    weight = table.class_probability if class_names else np.ones((len(table), 1))
    before, share = _rows(predicted, prior)
    after, _ = _rows(table, weight)
    models = len(before.mean) // len(table)
    for track_id, meaning in meanings:
        about = np.repeat(table.track_id == track_id, models)
        before, value = hear(meaning, before, about)
        # The class has been updated with the mean over all models.
        divisor = (share[:, :, None] * value.reshape(len(table), models, -1)).sum(axis=1)
        after, _ = hear(meaning, after, about, np.repeat(divisor, models, axis=0))
    if not table.model_weight.shape[1]:
        table.mean, table.covariance = after.mean, after.covariance
        return
    gained = after.class_weight.sum(axis=1).reshape(len(table), models)
    weights = table.model_weight * gained
    set_models(
        table,
        weights / weights.sum(axis=1, keepdims=True),
        after.mean.reshape(table.model_mean.shape),
        after.covariance.reshape(table.model_covariance.shape),
    )


def _rows(table: HypothesisTable, class_weight: FloatArray) -> tuple[Rows, FloatArray]:
    """Return a row for each hypothesis and motion model, and the models' weights (H, M)."""
    models = table.model_weight.shape[1]
    if not models:
        return Rows(table.mean, table.covariance, class_weight), np.ones((len(table), 1))
    size = table.model_mean.shape[2]
    rows = Rows(
        table.model_mean.reshape(-1, size),
        table.model_covariance.reshape(-1, size, size),
        np.repeat(class_weight, models, axis=0),
    )
    return rows, table.model_weight


def update_heard_beliefs(
    table: HypothesisTable, scores: AttributeScores, rows: IntArray, heard: IntArray
) -> None:
    """Give rows (R,) of the table the changed histories ``heard`` (R,), places in the scores' list.

    Those with a detection have the candidate belief of their pair, in which it is contained.
    """
    if not len(rows):
        return
    if scores.updated_masses.shape[1]:
        table.use_focal(scores.focal)
        masses = table.masses.copy()
        masses[rows] = 0.0
        masses[rows, : len(scores.focal)] = scores.updated_masses[heard]
        table.masses = masses
    beliefs = table.class_probability.copy()
    beliefs[rows] = scores.updated_class_probability[heard]
    table.class_probability = beliefs


def heard_rows(
    scores: AttributeScores, hypothesis: IntArray, alone: BoolArray
) -> tuple[IntArray, IntArray]:
    """Return which of the rows that are ``alone`` (R,) have a changed history, and its place.

    ``hypothesis`` (R,) are the rows of the predictions that they come from.
    """
    place = np.full(int(hypothesis.max(initial=-1)) + 1, -1)
    known = scores.updated_hypothesis[scores.updated_hypothesis < len(place)]
    place[known] = np.flatnonzero(scores.updated_hypothesis < len(place))
    rows = np.flatnonzero(alone & (place[hypothesis] >= 0))
    return rows, place[hypothesis[rows]]
