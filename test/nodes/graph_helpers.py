"""A ring, a source and the offline ring to compare with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gda_tracker.nodes.runner import Nodes, RingProcesses, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.simulation.playback import Playback, of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.tracks import Tracks

TIMEOUT_S = 120.0
TRACK_FIELDS = (
    "track_id",
    "hypothesis_id",
    "status",
    "mean",
    "covariance",
    "focal",
    "masses",
    "class_probability",
    "conflict",
    "hits",
    "misses",
    "coasted_scans",
    "first_detection_ns",
    "last_detection_ns",
    "detection_index",
    "deleted_track_id",
)


def scenario_plays(name: str, method: str, runs: int = 1, seed: int = 3):
    """Runs of a scenario and the parameters of the ring for them."""
    scenario = load_scenario(name)
    return of_scenario(scenario, runs, seed, method), with_method(tracker_preset(scenario), method)


def offline(plays: list[Playback], parameters: Mapping) -> dict[tuple[str, int], Tracks]:
    """Tracks of the offline ring, by sensor and stamp."""
    ring = Ring(parameters)
    found = {}
    for play in plays:
        if play.initial is not None:
            assert ring.initialise(play.initial).outcome == "initialised"
        for detections in play.detections:
            found[(detections.sensor_id, detections.stamp_ns)] = ring.process(detections).tracks
    return found


def differences(found: Mapping, expected: Mapping) -> list[str]:
    """Where two sets of tracks are not bit for bit the same."""
    told = []
    if set(found) != set(expected):
        told.append(f"scans: {len(found)} and {len(expected)}")
    for key in sorted(set(found) & set(expected), key=lambda k: k[1]):
        one, other = found[key], expected[key]
        for name in TRACK_FIELDS:
            a, b = getattr(one, name), getattr(other, name)
            if a.shape != b.shape or a.tobytes() != np.ascontiguousarray(b, a.dtype).tobytes():
                told.append(f"scan {key[1]}: {name}")
        if (one.frame, one.class_names) != (other.frame, other.class_names):
            told.append(f"scan {key[1]}: frame or classes")
    return told


class Played:
    """A source that has played everything: its progress."""

    def __init__(self, source: ScanSourceNode) -> None:
        self.progress = source.progress
        self.tracks = source.progress.tracks
        self.reports = source.progress.reports


def play(nodes: Nodes, source: ScanSourceNode, ring: RingProcesses | None = None) -> Played:
    """Play to the end, or fail with what is known."""

    def watch() -> None:
        if ring is not None:
            assert not ring.failed(), ring.failed()

    done = nodes.spin_until(lambda: source.finished, TIMEOUT_S, watch)
    p = source.progress
    assert done, f"{p.answered} of {p.total} scans answered after {TIMEOUT_S} s"
    assert not source.error, source.error
    return Played(source)


def play_in_processes(plays, parameters, environment, also=lambda **_: []) -> Played:
    """Play through four processes."""
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(
            lambda **o: [ScanSourceNode({}, plays=plays, collect=True, **o), *also(**o)],
            int(environment["ROS_DOMAIN_ID"]),
        ) as nodes,
    ):
        return play(nodes, nodes.nodes[0], ring)


def play_in_one_process(plays, parameters, domain: int, stages=stage_nodes) -> Played:
    """Play through four nodes on one executor."""
    with Nodes(
        lambda **o: [
            ScanSourceNode({}, plays=plays, collect=True, **o),
            *stages(parameters, **o),
        ],
        domain,
    ) as nodes:
        return play(nodes, nodes.nodes[0])
