"""What a statement means: its joint covering function over places and classes.

A statement is a random set of places and classes. With pieces k of mass m_k, a region with
membership g_k(z) and a fuzzy set of classes h_k(c) its one-point covering function is

    mu(z, c) = sum over k of m_k g_k(z) h_k(c)                             (Mahler 2011, (32), (80))

and for an inference rule g => h: min(g(z), h(c)) + (1 - g(z)) / 2, for h => g the same with the two
exchanged ((33), with the antecedent in the second term). Discounted by the reliability r it becomes
r mu + 1 - r: with the chance 1 - r nothing was said. So that no statement rules out anything for
ever, r counts as 1 - ``LEAST_DOUBT`` at most.

Where one of g and h is crisp, min(g, h) = g h, and every statement is linear in its memberships:

    mu(z, c) = constant(c) + sum over k of coefficient(k, c) g_k(z).

Its expectation under a Gaussian place is that of the regions, which is closed
(:mod:`gda_tracker.attributes.generalised_measurements`). A rule of two fuzzy sets is refused at the
door.

About a track mu is the likelihood of place and class of that track. About a place it says what is
*there*: a detection with membership g in the region is heard with it, with 1 - g it is elsewhere,
of which nothing was said; the likelihood of class c is

    sum over k of m_k (g_k h_k(c) + 1 - g_k),    a rule: mu(z, c) over what mu is elsewhere.

A rule h => g speaks of other places too (what is elsewhere is none of these) and is taken as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.attributes.generalised_measurements import (
    Box,
    CoveringFunction,
    GaussianShaped,
    Polygon,
    Sector,
    annular_sector,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.statements import (
    BOX,
    CLASSES_IMPLY_REGION,
    EVERYWHERE,
    GAUSSIAN,
    PLACE,
    POLYGON,
    RULE,
    Statement,
    StatementPiece,
    StatementRegion,
)

LEAST_DOUBT = 1e-6
# Chords of a sector's arcs stay this share of its range inside the circle.
ARC_TOLERANCE = 1e-3
# Standard deviations beyond which a place is not: less than 1e-15 lies there.
_REACH = 8.0


@dataclass(frozen=True, eq=False)
class Meaning:
    """mu(z, c) = ``constant`` (C,) + sum over k of ``coefficients`` (K, C) times region k at z.

    ``regions`` are K covering functions of the plane, one each.
    """

    regions: tuple[CoveringFunction, ...]
    coefficients: FloatArray
    constant: FloatArray

    @property
    def speaks_of_class(self) -> bool:
        """Whether the classes differ in it."""
        return bool(np.ptp(self.constant) > 0.0 or (np.ptp(self.coefficients, axis=1) > 0.0).any())

    def expectation(
        self, position: FloatArray, covariance: FloatArray, smallest_membership: float = 0.0
    ) -> FloatArray:
        """Mean mu(., c) (R, C) of R Gaussian places (R, 2) [m], (R, 2, 2) [m2]; above 0.

        A mean membership in a region below ``smallest_membership`` counts as none.
        """
        if not self.regions:
            return np.repeat(self.constant[None], len(position), axis=0)
        mean = _memberships(self.regions, position, covariance)
        if smallest_membership:
            mean = np.where(mean >= smallest_membership, mean, 0.0)
        # Not as a product of matrices, whose last bit may differ between equal columns.
        value = self.constant + (mean[:, :, None] * self.coefficients).sum(axis=1)
        # The differences of a rule may round to below what doubt leaves.
        return np.maximum(value, 0.5 * LEAST_DOUBT)


def _memberships(
    regions: tuple[CoveringFunction, ...], position: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Mean memberships (R, K) of R Gaussian places in K regions.

    Regions with many edges take their time, so what lies beyond all doubt outside is not asked.
    """
    mean = np.zeros((len(position), len(regions)))
    reach = _REACH * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    for column, region in enumerate(regions):
        near: BoolArray = np.ones(len(position), dtype=bool)
        if isinstance(region, Polygon):
            low, high = region.vertices[0].min(axis=0), region.vertices[0].max(axis=0)
            near = ((position + reach >= low) & (position - reach <= high)).all(axis=1)
        if near.any():
            found = region.expectation(position[near, None], covariance[near, None])
            mean[near, column] = found[:, 0]
    return mean


def covering_function(region: StatementRegion) -> CoveringFunction:
    """The membership of a region of the plane, as one covering function.

    Raises
    ------
    ValueError
        If its numbers make no region of its shape, or it is everywhere.
    """
    if region.shape == GAUSSIAN:
        shape = np.reshape(region.covariance_m2, (1, 2, 2))
        return GaussianShaped(np.array([region.centre_m]), shape)
    if region.shape == BOX:
        return Box(np.array([region.low_m]), np.array([region.high_m]))
    if region.shape == POLYGON:
        return Polygon(np.reshape(region.vertices_m, (1, -1, 2)))
    if region.shape == EVERYWHERE:
        raise ValueError("shape = everywhere: allowed is a region with an edge")
    if region.nearest_m == region.farthest_m == 0.0:
        return Sector(
            np.array([region.centre_m]),
            np.array([region.first_bearing_rad]),
            np.array([region.opening_rad]),
        )
    return annular_sector(
        region.centre_m,
        region.first_bearing_rad,
        region.opening_rad,
        region.nearest_m,
        region.farthest_m,
        max(ARC_TOLERANCE * region.farthest_m, 1e-9),
    )


def classes_known(statement: Statement, class_names: tuple[str, ...]) -> bool:
    """Whether every class that a statement names is one of ``class_names``."""
    return all(name in class_names for piece in statement.pieces for name in piece.class_names)


@lru_cache(maxsize=512)
def track_meaning(statement: Statement, class_names: tuple[str, ...]) -> Meaning:
    """Covering function mu of a statement about a track.

    Parameters
    ----------
    statement
        As the door admits it.
    class_names
        The C classes; none: a part on classes has no effect, mu has one column. Nor has it where
        the statement names a class that is not among them.
    """
    heard = bool(class_names) and classes_known(statement, class_names)
    count = max(len(class_names), 1)
    grades = [_grades(piece, class_names, heard, count) for piece in statement.pieces]
    return _discounted(statement, *_linear(statement, grades, heard))


@lru_cache(maxsize=512)
def place_meaning(statement: Statement, class_names: tuple[str, ...]) -> Meaning:
    """Likelihood of the classes of a detection, by a statement about a place.

    Elsewhere it is 1 for all classes, but by a rule of the kind ``classes_imply_region``.
    Parameters as of :func:`track_meaning`.
    """
    assert statement.about == PLACE
    heard = classes_known(statement, class_names)
    grades = [_grades(piece, class_names, heard, len(class_names)) for piece in statement.pieces]
    regions, coefficients, constant = _linear(statement, grades, heard)
    if statement.kind != RULE:
        # What a piece says of its region alone, that something is there, is left out.
        masses = np.array([piece.mass for piece in statement.pieces])[:, None]
        somewhere = np.array([piece.region.shape != EVERYWHERE for piece in statement.pieces])
        coefficients = coefficients - masses[somewhere]
        constant = constant + masses[somewhere].sum()
    meaning = _discounted(statement, regions, coefficients, constant)
    if statement.kind == RULE and statement.rule != CLASSES_IMPLY_REGION:
        elsewhere = meaning.constant[0]
        return Meaning(
            meaning.regions, meaning.coefficients / elsewhere, meaning.constant / elsewhere
        )
    return meaning


def _grades(
    piece: StatementPiece, class_names: tuple[str, ...], heard: bool, count: int
) -> FloatArray:
    """Memberships (C,) of the classes; 1 for all where the piece says nothing of them."""
    if not heard or not piece.class_names:
        return np.ones(count)
    grade = np.zeros(count)
    grade[[class_names.index(name) for name in piece.class_names]] = piece.class_grades
    return grade


Linear = tuple[tuple[StatementRegion, ...], FloatArray, FloatArray]


def _linear(statement: Statement, grades: list[FloatArray], heard: bool) -> Linear:
    """Regions with an edge, coefficients (K, C) and constant (C,) of mu without discount."""
    count = len(grades[0])
    if statement.kind == RULE:
        region, h = statement.pieces[0].region, grades[0]
        if not heard:
            return (), np.zeros((0, count)), np.ones(count)
        if statement.rule == CLASSES_IMPLY_REGION:
            return (region,), h[None], 0.5 * (1.0 - h)
        return (region,), (h - 0.5)[None], np.full(count, 0.5)
    regions, rows, constant = [], [], np.zeros(count)
    for piece, grade in zip(statement.pieces, grades, strict=True):
        if piece.region.shape == EVERYWHERE:
            constant = constant + piece.mass * grade
        else:
            regions.append(piece.region)
            rows.append(piece.mass * grade)
    return tuple(regions), np.reshape(rows, (len(rows), count)), constant


def _discounted(
    statement: Statement,
    regions: tuple[StatementRegion, ...],
    coefficients: FloatArray,
    constant: FloatArray,
) -> Meaning:
    r = min(statement.reliability, 1.0 - LEAST_DOUBT)
    functions = tuple(_function(region) for region in regions)
    return Meaning(
        functions,
        r * coefficients,
        r * constant + (1.0 - r),
    )


@lru_cache(maxsize=512)
def _function(region: StatementRegion) -> CoveringFunction:
    return covering_function(region)
