"""Tables V and VI of Ferry 2010 for a calibration, beside the published ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtr

from gda_tracker.evaluation.calibration import EDGES, LARGEST_DEVIATION, Tally
from gda_tracker.vocabulary.arrays import FloatArray

PUBLISHED_RUNS = 100_000
PUBLISHED_TOTAL = np.array(
    [
        *(75_986_700, 1_043_478, 452_911, 70_545, 64_167, 34_618, 27_279, 14_298, 9_497),
        *(7_774, 6_804, 6_557, 7_618, 11_162, 35_018, 20_013, 1_561, 100_000),
    ],
    dtype=np.float64,
)
"""Column tot of Table V; Table VI last."""

PUBLISHED_CORRECT = np.array(
    [
        *(85, 350, 1_453, 991, 2_020, 2_383, 3_907, 3_579, 3_249, 3_522, 3_753, 4_234, 5_747),
        *(9_602, 33_669, 19_897, 1_559, 82_805),
    ],
    dtype=np.float64,
)
"""Column # of Table V; Table VI last."""


def from_published(tally: Tally) -> tuple[FloatArray, FloatArray]:
    """Deviations of tot and # from the published ones in standard deviations of the difference.

    Associations of one run lie in the same bin together, so the spread of tot is taken from run to
    run; at most one association of a run is correct, so # is a number of coins. The last entry of
    tot, the number of runs, has no spread: 0.
    """
    share = tally.total / tally.runs
    spread = np.maximum(tally.squares / tally.runs - share**2, 0.0)
    both = 1.0 / tally.runs + 1.0 / PUBLISHED_RUNS
    correct = tally.correct / tally.runs
    published = PUBLISHED_CORRECT / PUBLISHED_RUNS
    pooled = (tally.correct + PUBLISHED_CORRECT) / (tally.runs + PUBLISHED_RUNS)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = (share - PUBLISHED_TOTAL / PUBLISHED_RUNS) / np.sqrt(spread * both)
    total[-1] = 0.0
    return total, (correct - published) / np.sqrt(pooled * (1.0 - pooled) * both)


def rows_of(tally: Tally) -> list[dict[str, Any]]:
    """Rows of Table V, the row of Table VI last; null where nothing fell into a bin."""
    total_off, correct_off = from_published(tally)
    count = np.where(tally.total > 0, tally.total, np.nan)
    columns = {
        "p_min": np.append(EDGES[:-1], 0.0),
        "p_max": np.append(EDGES[1:], 1.0),
        "total": tally.total,
        "correct": tally.correct,
        "share": tally.correct / count,
        "expected_share": tally.expected / count,
        "sigma": np.sqrt(tally.variance) / count,
        "zeta": tally.zeta,
        "percentile": ndtr(tally.zeta),
        "deviation": tally.deviation,
        "total_from_published": total_off,
        "correct_from_published": correct_off,
    }
    return [
        {
            name: float(values[k]) if np.isfinite(values[k]) else None
            for name, values in columns.items()
        }
        for k in range(len(tally.total))
    ]


def verdict(tally: Tally) -> tuple[bool, str]:
    """Whether the probabilities pass, and one line that says why."""
    deviation = np.abs(tally.deviation)
    worst = int(deviation.argmax())
    names = [*(f"{a:g} to {b:g}" for a, b in zip(EDGES[:-1], EDGES[1:], strict=True)), "MAP"]
    passed = bool(deviation[worst] < LARGEST_DEVIATION)
    word = "calibrated" if passed else "NOT calibrated"
    return passed, (
        f"{word}: the largest deviation is {deviation[worst]:.2f} sigma ({names[worst]}); "
        f"allowed is less than {LARGEST_DEVIATION:g}"
    )


def format_tables(tally: Tally) -> str:
    """Tables V and VI as text, with the deviations from the published counts."""
    rows = rows_of(tally)
    head = (
        f"{'p_min':>7} {'p_max':>7} {'tot':>11} {'#':>7} {'#/tot':>11} {'E(#/tot)':>11} "
        f"{'sigma':>10} {'zeta':>6} {'%':>5} {'tot-pub':>8} {'#-pub':>6}"
    )
    lines = [
        f"{tally.runs} runs. Table V: computed probabilities against the truth; tot-pub and #-pub: "
        "difference",
        f"to the published {PUBLISHED_RUNS} runs, in standard deviations",
        head,
    ]
    lines += [_line(row) for row in rows[:-1]]
    lines += ["Table VI: the most probable association of each run", head, _line(rows[-1])]
    return "\n".join(lines)


def _line(row: dict[str, Any]) -> str:
    def text(name: str, width: int, form: str) -> str:
        return f"{'-':>{width}}" if row[name] is None else f"{row[name]:{width}{form}}"

    cells = (
        text("p_min", 7, "g"),
        text("p_max", 7, "g"),
        text("total", 11, ".0f"),
        text("correct", 7, ".0f"),
        text("share", 11, ".7f"),
        text("expected_share", 11, ".7f"),
        text("sigma", 10, ".7f"),
        text("zeta", 6, ".2f"),
        text("percentile", 5, ".2f"),
        text("total_from_published", 8, ".2f"),
        text("correct_from_published", 6, ".2f"),
    )
    return " ".join(cells)
