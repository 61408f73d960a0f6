"""Association by the truth: the upper bound for every method that decides on the scan itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan, ScanTruth

CLAIRVOYANT = "clairvoyant"


class Clairvoyant:
    """Takes the place of the association stage and gives each track its own target's detection.

    A track gets its own detection whenever the target was detected and the detection is in the
    gate, else none.

    Parameters
    ----------
    truth
        The truth of every scan that will be asked for; it must name the sources of the detections.
    target_of_track
        Target id by track id.
    """

    def __init__(self, truth: Sequence[ScanTruth], target_of_track: Mapping[int, int]) -> None:
        self._source = {(t.sensor_id, t.stamp_ns): t.source_id for t in truth}
        self._target_of_track = dict(target_of_track)

    def __call__(
        self,
        scan: Scan,
        predictions: Predictions,
        scores: AttributeScores | None,
        pairs: GatedPairs,
    ) -> Associations:
        """Return the associations of one scan; the own pair has probability one."""
        source = self._source[scan.key.sensor_id, scan.key.stamp_ns]
        if source is None:
            raise ValueError(
                f"truth at stamp {scan.key.stamp_ns} ns: source_id of its detections is missing"
            )
        own_target = np.array([self._target_of_track[int(i)] for i in predictions.track_id], int)
        chosen = source[scan.source_index[pairs.detection]] == own_target[pairs.hypothesis]
        assigned = np.full(len(predictions), -1, dtype=np.int32)
        assigned[pairs.hypothesis[chosen]] = pairs.detection[chosen]
        certainty = chosen.astype(np.float64)
        return Associations(
            key=scan.key,
            decision=CLAIRVOYANT,
            attribute_term="none",
            degraded=False,
            hypothesis=pairs.hypothesis,
            detection=pairs.detection,
            mahalanobis_squared=pairs.mahalanobis_squared,
            kinematic_log_likelihood=pairs.log_likelihood,
            attribute_log_likelihood=np.zeros(len(pairs)),
            p_kinematic=certainty,
            p_attribute=np.ones(len(pairs)),
            p_generalised=certainty,
            joint_marginal=certainty,
            chosen=chosen,
            # Every hypothesis is decided on its own.
            cluster=pairs.hypothesis.copy(),
            assigned_detection=assigned,
            cluster_engine=np.zeros(len(predictions), dtype=np.int32),
            cluster_converged=np.ones(len(predictions), dtype=bool),
            engine_names=("truth",),
        )
