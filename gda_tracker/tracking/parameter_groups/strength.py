"""Parameters of the track manager: signal strength as part of the state (Koch 2014, (2.42)-(2.49)).

:mod:`gda_tracker.tracking.signal_strength` says what they mean.
"""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.kinematics.signal_strength import threshold
from gda_tracker.parameters import ParameterError, parameter

NONE, SWERLING_1 = "none", "swerling_1"
SIGNAL_STRENGTHS = (NONE, SWERLING_1)
LINEAR, DECIBEL = "linear", "decibel"
SIGNAL_STRENGTH_UNITS = (LINEAR, DECIBEL)


@dataclass(frozen=True)
class StrengthParameters:
    """Which attribute is the strength of a detection, and what is known of it beforehand."""

    signal_strength: str = parameter(
        NONE,
        "swerling_1: each track estimates the mean strength of its target's signals; it decides "
        "the detection probability, and strengths count in the association, the extraction and "
        "the existence probability; none: detection_probability for all",
        choices=SIGNAL_STRENGTHS,
    )
    signal_strength_attribute: str = parameter(
        "snr",
        "swerling_1: attribute of the detections with the strength of the signal, signal and "
        "noise over mean noise power; scans without it use detection_probability",
        advanced=True,
    )
    signal_strength_unit: str = parameter(
        LINEAR,
        "swerling_1: unit of the attribute, a ratio of powers (linear) or ten times its decimal "
        "logarithm (decibel)",
        choices=SIGNAL_STRENGTH_UNITS,
        advanced=True,
    )
    false_alarm_probability: float = parameter(
        1e-2,
        "swerling_1: chance that noise alone exceeds the threshold of a resolution cell; the "
        "threshold is minus its natural logarithm, in mean noise powers",
        minimum=1e-100,
        maximum=0.99,
        advanced=True,
    )
    clutter_signal_strength: float = parameter(
        0.0,
        "swerling_1: mean strength of what causes false detections, over mean noise power; 0: "
        "noise alone",
        minimum=0.0,
        maximum=1e9,
        advanced=True,
    )
    initial_signal_strength: float = parameter(
        5.0,
        "swerling_1: mean strength of a new target, over mean noise power: what is known before "
        "its first detection",
        minimum=0.0,
        maximum=1e9,
        minimum_excluded=True,
        advanced=True,
    )
    initial_signal_strength_shape: float = parameter(
        1.5,
        "swerling_1: how well the mean strength of a new target is known, in detections that "
        "would tell as much",
        minimum=1.0,
        maximum=1e6,
        advanced=True,
    )
    signal_strength_memory_s: float = parameter(
        60.0,
        "swerling_1: time after which what was known of a strength counts for 1/e",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.signal_strength != NONE and not self.signal_strength_attribute:
            raise ParameterError(
                f"parameter signal_strength_attribute = '': allowed is the name of an attribute "
                f"with signal_strength = {self.signal_strength!r}"
            )

    @property
    def signal_threshold(self) -> float:
        """Lambda [1]: strengths above it are detections."""
        return threshold(self.false_alarm_probability)
