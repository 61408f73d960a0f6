"""Doubt in what was learnt of the biases, where others would join more tracks.

A bias that was learnt from wrongly joined tracks, or that has changed, keeps tracks apart that
belong together. Now and then, while two radars have tracks without company, the association is
asked what it would say without what was learnt.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from gda_tracker.fusion.association import TrackAssociation
from gda_tracker.fusion.biases import Biases
from gda_tracker.fusion.snapshot import Snapshot
from gda_tracker.vocabulary.arrays import BoolArray, IntArray

EVERY = 10
"""Fusions from one look to the next, as long as nothing is found."""

TAIL = 1e-3
"""Chance that two right estimates of a bias differ so much."""

SURE = 0.5
"""Least probability of tracks being together that counts."""


class Suspicion:
    """Counts the looks in a row that spoke for other biases."""

    def __init__(self) -> None:
        self._waited = 0
        self._found = 0

    def looks(self, snapshot: Snapshot, found: TrackAssociation) -> bool:
        """Say whether it is time to look."""
        alone = np.bincount(found.chosen)[found.chosen] == 1
        if len(np.unique(snapshot.radar[alone])) < 2:
            self._waited = self._found = 0
            return False
        self._waited += 1
        return self._found > 0 or self._waited % EVERY == 1

    def confirmed(
        self, found: TrackAssociation, other: TrackAssociation, prior: Biases, looks: int
    ) -> bool:
        """Say whether so many looks in a row spoke for the other association and its biases."""
        more = _joined(other.chosen, other) > _joined(found.chosen, found)
        gap = other.biases.mean - prior.mean
        covariance = other.biases.covariance + prior.covariance
        known = np.isfinite(gap).all(axis=1) & covariance.any(axis=(1, 2))
        solved = np.linalg.solve(covariance[known], gap[known][..., None])[..., 0]
        far: BoolArray = (gap[known] * solved).sum(axis=1) > chdtri(2, TAIL)
        self._found = self._found + 1 if more and far.any() else 0
        if self._found < looks:
            return False
        self._found = self._waited = 0
        return True


def _joined(chosen: IntArray, found: TrackAssociation) -> int:
    """Number of tracks that surely have company."""
    size = np.bincount(chosen, minlength=len(found.cluster_probability))
    return int(size[(size > 1) & (found.cluster_probability >= SURE)].sum())
