"""Life of tracks: confirmation and deletion after each scan, by the rule of the parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gda_tracker.tracking.blind_zone import outlived
from gda_tracker.tracking.extraction import decide, held_between, sequential_test
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.lifecycle import confirmed, ended, hits_in_window
from gda_tracker.tracking.parameter_groups.life import M_OF_N, SEQUENTIAL
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.tracks import CONFIRMED

Increments = Callable[[], FloatArray]
Rule = Callable[[HypothesisTable, Increments, TrackManagerParameters], BoolArray]


def judge(
    table: HypothesisTable,
    increments: Increments,
    parameters: TrackManagerParameters,
    stamp_ns: int = 0,
) -> BoolArray:
    """Confirm tracks in ``table``, whose hits and misses are those after the scan.

    Parameters
    ----------
    table
        (H,) hypotheses; status and log likelihood ratio are replaced.
    increments
        Gives what the scan adds to the log likelihood ratio (H,):
        :func:`gda_tracker.tracking.extraction.scan_increments`.
    parameters
        Of the track manager.
    stamp_ns
        Time of the scan.

    Returns
    -------
    (H,) array
        Which tracks end.
    """
    gone = _RULES[parameters.extraction](table, increments, parameters)
    long = outlived(table, stamp_ns, parameters)
    return gone if long is None else gone | long


def _m_of_n(
    table: HypothesisTable,
    increments: Increments,
    parameters: TrackManagerParameters,
) -> BoolArray:
    p = parameters
    # It decides nothing here, but says how probably there is a target.
    test = sequential_test(p.false_track_probability, p.missed_track_probability)
    table.log_likelihood_ratio = held_between(table.log_likelihood_ratio, increments(), test)
    hits = None
    if np.count_nonzero(table.status != CONFIRMED):
        hits = hits_in_window(table.history, p.confirmation_scans)
    table.status = confirmed(
        table.status, table.history, p.confirmation_hits, p.confirmation_scans, hits
    )
    return ended(
        table.status,
        table.history,
        table.age_scans,
        # Misses that a blind zone explains are none.
        np.rint(table.coasted_scans - table.blind_scans).astype(np.int64)
        if np.count_nonzero(table.blind_scans)
        else table.coasted_scans,
        confirmation_hits=p.confirmation_hits,
        confirmation_scans=p.confirmation_scans,
        deletion_misses=p.deletion_misses,
        tentative_deletion_misses=p.tentative_deletion_misses,
        hits=hits,
    )


def _sequential(
    table: HypothesisTable,
    increments: Increments,
    parameters: TrackManagerParameters,
) -> BoolArray:
    test = sequential_test(parameters.false_track_probability, parameters.missed_track_probability)
    table.status, table.log_likelihood_ratio, gone = decide(
        table.status,
        table.track_id,
        table.log_likelihood_ratio + increments(),
        test,
    )
    if parameters.deletion_misses == 0:
        gone = gone & (table.status != CONFIRMED)
    return gone


_RULES: dict[str, Rule] = {M_OF_N: _m_of_n, SEQUENTIAL: _sequential}
