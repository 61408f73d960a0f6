"""Statements of every kind, and their covering function written out."""

from __future__ import annotations

import numpy as np

from gda_tracker.attributes.statement_meaning import covering_function
from gda_tracker.vocabulary import Statement, StatementPiece, StatementRegion

CLASSES = ("false_alarm", "fighter", "cargo")
GAUSSIAN = StatementRegion(
    "gaussian", centre_m=(100.0, 50.0), covariance_m2=(400.0, 50.0, 50.0, 900.0)
)
BOX = StatementRegion("box", low_m=(0.0, 0.0), high_m=(80.0, 500.0))
POLYGON = StatementRegion("polygon", vertices_m=(0.0, 0.0, 100.0, 0.0, 100.0, 100.0))
SECTOR = StatementRegion("sector", (0.0, -100.0), first_bearing_rad=1.0, opening_rad=0.5)
RING = StatementRegion(
    "sector",
    (0.0, -100.0),
    first_bearing_rad=1.0,
    opening_rad=0.5,
    nearest_m=50.0,
    farthest_m=200.0,
)


def piece(region=None, mass=1.0, **grades):
    return StatementPiece(
        region or StatementRegion(), tuple(grades), tuple(map(float, grades.values())), mass
    )


def said(kind, about, *pieces, track_id=1, **fields):
    values = {"source": "pilot", "sequence": 1, "stamp_ns": 0, "frame_id": "map", **fields}
    if about == "track":
        values["track_id"] = track_id
    return Statement(kind=kind, about=about, pieces=pieces, **values)


def rule(about, region, direction="region_implies_classes", **grades):
    return said("rule", about, piece(region, **grades), rule=direction)


ABOUT_TRACK = {
    "gaussian": said("fuzzy", "track", piece(GAUSSIAN)),
    "box": said("region", "track", piece(BOX)),
    "polygon": said("region", "track", piece(POLYGON), reliability=0.8),
    "sector": said("region", "track", piece(SECTOR), reliability=0.5),
    "ring": said("region", "track", piece(RING)),
    "class": said("fuzzy", "track", piece(fighter=0.9, cargo=0.2)),
    "place and class": said("fuzzy", "track", piece(GAUSSIAN, fighter=0.9, cargo=0.2)),
    "fds": said(
        "fds",
        "track",
        piece(GAUSSIAN, 0.5, fighter=0.9),
        piece(BOX, 0.3, cargo=0.5, fighter=0.1),
        piece(mass=0.2, cargo=1.0, fighter=0.5),
        reliability=0.9,
    ),
    "rule": rule("track", BOX, fighter=0.7, cargo=0.1),
    "fuzzy region": rule("track", GAUSSIAN, fighter=1.0),
    "reverse rule": rule("track", SECTOR, "classes_imply_region", fighter=0.8),
}


def mu(statement, points, name):
    """Covering function at points (N, 2) and a class, by the definitions of Mahler (2011)."""
    total = np.zeros(len(points))
    for each in statement.pieces:
        g = np.ones(len(points))
        if each.region.shape != "everywhere":
            g = covering_function(each.region)(points)[:, 0]
        h = np.ones(len(points))
        if each.class_names:
            h *= dict(zip(each.class_names, each.class_grades, strict=True)).get(name, 0.0)
        if statement.kind == "rule":
            first, second = (g, h) if statement.rule == "region_implies_classes" else (h, g)
            total += np.minimum(first, second) + 0.5 * (1.0 - first)
        else:
            total += each.mass * g * h
    r = min(statement.reliability, 1.0 - 1e-6)
    return r * total + (1.0 - r)
