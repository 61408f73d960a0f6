"""Node ``attribute_fusion``: candidate beliefs, distances and likelihoods of the gated pairs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gda_tracker_msgs import msg

from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.io.messages import (
    attribute_scores_to_message,
    evidence_from_message,
    predictions_from_message,
    scan_from_message,
)
from gda_tracker.nodes.base import spin_node
from gda_tracker.nodes.gating_stage import GatingNode
from gda_tracker.nodes.scan_table import Inputs
from gda_tracker.nodes.stage import Input
from gda_tracker.vocabulary.beliefs import AttributeScores


class AttributeFusionNode(GatingNode):
    """``scans``, ``predictions`` and ``evidence`` in, ``attribute_scores`` out."""

    inputs = (
        Input("scans", msg.Scan, scan_from_message),
        Input("predictions", msg.Predictions, predictions_from_message),
        Input("evidence", msg.Evidence, evidence_from_message),
    )
    output_topic = "attribute_scores"
    output_message = msg.AttributeScores
    write = staticmethod(attribute_scores_to_message)

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("attribute_fusion", AttributeFusionParameters, parameters, **options)

    def use_parameters(self, parameters: AttributeFusionParameters) -> None:
        """Take new parameters."""
        super().use_parameters(parameters)
        self._fusion = AttributeFusion(parameters)

    def compute(self, entry: Inputs) -> AttributeScores:
        """Fuse every gated pair."""
        pairs = self.pairs(entry)
        return self._fusion(
            entry["predictions"], entry["evidence"], pairs.hypothesis, pairs.detection
        )


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(AttributeFusionNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
