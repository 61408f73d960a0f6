"""The RCS fuzzifier: what a scan says about attributes becomes evidence on classes.

Per detection it gives masses on the labels of the frame (Tchamova et al. 2004, 14.3.1 and
14.3.2.1), the exact class likelihoods and the class probabilities that follow from this detection
alone (Mahler 2011, (94)). By default the only attribute is the radar cross section; parameters
declare more (:mod:`gda_tracker.attributes.attribute_evidence`), and statements about a place speak
of the detections there (:mod:`gda_tracker.attributes.statement_evidence`). A detection of which
nothing is known has its mass on total ignorance.

>>> parameters = RcsFuzzifierParameters(class_prior=[0.1, 0.5, 0.4])
>>> RcsFuzzifier(parameters).frame
('VS', 'S', 'B')
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from gda_tracker.attributes.attribute_evidence import (
    AttributeCombination,
    AttributeEvidence,
    class_focal,
    discounted_masses,
    forget_rows,
    mixed_log_likelihood,
)
from gda_tracker.attributes.bayes import class_update
from gda_tracker.attributes.fuzzifier_parameters import RcsFuzzifierParameters
from gda_tracker.attributes.memberships import DensityMembership, HistogramMembership
from gda_tracker.attributes.rcs import gamma_shape, log_gamma_density
from gda_tracker.attributes.statement_evidence import with_place_statements
from gda_tracker.attributes.statement_meaning import classes_known
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.scans import Scan

__all__ = ["RcsFuzzifier", "RcsFuzzifierParameters"]

# The attribute that needs no column of its own: the size of the range rate.
RADIAL_SPEED = "radial_speed_mps"


class RcsFuzzifier:
    """The stage: a scan in, evidence out.

    With the radar cross section alone the focal columns are the k labels of the frame, then total
    ignorance; with declared attributes those and their intersections, the same for every scan.

    Parameters
    ----------
    parameters
        The stage's parameters.
    counters
        Where to count, by attribute, the values that were out of range, and the statements that
        name a class that is none of ours: such a statement says nothing about classes.
    """

    def __init__(
        self, parameters: RcsFuzzifierParameters, counters: Counter[str] | None = None
    ) -> None:
        self.parameters = parameters
        self.frame = tuple(parameters.class_labels)
        self.class_names = tuple(parameters.class_names)
        self.prior = np.array(parameters.prior)
        self.counters: Counter[str] = Counter() if counters is None else counters
        means, models = parameters.class_rcs_mean_m2, parameters.class_rcs_swerling
        self._shape = gamma_shape(models)
        self._rate = self._shape / np.array(means)
        self.membership: HistogramMembership | DensityMembership
        if parameters.membership == "histogram":
            self.membership = HistogramMembership(means, models, parameters.histogram)
        else:
            self.membership = DensityMembership(means, models)
        self.attributes = parameters.attributes()
        self._every_class = np.ones(len(self.frame), dtype=bool)
        self._rcs_focal = class_focal(self._every_class)
        self.focal = self._rcs_focal
        self._combine: AttributeCombination | None = None
        if self.attributes:
            columns = [self._rcs_focal, *(item.focal for item in self.attributes.values())]
            self._combine = AttributeCombination(self.frame, columns, parameters.attribute_rule)
            self.focal = self._combine.focal

    def __call__(self, scan: Scan) -> Evidence:
        """Turn the attributes of a scan into evidence.

        An RCS that is marked invalid, is not a number or lies outside ``rcs_min_m2`` to
        ``rcs_max_m2`` is unknown, as is a further attribute that is absent, invalid, not finite,
        out of its range or beyond all classes. A detection of which nothing is known has all mass
        on total ignorance, log likelihoods 0, the prior as class probability.
        """
        found = self._radar_cross_section(scan)
        if self._combine is not None:
            found = self._combine(
                [found, *(self._attribute(scan, name) for name in self.attributes)]
            )
        if scan.statements:
            found = self._with_statements(found, scan)
        log_likelihood, unknown = found.log_class_likelihood, ~found.informative
        class_probability, _ = class_update(self.prior, log_likelihood)
        class_probability[unknown] = self.prior
        return Evidence(
            key=scan.key,
            frame=self.frame,
            focal=found.focal.copy(),
            masses=found.masses,
            class_names=self.class_names,
            log_class_likelihood=log_likelihood,
            class_probability=class_probability,
            informative=found.informative,
        )

    def _radar_cross_section(self, scan: Scan) -> AttributeEvidence:
        p = self.parameters
        rcs_m2 = scan.rcs_m2
        usable = scan.rcs_valid & (rcs_m2 >= p.rcs_min_m2) & (rcs_m2 <= p.rcs_max_m2)
        self._count("rcs_m2", scan.rcs_valid, usable)
        if p.rcs_reliability == 0.0:
            usable = np.zeros_like(usable)
        # Any RCS in range does for the rows that are overwritten below.
        rcs_m2 = np.where(usable, rcs_m2, p.rcs_min_m2)
        grades = self.membership(rcs_m2)
        masses = discounted_masses(grades / grades.sum(axis=1, keepdims=True), p.rcs_reliability)
        log_likelihood = mixed_log_likelihood(
            log_gamma_density(rcs_m2[:, None], self._shape, self._rate),
            self._every_class,
            p.rcs_reliability,
        )
        forget_rows(~usable, masses, log_likelihood)
        return AttributeEvidence(self._rcs_focal, masses, log_likelihood, usable)

    def _with_statements(self, found: AttributeEvidence, scan: Scan) -> AttributeEvidence:
        names = self.class_names
        strange = sum(not classes_known(statement, names) for statement in scan.statements)
        if strange:
            self.counters["statement_of_unknown_class"] += strange
        return with_place_statements(found, scan, self.frame, names, self.parameters.attribute_rule)

    def _attribute(self, scan: Scan, name: str) -> AttributeEvidence:
        values, valid = _column(scan, name)
        evidence = self.attributes[name](values, valid)
        if self.attributes[name].reliability > 0.0:
            self._count(name, valid, evidence.informative)
        return evidence

    def _count(self, name: str, valid: BoolArray, usable: BoolArray) -> None:
        unused = np.count_nonzero(valid) - np.count_nonzero(usable)
        if unused:
            self.counters[f"{name}_out_of_range"] += int(unused)


def _column(scan: Scan, name: str) -> tuple[FloatArray, BoolArray]:
    """Values (n,) of an attribute and whether they are known; nothing is where it is absent."""
    if name in scan.attribute_names:
        assert scan.attribute_values is not None
        assert scan.attribute_valid is not None
        row = scan.attribute_names.index(name)
        return scan.attribute_values[row], scan.attribute_valid[row]
    if name == RADIAL_SPEED and scan.range_rate_mps is not None:
        return np.abs(scan.range_rate_mps), np.ones(len(scan), dtype=bool)
    return np.zeros(len(scan)), np.zeros(len(scan), dtype=bool)
