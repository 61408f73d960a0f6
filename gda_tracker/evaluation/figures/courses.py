"""Courses of one replay over time: consistency, conflict; and how long each stage took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.consistency import CONFIDENCE, NormalisedErrors
from gda_tracker.evaluation.figures.canvas import INK, PALE, canvas, colour, legend_below
from gda_tracker.evaluation.figures.lives import seconds_of
from gda_tracker.evaluation.quality import combine_consistency
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# A mean over so many scans on each side: one scan has few values and scatters.
SMOOTHED_SCANS = 5


def nis_course(errors: NormalisedErrors, tracks: Sequence[Tracks]) -> Any:
    """Draw the mean NIS of each scan, its running mean, and the 95 % bounds of a scan's mean.

    Parameters
    ----------
    errors
        Of the replay; at least one.
    tracks
        One entry per scan.

    Raises
    ------
    ValueError
        Without a value.
    """
    if not len(errors.squared):
        raise ValueError("errors: no value, allowed is at least one")
    time_s = seconds_of(tracks)
    found = combine_consistency([errors], len(tracks))
    running = running_mean(found.per_scan, found.samples)
    with canvas(9.0, 3.6) as figure:
        axes = figure.add_subplot()
        some = found.samples > 0
        axes.vlines(
            time_s[some],
            found.lower[some],
            found.upper[some],
            color=PALE,
            lw=2.5,
            label=f"{CONFIDENCE:.0%} bounds of the scan's mean",
        )
        axes.plot(time_s, found.per_scan, ".", ms=5, color=colour(0), label="mean of the scan")
        label = f"mean over {2 * SMOOTHED_SCANS + 1} scans"
        axes.plot(time_s, running, color=colour(1), lw=1.8, label=label)
        label = f"expected: {found.expected:.2f}"
        axes.axhline(found.expected, color=INK, lw=1.0, ls="--", label=label)
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("NIS [1]")
        axes.set_xlabel("time since the first scan [s]")
        legend_below(figure, axes, 4)
    return figure


def running_mean(values: FloatArray, weights: FloatArray | IntArray) -> FloatArray:
    """Weighted mean (K,) over the neighbouring scans, NaN where none of them has a value."""
    weight = np.where(np.isfinite(values), weights, 0.0)
    total = np.where(weight > 0.0, values, 0.0) * weight
    window = np.ones(2 * SMOOTHED_SCANS + 1)
    middle = slice(SMOOTHED_SCANS, SMOOTHED_SCANS + len(values))
    sums, counts = (np.convolve(part, window)[middle] for part in (total, weight))
    return np.divide(sums, counts, out=np.full(len(values), np.nan), where=counts > 0.0)


def conflict_course(tracks: Sequence[Tracks]) -> Any:
    """Draw the conflict of the attributes of confirmed tracks with the detections they took."""
    place, values = heard_conflicts(tracks)
    time_s = seconds_of(tracks)
    count = np.bincount(place, minlength=len(tracks))
    total = np.bincount(place, values, minlength=len(tracks))
    per_scan = np.divide(total, count, out=np.full(len(tracks), np.nan), where=count > 0)
    with canvas(9.0, 3.4) as figure:
        axes = figure.add_subplot()
        axes.plot(time_s[place], values, ".", ms=3.5, ls="", color=colour(4), label="a track")
        label = f"mean over {2 * SMOOTHED_SCANS + 1} scans"
        axes.plot(time_s, running_mean(per_scan, count), color=colour(1), lw=1.8, label=label)
        axes.set_ylim(0.0, 1.02)
        axes.set_ylabel("conflict [1]")
        axes.set_xlabel("time since the first scan [s]")
        legend_below(figure, axes, 2)
    return figure


def heard_conflicts(tracks: Sequence[Tracks]) -> tuple[IntArray, FloatArray]:
    """Place of the scan and conflict (M,) of each confirmed track that took a detection."""
    places, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for place, live in enumerate(tracks):
        heard = (live.status == CONFIRMED) & (live.detection_index >= 0)
        values.append(live.conflict[heard])
        places.append(np.full(int(np.count_nonzero(heard)), place))
    return np.concatenate(places), np.concatenate(values)


def stage_latencies(latency_ms: Mapping[str, tuple[float, float]]) -> Any:
    """Draw the median and the 95 % quantile [ms] of each stage, in the order given, top down."""
    names = list(latency_ms)
    with canvas(8.4, 1.1 + 0.36 * max(len(names), 2)) as figure:
        axes = figure.add_subplot()
        for row, name in enumerate(names):
            median, most = latency_ms[name]
            axes.barh(row, most, height=0.62, color=PALE, label=None if row else "95 % below")
            axes.barh(row, median, height=0.62, color=colour(0), label=None if row else "median")
            axes.annotate(
                f"{median:.2f} / {most:.2f}",
                (most, row),
                (4, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.margins(x=0.14)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("time per scan [ms]")
        legend_below(figure, axes, 2)
    return figure
