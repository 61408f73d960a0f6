"""Opening a scan: every hypothesis is predicted to its time, and the other stages are told."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from gda_tracker.tracking.blind_zone import tell_zone
from gda_tracker.tracking.clutter import densities_of_hypotheses
from gda_tracker.tracking.detection_map import tell_detection_map
from gda_tracker.tracking.extended.cells import scan_of_cells
from gda_tracker.tracking.extended.columns import predict_extents, with_extents
from gda_tracker.tracking.history_window import with_window
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.manager_state import ManagerState, OpenScan
from gda_tracker.tracking.measurement_clutter import with_relative_density
from gda_tracker.tracking.mht.start import fit
from gda_tracker.tracking.parameter_groups.extended import NONE
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.predictions import predictions_of
from gda_tracker.tracking.signal_strength import tell_strengths, with_signals, with_strengths
from gda_tracker.tracking.state_update import predict_states
from gda_tracker.tracking.statement_desk import DeskLimits
from gda_tracker.tracking.waiting_room import Waiting
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.scans import Scan


def open_scan(
    state: ManagerState,
    waiting: Waiting,
    ended_track_id: IntArray,
    restarted: bool,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> OpenScan:
    """Open a scan that has waited for its turn.

    Parameters
    ----------
    state
        At rest; only its desk of statements is changed, which is cleared up.
    waiting
        The scan.
    ended_track_id
        Shape ``(e,)``: tracks that have ended since the last scan, told with this one.
    restarted
        Whether the time axis has begun anew with it.
    parameters
        Those of the scan.
    counters
        Resets and statements that were dropped are counted here.
    """
    scan = waiting.scan
    p = parameters.of_sensor(scan.key.sensor_id)
    table, ended_ids, started = state.table, ended_track_id, state.last_ns is None
    dt_s = 0.0 if state.last_ns is None else (scan.key.stamp_ns - state.last_ns) / 1e9
    if restarted or dt_s > p.max_gap_s:
        counters[f"reset_{'time_jump' if restarted else 'gap'}"] += 1
        if restarted:
            state.desk = state.desk.forget()
        ended_ids = np.concatenate([ended_ids, table.track_id[table.chosen]])
        started, dt_s = True, 0.0
        table = table.select(np.zeros(len(table), dtype=bool))
    table = fit(table, p.mht_scans if p.decision == "mht" else 0)
    stamp_ns = scan.key.stamp_ns
    last, table = table, with_window(predict_states(table, dt_s, p, stamp_ns), p.window_rows)
    table = predict_extents(last, table, dt_s, p)
    table, scan = with_strengths(table, dt_s, p), with_signals(scan, p, counters)
    density = densities_of_hypotheses(state.clutter, scan, table.mean, p)
    scan, density = with_relative_density(state.measurement_clutter, scan, density, p)
    if state.desk.waiting:
        scan = _with_statements(scan, table, state, p, counters)
    predictions = tell_strengths(predictions_of(scan.key, table, p, density), scan, table, p)
    predictions = tell_detection_map(predictions, state.looks, scan, table.mean, p)
    if p.extended_objects != NONE and not scan.sensor_model:
        scan = scan_of_cells(scan, table, predictions.settings.clutter_density, p)
        predictions = with_extents(predictions, table, p)
    return OpenScan(
        scan,
        tell_zone(predictions, scan, p),
        table,
        ended_ids,
        started,
        waiting.admitted_at,
        waiting.received,
        waiting.counts,
        density,
    )


def desk_limits(parameters: TrackManagerParameters) -> DeskLimits:
    """How many statements may wait, and for how long."""
    p = parameters
    age_ns = round(p.statement_max_age_s * 1e9)
    return DeskLimits(p.max_statements, age_ns, round(p.statement_max_ahead_s * 1e9))


def _with_statements(
    scan: Scan,
    table: HypothesisTable,
    state: ManagerState,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> Scan:
    """Return the scan with the statements that are due."""
    stamp_ns = scan.key.stamp_ns
    state.desk = state.desk.clear_up(
        stamp_ns, table.track_id.tolist(), desk_limits(parameters), counters
    )
    return replace(scan, statements=state.desk.due(stamp_ns))
