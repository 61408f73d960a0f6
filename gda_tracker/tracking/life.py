"""Life of tracks: confirmation and deletion after each scan, by the rule of the parameters."""

from __future__ import annotations

from collections.abc import Callable

from gda_tracker.tracking.extraction import decide, scan_increments, sequential_test
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.lifecycle import confirmed, ended
from gda_tracker.tracking.parameters import M_OF_N, SEQUENTIAL, TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.tracks import CONFIRMED

Rule = Callable[
    [
        HypothesisTable,
        Predictions,
        AttributeScores | None,
        Associations,
        FloatArray,
        TrackManagerParameters,
    ],
    BoolArray,
]


def judge(
    table: HypothesisTable,
    predictions: Predictions,
    scores: AttributeScores | None,
    associations: Associations,
    clutter_density: FloatArray,
    parameters: TrackManagerParameters,
) -> BoolArray:
    """Confirm tracks in ``table``, whose hits and misses are those after the scan.

    Parameters
    ----------
    table
        (H,) hypotheses; status and log likelihood ratio are replaced.
    predictions, scores, associations
        Of the scan, for the same hypotheses.
    clutter_density
        (H,) around each hypothesis [1/(m rad)].
    parameters
        Of the track manager.

    Returns
    -------
    (H,) array
        Which tracks end.
    """
    rule = _RULES[parameters.extraction]
    return rule(table, predictions, scores, associations, clutter_density, parameters)


def _m_of_n(
    table: HypothesisTable,
    predictions: Predictions,
    scores: AttributeScores | None,
    associations: Associations,
    clutter_density: FloatArray,
    parameters: TrackManagerParameters,
) -> BoolArray:
    p = parameters
    table.status = confirmed(table.status, table.history, p.confirmation_hits, p.confirmation_scans)
    return ended(
        table.status,
        table.history,
        table.age_scans,
        table.coasted_scans,
        confirmation_hits=p.confirmation_hits,
        confirmation_scans=p.confirmation_scans,
        deletion_misses=p.deletion_misses,
        tentative_deletion_misses=p.tentative_deletion_misses,
    )


def _sequential(
    table: HypothesisTable,
    predictions: Predictions,
    scores: AttributeScores | None,
    associations: Associations,
    clutter_density: FloatArray,
    parameters: TrackManagerParameters,
) -> BoolArray:
    test = sequential_test(parameters.false_track_probability, parameters.missed_track_probability)
    table.status, table.log_likelihood_ratio, gone = decide(
        table.status,
        table.track_id,
        table.log_likelihood_ratio
        + scan_increments(predictions, scores, associations, clutter_density),
        test,
    )
    if parameters.deletion_misses == 0:
        gone = gone & (table.status != CONFIRMED)
    return gone


_RULES: dict[str, Rule] = {M_OF_N: _m_of_n, SEQUENTIAL: _sequential}
