"""The most probable partition of a scan, chosen region by region.

Detections that no partition joins lie in regions of their own: whether the ones there belong
together has nothing to do with the others. So each region takes the partition that explains it
best; objects of different sizes need not agree on one distance.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.association.extended.hypotheses import (
    Explanation,
    ExtendedSensor,
    explain_partition,
)
from gda_tracker.kinematics.extended.partitions import by_appearance
from gda_tracker.kinematics.extended.random_matrix import ExtendedStates
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def explain_by_region(
    states: ExtendedStates,
    rate_shape: FloatArray,
    rate_rate: FloatArray,
    positions: FloatArray,
    noise: FloatArray,
    partitions: IntArray,
    sensor: ExtendedSensor,
    relative_density: FloatArray | None = None,
    gate: float = 25.0,
) -> tuple[Explanation, float]:
    """The best hypothesis over partitions that may differ from region to region.

    Parameters
    ----------
    states, rate_shape, rate_rate, positions, noise, sensor, gate
        As for :func:`~gda_tracker.association.extended.hypotheses.explain`.
    partitions
        (K, n), each coarser than the one before, as
        :func:`~gda_tracker.kinematics.extended.partitions.distance_partitions` has them. The
        regions are the cells of the last.
    relative_density
        (n,) by which the sensor's densities are scaled at each detection.

    Returns
    -------
    explanation, probability
        The hypothesis, and how probable its partition is among those looked at: the product over
        the regions. Each partition of a region stands for its best assignment.
    """

    def explained(label: IntArray) -> Explanation:
        return explain_partition(
            states, rate_shape, rate_rate, positions, noise, label, sensor, gate, relative_density
        )

    found = [explained(label) for label in partitions]
    if len(found) == 1:
        return found[0], 1.0
    region = partitions[-1]
    regions = int(region.max()) + 1
    weight, count = np.empty((len(found), regions)), np.empty((len(found), regions))
    for k, one in enumerate(found):
        first = np.unique(one.label, return_index=True)[1]
        weight[k] = np.bincount(region[first], one.log_cell, minlength=regions)
        count[k] = np.bincount(region[first], minlength=regions)
    # Partitions are nested: in a region two with as many cells are the same.
    weight[1:][count[1:] == count[:-1]] = -np.inf
    best = np.argmax(weight, axis=0)
    share = np.exp(weight - weight[best, np.arange(regions)]).sum(axis=0)
    probability = float(np.exp(-np.log(share).sum()))
    label = by_appearance(
        region * np.int64(len(region)) + partitions[best[region], np.arange(len(region))]
    )
    for one in found:
        if np.array_equal(one.label, label):
            return one, probability
    return explained(label), probability
