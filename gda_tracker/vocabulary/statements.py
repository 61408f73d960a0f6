"""Statements: what people and other sensors say about a place or a track.

They are few and made by hand, so they are objects with names, not arrays; they can be compared and
hashed. What they mean is in :mod:`gda_tracker.attributes.statement_meaning`.
"""

from __future__ import annotations

from dataclasses import dataclass

EVERYWHERE, GAUSSIAN, BOX, POLYGON, SECTOR = "everywhere", "gaussian", "box", "polygon", "sector"
SHAPES = (EVERYWHERE, GAUSSIAN, BOX, POLYGON, SECTOR)
REGION, FUZZY, FDS, RULE = "region", "fuzzy", "fds", "rule"
KINDS = (REGION, FUZZY, FDS, RULE)
PLACE, TRACK = "place", "track"
SUBJECTS = (PLACE, TRACK)
REGION_IMPLIES_CLASSES, CLASSES_IMPLY_REGION = "region_implies_classes", "classes_imply_region"
RULES = (REGION_IMPLIES_CLASSES, CLASSES_IMPLY_REGION)


@dataclass(slots=True, frozen=True)
class StatementRegion:
    """A part of the plane; message ``StatementRegion``.

    ``shape`` is one of ``SHAPES``; only the fields of that shape count. ``gaussian``: membership
    exp(-d' C^-1 d / 2) around ``centre_m`` (x, y) with C = ``covariance_m2`` (xx, xy, yx, yy);
    ``box``: from ``low_m`` (x, y) to ``high_m``; ``polygon``: ``vertices_m`` (x, y, x, y, ...);
    ``sector``: seen from ``centre_m``, from ``first_bearing_rad`` counter-clockwise by
    ``opening_rad``, between ``nearest_m`` and ``farthest_m``, 0 for no limit.
    """

    shape: str = EVERYWHERE
    centre_m: tuple[float, ...] = ()
    covariance_m2: tuple[float, ...] = ()
    low_m: tuple[float, ...] = ()
    high_m: tuple[float, ...] = ()
    vertices_m: tuple[float, ...] = ()
    first_bearing_rad: float = 0.0
    opening_rad: float = 0.0
    nearest_m: float = 0.0
    farthest_m: float = 0.0


@dataclass(slots=True, frozen=True)
class StatementPiece:
    """A region together with a fuzzy set of classes; message ``StatementPiece``.

    ``class_grades`` (K) are the memberships of the classes named in ``class_names`` (K), others
    have 0; without names the piece says nothing about the class. ``mass`` is that of a piece of an
    ``fds`` statement.
    """

    region: StatementRegion = StatementRegion()
    class_names: tuple[str, ...] = ()
    class_grades: tuple[float, ...] = ()
    mass: float = 1.0


@dataclass(slots=True, frozen=True)
class Statement:
    """What ``source`` says about a place or a track; message ``Statement``.

    ``kind`` is one of ``KINDS``, ``about`` one of ``SUBJECTS``, ``rule`` one of ``RULES`` for the
    kind ``rule``. With the chance 1 - ``reliability`` it says nothing. The pair of ``source`` and
    ``sequence`` is its identity.
    """

    source: str
    sequence: int
    stamp_ns: int
    kind: str
    about: str
    pieces: tuple[StatementPiece, ...]
    track_id: int = 0
    reliability: float = 1.0
    rule: str = ""
    frame_id: str = ""


@dataclass(slots=True, frozen=True)
class StatementReport:
    """The answer to one ``Statement``; message ``StatementReport``.

    ``outcome`` is ``admitted`` or ``rejected``, then with a ``reason``; ``waiting`` statements wait
    for a scan.
    """

    source: str
    sequence: int
    stamp_ns: int
    outcome: str
    reason: str = ""
    waiting: int = 0
