"""Parameters of the track manager: lanes and plans (Koch 2014, section 1.3.6).

:mod:`gda_tracker.tracking.context_models` says what they mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from gda_tracker.kinematics.context import Context
from gda_tracker.kinematics.lane_motion import LaneCourse
from gda_tracker.kinematics.motion_models import GPB2
from gda_tracker.kinematics.plan_motion import PlanCourse
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.context_files import full_path, read_context_file

LANE_KEEPING, PLAN_KEEPING = "lane_keeping", "plan_keeping"


@dataclass(frozen=True, slots=True)
class Courses:
    """Lanes, ``None`` for none, and plans by the ids of their tracks."""

    lanes: LaneCourse | None
    plans: dict[int, PlanCourse]

    @property
    def names(self) -> tuple[str, ...]:
        """The motion models that they add."""
        return (LANE_KEEPING,) * (self.lanes is not None) + (PLAN_KEEPING,) * bool(self.plans)


@dataclass(frozen=True)
class ContextParameters:
    """Lanes and plans that targets may keep to."""

    context_file: str = parameter(
        "",
        "YAML file with lanes and plans (docs/lanes.md): a further motion model for targets that "
        "keep to a lane, one for those that carry out a plan; empty: none",
    )
    lane_keeping_share: float = parameter(
        0.9,
        "context_file: share of those that keep to it among targets in the middle of a lane that "
        "move along it",
        minimum=0.0,
        maximum=0.9999,
    )
    lane_keeping_s: float = parameter(
        120.0,
        "context_file: mean time for which a target keeps to lanes before it leaves them",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    lane_correlation_s: float = parameter(
        10.0,
        "context_file: time after which the offset of a target from the middle of its lane is "
        "another one",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
        advanced=True,
    )
    plan_keeping_share: float = parameter(
        0.9,
        "context_file: share of those that carry it out among tracks with a plan that are where "
        "it would have them",
        minimum=0.0,
        maximum=0.9999,
    )
    plan_keeping_s: float = parameter(
        600.0,
        "context_file: mean time for which a target keeps to a plan before it gives it up",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def check_context(self, motion_filter: str, tracking_frame: str) -> None:
        """Read the file; raise :class:`ParameterError` for what does not fit together."""
        if not self.context_file:
            return
        if motion_filter == GPB2:
            raise ParameterError(
                f"parameter context_file = {self.context_file!r}: allowed is '' with filter = "
                f"{GPB2!r}, for lanes and plans are models of cv and imm"
            )
        frame = self.context.frame_id
        if frame and frame != tracking_frame:
            raise ParameterError(
                f"parameter context_file = {self.context_file!r}: its frame_id is {frame!r}: "
                f"allowed is tracking_frame = {tracking_frame!r}"
            )

    @cached_property
    def context(self) -> Context:
        """Lanes and plans of the file as it was when the parameters were made."""
        path = full_path(self.context_file)
        try:
            status = path.stat()
        except OSError as error:
            raise ParameterError(
                f"parameter context_file = {self.context_file!r}: {error.strerror}"
            ) from None
        return _read(str(path), status.st_mtime_ns, status.st_size)

    @cached_property
    def courses(self) -> Courses:
        """What the filter makes of lanes and plans; without a file there are none."""
        if not self.context_file:
            return Courses(None, {})
        whole: Any = self  # the motion is another group's
        density = float(whole.process_noise_std_mps2) ** 2
        context = self.context
        return Courses(
            LaneCourse(context.lanes, self.lane_correlation_s) if context.lanes else None,
            {plan.track_id: PlanCourse(plan, density) for plan in context.plans},
        )


@lru_cache(maxsize=8)
def _read(path: str, changed_ns: int, size: int) -> Context:
    """Content of a file, read again when it has been changed."""
    return read_context_file(path)
