"""The association matrix: hypotheses against detections, the terms of each pair apart.

Shown is one cluster, the tracks and detections that compete with each other, with the kinematic and
the attribute term as log likelihood ratios against "missed and a false alarm". Their sum is the
``log_likelihood_ratio`` of the association log (docs/association-log.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gda_tracker.evaluation.association_log import DECIDED_BY, pair_terms
from gda_tracker.view.encoding import numbers
from gda_tracker.view.picture import Picture
from gda_tracker.vocabulary.arrays import BoolArray, Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations, Predictions

MOST_ROWS, MOST_COLUMNS = 16, 12
DIGITS = 3


def matrix_json(picture: Picture, track_id: int | None) -> dict[str, Any] | None:
    """The matrix of the cluster of a track, or of the largest cluster; ``None``: no pairs.

    Rows are hypotheses, of the track itself first, columns detections (rows in the source's
    ``Detections``); both are cut to what can be read, and ``left_out`` counts the pairs that fell
    away. ``cells`` lists for each pair its row and column, then its terms by name.
    """
    decision = picture.decision
    if decision is None or not len(decision.associations.hypothesis):
        return None
    predictions, decided = decision.predictions, decision.associations
    chosen = _chosen(picture, predictions, decided)
    pairs = _pairs_of_cluster(predictions, decided, track_id)
    if not len(pairs):
        return None
    rows = _ranked_rows(predictions, decided, chosen, pairs, track_id)[:MOST_ROWS]
    shown = pairs[np.isin(decided.hypothesis[pairs], rows)]
    columns = _ranked_columns(decided, shown)[:MOST_COLUMNS]
    shown = shown[np.isin(decided.detection[shown], columns)]
    columns = np.sort(columns)
    terms = pair_terms(predictions, decision.scores, decided)
    kinematic = np.subtract(*terms["kinematic_log_likelihood"])
    table: dict[str, Any] = {
        "row": np.argsort(rows)[np.searchsorted(np.sort(rows), decided.hypothesis[shown])].tolist(),
        "column": np.searchsorted(columns, decided.detection[shown]).tolist(),
        "chosen": chosen[shown].tolist(),
        "kinematic": numbers(kinematic[shown], DIGITS),
        "attribute": None,
        "ratio": numbers(terms["log_likelihood_ratio"][0][shown], DIGITS),
        "mahalanobis_squared": numbers(decided.mahalanobis_squared[shown], DIGITS),
    }
    if "attribute_log_likelihood" in terms:
        attribute = np.subtract(*terms["attribute_log_likelihood"])
        table["attribute"] = numbers(attribute[shown], DIGITS)
    for name in ("p_kinematic", "p_attribute", "p_generalised", "joint_marginal"):
        table[name] = numbers(terms[name][0][shown], DIGITS)
    return {
        "decision": decided.decision,
        "attribute_term": decided.attribute_term,
        "decided_by": DECIDED_BY.get(decided.decision),
        "degraded": bool(decided.degraded),
        "rows": {
            "track": predictions.track_id[rows].tolist(),
            "hypothesis": predictions.hypothesis_id[rows].tolist(),
        },
        "columns": picture.sightings.source_index[columns].tolist(),
        "cells": table,
        "left_out": len(pairs) - len(shown),
    }


def _chosen(picture: Picture, predictions: Predictions, decided: Associations) -> BoolArray:
    """Whether each pair (P,) is the one its track took.

    With hypothesis trees that is known only after the association, from the tracks.
    """
    if decided.decision != "mht":
        return decided.chosen
    tracks = picture.tracks
    taken = dict(zip(tracks.track_id.tolist(), tracks.detection_index.tolist(), strict=True))
    given = np.array([taken.get(track, -1) for track in predictions.track_id.tolist()])
    source = picture.sightings.source_index[decided.detection]
    return np.asarray(given[decided.hypothesis] == source, dtype=np.bool_)


def _pairs_of_cluster(
    predictions: Predictions, decided: Associations, track_id: int | None
) -> IntArray:
    """Indices of the pairs of one cluster; the leaves of a track belong together."""
    _, track = np.unique(predictions.track_id, return_inverse=True)
    n_tracks = int(track.max()) + 1
    n = n_tracks + int(decided.detection.max()) + 1
    ends = (track[decided.hypothesis], n_tracks + decided.detection)
    links = coo_array((np.ones(len(decided.detection)), ends), shape=(n, n))
    _, cluster = connected_components(links, directed=False)
    of_pair = cluster[ends[0]]
    if track_id is None:
        wanted = np.bincount(of_pair).argmax()
    else:
        rows = np.flatnonzero(predictions.track_id == track_id)
        if not len(rows):
            return np.zeros(0, dtype=np.int64)
        wanted = cluster[track[rows[0]]]
    return np.flatnonzero(of_pair == wanted)


def _ranked_rows(
    predictions: Predictions,
    decided: Associations,
    chosen: BoolArray,
    pairs: IntArray,
    track_id: int | None,
) -> Int32Array:
    """Hypotheses of the pairs: the track asked for first, then by track, those that took one first.

    Of the leaves of a hypothesis tree those with the largest probability come first.
    """
    rows = np.unique(decided.hypothesis[pairs])
    weight = np.zeros(len(predictions))
    likely = np.nan_to_num(decided.joint_marginal[pairs]) + chosen[pairs]
    np.maximum.at(weight, decided.hypothesis[pairs], likely)
    track = predictions.track_id[rows]
    return np.asarray(rows[np.lexsort((-weight[rows], track, track != track_id))], dtype=np.int32)


def _ranked_columns(decided: Associations, pairs: IntArray) -> Int32Array:
    """Detections of the pairs, by rising squared distance."""
    order = np.argsort(decided.mahalanobis_squared[pairs], kind="stable")
    detection = decided.detection[pairs][order]
    _, first = np.unique(detection, return_index=True)
    return np.asarray(detection[np.sort(first)], dtype=np.int32)
