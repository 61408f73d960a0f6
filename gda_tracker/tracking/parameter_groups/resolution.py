"""Parameters of the track manager: targets too close for the sensor to tell apart."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter


@dataclass(frozen=True)
class ResolutionParameters:
    """What the sensor resolves (Koch 2014, section 2.3.3); sensors with a model are left alone."""

    resolution_range_m: float = parameter(
        0.0,
        "distance in range at which half of the pairs of targets with the same azimuth give one "
        "detection between them; with resolution_azimuth_rad confirmed tracks may share a "
        "detection; 0: every target gives its own",
        unit="m",
        minimum=0.0,
        advanced=True,
    )
    resolution_azimuth_rad: float = parameter(
        0.0,
        "distance in azimuth at which half of the pairs of targets with the same range give one "
        "detection between them; 0: every target gives its own",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        advanced=True,
    )
    unresolved_detection_probability: float = parameter(
        0.0,
        "chance that two targets that are not resolved are detected, as one; 0: the same as "
        "detection_probability",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if (self.resolution_range_m > 0.0) != (self.resolution_azimuth_rad > 0.0):
            raise ParameterError(
                f"parameters resolution_range_m = {self.resolution_range_m:g} and "
                f"resolution_azimuth_rad = {self.resolution_azimuth_rad:g}: allowed are two "
                "numbers > 0, or 0 and 0"
            )
        strength = getattr(self, "signal_strength", "none")
        if self.resolution_range_m > 0.0 and strength != "none":
            # What is the strength of a signal of two?
            raise ParameterError(
                f"parameters resolution_range_m = {self.resolution_range_m:g} and signal_strength "
                f"= {strength!r}: allowed is 0 with a signal strength"
            )
