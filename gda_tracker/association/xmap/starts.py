"""Where the chains of samples begin: associations that some relative bias makes likely.

A diffuse bias fits as many associations as there are pairs of measurements to lay on each other,
and a chain hardly passes from one fit to another. So the fits are tried, scored exactly, and the
chains start from them in proportion to their probability.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.partitions import canonical
from gda_tracker.association.xmap.positions import inverses
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

MAX_FITS = 300
GATE = 16.0
"""Squared Mahalanobis distance beyond which measurements are not joined in a start."""


def fitted_associations(model: SensorModel, data: SensorData, rng: np.random.Generator) -> IntArray:
    """Associations (K, M), canonical and different; the null association is the first.

    Every sensor is laid on a root sensor by each pair of their measurements, and without shift
    where both biases are finite; the best fits of the sensors are then joined in random ways.
    """
    positions = data.positions.reshape(len(data.positions), -1)
    covariances = data.covariances.reshape(len(positions), *data.covariances.shape[-2:])
    sizes = np.array(model.sizes)
    groups = [first + np.arange(n) for first, n in zip(model.first.tolist(), sizes, strict=True)]
    null = np.arange(len(positions))
    found = [null]
    for root in range(len(sizes)):
        if sizes[root] == 0:
            continue
        fits = [
            []
            if s == root or sizes[s] == 0
            else _fits(positions, covariances, groups[root], groups[s])
            for s in range(len(sizes))
        ]
        for rank in range(MAX_FITS // len(sizes)):
            labels = null.copy()
            for s, choices in enumerate(fits):
                if not choices:
                    continue
                # The first ones in turn, then at random with more weight on the good ones.
                pick = rank if rank < len(choices) and rank % 2 == 0 else 0
                if rank >= len(choices) or rank % 2:
                    pick = min(int(rng.exponential(3.0)), len(choices) - 1)
                partner = choices[pick][1]
                mine = partner >= 0
                labels[groups[s][mine]] = groups[root][partner[mine]]
            found.append(labels)
    return np.asarray(np.unique(canonical(np.stack(found)), axis=0))


def _fits(
    positions: FloatArray,
    covariances: FloatArray,
    root: IntArray,
    other: IntArray,
) -> list[tuple[float, IntArray]]:
    """(gain, partner of each of the other's measurements) of each shift, best first."""
    shifts = [positions[i] - positions[j] for i in root for j in other]
    shifts.append(np.zeros(positions.shape[1]))
    # One inverse per pair serves all shifts.
    precision = inverses(covariances[other][:, None] + covariances[root])
    fits = []
    for shift in shifts:
        difference = positions[other][:, None] + shift - positions[root]
        distance = np.einsum("jki,jkil,jkl->jk", difference, precision, difference)
        gain = np.maximum(GATE - distance, 0.0)
        row, column = linear_sum_assignment(gain, maximize=True)
        partner = np.full(len(other), -1)
        inside = gain[row, column] > 0.0
        partner[row[inside]] = column[inside]
        fits.append((float(gain[row, column].sum()), partner))
    fits.sort(key=lambda fit: -fit[0])
    return fits


def drawn_starts(
    candidates: IntArray, log_weight: FloatArray, number: int, rng: np.random.Generator
) -> IntArray:
    """Draw starts (number, M) from candidates (K, M) in proportion to their probability."""
    share = np.exp(log_weight - log_weight.max())
    steps = (np.arange(number) + rng.random()) / number
    place = np.searchsorted(np.cumsum(share) / share.sum(), steps, side="right")
    return np.asarray(candidates[np.minimum(place, len(candidates) - 1)])
