"""The RCS fuzzifier: radar cross sections of a scan become evidence on classes.

Per detection it gives masses on the labels of the frame (Tchamova et al. 2004, 14.3.1 and
14.3.2.1), the exact class likelihoods and the class probabilities that follow from this detection
alone (Mahler 2011, (94)). A detection without a usable RCS knows nothing: its mass is on total
ignorance.

>>> parameters = RcsFuzzifierParameters(class_prior=[0.1, 0.5, 0.4])
>>> RcsFuzzifier(parameters).frame
('VS', 'S', 'B')
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.attributes.bayes import class_update
from gda_tracker.attributes.frames import check_frame, singletons, total_ignorance
from gda_tracker.attributes.memberships import (
    INTERPOLATIONS,
    NORMALISATIONS,
    DensityMembership,
    HistogramMembership,
    HistogramSettings,
)
from gda_tracker.attributes.rcs import gamma_shape, log_gamma_density
from gda_tracker.parameters import ParameterError, parameter, specifications
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.scans import Scan

MEMBERSHIPS = ("histogram", "density")
MAX_CLASSES = 4
MAX_HISTOGRAM_BINS = 100_000


@dataclass(frozen=True)
class RcsFuzzifierParameters:
    """The classes, what their radar cross sections look like, and how an RCS becomes a belief."""

    class_names: list[str] = parameter(
        ["false_alarm", "fighter", "cargo"],
        f"names of the 2 to {MAX_CLASSES} classes; the first one is the false alarm",
        live=False,
    )
    class_rcs_mean_m2: list[float] = parameter(
        [0.3, 1.2, 4.0],
        "mean radar cross section, one entry per class",
        unit="m2",
        minimum=1e-6,
        maximum=1e9,
        live=False,
    )
    class_rcs_swerling: list[int] = parameter(
        [2, 3, 3],
        "Swerling model, one entry per class: 1 or 2 exponential, 3 or 4 gamma with shape 2",
        minimum=1,
        maximum=4,
        live=False,
    )
    class_labels: list[str] = parameter(
        ["VS", "S", "B"],
        "elements of the frame of discernment, one per class: very small, small, big",
        live=False,
    )
    class_prior: list[float] = parameter(
        [0.0, 0.5, 0.5],
        "probability of each class before any detection, need not sum to one; empty: equal for all "
        "but the false alarm",
        minimum=0.0,
        maximum=1e9,
        live=False,
    )
    membership: str = parameter(
        "histogram",
        "grades of membership: histogram of simulated draws (as in the 2004 chapter) or density",
        choices=MEMBERSHIPS,
        live=False,
    )
    rcs_min_m2: float = parameter(
        1e-6,
        "smaller radar cross sections count as unknown",
        unit="m2",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    rcs_max_m2: float = parameter(
        1e6,
        "larger radar cross sections count as unknown",
        unit="m2",
        minimum=0.0,
        maximum=1e12,
        minimum_excluded=True,
        advanced=True,
    )
    histogram_n_draws: int = parameter(
        10_000, "draws per class", minimum=1, maximum=10_000_000, live=False, advanced=True
    )
    histogram_bin_width_m2: float = parameter(
        0.1,
        "width of a bin",
        unit="m2",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    histogram_max_rcs_m2: float = parameter(
        30.0,
        "end of the last bin; beyond it the class of the largest mean is certain",
        unit="m2",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    histogram_normalisation: str = parameter(
        "area",
        "of the histograms: area, the share of draws in a bin; peak, relative to the fullest bin",
        choices=NORMALISATIONS,
        live=False,
        advanced=True,
    )
    histogram_interpolation: str = parameter(
        "linear",
        "between bin centres, or nearest: the height of the bin",
        choices=INTERPOLATIONS,
        live=False,
        advanced=True,
    )
    histogram_seed: int = parameter(2004, "seed of the draws", minimum=0, live=False, advanced=True)

    def __post_init__(self) -> None:
        """Refuse values out of range and tables that do not fit together."""
        for name, specification in specifications(type(self)).items():
            specification.check(getattr(self, name))
        n = len(self.class_names)
        if not 2 <= n <= MAX_CLASSES or len(set(self.class_names)) < n or "" in self.class_names:
            raise self._error("class_names", f"2 to {MAX_CLASSES} names that differ")
        for name in ("class_rcs_mean_m2", "class_rcs_swerling", "class_labels"):
            if len(getattr(self, name)) != n:
                raise self._error(name, f"a list with one entry per class, {n} in all")
        try:
            check_frame(self.class_labels)
        except ValueError:
            raise self._error(
                "class_labels", "names that differ, without blanks, &, |, ( and )"
            ) from None
        if len(self.class_prior) not in (0, n):
            raise self._error("class_prior", f"one entry per class, {n} in all, or an empty list")
        if self.class_prior and sum(self.class_prior) <= 0.0:
            raise self._error("class_prior", "a list with a sum > 0")
        if self.rcs_max_m2 <= self.rcs_min_m2:
            raise self._error("rcs_max_m2", f"a number > rcs_min_m2 = {self.rcs_min_m2:g} [m2]")
        if not 1 <= self.histogram_max_rcs_m2 / self.histogram_bin_width_m2 <= MAX_HISTOGRAM_BINS:
            raise self._error(
                "histogram_bin_width_m2",
                f"a number that cuts histogram_max_rcs_m2 = {self.histogram_max_rcs_m2:g} into 1 "
                f"to {MAX_HISTOGRAM_BINS} bins [m2]",
            )

    def _error(self, name: str, allowed: str) -> ParameterError:
        value: Any = getattr(self, name)
        return ParameterError(f"parameter {name} = {value!r}: allowed is {allowed}")

    @property
    def prior(self) -> list[float]:
        """The class prior, normalised."""
        values = self.class_prior or [0.0] + [1.0] * (len(self.class_names) - 1)
        return [value / sum(values) for value in values]

    @property
    def histogram(self) -> HistogramSettings:
        """The settings of the histograms."""
        return HistogramSettings(
            n_draws=self.histogram_n_draws,
            bin_width_m2=self.histogram_bin_width_m2,
            max_rcs_m2=self.histogram_max_rcs_m2,
            normalisation=self.histogram_normalisation,
            interpolation=self.histogram_interpolation,
            seed=self.histogram_seed,
        )


class RcsFuzzifier:
    """The stage: a scan in, evidence out.

    The focal columns are the k labels of the frame, then total ignorance.

    Parameters
    ----------
    parameters
        The stage's parameters.
    """

    def __init__(self, parameters: RcsFuzzifierParameters) -> None:
        self.parameters = parameters
        self.frame = tuple(parameters.class_labels)
        self.class_names = tuple(parameters.class_names)
        size = len(self.frame)
        self.focal = np.array([*singletons(size), total_ignorance(size)], dtype=np.uint32)
        self.prior = np.array(parameters.prior)
        means, models = parameters.class_rcs_mean_m2, parameters.class_rcs_swerling
        self._shape = gamma_shape(models)
        self._rate = self._shape / np.array(means)
        self.membership: HistogramMembership | DensityMembership
        if parameters.membership == "histogram":
            self.membership = HistogramMembership(means, models, parameters.histogram)
        else:
            self.membership = DensityMembership(means, models)

    def __call__(self, scan: Scan) -> Evidence:
        """Turn the radar cross sections of a scan into evidence.

        An RCS that is marked invalid, is not a number or lies outside ``rcs_min_m2`` to
        ``rcs_max_m2`` is unknown: all mass on total ignorance, log likelihoods 0, the prior as
        class probability.
        """
        p = self.parameters
        rcs_m2 = scan.rcs_m2
        informative = scan.rcs_valid & (rcs_m2 >= p.rcs_min_m2) & (rcs_m2 <= p.rcs_max_m2)
        # Any RCS in range does for the rows that are overwritten below.
        rcs_m2 = np.where(informative, rcs_m2, p.rcs_min_m2)
        grades = self.membership(rcs_m2)
        masses = np.zeros((len(grades), len(self.focal)))
        masses[:, :-1] = grades / grades.sum(axis=1, keepdims=True)
        log_likelihood = log_gamma_density(rcs_m2[:, None], self._shape, self._rate)
        unknown = ~informative
        if unknown.any():
            masses[unknown, :-1] = 0.0
            masses[unknown, -1] = 1.0
            log_likelihood[unknown] = 0.0
        class_probability, _ = class_update(self.prior, log_likelihood)
        class_probability[unknown] = self.prior
        return Evidence(
            key=scan.key,
            frame=self.frame,
            focal=self.focal.copy(),
            masses=masses,
            class_names=self.class_names,
            log_class_likelihood=log_likelihood,
            class_probability=class_probability,
            informative=informative,
        )
