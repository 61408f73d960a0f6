"""Node ``evaluator``: scores ``tracks`` against ``truth`` while they come.

Recordings and automatic initiation are scored by continuity (completeness, switches); runs that
start from labelled tracks by purity as well. The scores go to diagnostics and, on request, to a
JSON file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gda_tracker_msgs import msg

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.summary import pair_with_truth, run_purity
from gda_tracker.io.messages import (
    MessageError,
    scan_report_from_message,
    scan_truth_from_message,
    tracks_from_message,
)
from gda_tracker.nodes.base import RingNode, spin_node
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.parameters import parameter
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

MAX_SCANS = 100_000


@dataclass(frozen=True)
class EvaluatorParameters:
    """How to score and where to write."""

    match_distance_m: float = parameter(
        25.0,
        "a target counts as tracked if a confirmed track is this near",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    truth_is_partial: bool = parameter(
        False, "tracks elsewhere may follow real objects: count no false tracks"
    )
    output: str = parameter("", "JSON file for the scores at the end; empty: none", live=False)


class EvaluatorNode(RingNode):
    """``tracks`` and ``tracks_delayed``, ``truth``, ``initial_tracks``, reports in, scores out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("evaluator", EvaluatorParameters, parameters, **options)
        self._tracks: dict[tuple[str, int], Tracks] = {}
        self._delayed: dict[tuple[str, int], Tracks] = {}
        self._truth: dict[tuple[str, int], ScanTruth] = {}
        self._latency: dict[tuple[str, int], float] = {}
        self._labelled = False
        self._scored: tuple[int, dict[str, Any]] = (0, {})

    def open_topics(self) -> None:
        """Subscribe."""
        self.subscribe(
            msg.TrackArray, "tracks", lambda m: self._on_tracks(m, self._tracks), stream(1000)
        )
        self.subscribe(
            msg.TrackArray,
            "tracks_delayed",
            lambda m: self._on_tracks(m, self._delayed),
            stream(1000),
        )
        self.subscribe(msg.ScanTruth, "truth", self._on_truth, stream(1000))
        self.subscribe(msg.ScanReport, "scan_reports", self._on_report, stream(1000))
        self.subscribe(msg.TrackArray, "initial_tracks", self._on_initial, latched())

    def _on_initial(self, message: Any) -> None:
        self._labelled = True

    def _keep(self, store: dict[tuple[str, int], Any], key: tuple[str, int], value: Any) -> None:
        if key in store:
            return  # a repeated answer
        if len(store) >= MAX_SCANS:
            self.drop("too_many_scans", f"only {MAX_SCANS} are scored")
            return
        store[key] = value

    def _on_tracks(self, message: Any, store: dict[tuple[str, int], Tracks]) -> None:
        try:
            tracks = tracks_from_message(message)
        except MessageError as error:
            self.drop("malformed_tracks", str(error))
            return
        self._keep(store, (tracks.key.sensor_id, tracks.key.stamp_ns), tracks)

    def _on_truth(self, message: Any) -> None:
        try:
            truth = scan_truth_from_message(message)
        except MessageError as error:
            self.drop("malformed_truth", str(error))
            return
        self._keep(self._truth, (truth.sensor_id, truth.stamp_ns), truth)

    def _on_report(self, message: Any) -> None:
        report = scan_report_from_message(message)
        if report.outcome == "tracked" and not report.repeated:
            self._latency[(report.key.sensor_id, report.key.stamp_ns)] = report.latency_s

    def collected(self) -> tuple[dict[tuple[str, int], Tracks], dict[tuple[str, int], ScanTruth]]:
        """Tracks and truth that have come so far, by sensor and stamp."""
        return self._tracks, self._truth

    def scores(self) -> dict[str, Any]:
        """Scores over all scans for which both tracks and truth have come, run by run."""
        runs = pair_with_truth(self._tracks, self._truth)
        result: dict[str, Any] = {"scans": sum(len(run.tracks) for run in runs), "runs": len(runs)}
        if not runs:
            return result
        p = self.parameters
        found = [
            score_continuity(
                run.tracks,
                run.truth,
                match_distance_m=p.match_distance_m,
                truth_is_partial=p.truth_is_partial,
            )
            for run in runs
        ]
        result |= {
            "match_distance_m": p.match_distance_m,
            "completeness": float(np.mean([score.completeness for score in found])),
            "identity_switches": sum(score.identity_switches for score in found),
            "identity_flips": sum(score.identity_flips for score in found),
            "confirmed_tracks": sum(score.confirmed_tracks for score in found),
            "false_tracks": (
                None if p.truth_is_partial else sum(score.false_tracks or 0 for score in found)
            ),
            "per_run": [
                {
                    "target_id": score.target_id.tolist(),
                    "completeness": score.completeness_per_target.tolist(),
                    "identity_switches": score.switches.tolist(),
                    "position_rmse_m": score.position_rmse_m,
                }
                for score in found
            ],
        }
        latency = list(self._latency.values())
        if latency:
            result |= {
                "latency_ms_median": 1e3 * float(np.median(latency)),
                "latency_ms_p99": 1e3 * float(np.percentile(latency, 99)),
            }
        if self._labelled:
            result["purity_per_run"] = [run_purity(run) for run in runs]
            result["purity_mean"] = float(np.mean(result["purity_per_run"]))
            delayed = pair_with_truth(self._delayed, self._truth)
            if delayed:
                # Of the scans whose past has been told; those of the last N scans are not yet.
                result["purity_delayed_per_run"] = [run_purity(run) for run in delayed]
                result["purity_delayed_mean"] = float(np.mean(result["purity_delayed_per_run"]))
        return result

    def figures(self) -> dict[str, Any]:
        """The scores for diagnostics, computed again when a tenth more scans have come."""
        scans, known = len(self._tracks), self._scored[0]
        if scans > known + known // 10:
            self._scored = (len(self._tracks), self.scores())
        return self._scored[1]

    def close(self) -> None:
        """Write the scores."""
        if self.parameters.output:
            path = Path(self.parameters.output)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self.scores(), indent=1) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(EvaluatorNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
