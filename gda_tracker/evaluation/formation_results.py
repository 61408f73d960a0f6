"""Scores of formations over many runs: the numbers of table and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gda_tracker.evaluation.formation_scores import FormationScore
from gda_tracker.evaluation.statistics import mean_and_stderr

# Bins of the stated probability of the most probable number.
CALIBRATION_EDGES = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999, 1.0])
BINS = "formation_calibration"


def formation_values(runs: Sequence[FormationScore]) -> dict[str, Any]:
    """Figures of formations under their names in the JSON, with ``_stderr`` beside the means.

    Shares of scans are in 0..1, times in seconds, splits and mergers per run. The calibration error
    is the mean distance of the stated probability of the most probable number and the share of
    right ones, by bins, weighted by their samples.
    """
    values = {
        "formation_number_decided_right": np.array([_share(run.decided) for run in runs]),
        "formation_number_probable_right": np.array([_share(run.probable) for run in runs]),
        "formation_delay_s": np.concatenate([run.delay_s for run in runs]),
        "formations_never_right": np.array([np.isnan(run.delay_s).sum() for run in runs]),
        "formation_true_probability": np.array(
            [run.of_truth.mean() if len(run.of_truth) else np.nan for run in runs]
        ),
    }
    for name in ("splits", "mergers"):
        told = [getattr(run, name) for run in runs]
        values[f"formation_{name}_true"] = np.array([one.true for one in told])
        values[f"formation_{name}_told"] = np.array([one.told for one in told])
        values[f"formation_{name}_false"] = np.array([one.false for one in told])
        values[f"formation_{name}_delay_s"] = np.concatenate([one.delay_s for one in told])
    found: dict[str, Any] = {}
    for name, value in values.items():
        found[name], found[f"{name}_stderr"] = mean_and_stderr(value.astype(np.float64))
    bins = calibration_bins(runs)
    samples = sum(entry["samples"] for entry in bins)
    off = sum(entry["samples"] * abs(entry["stated"] - entry["right"]) for entry in bins)
    found["formation_calibration_error"] = off / samples if samples else float("nan")
    found[BINS] = bins
    return found


def calibration_bins(runs: Sequence[FormationScore]) -> list[dict[str, float]]:
    """Of each bin with samples their number, mean stated probability, and share of right ones."""
    stated = np.concatenate([run.stated for run in runs])
    right = np.concatenate([run.right for run in runs]).astype(np.float64)
    place = np.clip(np.searchsorted(CALIBRATION_EDGES, stated, side="right") - 1, 0, None)
    place = np.minimum(place, len(CALIBRATION_EDGES) - 2)
    return [
        {
            "samples": int((place == index).sum()),
            "stated": float(stated[place == index].mean()),
            "right": float(right[place == index].mean()),
        }
        for index in np.unique(place).tolist()
    ]


def formation_tables(methods: dict[str, dict[str, Any]]) -> list[tuple[str, list[list[str]]]]:
    """Tables of the figures of each method: a title and rows, the first two heading and units."""
    numbers = [
        ["method", "decided right", "probable right", "delay", "never right", "p(true)", "off by"],
        ["", "[% of scans]", "[% of scans]", "[s]", "[per run]", "[1]", "[1]"],
    ]
    lineage = [
        ["method", "event", "true", "told", "false", "delay"],
        ["", "", "[per run]", "[per run]", "[per run]", "[s]"],
    ]
    for method, found in methods.items():
        numbers.append(
            [
                method,
                _value(found, "formation_number_decided_right", 1, 100.0),
                _value(found, "formation_number_probable_right", 1, 100.0),
                _value(found, "formation_delay_s", 1),
                _value(found, "formations_never_right", 2),
                _value(found, "formation_true_probability", 3),
                _number(found["formation_calibration_error"], 3),
            ]
        )
        for name in ("splits", "mergers"):
            own = f"formation_{name}"
            true = _number(found[f"{own}_true"], 2)
            told, false = (_value(found, f"{own}_{kind}", 2) for kind in ("told", "false"))
            lineage.append([method, name, true, told, false, _value(found, f"{own}_delay_s", 1)])
    return [("Formations", numbers), ("Splits and mergers of formations", lineage)]


NOTES = [
    "a scan of a formation counts as right if the number decided last, or the most probable one, "
    "is that of the targets that fly together; delay: from its beginning to the first right "
    "decision; p(true): mean probability of the true number; off by: mean distance of the stated "
    "probability of the most probable number and the share of right ones, by bins",
    "told: true splits or mergers that were told, with the time from the scan from which the true "
    "states are apart or together (before it: negative); false: told ones that are none",
]


def _share(right: np.ndarray) -> float:
    return float(right.mean()) if len(right) else float("nan")


def _value(found: dict[str, Any], name: str, digits: int, factor: float = 1.0) -> str:
    error = factor * found[f"{name}_stderr"]
    after = f" +- {error:.{digits}f}" if np.isfinite(error) else ""
    return _number(factor * found[name], digits) + after


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "n/a"
