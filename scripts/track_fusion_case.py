"""Two radars with biases of 1 km: their tracks, what is fused of them, and how right it is.

Nobody knows where both radars err together, so all is compared in the coordinates of the first one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from gda_tracker.fusion.combination import fuse_independent
from gda_tracker.fusion.fuser import Fusion, TrackFuser
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.several_radars import BiasedRadar, simulate_radars
from gda_tracker.tracking.methods import default_method
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

SCENARIO = Path(__file__).resolve().parent / "two_radars.yaml"
RADARS = (
    BiasedRadar("radar_1", (-18_000.0, 0.0), (600.0, 800.0)),
    BiasedRadar("radar_2", (18_000.0, -4_000.0), (-800.0, 600.0)),
)
RELATIVE_BIAS_M = np.array(RADARS[1].bias_m) - RADARS[0].bias_m
# The trackers' process noise is 2 m/s2, constant for a scan of 4 s.
FUSION: dict[str, Any] = {
    "radars": [radar.name for radar in RADARS],
    "track_process_noise_std_mps2": 2.0,
    "process_noise_density_m2ps3": 16.0,
}
MATCH_M = 600.0
WIDE_GATE_M = 3000.0
GATE_TAIL = 0.01


class Fused(Protocol):
    """What is scored: fused tracks with the tracks that they are made of."""

    mean: FloatArray
    covariance: FloatArray
    member: BoolArray
    member_track_id: IntArray


@dataclass
class Pairs:
    """Fused tracks of a simple method."""

    mean: FloatArray
    covariance: FloatArray
    member: BoolArray
    member_track_id: IntArray


@dataclass(frozen=True)
class RingCase:
    """One run of the scenario: a recording and the parameters of the ring for each radar."""

    recordings: Mapping[str, Recording]
    rings: Mapping[str, Mapping[str, Any]]

    @cached_property
    def tracks(self) -> list[dict[str, Tracks]]:
        """Tracks of each radar after each scan, without ROS."""
        rings = {name: Ring(values) for name, values in self.rings.items()}
        scans = range(len(next(iter(self.recordings.values())).detections))
        found: list[dict[str, Tracks]] = []
        for scan in scans:
            live = {}
            for name, ring in rings.items():
                tracks = ring.process(self.recordings[name].detections[scan]).tracks
                assert tracks is not None
                live[name] = tracks
            found.append(live)
        return found

    def truth(self, scan: int) -> FloatArray:
        """True states (T, 4)."""
        known = next(iter(self.recordings.values())).truth
        assert known is not None
        return known[scan].target_state

    def offline(self, scans: int | None = None, **changes: Any) -> list[Fusion]:
        """Last fusion of each scan, without ROS."""
        return fuse(self.tracks[:scans], {**FUSION, **changes})

    def over_topics(self, domain: int, scans: int | None = None) -> tuple[Any, Any]:
        """Client and node after the run over real topics."""
        from scripts.track_fusion_topics import play_over_topics

        return play_over_topics(self.recordings, self.rings, FUSION, domain, scans)


def ring_case(seed: int, run: int, method: str | None = None) -> RingCase:
    """Simulate a run."""
    recordings = simulate_radars(load_scenario(SCENARIO), RADARS, seed, run)
    by_name = {r.name: recording for r, recording in zip(RADARS, recordings, strict=True)}
    chosen = default_method() if method is None else method
    return RingCase(by_name, {name: with_method(r.preset, chosen) for name, r in by_name.items()})


def fuse(tracks: list[dict[str, Tracks]], parameters: Mapping[str, Any]) -> list[Fusion]:
    """Fuse the tracks of all scans; the last fusion of each."""
    fuser, found = TrackFuser(TrackFusionParameters(**parameters)), []
    for live in tracks:
        made: list[Fusion] = []
        for name, one in live.items():
            made += fuser.take(name, one)
        found.append(made[-1])
    return found


def nearest_neighbours(live: Mapping[str, Tracks], wide: bool) -> Pairs:
    """Join nearest tracks of two radars as if there were no bias, and fuse them (2.27-2.28).

    The gate is that of the tracks' covariances, or ``wide``, as far as biases might reach.
    """
    one, other = (confirmed(tracks) for tracks in live.values())
    gap = one.mean[:, None] - other.mean
    spread = one.covariance[:, None] + other.covariance
    if wide:
        cost, gate = np.hypot(gap[..., 0], gap[..., 1]), WIDE_GATE_M
    else:
        solved = np.linalg.solve(spread, gap[..., None])[..., 0]
        cost, gate = (gap * solved).sum(axis=2), float(chdtri(4, GATE_TAIL))
    rows, columns = linear_sum_assignment(np.minimum(cost, gate))
    inside = cost[rows, columns] < gate
    rows, columns = rows[inside], columns[inside]
    alone = [np.setdiff1d(np.arange(len(t)), used) for t, used in ((one, rows), (other, columns))]
    first = np.concatenate([rows, alone[0], np.full(len(alone[1]), -1)])
    second = np.concatenate([columns, np.full(len(alone[0]), -1), alone[1]])
    member = np.stack([first >= 0, second >= 0], axis=1)
    ids = np.stack([one.track_id[first], other.track_id[second]], axis=1)
    states = np.stack([one.mean[first], other.mean[second]], axis=1)
    covariances = np.stack([one.covariance[first], other.covariance[second]], axis=1)
    return Pairs(*fuse_independent(states, covariances, member), member, ids)


@dataclass
class _Rows:
    mean: FloatArray
    covariance: FloatArray
    track_id: IntArray

    def __len__(self) -> int:
        return len(self.track_id)


def confirmed(tracks: Tracks) -> _Rows:
    """Confirmed tracks alone, with one that stands for none behind them."""
    rows = tracks.status == CONFIRMED
    return _Rows(tracks.mean[rows], tracks.covariance[rows], tracks.track_id[rows])


def targets_of(case: RingCase, scan: int, live: Mapping[str, Tracks]) -> dict[str, dict[int, int]]:
    """Which target each confirmed track of each radar follows, by id; those of none are left out.

    The nearest track within ``MATCH_M`` of a target's place as the radar sees it.
    """
    found = {}
    for radar in RADARS:
        rows = confirmed(live[radar.name])
        place = case.truth(scan)[:, :2] - np.array(radar.bias_m)
        gap = np.linalg.norm(rows.mean[:, None, :2] - place, axis=2)
        tracks, targets = linear_sum_assignment(np.minimum(gap, MATCH_M))
        inside = gap[tracks, targets] < MATCH_M
        ids = rows.track_id[tracks[inside]].tolist()
        found[radar.name] = dict(zip(ids, targets[inside].tolist(), strict=True))
    return found


def fused_targets(fused: Fused, owners: Mapping[str, Mapping[int, int]]) -> list[set[int]]:
    """Targets that the tracks of each fused track follow; -1 for a track of none."""
    names = list(owners)
    return [
        {
            owners[names[radar]].get(int(fused.member_track_id[row, radar]), -1)
            for radar in fused.member[row].nonzero()[0]
        }
        for row in range(len(fused.mean))
    ]


def fused_once(case: RingCase, fused: Fused, live: Mapping[str, Tracks], scan: int) -> BoolArray:
    """Of each target that all radars track, whether one fused track holds these and no other."""
    owners = targets_of(case, scan, live)
    seen = set.intersection(*(set(owned.values()) for owned in owners.values()))
    about = fused_targets(fused, owners)
    whole = fused.member.all(axis=1)
    return np.array(
        [
            sum(target in one for one in about) == 1
            and any(one == {target} and all_ for one, all_ in zip(about, whole, strict=True))
            for target in sorted(seen)
        ]
    )
