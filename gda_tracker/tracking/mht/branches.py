"""Branches of one scan: what each leaf may become, with the score of each possibility.

A leaf of the hypothesis tree of a track branches into one child for each detection in its gate and
one without (Koch 2014, 3.2; the score is the log likelihood ratio of (3.55)-(3.58) against the
hypothesis that all detections of the leaf are false alarms). Branches are light: indices, scores
and detections used. States are computed for those that survive the pruning alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray


@dataclass(slots=True)
class Branches:
    """B children of the H leaves of a scan, by parent, within a parent the miss first.

    ``parent`` (B,) is the row of the leaf, ``pair`` (B,) the row in the scan's list of pairs and
    ``detection`` (B,) the row in the scan, -1 for a miss; ``track_id`` (B,), ``log_score`` (B,);
    ``detection_numbers`` (B, W + 1) the numbers of the detections used, newest first, -1 for none.
    """

    parent: IntArray
    pair: IntArray
    detection: IntArray
    track_id: IntArray
    log_score: FloatArray
    detection_numbers: IntArray

    def __len__(self) -> int:
        return len(self.parent)

    def select(self, rows: np.ndarray) -> Branches:
        """Return the given rows."""
        return Branches(
            self.parent[rows],
            self.pair[rows],
            self.detection[rows],
            self.track_id[rows],
            self.log_score[rows],
            self.detection_numbers[rows],
        )


def branch(
    table: HypothesisTable,
    hypothesis: Int32Array,
    detection: Int32Array,
    pair_score: FloatArray,
    miss_score: FloatArray,
    first_number: int,
) -> Branches:
    """Expand every leaf by its gated pairs and the miss.

    Parameters
    ----------
    table
        H leaves.
    hypothesis, detection
        (P,) the gated pairs, row-major.
    pair_score, miss_score
        (P,), (H,) log likelihood ratios of the scan.
    first_number
        Running number of the scan's first detection.
    """
    h, p = len(table), len(hypothesis)
    parent = np.concatenate([np.arange(h), hypothesis.astype(np.int64)])
    # Stable: a leaf's miss comes first, then its pairs in their order.
    order = np.argsort(parent, kind="stable")
    parent = parent[order]
    pair = np.concatenate([np.full(h, -1), np.arange(p)])[order]
    used = np.concatenate([np.full(h, -1), detection.astype(np.int64)])[order]
    gain = np.concatenate([miss_score, pair_score])[order]
    number = np.where(used >= 0, first_number + used, -1)
    return Branches(
        parent,
        pair,
        used,
        table.track_id[parent],
        table.log_score[parent] + gain,
        np.concatenate([number[:, None], table.detection_numbers[parent]], axis=1),
    )
