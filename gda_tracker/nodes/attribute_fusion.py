"""Node ``attribute_fusion``: candidate beliefs, distances and likelihoods of the gated pairs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg

from gda_tracker.attributes.class_terms import fault_of_transition
from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.io.messages import (
    attribute_scores_to_message,
    evidence_from_message,
    predictions_from_message,
    scan_from_message,
)
from gda_tracker.nodes.base import spin_node
from gda_tracker.nodes.figures import FusionFigures
from gda_tracker.nodes.gating_stage import GatingNode
from gda_tracker.nodes.scan_table import Inputs
from gda_tracker.nodes.stage import Input
from gda_tracker.parameters import ParameterError
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
        # The classes are known as soon as the fuzzifier has answered a scan.
        self._class_names: tuple[str, ...] = ()
        self._figures = FusionFigures()
        super().__init__("attribute_fusion", AttributeFusionParameters, parameters, **options)

    def use_parameters(self, parameters: AttributeFusionParameters) -> None:
        """Take new parameters."""
        super().use_parameters(parameters)
        self._fusion = AttributeFusion(parameters)

    def check_parameters(self, parameters: AttributeFusionParameters) -> None:
        """Refuse a class transition of another number of classes than the fuzzifier's."""
        fault = self._fault(AttributeFusion(parameters))
        if fault:
            raise ParameterError(fault)

    def _fault(self, fusion: AttributeFusion) -> str:
        """Say why the parameters do not go with the classes, as far as these are known."""
        if not self._class_names:
            return ""
        return fault_of_transition(fusion.class_transition, self._class_names)

    def prepare(self, topic: str, entry: Inputs) -> None:
        """Look at the classes, and gate."""
        if topic == "evidence":
            self._look_at_classes(entry)
        super().prepare(topic, entry)

    def _look_at_classes(self, entry: Inputs) -> None:
        class_names = entry["evidence"].class_names
        if class_names != self._class_names:
            self._class_names = class_names
            fault = self._fault(self._fusion)
            if fault:
                self.get_logger().error(fault)

    def health(self) -> tuple[int, str]:
        """Say what is wrong with the parameters."""
        fault = self._fault(self._fusion)
        return (DiagnosticStatus.ERROR, fault) if fault else super().health()

    def compute(self, entry: Inputs) -> AttributeScores:
        """Fuse every gated pair."""
        self._look_at_classes(entry)
        pairs = self.pairs(entry)
        return self._fusion(
            entry["predictions"],
            entry["evidence"],
            pairs.hypothesis,
            pairs.detection,
            entry["scans"].statements,
        )

    def note(self, entry: Inputs, answer: Any) -> None:
        """Note what the scan tells."""
        self._figures.note(answer)

    def figures(self) -> dict[str, Any]:
        """What the last scans tell."""
        return {**super().figures(), **self._figures.values()}


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(AttributeFusionNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
