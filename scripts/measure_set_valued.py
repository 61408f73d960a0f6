#!/usr/bin/env python3
"""Measure set-valued tracking against MHT: tables and pictures of docs/set-valued-tracking.md.

    python scripts/measure_set_valued.py [--runs 24] [--seed 0] [--redraw]

Both trackers get the same scans of three crossing targets, and are told the same about radar and
targets. What was measured is kept in docs/set_valued_tracking.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.commands.demo_set_valued import CROSSING_SAMPLE, track_crossing  # noqa: E402
from gda_tracker.evaluation.figures import png  # noqa: E402
from gda_tracker.evaluation.figures.canvas import canvas, colour  # noqa: E402
from gda_tracker.evaluation.figures.track_sets import crossing_tracks_figure  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.evaluation.track_sets import covering, undecided  # noqa: E402
from gda_tracker.parameters import from_mapping  # noqa: E402
from gda_tracker.simulation.crossing_tracks import (  # noqa: E402
    CrossingTracks,
    ring_preset,
    set_valued_preset,
    simulate_crossing_tracks,
)
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters  # noqa: E402
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker  # noqa: E402
from gda_tracker.vocabulary.scans import Detections, ScanTruth  # noqa: E402
from gda_tracker.vocabulary.track_sets import TrackSetArray  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

SCENES = {
    "clear": CrossingTracks(),
    "coarse": CrossingTracks(range_std_m=60.0, azimuth_std_rad=0.008, detection_probability=0.95),
    "misses and clutter": CrossingTracks(detection_probability=0.9, clutter=3.0),
}
MHT = "mht/none/cv"
BOLDNESS, THETA = (0.01, 0.5, 1.0), (3.0, 6.0, 10.0)
# Samples, from 0: scored at all; before the crossing, where it is known who is who; at the
# crossing; at the end.
SCORED, KNOWN, CROSSING, END = slice(4, None), slice(5, 7), slice(8, 14), slice(20, None)
# Nothing is merged, thrown out or capped.
UNMANAGED = {
    "merge_distance": 0.0,
    "merge_scans": 16,
    "duplicate_scans": 0,
    "score_margin": 1e9,
    "max_sets_per_track": 100,
    "max_sets": 10_000,
}
COLUMNS = ("ambiguous", "covered", "own_at_crossing", "own_at_end", "sets_per_target", "tracks")

Measured = dict[str, dict[str, dict[str, list[float]]]]


def sets_of_tracks(tracks: Tracks) -> TrackSetArray:
    """Tracks as sets that are points."""
    n = len(tracks)
    return TrackSetArray(
        tracks.key,
        track_id=tracks.track_id,
        status=tracks.status,
        best=np.ones(n, dtype=bool),
        centroid=tracks.mean,
        covariance=tracks.covariance,
        matrix=np.zeros((n, 4, 4)),
        may_own_start=np.zeros(n + 1, dtype=np.int64),
    )


def by_sets(
    model: CrossingTracks, scans: Sequence[Detections], **changes: Any
) -> list[TrackSetArray]:
    """What the set-valued tracker makes of the scans."""
    table = from_mapping(SetValuedParameters, {**set_valued_preset(model), **changes})
    tracker = SetValuedTracker(table)
    found = [tracker.process(scan)[0] for scan in scans]
    return [sets for sets in found if sets is not None]


def by_mht(model: CrossingTracks, scans: Sequence[Detections]) -> list[TrackSetArray]:
    """What the ring makes of the scans, at once, without delay."""
    preset: dict[str, dict[str, Any]] = {k: dict(v) for k, v in ring_preset(model).items()}
    decision, term, kind = MHT.split("/")
    preset["track_manager"] |= {"decision": decision, "attribute_term": term, "filter": kind}
    ring = Ring(preset)
    found = [ring.process(scan).tracks for scan in scans]
    return [sets_of_tracks(tracks) for tracks in found if tracks is not None]


def scores(sets: Sequence[TrackSetArray], truth: Sequence[ScanTruth]) -> dict[str, float]:
    """Figures of one run; only sets of confirmed tracks count.

    ``ambiguous``: share of scans with an open association. ``covered``: share of targets, over the
    scans, that a kept set covers. ``own_at_crossing``, ``own_at_end``: the same by a set of the
    track whose leading set covered the target before the crossing. ``sets_per_target``,
    ``tracks``: means.
    """
    count = len(truth[0].target_id)
    good = [s.status == CONFIRMED for s in sets]
    covers = [
        covering(s, t.target_state[:, :2]) & g for s, t, g in zip(sets, truth, good, strict=True)
    ]
    owners = [_owner(target, sets[KNOWN], covers[KNOWN]) for target in range(count)]
    own = np.array(
        [
            [bool(c[i, s.track_id == owners[i]].any()) for i in range(count)]
            for s, c in zip(sets, covers, strict=True)
        ]
    )
    seen = np.array([c.any(axis=1) for c in covers])
    kept = [int(np.count_nonzero(g)) for g in good]
    tracks = [len(np.unique(s.track_id[g])) for s, g in zip(sets, good, strict=True)]
    open_scan = [bool((undecided(s) & g).any()) for s, g in zip(sets, good, strict=True)]
    values = {
        "ambiguous": np.mean(open_scan[SCORED]),
        "covered": np.mean(seen[SCORED]),
        "own_at_crossing": np.mean(own[CROSSING]),
        "own_at_end": np.mean(own[END]),
        "sets_per_target": np.mean(kept[SCORED]) / count,
        "tracks": np.mean(tracks[SCORED]),
    }
    return {name: float(value) for name, value in values.items()}


def _owner(target: int, sets: Sequence[TrackSetArray], covers: Sequence[np.ndarray]) -> int:
    """Track whose leading set covers a target most often, -1 for none; of several the oldest."""
    found: list[int] = []
    for one, cover in zip(sets, covers, strict=True):
        found += np.unique(one.track_id[cover[target] & one.best]).tolist()
    return max(sorted(set(found)), key=found.count, default=-1)


def measure(runs: int, seed: int) -> Measured:
    """Scores by scene, tracker and name, a list over the runs."""
    found: Measured = {}
    for scene, model in SCENES.items():
        of_scene = found.setdefault(scene, {})
        for run in range(runs):
            scans, truth = simulate_crossing_tracks(model, seed + run)
            results = {MHT: by_mht(model, scans)}
            for b in BOLDNESS:
                for theta in THETA:
                    name = f"sets b={b:g} theta={theta:g}"
                    results[name] = by_sets(model, scans, boldness=b, theta=theta)
            for name, sets in results.items():
                of_run = scores(sets, truth)
                for column, value in of_run.items():
                    of_scene.setdefault(name, {}).setdefault(column, []).append(round(value, 6))
        print(f"measured: {scene}", file=sys.stderr, flush=True)
    return found


def growth(seed: int) -> dict[str, list[int]]:
    """Sets after each of ten samples of the clear scene, with and without management."""
    model = SCENES["clear"]
    scans, _ = simulate_crossing_tracks(model, seed)
    return {
        name: [len(s) for s in by_sets(model, scans[:10], **changes)]
        for name, changes in (("managed", {}), ("unmanaged", UNMANAGED))
    }


def table_of(measured: Measured, scene: str) -> str:
    """Markdown: a row per tracker."""
    head = ["tracker", "b", "theta", "open scans", "covered", "own track, crossing"]
    head += ["own track, end", "sets per target", "tracks"]
    rows = []
    for name, values in measured[scene].items():
        parts = name.replace("b=", "").replace("theta=", "").split()
        first = [*parts] if len(parts) == 3 else [f"`{name}`", "-", "-"]
        cells = []
        for column in COLUMNS:
            mean, error = mean_and_stderr(np.array(values[column]))
            if column in ("own_at_crossing", "own_at_end"):
                cells.append(f"{mean:.3f} +- {error:.3f}")
            elif column == "ambiguous" and len(parts) < 3:
                cells.append("-")
            else:
                cells.append(f"{mean:.3f}" if column == "covered" else f"{mean:.2f}")
        rows.append([*first, *cells])
    return markdown(head, rows)


def growth_table(grown: dict[str, list[int]]) -> str:
    """Markdown: sets by sample."""
    head = ["sample", *map(str, range(1, 11))]
    return markdown(head, [[name, *map(str, counts)] for name, counts in grown.items()])


def picture(measured: Measured) -> bytes:
    """Coverage over the number of sets that it takes: colours are theta, marks are b."""
    marks = dict(zip(BOLDNESS, "v^s", strict=True))
    with canvas(11.5, 3.9) as figure:
        panels = figure.subplots(1, len(measured), sharey=True)
        for axes, (scene, trackers) in zip(panels, measured.items(), strict=True):
            for rank, theta in enumerate(THETA):
                for b in BOLDNESS:
                    label = f"theta = {theta:g}, b = {b:g}"
                    values = trackers[f"sets b={b:g} theta={theta:g}"]
                    _mark(axes, values, marks[b], colour(rank), label)
            _mark(axes, trackers[MHT], "*", "#222222", MHT)
            axes.set_title(scene)
            axes.set_xlabel("sets per target")
        panels[0].set_ylabel("share of targets covered")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return png(figure)


def _mark(axes: Any, values: dict[str, list[float]], mark: str, tint: str, label: str) -> None:
    mean, error = mean_and_stderr(np.array(values["covered"]))
    at = np.mean(values["sets_per_target"])
    axes.errorbar(
        [at], [mean], yerr=[error], fmt=mark, color=tint, ms=8, alpha=0.8, lw=1, label=label
    )


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument(
        "--redraw", action="store_true", help="measure nothing; tables and pictures of what is kept"
    )
    args = parser.parse_args(arguments)
    kept = args.docs / "set_valued_tracking.json"
    if args.redraw:
        content = json.loads(kept.read_text(encoding="utf-8"))
        measured, grown = content["scenes"], content["growth"]
    else:
        measured, grown = measure(args.runs, args.seed), growth(args.seed)
        content = {"runs": args.runs, "seed": args.seed, "growth": grown, "scenes": measured}
        kept.write_text(json.dumps(content, separators=(",", ":")) + "\n", encoding="utf-8")
    document = args.docs / "set-valued-tracking.md"
    for scene in SCENES:
        write_section(document, f"set-valued {scene}", table_of(measured, scene))
    write_section(document, "set-valued growth", growth_table(grown))
    images = args.docs / "images"
    images.mkdir(exist_ok=True)
    (images / "set_valued_trade_off.png").write_bytes(picture(measured))
    shown = track_crossing(1)
    figure = crossing_tracks_figure(
        shown.detections, shown.truth, shown.sets, around=CROSSING_SAMPLE
    )
    (images / "set_valued_crossing.png").write_bytes(png(figure, dpi=100))
    print(f"written: {kept}, tables of {document}, two pictures in {images}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
