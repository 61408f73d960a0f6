#!/usr/bin/env python3
"""Track real trajectories through a simulated radar; write docs/simulated-radar.md.

    python scripts/measure_simulated_radar.py [--runs 2] [--seed 1]

Every method tracks the same scans. The same numbers come from
``gda-tracker evaluate FILE --adapter ais --runs N --seed S``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import canvas, png  # noqa: E402
from gda_tracker.evaluation.recordings import (  # noqa: E402
    DEFAULT_METHODS,
    HEAD,
    RecordingScore,
    cells,
    score_method,
    track_recording,
)
from gda_tracker.io.adapters import InputOptions, load_recording  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

FILES = {"ais": "solent_ais_15min.csv", "uav": "uav.csv"}
# East and North [km] of the picture on the right: where it is crowded.
DETAIL = {"ais": ((-3.5, 0.5), (0.0, 4.0)), "uav": None}
TITLES = {"ais": "Ships in the Solent, 15 min", "uav": "One drone, 16 min"}


def load(kind: str, seed: int, run: int) -> Recording:
    """One run of a file of trajectories."""
    path = ROOT / "data" / "trajectories" / FILES[kind]
    return load_recording(path, kind, InputOptions(seed=seed, run=run))


def seen_by_type(recordings: Sequence[Recording]) -> list[tuple[str, str, str]]:
    """Type, number of targets and share of scans with a detection."""
    there: dict[str, int] = {}
    seen: dict[str, int] = {}
    ids: dict[str, set[int]] = {}
    for recording in recordings:
        for one in recording.truth or []:
            detected = set(np.asarray(one.source_id).tolist())
            for target, kind in zip(one.target_id.tolist(), one.target_class, strict=True):
                there[kind] = there.get(kind, 0) + 1
                seen[kind] = seen.get(kind, 0) + (target in detected)
                ids.setdefault(kind, set()).add(target)
    return [
        (kind, str(len(ids[kind])), f"{seen[kind] / there[kind]:.3f}") for kind in sorted(there)
    ]


def draw(kind: str, recording: Recording, tracks: Sequence[Tracks], method: str) -> Any:
    """Draw detections, true paths and confirmed tracks; each track has a colour of its own."""
    detail = DETAIL[kind]
    paths: dict[int, list[np.ndarray]] = {}
    for one in recording.truth or []:
        for target, state in zip(one.target_id.tolist(), one.target_state, strict=True):
            paths.setdefault(target, []).append(state[:2])
    points = np.concatenate(
        [
            scan.range_m[:, None]
            * np.stack([np.cos(scan.azimuth_rad), np.sin(scan.azimuth_rad)], axis=1)
            for scan in recording.detections
        ]
    )
    followed: dict[int, list[np.ndarray]] = {}
    for scan in tracks:
        for row in np.flatnonzero(scan.status == CONFIRMED):
            followed.setdefault(int(scan.track_id[row]), []).append(scan.mean[row, :2])
    with canvas(12.0 if detail else 8.0, 6.0) as figure:
        panels = figure.subplots(1, 2 if detail else 1, squeeze=False)[0]
        for number, axes in enumerate(panels):
            axes.plot(*(points.T / 1000), ",", color="0.75", zorder=0)
            for track, way in followed.items():
                axes.plot(*(np.array(way).T / 1000), lw=1.6, color=f"C{track % 10}", zorder=1)
            for way in paths.values():
                axes.plot(*(np.array(way).T / 1000), lw=0.6, color="black", zorder=2)
            axes.plot(0.0, 0.0, "^", color="black", ms=7)
            axes.set(xlabel="East [km]", ylabel="North [km]", aspect="equal")
            if detail and number == 1:
                axes.set(xlim=detail[0], ylim=detail[1], title="detail")
                continue
            box = np.concatenate([np.array(way) for way in paths.values()] + [np.zeros((1, 2))])
            low, high = box.min(axis=0) / 1000, box.max(axis=0) / 1000
            margin = 0.06 * float((high - low).max())
            axes.set(
                xlim=(low[0] - margin, high[0] + margin),
                ylim=(low[1] - margin, high[1] + margin),
                title=f"{TITLES[kind]}, {method}: {len(followed)} tracks",
            )
    return figure


def main() -> int:
    """Measure, and write tables and pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    page = ROOT / "docs" / "simulated-radar.md"
    for kind in FILES:
        recordings = [load(kind, args.seed, run) for run in range(args.runs)]
        scores: list[RecordingScore] = []
        for method in DEFAULT_METHODS:
            scores.append(score_method(recordings, method))
            print(f"{kind}: {' '.join(cells(scores[-1]))}", flush=True)
        first = scores[0]
        text = (
            f"{first.targets:g} targets, {len(recordings[0].detections)} scans, {args.runs} runs "
            f"of seed {args.seed}, match distance {first.match_distance_m:.0f} m:\n\n"
        )
        text += markdown(HEAD, [cells(score) for score in scores]) + "\n\n"
        text += markdown(("type", "targets", "share of scans seen"), seen_by_type(recordings))
        write_section(page, f"{kind} table", text)
        results, _ = track_recording(recordings[0], DEFAULT_METHODS[0])
        tracks = [result.tracks for result in results if result.tracks is not None]
        picture = ROOT / "docs" / "images" / f"simulated_radar_{kind}.png"
        picture.write_bytes(png(draw(kind, recordings[0], tracks, DEFAULT_METHODS[0])))
        print(f"{picture} and {page}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
