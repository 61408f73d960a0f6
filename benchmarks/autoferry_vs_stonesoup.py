"""Real marine radar: gda_tracker and Stone Soup's GNN on the Autoferry recordings.

Both trackers see the same scans, try the same settings, are judged by the same objective on both
recordings at once, and are scored by the same scorer. The settings are those that both have:
measurement noise, process noise, gate, detections that confirm a track, misses that end it.

    python -m benchmarks.autoferry_vs_stonesoup
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import stonesoup_peer
from benchmarks.measuring import RESULTS, table, write_results
from benchmarks.scoring import score_recording
from gda_tracker.io.adapters import load_recording
from gda_tracker.resources import resource
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import Tracks

SCENARIOS = (13, 16)
METHODS = ("gda/none/cv", "map/none/cv")
MATCH_DISTANCE_M = 25.0
FLIP_COST = 0.05

# What is known beforehand and not tuned: leisure boats do less than 10 m/s.
MAX_SPEED_MPS = 10.0
PRIOR_SPEED_STD_MPS = 5.0
TENTATIVE_DELETION_MISSES = 2

NOISE = ((5.0, 0.06), (10.0, 0.1))
PROCESS_NOISE_STD_MPS2 = (0.5, 1.0)
GATE_PROBABILITY = (0.99, 0.9999)
CONFIRMATION_HITS = (2, 3)
DELETION_MISSES = (5, 8)

Run = Callable[[Recording, "Setting"], list[Tracks]]
Scores = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Setting:
    """One point of the grid, in terms that both trackers have."""

    range_std_m: float
    azimuth_std_rad: float
    process_noise_std_mps2: float
    gate_probability: float
    confirmation_hits: int
    deletion_misses: int

    def __str__(self) -> str:
        return (
            f"noise {self.range_std_m:g} m, {self.azimuth_std_rad:g} rad; process noise "
            f"{self.process_noise_std_mps2:g} m/s2; gate {self.gate_probability:g}; confirmed by "
            f"{self.confirmation_hits}, ended by {self.deletion_misses} misses"
        )


def grid() -> list[Setting]:
    """All settings that are tried, for either tracker."""
    points = itertools.product(
        NOISE, PROCESS_NOISE_STD_MPS2, GATE_PROBABILITY, CONFIRMATION_HITS, DELETION_MISSES
    )
    return [
        Setting(*noise, acceleration, gate, hits, misses)
        for noise, acceleration, gate, hits, misses in points
    ]


def run_ring(parameters: Mapping[str, Mapping[str, Any]], recording: Recording) -> list[Tracks]:
    """Tracks of the offline ring, one entry per scan."""
    ring = Ring(parameters)
    found = []
    for detections in recording.detections:
        result = ring.process(detections)
        if result.tracks is None:
            raise RuntimeError(f"{recording.name}: scan rejected: {result.report.reason}")
        found.append(result.tracks)
    return found


def ring_runner(method: str) -> Run:
    """A function that runs gda_tracker with a setting, over the preset of the recording."""

    def run(recording: Recording, setting: Setting) -> list[Tracks]:
        tuned = {
            "range_std_m": setting.range_std_m,
            "azimuth_std_rad": setting.azimuth_std_rad,
            "process_noise_std_mps2": setting.process_noise_std_mps2,
            "gate_probability": setting.gate_probability,
            "confirmation_hits": setting.confirmation_hits,
            "confirmation_scans": setting.confirmation_hits + 1,
            "deletion_misses": setting.deletion_misses,
            "tentative_deletion_misses": TENTATIVE_DELETION_MISSES,
            "max_speed_mps": MAX_SPEED_MPS,
        }
        manager = {**recording.preset.get("track_manager", {}), **tuned, **parse_method(method)}
        return run_ring({**recording.preset, "track_manager": manager}, recording)

    return run


def run_stonesoup(recording: Recording, setting: Setting) -> list[Tracks]:
    """Tracks of Stone Soup's GNN with a setting."""
    period_s = float(np.median(np.diff([d.stamp_ns for d in recording.detections]))) / 1e9
    settings = stonesoup_peer.PeerSettings(
        range_std_m=setting.range_std_m,
        azimuth_std_rad=setting.azimuth_std_rad,
        # The same variance of the speed after one scan: an acceleration that is constant within a
        # scan adds (a T)^2, white noise of density q adds q T.
        process_noise=setting.process_noise_std_mps2**2 * period_s,
        prior_speed_std=PRIOR_SPEED_STD_MPS,
        gate_probability=setting.gate_probability,
        minimum_points=setting.confirmation_hits,
        tentative_deletion_misses=TENTATIVE_DELETION_MISSES,
        deletion_misses=setting.deletion_misses,
    )
    return stonesoup_peer.track(recording.detections, settings)[0]


def objective(scores: Sequence[Mapping[str, Any]]) -> float:
    """What tuning maximises: mean completeness of all boats, less 0.05 for each identity flip."""
    shares = [share for score in scores for share in score["completeness"].values()]
    return float(np.mean(shares)) - FLIP_COST * sum(score["flips"] for score in scores)


def search(run: Run, recordings: Sequence[Recording]) -> list[tuple[Setting, Scores]]:
    """Score every setting on every recording."""
    found = []
    for setting in grid():
        scores = {}
        for recording in recordings:
            assert recording.truth is not None
            tracks = run(recording, setting)
            scores[recording.name] = score_recording(tracks, recording.truth, MATCH_DISTANCE_M)
        found.append((setting, scores))
    return found


def best(results: Sequence[tuple[Setting, Scores]], names: Sequence[str]) -> tuple[Setting, Scores]:
    """The setting with the largest objective on the named recordings, then the smallest error."""

    def value(result: tuple[Setting, Scores]) -> tuple[float, float]:
        chosen = [result[1][name] for name in names]
        error = float(np.mean([score["rmse_m"] for score in chosen]))
        return round(objective(chosen), 9), -error

    return max(results, key=value)


def compare(
    recordings: Sequence[Recording], methods: Sequence[str]
) -> tuple[list[list[Any]], dict[str, Any]]:
    """Run everything; returns the rows of the table and the content of the JSON file."""
    names = [r.name for r in recordings]
    rows: list[list[Any]] = []
    content: dict[str, Any] = {"trackers": {}}

    def add(tracker: str, tuned_on: str, scores: Scores, shown: Sequence[str]) -> None:
        for name in shown:
            score = scores[name]
            shares = [round(share, 3) for share in score["completeness"].values()]
            rows.append(
                [tracker, tuned_on, name, *shares, score["switches"], score["flips"]]
                + [round(score["rmse_m"], 2), score["tracks"]]
            )

    runners: dict[str, Run] = {f"gda_tracker {method}": ring_runner(method) for method in methods}
    if stonesoup_peer.available():
        runners["Stone Soup GNN"] = run_stonesoup
    for method in methods:
        preset_scores = {}
        for recording in recordings:
            manager = {**recording.preset["track_manager"], **parse_method(method)}
            tracks = run_ring({**recording.preset, "track_manager": manager}, recording)
            assert recording.truth is not None
            preset_scores[recording.name] = score_recording(
                tracks, recording.truth, MATCH_DISTANCE_M
            )
        add(f"gda_tracker {method}", "preset", preset_scores, names)
        content["trackers"][f"gda_tracker {method}, preset"] = preset_scores
    for tracker, run in runners.items():
        results = search(run, recordings)
        setting, scores = best(results, names)
        add(tracker, "both", scores, names)
        entry = {"objective": objective(list(scores.values())), "setting": asdict(setting)}
        content["trackers"][tracker] = {
            "tuned_on_both": {**entry, "scores": scores},
            "grid": [{"setting": asdict(s), "scores": c} for s, c in results],
        }
        print(f"{tracker}, best of {len(results)}: {setting}", flush=True)
        for name in names:
            others = [other for other in names if other != name]
            if others:
                add(tracker, "the other", best(results, others)[1], [name])
    return rows, content


def recordings_of(scenarios: Sequence[int]) -> list[Recording]:
    """The shipped recordings."""
    return [load_recording(resource("data", "autoferry", f"scenario{n}"), "bag") for n in scenarios]


def main(arguments: list[str] | None = None) -> int:
    """Print the table, write the JSON file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", type=int, action="append", choices=SCENARIOS)
    parser.add_argument("--method", action="append", help=f"default: {' and '.join(METHODS)}")
    parser.add_argument("--json", type=Path, default=RESULTS / "autoferry_vs_stonesoup.json")
    a = parser.parse_args(arguments)
    rows, content = compare(recordings_of(a.scenario or SCENARIOS), a.method or METHODS)
    columns = ["tracker", "tuned on", "recording", "boat 1", "boat 2", "switches", "flips"]
    print()
    print(table([*columns, "error_m", "tracks"], rows))
    print(
        f"\nboat 1, boat 2: share of scans with a confirmed track within {MATCH_DISTANCE_M:g} m; "
        f"error: RMS of these.\ntracks: confirmed in all, also on moored boats and other traffic. "
        f"{len(grid())} settings each."
    )
    if not stonesoup_peer.available():
        print(stonesoup_peer.INSTALL)
    print(f"written: {write_results(a.json, content)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
