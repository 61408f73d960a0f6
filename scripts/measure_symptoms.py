#!/usr/bin/env python3
"""Measure what each parameter does to each symptom: the table of docs/tuning.md.

    python scripts/measure_symptoms.py [--runs 10] [--seed 1] [--write]

Each row changes what it names of a default that has the symptom, and nothing else, on the same
scans. A row whose change does not do what its table says ends the script with an error, so that
the document cannot claim what is not so.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.runs import AUTOMATIC, default_match_distance_m  # noqa: E402
from gda_tracker.io.adapters import load_recording  # noqa: E402
from gda_tracker.resources import resource  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tuning.cases import Case  # noqa: E402
from gda_tracker.tuning.scores import measures, score_case  # noqa: E402
from gda_tracker.tuning.search_space import MANAGER, base_value  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

BOATS, AIRCRAFT = "boats", "aircraft"
BOAT_SCENARIOS = (2, 3, 13, 16)
BOAT_MATCH_M = 25.0
METHODS = {BOATS: "map/none/cv", AIRCRAFT: "map/none/cv"}
RISE, FALL = 1, -1


@dataclass(frozen=True)
class Row:
    """A symptom, what tells it, the default that has it, and the change that cures it.

    ``goal`` is the direction in which ``measure`` gets better; ``price`` is another measure that
    the reader should watch.
    """

    symptom: str
    data: str
    measure: str
    goal: int
    change: Mapping[str, Any]
    price: str
    sick: Mapping[str, Any]


ROWS = (
    Row("tracks split", BOATS, "switches", FALL, {"azimuth_std_rad": 0.1}, "position_error_m",
        {"azimuth_std_rad": 0.025}),
    Row("tracks split", BOATS, "switches", FALL, {"deletion_misses": 8}, "confirmed_tracks",
        {"deletion_misses": 2}),
    Row("tracks split", AIRCRAFT, "switches", FALL, {"process_noise_std_mps2": 18.0},
        "position_error_m", {"process_noise_std_mps2": 3.0}),
    Row("tracks swap", AIRCRAFT, "purity", RISE, {"attribute_term": "bayes"}, "false_tracks", {}),
    Row("tracks swap", AIRCRAFT, "purity", RISE, {"process_noise_std_mps2": 18.0}, "completeness",
        {"process_noise_std_mps2": 60.0}),
    Row("tracks swap", AIRCRAFT, "purity", RISE, {"range_std_m": 60.0}, "position_error_m",
        {"range_std_m": 240.0}),
    Row("tracks swap", AIRCRAFT, "purity", RISE, {"gate_probability": 0.9}, "completeness",
        {"gate_probability": 0.9999}),
    Row("tracks swap", AIRCRAFT, "switches", FALL, {"decision": "mht"}, "purity",
        {"attribute_term": "bayes"}),
    Row("ghosts", AIRCRAFT, "false_tracks", FALL, {"confirmation_hits": 4}, "delay_s", {}),
    Row("ghosts", AIRCRAFT, "false_tracks", FALL, {"max_speed_mps": 300.0}, "completeness",
        {"max_speed_mps": 1500.0}),
    Row("ghosts", AIRCRAFT, "false_tracks", FALL,
        {"extraction": "sequential", "clutter_density": "estimated"}, "delay_s", {}),
    Row("tracks lag behind", BOATS, "position_error_m", FALL, {"process_noise_std_mps2": 0.7},
        "switches", {"process_noise_std_mps2": 0.05}),
    Row("tracks start late", BOATS, "delay_s", FALL, {"confirmation_hits": 2}, "confirmed_tracks",
        {"confirmation_hits": 3}),
    Row("tracks start late", BOATS, "delay_s", FALL, {"initiation_memory_scans": 2},
        "confirmed_tracks", {"initiation_memory_scans": 1}),
    Row("tracks live on", BOATS, "gospa_every_track_m", FALL, {"deletion_misses": 4},
        "completeness", {"deletion_misses": 12}),
    Row("tracks are lost", BOATS, "completeness", RISE, {"deletion_misses": 8}, "confirmed_tracks",
        {"deletion_misses": 2}),
    Row("two tracks on one object", BOATS, "false_m", FALL, {"initiation_outside_gates": True},
        "completeness", {}),
)  # fmt: skip
# What one might try first, and what it does not do.
NO_CURES = (
    Row("ghosts", AIRCRAFT, "false_tracks", FALL, {"clutter_density_per_m_rad": 3e-4}, "purity",
        {}),
    Row("tracks lag behind", BOATS, "position_error_m", FALL, {"process_noise_std_mps2": 0.7},
        "completeness", {"process_noise_std_mps2": 10.0}),
    Row("tracks are lost", BOATS, "completeness", RISE, {"gate_probability": 0.99}, "switches",
        {"gate_probability": 0.5}),
)  # fmt: skip
# A change that gains less than this share is no cure.
WORTH = 0.03
NAMES = {
    "switches": "identity switches",
    "purity": "purity",
    "false_tracks": "false tracks",
    "position_error_m": "position error [m]",
    "completeness": "completeness",
    "delay_s": "extraction delay [s]",
    "confirmed_tracks": "confirmed tracks",
    "gospa_every_track_m": "GOSPA of every track [m]",
    "false_m": "false part of GOSPA [m]",
}


def boats() -> tuple[list[Case], Mapping[str, Any]]:
    """The four recordings of marine radar, and their preset."""
    recordings = [load_recording(resource("data", "autoferry", f"scenario{n}"))
                  for n in BOAT_SCENARIOS]  # fmt: skip
    cases = [Case(r.name, r, BOAT_MATCH_M, partial=True) for r in recordings]
    return cases, with_method(recordings[0].preset, METHODS[BOATS])


def aircraft(runs: int, seed: int) -> tuple[list[Case], Mapping[str, Any]]:
    """Runs of the crossing aircraft, and what they tell the tracker."""
    scenario = load_scenario("crossing_targets")
    distance = default_match_distance_m(scenario)
    cases = [
        Case(f"run {run}", simulate(scenario, seed, run, initiation=AUTOMATIC), distance, False)
        for run in range(runs)
    ]
    return cases, with_method(tracker_preset(scenario, AUTOMATIC), METHODS[AIRCRAFT])


class Laboratory:
    """Scores changes of the track manager, each once."""

    def __init__(self, runs: int, seed: int) -> None:
        self._data = {BOATS: boats(), AIRCRAFT: aircraft(runs, seed)}
        self._known: dict[tuple[str, str], dict[str, float | None]] = {}

    def base(self, data: str) -> Mapping[str, Any]:
        """Parameters under the changes."""
        return self._data[data][1]

    def measure(self, data: str, changes: Mapping[str, Any]) -> dict[str, float | None]:
        """Measures with these parameters changed."""
        key = data, repr(sorted(changes.items()))
        if key not in self._known:
            cases, base = self._data[data]
            parameters = {**base, "track_manager": {**base["track_manager"], **changes}}
            self._known[key] = measures([score_case(case, parameters) for case in cases])
        return self._known[key]


def measure_row(laboratory: Laboratory, row: Row, cures: bool = True) -> list[str]:
    """One line of a table.

    Raises
    ------
    RuntimeError
        If the change gains less than the share ``WORTH``, or for what is no cure, more.
    """
    before = laboratory.measure(row.data, row.sick)
    after = laboratory.measure(row.data, {**row.sick, **row.change})
    first, second = before[row.measure], after[row.measure]
    assert first is not None
    assert second is not None
    if (row.goal * (second - first) > WORTH * first) != cures:
        raise RuntimeError(
            f"{row.symptom}, {dict(row.change)}: {row.measure} goes from {first:.4g} to "
            f"{second:.4g}, which is {'no' if cures else 'a'} cure"
        )
    base = laboratory.base(row.data)
    changes = [
        f"`{name}` {text(row.sick.get(name, base_value(base, MANAGER, name)))} -> {text(value)}"
        for name, value in row.change.items()
    ]
    return [
        row.symptom,
        ", ".join(changes),
        row.data,
        f"{NAMES[row.measure]} {first:.3g} -> **{second:.3g}**",
        f"{NAMES[row.price]} {before[row.price]:.3g} -> {after[row.price]:.3g}",
    ]


def text(value: Any) -> str:
    """A value of a parameter."""
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


def table(laboratory: Laboratory, rows: Sequence[Row], cures: bool) -> str:
    """Markdown: what was measured."""
    head = ["symptom", "parameter", "on", "before -> after", "and also"]
    return markdown(head, [measure_row(laboratory, row, cures) for row in rows])


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="into docs/tuning.md")
    options = parser.parse_args(arguments)
    laboratory = Laboratory(options.runs, options.seed)
    sections = {"cures": table(laboratory, ROWS, True)}
    sections["no-cures"] = table(laboratory, NO_CURES, False)
    for name, content in sections.items():
        print(content + "\n")
        if options.write:
            write_section(ROOT / "docs" / "tuning.md", name, content)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
