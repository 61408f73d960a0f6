"""What is on the pictures: the data of their lines, names with units, and bytes that repeat."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from report_examples import CLASSES, make_tracks, swapping_run

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.evaluation import figures
from gda_tracker.evaluation.figures import canvas
from gda_tracker.evaluation.figures.series import (
    detection_positions,
    detection_sources,
    track_histories,
)
from gda_tracker.vocabulary.scans import Detections


def lines(axes, label):
    """Data of all lines with this label."""
    return [line.get_xydata() for line in axes.lines if line.get_label() == label]


def markers(axes, marker):
    """Points of all lines with this marker, the legend's empty ones left out."""
    found = [line.get_xydata() for line in axes.lines if line.get_marker() == marker]
    return np.concatenate([np.zeros((0, 2)), *found])


def legend_texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


# --- rows for pictures ----------------------------------------------------------------------------


def test_detections_of_a_turned_and_moved_sensor():
    half = math.sqrt(0.5)
    detections = Detections(
        "radar",
        0,
        np.array([10.0, 2.0]),
        np.array([0.0, math.pi / 2]),
        sensor_position_m=np.array([100.0, 200.0, 5.0]),
        sensor_orientation_xyzw=np.array([0.0, 0.0, half, half]),  # 90 degrees to the left
    )
    expected = [[100.0, 210.0], [98.0, 200.0]]
    np.testing.assert_allclose(detection_positions(detections), expected, atol=1e-9)


def test_elevation_shortens_the_ground_range():
    detections = Detections(
        "radar", 0, np.array([10.0]), np.array([0.0]), elevation_rad=np.array([math.pi / 3])
    )
    np.testing.assert_allclose(detection_positions(detections), [[5.0, 0.0]], atol=1e-12)


def test_no_detections_no_positions():
    assert detection_positions(Detections("radar", 0, np.zeros(0), np.zeros(0))).shape == (0, 2)


def test_history_of_a_track_that_comes_and_goes():
    tracks = [
        make_tracks(0, [[1, 2]], [0], ids=(7,)),
        make_tracks(1, [[3, 4], [5, 6]], [0, -1], ids=(7, 9)),
        make_tracks(2, [[7, 8]], [1], ids=(9,)),
    ]
    first, second = track_histories(tracks)
    assert (first.track_id, first.scan.tolist()) == (7, [0, 1])
    assert (second.track_id, second.scan.tolist()) == (9, [1, 2])
    assert second.position_m.tolist() == [[5, 6], [7, 8]]
    assert second.detection.tolist() == [-1, 1]


def test_sources_of_a_tracks_detections():
    _, truth, tracks = swapping_run()
    first, second = track_histories(tracks)
    assert detection_sources(first, truth).tolist() == [1, 1, 2, 2]
    assert detection_sources(second, truth).tolist() == [2, 2, -1, 1]


def test_sources_need_a_truth_that_names_them():
    _, truth, tracks = swapping_run()
    truth[1].source_id = None
    with pytest.raises(ValueError, match="scan 1 does not name the sources"):
        detection_sources(track_histories(tracks)[0], truth)


# --- maps -----------------------------------------------------------------------------------------


def test_association_map_marks_every_detection_by_whose_it_was():
    detections, truth, tracks = swapping_run()
    figure = figures.association_maps({"one": tracks, "two": tracks[:2]}, detections, truth)
    swapped, kept = figure.axes
    assert len(markers(swapped, "o")) == 4
    assert markers(swapped, "X").tolist() == [[1200.0, 100.0], [1300.0, 100.0], [1300.0, 0.0]]
    assert markers(swapped, "v").tolist() == [[1200.0, 0.0]]
    assert (len(markers(kept, "o")), len(markers(kept, "X")), len(markers(kept, "v"))) == (4, 0, 0)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["one", "two"]


def test_association_map_colours_a_track_like_the_target_it_was_started_on():
    detections, truth, tracks = swapping_run()
    axes = figures.association_maps({"": tracks}, detections, truth).axes[0]
    by_label = {line.get_label(): line for line in axes.lines}
    for name in ("fighter", "cargo"):
        path, track = by_label[f"{name}: true path"], by_label[f"track started on the {name}"]
        assert path.get_color() == track.get_color()
    colours = {by_label[f"{name}: true path"].get_color() for name in ("fighter", "cargo")}
    assert len(colours) == 2


def test_track_map_gives_matched_tracks_the_targets_colour_and_others_grey():
    detections, truth, tracks = swapping_run()
    far = [
        make_tracks(k, [*t.mean[:, :2], [1500.0, 900.0]], [0, 1, -1], ids=(1, 2, 5))
        for k, t in enumerate(tracks)
    ]
    axes = figures.track_map(detections, far[:2], truth[:2], title="t").axes[0]
    assert len(lines(axes, "target 1: track")) == 1
    assert len(lines(axes, "target 2: track")) == 1
    (other,) = [line for line in axes.lines if line.get_label() == "other confirmed track"]
    assert other.get_color() == canvas.GREY
    (points,) = lines(axes, "detection")
    assert len(points) == 9  # two a scan and a false alarm
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")


def test_track_map_without_truth_shows_everything():
    detections, _, tracks = swapping_run()
    axes = figures.track_map(detections, tracks).axes[0]
    (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    points = np.concatenate([detection_positions(d) for d in detections])
    assert low < points[:, 0].min() < points[:, 0].max() < high
    assert bottom < points[:, 1].min() < points[:, 1].max() < top
    assert len(lines(axes, "other confirmed track")) == 1  # one entry in the legend for all


def test_large_maps_are_in_kilometres():
    detections, truth, tracks = swapping_run()
    for scan in detections:
        scan.range_m = scan.range_m * 100.0
    axes = figures.track_map(detections, [], axis_names=("East", "North")).axes[0]
    assert axes.get_xlabel() == "East [km]"
    assert max(axes.get_xlim()) < 200.0


# --- attributes -----------------------------------------------------------------------------------


def test_memberships_are_those_of_the_fuzzifier():
    fuzzifier = RcsFuzzifier(RcsFuzzifierParameters())
    left, right = figures.membership_functions(fuzzifier).axes
    (curve,) = lines(left, "S: fighter, mean 1.2 m²")
    np.testing.assert_array_equal(curve[:, 1], fuzzifier.membership(curve[:, 0])[:, 1])
    masses = np.array([line.get_ydata() for line in right.lines])
    np.testing.assert_allclose(masses.sum(axis=0), 1.0, atol=1e-12)
    assert right.get_xlabel() == "radar cross section [m²]"


def test_exact_densities_as_memberships_have_no_bins():
    fuzzifier = RcsFuzzifier(RcsFuzzifierParameters(membership="density"))
    left, _ = figures.membership_functions(fuzzifier).axes
    assert len(left.lines) == 3


def test_class_beliefs_show_one_run_strongly_and_name_the_classes():
    runs = [
        [make_tracks(k, np.zeros((2, 2)), [0, 1], r, classes=_beliefs(k, r)) for k in range(3)]
        for r in range(2)
    ]
    figure = figures.class_beliefs(runs, ["fighter", "cargo"], shown=1, first_scan=3)
    first, second = figure.axes
    (strong,) = lines(first, "fighter")
    np.testing.assert_allclose(strong, [[3, 0.2], [4, 0.3], [5, 0.4]])
    (strong,) = lines(second, "cargo")
    np.testing.assert_allclose(strong[:, 1], [0.8, 0.8, 0.8])
    assert legend_texts(figure)[:3] == [name.replace("_", " ") for name in CLASSES]
    pale = [line for line in first.lines if line.get_alpha() == pytest.approx(0.16)]
    assert len(pale) == 3


def _beliefs(scan, run):
    share = 0.1 * (scan + run + 1)
    return [[0.0, share, 1.0 - share], [0.1, 0.1, 0.8]]


def test_entropies_of_both_frames_by_hand():
    # All mass on S&B: two of seven parts on the free model, on Shafer's it becomes S|B.
    # Half on S, half on B: S has 4 parts, B has 4, 2 of them common; on Shafer's one part each.
    whole, halves = [0.0, 0.0, 1.0], [0.5, 0.5, 0.0]
    run = [make_tracks(0, np.zeros((2, 2)), [0, 1], masses=[whole, halves])]
    above, below = figures.pignistic_entropies([run], ["a", "b"]).axes
    free, shafer = (
        [
            line.get_ydata()[0]
            for line in axes.lines
            if line.get_linewidth() == 2.2 and len(line.get_ydata())
        ]
        for axes in (above, below)
    )
    shared = 2 * 0.25 * math.log2(4) + 4 * 0.125 * math.log2(8)
    np.testing.assert_allclose(free, [1.0, shared], atol=1e-12)
    np.testing.assert_allclose(shafer, [1.0, 1.0], atol=1e-12)
    most = [
        line.get_ydata()[0]
        for axes in (above, below)
        for line in axes.lines
        if line.get_linestyle() == ":" and len(line.get_ydata())
    ]
    np.testing.assert_allclose(most, [math.log2(7), math.log2(3)])
    assert above.get_ylabel() == "entropy [bit]"


def test_entropies_need_masses():
    tracks = make_tracks(0, np.zeros((1, 2)), [0], ids=(1,), masses=np.zeros((1, 0)))
    with pytest.raises(ValueError, match="carry no masses"):
        figures.pignistic_entropies([[tracks]], ["a"])


# --- scores ---------------------------------------------------------------------------------------


def test_paired_purity_keeps_the_pairs_and_sorts_by_the_first():
    figure = figures.paired_purity(("off", [0.9, 0.4, 0.4]), ("on", [0.8, 1.0, 0.5]))
    axes = figure.axes[0]
    (before,), (after,) = lines(axes, "off"), lines(axes, "on")
    assert before[:, 1].tolist() == [0.4, 0.4, 0.9]
    assert after[:, 1].tolist() == [0.5, 1.0, 0.8]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["2", "1", "0"]


@pytest.mark.parametrize(("off", "on"), [([0.5], [0.5, 0.6]), ([], [])])
def test_paired_purity_refuses_runs_without_partners(off, on):
    with pytest.raises(ValueError, match="must be equal and not zero"):
        figures.paired_purity(("off", off), ("on", on))


def test_one_run_has_no_error_bar_but_a_picture():
    assert figures.png(figures.paired_purity(("off", [0.5]), ("on", [0.7]))).startswith(b"\x89PNG")


def test_latency_histogram_counts_every_scan_and_states_the_quantiles():
    values = np.linspace(1.0, 100.0, 100)
    figure = figures.latency_histograms({"a": values, "b": 2.0 * values})
    axes = figure.axes[0]
    assert sum(patch.get_height() for patch in axes.patches) == 100
    assert "median 50.5 ms" in axes.get_title(loc="right")
    assert "99.0 ms" in axes.get_title(loc="right")
    assert figure.axes[1].get_xlabel().endswith("[ms]")


# --- rendering ------------------------------------------------------------------------------------


def test_the_same_figure_gives_the_same_bytes():
    detections, truth, tracks = swapping_run()
    made = [
        figures.png(figures.association_maps({"": tracks}, detections, truth)) for _ in range(2)
    ]
    assert made[0] == made[1]
    assert made[0].startswith(b"\x89PNG")


def test_pictures_leave_the_callers_style_alone():
    import matplotlib

    before = dict(matplotlib.rcParams)
    figures.latency_histograms({"a": [1.0, 2.0]})
    assert dict(matplotlib.rcParams) == before


def test_matplotlib_is_imported_only_for_drawing_and_its_absence_names_the_remedy():
    code = (
        "import sys\n"
        "sys.modules['matplotlib'] = None\n"
        "from gda_tracker.evaluation import figures\n"
        "try:\n"
        "    figures.latency_histograms({'a': [1.0]})\n"
        "except figures.MissingPlotLibraryError as error:\n"
        "    print(error)\n"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "pictures need matplotlib, install it with: pip install matplotlib\n"
