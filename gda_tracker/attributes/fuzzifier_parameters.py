"""The parameter table of the RCS fuzzifier: the classes, and what tells them apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gda_tracker.attributes.attribute_evidence import ATTRIBUTE_RULES, AttributeFuzzifier
from gda_tracker.attributes.class_models import CLASS_MODELS
from gda_tracker.attributes.declared_attributes import (
    MAX_ATTRIBUTES,
    AttributeLists,
    declared_attributes,
)
from gda_tracker.attributes.memberships import INTERPOLATIONS, NORMALISATIONS, HistogramSettings
from gda_tracker.evidence.frames import check_frame
from gda_tracker.parameters import ParameterError, parameter, specifications

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
    attribute_names: list[str] = parameter(
        [],
        f"further attributes that speak beside the radar cross section, at most {MAX_ATTRIBUTES}: "
        "the names under which detections bring them, e.g. length_m; radial_speed_mps is the size "
        "of the range rate",
        live=False,
    )
    attribute_models: list[str] = parameter(
        [],
        "what the values of an attribute look like for a class, one entry per attribute: gaussian, "
        "lognormal, trapezoid (grades of membership) or confusion_matrix (the value is the index "
        "of the class that a classifier called, from 0)",
        choices=tuple(CLASS_MODELS),
        live=False,
    )
    attribute_numbers: list[float] = parameter(
        [],
        "numbers of the models in the unit of the attribute, attribute after attribute, class "
        "after class: gaussian mean and standard deviation; lognormal median and standard "
        "deviation of the logarithm; trapezoid where it begins to rise, is 1, begins to fall, is "
        "0; confusion_matrix chance of each call",
        live=False,
    )
    attribute_reliability: list[float] = parameter(
        [],
        "trust in each attribute: this share of its masses and likelihoods counts, the rest tells "
        "nothing; empty: 1 for all",
        minimum=0.0,
        maximum=1.0,
        live=False,
    )
    attribute_unknown_classes: list[str] = parameter(
        [],
        "attribute/class pairs, e.g. length_m/false_alarm, of which nothing is known; they have no "
        "attribute_numbers",
        live=False,
        advanced=True,
    )
    attribute_minimum: list[float] = parameter(
        [],
        "smaller values count as unknown, one entry per attribute; empty: no limit",
        live=False,
        advanced=True,
    )
    attribute_maximum: list[float] = parameter(
        [],
        "larger values count as unknown, one entry per attribute; empty: no limit",
        live=False,
        advanced=True,
    )
    attribute_rule: str = parameter(
        "dempster",
        "how the masses of several attributes of one detection are combined: dsm_classic on the "
        "free model, or dempster (total conflict: ignorance)",
        choices=ATTRIBUTE_RULES,
        live=False,
        advanced=True,
    )
    rcs_reliability: float = parameter(
        1.0,
        "trust in the radar cross section, as attribute_reliability; 0: it is not used",
        minimum=0.0,
        maximum=1.0,
        live=False,
        advanced=True,
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

        declared_attributes(self._attribute_lists, self.class_names)

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

    @property
    def _attribute_lists(self) -> AttributeLists:
        return AttributeLists(
            names=self.attribute_names,
            models=self.attribute_models,
            numbers=self.attribute_numbers,
            unknown_classes=self.attribute_unknown_classes,
            reliability=self.attribute_reliability,
            minimum=self.attribute_minimum,
            maximum=self.attribute_maximum,
        )

    def attributes(self) -> dict[str, AttributeFuzzifier]:
        """Fuzzifiers of the declared attributes, by name in the order of declaration."""
        return declared_attributes(self._attribute_lists, self.class_names)
