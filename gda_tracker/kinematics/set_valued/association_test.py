"""The association likelihood ratio test (Stirling & Thompson 1991, equations 10, 22 to 24).

A predicted track set may own an observation z if for some mean x in it the credal density q(x) is
at least b times the density m(x) of what rejecting the association is worth, with the boldness b,
and H x in the seriously possible region of z. With v = H x - z

    q = exp(- v' W' P+^-1 W v / 2) / normaliser,    W' P+^-1 W = R^-1 (H P+ H') R^-1,
    m = |v| / (integral of |zeta| over the box |zeta_l| <= theta rho_l),

P+ the covariance after filtering. What is decided is whether the supremum over the set of
log q - log m reaches log b; where H x = z for a member it is infinite. Printed, q is a density over
the state: its normaliser |2 pi P+|^(1/2) has other units than that of m, and the decision changes
with the unit of length. By default q is therefore marginalised to the space of the measurement,
normaliser |2 pi H P+ H'|^(1/2), with the same exponent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.set_valued.filter import TrackSets
from gda_tracker.kinematics.set_valued.nearest_boundary import (
    EDGE,
    contains_origin,
    highest_on_ellipse,
    highest_on_ellipsoid,
    highest_on_interval,
)
from gda_tracker.kinematics.set_valued.possible_region import distance_integral
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MEASUREMENT, STATE = "measurement", "state"
SPACES = (MEASUREMENT, STATE)
# Pairs that are searched at a time in three and more dimensions.
BLOCK = 256


@dataclass(frozen=True)
class AssociationTest:
    """What the test is told.

    ``boldness`` b, 0 to 1: at 1 as many associations are rejected as possible, near 0 as few.
    ``theta``: half width of the seriously possible region in standard deviations of the
    observation. ``space``: ``measurement`` (answers do not depend on units) or ``state`` (as
    printed).

    Raises
    ------
    ValueError
        If one of them is not allowed.
    """

    boldness: float = 0.5
    theta: float = 5.0
    space: str = MEASUREMENT

    def __post_init__(self) -> None:
        """Refuse what is not allowed."""
        if not 0.0 <= self.boldness <= 1.0:
            raise ValueError(f"boldness = {self.boldness}: allowed is a number >= 0 and <= 1")
        if not 0.0 < self.theta < math.inf:
            raise ValueError(f"theta = {self.theta}: allowed is a number > 0")
        if self.space not in SPACES:
            raise ValueError(f"space = {self.space!r}: allowed is one of {', '.join(SPACES)}")

    def associated(
        self, sets: TrackSets, observation: FloatArray, observing: FloatArray, std: FloatArray
    ) -> BoolArray:
        """Say which of s observations each of N sets may own: (N, s), arguments as below."""
        threshold = math.log(self.boldness) if self.boldness > 0.0 else -np.finfo(float).max
        return self.log_ratio(sets, observation, observing, std) >= threshold

    def log_ratio(
        self, sets: TrackSets, observation: FloatArray, observing: FloatArray, std: FloatArray
    ) -> FloatArray:
        """Supremum over each of N predicted sets of log q - log m, for each of s observations.

        Parameters
        ----------
        sets
            N predicted track sets over n components.
        observation
            z (s, r), r >= 1.
        observing
            H (r, n) for all or (s, r, n).
        std
            rho (r,) or (s, r), > 0: standard deviations of the observation errors, which are
            uncorrelated. Correlated ones are turned into their principal axes first, see
            :mod:`gda_tracker.kinematics.set_valued.positions`.

        Returns
        -------
        (N, s), infinite where a member of the set explains the observation exactly, minus infinite
        where no member predicts it within the seriously possible region.

        Raises
        ------
        ValueError
            If an array has another shape, or a standard deviation is not > 0.
        """
        z, h, rho = _checked(sets, observation, observing, std)
        ratio = np.full((len(sets), len(z)), -np.inf)
        j, i = self._possible(sets, z, h, rho)
        if len(j):
            ratio[j, i] = self._of_pairs(sets.select(j), z[i], h[i], rho[i])
        return ratio

    def _possible(
        self, sets: TrackSets, z: FloatArray, h: FloatArray, rho: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Pairs (set, observation) of which the bounding box of the one meets that of the other."""
        if not len(sets) or not len(z):
            none = np.zeros(0, dtype=np.int64)
            return none, none
        s, r, n = h.shape
        rows = h.reshape(s * r, n)
        centre = (sets.centroid @ rows.T).reshape(-1, s, r) - z
        reach = np.sqrt(np.sum((rows @ sets.matrix) ** 2, axis=2)).reshape(-1, s, r)
        found = (np.abs(centre) - reach <= self.theta * rho * EDGE).all(axis=2)
        j, i = np.nonzero(found)
        return j, i

    def _of_pairs(
        self, sets: TrackSets, z: FloatArray, h: FloatArray, rho: FloatArray
    ) -> FloatArray:
        """Supremum of each of M pairs."""
        r = z.shape[1]
        width = self.theta * rho
        # One length for all that follows, for the sake of the numbers, not of the answer.
        length = width.max(axis=1)
        centre = ((h @ sets.centroid[:, :, None])[:, :, 0] - z) / length[:, None]
        spread = (h @ sets.matrix) / length[:, None, None]
        shape = spread @ spread.transpose(0, 2, 1)
        predicted = h @ sets.covariance @ h.transpose(0, 2, 1)
        predicted = (predicted + predicted.transpose(0, 2, 1)) / 2.0
        noise = rho[:, :, None] ** 2 * np.eye(r)
        # R^-1 (H P+ H') R^-1 = R^-1 - (H P H' + R)^-1, in the form that loses no digits.
        exponent = np.linalg.solve(predicted + noise, predicted) / rho[:, None, :] ** 2
        exponent = (exponent + exponent.transpose(0, 2, 1)) / 2.0 * length[:, None, None] ** 2

        ratio = np.full(len(z), np.inf)
        rest = np.flatnonzero(~contains_origin(centre, shape))
        search = {1: highest_on_interval, 2: highest_on_ellipse}.get(r, highest_on_ellipsoid)
        block = len(rest) if r < 3 else BLOCK
        for begin in range(0, len(rest), max(block, 1)):
            part = rest[begin : begin + block]
            ratio[part] = search(
                centre[part], shape[part], exponent[part], width[part] / length[part, None]
            )
        constant = np.log(distance_integral(width)) - np.log(length)
        return ratio + constant - self._log_normaliser(sets, predicted, noise, rho)

    def _log_normaliser(
        self, sets: TrackSets, predicted: FloatArray, noise: FloatArray, rho: FloatArray
    ) -> FloatArray:
        """Logarithm of |2 pi H P+ H'|^(1/2) or of |2 pi P+|^(1/2).

        Filtering multiplies either determinant by det R / det (H P H' + R).
        """
        before = predicted if self.space == MEASUREMENT else sets.covariance
        with np.errstate(divide="ignore"):
            log_determinant = np.linalg.slogdet(before)[1]
        gained = 2.0 * np.log(rho).sum(axis=1) - np.linalg.slogdet(predicted + noise)[1]
        return 0.5 * (before.shape[1] * math.log(2.0 * math.pi) + log_determinant + gained)


def _checked(
    sets: TrackSets, observation: FloatArray, observing: FloatArray, std: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    n = sets.centroid.shape[1]
    if observation.ndim != 2 or observation.shape[1] == 0:
        raise ValueError(f"observation of shape {observation.shape}: allowed is (s, r), r >= 1")
    s, r = observation.shape
    if observing.shape not in ((r, n), (s, r, n)):
        raise ValueError(
            f"observing of shape {observing.shape}: allowed is {(r, n)} or {(s, r, n)}"
        )
    if std.shape not in ((r,), (s, r)):
        raise ValueError(f"std of shape {std.shape}: allowed is {(r,)} or {(s, r)}")
    if not (std > 0.0).all():
        raise ValueError(f"std = {std.min() if std.size else std}: allowed are numbers > 0")
    return observation, np.broadcast_to(observing, (s, r, n)), np.broadcast_to(std, (s, r))
