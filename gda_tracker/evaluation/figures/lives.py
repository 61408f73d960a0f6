"""Tracks of one replay: where they went, when they lived, what they were taken for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.evaluation.figures.attributes import class_colours
from gda_tracker.evaluation.figures.canvas import GREY, INK, canvas, colour, legend_below
from gda_tracker.evaluation.figures.maps import box_around, name_place, prepare_map, stack_points
from gda_tracker.evaluation.figures.series import (
    TrackHistory,
    detection_positions,
    target_paths,
    track_histories,
)
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

# More would be neither drawn in time nor read.
MOST_LIVES = 40
MOST_PANELS = 6
PANEL_COLUMNS = 3
RCS_LEVELS = 200
# Radar cross sections are shown from so far below the smallest to so far above the largest.
RCS_BORDER_DB = 3.0


def seconds_of(tracks: Sequence[Tracks]) -> FloatArray:
    """Time of each scan [s], (K,), since the first of them."""
    stamps = np.array([t.key.stamp_ns for t in tracks], dtype=np.int64)
    # Whole nanoseconds first: of a time since 1970 a float keeps no microseconds.
    return (stamps - stamps.min()) / 1e9 if len(stamps) else np.zeros(0)


def longest_lives(tracks: Sequence[Tracks], most: int = MOST_LIVES) -> list[TrackHistory]:
    """Tracks that were confirmed on most scans, at most so many, by rising id."""
    histories = [h for h in track_histories(tracks) if h.confirmed.any()]
    histories.sort(key=lambda h: (-int(h.confirmed.sum()), h.track_id))
    return sorted(histories[:most], key=lambda h: h.track_id)


def plan_position(
    detections: Sequence[Detections],
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth] | None = None,
    *,
    axis_names: tuple[str, str] = ("x", "y"),
) -> Any:
    """Draw every confirmed track with its number, all detections, and the truth where it is given.

    Parameters
    ----------
    detections, tracks, truth
        One entry per scan, in the same order; ``truth`` may be missing.
    axis_names
        What x and y are, e.g. East and North.
    """
    histories = [h for h in track_histories(tracks) if h.confirmed.any()]
    points = stack_points([detection_positions(d) for d in detections])
    paths = target_paths(truth) if truth else {}
    radar = np.array([d.sensor_position_m[:2] for d in detections]).reshape(-1, 2)
    lines = [h.position_m[h.confirmed] for h in histories]
    box = box_around(stack_points([points, *paths.values(), *lines, radar]), margin=0.05)
    with canvas(8.6, 6.9) as figure:
        axes = figure.add_subplot()
        scale = prepare_map(axes, box, axis_names)
        axes.plot(*(points / scale).T, ".", ms=3, ls="", color=GREY, alpha=0.6, label="detection")
        for index, path in enumerate(paths.values()):
            label = "truth" if not index else None
            axes.plot(*(path / scale).T, color=INK, alpha=0.25, lw=6, label=label)
        for index, (history, line) in enumerate(zip(histories, lines, strict=True)):
            tint = colour(index)
            axes.plot(*(line / scale).T, color=tint, lw=1.6)
            axes.plot(*(line[0] / scale), "o", ms=4, color=tint, mec="white", mew=0.6)
            if index < MOST_LIVES:
                name_place(axes, line[0] / scale, f"{history.track_id}", tint)
        axes.plot([], [], color=GREY, lw=1.6, label="confirmed track, its number where it begins")
        if len(radar):
            axes.plot(*(radar / scale).T, ":", color=INK, lw=1.2)
            axes.plot(*(radar[-1] / scale), "^", color=INK, ms=7, ls="", label="radar")
        legend_below(figure, axes, 4)
    return figure


def track_lives(tracks: Sequence[Tracks]) -> Any:
    """Draw when each track was tentative, confirmed, coasting, and when it ended.

    Those that were confirmed on most scans, at most ``MOST_LIVES``, the first one on top.
    """
    time_s = seconds_of(tracks)
    histories = longest_lives(tracks)
    last = len(tracks) - 1
    with canvas(9.0, 1.3 + 0.23 * max(len(histories), 4)) as figure:
        axes = figure.add_subplot()
        for row, history in enumerate(histories):
            when, confirmed = time_s[history.scan], history.confirmed
            heard = history.detection >= 0
            tint = colour(row)
            at = np.full(len(when), row)
            first = confirmed.argmax()
            axes.plot(when[: first + 1], at[: first + 1], color=tint, lw=1.0, alpha=0.6)
            axes.plot(when[first:], at[first:], color=tint, lw=6.0, alpha=0.3)
            axes.plot(when[heard], at[heard], "|", color=tint, ms=8, mew=1.4, ls="")
            axes.plot(when[first], row, ">", ms=6, color=tint, mec=INK, mew=0.6)
            if history.scan[-1] < last:
                axes.plot(when[-1], row, "X", ms=6, color=tint, mec=INK, mew=0.6)
        grey = {"color": "#666666"}
        axes.plot([], [], lw=1.0, alpha=0.6, **grey, label="tentative")
        axes.plot([], [], lw=6.0, alpha=0.3, **grey, label="confirmed")
        axes.plot([], [], "|", ms=8, mew=1.4, ls="", **grey, label="took a detection")
        axes.plot([], [], ">", ms=6, ls="", mec=INK, mew=0.6, **grey, label="confirmation")
        axes.plot([], [], "X", ms=6, ls="", mec=INK, mew=0.6, **grey, label="end")
        axes.set_yticks(range(len(histories)), [f"{h.track_id}" for h in histories])
        axes.set_ylim(max(len(histories), 1) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_ylabel("track id")
        axes.set_xlabel("time since the first scan [s]")
        legend_below(figure, axes, 5)
    return figure


def belief_courses(tracks: Sequence[Tracks], histories: Sequence[TrackHistory]) -> Any:
    """Draw the class probabilities of some tracks over time, a panel each.

    Raises
    ------
    ValueError
        Without a track.
    """
    time_s = seconds_of(tracks)
    names = tracks[int(histories[0].scan[0])].class_names if histories else ()
    tints = class_colours(len(names))
    with canvas(9.6, _panels_height(len(histories))) as figure:
        panels = _panels(figure, len(histories))
        for axes, history in zip(panels, histories, strict=True):
            belief = _beliefs(tracks, history)
            for place, name in enumerate(names):
                label = name.replace("_", " ")
                axes.plot(
                    time_s[history.scan], belief[:, place], color=tints[place], lw=1.8, label=label
                )
            axes.set_ylim(0.0, 1.02)
            axes.set_title(f"track {history.track_id}")
        _label_edges(panels, "time since the first scan [s]", "class probability [1]")
        legend_below(figure, panels[0], max(len(names), 1))
    return figure


def rcs_courses(
    detections: Sequence[Detections],
    tracks: Sequence[Tracks],
    histories: Sequence[TrackHistory],
    fuzzifier: RcsFuzzifier,
) -> Any:
    """Draw the radar cross sections of the detections that tracks took, over the fuzzy sets.

    The ground is shaded with the colours of the classes, each as strongly as its grade of
    membership, normalised: so goes the mass of a detection of this radar cross section.

    Parameters
    ----------
    detections, tracks
        One entry per scan.
    histories
        The tracks to draw, each with at least one known radar cross section.
    fuzzifier
        What reads the radar cross sections.

    Raises
    ------
    ValueError
        Without a track.
    """
    time_s = seconds_of(tracks)
    measured = [rcs_dbsm(detections, history) for history in histories]
    means_db = 10.0 * np.log10(fuzzifier.parameters.class_rcs_mean_m2)
    known = np.concatenate([values[np.isfinite(values)] for values in measured] + [means_db])
    low, high = float(known.min()) - RCS_BORDER_DB, float(known.max()) + RCS_BORDER_DB
    level = np.linspace(low, high, RCS_LEVELS)
    grades = fuzzifier.membership(10.0 ** (level / 10.0))
    shares = grades / grades.sum(axis=1, keepdims=True)
    tints = class_colours(len(fuzzifier.class_names))
    ground = 1.0 - 0.45 * (shares @ (1.0 - _rgb(tints)))
    with canvas(9.6, _panels_height(len(histories))) as figure:
        panels = _panels(figure, len(histories))
        for axes, history, values in zip(panels, histories, measured, strict=True):
            when = time_s[history.scan]
            border = 0.02 * max(float(when[-1] - when[0]), 1e-3)
            extent = (float(when[0]) - border, float(when[-1]) + border, low, high)
            axes.imshow(ground[:, None], extent=extent, aspect="auto", origin="lower", zorder=0)
            axes.plot(when, values, "o", ms=3.5, ls="", color=INK, mec="white", mew=0.4)
            axes.set_title(f"track {history.track_id}")
            axes.grid(visible=False)
        for name, label, tint in zip(fuzzifier.class_names, fuzzifier.frame, tints, strict=True):
            entry = f"{label}: {name.replace('_', ' ')}"
            panels[0].plot([], [], "s", ms=9, ls="", color=tint, alpha=0.45, label=entry)
        panels[0].plot([], [], "o", ms=3.5, ls="", color=INK, label="measured")
        _label_edges(panels, "time since the first scan [s]", "radar cross section [dBsm]")
        legend_below(figure, panels[0], 4)
    return figure


def rcs_dbsm(detections: Sequence[Detections], history: TrackHistory) -> FloatArray:
    """Radar cross sections (L,) [dBsm] of the detections that a track took, NaN where unknown."""
    found = np.full(len(history.scan), np.nan)
    for place, (scan, row) in enumerate(zip(history.scan, history.detection, strict=True)):
        one = detections[scan]
        if row < 0 or one.rcs_m2 is None:
            continue
        valid = one.rcs_valid is None or bool(one.rcs_valid[row])
        value = float(one.rcs_m2[row])
        if valid and math.isfinite(value) and value > 0.0:
            found[place] = 10.0 * math.log10(value)
    return found


def says_a_class(tracks: Sequence[Tracks], history: TrackHistory) -> bool:
    """Whether a track's class probabilities ever moved: without an attribute they never do."""
    belief = _beliefs(tracks, history)
    return bool(belief.size) and not np.allclose(belief, belief[0], rtol=0.0, atol=1e-9)


def _beliefs(tracks: Sequence[Tracks], history: TrackHistory) -> FloatArray:
    """Class probabilities (L, C) of a track on the scans on which it lived."""
    rows = []
    for scan in history.scan:
        live = tracks[scan]
        rows.append(live.class_probability[np.searchsorted(live.track_id, history.track_id)])
    return np.array(rows)


def _rgb(tints: Sequence[str]) -> FloatArray:
    from matplotlib.colors import to_rgb

    return np.array([to_rgb(tint) for tint in tints])


def _panels_height(count: int) -> float:
    return 1.0 + 2.3 * math.ceil(max(count, 1) / PANEL_COLUMNS)


def _panels(figure: Any, count: int) -> list[Any]:
    if not count:
        raise ValueError("no track: allowed is at least one")
    columns = min(count, PANEL_COLUMNS)
    rows = math.ceil(count / columns)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return list(grid[:count])


def _label_edges(panels: Sequence[Any], below: str, beside: str) -> None:
    columns = min(len(panels), PANEL_COLUMNS)
    for place, axes in enumerate(panels):
        if place % columns == 0:
            axes.set_ylabel(beside)
        if place + columns >= len(panels):
            axes.set_xlabel(below)
