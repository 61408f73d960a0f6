"""Random leaves of hypothesis trees, and all their global hypotheses by enumeration."""

from __future__ import annotations

import itertools
import math

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING


def random_leaves(
    random, n_tracks, most_leaves, window=3, per_scan=3, spread=5.0, misses=0.3, all_missed=True
):
    """(log_score, track, used) of leaves in random order, tracks with odd ids."""
    scores, tracks, used = [], [], []
    for track in range(n_tracks):
        n_leaves = int(random.integers(1, most_leaves + 1))
        rows = random.integers(0, per_scan, (n_leaves, window)) + per_scan * np.arange(window)
        rows[random.random(rows.shape) < misses] = -1
        if all_missed:
            rows[0] = -1
        used.append(rows)
        scores.append(random.normal(0.0, spread, n_leaves))
        tracks.append(np.full(n_leaves, 10 * track + 3))
    order = random.permutation(sum(map(len, scores)))
    return np.concatenate(scores)[order], np.concatenate(tracks)[order], np.concatenate(used)[order]


def chain_leaves(random, n_tracks, window=8, n_leaves=6):
    """(log_score, track, used) of one cluster in which only neighbours share detections."""
    scores, tracks, used = [], [], []
    for track in range(n_tracks):
        near = random.integers(track, track + 2, (n_leaves, window)) + 1000 * np.arange(window)
        near[random.random(near.shape) < 0.2] = -1
        used += [near, np.full((1, window), -1)]
        scores += [random.normal(0.0, 4.0, n_leaves), [-20.0]]
        tracks.append(np.full(n_leaves + 1, track))
    order = random.permutation(n_tracks * (n_leaves + 1))
    return np.concatenate(scores)[order], np.concatenate(tracks)[order], np.concatenate(used)[order]


def compatible(used, rows):
    """Whether leaves (their rows) share no detection."""
    detections = [d for row in rows for d in used[row].tolist() if d >= 0]
    return len(detections) == len(set(detections))


def enumerate_hypotheses(log_score, track, used, tracks=None, log_dropped=None):
    """All hypotheses of some tracks: (log weight, rows by track, None for dropped), best first.

    Without ``log_dropped`` every track has a leaf.
    """
    tracks = sorted(set(track.tolist())) if tracks is None else tracks
    choices = []
    for t in tracks:
        rows = [r for r in (track == t).nonzero()[0].tolist() if log_score[r] > -math.inf]
        choices.append(rows if log_dropped is None else [*rows, None])
    found = []
    for rows in itertools.product(*choices):
        if compatible(used, [r for r in rows if r is not None]):
            terms = [log_dropped if r is None else log_score[r] for r in rows]
            found.append((math.fsum(terms), rows))
    return sorted(found, key=lambda entry: -entry[0])


def clusters_by_search(track, used):
    """Tracks joined by shared detections, as sorted lists, by their first track."""
    tracks = sorted(set(track.tolist()))
    own = {t: {d for row in used[track == t].tolist() for d in row if d >= 0} for t in tracks}
    left, clusters = list(tracks), []
    while left:
        cluster, front = [], [left[0]]
        while front:
            here = front.pop()
            left.remove(here)
            cluster.append(here)
            front += [t for t in left if own[t] & own[here] and t not in front]
        clusters.append(sorted(cluster))
    return clusters


def enumerate_all(log_score, track, used, log_dropped=LOG_VANISHING):
    """Per cluster (tracks, hypotheses); tracks may be dropped where there is no hypothesis."""
    found = []
    for tracks in clusters_by_search(track, used):
        hypotheses = enumerate_hypotheses(log_score, track, used, tracks)
        if not hypotheses:
            hypotheses = enumerate_hypotheses(log_score, track, used, tracks, log_dropped)
        found.append((tracks, hypotheses))
    return found
