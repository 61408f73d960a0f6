"""Quality over time: distance of tracks and targets with its parts, and consistency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import PALE, canvas, colour, legend_below
from gda_tracker.evaluation.quality_results import QualityResult

PARTS = (
    ("GOSPA", "gospa_m"),
    ("localisation", "localisation_m"),
    ("missed", "missed_m"),
    ("false", "false_m"),
)
LINE_STYLES = ("-", "--", ":", "-.")


def set_distance_course(methods: Mapping[str, QualityResult]) -> Any:
    """Draw GOSPA and its parts [m, root mean square over the runs] by scan, one line per method."""
    with canvas(9.0, 6.2) as figure:
        panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
        for axes, (title, field) in zip(panels, PARTS, strict=True):
            for index, (name, result) in enumerate(methods.items()):
                values = getattr(result, field)
                axes.plot(np.arange(1, len(values) + 1), values, **_line(index), label=name)
            axes.set_title(title)
            axes.set_ylim(bottom=0.0)
        for axes in panels[2:]:
            axes.set_xlabel("scan")
        for axes in panels[::2]:
            axes.set_ylabel("[m RMS]")
        legend_below(figure, panels[0], 3)
    return figure


def consistency_course(methods: Mapping[str, QualityResult]) -> Any:
    """Draw mean NEES and NIS by scan, one line per method, over the bounds of the first method."""
    with canvas(9.0, 3.8) as figure:
        panels = figure.subplots(1, 2)
        for axes, name in zip(panels, ("nees", "nis"), strict=True):
            first = getattr(next(iter(methods.values())), name)
            scan = np.arange(1, len(first.per_scan) + 1)
            bounds = {"color": PALE, "lw": 0.0, "step": "mid", "label": "95 % bounds"}
            axes.fill_between(scan, first.lower, first.upper, **bounds)
            for index, (title, result) in enumerate(methods.items()):
                axes.plot(scan, getattr(result, name).per_scan, **_line(index), label=title)
            axes.axhline(first.expected, color="#666666", lw=0.8)
            axes.set_title(f"{name.upper()}, {first.dimension} degrees of freedom")
            axes.set_xlabel("scan")
            axes.set_ylim(bottom=0.0)
        panels[0].set_ylabel("mean over runs and targets [1]")
        legend_below(figure, panels[0], 4)
    return figure


def _line(index: int) -> dict[str, Any]:
    """Methods often lie on each other: the later, the thinner, so that all are seen."""
    style = LINE_STYLES[index % len(LINE_STYLES)]
    return {"color": colour(index), "ls": style, "lw": max(3.0 - 0.6 * index, 1.2)}
