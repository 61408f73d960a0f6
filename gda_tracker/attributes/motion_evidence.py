"""How an object has moved, as evidence on its class (Koch 2014, 1.3.5, inferences from histories).

Classes are known by ranges of speed and of acceleration, trapezoids
(:mod:`gda_tracker.attributes.class_ranges`). The evidence of a history is that of its extremes
(:mod:`gda_tracker.kinematics.motion_extremes`): the lesser of what the greatest and the least speed
make likely, and what the greatest acceleration does. Given the class the two are independent.
Each is trusted with a reliability, as an attribute of a detection is: the rest tells nothing.

It is one piece of evidence, that of the *whole* history. So it is combined with the belief of a
track to be told, and the next scan begins from the belief without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.attribute_evidence import (
    AttributeEvidence,
    class_focal,
    discounted_masses,
    forget_rows,
    mixed_log_likelihood,
)
from gda_tracker.attributes.class_ranges import DENSITIES, log_density, log_possibility
from gda_tracker.attributes.class_terms import fuse_classes
from gda_tracker.attributes.mass_terms import fuse_masses
from gda_tracker.attributes.pair_beliefs import PairBeliefs, Pairs
from gda_tracker.attributes.statement_evidence import consonant_masses, union_focal
from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.kinematics.motion_extremes import (
    GREATEST_ACCELERATION,
    GREATEST_SPEED,
    LEAST_SPEED,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, MaskArray
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.scans import ScanKey

_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, slots=True, eq=False)
class ClassMotion:
    """How classes move.

    Attributes
    ----------
    reading
        ``ranges`` or ``densities``.
    class_names
        K classes of which something is known.
    speed_mps, acceleration_mps2
        (K, 4) corners of the ranges, (0, 4) where nothing is known.
    reliability
        In [0, 1], of each of the two.
    """

    reading: str
    class_names: tuple[str, ...]
    speed_mps: FloatArray
    acceleration_mps2: FloatArray
    reliability: float


def motion_evidence(
    extremes: FloatArray,
    motion: ClassMotion,
    class_names: Sequence[str],
) -> AttributeEvidence:
    """Evidence of histories.

    Parameters
    ----------
    extremes
        (n, 3, 2) of :mod:`gda_tracker.kinematics.motion_extremes`, NaN where not known.
    motion
        How classes move; a class that is not named there is as likely as the best of the others
        (``ranges``), or as their mean (``densities``).
    class_names
        The C classes, in the order of the frame's elements.
    """
    known = np.array([name in motion.class_names for name in class_names])
    place = [motion.class_names.index(name) for name in class_names if name in motion.class_names]
    n = len(extremes)
    total, informative = np.zeros((n, len(class_names))), np.zeros(n, dtype=bool)
    if known.any() and motion.reliability > 0.0:
        for corners, which in (
            (motion.speed_mps, [GREATEST_SPEED, LEAST_SPEED]),
            (motion.acceleration_mps2, [GREATEST_ACCELERATION]),
        ):
            if not len(corners):
                continue
            seen = extremes[:, which]
            usable = np.asarray(~np.isnan(seen).any(axis=(1, 2)))
            each = [_log_likelihood(seen[:, i], corners[place], motion) for i in range(len(which))]
            total += np.where(usable[:, None], _of_all(np.minimum.reduce(each), known, motion), 0.0)
            informative |= usable
    return _with_masses(total, informative, known, motion.reading)


def _log_likelihood(extreme: FloatArray, corners: FloatArray, motion: ClassMotion) -> FloatArray:
    """(n, K) of extremes (n, 2); any numbers where the extreme is not known."""
    value, std = np.where(np.isnan(extreme), 1.0, extreme).T
    if motion.reading == DENSITIES:
        return log_density(value, std, corners)
    return log_possibility(value, std, corners)


def _of_all(log_likelihood: FloatArray, known: BoolArray, motion: ClassMotion) -> FloatArray:
    """Log likelihoods of all classes (n, C) from those of the known ones, with the reliability."""
    r = motion.reliability
    if motion.reading == DENSITIES:
        return mixed_log_likelihood(log_likelihood, known, r)
    possible = np.empty((len(log_likelihood), len(known)))
    # Below that nothing can be told from nothing.
    possible[:, known] = np.maximum(r * np.exp(log_likelihood) + (1.0 - r), _TINY)
    possible[:, ~known] = possible[:, known].max(axis=1, keepdims=True)
    return np.log(possible)


def _with_masses(
    log_likelihood: FloatArray, informative: BoolArray, known: BoolArray, reading: str
) -> AttributeEvidence:
    """Evidence with masses that agree with the likelihoods (n, C), made of both in one step.

    Masses of speed and of acceleration, each on the unions of a class with those that are not
    known, would meet in these: what contradicts itself would be held for a false alarm.
    """
    ratio = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    if reading == DENSITIES and known.any():
        own = ratio[:, known]
        masses = discounted_masses(own / own.sum(axis=1, keepdims=True), 1.0)
        focal = class_focal(known)
    else:
        masses, focal = consonant_masses(np.maximum(ratio, _TINY)), union_focal(len(known))
    log_likelihood = log_likelihood.copy()
    forget_rows(~informative, masses, log_likelihood)
    return AttributeEvidence(focal, masses, log_likelihood, informative)


def fuse_motion(
    term: str,
    key: ScanKey,
    frame: tuple[str, ...],
    class_names: tuple[str, ...],
    focal: MaskArray,
    masses: FloatArray,
    class_probability: FloatArray,
    said: AttributeEvidence,
) -> PairBeliefs:
    """Fuse beliefs of n tracks with the evidence of their motion, by the rule of a term.

    Parameters
    ----------
    term
        An attribute term with a memory: any but ``none``.
    key
        Of the scan.
    frame, class_names
        Of the beliefs.
    focal, masses, class_probability
        (E,), (n, E), (n, C) beliefs of the tracks.
    said
        Evidence of their motion (n rows).
    """
    if not len(focal):
        focal = np.array([total_ignorance(len(frame))], dtype=np.uint32)
        masses = np.ones((len(class_probability), 1))
    # Few of the unions carry mass, and every column costs.
    used = (said.masses != 0.0).any(axis=0)
    used[-1] = True
    evidence = Evidence(
        key,
        frame,
        said.focal[used],
        np.ascontiguousarray(said.masses[:, used]),
        class_names,
        said.log_class_likelihood,
        class_probability,
        said.informative,
    )
    rows = np.arange(len(said.masses), dtype=np.int32)
    pairs = Pairs(focal, masses, class_probability, evidence, rows)
    return fuse_classes(pairs) if term == "bayes" else fuse_masses(term, pairs)
