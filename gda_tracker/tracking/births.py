"""Births: new tracks from the detections of a scan that belong to none."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.gaussian_sum_starts import Reach, Sums, start_sums
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.kinematics.measurement_models import observed
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.tracking.existence import prior_odds
from gda_tracker.tracking.extended.updates import begin_extents
from gda_tracker.tracking.gaussian_sums import joined, set_sums
from gda_tracker.tracking.history_window import begin_windows
from gda_tracker.tracking.hypotheses import HypothesisTable, move_columns
from gda_tracker.tracking.initiation import NewTracks, StartPoints, bounded_speed, start_tracks
from gda_tracker.tracking.lifecycle import confirmed
from gda_tracker.tracking.manager_state import ManagerState, OpenScan
from gda_tracker.tracking.mht.start import start_numbers, start_scores
from gda_tracker.tracking.model_states import has_models, with_models
from gda_tracker.tracking.parameter_groups.life import M_OF_N
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.signal_strength import starts
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE


def begin_tracks(
    opened: OpenScan,
    table: HypothesisTable,
    associations: Associations,
    evidence: Evidence | None,
    state: ManagerState,
    parameters: TrackManagerParameters,
) -> tuple[HypothesisTable, StartPoints, int]:
    """Append what starts from the unassigned detections of a scan, as far as there is room.

    Parameters
    ----------
    opened
        The scan.
    table
        The hypotheses after it.
    associations
        Says which detections are assigned to the hypotheses before it.
    evidence
        Of the scan, if the attribute was asked.
    state
        Gives the start points and the next ids, which move on.
    parameters
        Of the track manager.

    Returns
    -------
    table, points, refused
        The table with what has started, the detections that wait for a second one, and how many
        tracks found no room.
    """
    p, scan = parameters, opened.scan
    points = StartPoints() if opened.started else state.points
    if p.initiation != "automatic":
        return table, points, 0
    unassigned = unassigned_detections(
        scan, associations, opened.table.status, p.initiation_outside_gates
    )
    number = state.next_detection_number
    sums: Sums | None = None
    if scan.sensor_model:
        new, sums = sums_of_detections(scan, unassigned, number, p)
    else:
        new, points = new_tracks(points, scan, unassigned, number, p)
    room = p.max_tracks - int(np.count_nonzero(table.chosen))
    count = min(len(new.detection), max(room, 0))
    refused = len(new.detection) - count
    if not count:
        return table, points, refused
    born = hypotheses_of_births(
        new, count, scan, evidence, table, state.next_track_id, state.next_hypothesis_id, p
    )
    if sums is not None:
        set_sums(born, sums, np.arange(count), p)
    started = new.select(slice(count))
    density = opened.predictions.settings.clutter_density
    born.strength, strengths_ratio, log_seen = starts(started, scan, p)
    # What the strengths say of a target counts in the test; the rest is a matter of the start.
    born.log_likelihood_ratio = strengths_ratio
    born.log_prior_odds = prior_odds(started, scan, density, p) + log_seen
    width = table.detection_numbers.shape[1]
    if width:
        born.log_score = start_scores(started, scan, density, p) + (log_seen + strengths_ratio)
        born.detection_numbers = start_numbers(started, number, width)
    begin_extents(born, scan, started.detection, density, p)
    state.next_hypothesis_id += count
    state.next_track_id += count
    return joined(table, born), points, refused


def unassigned_detections(
    scan: Scan, associations: Associations, status: IntArray, outside_gates: bool
) -> IntArray:
    """Return the detections that may start tracks, as rows of the scan.

    ``status`` (H,) is that of the associations' hypotheses. With ``outside_gates``, those inside
    the gate of a confirmed one may not.
    """
    free = np.ones(len(scan), dtype=bool)
    free[associations.assigned_detection[associations.assigned_detection >= 0]] = False
    if outside_gates:
        free[associations.detection[status[associations.hypothesis] == CONFIRMED]] = False
    return np.flatnonzero(free)


def new_tracks(
    points: StartPoints,
    scan: Scan,
    unassigned: IntArray,
    first_number: int,
    parameters: TrackManagerParameters,
) -> tuple[NewTracks, StartPoints]:
    """Pair the unassigned detections with those of earlier scans.

    ``first_number`` is the running number of the scan's first detection.

    Returns
    -------
    new, points
        The tracks that start, and the detections that wait for a second one.
    """
    if not len(unassigned) and not len(points):
        return NewTracks(), points
    new, points = start_tracks(
        points,
        polar_measurements(scan),
        unassigned,
        scan.key.stamp_ns,
        max_speed_mps=parameters.max_speed_mps,
        memory_scans=parameters.initiation_memory_scans,
        first_number=first_number,
        signal=scan.signal_strength,
    )
    if len(new.detection):
        new.mean, new.covariance = bounded_speed(new.mean, new.covariance, parameters.max_speed_mps)
    return new, points


def sums_of_detections(
    scan: Scan, unassigned: IntArray, first_number: int, parameters: TrackManagerParameters
) -> tuple[NewTracks, Sums | None]:
    """Start a Gaussian sum from each unassigned detection of a sensor with a model of its own.

    ``first_number`` is the running number of the scan's first detection.

    Returns
    -------
    new, sums
        The tracks that start, with the moments of their sums, and the sums.
    """
    p = parameters
    model = MEASUREMENT_MODELS[scan.sensor_model]
    if not len(unassigned) or not p.gaussian_sum_start or not model.starts:
        return NewTracks(), None
    reach = Reach(
        p.gaussian_sum_nearest_m,
        p.gaussian_sum_farthest_m,
        p.gaussian_sum_components,
        p.max_speed_mps,
    )
    sums = start_sums(observed(scan).select(unassigned), reach)
    count = len(unassigned)
    return NewTracks(
        *moments(sums.weight, sums.mean, sums.covariance),
        detection=unassigned,
        first_stamp_ns=np.full(count, scan.key.stamp_ns, dtype=np.int64),
        gap_scans=np.zeros(count, dtype=np.int64),
        first_number=first_number + unassigned,
        log_density=np.zeros(count),
    ), sums


def hypotheses_of_births(
    new: NewTracks,
    count: int,
    scan: Scan,
    evidence: Evidence | None,
    table: HypothesisTable,
    first_track_id: int,
    first_hypothesis_id: int,
    parameters: TrackManagerParameters,
) -> HypothesisTable:
    """Return the first ``count`` of the new tracks as rows that fit under ``table``.

    ``table`` is widened where their beliefs need more focal columns than it has.
    """
    detection = new.detection[:count]
    ids = np.arange(count, dtype=np.int64)
    ones, zeros = np.ones(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    masses, classes = _first_beliefs(detection, evidence, table)
    started = HypothesisTable(
        hypothesis_id=first_hypothesis_id + ids,
        parent_id=zeros,
        track_id=first_track_id + ids,
        status=np.full(count, TENTATIVE, dtype=np.int64),
        mean=new.mean[:count],
        covariance=new.covariance[:count],
        history=(ones << new.gap_scans[:count]) | 1,
        age_scans=new.gap_scans[:count] + 1,
        # From two detections, or a sum from one.
        hits=ones + (new.gap_scans[:count] > 0),
        misses=np.maximum(new.gap_scans[:count] - 1, 0),
        coasted_scans=zeros,
        first_detection_ns=new.first_stamp_ns[:count],
        last_detection_ns=np.full(count, scan.key.stamp_ns, dtype=np.int64),
        detection_index=scan.source_index[detection].astype(np.int64),
        # The two detections say where the track is, not whether there is a target.
        log_likelihood_ratio=np.zeros(count),
        conflict=np.zeros(count),
        masses=masses,
        class_probability=classes,
    )
    begin_windows(started, table, evidence, detection)
    if parameters.extraction == M_OF_N:
        started.status = confirmed(
            started.status,
            started.history,
            parameters.confirmation_hits,
            parameters.confirmation_scans,
        )
    if not has_models(parameters):
        return started
    return with_models(started, parameters, scan.key.stamp_ns)


def _first_beliefs(
    detection: IntArray, evidence: Evidence | None, table: HypothesisTable
) -> tuple[FloatArray, FloatArray]:
    """Masses and class probabilities of tracks whose newest detections these are."""
    if evidence is None:
        # Nothing is known of the scan: the new tracks know nothing about their class.
        n, c = len(detection), len(table.class_names)
        return _ignorance(n, table), np.full((n, c), 1.0 / max(c, 1))
    if not np.array_equal(table.focal, evidence.focal):
        columns = np.union1d(table.focal, evidence.focal).astype(np.uint32)
        if len(columns) != len(table.focal):
            missing = columns[~np.isin(columns, table.focal)]
            table.use_focal(np.concatenate([table.focal, missing]))
    masses = move_columns(evidence.masses[detection], evidence.focal, table.focal)
    return masses, evidence.class_probability[detection]


def _ignorance(n: int, table: HypothesisTable) -> FloatArray:
    if not table.frame:
        return np.zeros((n, 0))
    total = np.uint32((1 << ((1 << len(table.frame)) - 1)) - 1)
    if total not in table.focal:
        table.use_focal(np.append(table.focal, total).astype(np.uint32))
    return np.where(table.focal == total, 1.0, 0.0)[None, :].repeat(n, axis=0)
