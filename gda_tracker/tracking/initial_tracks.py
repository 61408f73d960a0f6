"""Initial tracks: hypotheses that do not grow from detections but are given, with labels."""

from __future__ import annotations

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.manager_state import ManagerState
from gda_tracker.tracking.statement_desk import StatementDesk
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


def fault_of_initial_tracks(initial: Tracks) -> str:
    """Name what makes labelled tracks unusable, or return an empty text."""
    n = len(initial)
    shapes = (
        (initial.mean, (n, 4)),
        (initial.covariance, (n, 4, 4)),
        (initial.masses, (n, len(initial.focal))),
        (initial.class_probability, (n, len(initial.class_names))),
        (initial.conflict, (n,)),
        (initial.hits, (n,)),
        (initial.misses, (n,)),
        (initial.first_detection_ns, (n,)),
        (initial.last_detection_ns, (n,)),
        (initial.detection_index, (n,)),
    )
    if any(values.shape != shape for values, shape in shapes):
        return "initial_tracks_malformed"
    real = (
        initial.mean,
        initial.covariance,
        initial.masses,
        initial.class_probability,
        initial.conflict,
    )
    if not all(np.isfinite(values).all() for values in real):
        return "initial_tracks_not_finite"
    try:
        np.linalg.cholesky(initial.covariance)
    except np.linalg.LinAlgError:
        return "initial_tracks_bad_covariance"
    return ""


def hypotheses_of_tracks(
    initial: Tracks, first_track_id: int, first_hypothesis_id: int
) -> HypothesisTable:
    """Return the tracks as confirmed hypotheses with ids of their own, in the order given."""
    n = len(initial)
    ids = np.arange(n, dtype=np.int64)
    ones, zeros = np.ones(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    return HypothesisTable(
        hypothesis_id=first_hypothesis_id + ids,
        parent_id=zeros,
        track_id=first_track_id + ids,
        status=np.full(n, CONFIRMED, dtype=np.int64),
        mean=initial.mean.copy(),
        covariance=initial.covariance.copy(),
        history=3 * ones,
        age_scans=2 * ones,
        hits=initial.hits.astype(np.int64),
        misses=initial.misses.astype(np.int64),
        coasted_scans=zeros.copy(),
        first_detection_ns=initial.first_detection_ns.copy(),
        last_detection_ns=initial.last_detection_ns.copy(),
        detection_index=initial.detection_index.astype(np.int64),
        # What is given exists.
        log_likelihood_ratio=np.full(n, np.inf),
        conflict=initial.conflict.copy(),
        masses=initial.masses.copy(),
        class_probability=initial.class_probability.copy(),
        frame=initial.frame,
        focal=initial.focal.copy(),
        class_names=initial.class_names,
    )


def identity_of(initial: Tracks) -> tuple[bytes, int]:
    """Return what makes two messages of initial tracks the same: system UUID and stamp."""
    return initial.system_uuid, initial.key.stamp_ns


def state_of_initial_tracks(initial: Tracks, before: ManagerState) -> ManagerState:
    """Return the state that starts from labelled tracks; ids and the count of scans go on."""
    n = len(initial)
    return ManagerState(
        table=hypotheses_of_tracks(initial, before.next_track_id, before.next_hypothesis_id),
        next_track_id=before.next_track_id + n,
        next_hypothesis_id=before.next_hypothesis_id + n,
        next_detection_number=before.next_detection_number,
        last_ns=initial.key.stamp_ns,
        last_sensors=(initial.key.sensor_id,),
        initialised_from=identity_of(initial),
        scans_closed=before.scans_closed,
        # Like scans, statements may have waited for the first tracks.
        desk=before.desk if before.initialised_from is None else StatementDesk(),
    )
