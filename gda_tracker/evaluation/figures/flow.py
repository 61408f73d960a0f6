"""How one scan's evidence flows: from radar cross sections to the association of pairs.

The pictures of ``docs/evidence-flow.md``, for any scan that has gone round the ring.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.attributes.rcs import density
from gda_tracker.evaluation.figures.attributes import class_colours
from gda_tracker.evaluation.figures.canvas import GREY, INK, PALE, canvas, colour, legend_below
from gda_tracker.evaluation.figures.maps import association_maps
from gda_tracker.evaluation.figures.series import detection_positions
from gda_tracker.evidence.frames import element_name
from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.kinematics.sensor_models import polar_measurements, predicted_measurements
from gda_tracker.vocabulary.arrays import FloatArray, IntArray, MaskArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Detections, Scan, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

GATE_POINTS = 73
RCS_POINTS = 600
CHOSEN_COLOUR = "#009e73"


def fuzzy_reading(
    fuzzifier: RcsFuzzifier, scan: Scan, evidence: Evidence, rows: IntArray, names: Sequence[str]
) -> Any:
    """Draw detections on the fuzzy sets, and the masses of belief that they get.

    On the left the sets, with the radar cross section of each detection as a line and its grades
    of membership as points; the class that lies highest, the false alarm as a rule, is cut off.
    Where the grades are shares of draws per bin the exact densities are dotted. On the right the
    masses of all focal elements that carry any.

    Parameters
    ----------
    fuzzifier
        The stage that made the evidence.
    scan, evidence
        What the ring says of the scan.
    rows, names
        (n,) rows of the detections to draw, and what to call them.
    """
    p = fuzzifier.parameters
    means, swerling = p.class_rcs_mean_m2, p.class_rcs_swerling
    rcs = scan.rcs_m2[rows]
    axis = np.linspace(0.0, max(2.0 * max(means), 1.2 * rcs.max()), RCS_POINTS)
    grades = fuzzifier.membership(axis)
    own = fuzzifier.membership(rcs)
    peaks = np.sort(grades.max(axis=0))
    top = 1.3 * max(float(peaks[-2]), float(own.max()))
    tints = class_colours(len(p.class_labels))
    masses = evidence.masses[rows]
    columns = np.flatnonzero(masses.any(axis=0))
    with canvas(9.6, 3.9) as figure:
        sets, bars = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        for index, label in enumerate(p.class_labels):
            name = p.class_names[index].replace("_", " ")
            sets.fill_between(axis, grades[:, index], color=tints[index], alpha=0.22, lw=0)
            sets.plot(axis, grades[:, index], color=tints[index], lw=1.6, label=f"{label}: {name}")
            sets.plot(rcs, own[:, index], "o", ms=6.5, color=tints[index], mec=INK, mew=0.8)
        if p.membership == "histogram" and p.histogram_normalisation == "area":
            exact = density(axis[:, None], np.array(means), np.array(swerling))
            sets.plot(axis, exact * p.histogram_bin_width_m2, ":", color=INK, lw=1.0)
            sets.plot([], [], ":", color=INK, lw=1.0, label="Swerling density per bin")
        for value, name in zip(rcs, names, strict=True):
            sets.axvline(value, color=INK, lw=1.1, ls="--", zorder=1)
            text = f"{name}: {value:.2f} m²"
            sets.annotate(text, (value, top), (4, -12), textcoords="offset points", fontsize=9)
        sets.set_xlim(0.0, axis[-1])
        sets.set_ylim(0.0, top)
        sets.set_xlabel("radar cross section [m²]")
        sets.set_ylabel("grade of membership [1]")
        sets.set_title("Grades of membership")
        if peaks[-1] > top:
            highest = p.class_labels[int(np.argmax(grades.max(axis=0)))]
            note = f"{highest} cut, peak {peaks[-1]:.2f}"
            sets.set_title(note, loc="right", fontsize=9, fontweight="normal")
        _grouped_bars(bars, evidence, masses, columns, names, tints)
        legend_below(figure, sets, len(p.class_labels) + 1)
    return figure


def _grouped_bars(
    axes: Any,
    evidence: Evidence,
    masses: FloatArray,
    columns: IntArray,
    names: Sequence[str],
    tints: Sequence[str],
) -> None:
    """Masses of each detection side by side; elements of the frame in the colours of the sets."""
    width = 0.8 / len(columns)
    for place, column in enumerate(columns):
        element = element_name(evidence.frame, int(evidence.focal[column]))
        known = element in evidence.frame
        tint = tints[evidence.frame.index(element)] if known else PALE
        offset = np.arange(len(names)) + (place - 0.5 * (len(columns) - 1)) * width
        found = axes.bar(offset, masses[:, column], 0.92 * width, color=tint, label=element)
        texts = [f"{element}\n{value:.3f}" for value in masses[:, column]]
        axes.bar_label(found, texts, fontsize=8, padding=2)
    axes.set_xticks(np.arange(len(names)), names)
    axes.set_ylim(0.0, 1.22 * float(masses.max()))
    axes.grid(axis="x", visible=False)
    axes.set_ylabel("mass m [1]")
    axes.set_title("Masses of belief")


def candidate_histories(
    predictions: Predictions,
    scores: AttributeScores,
    pairs: IntArray,
    names: tuple[Sequence[str], Sequence[str]],
    chosen: np.ndarray,
) -> Any:
    """Draw each track's attribute history, and how each detection would change it.

    One row per track: on the left the masses of the history, then the masses of each candidate less
    those of the history, whose root of the sum of squares is the distance (Tchamova et al. 2004,
    14.4.2). Elements without any mass are left out. A chosen pair has a frame.

    Parameters
    ----------
    predictions, scores
        What the ring says of the scan, with an attribute term that has masses.
    pairs
        (T, D) rows of the pairs in ``scores`` of the tracks and detections to draw.
    names
        What to call the T tracks and the D detections.
    chosen
        (P,) the pairs that were chosen.
    """
    tracks = scores.hypothesis[pairs[:, 0]]
    history = predictions.masses[tracks]
    focal = _with_mass(predictions.focal, history) | _with_mass(scores.focal, scores.masses[pairs])
    # In the order of the columns of the candidates, with what only the histories have behind.
    order = [int(m) for m in scores.focal if int(m) in focal]
    order += [int(m) for m in predictions.focal if int(m) in focal and int(m) not in order]
    labels = [element_name(scores.frame, mask).replace("&", "∩") for mask in order]
    labels = [label.replace("|", "∪") for label in labels]
    before = _columns(predictions.focal, history, order)
    after = _columns(scores.focal, scores.masses[pairs], order)
    change = after - before[:, None]
    reach = 1.15 * max(float(np.abs(change).max()), 1e-12)
    place = np.arange(len(order))
    n_tracks, n_detections = pairs.shape
    with canvas(3.3 * (1 + n_detections), 2.6 * n_tracks + 0.3) as figure:
        panels = figure.subplots(n_tracks, 1 + n_detections, sharex=True, squeeze=False)
        for row in range(n_tracks):
            tint = colour(row)
            panels[row, 0].bar(place, before[row], color=tint, alpha=0.45)
            panels[row, 0].set_title(f"{names[0][row]}: history")
            panels[row, 0].set_ylabel("mass m [1]")
            panels[row, 0].set_ylim(0.0, 1.0)
            for column in range(n_detections):
                axes, pair = panels[row, 1 + column], pairs[row, column]
                axes.bar(place, change[row, column], color=tint)
                axes.axhline(0.0, color=INK, lw=0.8)
                axes.set_ylim(-reach, reach)
                axes.set_title(f"{names[0][row]} with {names[1][column]}")
                text = f"$d_e$ = {scores.distance[pair]:.3g}"
                axes.set_title(text, loc="right", fontsize=10, fontweight="normal")
                if column == 0:
                    axes.set_ylabel("change of mass [1]")
                if chosen[pair]:
                    _frame(axes)
        for axes in panels[-1]:
            axes.set_xticks(place, labels, rotation=55, ha="right", rotation_mode="anchor")
        for axes in panels.flat:
            axes.grid(axis="x", visible=False)
        panels[0, 0].bar(0, 0, color=GREY, alpha=0.45, label="history")
        panels[0, 0].bar(0, 0, color=GREY, label="candidate history less history")
        panels[0, 0].plot([], [], color=CHOSEN_COLOUR, lw=2.5, label="chosen pair")
        legend_below(figure, panels[0, 0], 3)
    return figure


def _with_mass(focal: MaskArray, masses: FloatArray) -> set[int]:
    return set(focal[masses.reshape(-1, len(focal)).any(axis=0)].tolist())


def _columns(focal: MaskArray, masses: FloatArray, order: Sequence[int]) -> FloatArray:
    """Masses (..., len(order)) of the elements in this order, 0 for those without a column."""
    place = {int(mask): column for column, mask in enumerate(focal)}
    found = [masses[..., place[m]] if m in place else np.zeros(masses.shape[:-1]) for m in order]
    return np.stack(found, axis=-1)


def _frame(axes: Any) -> None:
    for spine in axes.spines.values():
        spine.set(visible=True, color=CHOSEN_COLOUR, linewidth=2.5)


def pair_tables(
    tables: Mapping[str, FloatArray],
    names: tuple[Sequence[str], Sequence[str]],
    chosen: Sequence[np.ndarray],
) -> Any:
    """Draw numbers of pairs as tables, tracks by detections, the darker the larger in its table.

    Parameters
    ----------
    tables
        Title and numbers (T, D) of each table.
    names
        What to call the T tracks and the D detections.
    chosen
        For each table (T, D) which pairs to frame.
    """
    with canvas(2.15 * len(tables), 2.5) as figure:
        panels = figure.subplots(1, len(tables), squeeze=False)[0]
        for axes, (title, values), mark in zip(panels, tables.items(), chosen, strict=True):
            low, high = float(values.min()), float(values.max())
            shade = (values - low) / (high - low) if high > low else np.zeros_like(values)
            axes.imshow(shade, cmap="Greys", vmin=-0.15, vmax=2.2)
            for (row, column), value in np.ndenumerate(values):
                axes.text(column, row, f"{value:.4g}", ha="center", va="center", fontsize=11)
                if mark[row, column]:
                    corner = (column - 0.46, row - 0.46)
                    axes.add_patch(_rectangle(corner, 0.92))
            axes.set_title(title, fontsize=10)
            axes.set_xticks(range(len(names[1])), names[1])
            axes.set_yticks(range(len(names[0])), names[0])
            axes.tick_params(length=0)
            axes.grid(visible=False)
            for spine in axes.spines.values():
                spine.set_visible(False)
    return figure


def _rectangle(corner: tuple[float, float], size: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle(corner, size, size, fill=False, ec=CHOSEN_COLOUR, lw=2.5)


def gated_maps(
    panels: Mapping[str, Sequence[Tracks]],
    detections: Sequence[Detections],
    truth: Sequence[ScanTruth],
    shown: int,
    gates: tuple[Scan, Predictions],
    rows: IntArray,
    names: Sequence[str],
    *,
    axis_names: tuple[str, str] = ("x", "y"),
) -> Any:
    """Draw :func:`association_maps` of a few scans, with the gates and detections of one of them.

    Parameters
    ----------
    panels, detections, truth, axis_names
        As in :func:`association_maps`.
    shown
        Which of the scans has gates.
    gates
        The scan and the predictions behind them, one component per hypothesis.
    rows, names
        (n,) rows of the detections of that scan to name, and what to call them.
    """
    figure = association_maps(panels, detections, truth, axis_names=axis_names)
    points = detection_positions(detections[shown])[rows]
    ellipses = gate_outlines(*gates)
    # The map is drawn in km where its edges are long; the label says so.
    scale = 1000.0 if figure.axes[0].get_xlabel().endswith("[km]") else 1.0
    for axes in figure.axes:
        note = "dashed: gates, squares: detections in them"
        axes.set_title(note, loc="right", fontsize=8.5, fontweight="normal")
        for index, outline in enumerate(ellipses):
            axes.plot(*(outline / scale).T, "--", color=colour(index), lw=1.3)
        for point, name in zip(points, names, strict=True):
            axes.plot(*(point / scale), "s", ms=8, mfc="none", mec=INK, mew=1.4, zorder=7)
            axes.annotate(
                name,
                point / scale,
                xytext=(0, 13 if point[1] == points[:, 1].max() else -22),
                textcoords="offset points",
                ha="center",
                fontweight="bold",
                zorder=8,
            )
    return figure


def gate_outlines(scan: Scan, predictions: Predictions) -> FloatArray:
    """Outlines (H, points, 2) [m] of the gates of hypotheses of one component each.

    The points of range and azimuth at which the squared Mahalanobis distance is the gate threshold,
    for a detection with the noise of the scan's first one (Tchamova et al. 2004, (14.1)).

    Raises
    ------
    ValueError
        If a hypothesis has several components, or the scan no detections.
    """
    if len(predictions.component_mean) != len(predictions) or not len(scan):
        raise ValueError(
            f"{len(predictions.component_mean)} components of {len(predictions)} hypotheses, "
            f"{len(scan)} detections: allowed are one component each and at least one detection"
        )
    measured = polar_measurements(scan)
    seen = predicted_measurements(
        predictions.component_mean[:, :2],
        predictions.component_covariance[:, :2, :2],
        measured.sensor_xy_m,
    )
    turn = np.linspace(0.0, 2.0 * np.pi, GATE_POINTS)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    radius = np.sqrt(gate_threshold(predictions.settings.gate_probability))
    offset = radius * np.linalg.cholesky(seen.covariance + measured.covariance[0]) @ circle
    range_m = seen.range_m[:, None] + offset[:, 0]
    azimuth = seen.azimuth_rad[:, None] + offset[:, 1]
    outline = np.stack([range_m * np.cos(azimuth), range_m * np.sin(azimuth)], axis=-1)
    return np.asarray(outline + measured.sensor_xy_m)
