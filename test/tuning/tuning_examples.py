"""A short simulated scenario to tune on, and scores made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np

from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tuning.cases import Case
from gda_tracker.tuning.objectives import OBJECTIVES
from gda_tracker.tuning.scores import COLUMNS, CaseScore
from gda_tracker.tuning.search import Problem
from gda_tracker.tuning.search_space import parse_range
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanKey, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE, Tracks

SECOND = 1_000_000_000


def short_cases(runs=1, scans=8):
    scenario = load_scenario("crossing_targets")
    scenario = dataclasses.replace(scenario, time=dataclasses.replace(scenario.time, n_scans=scans))
    return [
        Case(f"run {run}", simulate(scenario, 3, run, initiation="automatic"), 200.0, False)
        for run in range(runs)
    ]


def short_base():
    preset = tracker_preset(load_scenario("crossing_targets"), "automatic")
    return {
        **preset,
        "track_manager": {**preset["track_manager"], **parse_method("map/none/cv")},
    }


def short_problem(
    parameters=("process_noise_std_mps2=1:50:log", "confirmation_hits=2:4"),
    objectives=("gospa",),
    **base,
):
    known = short_base()
    known["track_manager"].update(base)
    space = [parse_range(text, known) for text in parameters]
    return Problem(known, space, [OBJECTIVES[name] for name in objectives], short_cases(), 0)


def tracks_at(scan, positions, ids, detection=None, status=None):
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    n = len(positions)
    return Tracks(
        key=ScanKey(0, "radar", scan * SECOND),
        track_id=np.array(ids, dtype=np.int64),
        status=np.full(n, CONFIRMED) if status is None else np.array(status),
        mean=np.hstack([positions, np.zeros((n, 2))]),
        detection_index=np.full(n, -1) if detection is None else np.array(detection),
    )


def case_of(truth, sources=None, partial=True, distance=25.0, ids=None):
    """A case of (T, 2) positions per scan, NaN where unknown."""
    scans, known = [], []
    for scan, positions in enumerate(np.asarray(truth, dtype=float)):
        count = 0 if sources is None else len(sources[scan])
        scans.append(Detections("radar", scan * SECOND, np.ones(count), np.zeros(count)))
        state = np.hstack([positions, np.full((len(positions), 2), np.nan)])
        source = None if sources is None else np.array(sources[scan], dtype=np.int32)
        target = np.arange(1, len(positions) + 1) if ids is None else np.array(ids)
        known.append(ScanTruth("radar", scan * SECOND, target.astype(np.int32), state, source))
    return Case("by hand", Recording("by hand", scans, known), distance, partial)


def score_of(gospa, name="case", **numbers):
    """A score with these distances [m] on its scans, one target matched everywhere."""
    scans = np.zeros((len(gospa), len(COLUMNS)))
    for column, values in (
        ("scored", 1.0),
        ("gospa", np.square(gospa)),
        ("every_track", np.square(gospa)),
        ("samples", 1.0),
        ("matched", 1.0),
    ):
        scans[:, COLUMNS.index(column)] = values
    told = {
        "switches": 0,
        "false_tracks": None,
        "confirmed_tracks": 1,
        "delay_s": 0.0,
        "targets": 1,
        "not_extracted": 0,
        "names_sources": False,
        "cpu_s": 0.0,
        **numbers,
    }
    return CaseScore(name, scans, **told)


__all__ = [
    "CONFIRMED",
    "TENTATIVE",
    "case_of",
    "score_of",
    "short_base",
    "short_cases",
    "short_problem",
    "tracks_at",
]
