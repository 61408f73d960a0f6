"""Scores of formations against the truth: their numbers, when they are right, what is told of them.

What the tracker calls together is a matter of two bounds on distance and velocity; the same bounds,
applied to the true states, make the true formations: a pair is together from the one bound on, and
until the other is reached. So there are true splits and mergers, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components

from gda_tracker.evaluation.matching import known_targets, match_scan
from gda_tracker.formations.found import MERGED, SPLIT, Formation, Formations
from gda_tracker.formations.lineage import regroup
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.tracking.ring import RingResult
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

Sides = list[set[int]]


@dataclass(frozen=True)
class Told:
    """Splits or mergers of one run: true ones, those of them that were told, and false ones.

    ``delay_s`` (told,) runs from the scan from which one is true to that which tells it, negative
    where it was told before.
    """

    true: int
    told: int
    false: int
    delay_s: FloatArray


@dataclass(frozen=True)
class FormationScore:
    """One run. A sample is a true formation on a scan.

    ``decided`` and ``probable`` (S,) whether the number decided last, and the most probable one,
    are right; without a formation that holds one of its tracks neither is. ``delay_s`` (G,) of each
    true formation the time from its beginning to the first right decision, NaN: none. ``stated``
    (K,) probability of the most probable number, ``right`` (K,) whether it is right, ``of_truth``
    (K,) probability of the true number, of the samples with a formation.
    """

    decided: BoolArray
    probable: BoolArray
    delay_s: FloatArray
    stated: FloatArray
    right: BoolArray
    of_truth: FloatArray
    splits: Told
    mergers: Told


@dataclass(frozen=True)
class _Event:
    """A split or merger: the targets that part or come together, side by side."""

    stamp_ns: int
    sides: Sides


def follow_formations(
    results: Sequence[RingResult], parameters: FormationParameters
) -> list[Formations]:
    """Formations after each scan of a run."""
    tracker, found = FormationTracker(parameters), []
    for result in results:
        assert result.tracks is not None
        found.append(tracker.take(result.tracks, result.scan, result.predictions))
    return found


def score_formations(
    found: Sequence[Formations],
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth],
    match_distance_m: float,
    parameters: FormationParameters,
) -> FormationScore:
    """Score the formations of one run.

    Parameters
    ----------
    found, tracks, truth
        One entry per scan.
    match_distance_m
        How far a track may be from its target.
    parameters
        Those of the formations, whose bounds make the true ones.

    Raises
    ------
    ValueError
        If the numbers of scans differ.
    """
    if not len(found) == len(tracks) == len(truth):
        raise ValueError(
            f"{len(found)} scans with formations, {len(tracks)} with tracks, {len(truth)} with "
            "truth: must be equal"
        )
    groups = true_formations(truth, parameters)
    owners = [
        _targets_of_tracks(*pair, match_distance_m) for pair in zip(tracks, truth, strict=True)
    ]
    most = parameters.largest_number
    decided, probable, stated, right, of_truth = [], [], [], [], []
    begun: dict[tuple[int, ...], int] = {}
    delays: list[float] = []
    waiting: dict[tuple[int, ...], int] = {}
    for told, known, owner, now in zip(found, groups, owners, truth, strict=True):
        keys = {tuple(group.tolist()) for group in known}
        for gone in [key for key in begun if key not in keys]:
            delays.append(float("nan")) if gone in waiting else None
            begun.pop(gone)
            waiting.pop(gone, None)
        for group in known:
            key, number = tuple(group.tolist()), min(len(group), most)
            if key not in begun:
                begun[key] = waiting[key] = now.stamp_ns
            held = _held_by(told.formations, owner, set(key))
            decided.append(held is not None and held.number == number)
            best = 0 if held is None else int(held.number_probabilities.argmax()) + 1
            probable.append(best == number)
            if decided[-1] and key in waiting:
                delays.append((now.stamp_ns - waiting.pop(key)) / 1e9)
            if held is not None:
                stated.append(float(held.number_probabilities.max()))
                right.append(probable[-1])
                of_truth.append(float(held.number_probabilities[number - 1]))
    delays += [float("nan")] * len(waiting)
    true_splits, true_mergers = _true_events(groups, truth)
    told_splits, told_mergers = _told_events(found, owners)
    return FormationScore(
        np.array(decided, dtype=bool),
        np.array(probable, dtype=bool),
        np.array(delays),
        np.array(stated),
        np.array(right, dtype=bool),
        np.array(of_truth),
        _compare(true_splits, told_splits),
        _compare(true_mergers, told_mergers),
    )


def true_formations(
    truth: Sequence[ScanTruth], parameters: FormationParameters
) -> list[list[IntArray]]:
    """True formations on each scan, target ids of each, rising, by the lowest one."""
    ids = np.unique(np.concatenate([known.target_id for known in truth]))
    linked = np.zeros((len(ids), len(ids)), dtype=bool)
    p, found = parameters, []
    for known in truth:
        rows = known_targets(known)
        place = np.searchsorted(ids, known.target_id[rows])
        state = known.target_state[rows]
        gap = state[:, None, :] - state[None, :, :]
        apart_m, apart_mps = (np.hypot(gap[..., k], gap[..., k + 1]) for k in (0, 2))
        together = (apart_m <= p.together_distance_m) & (apart_mps <= p.together_speed_mps)
        parted = (apart_m >= p.apart_distance_m) | (apart_mps >= p.apart_speed_mps)
        now = np.zeros_like(linked)
        own = np.ix_(place, place)
        now[own] = (linked[own] & ~parted) | together
        linked = now
        count, label = connected_components(now[own], directed=False)
        found.append([np.sort(ids[place[label == group]]) for group in range(count)])
    return found


def _targets_of_tracks(tracks: Tracks, truth: ScanTruth, match_distance_m: float) -> dict[int, int]:
    """Target of each matched track."""
    target, track, _ = match_scan(tracks, truth, match_distance_m)
    pairs = zip(tracks.track_id[track].tolist(), truth.target_id[target].tolist(), strict=True)
    return dict(pairs)


def _held_by(
    formations: Sequence[Formation], owner: dict[int, int], targets: set[int]
) -> Formation | None:
    """The formation with most tracks of these targets, the first of equal ones."""
    best, most = None, 0
    for one in formations:
        count = sum(owner.get(track) in targets for track in one.track_ids.tolist())
        if count > most:
            best, most = one, count
    return best


def _true_events(
    groups: Sequence[Sequence[IntArray]], truth: Sequence[ScanTruth]
) -> tuple[list[_Event], list[_Event]]:
    """True splits and mergers of a run."""
    splits, mergers = [], []
    for before, after, now in zip(groups, groups[1:], truth[1:], strict=False):
        found = regroup(list(before), list(after))
        for row in np.unique(found.parent[found.parent >= 0]).tolist():
            parts = np.flatnonzero((found.parent == row) | (found.continues == row))
            sides = [
                set(after[part].tolist()) & set(before[row].tolist()) for part in parts.tolist()
            ]
            splits.append(_Event(now.stamp_ns, sides))
        for group in np.unique(found.joins[found.joins >= 0]).tolist():
            rows = np.flatnonzero(found.joins == group).tolist()
            rows += [int(row) for row in found.continues[[group]] if row >= 0]
            mergers.append(_Event(now.stamp_ns, [set(before[row].tolist()) for row in rows]))
    return splits, mergers


def _told_events(
    found: Sequence[Formations], owners: Sequence[dict[int, int]]
) -> tuple[list[_Event], list[_Event]]:
    """Splits and mergers that were told, of the targets of the tracks."""
    splits, mergers = [], []
    before: dict[int, IntArray] = {}
    for told, owner in zip(found, owners, strict=True):
        after = {one.formation_id: one.track_ids for one in told.formations}
        for event in told.events:
            members = (event.formation_id, *event.other_formation_ids)
            source = after if event.kind == SPLIT else before
            sides = [
                {owner[track] for track in source[one].tolist() if track in owner}
                for one in members
                if one in source
            ]
            if event.kind == SPLIT:
                splits.append(_Event(told.key.stamp_ns, sides))
            elif event.kind == MERGED:
                mergers.append(_Event(told.key.stamp_ns, sides))
        before = after
    return splits, mergers


def _compare(true: Sequence[_Event], told: Sequence[_Event]) -> Told:
    """Each true event is told once at most, by the nearest in time that parts or joins the same."""
    pairs = [
        (abs(event.stamp_ns - other.stamp_ns), row, column)
        for row, event in enumerate(true)
        for column, other in enumerate(told)
        if _same(event.sides, other.sides)
    ]
    used_true: set[int] = set()
    used_told: set[int] = set()
    delay_s = []
    for _, row, column in sorted(pairs):
        if row not in used_true and column not in used_told:
            used_true.add(row)
            used_told.add(column)
            delay_s.append((told[column].stamp_ns - true[row].stamp_ns) / 1e9)
    return Told(len(true), len(used_true), len(told) - len(used_told), np.array(delay_s))


def _same(one: Sides, other: Sides) -> bool:
    """Whether two targets on different sides of the one are on different sides of the other."""
    for a, b in combinations(one, 2):
        for c, d in combinations(other, 2):
            if (a & c and b & d) or (a & d and b & c):
                return True
    return False
