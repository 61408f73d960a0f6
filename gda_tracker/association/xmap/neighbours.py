"""From associations that are known to those beside them: what samples miss by chance.

A neighbour has one measurement moved to another object, or alone; where that object has a
measurement of the same sensor already, the two change places.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.partitions import canonical
from gda_tracker.association.xmap.scoring import log_weights, structure_of
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

ROUNDS = 6
ROWS_PER_ROUND = 6000
"""Neighbours that are looked at in one round, roughly."""

NEGLIGIBLE_GAIN = 1e-4
"""Share of the probability below which a round is the last."""


def neighbours(labels: IntArray, sensor_of: IntArray) -> IntArray:
    """All neighbours (X, M) of associations (K, M), canonical, some of them more than once."""
    found = []
    n = labels.shape[1]
    for i in range(n):
        alone = labels.copy()
        alone[:, i] = n
        found.append(alone)
        rivals = (sensor_of == sensor_of[i]).nonzero()[0]
        for j in (sensor_of != sensor_of[i]).nonzero()[0]:
            moved = labels.copy()
            for k in rivals:
                taken = labels[:, k] == labels[:, j]
                moved[taken, k] = labels[taken, i]
            moved[:, i] = labels[:, j]
            found.append(moved)
    return canonical(np.concatenate(found))


def explore(model: SensorModel, data: SensorData, labels: IntArray) -> tuple[IntArray, FloatArray]:
    """Add neighbours of the most probable associations, round by round, each scored exactly.

    Returns
    -------
    labels (A, M), log weight (A,)
        Different associations, the given ones among them.
    """
    labels = np.unique(labels, axis=0)
    weight = log_weights(model, data, structure_of(model, labels))[:, 0]
    asked = np.zeros(len(labels), dtype=np.bool_)
    most = max(1, ROWS_PER_ROUND // labels.shape[1] ** 2)
    for _ in range(ROUNDS):
        waiting = (~asked & np.isfinite(weight)).nonzero()[0]
        chosen = waiting[np.argsort(-weight[waiting], kind="stable")[:most]]
        if not len(chosen):
            break
        asked[chosen] = True
        together = np.concatenate([labels, neighbours(labels[chosen], model.sensor_of)])
        _, first = np.unique(together, axis=0, return_index=True)
        new = together[np.sort(first[first >= len(labels)])]
        if not len(new):
            continue
        added = log_weights(model, data, structure_of(model, new))[:, 0]
        labels = np.concatenate([labels, new])
        weight = np.concatenate([weight, added])
        asked = np.concatenate([asked, np.zeros(len(new), dtype=np.bool_)])
        share = np.exp(weight - weight.max())
        if share[-len(new) :].sum() < NEGLIGIBLE_GAIN * share.sum():
            break
    return labels, weight
