"""Latency of a scan through the four nodes as four processes over DDS.

A probe publishes one scan at a time, waits for its tracks and its report, and sends the next. Three
figures per scan: what the report says (admitted to tracks published), the round trip seen by the
probe (before its message is published to tracks received), and the times at which each topic was
published, which the middleware stamps on every message. Scenes follow one another; with each the
tracker starts anew, so its first scans are left out, as is the whole first scene.

    python -m benchmarks.ring_latency
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import RESULTS, cpu_seconds, table, write_results
from benchmarks.scenarios import SceneParameters, save_scene
from gda_tracker.io.adapters import load_recording
from gda_tracker.simulation.playback import RUN_SPACING_NS
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections

TARGETS = (10, 50, 100, 200)
METHOD = "gda/dsm_classic/cv"
SCENES = 9
WARM_UP_SCANS = 8
SCAN_TIMEOUT_S = 60.0
# What is published in which order; the last one closes the scan.
STAGES = (
    ("door, prediction", "detections", "scans"),
    ("rcs_fuzzifier", "scans", "evidence"),
    ("attribute_fusion", "evidence", "attribute_scores"),
    ("association", "attribute_scores", "associations"),
    ("update, tracks", "associations", "tracks"),
)
TOPICS = ("detections", "scans", "evidence", "attribute_scores", "associations", "tracks")


def scenes_of(
    targets: int, scans: int, seed: int, folder: Path, method: str
) -> tuple[list[list[Detections]], dict[str, dict[str, Any]]]:
    """Scans of all scenes one after the other in time, and the parameters of the nodes."""
    scenes: list[list[Detections]] = []
    recording: Recording | None = None
    for k in range(SCENES):
        scene = SceneParameters(targets, targets / 2, seed + k, scans)
        path = save_scene(folder / f"{targets}_{k}.npz", scene)
        recording = load_recording(path, "scan_npz")
        for detections in recording.detections:
            detections.stamp_ns += k * RUN_SPACING_NS
        scenes.append(recording.detections)
    assert recording is not None
    parameters = {node: dict(values) for node, values in recording.preset.items()}
    parameters["track_manager"] |= parse_method(method)
    return scenes, parameters


def warm(values: Sequence[Sequence[float]]) -> np.ndarray:
    """Values of all scans that count: neither the first scene nor the first scans of the others."""
    return np.concatenate([np.asarray(scene[WARM_UP_SCANS:], dtype=float) for scene in values[1:]])


def through_processes(
    scenes: Sequence[Sequence[Detections]],
    parameters: Mapping[str, Mapping[str, Any]],
    observe: bool,
) -> tuple[dict[str, list[list[float]]], dict[str, float]]:
    """Play all scenes through four processes.

    Returns
    -------
    dict
        Per scene and scan: ``latency`` of the report and ``round_trip`` [s]; with ``observe`` also
        the time from one publication to the next under the names of ``STAGES`` [s].
    dict
        CPU time per scan of each process, over all scenes but the first [s].
    """
    from benchmarks.probe import Probe
    from gda_tracker.nodes.runner import Nodes, RingProcesses, private_environment, use_environment

    environment = private_environment()
    use_environment(environment)
    topics = TOPICS if observe else ()
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(lambda **options: [Probe(topics, **options)]) as nodes,
    ):
        probe = nodes.nodes[0]

        def watch() -> None:
            failure = ring.failed()
            if failure:
                raise RuntimeError(failure)

        def watch_and_resend() -> None:
            watch()
            probe.resend()

        if not nodes.spin_until(probe.matched, SCAN_TIMEOUT_S, watch):
            raise RuntimeError("the ring did not come up")
        found: dict[str, list[list[float]]] = {}
        begin: dict[str, float] = {}
        for number, scene in enumerate(scenes):
            if number == 1:
                begin = {name: cpu_seconds(p.pid) for name, p in ring.processes.items()}
            for values in found.values():
                values.append([])
            for detections in scene:
                probe.send(detections)
                if not nodes.spin_until(probe.complete, SCAN_TIMEOUT_S, watch_and_resend):
                    raise RuntimeError(f"no answer to the scan of {detections.stamp_ns} ns")
                if number:
                    _check(probe)
                for name, value in _figures(probe, observe).items():
                    found.setdefault(name, [[]])[-1].append(value)
        scans = sum(len(scene) for scene in scenes[1:])
        cpu = {
            name: (cpu_seconds(process.pid) - begin[name]) / scans
            for name, process in ring.processes.items()
        }
        return found, cpu


def _check(probe: Any) -> None:
    """Refuse to measure what was sent twice or not tracked."""
    report = probe.report
    if report.outcome != "tracked" or report.retries or probe.resent:
        raise RuntimeError(
            f"scan of {report.key.stamp_ns} ns: {report.outcome} {report.reason}, {report.retries} "
            f"retries, sent again {probe.resent} times: no valid measurement"
        )


def _figures(probe: Any, observe: bool) -> dict[str, float]:
    """Times of the scan that was just answered [s]."""
    report = probe.report
    values = {"latency": report.latency_s, "round_trip": probe.round_trip_s}
    if observe:
        stamps = probe.published_ns
        values |= {name: (stamps[end] - stamps[begin]) / 1e9 for name, begin, end in STAGES}
    return values


def offline(
    scenes: Sequence[Sequence[Detections]], parameters: Mapping[str, Mapping[str, Any]]
) -> dict[str, list[list[float]]]:
    """The same scans offline: CPU time of ``total`` and of each stage's own computing [s]."""
    from benchmarks.stage_times import StageTimes

    found: dict[str, list[list[float]]] = {}
    times = StageTimes(Ring(parameters))
    for scene in scenes:
        for values in found.values():
            values.append([])
        for detections in scene:
            for name, value in times.process(detections).items():
                found.setdefault(name, [[]])[-1].append(value)
    return found


def measure(targets: int, scans: int, seed: int, method: str, stages: bool) -> dict[str, Any]:
    """All figures for one number of targets, in ms."""
    with tempfile.TemporaryDirectory() as folder:
        scenes, parameters = scenes_of(targets, scans, seed, Path(folder), method)
    through, cpu = through_processes(scenes, parameters, observe=False)
    passes = {"processes": through}
    passes["offline"] = offline(scenes, parameters)
    if stages:
        passes["publications"] = through_processes(scenes, parameters, observe=True)[0]
    result: dict[str, Any] = {"targets": targets, "method": method}
    result["cpu_ms_per_scan"] = {name: 1e3 * seconds for name, seconds in cpu.items()}
    for name, figures in passes.items():
        result[name] = {key: _summary(warm(values)) for key, values in figures.items()}
    result["scans"] = len(warm(passes["processes"]["latency"]))
    return result


def _summary(seconds: np.ndarray) -> dict[str, float]:
    return {
        "median_ms": 1e3 * float(np.median(seconds)),
        "p99_ms": 1e3 * float(np.percentile(seconds, 99)),
    }


def main(arguments: list[str] | None = None) -> int:
    """Print the tables, write the JSON file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--targets", type=int, nargs="+", default=list(TARGETS))
    parser.add_argument("--scans", type=int, default=40, help="per scene")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default=METHOD)
    parser.add_argument("--no-stages", action="store_true", help="leave out where the time goes")
    parser.add_argument("--json", type=Path, default=RESULTS / "ring_latency.json")
    a = parser.parse_args(arguments)
    if a.scans <= WARM_UP_SCANS:
        parser.error(f"--scans {a.scans}: allowed is more than {WARM_UP_SCANS}")
    results = [measure(n, a.scans, a.seed, a.method, not a.no_stages) for n in a.targets]

    def cell(result: dict[str, Any], how: str, name: str, figure: str = "median_ms") -> float:
        return round(result[how][name][figure], 2)

    rows = [
        [r["targets"], r["scans"]]
        + [cell(r, "processes", "latency", f) for f in ("median_ms", "p99_ms")]
        + [cell(r, "processes", "round_trip", f) for f in ("median_ms", "p99_ms")]
        + [cell(r, "offline", "total")]
        for r in results
    ]
    print(f"\n{a.method}, clutter targets / 2, four processes, ms")
    columns = [
        "targets",
        "scans",
        "latency median",
        "p99",
        "round trip median",
        "p99",
        "offline CPU",
    ]
    print(table(columns, rows))
    print(
        f"warm-up left out: the first of {SCENES} scenes, and the first {WARM_UP_SCANS} of "
        f"{a.scans} scans of the others"
    )
    if not a.no_stages:
        print("\nwhere it goes: median ms from publication to publication (CPU of computing alone)")
        names = [name for name, _, _ in STAGES]
        rows = [
            [r["targets"]]
            + [f"{cell(r, 'publications', n)} ({cell(r, 'offline', n)})" for n in names]
            for r in results
        ]
        print(table(["targets", *names], rows))
    print("\nCPU time per scan of each process, ms")
    nodes = list(results[0]["cpu_ms_per_scan"])
    rows = [
        [r["targets"], *(round(r["cpu_ms_per_scan"][node], 2) for node in nodes)] for r in results
    ]
    print(table(["targets", *nodes], rows))
    content = {"warm_up_scans": WARM_UP_SCANS, "scenes": SCENES, "results": results}
    print(f"written: {write_results(a.json, {'seed': a.seed, **content})}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
