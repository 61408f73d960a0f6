"""Tracks that can be tested: numbers all, with covariances that are some."""

from __future__ import annotations

from collections import Counter

import numpy as np

from gda_tracker.events.detector import LARGEST_NUMBER, TracksRejected
from gda_tracker.events.samples import States
from gda_tracker.vocabulary.arrays import BoolArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

__all__ = ["TracksRejected", "check_tracks", "usable_states"]

_SIZE = 4  # x, y, vx, vy
# Of the correlations between place and velocity: what is below is not positive definite.
_LEAST_EIGENVALUE = 1e-12


def check_tracks(tracks: Tracks, epoch: int | None, system_uuid: bytes, last_ns: int) -> None:
    """Refuse tracks that cannot be those after the last ones.

    Raises
    ------
    TracksRejected
        The message is the reason, one word.
    """
    key = tracks.key
    if epoch is not None and key.epoch < epoch:
        raise TracksRejected("older_epoch")
    same = (key.epoch, tracks.system_uuid) == (epoch, system_uuid)
    if same and key.stamp_ns < last_ns:
        raise TracksRejected("tracks_time_backwards", f"{key.stamp_ns} ns after {last_ns} ns")
    if len(tracks) and tracks.mean.shape[1] < _SIZE:
        raise TracksRejected("tracks_state_too_small", f"{tracks.mean.shape[1]} components")
    if len(np.unique(tracks.track_id)) != len(tracks):
        raise TracksRejected("tracks_duplicate_track_id")


def usable_states(tracks: Tracks, counters: Counter[str]) -> tuple[States, BoolArray]:
    """Return the states that can be tested, and which of them are of confirmed tracks."""
    mean = tracks.mean[:, :_SIZE]
    covariance = tracks.covariance[:, :_SIZE, :_SIZE]
    with np.errstate(invalid="ignore"):
        small = np.concatenate([mean, covariance.reshape(len(mean), _SIZE * _SIZE)], axis=1)
        numbers = np.asarray((np.abs(small) < LARGEST_NUMBER).all(axis=1), dtype=bool)
    safe = np.where(numbers[:, None, None], covariance, np.eye(_SIZE))
    safe = (safe + safe.swapaxes(1, 2)) / 2.0
    variance = np.diagonal(safe, axis1=1, axis2=2)
    positive = np.asarray((variance > _LEAST_EIGENVALUE).all(axis=1), dtype=bool)
    scale = np.sqrt(np.where(positive[:, None], variance, 1.0))
    correlation = safe / (scale[:, :, None] * scale[:, None, :])
    definite = positive & (np.linalg.eigvalsh(correlation)[:, 0] > _LEAST_EIGENVALUE)
    for which, reason in (
        (~numbers, "formation_track_not_finite"),
        (numbers & ~definite, "formation_track_bad_covariance"),
    ):
        if which.any():
            counters[reason] += int(which.sum())
    good = np.flatnonzero(numbers & definite)
    good = good[np.argsort(tracks.track_id[good])]
    states = States(
        tracks.key.stamp_ns,
        tracks.track_id[good],
        mean[good, :2],
        mean[good, 2:],
        safe[good],
        tracks.detection_index[good] >= 0,
        np.zeros(len(good), dtype=bool),
    )
    return states, tracks.status[good] == CONFIRMED
