"""Parameters of the track manager: how targets move."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.kinematics.model_sets import (
    ACCELERATION_MODELS,
    CONSTANT_VELOCITY,
    MODELS,
    ModelSet,
)
from gda_tracker.parameters import ParameterError, parameter

# The number of a model travels in one byte; more than a few gain nothing.
MOST_MODELS = 16
SOJOURN, PER_SCAN, ACCELERATION = "sojourn", "per_scan", "acceleration"
SWITCHINGS = (SOJOURN, PER_SCAN, ACCELERATION)


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
    imm_models: list[str] = parameter(
        [],
        "motion models of imm and gpb2: constant_velocity (acceleration constant within a scan), "
        "white_noise_acceleration (continuous), constant_acceleration (white jerk), van_keuk and "
        "singer (correlated acceleration), coordinated_turn, standstill (has lost its speed); one "
        "model: its plain filter; empty: constant_velocity for each of imm_process_noise_factors",
        choices=MODELS,
        advanced=True,
    )
    imm_process_noise_factors: list[float] = parameter(
        [0.2, 1.3],
        "process noise of each model of imm and gpb2, as a multiple of process_noise_std_mps2: of "
        "its acceleration; of constant_acceleration and white_noise_acceleration: of the change of "
        "acceleration [m/s2], of velocity [m/s] within a second; of standstill: a speed [m/s]",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_switching: str = parameter(
        SOJOURN,
        "how often a target changes its model in imm and gpb2: sojourn (by imm_mean_sojourn_s and "
        "the time between two scans), per_scan (by imm_transition) or acceleration (of two models "
        "the second is the more probable, the larger the acceleration is)",
        choices=SWITCHINGS,
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
    imm_transition: list[float] = parameter(
        [],
        "imm_switching per_scan: for each model the probabilities of the models that follow it on "
        "the next scan, one model after the other; empty with the others",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )
    imm_switching_acceleration_mps2: float = parameter(
        5.0,
        "imm_switching acceleration: below this acceleration of a target the first model is the "
        "more probable one, above it the second",
        unit="m/s2",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_correlation_time_s: float = parameter(
        20.0,
        "van_keuk and singer: time after which an acceleration has faded to 1/e",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_acceleration_std_mps2: float = parameter(
        10.0,
        "acceleration of a target that changes to a model which knows one, in each coordinate",
        unit="m/s2",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_turn_rate_std_radps: float = parameter(
        0.1,
        "turn rate of a target that changes to coordinated_turn",
        unit="rad/s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_turn_noise_std_radps2: float = parameter(
        0.005,
        "coordinated_turn: change of the turn rate, constant within a scan",
        unit="rad/s2",
        minimum=0.0,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        factors = self.imm_process_noise_factors
        models = len(factors)
        if not 1 <= models <= MOST_MODELS:
            raise ParameterError(
                f"parameter imm_process_noise_factors = {factors}: allowed are 1 to {MOST_MODELS} "
                "numbers"
            )
        if self.imm_models and len(self.imm_models) != models:
            raise ParameterError(
                f"parameter imm_models = {self.imm_models}: allowed are {models} names, one for "
                "each of imm_process_noise_factors, or none"
            )
        if len(self.imm_mean_sojourn_s) != models:
            raise ParameterError(
                f"parameter imm_mean_sojourn_s = {self.imm_mean_sojourn_s}: allowed are {models} "
                f"numbers, one for each of imm_process_noise_factors"
            )
        self._check_transition(models)
        if self.imm_switching == ACCELERATION and not (
            models == 2 and self.model_names[1] in ACCELERATION_MODELS
        ):
            raise ParameterError(
                f"parameter imm_switching = {ACCELERATION!r} with the models "
                f"{list(self.model_names)}: allowed are two, the second one of "
                f"{', '.join(ACCELERATION_MODELS)}"
            )

    def _check_transition(self, models: int) -> None:
        given = self.imm_transition
        wanted = models**2 if self.imm_switching == PER_SCAN else 0
        if len(given) != wanted:
            raise ParameterError(
                f"parameter imm_transition = {given}: allowed are {wanted} numbers with "
                f"imm_switching {self.imm_switching} and {models} models"
            )
        for model in range(models if given else 0):
            row = given[model * models : (model + 1) * models]
            if abs(sum(row) - 1.0) > 1e-6:
                raise ParameterError(
                    f"parameter imm_transition = {given}: allowed are probabilities that sum to 1 "
                    f"for each model; those of model {model} sum to {sum(row):g}"
                )

    @property
    def model_names(self) -> tuple[str, ...]:
        """Names of the motion models of ``imm`` and ``gpb2``."""
        if self.imm_models:
            return tuple(self.imm_models)
        return (CONSTANT_VELOCITY,) * len(self.imm_process_noise_factors)

    @property
    def model_set(self) -> ModelSet:
        """The motion models of ``imm`` and ``gpb2``."""
        unit = self.process_noise_std_mps2
        return ModelSet(
            self.model_names,
            tuple(factor * unit for factor in self.imm_process_noise_factors),
            self.imm_correlation_time_s,
            self.imm_acceleration_std_mps2,
            self.imm_turn_rate_std_radps,
            self.imm_turn_noise_std_radps2,
        )
