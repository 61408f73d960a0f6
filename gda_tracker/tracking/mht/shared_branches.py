"""Branches of a scan that share a detection with a branch of another track.

An event of a group, two or three leaves and one detection, becomes a branch of each of them, with
an equal share of the event's log score. Only all together are in a global hypothesis
(:mod:`gda_tracker.tracking.mht.couplings`). That a group gave nothing changes no state. Of two
tracks on their own it is part of the factor of two misses, (1 - P_u) + P_u (1 - P_Du) / (1 -
P_D)^2; where a third one is coupled with them it has branches like the other events, for no track
is in two groups. Groups of three are found by :mod:`gda_tracker.tracking.mht.threes`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.mht.branches import Branches
from gda_tracker.tracking.mht.couplings import (
    CoupledTracks,
    Couplings,
    components,
    coupled_tracks,
    in_conflict,
    together,
)
from gda_tracker.tracking.mht.threes import EventsOfThree, events_of_three, no_events_of_three
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan

MOST_EVENTS = 64
"""Events that become branches of two tracks, the most probable ones."""


@dataclass(frozen=True, slots=True)
class SharedBranches:
    """Branches of a scan with those that share, and the factors of coupled tracks.

    ``partner`` (B, 2) are the rows of the leaves that a branch shares its detection with, -1 for
    none; ``event`` (B,) the row of the event in the associations, followed by ``threes``, -1 for
    branches that share nothing.
    """

    branches: Branches
    partner: IntArray
    event: IntArray
    coupled: list[CoupledTracks]
    threes: EventsOfThree = field(default_factory=no_events_of_three)


def nothing_shared(
    branches: Branches, table: HypothesisTable, couplings: Couplings, track: IntArray
) -> SharedBranches:
    """Branches of a scan on which no tracks are near each other: factors are the parents'.

    ``track`` (H,) is the rank of each leaf's track.
    """
    none = np.full((len(branches), 2), -1, dtype=np.int64)
    coupled = [
        CoupledTracks(pair.first, pair.second, _of_parents(pair, branches, track))
        for pair in coupled_tracks(couplings, table.hypothesis_id, track)
    ]
    return SharedBranches(branches, none, none[:, 0], coupled)


def share(
    branches: Branches,
    table: HypothesisTable,
    scan: Scan,
    predictions: Predictions,
    associations: Associations,
    couplings: Couplings,
    track: IntArray,
    first_number: int,
    said: FloatArray,
) -> SharedBranches:
    """Add the branches that share detections.

    Parameters
    ----------
    branches
        Those that share nothing.
    table, scan, predictions, associations
        The leaves, and the answer on the scan.
    couplings
        Of the leaves.
    track
        (H,) rank of each leaf's track.
    first_number
        Running number of the scan's first detection.
    said
        (H,) log factors of statements for no detection of its own.
    """
    if not len(table):
        none = np.zeros((0, 2), dtype=np.int64)
        return SharedBranches(branches, none, none[:, 0], [])
    known = coupled_tracks(couplings, table.hypothesis_id, track)
    pairs, of_event = _coupled_pairs(known, associations, track)
    if not pairs:
        return nothing_shared(branches, table, couplings, track)
    parts = components(pairs)
    size = {member: len(part) for part in parts for member in part}
    among_three = np.array([size[a] > 2 for a, _ in pairs])
    starts = _starts(pairs, known, table, track)
    near = _nearness(pairs, of_event, associations, track)
    score = event_scores(predictions, associations)
    counts = (associations.group_detection >= 0) | among_three[of_event]
    events = _best_events(score, of_event, counts & (of_event >= 0), table, associations)
    threes = events_of_three(parts, starts, near, table, track, predictions, scan)
    grown, partner, event = _with_shares(
        branches, table, associations, events, score, threes, first_number, said
    )
    coupled = [
        CoupledTracks(
            start.first,
            start.second,
            _factors(
                start,
                near[start.first, start.second],
                grown,
                partner,
                event,
                track,
                predictions,
                size[start.first] > 2,
            ),
        )
        for start in starts
    ]
    return SharedBranches(grown, partner, event, coupled, threes)


def _starts(
    pairs: list[tuple[int, int]],
    known: list[CoupledTracks],
    table: HypothesisTable,
    track: IntArray,
) -> list[CoupledTracks]:
    """Factors of the leaves of each pair of tracks before the scan."""
    factors = {(pair.first, pair.second): pair for pair in known}
    found = []
    for a, b in pairs:
        if (a, b) not in factors:
            one, two = (table.detection_numbers[track == rank] for rank in (a, b))
            clash = in_conflict(one, two)
            factors[a, b] = CoupledTracks(a, b, np.where(clash, -np.inf, 0.0))
        found.append(factors[a, b])
    return found


def _nearness(
    pairs: list[tuple[int, int]], of_event: IntArray, associations: Associations, track: IntArray
) -> dict[tuple[int, int], FloatArray]:
    """P_u (a, b) of the leaves of each pair of tracks."""
    count = np.bincount(track)
    begin = np.cumsum(count) - count
    unresolved = np.flatnonzero((associations.group_detection < 0) & (of_event >= 0))
    found = {}
    for index, (a, b) in enumerate(pairs):
        near = np.zeros((count[a], count[b]))
        mine = unresolved[of_event[unresolved] == index]
        first, second = associations.group_first[mine], associations.group_second[mine]
        near[first - begin[a], second - begin[b]] = associations.group_unresolved[mine]
        found[a, b] = near
    return found


def detected_probability(
    predictions: Predictions, first: IntArray | Int32Array, second: IntArray | Int32Array
) -> FloatArray:
    """P_Du of groups of two hypotheses."""
    given = predictions.settings.unresolved_detection_probability
    if given > 0.0:
        return np.full(np.broadcast_shapes(first.shape, second.shape), given)
    single = predictions.detection_probability
    return np.asarray(0.5 * (single[first] + single[second]))


def event_scores(predictions: Predictions, associations: Associations) -> FloatArray:
    """Log likelihood ratio (E,) of the events against false alarms.

    P_u P_Du N / beta with a detection, P_u (1 - P_Du) without.
    """
    first, second = associations.group_first, associations.group_second
    with np.errstate(divide="ignore"):
        log_clutter = max(float(np.log(predictions.settings.clutter_density)), LOG_VANISHING)
        detected = detected_probability(predictions, first, second)
        gain = np.where(
            associations.group_detection >= 0,
            np.log(detected) + associations.group_log_likelihood - log_clutter,
            np.maximum(np.log1p(-detected), LOG_VANISHING),
        )
        return np.asarray(np.log(associations.group_unresolved) + gain)


def _coupled_pairs(
    known: list[CoupledTracks], associations: Associations, track: IntArray
) -> tuple[list[tuple[int, int]], IntArray]:
    """Pairs of tracks that are coupled, those that were first, and the pair of each event."""
    key = track[associations.group_first] * (track[-1] + 1) + track[associations.group_second]
    new, of_event = np.unique(key, return_inverse=True)
    nearest = np.zeros(len(new))
    np.maximum.at(nearest, of_event, associations.group_unresolved)
    order = np.argsort(-nearest, kind="stable")
    pairs = [(pair.first, pair.second) for pair in known]
    for value in new[order].tolist():
        pair = divmod(value, int(track[-1]) + 1)
        if pair not in pairs:
            pairs.append(pair)
    pairs = [pair for pair, taken in zip(pairs, together(pairs), strict=True) if taken]
    # Of three tracks every two need a factor: all may be one group.
    for part in components(pairs):
        pairs += [pair for pair in itertools.combinations(part, 2) if pair not in pairs]
    index = {pair: place for place, pair in enumerate(pairs)}
    place = [index.get(divmod(value, int(track[-1]) + 1), -1) for value in new.tolist()]
    return pairs, np.array(place, dtype=np.int64)[of_event]


def _best_events(
    score: FloatArray,
    of_event: IntArray,
    counts: BoolArray,
    table: HypothesisTable,
    associations: Associations,
) -> IntArray:
    """Those of the events that count (E,) that become branches, in their order."""
    events = np.flatnonzero(counts)
    whole = (
        score[events]
        + table.log_score[associations.group_first[events]]
        + table.log_score[associations.group_second[events]]
    )
    order = np.lexsort((-whole, of_event[events]))
    pair = of_event[events][order]
    rank = np.arange(len(order)) - np.searchsorted(pair, pair)
    return np.sort(events[order[rank < MOST_EVENTS]])


def _with_shares(
    branches: Branches,
    table: HypothesisTable,
    associations: Associations,
    events: IntArray,
    score: FloatArray,
    threes: EventsOfThree,
    first_number: int,
    said: FloatArray,
) -> tuple[Branches, IntArray, IntArray]:
    """Branches (B,) with one for each member of each event, their partners and events."""
    first = associations.group_first[events].astype(np.int64)
    second = associations.group_second[events].astype(np.int64)
    none = np.full(len(events), -1, dtype=np.int64)
    a, b, c = threes.rows.T
    member = np.concatenate([first, second, a, b, c])
    others = np.concatenate(
        [
            np.stack([second, none], axis=1),
            np.stack([first, none], axis=1),
            np.stack([b, c], axis=1),
            np.stack([a, c], axis=1),
            np.stack([a, b], axis=1),
        ]
    )
    number_of_three = len(associations.group_first) + np.arange(len(threes))
    event = np.concatenate([np.tile(events, 2), np.tile(number_of_three, 3)])
    detection = np.concatenate(
        [np.tile(associations.group_detection[events], 2), np.tile(threes.detection, 3)]
    ).astype(np.int64)
    gain = np.concatenate([np.tile(score[events], 2) / 2.0, np.tile(threes.score, 3) / 3.0])
    number = np.concatenate(
        [
            np.where(detection >= 0, first_number + detection, -1)[:, None],
            table.detection_numbers[member],
        ],
        axis=1,
    )
    parent = np.concatenate([branches.parent, member])
    order = np.argsort(parent, kind="stable")
    nothing = np.full((len(branches), 2), -1, dtype=np.int64)
    grown = Branches(
        parent[order],
        np.concatenate([branches.pair, np.full(len(member), -1)])[order],
        np.concatenate([branches.detection, detection])[order],
        table.track_id[parent][order],
        np.concatenate([branches.log_score, table.log_score[member] + gain + said[member]])[order],
        np.concatenate([branches.detection_numbers, number])[order],
    )
    partner = np.concatenate([nothing, others])[order]
    return grown, partner, np.concatenate([nothing[:, 0], event])[order]


def _of_parents(pair: CoupledTracks, branches: Branches, track: IntArray) -> FloatArray:
    """Factors of all branches of two tracks that share nothing on this scan."""
    of_branch = track[branches.parent]
    begin = np.searchsorted(track, [pair.first, pair.second])
    rows, columns = of_branch == pair.first, of_branch == pair.second
    parents = np.ix_(branches.parent[rows] - begin[0], branches.parent[columns] - begin[1])
    used, used_too = branches.detection[rows][:, None], branches.detection[columns]
    return np.where((used == used_too) & (used >= 0), -np.inf, pair.log_factor[parents])


def _factors(
    start: CoupledTracks,
    near: FloatArray,
    branches: Branches,
    partner: IntArray,
    event: IntArray,
    track: IntArray,
    predictions: Predictions,
    among_three: bool,
) -> FloatArray:
    """Factors (a, b) of the branches of two tracks; ``near`` are the P_u of their parents."""
    of_branch = track[branches.parent]
    rows = np.flatnonzero(of_branch == start.first)
    columns = np.flatnonzero(of_branch == start.second)
    begin = np.searchsorted(track, [start.first, start.second])
    parents = np.ix_(branches.parent[rows] - begin[0], branches.parent[columns] - begin[1])
    factor, unresolved = start.log_factor[parents], near[parents]

    def shared_with(mine: IntArray, other: int) -> IntArray:
        """Event of each branch (n,) if it shares its detection with that track, else -1."""
        with_other = (partner[mine] >= 0) & (track[partner[mine]] == other)
        return np.where(with_other.any(axis=1), event[mine], -1)

    one, two = shared_with(rows, start.second)[:, None], shared_with(columns, start.first)
    used, used_too = branches.detection[rows][:, None], branches.detection[columns]
    clash = (one != two) | ((one < 0) & (used == used_too) & (used >= 0))
    missed = (used < 0) & (used_too < 0)
    if among_three:
        missed[:] = False
    a, b = branches.parent[rows][:, None], branches.parent[columns][None]
    detected = detected_probability(predictions, a, b)
    single = predictions.detection_probability
    with np.errstate(divide="ignore"):
        resolved = np.log1p(-unresolved)
        missed_together = np.maximum(np.log1p(-detected), LOG_VANISHING) - sum(
            np.maximum(np.log1p(-single[each]), LOG_VANISHING) for each in (a, b)
        )
        empty = np.logaddexp(resolved, np.log(unresolved) + missed_together)
    apart = np.where(missed, empty, resolved)
    return np.where(clash, -np.inf, factor + np.where(one >= 0, 0.0, apart))
