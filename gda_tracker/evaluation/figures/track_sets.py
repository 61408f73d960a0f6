"""Track sets as pictures: the crossing of figure 1 of Stirling & Thompson 1991."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import GREY, INK, canvas, colour, legend_below
from gda_tracker.evaluation.figures.series import detection_positions
from gda_tracker.evaluation.track_sets import undecided
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.track_sets import TrackSetArray

KILOMETRE = 1000.0


def crossing_tracks_figure(
    detections: Sequence[Detections],
    truth: Sequence[ScanTruth],
    sets: Sequence[TrackSetArray],
    around: int,
) -> Any:
    """Draw what is true and measured, the sets, the crossing itself, and how much is open.

    Parameters
    ----------
    detections, truth, sets
        One entry per sample.
    around
        Sample, counted from 1, at which two targets cross: three samples before and after are
        drawn once more, larger.
    """
    paths = np.array([t.target_state[:, :2] for t in truth]).transpose(1, 0, 2) / KILOMETRE
    first, last = max(around - 4, 0), min(around + 3, len(sets))
    with canvas(11.0, 7.4) as figure:
        (measured, filtered), (crossing, counts) = figure.subplots(2, 2)
        for rank, path in enumerate(paths):
            measured.plot(*path.T, color=colour(rank), lw=1.4, label=f"target {rank + 1}: truth")
        for scan in detections:
            points = detection_positions(scan) / KILOMETRE
            measured.plot(*points.T, "+", color=INK, ms=5, mew=0.8)
        measured.set_title("(a) trajectories and observations")
        names = _ranks(sets)
        for scan_sets in sets:
            _draw(filtered, scan_sets, names)
        filtered.set_title("(b) filtered track sets")
        for k in range(first, last):
            points = detection_positions(detections[k]) / KILOMETRE
            crossing.plot(*points.T, "+", color=INK, ms=7, mew=1.0)
            _draw(crossing, sets[k], names)
        for rank, path in enumerate(paths):
            crossing.plot(*path[first:last].T, color=colour(rank), lw=0.8, ls="--")
        crossing.set_title(f"(c) samples {first + 1} to {last}: every set that is kept")
        whole = _borders(paths.reshape(-1, 2), 0.12)
        for axes, borders in (
            (measured, whole),
            (filtered, whole),
            (crossing, _borders(_closest_pair(paths[:, first:last]), 0.1)),
        ):
            axes.set_aspect("equal", adjustable="box")
            axes.set(xlim=borders[0], ylim=borders[1])
            axes.set_xlabel("x [km]")
            axes.set_ylabel("y [km]")
        _count(counts, sets)
        counts.set_title("(d) how much is open")
        legend_below(figure, measured, len(paths))
    return figure


def set_outlines(sets: TrackSetArray, points: int = 60) -> FloatArray:
    """Outlines (N, points, 2) [m] of the sets of positions, without their covariance."""
    part = sets.matrix[:, :2]
    values, axes = np.linalg.eigh(part @ part.transpose(0, 2, 1))
    root = (axes * np.sqrt(np.maximum(values, 0.0))[:, None]) @ axes.transpose(0, 2, 1)
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return sets.centroid[:, None, :2] + circle @ root


def _ranks(sets: Sequence[TrackSetArray]) -> dict[int, int]:
    """Place of each track in the order in which they began."""
    found: dict[int, int] = {}
    for one in sets:
        for track in np.unique(one.track_id).tolist():
            found.setdefault(track, len(found))
    return found


def _draw(axes: Any, sets: TrackSetArray, names: dict[int, int]) -> None:
    outlines = set_outlines(sets) / KILOMETRE
    for row in range(len(sets)):
        best = bool(sets.best[row])
        tint = colour(names[int(sets.track_id[row])])
        axes.fill(*outlines[row].T, color=tint, alpha=0.22 if best else 0.08, lw=0)
        axes.plot(*outlines[row].T, color=tint, lw=1.1 if best else 0.7, alpha=1 if best else 0.7)
        centre = sets.centroid[row, :2] / KILOMETRE
        axes.plot(*centre, "." if best else "x", color=tint, ms=4)


def _closest_pair(paths: FloatArray) -> FloatArray:
    """Points (., 2) of the two paths that come closest together."""
    gaps = np.linalg.norm(paths[:, None] - paths[None], axis=3).min(axis=2)
    gaps[np.diag_indices(len(paths))] = np.inf
    first, second = np.unravel_index(gaps.argmin(), gaps.shape)
    return paths[[first, second]].reshape(-1, 2)


def _borders(points: FloatArray, margin: float) -> FloatArray:
    """Lowest and highest x and y (2, 2) of a picture of points, margins relative to its width."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = margin * (high - low).max()
    return np.stack([low - room, high + room], axis=1)


def _count(axes: Any, sets: Sequence[TrackSetArray]) -> None:
    sample = np.arange(1, len(sets) + 1)
    axes.step(sample, [len(s) for s in sets], where="mid", color=INK, lw=1.6, label="sets kept")
    axes.step(
        sample,
        [len(np.unique(s.track_id)) for s in sets],
        where="mid",
        color=GREY,
        lw=1.2,
        label="tracks",
    )
    open_sets = [int(np.count_nonzero(undecided(s))) for s in sets]
    axes.bar(sample, open_sets, color=colour(1), alpha=0.35, label="of an open association")
    axes.set_xlabel("sample")
    axes.set_ylim(0, None)
    radius = axes.twinx()
    radius.plot(
        sample,
        [float(s.position_radius_m.max(initial=0.0)) for s in sets],
        color=colour(0),
        lw=1.2,
        ls="--",
    )
    radius.set_yscale("log")
    radius.set_ylabel("largest radius [m] (dashed)")
    radius.grid(False)
    axes.legend(loc="upper right")
