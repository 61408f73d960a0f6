"""Which leaves of hypothesis trees are kept: N-scan decision, probability threshold, cap."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.errors import AssociationInputError
from gda_tracker.vocabulary.arrays import BoolArray


def n_scan_decision(
    chosen: ArrayLike,
    track: ArrayLike,
    ancestors: ArrayLike,
    *,
    probability: ArrayLike | None = None,
    min_probability: float = 0.0,
    max_leaves: int | None = None,
) -> BoolArray:
    """Decide which leaves survive.

    First the decision about the scan N scans ago: of a track with a chosen leaf only those leaves
    survive that have the chosen leaf's ancestor at that scan (Koch 2014, 3.3: pruning; Blackman
    2004, "Multiple hypothesis tracking for multiple target tracking", N-scan). Then, of what is
    left, leaves below a probability, and the least probable beyond a number per track. The chosen
    leaf is never dropped, and no track loses all its leaves: one without a chosen leaf keeps its
    most probable one.

    Parameters
    ----------
    chosen : (L,) bool
        Leaves of the best global hypothesis, at most one per track.
    track : (L,) int
    ancestors : (L, N + 1) int
        Node of each leaf's branch n scans ago in column n: column 0 is the leaf itself, the last
        one is decided about. A number, such as -1, that all leaves of a track have there (it is
        younger) decides nothing.
    probability : (L,), optional
        Of each leaf, not NaN; needed for the other two.
    min_probability : float
        Leaves of less go.
    max_leaves : int, optional
        Leaves kept per track, at least 1. Of equally probable ones the first rows are kept.

    Returns
    -------
    (L,) True for the leaves that survive.

    Raises
    ------
    AssociationInputError
        For shapes that do not fit, two chosen leaves of a track, a missing or NaN probability, and
        limits without meaning.

    Examples
    --------
    >>> n_scan_decision([0, 1, 0], [5, 5, 5], [[7, 2], [8, 3], [9, 3]])
    array([False,  True,  True])
    """
    leaf_chosen = np.asarray(chosen, dtype=np.bool_)
    ids = np.asarray(track)
    nodes = np.asarray(ancestors)
    if leaf_chosen.ndim != 1:
        raise AssociationInputError(f"chosen has shape {leaf_chosen.shape}: allowed is (L,)")
    if ids.shape != leaf_chosen.shape:
        raise AssociationInputError(f"track has shape {ids.shape}: allowed is {leaf_chosen.shape}")
    if nodes.ndim != 2 or len(nodes) != len(ids) or nodes.shape[1] < 1:
        raise AssociationInputError(
            f"ancestors has shape {nodes.shape}: allowed is ({len(ids)}, N + 1)"
        )
    tracks, owner = np.unique(ids, return_inverse=True)
    rows = leaf_chosen.nonzero()[0]
    number = np.bincount(owner[rows], minlength=len(tracks))
    if number.max(initial=0) > 1:
        raise AssociationInputError(
            f"track {tracks[number.argmax()]} has {number.max()} chosen leaves: allowed is one"
        )
    decided = np.full(len(tracks), -1)
    decided[owner[rows]] = rows
    reference = decided[owner]
    survives: BoolArray = (reference < 0) | (nodes[:, -1] == nodes[reference, -1])
    if min_probability == 0.0 and max_leaves is None:
        return survives

    if not 0.0 <= min_probability <= 1.0:
        raise AssociationInputError(f"min_probability = {min_probability}: allowed is 0 to 1")
    if max_leaves is not None and max_leaves < 1:
        raise AssociationInputError(f"max_leaves = {max_leaves}: allowed are integers >= 1")
    if probability is None:
        raise AssociationInputError("probability is missing: min_probability and max_leaves use it")
    share = np.asarray(probability, dtype=np.float64)
    if share.shape != ids.shape or np.isnan(share).any():
        raise AssociationInputError(
            f"probability has shape {share.shape} and {np.count_nonzero(np.isnan(share))} NaN: "
            f"allowed is {ids.shape} without NaN"
        )
    # Best first: the chosen leaf, then by probability, survivors of the first decision only.
    order = np.lexsort((-share, ~leaf_chosen, ~survives, owner))
    count = np.bincount(owner, minlength=len(tracks))
    rank = np.empty(len(ids), dtype=np.int64)
    rank[order] = np.arange(len(ids)) - (count.cumsum() - count)[owner[order]]
    survives &= (rank == 0) | (share >= min_probability)
    if max_leaves is not None:
        survives &= rank < max_leaves
    return survives
