"""Memberships: how well an RCS goes with each class (Tchamova et al. 2004, 14.3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.attributes.rcs import density, gamma_shape, sample
from gda_tracker.vocabulary.arrays import FloatArray

NORMALISATIONS = ("area", "peak")
INTERPOLATIONS = ("linear", "nearest")


@dataclass(frozen=True)
class HistogramSettings:
    """How the histograms of the memberships are made.

    ``n_draws`` draws per class from ``seed``; bins of ``bin_width_m2`` from 0 to ``max_rcs_m2``;
    grades are the share of draws in a bin (``area``) or the count over that of the fullest bin
    (``peak``); between bin centres they are interpolated (``linear``) or that of the bin
    (``nearest``).
    """

    n_draws: int = 10_000
    bin_width_m2: float = 0.1
    max_rcs_m2: float = 30.0
    normalisation: str = "area"
    interpolation: str = "linear"
    seed: int = 2004


@lru_cache(maxsize=32)
def _histograms(
    means: tuple[float, ...], models: tuple[int, ...], settings: HistogramSettings
) -> tuple[FloatArray, FloatArray]:
    """Bin edges and draws per bin (C, bins), read-only; made once per process."""
    generator = np.random.default_rng(settings.seed)
    n_bins = int(np.ceil(settings.max_rcs_m2 / settings.bin_width_m2 - 1e-9))
    edges_m2 = np.append(np.arange(n_bins) * settings.bin_width_m2, settings.max_rcs_m2)
    counts = np.empty((len(means), n_bins))
    for row, (mean, swerling) in enumerate(zip(means, models, strict=True)):
        draws = sample(generator, mean, swerling, settings.n_draws)
        counts[row] = np.histogram(draws, edges_m2)[0]
    for array in (edges_m2, counts):
        array.flags.writeable = False
    return edges_m2, counts


class HistogramMembership:
    """Grades of membership from histograms of simulated radar cross sections, one per class.

    The draws are made class after class from one ``numpy.random.default_rng(seed)``, each class
    ``n_draws`` uniforms put through its inverse cumulative probability. The histogram counts what
    falls below ``max_rcs_m2``; the last bin is cut there.

    Between the first and last bin centre ``linear`` interpolates; in the outer halves of the first
    and last bin the grade is that of the bin. Beyond ``max_rcs_m2`` all grades are zero. Where all
    grades are zero, beyond the end or in a gap of all histograms, the class of the largest mean
    gets grade 1.

    Parameters
    ----------
    class_rcs_mean_m2, class_rcs_swerling
        (C,) mean RCS [m2] and Swerling model of each class.
    settings
        How the histograms are made.
    """

    def __init__(
        self,
        class_rcs_mean_m2: list[float],
        class_rcs_swerling: list[int],
        settings: HistogramSettings,
    ) -> None:
        self.edges_m2, counts = _histograms(
            tuple(class_rcs_mean_m2), tuple(class_rcs_swerling), settings
        )
        if settings.normalisation == "peak":
            self.grades = counts / np.maximum(counts.max(axis=1, keepdims=True), 1.0)
        else:
            self.grades = counts / settings.n_draws
        self.linear = settings.interpolation == "linear"
        self.largest = int(np.argmax(class_rcs_mean_m2))
        centres = 0.5 * (self.edges_m2[:-1] + self.edges_m2[1:])
        self._knots_m2 = np.concatenate([[0.0], centres, [settings.max_rcs_m2]])
        self._knot_grades = np.pad(self.grades, ((0, 0), (1, 1)), mode="edge")

    def __call__(self, rcs_m2: FloatArray) -> FloatArray:
        """Grades (n, C) of radar cross sections (n,) [m2]; no row is all zero."""
        grades = np.empty((len(rcs_m2), len(self.grades)))
        if self.linear:
            for column, row in enumerate(self._knot_grades):
                grades[:, column] = np.interp(rcs_m2, self._knots_m2, row, left=0.0, right=0.0)
        else:
            place = np.searchsorted(self.edges_m2, rcs_m2, side="right") - 1
            inside = (place >= 0) & (place < self.grades.shape[1])
            grades[:] = np.where(inside[:, None], self.grades.T[np.where(inside, place, 0)], 0.0)
        nothing = ~grades.any(axis=1)
        grades[nothing, self.largest] = 1.0
        return grades


class DensityMembership:
    """Grades of membership that are the exact densities of the classes.

    Parameters
    ----------
    class_rcs_mean_m2, class_rcs_swerling
        (C,) mean RCS [m2] and Swerling model of each class.
    """

    def __init__(self, class_rcs_mean_m2: list[float], class_rcs_swerling: list[int]) -> None:
        self.mean_m2 = np.array(class_rcs_mean_m2)
        self.swerling = np.array(class_rcs_swerling)
        self.slowest = int(np.argmin(gamma_shape(self.swerling) / self.mean_m2))

    def __call__(self, rcs_m2: FloatArray) -> FloatArray:
        """Grades (n, C) [1/m2] of radar cross sections (n,) [m2]; no row is all zero.

        Where all densities underflow, the class whose density falls off slowest gets grade 1.
        """
        grades = density(rcs_m2[:, None], self.mean_m2, self.swerling)
        nothing = ~grades.any(axis=1)
        grades[nothing, self.slowest] = 1.0
        return grades
