"""Formations over time: who came from whom, and how many objects each one has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import COLOURS, GREY, INK, canvas, colour
from gda_tracker.formations.found import MERGED, NUMBER_CHANGED, SPLIT, Formation, Formations
from gda_tracker.vocabulary.arrays import FloatArray

# More lanes or panels would not be read.
MOST_LANES = 16
MOST_NUMBERS = 8
PANEL_COLUMNS = 2


@dataclass(frozen=True, slots=True)
class FormationHistory:
    """One formation: ``scan`` (L,) the scans on which it was there, and what it was on each."""

    formation_id: int
    scan: list[int]
    formation: list[Formation]

    def probabilities(self) -> FloatArray:
        """Return c(n) (L, N)."""
        return np.array([one.number_probabilities for one in self.formation])


def formation_histories(
    found: Sequence[Formations], most: int = MOST_LANES
) -> list[FormationHistory]:
    """Formations by rising id, those alone that were there on most scans."""
    histories: dict[int, FormationHistory] = {}
    for scan, formations in enumerate(found):
        for one in formations.formations:
            history = histories.setdefault(
                one.formation_id, FormationHistory(one.formation_id, [], [])
            )
            history.scan.append(scan)
            history.formation.append(one)
    longest = sorted(histories.values(), key=lambda h: (-len(h.scan), h.formation_id))[:most]
    return sorted(longest, key=lambda h: h.formation_id)


def _seconds(found: Sequence[Formations]) -> FloatArray:
    stamps = np.array([one.key.stamp_ns for one in found], dtype=np.int64)
    return (stamps - stamps.min()) / 1e9


def formation_lanes(found: Sequence[Formations]) -> Any:
    """Draw a lane for each formation, as wide as it has objects, with splits and mergers between.

    Raises
    ------
    ValueError
        Without a formation.
    """
    histories = formation_histories(found)
    if not histories:
        raise ValueError("no formation to draw")
    time_s = _seconds(found)
    lane = {history.formation_id: row for row, history in enumerate(histories)}
    with canvas(9.0, 1.4 + 0.42 * max(len(histories), 4)) as figure:
        axes = figure.add_subplot()
        for row, history in enumerate(histories):
            _draw_lane(axes, row, time_s[history.scan], history)
        for scan, formations in enumerate(found):
            for event in formations.events:
                if event.kind not in (SPLIT, MERGED):
                    continue
                for other in event.other_formation_ids:
                    if event.formation_id in lane and other in lane:
                        ends = (lane[event.formation_id], lane[other])
                        _draw_link(axes, time_s[scan], ends, event.kind)
        axes.plot([], [], "-", color=COLOURS[1], lw=1.6, label="splits off")
        axes.plot([], [], "--", color=COLOURS[2], lw=1.6, label="is taken in")
        axes.plot([], [], "o", color="white", mec=INK, ms=10, ls="", label="number decided")
        axes.set_yticks(range(len(histories)), [f"{h.formation_id}" for h in histories])
        axes.set_ylim(len(histories) - 0.3, -0.7)
        axes.grid(axis="y", visible=False)
        axes.set_ylabel("formation")
        axes.set_xlabel("time since the first scan [s]")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw_lane(axes: Any, row: int, time_s: FloatArray, history: FormationHistory) -> None:
    number = np.array([one.number for one in history.formation])
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    tint = colour(row)
    for start, end in zip(starts, [*starts[1:], len(number) - 1], strict=True):
        width = 1.5 + 2.0 * number[start]
        axes.plot(
            time_s[[start, end]], [row, row], color=tint, lw=width, alpha=0.45,
            solid_capstyle="butt",
        )  # fmt: skip
        if number[start]:
            axes.plot(time_s[start], row, "o", ms=13, color="white", mec=tint, mew=1.4, zorder=4)
            axes.text(
                time_s[start], row, f"{number[start]}", ha="center", va="center_baseline",
                fontsize=8.5, zorder=5,
            )  # fmt: skip


def _draw_link(axes: Any, when: float, ends: tuple[int, int], kind: str) -> None:
    style = "-" if kind == SPLIT else "--"
    tint = COLOURS[1] if kind == SPLIT else COLOURS[2]
    tail, head = ends if kind == SPLIT else ends[::-1]
    axes.annotate(
        "", (when, head), (when, tail), zorder=3,
        arrowprops={"arrowstyle": "->", "color": tint, "lw": 1.6, "ls": style},
    )  # fmt: skip


def formation_numbers(found: Sequence[Formations]) -> Any:
    """Draw c(n) over time of the longest formations, a panel each, and the number decided.

    Raises
    ------
    ValueError
        Without a formation.
    """
    histories = formation_histories(found, MOST_NUMBERS)
    if not histories:
        raise ValueError("no formation to draw")
    time_s = _seconds(found)
    rows = math.ceil(len(histories) / PANEL_COLUMNS)
    with canvas(9.6, 0.9 + 1.9 * rows) as figure:
        panels = figure.subplots(rows, PANEL_COLUMNS, squeeze=False, sharex=True, sharey=True)
        shade = None
        for axes, history in zip(panels.flat, histories, strict=False):
            shade = _draw_numbers(axes, time_s, history, found)
        for axes in panels.flat[len(histories) :]:
            axes.set_axis_off()
        figure.supxlabel("time since the first scan [s]", fontsize=10)
        figure.supylabel("number of objects", fontsize=10)
        figure.colorbar(shade, ax=panels, label="probability c(n)", shrink=0.8, pad=0.01)
    return figure


def _draw_numbers(
    axes: Any, time_s: FloatArray, history: FormationHistory, found: Sequence[Formations]
) -> Any:
    probability = history.probabilities()
    when = time_s[history.scan]
    most = probability.shape[1]
    shade = axes.pcolormesh(
        when, np.arange(1, most + 1), probability.T, cmap="Blues", vmin=0.0, vmax=1.0,
        shading="nearest",
    ) if len(when) > 1 else axes.scatter(
        np.repeat(when, most), np.arange(1, most + 1), c=probability.ravel(), cmap="Blues",
        vmin=0.0, vmax=1.0,
    )  # fmt: skip
    number = np.array([float(one.number) for one in history.formation])
    number[number == 0.0] = np.nan
    axes.plot(when, number, color=COLOURS[1], lw=1.8, drawstyle="steps-post")
    axes.plot(when, [one.expected_number for one in history.formation], ":", color=INK, lw=1.2)
    for scan, formations in enumerate(found):
        for event in formations.events:
            if event.formation_id == history.formation_id and event.kind == NUMBER_CHANGED:
                axes.plot(time_s[scan], event.number, "o", ms=4, color=COLOURS[1])
    axes.set_title(f"formation {history.formation_id}", fontsize=9)
    axes.grid(visible=False)
    axes.set_yticks(range(1, most + 1))
    return shade


def stated_numbers(methods: Mapping[str, Sequence[Mapping[str, float]]]) -> Any:
    """Draw the share of right numbers against the probability that was stated, by method.

    The bins are those of :func:`~gda_tracker.evaluation.formation_results.calibration_bins`.
    """
    with canvas(5.6, 4.6) as figure:
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, lw=1.2)
        for index, (name, bins) in enumerate(methods.items()):
            if not bins:
                continue  # no formation held a track
            size = np.sqrt([entry["samples"] for entry in bins])
            axes.scatter(
                [entry["stated"] for entry in bins],
                [entry["right"] for entry in bins],
                s=20.0 + 200.0 * size / size.max(),
                color=colour(index),
                alpha=0.75,
                label=name,
            )
        axes.set(
            xlim=(0.0, 1.03),
            ylim=(-0.03, 1.03),
            xlabel="stated probability of the most probable number",
            ylabel="share of right numbers",
        )
        if any(methods.values()):
            axes.legend()
    return figure
