"""Global hypotheses with coupled tracks: their trees become one tree of compound leaves.

A compound leaf is a leaf of each of two or three coupled tracks, with the sum of their log scores
and the factors between them, and uses what they use. So the choice is again one leaf of each tree
without a detection twice, and its log weight that of the joint hypothesis, exactly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gda_tracker.tracking.mht.couplings import CoupledTracks, components, in_conflict
from gda_tracker.tracking.mht.decision import global_hypothesis
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MOST_PAIRS, MOST_COMPOUNDS = 5_000, 20_000
"""Compound leaves that count, the heaviest ones: before a third track is joined, and in the end."""


def coupled_global_hypothesis(
    log_score: FloatArray,
    track: IntArray,
    detection_numbers: IntArray,
    optional: IntArray,
    coupled: Sequence[CoupledTracks],
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Choose one leaf for every track, as :func:`.decision.global_hypothesis` does.

    Parameters
    ----------
    log_score, track, detection_numbers, optional
        As there.
    coupled
        Factors between the leaves of coupled tracks, none of them optional.
    """
    if not coupled:
        return global_hypothesis(log_score, track, detection_numbers, optional)
    parts = [
        compounds(members, coupled, log_score, track, detection_numbers)
        for members in components([(pair.first, pair.second) for pair in coupled])
    ]
    inside = np.zeros(track[-1] + 1, dtype=np.bool_)
    for rows, _ in parts:
        inside[track[rows[0]]] = True
    alone = np.flatnonzero(~inside[track])
    width = detection_numbers.shape[1]
    most = max(rows.shape[1] for rows, _ in parts)
    single = np.full((len(alone), most * width), -1, dtype=np.int64)
    single[:, :width] = detection_numbers[alone]
    scores, tracks, used = [log_score[alone]], [track[alone]], [single]
    for rows, weight in parts:
        numbers = np.full((len(rows), most, width), -1, dtype=np.int64)
        for place in range(rows.shape[1]):
            own = detection_numbers[rows[:, place]]
            # What members share is used once.
            again = (own[:, None] == numbers[:, :place]).any(axis=1)
            numbers[:, place] = np.where(again, -1, own)
        scores.append(weight)
        tracks.append(np.full(len(rows), track[rows[0, 0]]))
        used.append(numbers.reshape(len(rows), -1))
    chosen, probability, absent = global_hypothesis(
        np.concatenate(scores), np.concatenate(tracks), np.concatenate(used), optional
    )
    picked = np.zeros(len(track), dtype=np.bool_)
    share = np.zeros(len(track))
    picked[alone], share[alone] = chosen[: len(alone)], probability[: len(alone)]
    begin = len(alone)
    for rows, weight in parts:
        mine = slice(begin, begin + len(weight))
        picked[rows[chosen[mine]]] = True
        for place in range(rows.shape[1]):
            np.add.at(share, rows[:, place], probability[mine])
        begin += len(weight)
    return picked, np.minimum(share, 1.0), absent


def compounds(
    members: tuple[int, ...],
    coupled: Sequence[CoupledTracks],
    log_score: FloatArray,
    track: IntArray,
    detection_numbers: IntArray,
) -> tuple[IntArray, FloatArray]:
    """Rows (C, n) of the leaves of each compound leaf, and their log weights (C,)."""
    factors = {(pair.first, pair.second): pair.log_factor for pair in coupled}
    leaves = [np.flatnonzero(track == member) for member in members]
    place, weight = np.arange(len(leaves[0]))[:, None], log_score[leaves[0]]
    for number in range(1, len(members)):
        total = weight[:, None] + log_score[leaves[number]]
        for before in range(number):
            key = members[before], members[number]
            if key in factors:
                between = factors[key]
            else:
                one, two = leaves[before], leaves[number]
                clash = in_conflict(detection_numbers[one], detection_numbers[two])
                between = np.where(clash, -np.inf, 0.0)
            total = total + between[place[:, before]]
        row, column = np.nonzero(total > -np.inf)
        weight = total[row, column]
        place = np.concatenate([place[row], column[:, None]], axis=1)
        most = MOST_COMPOUNDS if number == len(members) - 1 else MOST_PAIRS
        if len(weight) > most:
            best = np.sort(np.argpartition(-weight, most)[:most])
            place, weight = place[best], weight[best]
    rows = np.stack([leaves[number][place[:, number]] for number in range(len(members))], axis=1)
    return rows, weight
