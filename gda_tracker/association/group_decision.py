"""What groups of unresolved targets change in the association of a scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.association.cluster_marginals import EngineLimits
from gda_tracker.association.group_events import GroupEvents
from gda_tracker.association.group_joint import GroupAnswer, group_weights, resolve_groups
from gda_tracker.association.weightings import JointWeights
from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan


@dataclass(frozen=True, slots=True)
class SharedDetections:
    """The answer about groups, ready for ``Associations``.

    ``fields`` are those of the associations; ``taken`` (P,) marks the pairs of which the groups
    that were decided for have the hypothesis or the detection.
    """

    answer: GroupAnswer
    fields: dict[str, Any]
    taken: BoolArray

    def marginals(self, without: FloatArray, layer: int) -> FloatArray:
        """Marginals (P,) of the pairs under one weighting, from those without groups."""
        found = without.copy()
        found[self.answer.rows] = self.answer.marginals[layer]
        return found

    def assign(self, assigned: Int32Array) -> None:
        """Give the members of the chosen groups their detection."""
        chosen = np.flatnonzero(self.answer.group_chosen)
        for members in (self.fields["group_first"], self.fields["group_second"]):
            assigned[members[chosen]] = self.fields["group_detection"][chosen]


def decide_groups(
    events: GroupEvents,
    scan: Scan,
    predictions: Predictions,
    scores: AttributeScores | None,
    pairs: GatedPairs,
    weightings: list[JointWeights],
    said: FloatArray | None,
    limits: EngineLimits,
) -> SharedDetections:
    """Marginals and the most probable joint hypothesis with groups.

    The first of ``weightings`` is that of the kinematics or the only one, the last one that of all
    likelihoods. ``said`` (H,) are log factors of statements. The decision ``gda`` takes the groups
    of the most probable joint hypothesis, and decides on what is left by its own rule.
    """
    silent = np.zeros(len(scan))
    clutter = [silent, silent if scores is None else scores.clutter_log_likelihood]
    weights = group_weights(
        events,
        weightings,
        len(predictions),
        predictions.settings.clutter_density,
        # The only one is that of all likelihoods.
        clutter[-len(weightings) :],
        np.zeros(len(predictions)) if said is None else said,
    )
    answer = resolve_groups(events, pairs, weights, limits.max_exact_size)
    fields = events.fields()
    fields["group_marginal"] = answer.group_marginals[-1]
    fields["group_chosen"] = answer.group_chosen
    chosen = np.flatnonzero(answer.group_chosen)
    members = np.concatenate([fields["group_first"][chosen], fields["group_second"][chosen]])
    taken = np.isin(pairs.hypothesis, members)
    taken |= np.isin(pairs.detection, fields["group_detection"][chosen])
    return SharedDetections(answer, fields, taken)
