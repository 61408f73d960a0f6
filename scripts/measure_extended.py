#!/usr/bin/env python3
"""Measure the tracking of extended objects; write docs/extended-objects.md.

    python scripts/measure_extended.py [--runs 500] [--seed 1]

The published scenario of an ellipse that turns, then two recordings: a person who walks past a
mmWave radar, and one scan of a car's radar. Numbers also go to docs/extended_objects.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.association.extended.hypotheses import ExtendedSensor  # noqa: E402
from gda_tracker.association.extended.tracker import (  # noqa: E402
    ExtendedTracker,
    ExtendedTrackerParameters,
    ExtendedTracks,
)
from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.io.adapters import InputOptions, load_recording  # noqa: E402
from gda_tracker.kinematics.converted_measurements import unbiased_positions  # noqa: E402
from gda_tracker.kinematics.extended.ellipses import (  # noqa: E402
    extent_of,
    gaussian_wasserstein,
    outline,
    rotation,
    semi_axes,
)
from gda_tracker.kinematics.extended.random_matrix import (  # noqa: E402
    Cells,
    ExtendedStates,
    cells_of,
    feldmann_update,
    koch_update,
    predict,
)
from gda_tracker.vocabulary.scans import Detections  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

STEP_S, SPEED_MPS, AXES_M = 10.0, 500.0 / 36.0, np.array([170.0, 40.0])
NOISE = 0.2 * np.diag([100.0**2, 20.0**2])
RATE = 5.0
FILTERS = ("Koch, no noise", "Feldmann", "Feldmann, turning with the course")
# How long an extent holds, chosen on other seeds: one that turns with the course needs less
# forgetting. [s]
MEMORY_S = dict(zip(FILTERS, (20.0, 20.0, 60.0), strict=True))
MMWAVE = ROOT / "data/mmwave_walk/SOT.tar.xz"
ARS548 = ROOT / "data/continental/ars548_1708578204_202447652_detection.yaml"
# No clusters: every point. What stands still is left out by the preset of the walk; of the ARS548
# all is kept, since all of it stands still.
# Points of one body are not drawn anew on every scan, as the filter believes: its certainty of the
# extent and of the number of points is forgotten within a scan or two (0.05 s).
WALK = ExtendedTrackerParameters(
    ExtendedSensor(
        detection_probability=0.95,
        clutter_density=0.05,
        birth_density=1e-3,
        ghost_density=2e-2,
        birth_rate_rate=0.05,
        birth_radius_m=0.4,
    ),
    acceleration_density_m2ps3=2.0,
    extent_memory_s=0.02,
    rate_memory_s=0.02,
    partition_least_m=0.3,
    partition_largest_m=1.5,
)
WALK_STD = (0.03, 0.016)  # of one point: range [m], azimuth [rad]
CAR = ExtendedTrackerParameters(
    ExtendedSensor(
        clutter_density=0.01,
        birth_density=1e-3,
        birth_rate_rate=0.3,
        birth_radius_m=1.5,
        birth_weight=2.5,
    ),
    partition_least_m=0.5,
    partition_largest_m=4.0,
    partitions=12,
    log_accept=3.0,
)


def course() -> tuple[np.ndarray, np.ndarray]:
    """Orientation (K,) and centre (K, 2) of the scenario: three turns, of 45, 90 and 90 degrees."""
    quarter = np.pi / 4.0
    orientation = np.concatenate(
        [
            np.full(25, -quarter),
            np.linspace(-quarter, 0.0, 11),
            np.zeros(20),
            np.linspace(0.0, 2.0 * quarter, 11),
            np.full(15, 2.0 * quarter),
            np.linspace(2.0 * quarter, 4.0 * quarter, 11),
            np.full(40, 4.0 * quarter),
        ]
    )
    way = SPEED_MPS * STEP_S * np.stack([np.cos(orientation), np.sin(orientation)], axis=1)
    way[0] = 0.0
    return orientation, np.cumsum(way, axis=0)


def scan(
    rng: np.random.Generator, runs: int, centre: np.ndarray, extent: np.ndarray
) -> tuple[Cells, np.ndarray]:
    """Detections all over the ellipse in every run, at least one, and those of the first run."""
    count = rng.poisson(RATE, runs)
    while (count == 0).any():
        count[count == 0] = rng.poisson(RATE, int((count == 0).sum()))
    label = np.repeat(np.arange(runs), count)
    radius = np.sqrt(rng.uniform(0.0, 1.0, len(label)))
    turn = rng.uniform(0.0, 2.0 * np.pi, len(label))
    disc = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = centre + disc @ np.linalg.cholesky(extent).T
    points += rng.multivariate_normal([0.0, 0.0], NOISE, len(label))
    return cells_of(points, label, np.tile(NOISE, (len(label), 1, 1))), points[label == 0]


def benchmark(runs: int, seed: int) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Gaussian Wasserstein distances (K, runs) of each filter, and one run to draw."""
    rng = np.random.default_rng(seed)
    orientation, centre = course()
    plain = np.array([[1.0, STEP_S], [0.0, 1.0]])
    full = np.kron(plain, np.eye(2))
    start = np.array([100.0, 100.0, 5.0, -8.0])
    extent = extent_of(np.array([200.0, 90.0]), np.array(-np.pi / 3.0))

    def prior(covariance: np.ndarray) -> ExtendedStates:
        return ExtendedStates(
            np.tile(start, (runs, 1)),
            np.tile(covariance, (runs, 1, 1)),
            np.tile(extent, (runs, 1, 1)),
            np.full(runs, 50.0),
        )

    size = 2.0 * np.trace(extent) / 4.0  # twice the mean square semi-axis
    states = {name: prior(np.diag([900.0, 900.0, 400.0, 400.0])) for name in FILTERS[1:]}
    states[FILTERS[0]] = prior(np.diag([900.0, 400.0]) / size)
    noise = np.diag([100.0, 100.0, 1.0, 1.0])
    distance: dict[str, list[np.ndarray]] = {name: [] for name in FILTERS}
    drawn: dict[str, Any] = {"truth": [], "points": [], **{name: [] for name in FILTERS}}
    for k in range(len(orientation)):
        truth = extent_of(AXES_M, orientation[k])
        cells, points = scan(rng, runs, centre[k], truth)
        drawn["truth"].append((centre[k], truth))
        drawn["points"].append(points)
        for name in FILTERS:
            before = states[name]
            if k and name == FILTERS[0]:
                before = predict(
                    before, plain, np.diag([100.0, 1.0]) / size, STEP_S, MEMORY_S[name]
                )
            elif k:
                ahead = predict(before, full, noise, STEP_S, MEMORY_S[name])
                if name == FILTERS[2]:
                    ahead.extent = _turned(before, ahead, states, name)
                before = ahead
            update = koch_update if name == FILTERS[0] else feldmann_update
            states[name], _ = update(before, cells, 0.25)
            after = states[name]
            distance[name].append(
                gaussian_wasserstein(after.mean[:, :2], after.extent, centre[k], truth)
            )
            drawn[name].append((after.mean[0, :2], after.extent[0]))
    return {name: np.array(values) for name, values in distance.items()}, drawn


_HEADING = "heading"


def _turned(
    before: ExtendedStates, ahead: ExtendedStates, states: dict[str, Any], name: str
) -> np.ndarray:
    """Extents turned by as much as the estimated course turned with the last scan."""
    heading = np.arctan2(before.mean[:, 3], before.mean[:, 2])
    last = states.get(_HEADING, heading)
    states[_HEADING] = heading
    gap = (heading - last + np.pi) % (2.0 * np.pi) - np.pi
    turn = rotation(gap)
    return turn @ ahead.extent @ np.swapaxes(turn, -1, -2)


def straight_and_turning() -> dict[str, np.ndarray]:
    """Scans on straight legs, 15 scans after start or turn at least, and scans in turns."""
    orientation, _ = course()
    moving = np.diff(orientation, prepend=orientation[0]) != 0.0
    recent = np.convolve(moving, np.ones(15), "full")[: len(moving)] > 0
    recent[:15] = True
    return {"straight": ~recent, "turns": moving}


def positions_of(one: Detections, std: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2) in the sensor's axes and their covariances, by range and azimuth."""
    polar = np.stack([one.range_m, one.azimuth_rad], axis=1)
    given = (one.range_std_m, one.azimuth_std_rad)
    spread = [
        np.broadcast_to(other if value is None else value, len(polar))
        for value, other in zip(given, std, strict=True)
    ]
    noise = np.zeros((len(polar), 2, 2))
    noise[:, 0, 0], noise[:, 1, 1] = spread[0] ** 2, spread[1] ** 2
    return unbiased_positions(polar, noise)


def track_walk() -> tuple[list[ExtendedTracks], list[np.ndarray], list[float]]:
    """Track the person; tracks after each scan, detections and times."""
    options = InputOptions(radar_input={"cluster_distance_m": 0.0})
    recording = load_recording(MMWAVE, "mmwave", options)
    tracker, found, points, times = ExtendedTracker(WALK), [], [], []
    for one in recording.detections:
        at, noise = positions_of(one, WALK_STD)
        times.append((one.stamp_ns - recording.detections[0].stamp_ns) * 1e-9)
        found.append(tracker.process(times[-1], at, noise))
        points.append(at)
    return found, points, times


def walk_numbers(found: list[ExtendedTracks], times: list[float]) -> dict[str, Any]:
    """Numbers of the track that lives longest."""
    ids = np.concatenate([one.track_id[one.confirmed] for one in found])
    longest = int(np.bincount(ids).argmax())
    rows = [np.flatnonzero((one.track_id == longest) & one.confirmed) for one in found]
    there = [(one, row[0]) for one, row in zip(found, rows, strict=True) if len(row)]
    at = np.array([one.states.mean[row] for one, row in there])
    axes = semi_axes(np.array([one.states.extent[row] for one, row in there]))[0]
    counts = np.array([one.count[row] for one, row in there], dtype=float)
    reach = np.hypot(at[:, 0], at[:, 1])
    others = len(np.unique(ids)) - 1
    return {
        "scans": len(found),
        "scans_with_the_track": len(there),
        "scans_in_which_it_has_points": int((counts > 0).sum()),
        "other_confirmed_tracks": others,
        "from_m": round(float(reach[0]), 2),
        "to_m": round(float(reach[-1]), 2),
        "median_speed_mps": round(float(np.median(np.hypot(at[:, 2], at[:, 3]))), 2),
        "median_long_semi_axis_m": round(float(np.median(axes[:, 0])), 2),
        "median_short_semi_axis_m": round(float(np.median(axes[:, 1])), 2),
        "mean_detections": round(float(counts.mean()), 1),
        "mean_probability_of_the_chosen_partition": round(
            float(np.mean([one.partition_probability[0] for one in found])), 3
        ),
    }


def track_car() -> tuple[ExtendedTracks, np.ndarray, dict[str, Any]]:
    """One scan of the ARS548: new objects, the detections, and numbers."""
    options = InputOptions(radar_input={"cluster_distance_m": 0.0})
    recording = load_recording(ARS548, "continental_yaml", options)
    at, noise = positions_of(recording.detections[0], (0.3, 0.01))
    tracks = ExtendedTracker(CAR).process(0.0, at, noise)
    sure = tracks.confirmed
    axes = semi_axes(tracks.states.extent[sure])[0]
    return (
        tracks,
        at,
        {
            "detections": len(at),
            "partitions": len(tracks.partition_probability),
            "probability_of_the_chosen_partition": round(float(tracks.partition_probability[0]), 3),
            "objects": int(sure.sum()),
            "detections_in_objects": int(tracks.count[sure].sum()),
            "median_long_semi_axis_m": round(float(np.median(axes[:, 0])), 2),
            "median_short_semi_axis_m": round(float(np.median(axes[:, 1])), 2),
        },
    )


def draw_benchmark(distance: dict[str, np.ndarray], drawn: dict[str, Any]) -> Any:
    """One run on the left, mean distances by time on the right."""
    with canvas(12.0, 4.8) as figure:
        way, error = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
        every = range(0, len(drawn["truth"]), 6)
        for k in every:
            way.plot(*(drawn["points"][k].T / 1000), ".", color="0.6", ms=4)
            way.plot(*(outline(*drawn["truth"][k]).T / 1000), color="black", lw=1.0)
            way.plot(*(outline(*drawn[FILTERS[1]][k]).T / 1000), color=COLOURS[0], lw=1.2)
        way.set(
            xlabel="x [km]", ylabel="y [km]", aspect="equal", title="truth, and Feldmann's filter"
        )
        for name, colour in zip(FILTERS, COLOURS, strict=False):
            error.plot(distance[name].mean(axis=1), color=colour, label=name)
        error.set(xlabel="scan", ylabel="Gaussian Wasserstein distance [m]", title="mean over runs")
        error.set_ylim(bottom=0.0)
        error.legend()
    return figure


def draw_recordings(
    walk: tuple[list[ExtendedTracks], list[np.ndarray], list[float]],
    car: tuple[ExtendedTracks, np.ndarray, dict[str, Any]],
) -> Any:
    """The walk every second on the left, the scan of the car on the right."""
    found, points, times = walk
    with canvas(12.0, 5.6) as figure:
        left, right = figure.subplots(1, 2)
        for k in range(0, len(times), 15):
            left.plot(-points[k][:, 1], points[k][:, 0], ".", color="0.7", ms=3)
            one = found[k]
            for row in np.flatnonzero(one.confirmed):
                line = outline(one.states.mean[row, :2], one.states.extent[row])
                left.plot(-line[:, 1], line[:, 0], color=f"C{one.track_id[row] % 10}", lw=1.5)
        left.set(
            xlim=(-7.0, 3.0),
            ylim=(0.0, 14.0),
            xlabel="to the right [m]",
            ylabel="ahead [m]",
            aspect="equal",
            title="a person walks away, every 15th scan",
        )
        tracks, at, _ = car
        right.plot(-at[:, 1], at[:, 0], ".", color="0.7", ms=3)
        for row in np.flatnonzero(tracks.confirmed):
            line = outline(tracks.states.mean[row, :2], tracks.states.extent[row])
            right.plot(-line[:, 1], line[:, 0], color=COLOURS[row % len(COLOURS)], lw=1.2)
        right.set(
            xlabel="to the right [m]",
            ylabel="ahead [m]",
            aspect="equal",
            title="one scan of a car's radar: new objects",
        )
    return figure


def tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Sections of the page by name."""
    rows = []
    for name, entry in numbers["benchmark"].items():
        rows.append((name, *(f"{entry[part][0]:.1f} +- {entry[part][1]:.1f}" for part in entry)))
    head = ("filter", "all scans [m]", "straight legs [m]", "turns [m]")
    walk = [(key.replace("_", " "), f"{value:g}") for key, value in numbers["walk"].items()]
    car = [(key.replace("_", " "), f"{value:g}") for key, value in numbers["car"].items()]
    return {
        "benchmark": f"{numbers['runs']} runs of seed {numbers['seed']}:\n\n"
        + markdown(head, rows),
        "walk": markdown(("the walk", ""), walk),
        "car": markdown(("one scan of the ARS548", ""), car),
    }


def measure(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """All numbers, and what the pictures show."""
    distance, drawn = benchmark(runs, seed)
    parts = {"all": np.ones(len(drawn["truth"]), dtype=bool), **straight_and_turning()}
    walk, car = track_walk(), track_car()
    numbers = {
        "runs": runs,
        "seed": seed,
        "benchmark": {
            name: {
                part: [round(v, 3) for v in mean_and_stderr(values[rows].mean(axis=0))]
                for part, rows in parts.items()
            }
            for name, values in distance.items()
        },
        "walk": walk_numbers(walk[0], walk[2]),
        "car": car[2],
    }
    return numbers, {
        "extended_benchmark.png": draw_benchmark(distance, drawn),
        "extended_recordings.png": draw_recordings(walk, car),
    }


def main() -> int:
    """Measure, and write tables and pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers, figures = measure(args.runs, args.seed)
    print(json.dumps(numbers, indent=1))
    text = json.dumps(numbers, indent=1) + "\n"
    (ROOT / "docs" / "extended_objects.json").write_text(text, encoding="utf-8")
    for name, content in tables(numbers).items():
        write_section(ROOT / "docs" / "extended-objects.md", name, content)
    for name, figure in figures.items():
        (ROOT / "docs" / "images" / name).write_bytes(png(figure))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
