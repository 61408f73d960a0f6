"""Shapes of formations: an outline around the members, what is known of their number, lineage."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.formations.found import Formation, Formations
from gda_tracker.formations.labels import formation_text, is_finite
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.io.markers.shapes import LINE_LIST, LINE_STRIP, TEXT, Shape, number_of
from gda_tracker.vocabulary.arrays import FloatArray

OUTLINE_POINTS = 48


def formation_shapes(found: Formations, p: MarkerParameters) -> list[Shape]:
    """Return outline and text of each formation, and a line to each parent that is still there.

    Those with a place or an extent that is not finite are left out.
    """
    sound = [one for one in found.formations if is_finite(one)]
    place = {one.formation_id: one.position for one in sound}
    colour, width = p.colour("formation_colour"), p.scale * p.line_width_m
    height = p.scale * p.label_size_m
    shapes = []
    for one in sound:
        number, edge = number_of(one.formation_id), formation_outline(one, p)
        shapes.append(Shape("outlines", number, LINE_STRIP, colour, (width, 0.0, 0.0), points=edge))
        # Beside the labels of the tracks, above the northern end.
        top = edge[np.argmax(edge[:, 1])]
        at = (float(top[0]), float(top[1]) + height, p.height_m + height)
        text = formation_text(one)
        shapes.append(Shape("numbers", number, TEXT, colour, (0.0, 0.0, height), at, text=text))
        lines = [
            end
            for parent in one.parent_ids
            if parent in place
            for end in (place[parent], one.position)
        ]
        if lines:
            shapes.append(
                Shape(
                    "lineage",
                    number,
                    LINE_LIST,
                    colour,
                    (0.5 * width, 0.0, 0.0),
                    points=np.array(lines),
                )
            )
    return shapes


def formation_outline(one: Formation, p: MarkerParameters) -> FloatArray:
    """Edge (n, 2) [m] of an ellipse that holds all members, with a margin; closed.

    Of T points none is farther from their centroid than T - 1 in squared Mahalanobis distance by
    their own spread.
    """
    value, vector = np.linalg.eigh(one.extent)
    reach = math.sqrt(max(len(one.track_ids) - 1, 0))
    axes = reach * np.sqrt(np.maximum(value, 0.0)) + p.scale * p.formation_margin_m
    angle = np.linspace(0.0, 2.0 * np.pi, OUTLINE_POINTS + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    edge: FloatArray = one.position + (vector @ (axes[:, None] * circle)).T
    return edge
