#!/usr/bin/env python3
"""Draw docs/images/formation_layer.png from the bytes that the node ``markers`` publishes.

    python scripts/make_formation_layer_picture.py [--seed 1]

It needs the environment of the tests: messages and matplotlib.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "test" / "io"))

import matplotlib  # noqa: E402

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
from marker_viewer import Viewer  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from gda_tracker.formations.tracker import FormationTracker  # noqa: E402
from gda_tracker.io.markers.cdr import marker_array  # noqa: E402
from gda_tracker.io.markers.layers import Layers  # noqa: E402
from gda_tracker.io.markers.parameters import MarkerParameters, marker_topic  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from scripts.make_layers_picture import BACKGROUND, INK, draw  # noqa: E402

SHOWN = ("tracks", "trails", "formations")
# Before the merger, with it, and after the split.
SCANS = (27, 36, 56)
PARAMETERS = MarkerParameters(
    track_size_m=250.0, formation_margin_m=350.0, label_size_m=300.0, trail_scans=20
)


def panels(seed: int) -> list[dict[str, dict[Any, Any]]]:
    """What a viewer shows of each layer after the scans of the picture."""
    scenario = load_scenario("formations")
    preset = tracker_preset(scenario, "automatic")
    preset["track_manager"].update(decision="map", attribute_term="none")
    ring, formations = Ring(preset), FormationTracker()
    layers, viewers = Layers(lambda name: name in SHOWN), {name: Viewer() for name in SHOWN}
    found = []
    for number, detections in enumerate(simulate(scenario, seed).detections, 1):
        result = ring.process(detections)
        assert result.tracks is not None
        updates = layers.take_tracks(result.tracks, PARAMETERS)
        told = formations.take(result.tracks, result.scan, result.predictions)
        updates += layers.take_formations(told, PARAMETERS)
        for update in updates:
            content = deserialize_message(marker_array(update, PARAMETERS), MarkerArray)
            viewers[update.layer].take(content)
        if number in SCANS:
            found.append({name: dict(viewer.shown) for name, viewer in viewers.items()})
    return found


def main(arguments: list[str] | None = None) -> int:
    """Draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/formation_layer.png")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    figure, grid = plt.subplots(len(SCANS), 1, figsize=(11, 11), facecolor=BACKGROUND)
    for axes, scan, shown in zip(grid, SCANS, panels(args.seed), strict=True):
        axes.set_facecolor(BACKGROUND)
        for name in SHOWN:
            for marker in shown[name].values():
                draw(axes, marker, faint=name == "trails")
        places = [m.pose.position for m in shown["tracks"].values()]
        north = sorted(place.y for place in places)[len(places) // 2]
        axes.set_xlim(-15_500.0, 10_500.0)
        axes.set_ylim(north - 3_000.0, north + 4_500.0)
        axes.set_aspect("equal")
        axes.set_title(
            f"{marker_topic('formations')}, scan {scan}", color=INK, fontsize=10, family="monospace"
        )
        axes.set_xticks([])
        axes.set_yticks([])
    figure.tight_layout()
    figure.savefig(args.output, dpi=80, facecolor=BACKGROUND)
    print(f"{args.output}: {args.output.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
