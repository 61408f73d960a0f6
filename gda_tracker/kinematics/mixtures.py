"""Gaussian mixtures, H at a time: moments, pruning, local merging, capping.

The H mixtures of K components in all are stored one after the other, as in ``Predictions``. Weights
need not sum to one and may be negative (unresolved measurements bring such): components count by
the absolute weight, and only those of one sign are merged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


def moments(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of mixtures of M components each.

    Parameters
    ----------
    weight, mean, covariance
        (..., M), (..., M, s), (..., M, s, s); the weights of a mixture sum to one.

    Returns
    -------
    mean, covariance
        (..., s) and (..., s, s): x = sum p_i x_i, P = sum p_i [P_i + (x_i - x)(x_i - x)']
        (Koch 2014, (3.33)-(3.35)).
    """
    size = mean.shape[-1]
    row = weight[..., None, :]
    centre = (row @ mean)[..., 0, :]
    deviation = mean - centre[..., None, :]
    inner = (row @ covariance.reshape(*mean.shape[:-1], size * size)).reshape(
        *centre.shape[:-1], size, size
    )
    spread = np.swapaxes(weight[..., None] * deviation, -1, -2) @ deviation
    total = inner + spread
    return centre, 0.5 * (total + np.swapaxes(total, -1, -2))


@dataclass(slots=True)
class GaussianMixtures:
    """H mixtures: components ``start[h]`` to ``start[h + 1]`` belong to mixture h.

    ``start`` (H + 1,), ``weight`` (K,), ``mean`` (K, s), ``covariance`` (K, s, s).
    """

    start: IntArray
    weight: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def __len__(self) -> int:
        return len(self.start) - 1

    @property
    def owner(self) -> IntArray:
        """Mixture (K,) that each component belongs to."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    def totals(self) -> FloatArray:
        """Sum (H,) of the weights of each mixture."""
        return _sums(self.owner, self.weight, len(self))

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (H, s) and covariance (H, s, s) of each mixture.

        Raises
        ------
        ValueError
            If a mixture has no components or weights that sum to zero.
        """
        totals = self.totals()
        if (totals == 0.0).any():
            raise ValueError(f"mixture {int(np.argmin(totals != 0.0))} has no weight")
        return _merged(self, self.owner, len(self))[1:]

    def normalised(self) -> GaussianMixtures:
        """The same mixtures with weights that sum to one."""
        return GaussianMixtures(
            self.start, self.weight / self.totals()[self.owner], self.mean, self.covariance
        )

    def select(self, keep: BoolArray) -> GaussianMixtures:
        """The mixtures with the components where ``keep`` (K,) is true, in the same order."""
        count = np.bincount(self.owner[keep], minlength=len(self))
        return GaussianMixtures(
            np.concatenate([[0], np.cumsum(count)]),
            self.weight[keep],
            self.mean[keep],
            self.covariance[keep],
        )

    def _heaviest_first(self) -> IntArray:
        """Components by mixture and falling absolute weight; equal ones keep their order."""
        return np.lexsort((-np.abs(self.weight), self.owner))


def prune(mixtures: GaussianMixtures, smallest_share: float) -> GaussianMixtures:
    """Leave out components with less than ``smallest_share`` of their mixture's absolute weight.

    The heaviest of a mixture stays. The others' weights are scaled so that the sum is kept, unless
    that is impossible because the sum of what stays is zero.
    """
    owner, size = mixtures.owner, np.abs(mixtures.weight)
    total = _sums(owner, size, len(mixtures))
    keep = size >= smallest_share * total[owner]
    keep[_first_of_each(mixtures, mixtures._heaviest_first())] = True
    return _with_totals(mixtures.select(keep), mixtures.totals())


def cap(mixtures: GaussianMixtures, most: int) -> GaussianMixtures:
    """Keep the ``most`` >= 1 heaviest components of each mixture; the sum of weights is kept."""
    if most < 1:
        raise ValueError(f"most = {most}: allowed is an integer >= 1")
    order = mixtures._heaviest_first()
    rank = np.arange(len(order)) - mixtures.start[mixtures.owner[order]]
    keep = np.zeros(len(order), dtype=bool)
    keep[order[rank < most]] = True
    return _with_totals(mixtures.select(keep), mixtures.totals())


def merge(mixtures: GaussianMixtures, threshold: float) -> GaussianMixtures:
    """Merge components that lie close together, by moments; each mixture on its own.

    The heaviest component takes in all others of the same sign with squared Mahalanobis distance at
    most ``threshold`` under its own covariance; the heaviest of those left goes on, and so forth
    (Koch 2014, section 3.3.3, local combining). The components of the result stand in the order
    of these centres. Mixtures are worked on side by side: the rounds are as many as the largest
    result has components.

    ``threshold`` = infinity makes one Gaussian (of each sign) of every mixture: the limiting case
    of probabilistic data association.
    """
    group, holder = merge_groups(mixtures, threshold)
    weight, mean, covariance = _merged(mixtures, group, len(holder))
    by_mixture = np.argsort(holder, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(holder, minlength=len(mixtures)))])
    return GaussianMixtures(
        start.astype(np.int64), weight[by_mixture], mean[by_mixture], covariance[by_mixture]
    )


def merge_groups(mixtures: GaussianMixtures, threshold: float) -> tuple[IntArray, IntArray]:
    """Which components :func:`merge` makes one of.

    Returns
    -------
    group, holder
        (K,) the number of each component's group, and (groups,) the mixture that each group is of.
        The groups of a mixture are numbered in the order of their centres.
    """
    owner, order = mixtures.owner, mixtures._heaviest_first()
    group = np.full(len(order), -1, dtype=np.int64)
    groups = 0
    waiting = order
    while len(waiting):
        centre = np.full(len(mixtures), -1, dtype=np.int64)
        first = waiting[_changes(owner[waiting])]
        centre[owner[first]] = first
        own = centre[owner[waiting]]
        gap = mixtures.mean[waiting] - mixtures.mean[own]
        if np.isinf(threshold):
            near = np.ones(len(waiting), dtype=bool)
        else:
            inverse = np.zeros((len(mixtures), *mixtures.covariance.shape[1:]))
            inverse[owner[first]] = np.linalg.inv(mixtures.covariance[first])
            pull = (inverse[owner[waiting]] @ gap[:, :, None])[:, :, 0]
            near = np.sum(gap * pull, axis=1) <= threshold
        near &= np.sign(mixtures.weight[waiting]) == np.sign(mixtures.weight[own])
        near |= waiting == own
        number = np.zeros(len(mixtures), dtype=np.int64)
        number[owner[first]] = groups + np.arange(len(first))
        group[waiting[near]] = number[owner[waiting[near]]]
        groups += len(first)
        waiting = waiting[~near]
    holder = np.zeros(groups, dtype=np.int64)
    holder[group] = owner
    return group, holder


def _merged(
    mixtures: GaussianMixtures, group: IntArray, groups: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weight, mean and covariance of groups of components, ``group`` (K,) numbers them."""
    size = mixtures.mean.shape[1]
    weight = _sums(group, mixtures.weight, groups)
    # A group of weight zero (components of weight zero) is the plain mean of its components.
    count = np.bincount(group, minlength=groups)
    flat = weight[group] == 0.0
    divisor = np.where(flat, count[group], weight[group])
    share = np.where(flat, 1.0, mixtures.weight) / divisor
    mean = np.zeros((groups, size))
    np.add.at(mean, group, share[:, None] * mixtures.mean)
    gap = mixtures.mean - mean[group]
    each = mixtures.covariance + gap[:, :, None] * gap[:, None, :]
    covariance = np.zeros((groups, size, size))
    np.add.at(covariance, group, share[:, None, None] * each)
    return weight, mean, 0.5 * (covariance + covariance.transpose(0, 2, 1))


def _sums(group: IntArray, values: FloatArray, groups: int) -> FloatArray:
    """Sum of the values of each group; floats also where there are none."""
    return np.bincount(group, values, groups).astype(np.float64)


def _with_totals(mixtures: GaussianMixtures, totals: FloatArray) -> GaussianMixtures:
    """Scale the weights of each mixture so that they sum to ``totals`` (H,)."""
    left = mixtures.totals()
    factor = np.divide(totals, left, out=np.ones(len(mixtures)), where=left != 0.0)
    return GaussianMixtures(
        mixtures.start,
        mixtures.weight * factor[mixtures.owner],
        mixtures.mean,
        mixtures.covariance,
    )


def _changes(owner: IntArray) -> BoolArray:
    """True where a sorted array starts a new value."""
    change = np.ones(len(owner), dtype=bool)
    change[1:] = owner[1:] != owner[:-1]
    return change


def _first_of_each(mixtures: GaussianMixtures, order: IntArray) -> IntArray:
    """The first component of each mixture in ``order`` (K,), which is sorted by mixture."""
    return order[_changes(mixtures.owner[order])]


def detection_weights(
    log_likelihood: FloatArray, detection_probability: float, clutter_density: float
) -> FloatArray:
    """Probabilities of what happened to one target: no detection, or one of D.

    Parameters
    ----------
    log_likelihood
        (D,) log N(z_j; H x, S_j), in log of one over the unit of the measurement.
    detection_probability
        P_D.
    clutter_density
        rho_F in one over the unit of the measurement, > 0 unless P_D < 1.

    Returns
    -------
    ndarray
        (1 + D,): proportional to (1 - P_D) rho_F and P_D N_j, normalised; the weights of the
        mixture whose components are the predicted and the D updated states, and with moments
        matched that of probabilistic data association (Koch 2014, (3.55)-(3.58)).

    Raises
    ------
    ValueError
        If all of them are zero.
    """
    with np.errstate(divide="ignore"):
        missed = np.log((1.0 - detection_probability) * clutter_density)
        log_weight = np.concatenate(
            [[missed], np.log(detection_probability) + np.asarray(log_likelihood, dtype=float)]
        )
    peak = log_weight.max()
    if np.isneginf(peak):
        raise ValueError(
            f"detection_probability = {detection_probability}, clutter_density = "
            f"{clutter_density}: no outcome has any weight"
        )
    weight: FloatArray = np.exp(log_weight - peak)
    return weight / weight.sum()
