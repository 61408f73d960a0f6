"""Evidence of single attributes, and of several attributes of one detection together.

Each attribute gives masses on the frame and log likelihoods of the classes. It is trusted with its
*reliability* r in [0, 1]: masses are discounted, m'(A) = r m(A), the rest goes to total ignorance;
likelihoods are mixed with what tells nothing, f'(z | c) = r f(z | c) + (1 - r) f0(z), where f0 is
the mean of f(z | c) over the classes: with chance 1 - r the value came from any class.

An attribute may know some classes only (its numbers are not known for the others, the set U). Then
a value that goes with class c supports "c or one of U": the mass lies on the union c | U, the least
committed mass on the whole frame that agrees with the attribute's own (deconditioning). The
likelihood of a class of U is f0(z): the value changes nothing about it.

Attributes of one detection are independent given the class, by assumption: log likelihoods add,
masses are combined by the conjunctive rule on the free model (classic DSm rule) or by Dempster's.
Both are commutative and associative, so the order of the attributes plays no part. A log likelihood
means something up to one constant per detection: every joint hypothesis has one factor of each
detection, the unit cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.class_models import ClassModel
from gda_tracker.evidence.frames import free_model, shafer_model, singletons, total_ignorance
from gda_tracker.evidence.rules import conjunction_table, conjunctive
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, MaskArray

# Attribute rules: how the masses of several attributes are combined.
ATTRIBUTE_RULES = ("dsm_classic", "dempster")
# No detection rules out a class for ever: its log likelihood is at most this below the best class.
LARGEST_LOG_RATIO = 500.0


@dataclass(slots=True)
class AttributeEvidence:
    """What one attribute, or several, say of n detections.

    ``masses`` (n, F) over the focal columns ``focal`` (F,), with total ignorance among them, for
    one attribute the last; ``log_class_likelihood`` (n, C); ``informative`` (n,) False where
    nothing is known: mass one on total ignorance, log likelihoods 0.
    """

    focal: MaskArray
    masses: FloatArray
    log_class_likelihood: FloatArray
    informative: BoolArray


def class_focal(known: BoolArray) -> MaskArray:
    """Focal columns (K + 1,) of an attribute that knows K classes (C,): c | U each, then all."""
    size = len(known)
    masks = np.array(singletons(size), dtype=np.uint32)
    unknown = int(np.bitwise_or.reduce(masks[~known])) if not known.all() else 0
    return np.append(masks[known] | np.uint32(unknown), np.uint32(total_ignorance(size)))


def discounted_masses(shares: FloatArray, reliability: float) -> FloatArray:
    """Masses (n, K + 1) from shares of the classes (n, K) with the sum one; the last: ignorance."""
    masses = np.empty((len(shares), shares.shape[1] + 1))
    masses[:, :-1] = shares if reliability == 1.0 else reliability * shares
    masses[:, -1] = 1.0 - reliability
    return masses


def mixed_log_likelihood(
    log_likelihood: FloatArray, known: BoolArray, reliability: float
) -> FloatArray:
    """Log likelihoods of all classes (n, C) from those of the known ones (n, K).

    Rows need one finite entry. With reliability 1 those of known classes stay as they are.
    """
    mixed = np.empty((len(log_likelihood), len(known)))
    if reliability == 1.0 and known.all():
        mixed[:] = log_likelihood
        return mixed
    top = log_likelihood.max(axis=1, keepdims=True)
    ratio = np.exp(log_likelihood - top)
    mean = ratio.mean(axis=1, keepdims=True)
    if reliability == 1.0:
        mixed[:, known] = log_likelihood
    else:
        mixed[:, known] = np.log(reliability * ratio + (1.0 - reliability) * mean) + top
    mixed[:, ~known] = np.log(mean) + top
    return mixed


class AttributeFuzzifier:
    """One attribute: its values in, its evidence out.

    Parameters
    ----------
    model
        Log likelihoods of the K known classes.
    known
        (C,) whether the attribute knows a class.
    reliability
        In [0, 1]; 0: the attribute says nothing.
    minimum, maximum
        Values outside are unknown.
    """

    def __init__(
        self,
        model: ClassModel,
        known: BoolArray,
        reliability: float = 1.0,
        minimum: float = -np.inf,
        maximum: float = np.inf,
    ) -> None:
        self.model = model
        self.known = known
        self.reliability = reliability
        self.minimum, self.maximum = minimum, maximum
        self.focal = class_focal(known)

    def __call__(self, values: FloatArray, valid: BoolArray) -> AttributeEvidence:
        """Turn values (n,), where ``valid`` (n,), into evidence.

        A value that is not finite, lies outside the range or goes with no class is unknown.
        """
        usable = valid & np.isfinite(values)
        usable &= (values >= self.minimum) & (values <= self.maximum)
        log_likelihood = self.model(np.where(usable, values, np.nan))
        # NaN out of the model's own range, -inf where no class gives the value.
        usable &= np.isfinite(log_likelihood.max(axis=1))
        if self.reliability == 0.0:
            return _vacuous(self.focal, len(values), len(self.known))
        # Any numbers do for the rows that are overwritten below.
        log_likelihood = np.where(usable[:, None], log_likelihood, 0.0)
        ratio = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
        masses = discounted_masses(ratio / ratio.sum(axis=1, keepdims=True), self.reliability)
        mixed = mixed_log_likelihood(log_likelihood, self.known, self.reliability)
        forget_rows(~usable, masses, mixed)
        return AttributeEvidence(self.focal, masses, mixed, usable)


def _vacuous(focal: MaskArray, n: int, n_classes: int) -> AttributeEvidence:
    masses, log_likelihood = np.empty((n, len(focal))), np.empty((n, n_classes))
    forget_rows(np.ones(n, dtype=bool), masses, log_likelihood)
    return AttributeEvidence(focal, masses, log_likelihood, np.zeros(n, dtype=bool))


def forget_rows(unknown: BoolArray, masses: FloatArray, log_likelihood: FloatArray) -> None:
    """Make rows vacuous: mass one on the last column, log likelihoods 0."""
    if unknown.any():
        masses[unknown] = 0.0
        masses[unknown, -1] = 1.0
        log_likelihood[unknown] = 0.0


class AttributeCombination:
    """Fuses the evidence of several attributes, detection by detection.

    Parameters
    ----------
    frame
        Names of the frame's elements, one per class.
    focal
        Focal columns of each attribute, in the order in which their evidence is given.
    rule
        One of ``ATTRIBUTE_RULES``. Under ``dempster`` attributes in total conflict leave total
        ignorance.
    """

    def __init__(self, frame: Sequence[str], focal: Sequence[MaskArray], rule: str) -> None:
        self._normalised = rule == "dempster"
        model = shafer_model(frame) if self._normalised else free_model(frame)
        self._tables = []
        self.focal: MaskArray = np.array([total_ignorance(len(frame))], dtype=np.uint32)
        for columns in focal:
            table = conjunction_table(model, self.focal, columns)
            self._tables.append(table)
            self.focal = table.focal
        self._vacuous = (self.focal == total_ignorance(len(frame))).astype(np.float64)

    def __call__(self, evidence: Sequence[AttributeEvidence]) -> AttributeEvidence:
        """Fuse; the columns of the result are the same for every scan."""
        first = evidence[0]
        masses = np.ones((len(first.masses), 1))
        log_likelihood = np.zeros_like(first.log_class_likelihood)
        informative = np.zeros(len(first.informative), dtype=bool)
        for table, item in zip(self._tables, evidence, strict=True):
            masses, _ = conjunctive(table, table.embed(masses), item.masses)
            log_likelihood += item.log_class_likelihood
            informative |= item.informative
        masses = np.ascontiguousarray(masses)
        if self._normalised:
            # The conjunctive rule is associative without its conflict: one division at the end.
            rest = masses.sum(axis=1, keepdims=True)
            masses /= np.maximum(rest, np.finfo(np.float64).tiny)
            masses[rest[:, 0] < np.finfo(np.float64).tiny] = self._vacuous
        top = log_likelihood.max(axis=1, keepdims=True)
        # Attributes that exclude all classes together exclude none.
        top[np.isneginf(top)] = LARGEST_LOG_RATIO
        np.maximum(log_likelihood, top - LARGEST_LOG_RATIO, out=log_likelihood)
        return AttributeEvidence(self.focal, masses, log_likelihood, informative)
