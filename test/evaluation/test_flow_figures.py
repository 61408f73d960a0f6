"""What is on the pictures of one scan's evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.evaluation import figures
from gda_tracker.kinematics.gating import gate, gate_threshold
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring

NAMES = (("T1", "T2"), ("O1", "O2"))


@pytest.fixture(scope="module")
def crossing():
    """Scans of a run up to one on which both tracks have gated the same two detections."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, 1, "gda/dsm_classic/cv")
    ring = Ring(with_method(tracker_preset(scenario), "gda/dsm_classic/cv"))
    ring.initialise(play.initial)
    results = []
    for detections in play.detections:
        results.append(ring.process(detections))
        found = results[-1].scores
        if found.hypothesis.tolist() == [0, 0, 1, 1] and len(set(found.detection)) == 2:
            return ring, play, results
    raise AssertionError("the targets never meet")


def test_the_outline_of_a_gate_is_at_its_threshold(crossing):
    _, _, results = crossing
    scan, predictions = results[-1].scan, results[-1].predictions
    threshold = gate_threshold(predictions.settings.gate_probability)
    wider = replace(predictions, settings=replace(predictions.settings, gate_probability=0.999999))
    for row, outline in enumerate(figures.gate_outlines(scan, predictions)):
        n = len(outline)
        relative = outline - scan.sensor_position_m[:2]
        on_it = replace(
            scan,
            range_m=np.hypot(*relative.T),
            azimuth_rad=np.arctan2(relative[:, 1], relative[:, 0]),
            noise_covariance=np.tile(scan.noise_covariance[0], (n, 1, 1)),
        )
        pairs = gate(on_it, wider)
        squared = pairs.mahalanobis_squared[pairs.hypothesis == row]
        np.testing.assert_allclose(squared, np.full(n, threshold), rtol=1e-9)


def test_gates_of_mixtures_and_of_empty_scans_are_refused(crossing):
    _, _, results = crossing
    scan, predictions = results[-1].scan, results[-1].predictions
    mixture = replace(predictions, component_mean=np.tile(predictions.component_mean, (2, 1)))
    empty = replace(scan, range_m=np.zeros(0))
    for refused in ((scan, mixture), (empty, predictions)):
        with pytest.raises(ValueError, match="allowed are one component each"):
            figures.gate_outlines(*refused)


def test_detections_stand_on_the_fuzzy_sets_at_their_grades(crossing):
    ring, _, results = crossing
    scan, evidence = results[-1].scan, results[-1].evidence
    rows = np.unique(results[-1].scores.detection)
    figure = figures.fuzzy_reading(ring.fuzzifier, scan, evidence, rows, NAMES[1])
    sets, bars = figure.axes
    points = [line.get_xydata() for line in sets.lines if line.get_marker() == "o"]
    grades = ring.fuzzifier.membership(scan.rcs_m2[rows])
    np.testing.assert_allclose(np.array(points)[..., 1].T, grades)
    np.testing.assert_allclose(np.array(points)[0, :, 0], scan.rcs_m2[rows])
    heights = [patch.get_height() for patch in bars.patches]
    np.testing.assert_allclose(np.sum(heights), len(rows))
    np.testing.assert_allclose(np.reshape(heights, (-1, 2)).T, evidence.masses[rows][:, :3])


def test_bars_of_candidates_have_the_length_of_the_distance(crossing):
    _, _, results = crossing
    predictions, scores = results[-1].predictions, results[-1].scores
    pairs = np.arange(4).reshape(2, 2)
    chosen = results[-1].associations.chosen
    figure = figures.candidate_histories(predictions, scores, pairs, NAMES, chosen)
    panels = np.array(figure.axes).reshape(2, 3)
    for row, column in np.ndindex(2, 2):
        heights = [patch.get_height() for patch in panels[row, 1 + column].patches]
        pair = pairs[row, column]
        assert np.linalg.norm(heights) == pytest.approx(scores.distance[pair], rel=1e-9)
        framed = panels[row, 1 + column].spines["top"].get_linewidth() > 2.0
        assert framed == chosen[pair]
    heights = [patch.get_height() for patch in panels[1, 0].patches]
    assert np.sum(heights) == pytest.approx(1.0)
    assert panels[0, 1].get_title(loc="left") == "T1 with O1"


def test_tables_of_pairs_show_each_number_and_frame_the_chosen():
    values = np.array([[0.25, 0.5], [0.125, 1.0]])
    mark = np.array([[False, True], [True, False]])
    same = np.full((2, 2), 0.5)
    figure = figures.pair_tables({"P": values, "Q": same}, NAMES, [mark, ~mark])
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.texts] == ["0.25", "0.5", "0.125", "1"]
    corners = [patch.get_xy() for patch in axes.patches]
    np.testing.assert_allclose(corners, [(0.54, -0.46), (-0.46, 0.54)])
    assert figure.axes[1].get_title(loc="left") == "Q"


def test_maps_with_gates_name_the_detections(crossing):
    _, play, results = crossing
    last = results[-1]
    rows = np.unique(last.scores.detection)
    n = len(results)
    figure = figures.gated_maps(
        {"one": [r.tracks for r in results], "two": [r.tracks for r in results]},
        play.detections[:n],
        play.truth[:n],
        n - 1,
        (last.scan, last.predictions),
        rows,
        NAMES[1],
    )
    outlines = figures.gate_outlines(last.scan, last.predictions)
    for axes in figure.axes:
        dashed = [line.get_xydata() for line in axes.lines if line.get_linestyle() == "--"]
        np.testing.assert_allclose(np.array(dashed) * 1000.0, outlines)
        squares = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "s"]
        np.testing.assert_allclose(
            np.hypot(*np.transpose(squares)) * 1000.0, last.scan.range_m[rows]
        )
        assert {"O1", "O2"} <= {text.get_text() for text in axes.texts}
