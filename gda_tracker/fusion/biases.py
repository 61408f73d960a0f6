"""Radar biases and targets together: Gaussians over the state of a target and all unknown biases.

A radar's bias is a shift of its positions in the common frame: adding it to them gives the true
ones. Given the biases the targets are independent, so each target keeps a Gaussian over its own
state and the biases, without the biases' prior. What it says of the biases, with its state
integrated out, is its vote; the biases' posterior is the product of the prior and all votes. A
target of one radar alone has no vote, as its state can take up any bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gda_tracker.fusion.motion import STATE
from gda_tracker.fusion.parameters import DIFFUSE
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

DIFFUSE_STD_M = 1e6
"""In place of an infinite standard deviation: far beyond any bias, and with digits to spare."""

UNKNOWN_STD_M = 1e5
"""Biases with a standard deviation above it are not known."""


class BiasUnknowns(NamedTuple):
    """Which biases are unknown, and their prior.

    Attributes
    ----------
    column : (r,)
        First of the two columns of each radar's bias, counted from the first bias; -1: known to be
        zero.
    prior : (n, n)
        Information; n = 2 times the number of unknown biases.
    reference
        Radar whose bias is taken for zero because none is known, -1: the biases are absolute.
    """

    column: IntArray
    prior: FloatArray
    reference: int

    @property
    def size(self) -> int:
        """Number n of unknown coordinates."""
        return len(self.prior)

    def rows(self, radar: int) -> slice:
        """Columns of a radar's bias among the unknowns of a target and the biases."""
        first = STATE + int(self.column[radar])
        return slice(first, first + 2)


def bias_unknowns(std_m: Sequence[float], n_radars: int) -> BiasUnknowns:
    """Arrange the biases; without any finite prior the first radar is the reference."""
    std = list(std_m) or [DIFFUSE] * n_radars
    reference = 0 if all(s == DIFFUSE for s in std) else -1
    column = np.full(n_radars, -1)
    prior: list[float] = []
    for radar, value in enumerate(std):
        if value == 0.0 or radar == reference:
            continue
        column[radar] = 2 * len(prior)
        prior.append(DIFFUSE_STD_M if value == DIFFUSE else value)
    information = np.repeat(np.array(prior, dtype=np.float64) ** -2.0, 2)
    return BiasUnknowns(column, np.diag(information), reference)


def absorb(
    information: FloatArray,
    vector: FloatArray,
    targets: IntArray,
    learnt: tuple[FloatArray, FloatArray],
    unknowns: BiasUnknowns,
    radar: int,
) -> None:
    """Add what a radar learnt of different targets (k,) to their Gaussians, in place.

    It learnt y = x - b + error: information (k, 4, 4) and vector (k, 4) of the state as that radar
    sees it (Koch 2014, 2.27-2.28 in information form).
    """
    gain, value = learnt
    information[targets, :STATE, :STATE] += gain
    vector[targets, :STATE] += value
    if unknowns.column[radar] < 0:
        return
    own = unknowns.rows(radar)
    information[targets, :STATE, own] -= gain[:, :, :2]
    information[targets, own, :STATE] -= gain[:, :2, :]
    information[targets, own, own] += gain[:, :2, :2]
    vector[targets, own] -= value[:, :2]


def votes(information: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What targets say of the biases: information (N, n, n), vector (N, n)."""
    state, mixed = information[:, :STATE, :STATE], information[:, :STATE, STATE:]
    solved = np.linalg.solve(state, mixed)
    inner = information[:, STATE:, STATE:] - np.swapaxes(mixed, 1, 2) @ solved
    return (
        0.5 * (inner + np.swapaxes(inner, 1, 2)),
        vector[:, STATE:] - np.einsum("nij,ni->nj", solved, vector[:, :STATE]),
    )


def forget(
    information: FloatArray, vector: FloatArray, share: float
) -> tuple[FloatArray, FloatArray]:
    """Let the votes of targets count less; their states given the biases stay."""
    inner, outer = votes(information, vector)
    information, vector = information.copy(), vector.copy()
    information[:, STATE:, STATE:] -= (1.0 - share) * inner
    vector[:, STATE:] -= (1.0 - share) * outer
    return information, vector


def states(
    information: FloatArray, vector: FloatArray, rest: FloatArray, rest_vector: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """States (N, 4) and covariances (N, 4, 4) of targets, biases integrated out.

    Parameters
    ----------
    rest : (N, n, n), rest_vector : (N, n)
        What is known of the biases without the target's own vote.
    """
    state, mixed = information[:, :STATE, :STATE], information[:, :STATE, STATE:]
    inner = information[:, STATE:, STATE:] + rest
    outer = vector[:, STATE:] + rest_vector
    solved = np.linalg.solve(inner, np.swapaxes(mixed, 1, 2))
    covariance: FloatArray = np.asarray(np.linalg.inv(state - mixed @ solved), dtype=np.float64)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    left = vector[:, :STATE] - np.einsum("nij,ni->nj", solved, outer)
    return np.einsum("nij,nj->ni", covariance, left), covariance


class Biases(NamedTuple):
    """Biases of all radars: mean (r, 2) and covariance (r, 2, 2) [m, m2]."""

    mean: FloatArray
    covariance: FloatArray

    def hidden(self) -> Biases:
        """The same with NaN for what is not known."""
        wide = np.trace(self.covariance, axis1=1, axis2=2) > 2.0 * UNKNOWN_STD_M**2
        return Biases(
            np.where(wide[:, None], np.nan, self.mean),
            np.where(wide[:, None, None], np.nan, self.covariance),
        )


def biases_of(unknowns: BiasUnknowns, information: FloatArray, vector: FloatArray) -> Biases:
    """Biases of all radars from what is known of the unknown ones, the prior included."""
    n_radars = len(unknowns.column)
    mean, covariance = np.zeros((n_radars, 2)), np.zeros((n_radars, 2, 2))
    if unknowns.size:
        spread = np.linalg.inv(information)
        centre = spread @ vector
        for radar in (unknowns.column >= 0).nonzero()[0]:
            rows = slice(unknowns.column[radar], unknowns.column[radar] + 2)
            mean[radar], covariance[radar] = centre[rows], spread[rows, rows]
    return Biases(mean, 0.5 * (covariance + np.swapaxes(covariance, 1, 2)))
