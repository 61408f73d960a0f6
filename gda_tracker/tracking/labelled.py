"""Labelled initiation: tracks from detections whose sources are known, as in the 2004 chapter.

Not part of the track manager: what it makes reaches the manager as ``initial_tracks``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gda_tracker.attributes.fusion import fuse_pairs
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.tracking.initiation import two_point_states
from gda_tracker.tracking.ring import Prepared, Ring
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


def labelled_tracks(
    recording: Recording,
    n_initiation_scans: int,
    ring: Ring,
    prepared: Sequence[Prepared] | None = None,
) -> Tracks:
    """Start one confirmed track per target from the first ``n_initiation_scans`` scans.

    States come from two-point differencing of the last two of them, the belief is that of the first
    detection fused with those that follow by the attribute term of the ring's parameters (Tchamova
    et al. 2004, section 14.2.2 and the scenario files' ``history_initialisation``), under the
    history policy ``window`` no more than the last of them. Track ids count
    the targets by rising id, from 1; the stamp is that of the last initiation scan. ``prepared``
    are these scans as :meth:`Ring.prepare` makes them, if they are known already.

    Raises
    ------
    ValueError
        If the recording has too few scans, or its truth does not label every target's detection in
        each of these scans.
    """
    if recording.truth is None or n_initiation_scans < 2:
        raise ValueError("labelled initiation needs truth and at least two scans")
    if len(recording.detections) < n_initiation_scans:
        raise ValueError(
            f"{recording.name}: {len(recording.detections)} scans, labelled initiation needs "
            f"{n_initiation_scans}"
        )
    manager = ring.manager.parameters
    windowed = manager.history_policy == "window"
    window = manager.history_window if windowed else n_initiation_scans
    if prepared is None:
        prepared = [ring.prepare(scan) for scan in recording.detections[:n_initiation_scans]]
    targets = np.sort(recording.truth[0].target_id)
    count = len(targets)
    positions, covariances, stamps = [], [], []
    frame: tuple[str, ...] = ()
    for step, known in enumerate(prepared[:n_initiation_scans]):
        scan, evidence = known.validated[0], known.evidence
        rows = _rows_of(recording, step, scan.source_index, targets)
        position, covariance = cartesian_positions(polar_measurements(scan))
        positions.append(position[rows])
        covariances.append(covariance[rows])
        stamps.append(scan.key.stamp_ns)
        if step == 0 or step <= n_initiation_scans - window:
            frame, focal = evidence.frame, evidence.focal
            masses, classes = evidence.masses[rows], evidence.class_probability[rows]
            conflict = np.zeros(count)
        elif manager.attribute_term != "none":
            fused = fuse_pairs(
                manager.attribute_term,
                frame,
                focal,
                masses,
                classes,
                evidence,
                rows,
                manager.share_kept,
                ring.fusion.class_transition,
            )
            classes, conflict = fused.class_probability, fused.conflict
            if fused.masses.shape[1]:
                focal, masses = fused.focal, fused.masses
    if stamps[-1] <= stamps[-2]:
        raise ValueError(
            f"{recording.name}: stamps {stamps[-2]} and {stamps[-1]} ns of scans "
            f"{n_initiation_scans - 2} and {n_initiation_scans - 1} do not rise"
        )
    dt = np.full(count, (stamps[-1] - stamps[-2]) / 1e9)
    mean, covariance = two_point_states(
        positions[-2], covariances[-2], positions[-1], covariances[-1], dt
    )
    ids = np.arange(1, count + 1, dtype=np.int64)
    ones = np.ones(count, dtype=np.int64)
    return Tracks(
        key=ScanKey(0, recording.detections[0].sensor_id, stamps[-1]),
        frame_id=manager.tracking_frame,
        track_id=ids,
        hypothesis_id=ids,
        status=np.full(count, CONFIRMED, dtype=np.int64),
        mean=mean,
        covariance=covariance,
        frame=frame,
        focal=focal,
        masses=masses,
        class_names=evidence.class_names,
        class_probability=classes,
        conflict=conflict,
        existence_probability=np.ones(count),
        hits=n_initiation_scans * ones,
        misses=0 * ones,
        coasted_scans=0 * ones,
        first_detection_ns=stamps[0] * ones,
        last_detection_ns=stamps[-1] * ones,
        detection_index=scan.source_index[rows].astype(np.int32),
    )


def _rows_of(
    recording: Recording, step: int, source_index: np.ndarray, targets: np.ndarray
) -> np.ndarray:
    """Rows (T,) of the targets' own detections in an admitted scan."""
    assert recording.truth is not None
    sources = recording.truth[step].source_id
    rows = []
    for target in targets:
        labels = np.zeros(0) if sources is None else sources[source_index]
        own = np.flatnonzero(labels == target)
        if len(own) != 1:
            raise ValueError(
                f"{recording.name}: scan {step} has {len(own)} detections labelled target "
                f"{target}, labelled initiation needs one"
            )
        rows.append(int(own[0]))
    return np.array(rows, dtype=np.int64)
