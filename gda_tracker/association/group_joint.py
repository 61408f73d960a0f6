"""Joint probabilities where two targets may have given one detection between them.

A joint hypothesis says first who is one group, then which detection is whose. Its weight is the
product of P_u over the groups and 1 - P_u over the other links, times that of the reduced problem:
a group is one row, with w = P_Du N(z; ..), r = 1 - P_Du, in place of its members' (Koch 2014,
section 2.3.3). The sum runs over the sets of disjoint groups of a cluster, exactly; within each the
present engine sums over the assignments.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gda_tracker.association.assignment import LOG_VANISHING
from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.association.group_events import GroupEvents
from gda_tracker.association.joint import joint_marginals_batch
from gda_tracker.association.weightings import JointWeights
from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MOST_LINKS = 6
"""Links of a cluster that count, the least resolved ones first: at most 64 sets of groups."""


@dataclass(frozen=True, slots=True)
class GroupWeights:
    """Weights of Q weightings, in logarithms, for all H hypotheses and n detections of a scan.

    ``pair`` (Q, P), ``idle_hypothesis`` (Q, H), ``idle_detection`` (Q, n); ``group_pair`` (Q, E)
    and ``group_idle`` (Q, L) of groups.
    """

    pair: FloatArray
    idle_hypothesis: FloatArray
    idle_detection: FloatArray
    group_pair: FloatArray
    group_idle: FloatArray


@dataclass(frozen=True, slots=True)
class GroupAnswer:
    """Marginals where groups may be, under each of Q weightings.

    ``rows`` are the pairs, ``marginals`` (Q, rows) theirs; ``group_marginals`` (Q, E). ``chosen``
    (rows,) and ``group_chosen`` (E,) mark the most probable joint hypothesis of the last weighting.
    """

    rows: IntArray
    marginals: FloatArray
    group_marginals: FloatArray
    chosen: BoolArray
    group_chosen: BoolArray


def group_weights(
    events: GroupEvents,
    weightings: list[JointWeights],
    n_hypotheses: int,
    clutter_density: float,
    clutter_log_likelihood: list[FloatArray],
    said: FloatArray,
) -> GroupWeights:
    """Weights of hypotheses, detections and groups under several weightings.

    Parameters
    ----------
    events
        Of the scan.
    weightings
        Q of them, for the P gated pairs.
    n_hypotheses, clutter_density
        Of the scan; beta in 1/(m rad).
    clutter_log_likelihood
        Q times (n,): what the weighting gives to the attributes of a false alarm. A group's
        detection has attributes of both members, and no more to say of them than a false alarm.
    said
        (H,) log factors of statements on where the tracks are.
    """
    idle_hypothesis = np.array([one.log_idle[:n_hypotheses] for one in weightings])
    with np.errstate(divide="ignore"):
        clutter = np.array([np.log(clutter_density) + each for each in clutter_log_likelihood])
        detected, missed = np.log(events.detected), np.log1p(-events.detected)
    told = said[events.first] + said[events.second]
    attribute = np.array(clutter_log_likelihood)
    if attribute.shape[1]:
        attribute = attribute[:, np.maximum(events.detection, 0)]
    else:  # no detections, no events but the one without
        attribute = np.zeros((len(weightings), len(events.link)))
    return GroupWeights(
        np.array([one.log_pair for one in weightings]),
        np.maximum(idle_hypothesis, LOG_VANISHING),
        np.maximum(clutter, LOG_VANISHING),
        (detected + told)[events.link] + events.log_likelihood + attribute,
        np.tile(np.maximum(missed + told, LOG_VANISHING), (len(weightings), 1)),
    )


def resolve_groups(
    events: GroupEvents, pairs: GatedPairs, weights: GroupWeights, max_exact_size: int
) -> GroupAnswer:
    """Sum over the sets of groups in every cluster that has links.

    Clusters with more than ``max_exact_size`` hypotheses and as many detections keep their answer
    without groups.
    """
    layers = len(weights.pair)
    rows: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    marginals = [np.zeros((layers, 0))]
    group_marginals = np.zeros((layers, len(events.link)))
    group_chosen = np.zeros(len(events.link), dtype=np.bool_)
    chosen = [np.zeros(0, dtype=np.bool_)]
    for part in _parts(events, pairs, weights):
        if min(len(part.hypotheses), len(part.detections)) > max_exact_size:
            continue
        bordered = _bordered(part, events, weights)
        found, group_found, served, group_served = _answer(part, events, bordered)
        rows.append(part.pairs)
        marginals.append(found)
        chosen.append(served)
        group_marginals[:, part.events] = group_found
        group_chosen[part.events] = group_served
    return GroupAnswer(
        np.concatenate(rows),
        np.concatenate(marginals, axis=1),
        group_marginals,
        np.concatenate(chosen),
        group_chosen,
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A cluster with links: its nodes, pairs, links, events, and the sets of disjoint groups.

    ``row``, ``column`` are the places of the pairs among them. ``groups`` (M, l) marks the links of
    each set.
    """

    hypotheses: IntArray
    detections: IntArray
    pairs: IntArray
    row: IntArray
    column: IntArray
    links: IntArray
    events: IntArray
    groups: BoolArray


def _parts(events: GroupEvents, pairs: GatedPairs, weights: GroupWeights) -> Iterator[_Part]:
    """Connected parts of gates and links that have links."""
    h, n = weights.idle_hypothesis.shape[1], weights.idle_detection.shape[1]
    seen = np.flatnonzero(events.detection >= 0)
    ends = (
        np.concatenate([pairs.hypothesis, events.first, events.first[events.link[seen]]]),
        np.concatenate([h + pairs.detection, events.second, h + events.detection[seen]]),
    )
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(h + n, h + n))
    _, label = connected_components(graph, directed=False)
    of_link, of_pair = label[events.first], label[pairs.hypothesis]
    for name in np.unique(of_link).tolist():
        members = np.flatnonzero(label == name)
        hypotheses, detections = members[members < h], members[members >= h] - h
        links = np.flatnonzero(of_link == name)
        if len(links) > MOST_LINKS:
            most = np.argsort(-events.unresolved[links], kind="stable")[:MOST_LINKS]
            links = np.sort(links[most])
        rows = np.flatnonzero(of_pair == name)
        yield _Part(
            hypotheses,
            detections,
            rows,
            np.searchsorted(hypotheses, pairs.hypothesis[rows]),
            np.searchsorted(detections, pairs.detection[rows]),
            links,
            np.flatnonzero(np.isin(events.link, links)),
            disjoint_sets(events.first[links], events.second[links]),
        )


def disjoint_sets(first: IntArray, second: IntArray) -> BoolArray:
    """Sets (M, l) of links without a common member; the empty one comes first."""
    found = []
    ends = list(zip(first.tolist(), second.tolist(), strict=True))
    for size in range(len(ends) + 1):
        for choice in itertools.combinations(range(len(ends)), size):
            members = [end for index in choice for end in ends[index]]
            if len(set(members)) == len(members):
                found.append([index in choice for index in range(len(ends))])
    return np.array(found, dtype=np.bool_).reshape(len(found), len(ends))


@dataclass(frozen=True, slots=True)
class _Bordered:
    """Reduced problems of M sets under Q weightings: (Q, M, n, m), (Q, M, n), (Q, M, m), (M,)."""

    weight: FloatArray
    idle_row: FloatArray
    idle_column: FloatArray
    constant: FloatArray


def _bordered(part: _Part, events: GroupEvents, weights: GroupWeights) -> _Bordered:
    layers, sets = len(weights.pair), len(part.groups)
    n, m = len(part.hypotheses), len(part.detections)
    weight = np.full((layers, sets, n, m), -np.inf)
    weight[:, :, part.row, part.column] = weights.pair[:, None, part.pairs]
    idle_row = np.repeat(weights.idle_hypothesis[:, None, part.hypotheses], sets, axis=1)
    idle_column = np.repeat(weights.idle_detection[:, None, part.detections], sets, axis=1)
    for place, link in enumerate(part.links.tolist()):
        grouped = np.flatnonzero(part.groups[:, place])
        first, second = np.searchsorted(
            part.hypotheses, [events.first[link], events.second[link]]
        ).tolist()
        # The first member's row is the group's; the second member is no more.
        weight[:, grouped, first], weight[:, grouped, second] = -np.inf, -np.inf
        own = part.events[events.link[part.events] == link][1:]
        column = np.searchsorted(part.detections, events.detection[own])
        weight[:, grouped[:, None], first, column] = weights.group_pair[:, None, own]
        idle_row[:, grouped, first] = weights.group_idle[:, None, link]
        idle_row[:, grouped, second] = 0.0
    unresolved = events.unresolved[part.links]
    with np.errstate(divide="ignore"):
        constant = np.where(part.groups, np.log(unresolved), np.log1p(-unresolved)).sum(axis=1)
    return _Bordered(weight, idle_row, idle_column, constant)


def _answer(
    part: _Part, events: GroupEvents, bordered: _Bordered
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """Marginals of pairs (Q, p) and events (Q, e), and which are in the best hypothesis."""
    layers, sets, n, m = bordered.weight.shape
    joint = joint_marginals_batch(
        bordered.weight.reshape(layers * sets, n, m),
        bordered.idle_row.reshape(layers * sets, n),
        bordered.idle_column.reshape(layers * sets, m),
    )
    log_total = bordered.constant + joint.log_partition.reshape(layers, sets)
    share = np.exp(log_total - log_total.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    each = share[:, :, None, None] * joint.marginals.reshape(layers, sets, n, m)

    link = events.link[part.events]
    place = np.searchsorted(part.links, link)
    row = np.searchsorted(part.hypotheses, events.first[link])
    seen = events.detection[part.events] >= 0
    column = np.searchsorted(part.detections, events.detection[part.events][seen])
    grouped = part.groups[:, place].T  # (e, M)
    group_found = np.empty((layers, len(link)))
    group_found[:, seen] = np.einsum("qme,em->qe", each[:, :, row[seen], column], grouped[seen])
    rest = np.einsum("qme,em->qe", each.sum(axis=3)[:, :, row[~seen]], grouped[~seen])
    group_found[:, ~seen] = np.maximum(share @ grouped[~seen].T - rest, 0.0)

    # A group's row is the first member's, whose own pairs have no weight in these sets.
    single = np.ones((sets, n))
    for index, number in enumerate(part.links.tolist()):
        ends = np.searchsorted(part.hypotheses, [events.first[number], events.second[number]])
        single[np.ix_(np.flatnonzero(part.groups[:, index]), ends)] = 0.0
    found = np.einsum("qmp,mp->qp", each[:, :, part.row, part.column], single[:, part.row])

    best, chosen_set = _best(bordered)
    given = np.full(len(link), -1)
    given[seen] = column
    group_served = part.groups[chosen_set, place] & (best[row] == given)
    served_pairs = (best[part.row] == part.column) & (single[chosen_set, part.row] > 0.0)
    return found, group_found, served_pairs, group_served


def _best(bordered: _Bordered) -> tuple[IntArray, int]:
    """Most probable hypothesis of the last weighting: column of each row, -1 for none, and set."""
    best, chosen_set, highest = None, 0, -np.inf
    for index in range(bordered.weight.shape[1]):
        weight = bordered.weight[-1, index]
        idle_row, idle_column = bordered.idle_row[-1, index], bordered.idle_column[-1, index]
        answer = best_hypothesis(weight, idle_row, idle_column)
        if answer is None:
            continue
        served = np.flatnonzero(answer >= 0)
        log_weight = bordered.constant[index] + weight[served, answer[served]].sum()
        log_weight += idle_row[answer < 0].sum() + np.delete(idle_column, answer[served]).sum()
        if log_weight > highest:
            best, chosen_set, highest = answer, index, log_weight
    if best is None:
        raise ValueError("a cluster with finite idle weights has no feasible hypothesis")
    return best, chosen_set
