"""The parameter table of the track manager."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from gda_tracker.tracking.parameter_groups.blind_zone import BlindZoneParameters
from gda_tracker.tracking.parameter_groups.class_motion import ClassMotionParameters
from gda_tracker.tracking.parameter_groups.context import ContextParameters
from gda_tracker.tracking.parameter_groups.door import DoorParameters
from gda_tracker.tracking.parameter_groups.extended import ExtendedParameters
from gda_tracker.tracking.parameter_groups.history import HistoryParameters
from gda_tracker.tracking.parameter_groups.life import LifeParameters
from gda_tracker.tracking.parameter_groups.method import MethodParameters
from gda_tracker.tracking.parameter_groups.mht import MhtParameters
from gda_tracker.tracking.parameter_groups.motion import MotionParameters
from gda_tracker.tracking.parameter_groups.operation import OperationParameters
from gda_tracker.tracking.parameter_groups.resolution import ResolutionParameters
from gda_tracker.tracking.parameter_groups.sensor import SensorParameters
from gda_tracker.tracking.parameter_groups.sensor_models import SensorModelParameters
from gda_tracker.tracking.parameter_groups.strength import StrengthParameters


# The last group first: a dataclass takes its fields from its last base first.
@dataclass(frozen=True)
class TrackManagerParameters(
    OperationParameters,
    DoorParameters,
    HistoryParameters,
    ClassMotionParameters,
    MhtParameters,
    LifeParameters,
    ExtendedParameters,
    ContextParameters,
    MotionParameters,
    ResolutionParameters,
    SensorModelParameters,
    StrengthParameters,
    BlindZoneParameters,
    SensorParameters,
    MethodParameters,
):
    """What the track manager is told: method, sensor, motion, life of a track, what comes in."""

    def __post_init__(self) -> None:
        MotionParameters.check(self)
        SensorModelParameters.check(self)
        BlindZoneParameters.check(self)
        StrengthParameters.check(self)
        ResolutionParameters.check(self)
        LifeParameters.check(self)
        HistoryParameters.check(self)
        DoorParameters.check(self)
        OperationParameters.check(self)
        self.check_class_motion()
        self.check_extended(self.max_detections_per_scan, self.clutter_density_per_m_rad)
        self.check_context(self.filter, self.tracking_frame)

    @cached_property
    def _of_sensors(self) -> dict[str, Any]:
        if not self.context_file:
            return super()._of_sensors
        found = replace(self, context_file="")._of_sensors
        for own in found.values():
            # Lanes and plans as they were when these parameters were made.
            object.__setattr__(own, "context_file", self.context_file)
            own.__dict__.update(context=self.context)
            own.__dict__.pop("courses", None)
        return found
