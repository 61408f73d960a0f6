"""Maps: tracks over detections, with the true paths where they are known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import GREY, INK, PALE, canvas, colour, legend_below
from gda_tracker.evaluation.figures.series import (
    CLUTTER,
    NOTHING,
    TrackHistory,
    detection_positions,
    detection_sources,
    target_names,
    target_paths,
    track_histories,
)
from gda_tracker.evaluation.matching import match_scan
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

# Longer edges are labelled in km.
KILOMETRES_FROM_M = 3000.0
PANEL_WIDTH_IN = 4.3


def track_map(
    detections: Sequence[Detections],
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth] | None = None,
    *,
    match_distance_m: float = 25.0,
    axis_names: tuple[str, str] = ("x", "y"),
    title: str = "",
) -> Any:
    """Draw confirmed tracks over all detections.

    A track that is matched with a target on at least half of its scans has the target's colour,
    and its number where it begins; other tracks are grey. With truth the picture shows the
    surroundings of the targets and the radar, else everything.

    Parameters
    ----------
    detections, tracks, truth
        One entry per scan, in the same order; ``truth`` may be missing.
    match_distance_m
        How far a track may be from the target it is matched with.
    axis_names
        What x and y are, e.g. East and North.
    title
        Title of the picture.
    """
    histories = [h for h in track_histories(tracks) if h.confirmed.any()]
    paths = target_paths(truth) if truth is not None else {}
    owners = _owners(tracks, truth, match_distance_m) if truth is not None else {}
    points = stack_points([detection_positions(d) for d in detections])
    own_ship = np.array([d.sensor_position_m[:2] for d in detections]).reshape(-1, 2)
    mapped = [h.position_m for h in histories if not paths or h.track_id in owners]
    shown = stack_points([*paths.values(), *mapped, own_ship])
    box = box_around(shown if len(mapped) else stack_points([shown, points]), margin=0.10)
    with canvas(8.6, 6.6) as figure:
        axes = figure.add_subplot()
        scale = prepare_map(axes, box, axis_names)
        sensors = np.array([d.sensor_id for d in detections])
        # In the order in which they appear.
        for number, sensor in enumerate(dict.fromkeys(sensors.tolist())):
            path = own_ship[sensors == sensor] / scale
            axes.plot(*path.T, ":", color=INK, lw=1.2)
            label = "_" if number else "radar"
            axes.plot(*path[-1], "^", ls=":", color=INK, ms=7, label=label)
        rank = {target: index for index, target in enumerate(paths)}
        for target, path in paths.items():
            axes.plot(
                *(path / scale).T,
                color=colour(rank[target]),
                alpha=0.28,
                lw=8,
                label=f"target {target}: truth",
            )
        hollow = {"mfc": "none", "mec": "#555555", "mew": 0.7}
        axes.plot(*(points / scale).T, "o", ms=5, ls="", **hollow, label="detection")
        labelled: set[int | None] = set()
        for history in histories:
            owner = owners.get(history.track_id)
            label = "other confirmed track" if owner is None else f"target {owner}: track"
            line = history.position_m[history.confirmed] / scale
            tint = GREY if owner is None else colour(rank[owner])
            style = {"color": tint, "lw": 1.6, "alpha": 1.0}
            if owner is None:
                style |= {"lw": 0.9, "alpha": 0.5}
            axes.plot(*line.T, **style, label=None if owner in labelled else label)
            axes.plot(*line[0], "o", ms=4, color=tint, mec="white", mew=0.6)
            name_place(axes, line[0], f"{history.track_id}", tint)
            labelled.add(owner)
        axes.set_title(title)
        legend_below(figure, axes, 3)
    return figure


def association_maps(
    panels: Mapping[str, Sequence[Tracks]],
    detections: Sequence[Detections],
    truth: Sequence[ScanTruth],
    *,
    axis_names: tuple[str, str] = ("x", "y"),
) -> Any:
    """Draw the same scans as several methods have tracked them, side by side.

    Track i has the colour of target i, on which it was started (the i-th by rising id): where its
    line runs along a band of another colour it has swapped. Filled circles are scans on which it
    took the detection of its own target, crosses those of another, small triangles false alarms.

    Parameters
    ----------
    panels
        Title and tracks, one entry per scan, of each method.
    detections, truth
        One entry per scan; the truth names the source of every detection.
    axis_names
        What x and y are.
    """
    paths, names = target_paths(truth), target_names(truth)
    points = stack_points([detection_positions(d) for d in detections])
    lines = [h.position_m for tracks in panels.values() for h in track_histories(tracks)]
    box = box_around(stack_points([*paths.values(), *lines]), margin=0.05)
    width, height = box[1] - box[0]
    panel_width = 4.3
    with canvas(
        panel_width * len(panels), panel_width * height / width * 0.9 + 1.5, "compressed"
    ) as figure:
        all_axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        for axes, (title, tracks) in zip(all_axes, panels.items(), strict=True):
            scale = prepare_map(axes, box, axis_names)
            axes.set_title(title)
            axes.plot(
                *(points / scale).T, ".", ms=3.5, color=PALE, label="detection or false alarm"
            )
            for index, (target, path) in enumerate(paths.items()):
                tint = colour(index)
                truth_label = f"{names[target]}: true path"
                axes.plot(*(path / scale).T, color=tint, alpha=0.25, lw=9, label=truth_label)
            histories = track_histories(tracks)
            for index, (target, history) in enumerate(zip(paths, histories, strict=False)):
                label = f"track started on the {names[target]}"
                _draw_track(axes, history, truth, target, colour(index), scale, label)
            _marker_legend(axes)
            axes.label_outer()
            for index, path in enumerate(paths.values()):
                _arrow(axes, path / scale, colour(index))
        legend_below(figure, all_axes[0], 2)
    return figure


def _draw_track(
    axes: Any,
    history: TrackHistory,
    truth: Sequence[ScanTruth],
    target: int,
    tint: str,
    scale: float,
    label: str,
) -> None:
    line = history.position_m / scale
    source = detection_sources(history, truth)
    own, false = source == target, source == CLUTTER
    other = ~own & ~false & (source != NOTHING)
    axes.plot(*line.T, color=tint, lw=1.6, label=label)
    axes.plot(*line[own].T, "o", ms=4, color=tint, mec="white", mew=0.5)
    axes.plot(*line[other].T, "X", ms=7.5, color=tint, mec=INK, mew=0.7)
    axes.plot(*line[false].T, "v", ms=6, color="white", mec=tint, mew=1.3)


def _marker_legend(axes: Any) -> None:
    """Entries for the markers, which have the colours of several tracks."""
    axes.plot([], [], "o", ms=5, color=GREY, label="took its own target's detection")
    axes.plot([], [], "X", ms=7.5, color=GREY, mec=INK, mew=0.7, label="took another target's")
    axes.plot([], [], "v", ms=6, color="white", mec=GREY, mew=1.3, label="took a false alarm")


def _arrow(axes: Any, path: FloatArray, tint: str) -> None:
    """Show the direction of a path at its beginning."""
    known = path[np.isfinite(path).all(axis=1)]
    if len(known) > 1:
        axes.annotate(
            "",
            xy=known[1],
            xytext=known[0],
            arrowprops={"arrowstyle": "-|>", "color": tint, "lw": 2.2, "mutation_scale": 16},
        )


def _owners(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], match_distance_m: float
) -> dict[int, int]:
    """Target of each track that is matched with one target on at least half of its scans."""
    alive: Counter[int] = Counter()
    matched: Counter[tuple[int, int]] = Counter()
    for live, known in zip(tracks, truth, strict=True):
        targets, rows, _ = match_scan(live, known, match_distance_m)
        # Only scans count on which some target's position is known.
        if np.isfinite(known.target_state[:, :2]).any():
            alive.update(live.track_id[live.status == 1].tolist())
        pairs = zip(live.track_id[rows].tolist(), known.target_id[targets].tolist(), strict=True)
        matched.update(pairs)
    return {
        track: target
        for (track, target), count in matched.items()
        if 2 * count >= alive[track] and count == max(matched[track, t] for t in _ids(truth))
    }


def _ids(truth: Sequence[ScanTruth]) -> list[int]:
    return np.unique(np.concatenate([t.target_id for t in truth])).tolist()


def stack_points(parts: Sequence[FloatArray]) -> FloatArray:
    """All finite points (n, 2) of several arrays of points."""
    points = np.concatenate([np.zeros((0, 2)), *parts])
    return points[np.isfinite(points).all(axis=1)]


def box_around(points: FloatArray, margin: float) -> FloatArray:
    """Corners (2, 2) of what holds all points with a margin, never empty."""
    if not len(points):
        return np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    border = max(margin * float((high - low).max()), 1.0)
    return np.array([low - border, high + border])


def prepare_map(axes: Any, box: FloatArray, axis_names: tuple[str, str]) -> float:
    """Set limits and labels of a map; return what to divide metres by."""
    large = float((box[1] - box[0]).max()) > KILOMETRES_FROM_M
    scale, unit = (1000.0, "km") if large else (1.0, "m")
    axes.set_aspect("equal")
    axes.locator_params(nbins=7, steps=[1, 2, 5, 10])
    axes.set_xlim(box[0, 0] / scale, box[1, 0] / scale)
    axes.set_ylim(box[0, 1] / scale, box[1, 1] / scale)
    axes.set_xlabel(f"{axis_names[0]} [{unit}]")
    axes.set_ylabel(f"{axis_names[1]} [{unit}]")
    return scale


def name_place(axes: Any, place: FloatArray, text: str, tint: str) -> None:
    """Write a name beside a point."""
    axes.annotate(
        text,
        place,
        xytext=(6, 6),
        textcoords="offset points",
        color=tint,
        fontsize=8,
        fontweight="bold",
        clip_on=True,
        zorder=6,
        bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7},
    )
