"""Statements about a place, as evidence on the classes of the detections there.

The likelihood of the classes (:func:`~gda_tracker.attributes.statement_meaning.place_meaning`) is a
possibility distribution over them, once divided by its largest value. The belief masses are the
consonant ones that have it as their plausibility of single classes: with the classes in falling
order of the likelihood f1 >= f2 >= ..., the mass f_i - f_(i+1) lies on the union of the first i.
They commit themselves to no more than was said ("no cargo" is a mass on the union of all others),
and a discount of the masses is one of the likelihood. They are combined with the detection's own
evidence by the attribute rule, as one more attribute.

The speaker means objects, not what a radar returns: a false alarm that is not named fits as well as
the class that fits best, so that no statement raises or lowers the chance of clutter by itself.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.attributes.attribute_evidence import AttributeCombination, AttributeEvidence
from gda_tracker.attributes.statement_meaning import place_meaning
from gda_tracker.evidence.frames import singletons
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.vocabulary.arrays import FloatArray, MaskArray
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.statements import PLACE, Statement

# A mean membership below says nothing: the detection is elsewhere.
SMALLEST_MEMBERSHIP = 1e-6


def consonant_masses(likelihood: FloatArray) -> FloatArray:
    """Consonant masses (n, 2^C - 1) of likelihoods (n, C) above 0, over :func:`union_focal`.

    Examples
    --------
    "A fighter (0.9), perhaps a cargo aircraft (0.2)", of three classes, column s being the union of
    the classes that are bits of s + 1:

    >>> consonant_masses(np.array([[0.09, 0.9, 0.18]])).round(2).tolist()
    [[0.0, 0.8, 0.0, 0.0, 0.0, 0.1, 0.1]]
    """
    n, count = likelihood.shape
    order = np.argsort(-likelihood, axis=1, kind="stable")
    falling = np.take_along_axis(likelihood, order, axis=1)
    falling = falling / falling[:, :1]
    steps = falling - np.append(falling[:, 1:], np.zeros((n, 1)), axis=1)
    masses = np.zeros((n, (1 << count) - 1))
    unions = np.cumsum(1 << order, axis=1) - 1
    np.put_along_axis(masses, unions, steps, axis=1)
    return masses


@lru_cache(maxsize=8)
def union_focal(count: int) -> MaskArray:
    """Focal columns (2^C - 1,): column s is the union of the classes that are bits of s + 1."""
    masks = singletons(count)
    columns = np.zeros((1 << count) - 1, dtype=np.uint32)
    for column in range(len(columns)):
        for element in range(count):
            if column + 1 >> element & 1:
                columns[column] |= np.uint32(masks[element])
    columns.flags.writeable = False
    return columns


def place_likelihood(
    statement: Statement,
    class_names: tuple[str, ...],
    position: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """Likelihood (n, C) of the classes of n detections, by a statement about a place.

    Parameters
    ----------
    statement
        About a place.
    class_names
        The C classes, the false alarm first.
    position, covariance
        (n, 2) [m], (n, 2, 2) [m2] where the detections are, with their noise.
    """
    meaning = place_meaning(statement, class_names)
    likelihood = meaning.expectation(position, covariance, SMALLEST_MEMBERSHIP)
    if not any(class_names[0] in piece.class_names for piece in statement.pieces):
        likelihood[:, 0] = likelihood[:, 1:].max(axis=1)
    return likelihood


def with_place_statements(
    own: AttributeEvidence,
    scan: Scan,
    frame: tuple[str, ...],
    class_names: tuple[str, ...],
    rule: str,
) -> AttributeEvidence:
    """Combine the evidence of n detections with what was said about the places where they are.

    Detections of which nothing was said keep their evidence bit for bit, maybe among more columns.

    Parameters
    ----------
    own
        Evidence of the detections' attributes.
    scan
        The scan with its statements.
    frame, class_names
        Names of the frame's elements and of the classes that go with them.
    rule
        Attribute rule, one of ``ATTRIBUTE_RULES``.
    """
    statements = [each for each in scan.statements if each.about == PLACE]
    if not statements or not len(scan) or scan.sensor_model:
        # A sensor with a model of its own need not know where a detection is.
        return own
    position, covariance = cartesian_positions(polar_measurements(scan))
    heard = []
    for statement in statements:
        likelihood = place_likelihood(statement, class_names, position, covariance)
        if (np.ptp(likelihood, axis=1) > 0.0).any():
            heard.append(likelihood)
    if not heard:
        return own
    rows = np.flatnonzero(np.any([np.ptp(each, axis=1) > 0.0 for each in heard], axis=0))
    combine = _combination(frame, own.focal.tobytes(), len(heard), rule)
    some = AttributeEvidence(
        own.focal, own.masses[rows], own.log_class_likelihood[rows], own.informative[rows]
    )
    fused = combine([some, *(_evidence(likelihood[rows]) for likelihood in heard)])
    place = {int(mask): column for column, mask in enumerate(fused.focal)}
    masses = np.zeros((len(scan), len(fused.focal)))
    # Every column of the own evidence is one of the fused: it meets total ignorance.
    masses[:, [place[int(mask)] for mask in own.focal]] = own.masses
    masses[rows] = fused.masses
    log_likelihood, informative = own.log_class_likelihood.copy(), own.informative.copy()
    log_likelihood[rows], informative[rows] = fused.log_class_likelihood, fused.informative
    return AttributeEvidence(fused.focal, masses, log_likelihood, informative)


def _evidence(likelihood: FloatArray) -> AttributeEvidence:
    return AttributeEvidence(
        union_focal(likelihood.shape[1]),
        consonant_masses(likelihood),
        np.log(likelihood),
        np.ptp(likelihood, axis=1) > 0.0,
    )


@lru_cache(maxsize=32)
def _combination(
    frame: tuple[str, ...], own_focal: bytes, count: int, rule: str
) -> AttributeCombination:
    focal = np.frombuffer(own_focal, dtype=np.uint32)
    return AttributeCombination(frame, [focal, *[union_focal(len(frame))] * count], rule)
