"""Pictures of a search: its course or trade-off, what mattered, and each parameter's values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import GREY, PALE, canvas, colour, legend_below
from gda_tracker.tuning.objectives import Objective, pareto_front
from gda_tracker.tuning.search import Found, Outcome
from gda_tracker.tuning.search_space import Range

DOT = {"s": 18, "lw": 0.0, "zorder": 2}
COLUMNS = 3
# Trials far off would squeeze the interesting ones together.
SHOWN_SHARE = 0.95


def course(found: Found, objective: Objective, chosen: Outcome | None) -> Any:
    """Draw one objective by trial, the best so far, the default and what was chosen."""
    number = np.array([trial.number for trial in found.trials])
    value = np.array([trial.values[0] for trial in found.trials])
    start = objective.sign * found.baseline.values[0]
    best = objective.sign * np.minimum.accumulate(np.array([start, *(objective.sign * value)]))
    with canvas(8.0, 3.8) as figure:
        axes = figure.subplots()
        axes.scatter(number, value, color=PALE, label="trial", **DOT)
        axes.step([0, *number], best, where="post", color=colour(0), label="best so far")
        axes.axhline(found.baseline.values[0], color=colour(1), ls="--", label="default")
        if chosen is not None:
            axes.scatter(
                [chosen.number],
                chosen.values[:1],
                color=colour(2),
                marker="D",
                s=50,
                zorder=3,
                label="chosen",
            )
        _limit(axes.set_ylim, [*value, found.baseline.values[0]], objective)
        axes.set_xlabel("trial")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel(_axis(objective))
        legend_below(figure, axes, 4)
    return figure


def trade_off(found: Found, objectives: Sequence[Objective], chosen: Outcome | None) -> Any:
    """Draw the first objective against each other one, with the trials that nothing beats."""
    others = objectives[1:]
    values = np.array([trial.values for trial in found.trials])
    front = pareto_front(objectives, values.tolist())
    with canvas(4.6 * max(len(others), 1) + 1.0, 4.4) as figure:
        panels = np.atleast_1d(figure.subplots(1, len(others)))
        for axes, (place, other) in zip(panels, enumerate(others, 1), strict=True):
            axes.scatter(values[:, 0], values[:, place], color=PALE, label="trial", **DOT)
            order = sorted(front, key=lambda row: values[row, 0])
            line = "-" if len(objectives) == 2 else ""
            axes.plot(
                values[order, 0],
                values[order, place],
                color=colour(0),
                marker="o",
                ms=5,
                ls=line,
                lw=1.0,
                label="beaten by none",
            )
            at = found.baseline.values
            axes.scatter(
                [at[0]], [at[place]], color=colour(1), marker="s", s=60, zorder=3, label="default"
            )
            if chosen is not None:
                axes.scatter(
                    [chosen.values[0]],
                    [chosen.values[place]],
                    color=colour(2),
                    marker="D",
                    s=60,
                    zorder=3,
                    label="chosen",
                )
            axes.set_xlabel(_axis(objectives[0]))
            axes.set_ylabel(_axis(other))
            _limit(axes.set_xlim, [*values[:, 0], at[0]], objectives[0])
            _limit(axes.set_ylim, [*values[:, place], at[place]], other)
        legend_below(figure, panels[0], 4)
    return figure


def importance_bars(importances: Mapping[str, Mapping[str, float]]) -> Any:
    """Draw the share of each parameter, one panel per objective."""
    names = sorted({name for shares in importances.values() for name in shares}, reverse=True)
    only = next(iter(importances.values()))
    names.sort(key=lambda name: only.get(name, 0.0) if len(importances) == 1 else 0.0)
    with canvas(3.2 * len(importances) + 3.0, 0.32 * len(names) + 1.2) as figure:
        panels = np.atleast_1d(figure.subplots(1, len(importances), sharey=True))
        for axes, (title, shares) in zip(panels, importances.items(), strict=True):
            axes.barh(names, [shares.get(name, 0.0) for name in names], color=colour(0))
            axes.set_title(title)
            axes.set_xlabel("share [1]")
            axes.grid(False, axis="y")
    return figure


def parameter_slices(
    found: Found, space: Sequence[Range], objective: Objective, chosen: Outcome | None
) -> Any:
    """Draw the first objective over each parameter."""
    rows = math.ceil(len(space) / COLUMNS)
    value = [trial.values[0] for trial in found.trials]
    with canvas(9.0, 2.2 * rows + 0.6) as figure:
        panels = figure.subplots(rows, COLUMNS, sharey=True, squeeze=False).ravel()
        for axes in panels[len(space) :]:
            axes.set_visible(False)
        for axes, item in zip(panels, space, strict=False):
            place = _places(item)
            at = [place(trial.point[item.name]) for trial in found.trials]
            axes.scatter(at, value, color=GREY, s=10, lw=0.0, label="trial")
            base = place(found.baseline.point[item.name])
            axes.scatter(
                [base],
                found.baseline.values[:1],
                color=colour(1),
                marker="s",
                s=40,
                zorder=3,
                label="default",
            )
            if chosen is not None:
                axes.scatter(
                    [place(chosen.point[item.name])],
                    chosen.values[:1],
                    color=colour(2),
                    marker="D",
                    s=40,
                    zorder=3,
                    label="chosen",
                )
            _ticks(axes, item)
            unit = item.specification.unit
            axes.set_xlabel(item.name + (f" [{unit}]" if unit else ""))
        for axes in panels[::COLUMNS]:
            axes.set_ylabel(_axis(objective))
        _limit(panels[0].set_ylim, [*value, found.baseline.values[0]], objective)
        legend_below(figure, panels[0], 3)
    return figure


def _ticks(axes: Any, item: Range) -> None:
    """Label a few values, however small the panel."""
    if item.choices:
        axes.set_xticks(range(len(item.choices)), [str(choice) for choice in item.choices])
        return
    if item.log:
        axes.set_xscale("log")
        at = np.geomspace(item.low, item.high, 4)
        axes.set_xticks(at, [f"{float(f'{value:.2g}'):g}" for value in at])
        axes.set_xticks([], minor=True)
    elif item.specification.element_kind is int:
        axes.xaxis.get_major_locator().set_params(integer=True, min_n_ticks=1)


def _places(item: Range) -> Any:
    """Where a value stands on the axis."""
    if item.choices:
        return item.choices.index
    return float


def _axis(objective: Objective) -> str:
    unit = f" [{objective.unit}]" if objective.unit else ""
    return objective.title + unit


def _limit(set_limits: Any, values: Sequence[float], objective: Objective) -> None:
    """Leave out the worst few."""
    keys = np.sort(objective.sign * np.asarray(values, dtype=float))
    low, high = keys[0], keys[math.ceil(SHOWN_SHARE * (len(keys) - 1))]
    high = max(high, objective.sign * float(values[-1]))
    room = 0.05 * (high - low) or 0.05 * max(abs(low), 1.0)
    ends = sorted((objective.sign * (low - room), objective.sign * (high + room)))
    set_limits(*ends)
