"""The table that declares what a radar's fields mean, and which detections are passed on."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.io.radar.parameter_groups.fields import FieldParameters
from gda_tracker.io.radar.parameter_groups.motion import MotionParameters
from gda_tracker.io.radar.parameter_groups.selection import SelectionParameters
from gda_tracker.io.radar.parameter_groups.source import SourceParameters


# The last group first: a dataclass takes its fields from its last base first.
@dataclass(frozen=True)
class RadarInputParameters(
    SelectionParameters, MotionParameters, FieldParameters, SourceParameters
):
    """What the fields of a radar mean, and which detections are passed on."""

    def __post_init__(self) -> None:
        FieldParameters.check(self)
        MotionParameters.check(self)
        SelectionParameters.check(self)
