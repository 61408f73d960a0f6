"""Parameters of the track manager: what a Doppler radar does not see for it is too slow."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter


@dataclass(frozen=True)
class BlindZoneParameters:
    """The Doppler blind zone."""

    blind_speed_mps: float = parameter(
        0.0,
        "minimum detectable velocity of a radar that drops slow echoes: a target with this range "
        "rate over ground is detected with half of detection_probability, slower ones less "
        "(docs/blind-zone.md); 0: it sees what stands as well",
        unit="m/s",
        minimum=0.0,
    )
    blind_longest_s: float = parameter(
        300.0,
        "blind_speed_mps: time without a detection after which a track that the blind zone hides "
        "ends; 0: never",
        unit="s",
        minimum=0.0,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        several = getattr(self, "sensor_blind_speeds_mps", [])
        if any(several):
            given = f"sensor_blind_speeds_mps = {several}"
        elif self.blind_speed_mps:
            given = f"blind_speed_mps = {self.blind_speed_mps}"
        else:
            return
        for other, off in (
            ("signal_strength", "none"),
            ("resolution_range_m", 0.0),
            # The zone would hide what the map has learnt, and be counted as the map's misses.
            ("detection_probability_map", "given"),
        ):
            if getattr(self, other, off) != off:
                raise ParameterError(
                    f"parameter {given}: allowed is 0 with {other} = "
                    f"{getattr(self, other)}, for the two are not combined"
                )
