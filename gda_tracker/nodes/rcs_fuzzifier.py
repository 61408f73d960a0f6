"""Node ``rcs_fuzzifier``: attributes of a scan -> belief masses and class likelihoods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.io.messages import evidence_to_message, scan_from_message
from gda_tracker.nodes.base import spin_node
from gda_tracker.nodes.figures import EvidenceFigures
from gda_tracker.nodes.scan_table import Inputs
from gda_tracker.nodes.stage import Input, StageNode
from gda_tracker.vocabulary.beliefs import Evidence


class RcsFuzzifierNode(StageNode):
    """``scans`` in, ``evidence`` out."""

    inputs = (Input("scans", msg.Scan, scan_from_message),)
    output_topic = "evidence"
    output_message = msg.Evidence
    write = staticmethod(evidence_to_message)

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        self._figures = EvidenceFigures()
        super().__init__("rcs_fuzzifier", RcsFuzzifierParameters, parameters, **options)

    def use_parameters(self, parameters: RcsFuzzifierParameters) -> None:
        """Build the memberships anew."""
        super().use_parameters(parameters)
        self._fuzzifier = RcsFuzzifier(parameters, self.counters)

    def compute(self, entry: Inputs) -> Evidence:
        """Fuzzify the scan."""
        return self._fuzzifier(entry["scans"])

    def note(self, entry: Inputs, answer: Any) -> None:
        """Note what the scan tells."""
        self._figures.note(entry["scans"], answer)

    def figures(self) -> dict[str, Any]:
        """What the last scans tell."""
        return {**super().figures(), **self._figures.values()}

    def health(self) -> tuple[int, str]:
        """Say what is wrong with the attributes."""
        problem = self._figures.problem()
        return (DiagnosticStatus.WARN, problem) if self.active and problem else super().health()


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(RcsFuzzifierNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
