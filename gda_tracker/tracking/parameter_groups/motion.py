"""Parameters of the track manager: how targets move."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

# The number of a model travels in one byte; more than a few gain nothing.
MOST_MODELS = 16


@dataclass(frozen=True)
class MotionParameters:
    """How targets move."""

    process_noise_std_mps2: float = parameter(
        2.0,
        "acceleration of targets, standard deviation per scan; with imm the unit of "
        "imm_process_noise_factors",
        unit="m/s2",
        minimum=0.0,
        minimum_excluded=True,
    )
    max_speed_mps: float = parameter(
        300.0,
        "largest speed of a target; bounds the pairs that may start a track",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
    )
    imm_process_noise_factors: list[float] = parameter(
        [0.2, 1.3],
        "process noise of each model of imm, as a multiple of process_noise_std_mps2",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_mean_sojourn_s: list[float] = parameter(
        [20.0, 20.0],
        "mean time that a target stays in each model of imm before it changes to another",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        models = len(self.imm_process_noise_factors)
        if not 1 <= models <= MOST_MODELS:
            raise ParameterError(
                f"parameter imm_process_noise_factors = {self.imm_process_noise_factors}: allowed "
                f"are 1 to {MOST_MODELS} numbers"
            )
        if len(self.imm_mean_sojourn_s) != models:
            raise ParameterError(
                f"parameter imm_mean_sojourn_s = {self.imm_mean_sojourn_s}: allowed are {models} "
                f"numbers, one for each of imm_process_noise_factors"
            )
