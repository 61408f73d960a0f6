"""Node ``association``: which detection belongs to which hypothesis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg

from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.io.messages import (
    associations_to_message,
    attribute_scores_from_message,
    predictions_from_message,
    scan_from_message,
)
from gda_tracker.nodes.base import spin_node
from gda_tracker.nodes.figures import EngineFigures
from gda_tracker.nodes.gating_stage import GatingNode
from gda_tracker.nodes.scan_table import Inputs
from gda_tracker.nodes.stage import Input
from gda_tracker.vocabulary.hypotheses import Associations


class AssociationNode(GatingNode):
    """``scans``, ``predictions`` and ``attribute_scores`` in, ``associations`` out."""

    inputs = (
        Input("scans", msg.Scan, scan_from_message),
        Input("predictions", msg.Predictions, predictions_from_message),
        Input("attribute_scores", msg.AttributeScores, attribute_scores_from_message),
    )
    output_topic = "associations"
    output_message = msg.Associations
    write = staticmethod(associations_to_message)

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        self._figures = EngineFigures()
        super().__init__("association", AssociationParameters, parameters, **options)

    def use_parameters(self, parameters: AssociationParameters) -> None:
        """Take new parameters."""
        super().use_parameters(parameters)
        self._associator = Associator(parameters)

    def complete(self, entry: Inputs) -> bool:
        """All inputs, or no scores where the track manager has given them up."""
        if "scans" not in entry or "predictions" not in entry:
            return False
        return "attribute_scores" in entry or entry["predictions"].settings.degraded

    def after_gating(self, entry: Inputs) -> None:
        """Find the clusters and weigh the kinematics while the attribute scores are on the way."""
        if entry["predictions"].settings.decision == "mht":
            return  # no clusters
        pairs = self.pairs(entry)
        entry["groundwork"] = (
            pairs,
            self._associator.lay_groundwork(entry["scans"], entry["predictions"], pairs),
        )

    def compute(self, entry: Inputs) -> Associations:
        """Associate the gated pairs."""
        scan, predictions = entry["scans"], entry["predictions"]
        scores = None if predictions.settings.degraded else entry["attribute_scores"]
        pairs = self.pairs(entry)
        of_pairs, groundwork = entry.get("groundwork", (None, None))
        return self._associator(
            scan, predictions, scores, pairs, groundwork if of_pairs is pairs else None
        )

    def note(self, entry: Inputs, answer: Any) -> None:
        """Note what the scan tells."""
        self._figures.note(answer)

    def figures(self) -> dict[str, Any]:
        """What the last scans tell."""
        return {**super().figures(), **self._figures.values()}

    def health(self) -> tuple[int, str]:
        """Say what is wrong with the joint probabilities."""
        problem = self._figures.problem()
        return (DiagnosticStatus.WARN, problem) if self.active and problem else super().health()


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(AssociationNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
