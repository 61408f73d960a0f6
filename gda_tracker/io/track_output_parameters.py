"""The table that declares in which formats tracks are given out, and the names of the classes."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

# Labels of autoware_perception_msgs/ObjectClassification.
AUTOWARE_LABELS = {
    name: number
    for number, name in enumerate(
        ("UNKNOWN", "CAR", "TRUCK", "BUS", "TRAILER", "MOTORCYCLE", "BICYCLE", "PEDESTRIAN")
    )
}
LARGEST_RADAR_CLASS = 2**16 - 1


@dataclass(frozen=True)
class TrackOutputParameters:
    """Topics of the formats, and what the tracker does not measure."""

    radar_tracks: str = parameter(
        "", "topic for radar_msgs/RadarTracks; empty: not published", live=False
    )
    detections_3d: str = parameter(
        "", "topic for vision_msgs/Detection3DArray; empty: not published", live=False
    )
    tracked_objects: str = parameter(
        "", "topic for autoware_perception_msgs/TrackedObjects; empty: not published", live=False
    )
    tentative: bool = parameter(False, "give out tracks that are not confirmed yet, too")
    radar_classes: list[str] = parameter(
        [],
        "numbers of RadarTrack.classification as class=number, e.g. car=32001; 0 for classes that "
        "are not named",
    )
    vision_classes: list[str] = parameter(
        [],
        "texts of ObjectHypothesis.class_id as class=text; the class's own name if it is not named",
    )
    autoware_classes: list[str] = parameter(
        [],
        f"labels of ObjectClassification as class=label; UNKNOWN for classes that are not named. "
        f"Labels: {', '.join(AUTOWARE_LABELS)}",
    )
    object_size_m: list[float] = parameter(
        [0.0, 0.0, 0.0],
        "length, width and height given out for every object, for the tracker measures none",
        unit="m",
        minimum=0.0,
        maximum=1e4,
    )
    height_m: float = parameter(
        0.0,
        "z of every object in the tracking frame: tracks are made in its plane",
        unit="m",
        minimum=-1e5,
        maximum=1e5,
    )
    height_std_m: float = parameter(
        10.0, "standard deviation of this z", unit="m", minimum=0.0, maximum=1e5
    )

    def __post_init__(self) -> None:
        """Refuse what is no mapping or no size."""
        if len(self.object_size_m) != 3:
            raise ParameterError(
                f"parameter object_size_m = {self.object_size_m}: allowed are 3 numbers"
            )
        for name in ("radar_classes", "vision_classes", "autoware_classes"):
            self.mapping(name)
        for cls, text in self.mapping("radar_classes").items():
            if not text.isdecimal() or int(text) > LARGEST_RADAR_CLASS:
                raise ParameterError(
                    f"parameter radar_classes: {cls}={text}, allowed is an integer >= 0 and <= "
                    f"{LARGEST_RADAR_CLASS}"
                )
        for cls, text in self.mapping("autoware_classes").items():
            if text not in AUTOWARE_LABELS:
                raise ParameterError(
                    f"parameter autoware_classes: {cls}={text}, allowed is one of "
                    f"{', '.join(AUTOWARE_LABELS)}"
                )

    def mapping(self, name: str) -> dict[str, str]:
        """Return what the classes are called, of one of the three lists."""
        found: dict[str, str] = {}
        for entry in getattr(self, name):
            cls, sign, text = (part.strip() for part in entry.partition("="))
            if not sign or not cls or not text or cls in found:
                raise ParameterError(
                    f"parameter {name}: {entry!r}, allowed are entries class=name that differ"
                )
            found[cls] = text
        return found
