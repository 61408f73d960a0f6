"""Speed offline: CPU time per scan of the ring and of Stone Soup on the same scene.

Each run is a process of its own with one thread; gda_tracker runs before and after the peer, so
that a change of the machine's load shows. The scene is written to a ``scan_npz`` file that both
read. Accuracy is measured in the same runs, so that speed is not bought by bad tracks.

    python -m benchmarks.offline_vs_stonesoup
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import stonesoup_peer
from benchmarks.measuring import RESULTS, table, write_results
from benchmarks.scenarios import SceneParameters, save_scene
from benchmarks.scoring import score_scene
from gda_tracker.io.adapters import load_recording
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import Tracks

TARGETS = (10, 50, 100, 200)
METHODS = ("gda/none/cv", "gda/dsm_classic/cv", "map/bayes/cv")
GNN, GNN_KDTREE = "Stone Soup GNN", "Stone Soup GNN, k-d tree"
JPDA_KDTREE = "Stone Soup JPDA, EHM2, k-d tree"
PEERS = (GNN, GNN_KDTREE, JPDA_KDTREE)

# The same for both: what is known of the scene, and the life of a track.
PROCESS_NOISE = 100.0  # m2/s3
GATE_PROBABILITY = 0.9999
CONFIRMATION_HITS, CONFIRMATION_SCANS = 3, 4
TENTATIVE_DELETION_MISSES, DELETION_MISSES = 2, 4
PRIOR_SPEED_STD_MPS = 200.0
MAX_SPEED_MPS = 300.0
# A k-d tree over (azimuth [rad], range [m]) prunes in range alone: what a new track may be off.
KDTREE_DISTANCE = 4_000.0


def run(tracker: str, scene: str) -> dict[str, Any]:
    """Run one tracker over a scene file: CPU times and scores."""
    recording = load_recording(scene, "scan_npz")
    assert recording.truth is not None
    if tracker in PEERS:
        tracks, cpu_s = _run_stonesoup(recording, tracker)
    else:
        tracks, cpu_s = _run_ring(recording, tracker)
    return {
        "tracker": tracker,
        # The CPU clock may tick in steps of milliseconds: the mean is exact, single scans are not.
        "cpu_ms_per_scan": 1e3 * float(np.mean(cpu_s)),
        "scans": len(cpu_s),
        **score_scene(tracks, recording.truth),
    }


def _run_ring(recording: Recording, method: str) -> tuple[list[Tracks], list[float]]:
    period_s = (recording.detections[1].stamp_ns - recording.detections[0].stamp_ns) / 1e9
    manager = {
        **recording.preset["track_manager"],
        **parse_method(method),
        # The same variance of the speed after one scan as the peer's: (a T)^2 = q T.
        "process_noise_std_mps2": math.sqrt(PROCESS_NOISE / period_s),
        "gate_probability": GATE_PROBABILITY,
        "confirmation_hits": CONFIRMATION_HITS,
        "confirmation_scans": CONFIRMATION_SCANS,
        "tentative_deletion_misses": TENTATIVE_DELETION_MISSES,
        "deletion_misses": DELETION_MISSES,
        "max_speed_mps": MAX_SPEED_MPS,
    }
    ring = Ring({**recording.preset, "track_manager": manager})
    tracks, cpu_s = [], []
    for detections in recording.detections:
        begin = time.process_time()
        result = ring.process(detections)
        cpu_s.append(time.process_time() - begin)
        if result.tracks is None:
            raise RuntimeError(f"scan rejected: {result.report.reason}")
        tracks.append(result.tracks)
    return tracks, cpu_s


def _run_stonesoup(recording: Recording, tracker: str) -> tuple[list[Tracks], list[float]]:
    range_std, azimuth_std = (
        recording.detections[0].range_std_m,
        recording.detections[0].azimuth_std_rad,
    )
    assert range_std is not None
    assert azimuth_std is not None
    settings = stonesoup_peer.PeerSettings(
        range_std_m=float(range_std[0]),
        azimuth_std_rad=float(azimuth_std[0]),
        process_noise=PROCESS_NOISE,
        prior_speed_std=PRIOR_SPEED_STD_MPS,
        gate_probability=GATE_PROBABILITY,
        minimum_points=CONFIRMATION_HITS,
        tentative_deletion_misses=TENTATIVE_DELETION_MISSES,
        deletion_misses=DELETION_MISSES,
        kdtree_distance=0.0 if tracker == GNN else KDTREE_DISTANCE,
        joint_probabilities=tracker == JPDA_KDTREE,
        detection_probability=recording.preset["track_manager"]["detection_probability"],
        clutter_density=recording.preset["track_manager"]["clutter_density_per_m_rad"],
    )
    return stonesoup_peer.track(recording.detections, settings)


def in_own_process(tracker: str, scene: str) -> dict[str, Any]:
    """Run one tracker in a fresh process."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as pool:
        return pool.submit(run, tracker, scene).result()


def compare(targets: int, scene: str, methods: list[str], peers: list[str]) -> list[dict[str, Any]]:
    """Run all trackers on one scene: our methods, the peers, our methods again."""
    ours = {method: [in_own_process(method, scene)] for method in methods}
    theirs = [in_own_process(peer, scene) for peer in peers]
    for method in methods:
        ours[method].append(in_own_process(method, scene))
    results = []
    for repeats in ours.values():
        both = [r["cpu_ms_per_scan"] for r in repeats]
        results.append({**repeats[0], "cpu_ms_per_scan": float(np.mean(both)), "cpu_ms_runs": both})
    for result in results:
        for peer in theirs:
            ratio = peer["cpu_ms_per_scan"] / result["cpu_ms_per_scan"]
            result["faster_than " + peer["tracker"]] = ratio
    return [{"targets": targets, **result} for result in results + theirs]


def row(result: dict[str, Any]) -> list[Any]:
    """One line of the table."""
    return [
        result["tracker"],
        result["targets"],
        round(result["cpu_ms_per_scan"], 2),
        *(result.get(f"faster_than {peer}") for peer in PEERS),
        *(round(result[name], 1) for name in ("ospa_m", "rmse_m")),
        *(round(result[name], 2) for name in ("missed_percent", "false_percent")),
        result["switches"],
        result["flips"],
    ]


def main(arguments: list[str] | None = None) -> int:
    """Print the table, write the JSON file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--targets", type=int, nargs="+", default=list(TARGETS))
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", action="append", help=f"default: {', '.join(METHODS)}")
    parser.add_argument(
        "--peer-limit",
        type=int,
        default=1_000_000,
        metavar="N",
        help="leave Stone Soup out above N targets (it takes minutes at 200)",
    )
    parser.add_argument("--json", type=Path, default=RESULTS / "offline_vs_stonesoup.json")
    a = parser.parse_args(arguments)
    columns = [
        "tracker",
        "targets",
        "cpu_ms/scan",
        "x GNN",
        "x k-d tree",
        "x JPDA",
        "ospa_m",
        "error_m",
    ]
    columns += ["missed_%", "false_%", "switches", "flips"]
    results: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for n in a.targets:
            scene = SceneParameters(n, n / 2, a.seed, a.scans)
            path = save_scene(Path(folder) / f"targets_{n}.npz", scene)
            peers = list(PEERS) if stonesoup_peer.available() and n <= a.peer_limit else []
            results += compare(n, str(path), a.method or list(METHODS), peers)
            print(table(columns, [row(r) for r in results if r["targets"] == n]), flush=True)
            print()
    print(
        "x GNN, x k-d tree, x JPDA: how many times less CPU time than Stone Soup's GNN, its GNN "
        "with k-d tree, its JPDA with EHM2 and k-d tree."
    )
    if not stonesoup_peer.available():
        print(stonesoup_peer.INSTALL)
    settings = {"seed": a.seed, "scans": a.scans, "clutter": "targets / 2", "results": results}
    print(f"written: {write_results(a.json, settings)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
