"""What ``gda-tracker tune`` works on: recordings and scenarios, their default, the search space."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from gda_tracker.commands.options import Parameters, gather_parameters, radar_input_of_file
from gda_tracker.commands.replay_summary import REAL_MATCH_M, SIMULATED_MATCH_M
from gda_tracker.errors import UserError
from gda_tracker.evaluation.runs import AUTOMATIC, default_match_distance_m
from gda_tracker.io.adapters import InputOptions, is_recording, load_recording
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.io.truth_files import TruthTable, truth_of_scans
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario, shipped_scenarios
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.tuning.cases import Case
from gda_tracker.tuning.search_space import Range, default_space, parse_range

DEFAULT_SPACE = "default"


def load_cases(
    name: str, args: argparse.Namespace, tables: Sequence[TruthTable], seed: int
) -> tuple[list[Case], Parameters]:
    """The cases that a name on the command line stands for, and their parameters."""
    scenario_file = Path(name).suffix in (".yaml", ".yml") and args.adapter == "auto"
    if name in shipped_scenarios() or (scenario_file and not is_recording(name)):
        scenario = load_scenario(name)
        preset = tracker_preset(scenario, AUTOMATIC)
        distance = args.match_distance or default_match_distance_m(scenario)
        cases = [
            Case(
                f"{scenario.name} run {number} of seed {seed}",
                simulate_network(scenario, seed, number)
                if scenario.sensors
                else simulate(scenario, seed, number, initiation=AUTOMATIC),
                distance,
                partial=False,
            )
            for number in range(args.runs)
        ]
        return cases, gather_parameters(args.params, args.method, preset)
    options = InputOptions(args.topic, args.preset, radar_input_of_file(args.params))
    recording = load_recording(name, args.adapter, options)
    for warning in recording.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if recording.truth is None and tables:
        recording.truth = truth_of_scans(tables, recording.detections)
    truth = recording.truth
    simulated = bool(truth) and all(entry.source_id is not None for entry in truth)
    distance = args.match_distance or (SIMULATED_MATCH_M if simulated else REAL_MATCH_M)
    case = Case(recording.name, recording, distance, not (simulated or args.complete_truth))
    given, on_top = recording.preset, recording.preset_is_base
    if args.preset is not None and not on_top:
        given, on_top = read_preset(args.preset), True
    return [case], gather_parameters(args.params, args.method, given, on_top)


def one_base(loaded: Sequence[tuple[list[Case], Parameters]], names: Sequence[str]) -> Parameters:
    """The default parameters, which must be the same for all recordings."""
    first = loaded[0][1]
    for (_, other), name in zip(loaded[1:], names[1:], strict=True):
        for node, table in stage_parameters(other).items():
            mine = stage_parameters(first)[node]
            differs = [key for key in vars(table) if getattr(table, key) != getattr(mine, key)]
            if differs:
                key = differs[0]
                raise UserError(
                    f"{names[0]} and {name} have different defaults: {key} is "
                    f"{getattr(mine, key)} and {getattr(table, key)}; one set of parameters is "
                    "searched, so give the default with --params"
                )
    return first


def search_space(texts: Sequence[str], base: Parameters, cases: Sequence[Case]) -> list[Range]:
    """What is searched; a range that the user gives takes the place of the default one."""
    found: dict[str, Range] = {}
    if not texts or DEFAULT_SPACE in texts:
        recordings = [case.recording for case in cases]
        found = {item.name: item for item in default_space(base, recordings)}
    for text in texts:
        if text != DEFAULT_SPACE:
            item = parse_range(text, base)
            found[item.name] = item
    return list(found.values())


def refuse_seen(cases: Sequence[Case], held_back: Sequence[Case]) -> None:
    """Raise an error if a recording is both searched and held back."""
    names = {case.name for case in cases}
    for case in held_back:
        if case.name in names:
            raise UserError(
                f"--held-back {case.name}: the search sees it, so it tells nothing; hold back "
                "another recording"
            )
