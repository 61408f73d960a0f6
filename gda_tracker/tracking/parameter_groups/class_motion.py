"""Parameters of the track manager: what the motion of a track says of its class."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.attributes.class_ranges import DENSITIES, RANGES
from gda_tracker.attributes.motion_evidence import ClassMotion
from gda_tracker.parameters import ParameterError, parameter

OFF = "off"
CORNERS = 4


@dataclass(frozen=True)
class ClassMotionParameters:
    """How classes move."""

    class_motion: str = parameter(
        OFF,
        "speed and acceleration history as evidence on the class of confirmed tracks "
        "(docs/class-motion.md): ranges, class_speed_mps and class_acceleration_mps2 say what a "
        "class can do, so that some are excluded; densities, they say what it does, its values "
        "spread over them",
        choices=(OFF, RANGES, DENSITIES),
    )
    class_motion_names: list[str] = parameter(
        [],
        "class_motion: classes of which it is known how they move, as in class_names of "
        "rcs_fuzzifier",
        live=False,
    )
    class_speed_mps: list[float] = parameter(
        [],
        "class_motion: speeds a <= b <= c <= d, class after class: between b and c the class "
        "moves, below a and above d it does not; empty: speed says nothing",
        unit="m/s",
        minimum=0.0,
        live=False,
    )
    class_acceleration_mps2: list[float] = parameter(
        [],
        "class_motion: the same of the greatest acceleration of a history, turns and braking too; "
        "empty: it says nothing",
        unit="m/s2",
        minimum=0.0,
        live=False,
    )
    class_motion_reliability: float = parameter(
        0.95,
        "class_motion: trust in speed and in acceleration; this share counts, the rest tells "
        "nothing",
        minimum=0.0,
        maximum=1.0,
    )
    class_motion_scans: int = parameter(
        10,
        "class_motion: scans after its own in whose light a state is retrodicted before it is "
        "final",
        minimum=1,
        maximum=100,
        live=False,
        advanced=True,
    )
    class_motion_span_s: float = parameter(
        6.0,
        "class_motion: an acceleration is the change of the velocity over this time, or the next "
        "longer one that is whole scans",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )

    def check_class_motion(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        names = self.class_motion_names
        if len(set(names)) < len(names) or "" in names:
            raise self._error("class_motion_names", "names that differ")
        for name in ("class_speed_mps", "class_acceleration_mps2"):
            values = getattr(self, name)
            if not values:
                continue
            if len(values) != CORNERS * len(names):
                raise self._error(
                    name,
                    f"{CORNERS} numbers for each of class_motion_names = {names}, "
                    f"{CORNERS * len(names)} in all, or none",
                )
            corners = np.array(values).reshape(-1, CORNERS)
            if not ((np.diff(corners) >= 0.0).all() and (corners[:, 0] < corners[:, 3]).all()):
                raise self._error(name, "four corners a <= b <= c <= d, a < d, per class")
        if self.class_motion != OFF and not (self.class_speed_mps or self.class_acceleration_mps2):
            raise self._error(
                "class_motion", f"{OFF!r} without class_speed_mps and class_acceleration_mps2"
            )

    def _error(self, name: str, allowed: str) -> ParameterError:
        value: Any = getattr(self, name)
        return ParameterError(f"parameter {name} = {value!r}: allowed is {allowed}")

    @property
    def motion_of_classes(self) -> ClassMotion:
        """How classes move, as arrays."""
        return ClassMotion(
            self.class_motion,
            tuple(self.class_motion_names),
            np.array(self.class_speed_mps, dtype=np.float64).reshape(-1, CORNERS),
            np.array(self.class_acceleration_mps2, dtype=np.float64).reshape(-1, CORNERS),
            self.class_motion_reliability,
        )
