"""Results of a Monte Carlo evaluation: means over runs with standard errors, paired differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.evaluation.purity import confusion, purity
from gda_tracker.evaluation.quality_results import QualityResult, combine_quality
from gda_tracker.evaluation.runs import RunScore
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True)
class MethodResult:
    """One method on one scenario.

    ``score`` (runs,) is what the methods are compared by: the purity of a run averaged over tracks,
    or with automatic initiation its completeness. ``difference_mean`` and ``difference_stderr`` are
    those of ``score`` minus the score of the first method in the same run. ``delayed`` (runs,) is
    the purity with the revised past, for methods that revise it.
    """

    method: str
    score: FloatArray
    score_mean: float
    score_stderr: float
    difference_mean: float
    difference_stderr: float
    cpu_ms_per_scan: float
    purity_per_track: FloatArray | None = None
    confusion: FloatArray | None = None
    quality: QualityResult | None = None
    delayed: FloatArray | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``methods`` in the JSON; a number that does not exist is ``None``."""
        entry: dict[str, Any] = {
            "method": self.method,
            "purity_mean": None,
            "purity_stderr": None,
            "purity_per_track": None,
            "confusion": None,
            "missed": None,
            "false_alarm": None,
            "cpu_ms_per_scan": self.cpu_ms_per_scan,
            "difference_mean": self.difference_mean,
            "difference_stderr": self.difference_stderr,
            **({} if self.quality is None else self.quality.values),
        }
        if self.confusion is not None and self.purity_per_track is not None:
            entry["purity_mean"] = self.score_mean
            entry["purity_stderr"] = self.score_stderr
            entry["purity_per_track"] = self.purity_per_track.tolist()
            entry["confusion"] = self.confusion.tolist()
            entry["missed"] = float(self.confusion[:, -2].mean())
            entry["false_alarm"] = float(self.confusion[:, -1].mean())
        if self.delayed is not None:
            entry["purity_delayed_mean"], entry["purity_delayed_stderr"] = mean_and_stderr(
                self.delayed
            )
        return {name: _finite_or_none(value) for name, value in entry.items()}


@dataclass(frozen=True)
class ScenarioResult:
    """All methods on one scenario; ``n_scored_scans`` per run."""

    scenario: Scenario
    runs: int
    seed: int
    initiation: str
    n_scored_scans: int
    methods: list[MethodResult]
    match_distance_m: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object; a number that does not exist is ``None``."""
        found = {
            "scenario": self.scenario.name,
            "runs": self.runs,
            "seed": self.seed,
            "methods": [method.to_dict() for method in self.methods],
            "initiation": self.initiation,
            "scored_scans_per_run": self.n_scored_scans,
            "difference_to": self.methods[0].method,
        }
        if self.match_distance_m is not None:
            found["match_distance_m"] = self.match_distance_m
        return found


def combine(
    scenario: Scenario,
    methods: Sequence[str],
    seed: int,
    initiation: str,
    match_distance_m: float | None,
    scores: Sequence[Sequence[RunScore]],
) -> ScenarioResult:
    """Combine the scores of all runs (one list of scores per run, by method) of one scenario."""
    results: list[MethodResult] = []
    for column, method in enumerate(methods):
        results.append(
            _method_result(method, [run[column] for run in scores], results[0] if results else None)
        )
    return ScenarioResult(
        scenario=scenario,
        runs=len(scores),
        seed=seed,
        initiation=initiation,
        n_scored_scans=scores[0][0].n_scans,
        methods=results,
        match_distance_m=match_distance_m,
    )


def _method_result(method: str, runs: list[RunScore], first: MethodResult | None) -> MethodResult:
    tables = [run.counts for run in runs if run.counts is not None]
    quality = None
    shares = per_track = delayed = None
    revised = [run.delayed_counts for run in runs if run.delayed_counts is not None]
    if revised:
        delayed = purity(np.stack(revised)).mean(axis=1)
    if tables:
        counts = np.stack(tables)
        score = purity(counts).mean(axis=1)
        # Every run scores the same number of scans, so that shares may be averaged or pooled.
        shares = confusion(counts.sum(axis=0))
        per_track = purity(counts.sum(axis=0))
    else:
        quality = combine_quality([run.quality for run in runs if run.quality is not None])
        score = quality.completeness
    mean, stderr = mean_and_stderr(score)
    against = score if first is None else first.score
    difference, difference_stderr = mean_and_stderr(score - against)
    return MethodResult(
        method=method,
        score=score,
        score_mean=mean,
        score_stderr=stderr,
        difference_mean=difference,
        difference_stderr=difference_stderr,
        cpu_ms_per_scan=1e3 * sum(run.cpu_s for run in runs) / sum(run.n_scans for run in runs),
        purity_per_track=per_track,
        confusion=shares,
        quality=quality,
        delayed=delayed,
    )


def _finite_or_none(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
