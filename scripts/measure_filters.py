#!/usr/bin/env python3
"""Measure the filters and sets of motion models: the tables of docs/filters.md.

    python scripts/measure_filters.py [--runs 60] [--decided 60] [--seed 0]

The same simulated runs are tracked by every filter: once with the detections given to the right
tracks, which leaves nothing but the filter, then with the decisions map and mht.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.clairvoyant import Clairvoyant  # noqa: E402
from gda_tracker.evaluation.purity import confusion_counts, purity  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.hypotheses import HypothesisTable  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.manager import TrackManager  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.tracking.state_retrodiction import retrodict_states  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

SCENARIOS = (
    str(ROOT / "scripts" / "manoeuvring_targets.yaml"),
    "crossing_targets",
    "closely_spaced_targets",
)
CLAIRVOYANT, DECISIONS = "clairvoyant", ("map/bayes", "mht/bayes")


def _models(filter_: str, names: str, factors: list[float], **more: Any) -> dict[str, Any]:
    return {
        "filter": filter_,
        "imm_models": names.split(),
        "imm_process_noise_factors": factors,
        "imm_mean_sojourn_s": [20.0] * len(factors),
        "imm_acceleration_std_mps2": 20.0,
        **more,
    }


TURN = "constant_velocity coordinated_turn"
# What the decisions are measured with.
SHORT_LIST = ("cv", "imm", "gpb2", "imm, cv + singer", "gpb2, cv + turn")
# Parameters of the track manager; the first is what the others differ from.
FILTERS: dict[str, dict[str, Any]] = {
    "cv": {"filter": "cv"},
    "imm": {"filter": "imm"},
    "gpb2": {"filter": "gpb2"},
    "imm, singer alone": _models("imm", "singer", [1.3]),
    "imm, van_keuk alone": _models("imm", "van_keuk", [1.3]),
    "imm, cv + singer": _models("imm", "constant_velocity singer", [0.2, 1.3]),
    "imm, cv + acceleration": _models("imm", "constant_velocity constant_acceleration", [0.2, 0.5]),
    "imm, cv + turn": _models("imm", TURN, [0.2, 0.6]),
    "gpb2, cv + turn": _models("gpb2", TURN, [0.2, 0.6]),
    "imm, 2 van_keuk by acceleration": _models(
        "imm", "van_keuk van_keuk", [0.2, 1.3], imm_switching="acceleration"
    ),
}


@dataclass
class Found:
    """What one filter reached with one decision, run by run; ``cpu_s`` is for a scan.

    ``error_m`` and ``smoothed_m`` are root mean squares of the position error, online and by the
    fixed-interval smoother.
    """

    error_m: list[float] = field(default_factory=list)
    smoothed_m: list[float] = field(default_factory=list)
    purity: list[float] = field(default_factory=list)
    delayed_purity: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)


def rings_of(scenario: Scenario) -> dict[tuple[str, str], Ring]:
    """A ring for each filter and decision."""
    rings = {}
    for name, values in FILTERS.items():
        for decision in (CLAIRVOYANT, *(DECISIONS if name in SHORT_LIST else ())):
            method = "gda/none" if decision == CLAIRVOYANT else decision
            preset = with_method(tracker_preset(scenario), f"{method}/{values['filter']}")
            preset["track_manager"] = {**preset["track_manager"], **values}
            rings[name, decision] = Ring(preset)
    return rings


def measure(name: str, runs: int, seed: int, decided: int) -> dict[tuple[str, str], Found]:
    """Track the runs of a scenario by all filters, the first ``decided`` also by the decisions."""
    scenario = load_scenario(name)
    rings = rings_of(scenario)
    found = {key: Found() for key in rings}
    for run in range(runs):
        recording = simulate(scenario, seed, run)
        # The same for all.
        prepared = [next(iter(rings.values())).prepare(scan) for scan in recording.detections]
        for (filter_, decision), ring in rings.items():
            if decision == CLAIRVOYANT or run < decided:
                _track(ring, scenario, recording, prepared, decision, found[filter_, decision])
    return found


def _track(
    ring: Ring,
    scenario: Scenario,
    recording: Recording,
    prepared: list[Any],
    decision: str,
    found: Found,
) -> None:
    """Track one run and add what came of it."""
    assert recording.truth is not None
    skip = scenario.time.n_initiation_scans
    truth = recording.truth[skip:]
    targets = np.sort(truth[0].target_id)
    ids = np.arange(1, len(targets) + 1)
    # All but the track manager keep nothing from run to run.
    ring.manager = TrackManager(ring.manager.parameters)
    if decision == CLAIRVOYANT:
        pairs = zip(ids.tolist(), targets.tolist(), strict=True)
        ring.associate = Clairvoyant(recording.truth, dict(pairs))
    ring.initialise(labelled_tracks(recording, skip, ring, prepared))
    results, tables = [], []
    start = time.process_time()
    for scan, known in zip(recording.detections[skip:], prepared[skip:], strict=True):
        results.append(ring.process(scan, known))
        tables.append(ring.manager.state.table)
    found.cpu_s.append((time.process_time() - start) / len(results))
    if decision == CLAIRVOYANT:
        states = np.array([one.target_state[np.argsort(one.target_id), :2] for one in truth])
        for values, kept in (
            (found.error_m, tables),
            (found.smoothed_m, _smoothed(tables, scenario.time.scan_period_s, ring)),
        ):
            gap = np.array([table.mean[:, :2] for table in kept]) - states
            values.append(float(np.sqrt(np.square(gap).sum(axis=2).mean())))
        return
    tracks = [result.tracks for result in results if result.tracks is not None]
    found.purity.append(float(purity(confusion_counts(tracks, truth, ids, targets)).mean()))
    delayed = [told for result in results for told in result.delayed] + ring.rest_of_delayed()
    if delayed:
        counts = confusion_counts(delayed, truth, ids, targets)
        found.delayed_purity.append(float(purity(counts).mean()))


def _smoothed(tables: list[HypothesisTable], period_s: float, ring: Ring) -> list[HypothesisTable]:
    back = [tables[-1]]
    for table in tables[-2::-1]:
        back.append(retrodict_states(table, back[-1], period_s, ring.manager.parameters))
    return back[::-1]


def error_table(found: dict[str, dict[tuple[str, str], Found]]) -> str:
    """Markdown: root mean square errors of position, online and smoothed, by right detections."""
    head = ["filter and models"]
    for name in found:
        head += [f"{_title(name)}: online [m]", "smoothed [m]"]
    rows = []
    for filter_ in FILTERS:
        cells = [f"`{filter_}`"]
        for one in found.values():
            values = one[filter_, CLAIRVOYANT]
            for errors in (values.error_m, values.smoothed_m):
                mean, stderr = mean_and_stderr(np.array(errors))
                cells.append(f"{mean:.0f} +- {stderr:.0f}")
        rows.append(cells)
    return markdown(head, rows)


def purity_table(found: dict[str, dict[tuple[str, str], Found]]) -> str:
    """Markdown: purity with its paired difference to the first filter, and processor time."""
    head = ["filter and models", "decision", "CPU [ms]"]
    for name in found:
        head += [_title(name), "difference to `cv`"]
    rows = []
    for decision in DECISIONS:
        for filter_ in SHORT_LIST:
            first = next(iter(found.values()))[filter_, decision]
            cells = [f"`{filter_}`", f"`{decision}`", f"{1e3 * np.mean(first.cpu_s):.1f}"]
            for one in found.values():
                values, plain = (
                    np.array(one[f, decision].delayed_purity or one[f, decision].purity)
                    for f in (filter_, SHORT_LIST[0])
                )
                cells.append(with_error(*mean_and_stderr(values)))
                difference = mean_and_stderr(values - plain)
                cells.append("-" if filter_ == SHORT_LIST[0] else signed(*difference))
            rows.append(cells)
    return markdown(head, rows)


def _title(name: str) -> str:
    return f"`{Path(name).stem}`"


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--decided", type=int, default=60, help="runs with map and mht")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--document", type=Path, default=ROOT / "docs/filters.md")
    args = parser.parse_args(arguments)
    found = {}
    for name in SCENARIOS:
        found[name] = measure(name, args.runs, args.seed, args.decided)
        print(f"measured: {name}", file=sys.stderr, flush=True)
    write_section(args.document, "filter errors", error_table(found))
    write_section(args.document, "filter purity", purity_table(found))
    print(f"written: tables of {args.document}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
