"""The common base of the two stages that work on gated pairs."""

from __future__ import annotations

from gda_tracker.kinematics.gating import GatedPairs, gate
from gda_tracker.nodes.scan_table import Inputs
from gda_tracker.nodes.stage import StageNode


class GatingNode(StageNode):
    """Finds the gated pairs of a scan while it waits for its last input."""

    def prepare(self, topic: str, entry: Inputs) -> None:
        """Gate as soon as scan and predictions are there."""
        if topic in ("scans", "predictions") and "scans" in entry and "predictions" in entry:
            scan, predictions = entry["scans"], entry["predictions"]
            entry["gated"] = (scan, predictions, gate(scan, predictions))
            self.after_gating(entry)

    def after_gating(self, entry: Inputs) -> None:
        """Do what can be done once the pairs are known, before the last input comes."""

    @staticmethod
    def pairs(entry: Inputs) -> GatedPairs:
        """Return the gated pairs of a complete entry."""
        scan, predictions = entry["scans"], entry["predictions"]
        of_scan, of_predictions, found = entry.get("gated", (None, None, None))
        if found is not None and of_scan is scan and of_predictions is predictions:
            return found
        return gate(scan, predictions)
