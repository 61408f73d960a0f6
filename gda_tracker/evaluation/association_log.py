"""Why did it choose that? The decision on each scan in machine form, one JSON object per scan.

Every gated pair of a hypothesis and a detection stands there with each term of its decision: value,
threshold and whether it passed; beside it the strongest rival and what became of it. The log is
complete: with the numbers of a scan the decision can be made again. (docs/association-log.md)
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np

from gda_tracker.evaluation.group_entries import group_entries
from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.tracking.ring import RingResult
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import Tracks

MHT = "mht"
DECIDED_BY = {
    "gda": "p_generalised",
    "map": "log_likelihood_ratio",
    "jpda": "joint_marginal",
    MHT: "log_likelihood_ratio",
}
"""The term that each decision goes by: the larger, the rather the pair is chosen."""

CHOSEN = "chosen"
TRACK_ELSEWHERE = "track_has_another_detection"
DETECTION_ELSEWHERE = "detection_has_another_track"
BOTH_ELSEWHERE = "track_and_detection_are_elsewhere"
SHARED = "detection_is_shared"
NOT_WORTH_IT = "miss_and_false_alarm_preferred"
NOT_LEADING = "another_hypothesis_leads"

Term = tuple[FloatArray, FloatArray]


def pair_terms(
    predictions: Predictions, scores: AttributeScores | None, associations: Associations
) -> dict[str, Term]:
    """Values (P,) and thresholds (P,) of every term of the decision, by name.

    A pair passes ``mahalanobis_squared`` with a value at most, and every other term with a value at
    least, the threshold; NaN stands for no threshold.

    - ``mahalanobis_squared``: the gate, (14.1).
    - ``kinematic_log_likelihood`` log g [log 1/(m rad)]: from log[beta (1 - P_d) / P_d] on the pair
      alone is more likely than a miss and a false alarm.
    - ``attribute_log_likelihood``: from the false alarm's own likelihood on the attribute speaks
      for the pair.
    - ``log_likelihood_ratio``: both together, log[P_d g l / ((1 - P_d) beta l_false)], from 0 on.
    - ``attribute_distance``: where the term has one; no threshold.
    - ``p_kinematic``, ``p_attribute``, ``p_generalised``, ``joint_marginal``: as in
      :class:`~gda_tracker.vocabulary.hypotheses.Associations`; they compete, without a threshold.
    """
    decided, settings = associations, predictions.settings
    n = len(decided.hypothesis)
    none = np.full(n, np.nan)
    p_detection = predictions.detection_probability[decided.hypothesis]
    with np.errstate(divide="ignore"):
        log_idle = np.log(1.0 - p_detection) + np.log(settings.clutter_density)
        worth = log_idle - np.log(p_detection)
    attribute, clutter = decided.attribute_log_likelihood, np.zeros(n)
    if scores is not None and not decided.degraded:
        clutter = scores.clutter_log_likelihood[decided.detection]
    kinematic = decided.kinematic_log_likelihood
    with np.errstate(invalid="ignore"):
        ratio = kinematic - worth + attribute - clutter
    gate = np.full(n, gate_threshold(settings.gate_probability))
    terms = {
        "mahalanobis_squared": (decided.mahalanobis_squared, gate),
        "kinematic_log_likelihood": (kinematic, worth),
    }
    if decided.attribute_term != "none":
        terms["attribute_log_likelihood"] = (attribute, clutter)
    terms["log_likelihood_ratio"] = (ratio, np.zeros(n))
    if scores is not None and scores.has_distance:
        terms["attribute_distance"] = (scores.distance, none)
    for name in ("p_kinematic", "p_attribute", "p_generalised", "joint_marginal"):
        terms[name] = (getattr(decided, name), none)
    return terms


def strongest_rivals(
    value: FloatArray, hypothesis: Int32Array, detection: Int32Array
) -> Int32Array:
    """For each pair (P,) the one with the largest value that shares its hypothesis or detection.

    The pair itself is no rival; -1 where there is none.
    """
    rival = np.full(len(value), -1, dtype=np.int32)
    if not len(value):
        return rival
    best = np.full(len(value), -np.inf)
    for shared in (hypothesis, detection):
        # By group, the largest value first; the rival of that one is the second.
        order = np.lexsort((np.arange(len(value)), -value, shared))
        group = shared[order]
        first = np.flatnonzero(np.diff(group, prepend=-1) != 0)
        size = np.diff(np.append(first, len(group)))
        leader = np.repeat(order[first], size)
        second = np.repeat(order[np.minimum(first + 1, len(order) - 1)], size)
        candidate = np.where(leader == order, second, leader)
        alone = np.repeat(size == 1, size)
        candidate_value = np.where(alone, -np.inf, value[candidate])
        better = ~alone & ((candidate_value > best[order]) | (rival[order] < 0))
        rival[order[better]] = candidate[better]
        best[order[better]] = candidate_value[better]
    return rival


def log_entry(result: RingResult) -> dict[str, Any]:
    """Return the entry of one scan, for ``json.dumps``; ``None`` stands for an infinite number.

    A scan that was not associated (rejected, given up) has outcome and reason alone.
    """
    report = result.report
    entry: dict[str, Any] = {
        "sensor_id": report.key.sensor_id,
        "stamp_ns": int(report.key.stamp_ns),
        "outcome": report.outcome,
        "reason": report.reason,
    }
    if result.scan is None or result.predictions is None or result.associations is None:
        return entry
    return entry | decision_entry(
        result.scan, result.predictions, result.scores, result.associations, result.tracks
    )


def decision_entry(
    scan: Scan,
    predictions: Predictions,
    scores: AttributeScores | None,
    associations: Associations,
    tracks: Tracks | None = None,
) -> dict[str, Any]:
    """Return what :func:`log_entry` says of the decision, from the messages of one scan.

    Decision ``mht`` is taken by the track manager, after the association stage, on whole trees of
    hypotheses: which detection a track was given by the hypothesis that leads at that time is known
    from the ``tracks`` after the scan, and without them all pairs stand as not chosen.
    """
    decided, settings = associations, predictions.settings
    if decided.decision == MHT:
        decided = _as_led(decided, scan, predictions, tracks)
    decided_by = DECIDED_BY.get(decided.decision)
    source = np.append(scan.source_index, -1)
    with np.errstate(divide="ignore"):
        log_miss = np.log(1.0 - predictions.detection_probability)
    return {
        "decision": decided.decision,
        "decided_by": decided_by,
        "attribute_term": decided.attribute_term,
        "degraded": bool(decided.degraded),
        "gate_probability": settings.gate_probability,
        "clutter_density_per_m_rad": settings.clutter_density,
        "missed_track_hypotheses": settings.missed_track_hypotheses,
        "detections": len(scan),
        "tracks": [
            {
                "track_id": track,
                "hypothesis_id": hypothesis,
                "detection": None if index < 0 else int(source[index]),
                "log_miss_probability": _number(miss),
            }
            for track, hypothesis, index, miss in zip(
                predictions.track_id.tolist(),
                predictions.hypothesis_id.tolist(),
                decided.assigned_detection.tolist(),
                log_miss.tolist(),
                strict=True,
            )
        ],
        "pairs": _pairs(scan, predictions, scores, decided, decided_by),
        **group_entries(scan, predictions, decided),
    }


def _pairs(
    scan: Scan,
    predictions: Predictions,
    scores: AttributeScores | None,
    decided: Associations,
    decided_by: str | None,
) -> list[dict[str, Any]]:
    terms = pair_terms(predictions, scores, decided)
    rows, columns = decided.hypothesis, decided.detection
    track, source = predictions.track_id[rows].tolist(), scan.source_index[columns].tolist()
    hypothesis = predictions.hypothesis_id[rows].tolist()
    rival = np.full(len(rows), -1, dtype=np.int32)
    if decided_by is not None:
        rival = strongest_rivals(np.nan_to_num(terms[decided_by][0]), rows, columns)
    reasons = _reasons(decided)
    table = {
        name: list(zip(value.tolist(), threshold.tolist(), strict=True))
        for name, (value, threshold) in terms.items()
    }
    found = []
    for pair in range(len(rows)):
        other = int(rival[pair])
        cluster = int(decided.cluster[pair])
        found.append(
            {
                "track_id": track[pair],
                "hypothesis_id": hypothesis[pair],
                "detection": source[pair],
                "cluster": cluster,
                "engine": decided.engine_names[decided.cluster_engine[cluster]],
                "converged": bool(decided.cluster_converged[cluster]),
                "chosen": bool(decided.chosen[pair]),
                "reason": reasons[pair],
                "terms": [_term(name, *values[pair]) for name, values in table.items()],
                "rival": None
                if other < 0
                else {
                    "track_id": track[other],
                    "hypothesis_id": hypothesis[other],
                    "detection": source[other],
                    "value": _number(table[str(decided_by)][other][0]),
                },
            }
        )
    return found


def _term(name: str, value: float, threshold: float) -> dict[str, Any]:
    passed = None
    if not math.isnan(threshold):
        passed = value <= threshold if name == "mahalanobis_squared" else value >= threshold
    return {
        "term": name,
        "value": _number(value),
        "threshold": _number(threshold),
        "passed": passed,
    }


def _as_led(
    decided: Associations, scan: Scan, predictions: Predictions, tracks: Tracks | None
) -> Associations:
    """Return the associations with the detections that the leading hypotheses gave the tracks."""
    given = np.full(len(predictions), -1, dtype=np.int64)
    if tracks is not None and len(tracks):
        row = np.searchsorted(tracks.track_id, predictions.track_id)
        row = np.minimum(row, len(tracks) - 1)
        lives = tracks.track_id[row] == predictions.track_id
        given[lives] = tracks.detection_index[row[lives]]
    source = scan.source_index[decided.detection]
    chosen = (given[decided.hypothesis] >= 0) & (given[decided.hypothesis] == source)
    assigned = np.full(len(predictions), -1, dtype=np.int32)
    assigned[decided.hypothesis[chosen]] = decided.detection[chosen]
    return replace(decided, chosen=chosen, assigned_detection=assigned)


def _reasons(decided: Associations) -> list[str]:
    """What became of each pair (P,)."""
    if decided.decision == MHT:
        return np.where(decided.chosen, CHOSEN, NOT_LEADING).tolist()
    served = decided.assigned_detection[decided.hypothesis] >= 0
    taken = np.isin(decided.detection, decided.assigned_detection)
    shared = decided.assigned_detection[decided.hypothesis] == decided.detection
    return np.select(
        [decided.chosen, shared, served & taken, served, taken],
        [CHOSEN, SHARED, BOTH_ELSEWHERE, TRACK_ELSEWHERE, DETECTION_ELSEWHERE],
        NOT_WORTH_IT,
    ).tolist()


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


class AssociationLogWriter:
    """Writes one line of JSON per scan, to be used in a ``with`` statement.

    Parameters
    ----------
    path
        File to write; replaced if it exists.

    Raises
    ------
    OSError
        If it cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file: TextIO = self.path.open("w", encoding="utf-8", newline="\n")

    def write(self, result: RingResult) -> None:
        """Write the entry of one scan."""
        json.dump(log_entry(result), self._file, allow_nan=False)
        self._file.write("\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> AssociationLogWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
