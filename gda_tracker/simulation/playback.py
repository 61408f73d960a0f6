"""What a source plays: scans with truth, and the labelled tracks that they start from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.statements import Statement
from gda_tracker.vocabulary.tracks import Tracks

# Runs that are played one after the other keep their stamps apart.
RUN_SPACING_NS = 100_000 * 1_000_000_000


@dataclass(slots=True)
class Playback:
    """One run: scans in order; truth per scan and labelled tracks to start from, or ``None``.

    ``statements`` are said on the way, each with the number of scans before it, in this order.
    ``notes`` are lines about the source and how it was read.
    """

    name: str
    detections: list[Detections]
    truth: list[ScanTruth] | None = None
    initial: Tracks | None = None
    statements: list[tuple[int, Statement]] = field(default_factory=list)
    match_distance_m: float | None = None
    notes: tuple[str, ...] = ()

    def said_before(self, position: int) -> list[Statement]:
        """Statements that are said right before the scan at a position."""
        return [statement for number, statement in self.statements if number == position]


def of_recording(recording: Recording) -> Playback:
    """Play a recording as it is; the tracker starts its tracks itself."""
    return Playback(
        recording.name,
        recording.detections,
        recording.truth,
        statements=recording.statements,
        match_distance_m=recording.match_distance_m,
        notes=tuple(filter(None, (recording.origin, *recording.notes, *recording.warnings))),
    )


def with_method(
    parameters: Mapping[str, Mapping[str, Any]], method: str
) -> dict[str, dict[str, Any]]:
    """Parameters ``{node: {name: value}}`` with the decision, term and filter of ``method``."""
    merged = {node: dict(values) for node, values in parameters.items()}
    merged["track_manager"] = {**merged.get("track_manager", {}), **parse_method(method)}
    return merged


def of_scenario(
    scenario: Scenario, runs: int, seed: int, method: str, first_run: int = 0
) -> list[Playback]:
    """Simulate ``runs`` runs and start each from its labelled detections.

    With several sensors, or extended targets, the tracker starts its tracks itself.
    """
    plays = []
    for run in range(first_run, first_run + runs):
        if scenario.sensors:
            spacing = run * RUN_SPACING_NS
            network = simulate_network(scenario, seed, run, base_stamp_ns=spacing)
            plays.append(of_recording(network))
            continue
        recording = simulate(scenario, seed, run, base_stamp_ns=run * RUN_SPACING_NS)
        if scenario.only_automatic:
            plays.append(of_recording(recording))
            continue
        n = scenario.time.n_initiation_scans
        initial = labelled_tracks(recording, n, Ring(with_method(recording.preset, method)))
        assert recording.truth is not None
        plays.append(
            Playback(recording.name, recording.detections[n:], recording.truth[n:], initial)
        )
    return plays
