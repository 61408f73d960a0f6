"""A ring, a source and the offline ring to compare with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gda_tracker.nodes.runner import Nodes, RingProcesses, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.simulation.playback import Playback, of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.statements import Statement, StatementPiece, StatementRegion
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
    "existence_probability",
    "signal_strength",
    "signal_strength_std_db",
    "detection_probability",
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


def with_statements(play: Playback, source: str = "pilot") -> Playback:
    """Say something of every kind on the way, some of it refused."""
    assert play.truth is not None
    said = []
    for position in range(2, len(play.detections)):
        x, y = (float(value) for value in play.truth[position].target_state[0, :2])
        around = StatementRegion("gaussian", centre_m=(x, y), covariance_m2=(9e4, 0.0, 0.0, 9e4))
        box = StatementRegion("box", low_m=(x - 500.0, y - 400.0), high_m=(x + 300.0, y + 600.0))
        seen = StatementRegion(
            "sector", (x - 3e3, y - 3e3), first_bearing_rad=0.6, opening_rad=0.4, farthest_m=9e3
        )
        fighter = {"class_names": ("fighter", "cargo"), "class_grades": (0.9, 0.3)}
        kind, about, *pieces = (
            ("fuzzy", "place", StatementPiece(around, **fighter)),
            ("region", "track", StatementPiece(box)),
            ("fuzzy", "track", StatementPiece(**fighter)),
            ("fds", "track", StatementPiece(seen, ("fighter",), (1.0,), 0.6),
             StatementPiece(around, mass=0.4)),
            ("rule", "place", StatementPiece(box, ("fighter",), (1.0,))),
            ("fuzzy", "track", StatementPiece(around)),
            ("region", "track", StatementPiece(box), "of an unknown track"),
        )[position % 7]  # fmt: skip
        unknown = isinstance(pieces[-1], str)
        statement = Statement(
            source,
            position,
            play.detections[position].stamp_ns - 10**8,
            kind,
            about,
            tuple(piece for piece in pieces if not isinstance(piece, str)),
            track_id=10**6 if unknown else int(play.initial.track_id[position % 2]),
            reliability=(1.0, 0.7)[position % 2],
            rule="region_implies_classes" if kind == "rule" else "",
            frame_id="map",
        )
        said.append((position, statement))
    return replace(play, statements=said)


def offline(plays: list[Playback], parameters: Mapping) -> dict[tuple[str, int], Tracks]:
    """Tracks of the offline ring, by sensor and stamp."""
    ring = Ring(parameters)
    found = {}
    for play in plays:
        if play.initial is not None:
            assert ring.initialise(play.initial).outcome == "initialised"
        for position, detections in enumerate(play.detections):
            for statement in play.said_before(position):
                ring.say(statement)
            found[(detections.sensor_id, detections.stamp_ns)] = ring.process(detections).tracks
    return found


def offline_delayed(plays: list[Playback], parameters: Mapping) -> dict[tuple[str, int], Tracks]:
    """What the offline ring tells with delay, by sensor and stamp, as far as it is final."""
    ring = Ring(parameters)
    told = []
    for play in plays:
        if play.initial is not None:
            ring.initialise(play.initial)
            told += ring.manager.delayed
        for detections in play.detections:
            told += ring.process(detections).delayed
    return {(tracks.key.sensor_id, tracks.key.stamp_ns): tracks for tracks in told}


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
