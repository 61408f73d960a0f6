"""The layer of formations: outlines that hold their members, what the text says, lineage."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marker_run import marker_array
from marker_viewer import Viewer

from gda_tracker.formations.found import Formation, Formations
from gda_tracker.formations.labels import formation_text
from gda_tracker.io.markers.formation_shapes import (
    formation_outline,
    formation_shapes,
)
from gda_tracker.io.markers.layers import Layers
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.io.markers.shapes import LINE_LIST, LINE_STRIP, TEXT
from gda_tracker.vocabulary.scans import ScanKey

P = MarkerParameters()


def formation(number_id, places, probabilities=(0.03, 0.97), number=2, **lineage):
    places = np.asarray(places, dtype=float)
    out = places - places.mean(axis=0)
    return Formation(
        number_id,
        0,
        np.arange(len(places)),
        np.full(len(places), -1),
        places.mean(axis=0),
        np.eye(2),
        np.zeros(2),
        np.eye(2),
        out.T @ out / len(places),
        np.array(probabilities),
        number,
        0,
        1,
        0.0,
        **lineage,
    )


def found(*formations, k=0):
    return Formations(ScanKey(0, "radar", k * 10**9), "map", formations=list(formations))


@given(st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), min_size=1, max_size=8))
def test_the_outline_holds_every_member(places):
    one = formation(1, places)
    edge = formation_outline(one, dataclasses.replace(P, formation_margin_m=100.0))
    np.testing.assert_allclose(edge[0], edge[-1], atol=1e-6)
    # The polygon is the image of a circle; undo that, less what its straight sides cut off.
    half = edge[: len(edge) // 2] - one.position
    axes = np.array([half[0], half[len(edge) // 4]]).T
    inside = np.linalg.solve(axes, (np.array(places) - one.position).T)
    assert np.hypot(*inside).max(initial=0.0) <= 1.0


def test_the_text_says_number_probability_decision_and_lineage():
    assert formation_text(formation(4, [[0, 0], [9, 0]])) == "F4: 2 (97 %)\ndecided 2"
    one = formation(4, [[0, 0]], (0.6, 0.4), 0, parent_ids=(1, 3), child_ids=(7,))
    assert formation_text(one) == "F4: 1 (60 %)\nundecided\nfrom F1, F3\nsplit off F7"


def test_shapes_by_hand():
    parent, child = formation(1, [[0, 0], [8, 0]]), formation(2, [[100, 0]], parent_ids=(1, 9))
    shapes = formation_shapes(found(parent, child), P)
    assert [(s.namespace, s.number, s.kind) for s in shapes] == [
        ("outlines", 1, LINE_STRIP),
        ("numbers", 1, TEXT),
        ("outlines", 2, LINE_STRIP),
        ("numbers", 2, TEXT),
        ("lineage", 2, LINE_LIST),
    ]
    np.testing.assert_allclose(shapes[-1].points, [[4.0, 0.0], [100.0, 0.0]])
    # Alone: a circle as large as the margin.
    radius = np.hypot(*(shapes[2].points - [100.0, 0.0]).T)
    assert radius == pytest.approx(np.full(len(radius), P.formation_margin_m))


def test_what_is_not_finite_is_left_out():
    wrong = dataclasses.replace(formation(1, [[0, 0]]), position=np.array([np.nan, 0.0]))
    shapes = formation_shapes(found(wrong, formation(2, [[1, 1]], parent_ids=(1,))), P)
    assert {s.number for s in shapes} == {2}
    assert "lineage" not in {s.namespace for s in shapes}


def test_formations_that_end_are_deleted():
    layers, viewer = Layers(lambda name: name == "formations"), Viewer()
    for k, present in enumerate([(1, 2), (2,), ()]):
        scan = found(*[formation(n, [[n, 0.0]]) for n in present], k=k)
        for update in layers.take_formations(scan, P):
            viewer.take(marker_array(update, P))
        assert len(viewer.shown) == 2 * len(present)
    assert Layers(lambda name: False).take_formations(found(formation(1, [[0, 0]])), P) == []
