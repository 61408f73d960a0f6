"""What comes in: the tracks of one radar, checked and in the common frame."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.fusion.motion import STATE
from gda_tracker.fusion.parameters import SAME_FRAME, TrackFusionParameters
from gda_tracker.kinematics.rigid_transforms import RigidTransform, rotation_matrix
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

LARGEST_TILT_RAD = 0.02
"""Frames that lean more against each other are refused: tracks are made in the plane."""

LARGEST_NUMBER = 1e9
LARGEST_CONDITION = 1e14


class Refused(ValueError):
    """A message is refused; ``reason`` is one word for counters."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


@dataclass(frozen=True)
class Report:
    """The n tracks of a radar at one time, by rising id, in the common frame.

    ``belief`` (n, K) over ``class_names``; ``last_detection_ns`` (n,), 0: not known;
    ``company`` (n,) fused track that already holds what the radar learnt of the track, or -1.
    """

    radar: int
    stamp_ns: int
    system_uuid: bytes
    epoch: int
    track_id: IntArray
    mean: FloatArray
    covariance: FloatArray
    class_names: tuple[str, ...]
    belief: FloatArray
    existence: FloatArray
    last_detection_ns: IntArray
    company: IntArray

    def __len__(self) -> int:
        return len(self.track_id)


def report_of(
    radar: int,
    tracks: Tracks,
    parameters: TrackFusionParameters,
    transform: RigidTransform | None,
    counters: Counter[str],
) -> Report:
    """Check the tracks of a radar and bring them into the common frame.

    Tracks that cannot be used are left out and counted.

    Parameters
    ----------
    transform
        From the frame of the tracks to the common one; ``None`` with alignment ``same_frame``.

    Raises
    ------
    Refused
        If the message as a whole cannot be used.
    """
    name = parameters.radars[radar]
    if len(tracks) > parameters.max_tracks_per_radar:
        raise Refused(
            "refused_too_many_tracks",
            f"{name}: {len(tracks)} tracks; allowed are {parameters.max_tracks_per_radar}",
        )
    if tracks.mean.shape[1] != STATE:
        raise Refused(
            "refused_state_size",
            f"{name}: states of {tracks.mean.shape[1]} numbers; allowed are x, y, vx, vy",
        )
    if parameters.alignment == SAME_FRAME and tracks.frame_id != parameters.fusion_frame:
        raise Refused(
            "refused_frame",
            f"{name}: frame {tracks.frame_id!r}; allowed is {parameters.fusion_frame!r} with "
            f"alignment {SAME_FRAME}",
        )
    rows = _usable(tracks, parameters, counters)
    order = rows.nonzero()[0]
    order = order[np.argsort(tracks.track_id[order], kind="stable")]
    mean, covariance = tracks.mean[order], tracks.covariance[order]
    if transform is not None:
        mean, covariance = _moved(mean, covariance, transform, name)
    belief = tracks.class_probability[order]
    last = tracks.last_detection_ns
    if belief.size:
        with np.errstate(invalid="ignore"):
            bad = np.asarray(~((belief >= 0.0) & np.isfinite(belief)).all(axis=1))
        _count(counters, "class_belief_not_valid", bad)
    return Report(
        radar,
        tracks.key.stamp_ns,
        tracks.system_uuid,
        tracks.key.epoch,
        tracks.track_id[order],
        mean,
        0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
        tuple(tracks.class_names),
        belief,
        tracks.existence_probability[order],
        last[order] if len(last) else np.zeros(len(order), dtype=np.int64),
        np.full(len(order), -1),
    )


def _usable(tracks: Tracks, parameters: TrackFusionParameters, counters: Counter[str]) -> BoolArray:
    """Which tracks (N,) count; the others are counted by reason."""
    wanted: BoolArray = np.asarray((tracks.status == CONFIRMED) | parameters.tentative)
    with np.errstate(invalid="ignore"):
        near = (np.abs(tracks.mean) <= LARGEST_NUMBER).all(axis=1)
        sound: BoolArray = np.asarray(near & np.isfinite(tracks.covariance).all(axis=(1, 2)))
    _count(counters, "track_not_finite", wanted & ~sound)
    wanted &= sound
    symmetric = 0.5 * (tracks.covariance + np.swapaxes(tracks.covariance, 1, 2))
    values = np.linalg.eigvalsh(np.where(sound[:, None, None], symmetric, np.eye(STATE)))
    definite = values[:, 0] * LARGEST_CONDITION > values[:, -1]
    _count(counters, "track_covariance_not_valid", wanted & ~definite)
    wanted &= definite
    _, first = np.unique(tracks.track_id, return_index=True)
    unique = np.zeros(len(tracks), dtype=np.bool_)
    unique[first] = True
    _count(counters, "track_id_twice", wanted & ~unique)
    return wanted & unique


def _count(counters: Counter[str], reason: str, bad: BoolArray) -> None:
    if bad.any():
        counters[reason] += int(bad.sum())


def _moved(
    mean: FloatArray, covariance: FloatArray, transform: RigidTransform, name: str
) -> tuple[FloatArray, FloatArray]:
    rotation = rotation_matrix(transform.rotation)
    if rotation[2, 2] < np.cos(LARGEST_TILT_RAD):
        raise Refused(
            "refused_tilted_frame",
            f"{name}: its frame leans by {np.degrees(np.arccos(rotation[2, 2])):.1f} deg; allowed "
            f"are {np.degrees(LARGEST_TILT_RAD):.1f} deg",
        )
    turn = np.kron(np.eye(2), rotation[:2, :2])
    moved = mean @ turn.T
    moved[:, :2] += transform.translation[:2]
    return moved, turn @ covariance @ turn.T


def with_company(report: Report, company: IntArray) -> Report:
    """The same report with other companies."""
    return replace(report, company=company)
