"""Extended objects need every detection: the radar input must not make one of each cluster."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def fault_of_clusters(radar_input: Mapping[str, Any], track_manager: Mapping[str, Any]) -> str:
    """Say why the parameters of the two nodes do not go together, or return an empty text."""
    model = track_manager.get("extended_objects", "none")
    distance = radar_input.get("cluster_distance_m", 0.0)
    if model == "none" or not distance:
        return ""
    return (
        f"parameters cluster_distance_m = {distance} of radar_input and extended_objects = "
        f"{model!r} of track_manager: allowed together is cluster_distance_m = 0, for extended "
        "objects are told by all their detections"
    )
