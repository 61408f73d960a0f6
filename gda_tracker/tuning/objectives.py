"""What a search may look for: measures with a direction, and which of two results is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from gda_tracker.parameters import ParameterError
from gda_tracker.tuning.cases import Case


@dataclass(frozen=True)
class Objective:
    """A measure of :func:`~gda_tracker.tuning.scores.measures` and where it should go.

    ``sign`` is 1 for measures that should fall, -1 for those that should rise.
    """

    name: str
    measure: str
    title: str
    unit: str
    sign: int

    @property
    def direction(self) -> Literal["minimize", "maximize"]:
        """As Optuna names it."""
        return "minimize" if self.sign > 0 else "maximize"

    def format(self, value: float, signed: bool = False) -> str:
        """Write a value with its unit."""
        text = f"{value:+.3f}" if signed else f"{value:.3f}"
        return f"{text} {self.unit}".rstrip()


OBJECTIVES = {
    objective.name: objective
    for objective in (
        Objective("gospa", "gospa_m", "GOSPA", "m", 1),
        Objective("purity", "purity", "purity", "", -1),
        Objective("completeness", "completeness", "completeness", "", -1),
        Objective("switches", "switches", "identity switches", "", 1),
        Objective("false_tracks", "false_tracks", "false tracks", "", 1),
        Objective("delay", "delay_s", "extraction delay", "s", 1),
    )
}


def parse_objectives(names: Sequence[str], cases: Sequence[Case]) -> list[Objective]:
    """Return the objectives of these names, in their order.

    Raises
    ------
    ParameterError
        If a name is unknown, or the truth of a case does not tell the measure.
    """
    found = []
    for name in dict.fromkeys(name.replace("-", "_") for name in names):
        if name not in OBJECTIVES:
            allowed = ", ".join(OBJECTIVES)
            raise ParameterError(f"--objective {name}: allowed is one of {allowed}")
        for case in cases:
            if name == "false_tracks" and case.partial:
                raise ParameterError(
                    f"--objective {name}: the truth of {case.name} does not know everything that "
                    "the sensor sees, so a track elsewhere is not false; if it does, say "
                    "--complete-truth"
                )
            if name == "purity" and not case.names_sources:
                raise ParameterError(
                    f"--objective {name}: the truth of {case.name} does not name the source of "
                    "each detection, as simulations do; try completeness or switches"
                )
        found.append(OBJECTIVES[name])
    return found


def values_of(objectives: Sequence[Objective], measured: Mapping[str, float | None]) -> list[float]:
    """Values of the objectives in a table of measures.

    Raises
    ------
    ValueError
        If one is not there.
    """
    values = []
    for objective in objectives:
        value = measured[objective.measure]
        if value is None:
            raise ValueError(f"{objective.title} cannot be told: no target position is known")
        values.append(value)
    return values


def pareto_front(objectives: Sequence[Objective], values: Sequence[Sequence[float]]) -> list[int]:
    """Places of those that no other one matches in everything and beats in something.

    Of several with the same values the first is taken.
    """
    keys = [tuple(o.sign * v for o, v in zip(objectives, row, strict=True)) for row in values]
    front = []
    for place, key in enumerate(keys):
        beaten = any(
            all(a <= b for a, b in zip(other, key, strict=True)) and (other != key or at < place)
            for at, other in enumerate(keys)
            if at != place
        )
        if not beaten:
            front.append(place)
    return front


def choose(
    objectives: Sequence[Objective], baseline: Sequence[float], values: Sequence[Sequence[float]]
) -> int | None:
    """Place of the best result: of those not worse than the baseline in anything, the best.

    The objectives count in their order. ``None`` if nothing is better than the baseline.
    """

    def key(row: Sequence[float]) -> tuple[float, ...]:
        return tuple(o.sign * v for o, v in zip(objectives, row, strict=True))

    limit = key(baseline)
    best, chosen = limit, None
    for place, row in enumerate(values):
        mine = key(row)
        if all(a <= b for a, b in zip(mine, limit, strict=True)) and mine < best:
            best, chosen = mine, place
    return chosen
