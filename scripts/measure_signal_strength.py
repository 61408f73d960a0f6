#!/usr/bin/env python3
"""Measure what signal strength adds to the detection of weak targets: docs/signal-strength.md.

    python scripts/measure_signal_strength.py [--runs 10000] [--seed 1]

A track candidate begins with a detection, of a target or a false one; the sequential likelihood
ratio test decides within ten scans. Numbers also go to docs/signal_strength.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.kinematics.motion_models import white_noise_acceleration  # noqa: E402
from gda_tracker.kinematics.signal_strength import (  # noqa: E402
    Strengths,
    detection_probability,
    log_clutter_density,
    log_scan_ratio,
    log_signal_density,
    predict_strength,
    swerling_detection_probability,
    threshold,
    update_detected,
    update_strength,
)
from scripts.doc_tables import markdown, write_section  # noqa: E402

FALSE_ALARM, SCANS, STEP_S = 1e-2, 10, 1.0
NOISE_M, SPEED_MPS, DENSITY = 50.0, 30.0, 1.0
CLUTTER, HALF_WIDTH_M = 2e-6, 700.0  # per m2 and scan; of the square that is looked at
WEAK = (3.0, 5.0, 10.0)
FALSE_TRACKS = (1e-2, 1e-3)
PRIOR = (1.5, 9.0)  # inverse Gamma of 1 + x: the median is 8, nine tenths lie between 2 and 50
MEMORY_S = 60.0
MODELS = ("position alone", "with strength")


def candidates(
    rng: np.random.Generator, runs: int, strength: float | None
) -> dict[str, np.ndarray]:
    """Detections of ``runs`` candidates: places (K, runs, m, 2), signals, there (K, runs, m).

    ``strength`` is the target's x; ``None``: there is no target, the first detection is false.
    """
    lambda_ = threshold(FALSE_ALARM)
    step, noise = white_noise_acceleration(STEP_S, DENSITY)
    state = np.concatenate(
        [rng.normal(0.0, NOISE_M, (runs, 2)), rng.normal(0.0, SPEED_MPS, (runs, 2))], axis=1
    )
    count = rng.poisson(CLUTTER * (2.0 * HALF_WIDTH_M) ** 2, (SCANS, runs))
    most = int(count.max())
    places = rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, (SCANS, runs, most + 1, 2))
    signals = lambda_ + rng.exponential(1.0, (SCANS, runs, most + 1))
    there = np.arange(most + 1) < count[:, :, None]
    there[:, :, most] = False
    # The first detection of a target is that of an exponential signal above the threshold.
    first = lambda_ + rng.exponential(1.0 if strength is None else 1.0 + strength, runs)
    for k in range(SCANS):
        state = state @ step.T + rng.multivariate_normal(np.zeros(4), noise, runs)
        if strength is not None:
            signal = rng.exponential(1.0 + strength, runs)
            places[k, :, most] = state[:, :2] + rng.normal(0.0, NOISE_M, (runs, 2))
            signals[k, :, most] = signal
            there[k, :, most] = signal > lambda_
    return {"places": places, "signals": signals, "there": there, "first": first}


def log_ratios(found: dict[str, np.ndarray], seen: float) -> dict[str, np.ndarray]:
    """Log ratios (K + 1, runs) of both tests; ``seen`` is P_D of the one without strength.

    Both take all detections into one Gaussian, each by its probability.
    """
    runs, lambda_ = len(found["first"]), threshold(FALSE_ALARM)
    step, noise = white_noise_acceleration(STEP_S, DENSITY)
    ratios = {}
    for model in MODELS:
        with_strength = model == MODELS[1]
        mean = np.zeros((runs, 4))
        covariance = np.tile(np.diag([NOISE_M, NOISE_M, SPEED_MPS, SPEED_MPS]) ** 2, (runs, 1, 1))
        prior = Strengths(np.full(runs, PRIOR[0]), np.full(runs, PRIOR[1]))
        known = update_detected(prior, found["first"])
        total = np.zeros(runs)
        if with_strength:
            total = log_signal_density(prior, found["first"])
            total = total - np.log(detection_probability(prior, lambda_))
            total = total - log_clutter_density(found["first"], lambda_)
        values = [total]
        for k in range(SCANS):
            mean, covariance = mean @ step.T, step @ covariance @ step.T + noise
            innovation = covariance[:, :2, :2] + NOISE_M**2 * np.eye(2)
            gap = found["places"][k] - mean[:, None, :2]
            pull = np.linalg.solve(innovation[:, None], gap[..., None])[..., 0]
            log_kinematic = -0.5 * (
                np.sum(gap * pull, axis=2) + np.linalg.slogdet(2.0 * np.pi * innovation)[1][:, None]
            )
            log_kinematic = np.where(found["there"][k], log_kinematic, -np.inf)
            signal = np.where(found["there"][k], found["signals"][k], lambda_)
            if with_strength:
                known = predict_strength(known, STEP_S, MEMORY_S)
                gained, weight = log_scan_ratio(known, log_kinematic, signal, CLUTTER, lambda_)
                known = update_strength(known, weight, signal, lambda_)
            else:
                pair = np.exp(log_kinematic) * seen / CLUTTER
                whole = 1.0 - seen + pair.sum(axis=1)
                gained = np.log(whole)
                weight = np.concatenate([np.full((runs, 1), 1.0 - seen), pair], axis=1)
                weight = weight / whole[:, None]
            total = total + gained
            values.append(total)
            mean, covariance = _absorb(mean, covariance, innovation, gap, weight[:, 1:])
        ratios[model] = np.array(values)
    return ratios


def _absorb(
    mean: np.ndarray,
    covariance: np.ndarray,
    innovation: np.ndarray,
    gap: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Probabilistic data association: one Gaussian with the moments of all readings."""
    gain = covariance[:, :, :2] @ np.linalg.inv(innovation)
    some = weight.sum(axis=1)
    middle = np.einsum("rm,rmd->rd", weight, gap)
    spread = np.einsum("rm,rmd,rme->rde", weight, gap, gap) - middle[:, :, None] * middle[:, None]
    reduced = covariance - some[:, None, None] * (gain @ innovation @ gain.transpose(0, 2, 1))
    return (
        mean + np.einsum("rsd,rd->rs", gain, middle),
        reduced + gain @ spread @ gain.transpose(0, 2, 1),
    )


def measure(runs: int, seed: int) -> dict[str, Any]:
    """Detection within ten scans at equal false-track rates, paired."""
    numbers: dict[str, Any] = {"runs": runs, "seed": seed, "strengths": {}}
    false = candidates(np.random.default_rng([seed, 0]), runs, None)
    for strength in WEAK:
        seen = float(swerling_detection_probability(np.array(strength), FALSE_ALARM))
        empty = {name: v.max(axis=0) for name, v in log_ratios(false, seen).items()}
        target = candidates(np.random.default_rng([seed, int(strength)]), runs, strength)
        full = {name: v.max(axis=0) for name, v in log_ratios(target, seen).items()}
        entry: dict[str, Any] = {"detection_probability": round(seen, 3)}
        for rate in FALSE_TRACKS:
            limit = {name: np.quantile(v, 1.0 - rate) for name, v in empty.items()}
            hit = {name: (full[name] > limit[name]).astype(float) for name in MODELS}
            gain = mean_and_stderr(hit[MODELS[1]] - hit[MODELS[0]])
            entry[f"{rate:g}"] = {
                **{name: round(float(hit[name].mean()), 4) for name in MODELS},
                "difference": [round(value, 4) for value in gain],
                "false": {name: float(np.mean(empty[name] > limit[name])) for name in MODELS},
            }
        entry["curves"] = {
            name: [
                round(float(np.mean(full[name] > np.quantile(empty[name], 1.0 - rate))), 4)
                for rate in rates()
            ]
            for name in MODELS
        }
        numbers["strengths"][f"{strength:g}"] = entry
    return numbers


def rates() -> np.ndarray:
    """False-track rates of the curves."""
    return np.logspace(-3.0, -0.5, 16)


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for strength, entry in numbers["strengths"].items():
        for rate in FALSE_TRACKS:
            one = entry[f"{rate:g}"]
            mean, error = one["difference"]
            rows.append(
                (
                    f"{strength} ({10 * np.log10(float(strength)):.1f} dB)",
                    f"{entry['detection_probability']:.2f}",
                    f"{rate:g}",
                    *(f"{one[name]:.3f}" for name in MODELS),
                    f"{mean:+.3f} +- {error:.3f}",
                )
            )
    head = ("mean strength x", "P_D of a scan", "false tracks", *MODELS, "gain")
    return (
        f"{numbers['runs']} candidates with a target, as many without, seed {numbers['seed']}:\n\n"
        + markdown(head, rows)
    )


def draw(numbers: dict[str, Any]) -> Any:
    """Detection against false tracks."""
    with canvas(12.0, 4.2) as figure:
        panels = figure.subplots(1, len(WEAK), sharey=True)
        for axes, (strength, entry) in zip(panels, numbers["strengths"].items(), strict=True):
            for name, colour in zip(MODELS, COLOURS, strict=False):
                axes.semilogx(rates(), entry["curves"][name], color=colour, label=name)
            axes.set(
                xlabel="false tracks per false candidate",
                ylim=(0.0, 1.0),
                title=f"x = {strength}, P_D = {entry['detection_probability']:.2f}",
            )
        panels[0].set_ylabel("targets detected in 10 scans")
        panels[0].legend(loc="upper left")
    return figure


def main() -> int:
    """Measure, and write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(table(numbers))
    (ROOT / "docs" / "signal_strength.json").write_text(text, encoding="utf-8")
    write_section(ROOT / "docs" / "signal-strength.md", "strength", table(numbers))
    (ROOT / "docs" / "images" / "signal_strength.png").write_bytes(png(draw(numbers)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
