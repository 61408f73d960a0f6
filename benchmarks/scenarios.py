"""Surveillance scenes for benchmarks: N targets, alone and in groups, false alarms, RCS.

A scene is a function of its parameters and seed alone. It is written in the ``scan_npz`` format,
which any tracker can read (no pickles; s, rad, m, m/s, m2):

====================  ===============================================================
``times``             (K,) scan times
``scan_ptr``          (K+1,) detections of scan k are the rows scan_ptr[k]:scan_ptr[k+1]
``azimuth``           (D,) from North, clockwise, in (-pi, pi]
``range``, ``rcs``    (D,)
``truth_id``          (D,) target, -1 for a false alarm
``truth_state``       (K, N, 4) x East, v East, y North, v North
``truth_type``        (N,) 0 fighter, 1 cargo
``truth_group``       (N,) targets of a group fly close together
``meta``              () the parameters as a JSON string
====================  ===============================================================

    python -m benchmarks.scenarios --targets 50 --out scene.npz
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gda_tracker.attributes.rcs import sample
from gda_tracker.simulation.scenarios import Manoeuvre, Target
from gda_tracker.simulation.targets import target_states
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

CLASS_NAMES = ("fighter", "cargo")
CLASS_RCS_M2 = (1.2, 4.0)
CLASS_SWERLING = 3
CLUTTER_SWERLING = 2
FALSE_ALARM = -1


@dataclass(frozen=True)
class SceneParameters:
    """What a scene is made of; lengths in m, times in s, speeds in m/s, angles in rad."""

    targets: int
    clutter: float
    seed: int = 1
    scans: int = 40
    scan_period: float = 5.0
    sigma_azimuth: float = math.radians(0.3)
    sigma_range: float = 60.0
    p_detect: float = 0.99
    range_min: float = 5_000.0
    range_max: float = 120_000.0
    slowest: float = 120.0
    fastest: float = 260.0
    closest: float = 400.0
    widest: float = 1_200.0
    mean_rcs_clutter: float = 0.3

    def __post_init__(self) -> None:
        for name, least in (("targets", 1), ("scans", 3), ("clutter", 0.0), ("seed", 0)):
            value = getattr(self, name)
            if not value >= least:
                raise ValueError(f"{name} = {value}: allowed is >= {least}")

    @property
    def clutter_density(self) -> float:
        """False alarms per scan, metre of range and radian of azimuth."""
        return self.clutter / (2.0 * math.pi * (self.range_max - self.range_min))


def make_scene(p: SceneParameters) -> dict[str, np.ndarray]:
    """Make a scene: the arrays of the ``scan_npz`` format.

    Targets fly straight legs and coordinated turns of 0.2 to 0.8 g. About half of them fly in
    groups of two to four, ``closest`` to ``widest`` from their neighbours, either in formation or
    on paths that cross in the middle of the scene. Neighbours differ in class. False alarms are
    uniform in range and azimuth.
    """
    paths, chances, clutter_rng, order_rng = (
        np.random.default_rng(s) for s in np.random.SeedSequence([p.seed, p.targets]).spawn(4)
    )
    states, group = _fly(p, paths)
    kinds = np.arange(p.targets) % 2
    seen = chances.random((p.scans, p.targets)) < p.p_detect
    noise = chances.standard_normal((p.scans, p.targets, 2))
    x, y = states[..., 0], states[..., 1]
    ranges = np.hypot(x, y) + p.sigma_range * noise[..., 0]
    azimuths = np.arctan2(x, y) + p.sigma_azimuth * noise[..., 1]
    rcs = sample(chances, np.asarray(CLASS_RCS_M2)[kinds], CLASS_SWERLING, seen.shape)
    scan, target = np.nonzero(seen)

    counts = clutter_rng.poisson(p.clutter, p.scans)
    total = int(counts.sum())
    all_scans = np.concatenate([scan, np.repeat(np.arange(p.scans), counts)])
    # A random order within the scan tells nothing about where a detection comes from.
    order = np.lexsort((order_rng.random(len(all_scans)), all_scans))
    all_azimuths = np.concatenate([azimuths[seen], clutter_rng.uniform(-math.pi, math.pi, total)])
    all_ranges = np.concatenate(
        [ranges[seen], clutter_rng.uniform(p.range_min, p.range_max, total)]
    )
    clutter_rcs = sample(clutter_rng, p.mean_rcs_clutter, CLUTTER_SWERLING, total)
    meta = {
        **asdict(p),
        "clutter_density": p.clutter_density,
        "mean_rcs": CLASS_RCS_M2,
        "classes": CLASS_NAMES,
    }
    return {
        "times": np.arange(p.scans) * p.scan_period,
        "scan_ptr": np.searchsorted(all_scans[order], np.arange(p.scans + 1)),
        "azimuth": _wrap(all_azimuths[order]),
        "range": all_ranges[order],
        "rcs": np.concatenate([rcs[seen], clutter_rcs])[order],
        "truth_id": np.concatenate([target, np.full(total, FALSE_ALARM)])[order],
        "truth_state": states[..., [0, 2, 1, 3]],
        "truth_type": kinds,
        "truth_group": group,
        "meta": np.array(json.dumps(meta)),
    }


def save_scene(path: Path, p: SceneParameters) -> Path:
    """Make a scene and write it; returns the path."""
    np.savez_compressed(path, **make_scene(p))
    return path


def _fly(p: SceneParameters, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """States (K, N, 4) x, y, vx, vy of all targets, and the group (N,) of each."""
    states: list[FloatArray] = []
    group: list[int] = []
    while len(states) < p.targets:
        # One flight in four is a group of two to four: half of all targets fly in company.
        size = int(rng.integers(2, 5)) if rng.random() < 0.25 else 1
        members = _flight(p, size, rng)[: p.targets - len(states)]
        group += [group[-1] + 1 if group else 0] * len(members)
        states += members
    return np.stack(states, axis=1), np.array(group)


def _flight(p: SceneParameters, size: int, rng: np.random.Generator) -> list[FloatArray]:
    """Paths (K, 4) of one group of targets, within the coverage of the radar."""
    margin = 4.0 * p.widest
    while True:
        leader = _leader(p, rng)
        distance = np.hypot(leader[:, 0], leader[:, 1])
        if distance.min() > p.range_min + margin and distance.max() < p.range_max - margin:
            break
    spacing = rng.uniform(p.closest, p.widest)
    crossing = rng.random() < 0.5
    middle = leader[p.scans // 2, :2]
    heading = leader[0, 2:] / np.hypot(*leader[0, 2:])
    side = np.array([heading[1], -heading[0]])
    reach = float(np.hypot(*(leader[0, :2] - middle)))
    members = []
    for k in range(size):
        trail = -0.4 * spacing * (k % 2) * heading
        if crossing:
            # The leader's path turned about its middle: it starts k spacings aside and ends on the
            # other side.
            angle = 2.0 * math.asin(min(0.5 * k * spacing / max(reach, spacing), 0.5))
            members.append(_moved(leader, middle, angle, trail))
        else:
            members.append(_moved(leader, middle, 0.0, trail + k * spacing * side))
    return members


def _leader(p: SceneParameters, rng: np.random.Generator) -> FloatArray:
    """A path (K, 4) with up to two turns that starts anywhere within the coverage."""
    start = rng.uniform(0.2, 0.7) * p.range_max
    bearing = rng.uniform(-math.pi, math.pi)
    turns = []
    for half in range(int(rng.integers(0, 3))):
        # One turn in either half of the scene, so that they do not overlap.
        begin = 1.0 + 0.5 * p.scans * (half + rng.uniform(0.0, 0.5))
        turns.append(
            Manoeuvre(
                start_scan=begin,
                end_scan=begin + rng.uniform(0.1, 0.4) * 0.5 * p.scans,
                lateral_acceleration_g=float(rng.uniform(0.2, 0.8)),
                turn=str(rng.choice(["left", "right"])),
            )
        )
    target = Target(
        id=1,
        class_name=CLASS_NAMES[0],
        rcs_mean_m2=CLASS_RCS_M2[0],
        rcs_swerling=CLASS_SWERLING,
        initial_position_m=(start * math.sin(bearing), start * math.cos(bearing)),
        speed_mps=float(rng.uniform(p.slowest, p.fastest)),
        initial_heading_deg_ccw_from_north=float(rng.uniform(0.0, 360.0)),
        manoeuvres=tuple(turns),
    )
    times = np.arange(p.scans, dtype=np.float64) * p.scan_period
    return target_states(target, times, p.scan_period)


def _moved(path: FloatArray, centre: FloatArray, angle: float, shift: FloatArray) -> FloatArray:
    """A path turned about a centre, then shifted."""
    c, s = math.cos(angle), math.sin(angle)
    rotation = np.array([[c, s], [-s, c]])
    position = (path[:, :2] - centre) @ rotation + centre + shift
    return np.concatenate([position, path[:, 2:] @ rotation], axis=1)


def _wrap(angle: FloatArray) -> FloatArray:
    """Angles in (-pi, pi]."""
    return math.pi - np.mod(math.pi - angle, 2.0 * math.pi)


def main(arguments: list[str] | None = None) -> int:
    """Write one scene."""
    parser = argparse.ArgumentParser(description="Write a surveillance scene as scan_npz.")
    parser.add_argument("--targets", type=int, required=True)
    parser.add_argument("--clutter", type=float, help="false alarms per scan (default: targets/2)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args(arguments)
    clutter = a.targets / 2 if a.clutter is None else a.clutter
    save_scene(a.out, SceneParameters(a.targets, clutter, a.seed, a.scans))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
