"""Default and tuned parameters on recordings that the search has not seen, pair by pair.

The same scans are tracked under both, so that what is common to them cancels in the difference. Its
interval comes from a bootstrap: of whole recordings where there are many, otherwise of blocks of
consecutive scans, within which errors depend on each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.tuning.objectives import Objective
from gda_tracker.tuning.scores import COLUMNS, CaseScore, measures
from gda_tracker.vocabulary.arrays import FloatArray

BLOCK_SCANS = 8
# From so many recordings on they are drawn whole.
ENOUGH_CASES = 8
DRAWS = 2000
QUANTILES = (0.025, 0.975)
# Columns of a measure that is made of sums: numerator, denominator, whether the root is taken.
SUMS = {
    "gospa_m": ("gospa", "scored", True),
    "completeness": ("matched", "samples", False),
    "purity": ("own", "taken", False),
}
WHOLE = ("switches", "false_tracks", "delay_s")


@dataclass(frozen=True)
class Difference:
    """One objective under the default and the tuned parameters.

    ``interval`` is the 95 % interval of ``tuned - default``, ``None`` where there is too little to
    draw from.
    """

    objective: Objective
    default: float
    tuned: float
    interval: tuple[float, float] | None

    @property
    def gain(self) -> float:
        """How much better the tuned parameters are, positive whatever the direction."""
        return self.objective.sign * (self.default - self.tuned)

    @property
    def certain(self) -> bool:
        """Whether the interval leaves no doubt about the direction."""
        return self.interval is not None and (self.interval[0] > 0.0 or self.interval[1] < 0.0)

    def __str__(self) -> str:
        """A sentence without its full stop."""
        form = self.objective.format
        text = f"{self.objective.title}: {form(self.default)} by default, {form(self.tuned)} tuned"
        if self.gain == 0.0:
            return f"{text}, no difference"
        text += f", {form(self.tuned - self.default, signed=True)}"
        if self.interval is not None:
            low, high = (f"{end:+.3f}" for end in self.interval)
            text += f" (95 % interval {low} to {high})"
        return text


@dataclass(frozen=True)
class Comparison:
    """All objectives on the recordings held back."""

    differences: list[Difference]
    default: list[CaseScore]
    tuned: list[CaseScore]

    @property
    def beats(self) -> bool:
        """Whether the tuned parameters are better in something and worse in nothing."""
        gains = [difference.gain for difference in self.differences]
        return max(gains) > 0.0 and min(gains) >= 0.0

    @property
    def verdict(self) -> str:
        """What the user must know, in plain words."""
        told = "; ".join(str(difference) for difference in self.differences)
        if not self.beats:
            return f"It does NOT beat the default on the held-back data. {told}."
        better = [difference for difference in self.differences if difference.gain > 0.0]
        if all(difference.certain for difference in better):
            return f"It beats the default on the held-back data. {told}."
        if any(difference.interval is None for difference in better):
            return (
                "It is better than the default on the held-back data, which are too few to tell "
                f"whether by chance. {told}."
            )
        return (
            "It is better than the default on the held-back data, but by less than can be told "
            f"from chance. {told}."
        )


def compare(
    objectives: Sequence[Objective],
    default: Sequence[CaseScore],
    tuned: Sequence[CaseScore],
    seed: int,
) -> Comparison:
    """Compare the scores of the same cases under default and tuned parameters.

    Raises
    ------
    ValueError
        If an objective cannot be told, or the cases are not the same.
    """
    if [score.name for score in default] != [score.name for score in tuned]:
        raise ValueError("default and tuned: scored on different cases")
    before, after = measures(default), measures(tuned)
    differences = []
    for objective in objectives:
        first, second = before[objective.measure], after[objective.measure]
        if first is None or second is None:
            raise ValueError(f"{objective.title} cannot be told on the held-back data")
        interval = _interval(objective.measure, default, tuned, seed)
        differences.append(Difference(objective, first, second, interval))
    return Comparison(differences, list(default), list(tuned))


def _interval(
    measure: str, default: Sequence[CaseScore], tuned: Sequence[CaseScore], seed: int
) -> tuple[float, float] | None:
    whole = len(default) >= ENOUGH_CASES
    if measure in WHOLE and not whole:
        return None
    first, second = _units(measure, default, whole), _units(measure, tuned, whole)
    if len(first) < ENOUGH_CASES:
        return None
    draws = np.random.default_rng([seed, 1]).integers(len(first), size=(DRAWS, len(first)))
    root = measure in SUMS and SUMS[measure][2]
    difference = _ratio(second[draws].sum(axis=1), root) - _ratio(first[draws].sum(axis=1), root)
    low, high = np.quantile(difference, QUANTILES)
    return float(low), float(high)


def _units(measure: str, scores: Sequence[CaseScore], whole: bool) -> FloatArray:
    """(U, 2) numerators and denominators of what is drawn: cases, or blocks of scans."""
    if measure in WHOLE:
        return np.array([_whole(measure, score) for score in scores])
    columns = [COLUMNS.index(name) for name in SUMS[measure][:2]]
    parts = []
    for score in scores:
        scans = score.scans[:, columns]
        size = len(scans) if whole else BLOCK_SCANS
        # A rest shorter than half a block goes to the block before it.
        count = max(1, math.floor(len(scans) / size + 0.5))
        parts += [block.sum(axis=0) for block in np.array_split(scans, count)]
    return np.array(parts)


def _whole(measure: str, score: CaseScore) -> tuple[float, float]:
    if measure == "switches":
        return float(score.switches), 1.0
    if measure == "false_tracks":
        return float(score.false_tracks or 0), 1.0
    return score.delay_s, float(score.targets)


def _ratio(sums: FloatArray, root: bool) -> FloatArray:
    part, count = sums[:, 0], sums[:, 1]
    values = np.divide(part, count, out=np.zeros(len(part)), where=count > 0)
    return np.sqrt(values) if root else values
