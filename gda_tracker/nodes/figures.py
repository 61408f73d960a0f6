"""Figures of the last scans for diagnostics: noted cheaply, worked out once a second."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.innovations import taken_pairs
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

LAST_SCANS = 100
# Of the squared Mahalanobis distance of a position in the plane.
EXPECTED_NIS = 2.0
# Beyond these the noise or the motion model is wrong by a factor that matters.
LARGEST_NIS, SMALLEST_NIS = 2.0 * EXPECTED_NIS, 0.05 * EXPECTED_NIS
LARGEST_CONFLICT = 0.9
ENOUGH = 50


class Recent:
    """The last numbers of a kind."""

    def __init__(self, size: int = LAST_SCANS) -> None:
        self._values: deque[float] = deque(maxlen=size)

    def __len__(self) -> int:
        return len(self._values)

    def note(self, value: float) -> None:
        """Add one."""
        self._values.append(value)

    def milliseconds(self, name: str) -> dict[str, float]:
        """Median and 95 % quantile of seconds, in ms; nothing without numbers."""
        if not self._values:
            return {}
        p50, p95 = np.percentile(np.array(self._values), (50, 95))
        return {
            f"{name}_ms_p50": round(1e3 * float(p50), 3),
            f"{name}_ms_p95": round(1e3 * float(p95), 3),
        }

    def rate_hz(self, now: float) -> float | None:
        """Events per second, taken for times; ``None`` for fewer than two.

        Where the last one is longer ago than usual, the time since then counts.
        """
        if len(self._values) < 2:
            return None
        span = self._values[-1] - self._values[0]
        usual = span / (len(self._values) - 1)
        silence = now - self._values[-1]
        if silence > 3.0 * usual:
            span += silence
        return (len(self._values) - 1) / span if span > 0.0 else None


class Shares:
    """Sums and counts of the last scans: means weighted by how many there were on each."""

    def __init__(self, size: int = LAST_SCANS) -> None:
        self._parts: deque[tuple[float, int]] = deque(maxlen=size)

    def note(self, total: float, count: int) -> None:
        """Add the sum and the number of one scan."""
        self._parts.append((total, count))

    @property
    def count(self) -> int:
        """How many there were."""
        return sum(count for _, count in self._parts)

    @property
    def mean(self) -> float | None:
        """The mean, ``None`` where there were none."""
        count = self.count
        return sum(total for total, _ in self._parts) / count if count else None

    def figure(self, name: str, digits: int = 3) -> dict[str, float]:
        """The mean by name, nothing where there were none."""
        mean = self.mean
        return {} if mean is None else {name: round(mean, digits)}


class TrackingFigures:
    """What closed scans tell: gate, normalised innovation squared (NIS), conflict."""

    def __init__(self) -> None:
        self._outside = Shares()
        self._nis = Shares()
        self._conflict = Shares()

    def note(
        self,
        scan: Scan,
        predictions: Predictions,
        leading: np.ndarray,
        associations: Associations,
        tracks: Tracks,
    ) -> None:
        """Note one scan; ``leading`` (H,) marks the hypotheses that lead before it."""
        pairs = associations
        in_a_gate = np.zeros(len(scan), dtype=bool)
        in_a_gate[pairs.detection] = True
        self._outside.note(float(np.count_nonzero(~in_a_gate)), len(scan))
        if not len(tracks):
            return
        nis = taken_nis(scan, predictions, leading, associations, tracks)
        self._nis.note(float(nis.sum()), len(nis))
        heard = (tracks.status == CONFIRMED) & (tracks.detection_index >= 0)
        if associations.attribute_term != "none":
            self._conflict.note(float(tracks.conflict[heard].sum()), int(np.count_nonzero(heard)))

    def values(self) -> dict[str, float]:
        """Figures by name."""
        return {
            **self._outside.figure("detections_outside_gates_share"),
            **self._nis.figure("nis_mean"),
            "nis_expected": EXPECTED_NIS,
            **self._conflict.figure("conflict_mean"),
        }

    def problem(self) -> str:
        """Say what does not fit, or nothing."""
        nis, conflict = self._nis.mean, self._conflict.mean
        if nis is not None and self._nis.count >= ENOUGH:
            if nis > LARGEST_NIS:
                return (
                    f"detections lie farther from their tracks than the noise allows: NIS "
                    f"{nis:.1f}, expected {EXPECTED_NIS:g}; range_std_m, azimuth_std_rad or "
                    "process_noise_std_mps2 is too small"
                )
            if nis < SMALLEST_NIS:
                return (
                    f"detections lie much nearer to their tracks than the noise tells: NIS "
                    f"{nis:.2g}, expected {EXPECTED_NIS:g}; range_std_m, azimuth_std_rad or "
                    "process_noise_std_mps2 is too large"
                )
        if conflict is not None and self._conflict.count >= ENOUGH and conflict > LARGEST_CONFLICT:
            return (
                f"attributes contradict the classes: mean conflict {conflict:.2f}; look at "
                "class_rcs_mean_m2 and the unit of the radar cross section"
            )
        return ""


def taken_nis(
    scan: Scan,
    predictions: Predictions,
    leading: np.ndarray,
    associations: Associations,
    tracks: Tracks,
) -> FloatArray:
    """Squared Mahalanobis distance of the detections that confirmed tracks took, (N,).

    Of a track with several hypotheses it is that of the one which led before the scan.
    """
    a = associations
    taken = taken_pairs(
        predictions.track_id[a.hypothesis],
        leading[a.hypothesis],
        scan.source_index[a.detection],
        tracks,
    )
    return np.asarray(a.mahalanobis_squared[taken], dtype=np.float64)


class EvidenceFigures:
    """How much detections say of attributes."""

    def __init__(self) -> None:
        self._known = Shares()
        self._usable = Shares()

    def note(self, scan: Scan, evidence: Evidence) -> None:
        """Note one scan."""
        self._known.note(float(np.count_nonzero(scan.rcs_valid)), len(scan))
        self._usable.note(float(np.count_nonzero(evidence.informative)), len(scan))

    def values(self) -> dict[str, float]:
        """Figures by name."""
        return {
            **self._known.figure("rcs_known_share"),
            **self._usable.figure("attribute_used_share"),
        }

    def problem(self) -> str:
        """Say why what is measured is of no use, or nothing."""
        if self._known.count < ENOUGH or not self._known.mean or self._usable.mean:
            return ""
        return (
            "no radar cross section can be used: all are below rcs_min_m2 or above rcs_max_m2; "
            "dBsm taken for m2?"
        )


class FusionFigures:
    """What fusing the pairs of the last scans brought."""

    def __init__(self) -> None:
        self._conflict = Shares()
        self._informative = Shares()

    def note(self, scores: AttributeScores) -> None:
        """Note one scan."""
        n = int(np.count_nonzero(scores.informative))
        self._conflict.note(float(scores.conflict.sum()), n)  # 0 where nothing is known
        self._informative.note(float(n), len(scores.informative))

    def values(self) -> dict[str, float]:
        """Figures by name."""
        return {
            **self._conflict.figure("pair_conflict_mean"),
            **self._informative.figure("informative_pairs_share"),
        }


class EngineFigures:
    """Which engines computed the joint probabilities, and whether they settled."""

    def __init__(self) -> None:
        self._clusters: Counter[str] = Counter()
        self._pairs = Shares()
        self._open = Shares()

    def note(self, associations: Associations) -> None:
        """Note one scan."""
        a = associations
        count = np.bincount(a.cluster_engine, minlength=len(a.engine_names)).tolist()
        for name, clusters in zip(a.engine_names, count, strict=True):
            if clusters:
                self._clusters[name] += clusters
        self._pairs.note(float(len(a.hypothesis)), 1)
        unsettled = len(a.cluster_converged) - np.count_nonzero(a.cluster_converged)
        self._open.note(float(unsettled), len(a.cluster_converged))

    def values(self) -> dict[str, float | str]:
        """Figures by name; the engines with the clusters that each has computed."""
        engines = ", ".join(f"{name} {count}" for name, count in self._clusters.most_common())
        return {
            "engines": engines or "none",
            **self._pairs.figure("pairs_per_scan", 1),
            **self._open.figure("not_converged_share", 5),
        }

    def problem(self) -> str:
        """Say how much is only approximate, or nothing."""
        share = self._open.mean
        if not share:
            return ""
        return (
            f"joint probabilities have not converged in {100.0 * share:.2g} % of the last clusters:"
            " raise max_exact_size or belief_propagation_iterations"
        )
