"""Scores: one method against another run by run, and how long a scan takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import INK, PALE, canvas, colour, legend_below
from gda_tracker.evaluation.statistics import mean_and_stderr

LATENCY_BINS = 60
# More runs than this stay without their number under the axis.
MOST_RUN_NUMBERS = 50


def paired_purity(first: tuple[str, Sequence[float]], second: tuple[str, Sequence[float]]) -> Any:
    """Draw the purity of every run with two methods on the same random numbers.

    Parameters
    ----------
    first, second
        Name of the method and its purity in each run, in the same order of runs. The runs are
        sorted by the first, then by the second.

    Raises
    ------
    ValueError
        If the numbers of runs differ or are zero.
    """
    before, after = np.asarray(first[1], dtype=float), np.asarray(second[1], dtype=float)
    if before.shape != after.shape or not len(before):
        raise ValueError(f"{len(before)} and {len(after)} runs: must be equal and not zero")
    order = np.lexsort((after, before))
    place = np.arange(len(order))
    colours = (colour(1), colour(0))
    with canvas(9.0, 3.8) as figure:
        axes, side = figure.subplots(1, 2, sharey=True, width_ratios=[5, 1])
        axes.vlines(place, before[order], after[order], color=PALE, lw=2.5, zorder=1)
        ring = {"mfc": "white", "mec": colours[0], "mew": 2}
        axes.plot(place, before[order], "o", ms=9, ls="", **ring, label=first[0])
        axes.plot(place, after[order], "D", ms=5, color=colours[1], mew=0, label=second[0])
        named = len(order) <= MOST_RUN_NUMBERS
        axes.set_xticks(place if named else [], [str(run) for run in order] if named else [])
        axes.tick_params(axis="x", labelsize=8)
        axes.set_xlabel(f"run, sorted by its purity with {first[0]}")
        axes.set_ylabel("track purity [1]")
        axes.set_ylim(min(0.0, float(before.min())), 1.04)
        axes.grid(axis="x", visible=False)
        axes.set_title("Every run")
        sides = ((before, {"fmt": "o", "ms": 9, **ring}), (after, {"fmt": "D", "ms": 7}))
        for column, (values, style) in enumerate(sides):
            mean, error = mean_and_stderr(values)
            side.errorbar(column, mean, error, color=colours[column], capsize=4, **style)
            side.annotate(
                f"{mean:.3f}", (column, mean), (0, -26), textcoords="offset points", ha="center"
            )
        side.set_xlim(-0.7, 1.7)
        side.set_xticks([])
        side.set_title("Mean ± SE")
        legend_below(figure, axes, 2)
    return figure


def latency_histograms(latency_ms: Mapping[str, Sequence[float]]) -> Any:
    """Draw the distribution of the time from detections to tracks, one panel per name.

    Parameters
    ----------
    latency_ms
        Latency of each scan [ms] by name, positive.
    """
    everything = np.concatenate([np.asarray(v, dtype=float) for v in latency_ms.values()])
    low, high = 0.9 * everything.min(), 1.1 * everything.max()
    bins = np.geomspace(low, high, LATENCY_BINS)
    with canvas(7.6, 0.9 + 1.45 * len(latency_ms)) as figure:
        panels = figure.subplots(len(latency_ms), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(panels, latency_ms.items(), strict=True):
            axes.hist(values, bins, color=colour(4), edgecolor="white", lw=0.4)
            median, most = float(np.median(values)), float(np.percentile(values, 99))
            axes.axvline(median, color=INK, lw=1.4)
            axes.axvline(most, color=INK, lw=1.4, ls="--")
            axes.set_title(name)
            text = f"median {median:.1f} ms (line), 99 % below {most:.1f} ms (dashed)"
            axes.set_title(text, loc="right", fontsize=9, fontweight="normal")
            axes.set_ylabel("scans")
            axes.locator_params(axis="y", nbins=4, integer=True)
            axes.set_xscale("log")
        panels[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panels[-1].xaxis.set_minor_formatter(_few_labels)
        panels[-1].set_xlabel("latency per scan, from detections to tracks [ms]")
    return figure


def _few_labels(value: float, _: int) -> str:
    """Label the minor ticks of a logarithmic axis at 2, 3, 5 and their multiples by ten."""
    return f"{value:g}" if f"{value:e}"[0] in "235" else ""
