#!/usr/bin/env python3
"""Draw the picture of docs/layers.md: what RViz and Foxglove get, layer by layer.

    python scripts/make_layers_picture.py [--output docs/images/layers.png] [--scans 13] [--seed 1]

It tracks the crossing targets with the offline ring, makes the bytes that node ``markers`` would
publish, reads them back by the definition of the messages and draws every marker as a viewer does.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse, FancyArrow

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.io.bag_types import type_store  # noqa: E402
from gda_tracker.io.markers import shapes  # noqa: E402
from gda_tracker.io.markers.cdr import ADD, DELETE_ALL, marker_array  # noqa: E402
from gda_tracker.io.markers.layers import Layers, Update  # noqa: E402
from gda_tracker.io.markers.parameters import (  # noqa: E402
    LAYERS,
    MARKER_ARRAY,
    MarkerParameters,
    marker_topic,
)
from gda_tracker.simulation.playback import of_scenario, with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402

METHOD = "mht/bayes/imm"
BACKGROUND, INK = "#101820", "#c8d0d8"
PARAMETERS = MarkerParameters(scale=150.0, velocity_s=15.0, detection_persistence_s=25.0)
CENTRE_M, HALF_M = (-3000.0, 25_000.0), 6500.0

Shown = dict[str, dict[tuple[str, int], Any]]


def show(shown: Shown, updates: list[Update]) -> None:
    """Take updates as a viewer takes the messages."""
    for update in updates:
        data = marker_array(update, PARAMETERS)
        layer = shown.setdefault(update.layer, {})
        for marker in type_store().deserialize_cdr(data, MARKER_ARRAY).markers:
            if marker.action == DELETE_ALL:
                layer.clear()
            elif marker.action == ADD:
                layer[marker.ns, marker.id] = marker
            else:
                del layer[marker.ns, marker.id]


def run(scans: int, seed: int) -> Shown:
    """Return what the layers show after so many scans."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, seed, METHOD)
    preset = with_method(tracker_preset(scenario), METHOD)
    ring = Ring({**preset, "track_manager": {**preset["track_manager"], "mht_scans": 4}})
    ring.initialise(play.initial)
    layers, shown = Layers(lambda _: True), Shown()
    for detections in play.detections[:scans]:
        result = ring.process(detections)
        assert result.scan is not None
        assert result.predictions is not None
        assert result.tracks is not None
        show(shown, layers.take_scan(result.scan, PARAMETERS))
        show(shown, layers.take_predictions(result.predictions, PARAMETERS))
        show(shown, layers.take_tracks(result.tracks, PARAMETERS))
        for tracks in result.delayed:
            show(shown, layers.take_delayed(tracks, PARAMETERS))
    return shown


def draw(axes: Any, m: Any, faint: bool) -> None:
    """Draw one marker, sizes in metres as they are."""
    colour = (m.color.r, m.color.g, m.color.b, 0.25 * m.color.a if faint else m.color.a)
    x, y = m.pose.position.x, m.pose.position.y
    yaw = 2.0 * math.atan2(m.pose.orientation.z, m.pose.orientation.w)
    points = np.array([(p.x, p.y) for p in m.points]).reshape(-1, 2)
    if m.type in (shapes.SPHERE, shapes.CYLINDER):
        axes.add_patch(Ellipse((x, y), m.scale.x, m.scale.y, angle=math.degrees(yaw), color=colour))
    elif m.type == shapes.SPHERE_LIST:
        for point in points:
            axes.add_patch(Ellipse(point, m.scale.x, m.scale.y, color=colour))
    elif m.type == shapes.LINE_STRIP:
        axes.plot(*points.T, color=colour, linewidth=1.2)
    elif m.type == shapes.LINE_LIST:
        for pair in points.reshape(-1, 2, 2):
            axes.plot(*pair.T, color=colour, linewidth=1.2)
    elif m.type == shapes.ARROW:
        along = m.scale.x * np.array([math.cos(yaw), math.sin(yaw)])
        axes.add_patch(
            FancyArrow(x, y, *along, width=0.3 * m.scale.y, head_width=1.5 * m.scale.y,
                       length_includes_head=True, color=colour)
        )  # fmt: skip
    elif m.type == shapes.TEXT and not faint:
        axes.text(x, y + m.scale.z, m.text, color=colour, fontsize=7, ha="center", clip_on=True)


def main(arguments: list[str] | None = None) -> int:
    """Draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/layers.png")
    parser.add_argument("--scans", type=int, default=13)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    shown = run(args.scans, args.seed)
    figure, grid = plt.subplots(2, 5, figsize=(15, 6.6), facecolor=BACKGROUND)
    # Formations have a scenario and a picture of their own (make_formation_layer_picture.py).
    layers = [layer for layer in LAYERS if layer != "formations"]
    for axes, layer in zip(grid.flat, layers, strict=True):
        axes.set_facecolor(BACKGROUND)
        for marker in shown["trails"].values():
            draw(axes, marker, faint=True)
        for marker in shown.get(layer, {}).values():
            draw(axes, marker, faint=False)
        axes.set_title(marker_topic(layer), color=INK, fontsize=10, family="monospace")
        centre = (0.0, 0.0) if layer == "sensors" else CENTRE_M
        axes.set_xlim(centre[0] - HALF_M, centre[0] + HALF_M)
        axes.set_ylim(centre[1] - HALF_M, centre[1] + HALF_M)
        axes.set_aspect("equal")
        axes.set_xticks([])
        axes.set_yticks([])
        for side in axes.spines.values():
            side.set_color("#40505c")
    figure.tight_layout()
    args.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(args.output, dpi=80, facecolor=BACKGROUND)
    print(f"{args.output}: {args.output.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
