#!/usr/bin/env python3
"""Measure what statements do to an association: the table and the picture of docs/statements.md.

    python scripts/measure_statements.py [--runs 300] [--seed 1] [--output PICTURE.png]

A fighter and a cargo aircraft fly towards each other's line. Then the radar is silent for 35 s. In
half of the runs they have crossed when it comes back, in the other half they have turned away; what
is predicted fits both. With the first scan after the gap somebody says something. Every variant
tracks the same runs.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.attributes.rcs import sample  # noqa: E402
from gda_tracker.evaluation.figures.canvas import (  # noqa: E402
    GREY,
    INK,
    canvas,
    colour,
    legend_below,
    png,
)
from gda_tracker.evaluation.results import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from gda_tracker.vocabulary.scans import Detections, ScanTruth  # noqa: E402
from gda_tracker.vocabulary.statements import (  # noqa: E402
    Statement,
    StatementPiece,
    StatementRegion,
)
from gda_tracker.vocabulary.tracks import Tracks  # noqa: E402

SECOND = 1_000_000_000
FIGHTER, CARGO = 0, 1
# Three scans, a gap, eight scans [s]; the tracks start from the first two.
TIMES = (0, 5, 10, *range(45, 85, 5))
FIRST_AFTER, LABELLED = 3, 2
SENSOR = np.array([0.0, -20_000.0])
RANGE_STD_M, AZIMUTH_STD_RAD = 60.0, math.radians(0.3)
DETECTION_PROBABILITY, CLUTTER_PER_SCAN = 0.95, 0.5
REGION = np.array([[-2_000.0, 14_000.0], [-3_000.0, 3_000.0]])
RCS_MEAN_M2, RCS_SWERLING = np.array([1.2, 4.0]), np.array([3, 3])
# How well people see and say it.
BUOY_STD_M, BUOY_ERROR_M = 300.0, 100.0
POST = np.array([0.0, 0.0])
SECTOR_RAD, BEARING_ERROR_RAD = math.radians(4.0), math.radians(1.0)

PARAMETERS = {
    "track_manager": {
        "initiation": "labelled",
        "deletion_misses": 0,
        "range_std_m": RANGE_STD_M,
        "azimuth_std_rad": AZIMUTH_STD_RAD,
        "process_noise_std_mps2": 1.0,
        "detection_probability": DETECTION_PROBABILITY,
        # Detections per scan over the area in range and azimuth.
        "clutter_density_per_m_rad": CLUTTER_PER_SCAN / (6_000.0 * 0.8),
    }
}


@dataclass(frozen=True)
class Run:
    """One simulated run: what the radar saw, and where the fighter and the cargo aircraft were."""

    recording: Recording
    position: np.ndarray
    buoy_error: np.ndarray
    bearing_error: float


def simulate(seed: int, run: int) -> Run:
    """Simulate a run; it depends on seed and number alone."""
    random = np.random.default_rng([seed, run])
    crossed = random.random() < 0.5
    times = np.array(TIMES, dtype=float)
    y = 600.0 - 20.0 * times
    if not crossed:
        y = np.abs(y)
    position = np.stack(
        [np.stack([120.0 * times, y], axis=1), np.stack([120.0 * times, -y], axis=1)], axis=1
    )
    detections, truth = [], []
    for step, time in enumerate(TIMES):
        seen = random.random(2) < DETECTION_PROBABILITY
        seen |= step < LABELLED
        clutter = random.uniform(*REGION.T, (random.poisson(CLUTTER_PER_SCAN), 2))
        places = np.concatenate([position[step][seen], clutter]) - SENSOR
        rcs = np.concatenate(
            [sample(random, RCS_MEAN_M2, RCS_SWERLING, (2,))[seen],
             random.exponential(0.3, len(clutter))]
        )  # fmt: skip
        source = np.concatenate([np.flatnonzero(seen), np.full(len(clutter), -1)])
        order, n = random.permutation(len(places)), len(places)
        detections.append(
            Detections(
                "radar",
                time * SECOND,
                (np.hypot(*places.T) + random.normal(0.0, RANGE_STD_M, n))[order],
                (np.arctan2(places[:, 1], places[:, 0])
                 + random.normal(0.0, AZIMUTH_STD_RAD, n))[order],
                rcs_m2=rcs[order],
                sensor_position_m=np.array([*SENSOR, 0.0]),
            )
        )  # fmt: skip
        truth.append(
            ScanTruth(
                "radar",
                time * SECOND,
                np.array([FIGHTER, CARGO], dtype=np.int32),
                np.hstack([position[step], np.zeros((2, 2))]),
                source[order].astype(np.int32),
            )
        )
    return Run(
        Recording("gap", detections, truth),
        position,
        random.normal(0.0, BUOY_ERROR_M, 2),
        random.normal(0.0, BEARING_ERROR_RAD),
    )


def _said(about: str, piece: StatementPiece, reliability: float) -> Statement:
    stamp_ns = TIMES[FIRST_AFTER] * SECOND
    return Statement(
        "lookout", 1, stamp_ns, "fuzzy", about, (piece,), 1, reliability, frame_id="map"
    )


def by_the_buoy(run: Run, target: int, reliability: float) -> Statement:
    """Say "the fighter is by the buoy", which is where ``target`` is."""
    x, y = (float(value) for value in run.position[FIRST_AFTER, target] + run.buoy_error)
    shape = (BUOY_STD_M**2, 0.0, 0.0, BUOY_STD_M**2)
    region = StatementRegion("gaussian", centre_m=(x, y), covariance_m2=shape)
    return _said("place", StatementPiece(region, ("fighter",), (1.0,)), reliability)


def track_is(name: str, reliability: float) -> Statement:
    """Say "track 1 is a fighter", or something else."""
    return _said("track", StatementPiece(class_names=(name,), class_grades=(1.0,)), reliability)


def in_the_sector(run: Run, target: int, reliability: float) -> Statement:
    """Say "track 1 is in this sector", in which ``target`` is."""
    x, y = run.position[FIRST_AFTER, target] - POST
    bearing = math.atan2(y, x) + run.bearing_error
    region = StatementRegion(
        "sector",
        (float(POST[0]), float(POST[1])),
        first_bearing_rad=bearing - 0.5 * SECTOR_RAD,
        opening_rad=SECTOR_RAD,
    )
    return _said("track", StatementPiece(region), reliability)


Say = Callable[[Run], Statement]
VARIANTS: dict[str, Say | None] = {
    "nothing": None,
    "the fighter is by the buoy": lambda run: by_the_buoy(run, FIGHTER, 0.95),
    "track 1 is a fighter": lambda run: track_is("fighter", 0.95),
    "track 1 is in this sector": lambda run: in_the_sector(run, FIGHTER, 0.95),
    "wrong: it is the cargo by the buoy, .5": lambda run: by_the_buoy(run, CARGO, 0.5),
    "wrong: it is the cargo by the buoy, .95": lambda run: by_the_buoy(run, CARGO, 0.95),
    "wrong: track 1 is a cargo, .5": lambda run: track_is("cargo", 0.5),
    "wrong: track 1 is in the cargo's sector, .5": lambda run: in_the_sector(run, CARGO, 0.5),
}
METHODS = ("map/none/cv", "map/bayes/cv", "gda/dsm_classic/cv")


def track(method: str, run: Run, say: Say | None) -> list[Tracks]:
    """Track a run; one entry per scan after the labelled ones."""
    ring = Ring(with_method(PARAMETERS, method))
    ring.initialise(labelled_tracks(run.recording, LABELLED, ring))
    found = []
    for step in range(LABELLED, len(TIMES)):
        if say is not None and step == FIRST_AFTER:
            report = ring.say(say(run))
            assert report.outcome == "admitted", report
        result = ring.process(run.recording.detections[step])
        assert result.tracks is not None
        found.append(result.tracks)
    return found


def kept(tracks: list[Tracks], run: Run) -> bool:
    """Whether at the end each track is nearer to its own aircraft than to the other."""
    place = {int(i): mean for i, mean in zip(tracks[-1].track_id, tracks[-1].mean, strict=True)}
    ends = run.position[-1]
    gap = [[float(np.hypot(*(place[t + 1][:2] - end))) for end in ends] for t in (FIGHTER, CARGO)]
    return gap[0][0] < gap[0][1] and gap[1][1] < gap[1][0]


def measure(
    runs: int, seed: int, methods: tuple[str, ...] = METHODS
) -> dict[tuple[str, str], np.ndarray]:
    """Whether each run (R,) kept its tracks, by method and variant."""
    simulated = [simulate(seed, run) for run in range(runs)]
    return {
        (method, name): np.array([kept(track(method, run, say), run) for run in simulated], float)
        for method in methods
        for name, say in VARIANTS.items()
    }


def table(found: dict[tuple[str, str], np.ndarray]) -> str:
    """Markdown: the share of runs whose tracks were kept, and its standard error."""
    lines = ["| said | " + " | ".join(f"`{m}`" for m in METHODS) + " |", "|---" * 4 + "|"]
    for name in VARIANTS:
        cells = []
        for method in METHODS:
            mean, error = mean_and_stderr(found[method, name])
            cells.append(f"{mean:.3f} +- {error:.3f}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def differences(found: dict[tuple[str, str], np.ndarray]) -> str:
    """Paired differences to saying nothing, with their standard errors, a line each."""
    lines = []
    for (method, name), values in found.items():
        if name != "nothing":
            mean, error = mean_and_stderr(values - found[method, "nothing"])
            lines.append(f"{method}, {name}: {mean:+.3f} +- {error:.3f}")
    return "\n".join(lines)


def picture(run: Run, method: str, names: tuple[str, ...]) -> Any:
    """Draw a run with several variants, side by side."""
    with canvas(3.6 * len(names), 4.4) as figure:
        panels = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
        for panel, name in zip(panels, names, strict=True):
            say = VARIANTS[name]
            tracks = track(method, run, say)
            _draw(panel, run, tracks, None if say is None else say(run))
            good = "kept" if kept(tracks, run) else "swapped"
            said = f'"{name}"' if say is not None else "nothing is said"
            panel.set_title(f"{said}\n{good}", fontsize=10)
            panel.set_xlabel("x [km]")
        panels[0].set_ylabel("y [km]")
        legend_below(figure, panels[0], 4)
    return figure


def _draw(panel: Any, run: Run, tracks: list[Tracks], statement: Statement | None) -> None:
    for target, name in ((FIGHTER, "the fighter's path"), (CARGO, "the cargo aircraft's path")):
        path = run.position[:, target] / 1e3
        panel.plot(*path.T, color=colour(target), lw=6, alpha=0.25, label=name)
    for detections in run.recording.detections:
        x = detections.range_m * np.cos(detections.azimuth_rad) + SENSOR[0]
        y = detections.range_m * np.sin(detections.azimuth_rad) + SENSOR[1]
        panel.plot(x / 1e3, y / 1e3, ".", color=GREY, ms=3)
    for track_id in (1, 2):
        path = np.array([t.mean[t.track_id == track_id][0, :2] for t in tracks]) / 1e3
        panel.plot(*path.T, "o-", color=colour(track_id - 1), ms=3, lw=1, label=f"track {track_id}")
    if statement is not None:
        region = statement.pieces[0].region
        if region.shape == "gaussian":
            angle = np.linspace(0.0, 2.0 * np.pi, 100)
            for radius in (1.0, 2.0):
                ring = np.array([np.cos(angle), np.sin(angle)]) * radius * BUOY_STD_M
                panel.plot(*((ring.T + region.centre_m) / 1e3).T, color=INK, lw=0.8, ls="--")
        elif region.shape == "sector":
            for bearing in (
                region.first_bearing_rad,
                region.first_bearing_rad + region.opening_rad,
            ):
                end = np.array(region.centre_m) + 10_500.0 * np.array(
                    [math.cos(bearing), math.sin(bearing)]
                )
                line = np.stack([region.centre_m, end]) / 1e3
                panel.plot(*line.T, color=INK, lw=0.8, ls="--")
    panel.set_xlim(-0.3, 12.0)
    panel.set_ylim(-1.6, 1.6)


SHOWN = (
    "nothing",
    "the fighter is by the buoy",
    "track 1 is a fighter",
    "track 1 is in this sector",
)


def main(arguments: list[str] | None = None) -> int:
    """Print the table and draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/statements.png")
    parser.add_argument("--shown", type=int, help="only draw this run")
    args = parser.parse_args(arguments)
    method, shown = "map/bayes/cv", args.shown
    if shown is None:
        found = measure(args.runs, args.seed)
        print(table(found), differences(found), sep="\n\n")
        swapped = np.flatnonzero(found[method, "nothing"] == 0.0)
        mended = [r for r in swapped if all(found[method, name][r] for name in SHOWN[1:])]
        if not mended:
            print("no run in which every statement keeps what is swapped without")
            return 1
        shown = int(mended[0])
    figure = picture(simulate(args.seed, shown), method, SHOWN)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_bytes(png(figure, 110))
    print(f"{args.output}: run {shown}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
