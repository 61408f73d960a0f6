#!/usr/bin/env python3
"""Measure the error rates of the event tests on tracks of the ring: docs/track-events.md.

    python scripts/measure_events_in_the_ring.py [--targets 100] [--scans 300] [--seed 0]

Targets with missed detections, and false alarms in every second gate or so, tracked by several
methods; the errors of the confirmed tracks are laid on paths at the bounds of the hypotheses, as
scripts/measure_track_events.py does with those of single Kalman filters. Writes
docs/track-events-ring.json, and from it a table of the page.
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

from gda_tracker.events.monte_carlo import QUANTITIES, Followed  # noqa: E402
from gda_tracker.tracking.methods import parse_method  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.scans import Detections  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402
from scripts.measure_track_events import FACTOR_MARGIN_M, TRUTHS, rate  # noqa: E402

PAGE = ROOT / "docs" / "track-events.md"
FIGURES = ROOT / "docs" / "track-events-ring.json"
# The tests, and the lane with a margin so small that the ratio hardly exceeds a threshold.
NARROW = f"lane, {FACTOR_MARGIN_M:g} m margin"
TESTS: dict[str, tuple[str, dict[str, float]]] = {
    "lane": ("lane", {}),
    NARROW: ("lane", {"lane_margin_m": FACTOR_MARGIN_M}),
    **{quantity: (quantity, {}) for quantity in QUANTITIES[1:]},
}
METHODS = ("map/none/cv", "map/none/imm", "jpda/none/imm", "mht/none/imm")
DT_S, NOISE_M, SEEN = 1.0, 20.0, 0.9
DISTANCE_M, SPREAD_M = 60_000.0, 30_000.0
# False alarms around each target, in a square of that half width.
AROUND_M, FALSE_EACH = 500.0, 2.0
FACTORS, SOJOURN_S = (0.2, 1.3), (20.0, 20.0)
OWN_M = 200.0


def simulate(
    targets: int, scans: int, rng: np.random.Generator, switching: bool
) -> tuple[np.ndarray, list[Detections]]:
    """States (K, N, 4) of targets that move as the filter believes, and what is seen of them.

    Their acceleration is constant within a scan, of standard deviation 1 m/s2, or, ``switching``,
    0.2 and 1.3 m/s2 by turns of 20 s on average.
    """
    at = np.array([DISTANCE_M, 0.0]) + rng.uniform(-SPREAD_M, SPREAD_M, (targets, 2))
    state = np.hstack([at, rng.normal(0.0, 15.0, (targets, 2))])
    model = rng.integers(0, 2, targets)
    states, told = [], []
    for k in range(scans):
        model = np.where(rng.random(targets) < DT_S / SOJOURN_S[0], 1 - model, model)
        std = np.array(FACTORS)[model] if switching else np.ones(targets)
        kick = rng.normal(0.0, 1.0, (targets, 2)) * std[:, None]
        state = np.hstack(
            [
                state[:, :2] + DT_S * state[:, 2:] + 0.5 * DT_S**2 * kick,
                state[:, 2:] + DT_S * kick,
            ]
        )
        seen = state[rng.random(targets) < SEEN, :2]
        around = np.repeat(state[:, :2], rng.poisson(FALSE_EACH, targets), axis=0)
        false = around + rng.uniform(-AROUND_M, AROUND_M, around.shape)
        xy = np.concatenate([seen + rng.normal(0.0, NOISE_M, seen.shape), false])
        r = np.hypot(*xy.T)
        told.append(
            Detections(
                "radar",
                round(k * DT_S * 1e9),
                r,
                np.arctan2(xy[:, 1], xy[:, 0]),
                range_std_m=np.full(len(r), NOISE_M),
                azimuth_std_rad=NOISE_M / r,
            )
        )
        states.append(state)
    return np.array(states), told


def follow(method: str, targets: int, scans: int, seed: int) -> tuple[Followed, dict[str, float]]:
    """Errors of the confirmed tracks of a method, and how consistent they are."""
    choice = parse_method(method)
    states, told = simulate(targets, scans, np.random.default_rng(seed), choice["filter"] == "imm")
    density = FALSE_EACH / (2.0 * AROUND_M) ** 2 * DISTANCE_M
    ring = Ring(
        {
            "track_manager": {
                **choice,
                "process_noise_std_mps2": 1.0,
                "imm_process_noise_factors": list(FACTORS),
                "imm_mean_sojourn_s": list(SOJOURN_S),
                "max_speed_mps": 80.0,
                "detection_probability": SEEN,
                "clutter_density_per_m_rad": density,
                "extraction": "sequential",
            }
        }
    )
    each, squared = [], []
    for scan, truth in zip(told, states, strict=True):
        tracks = ring.process(scan).tracks
        assert tracks is not None
        gap = np.linalg.norm(tracks.mean[:, None, :2] - truth[:, :2], axis=2)
        own = gap.argmin(axis=1)
        chosen = np.flatnonzero((tracks.status == CONFIRMED) & (gap.min(axis=1) < OWN_M))
        chosen = chosen[np.argsort(tracks.track_id[chosen])]
        error = tracks.mean[chosen] - truth[own[chosen]]
        covariance = tracks.covariance[chosen]
        solved = np.linalg.solve(covariance, error[:, :, None])[:, :, 0]
        squared.append(np.sum(error * solved, axis=1))
        each.append(
            (tracks.track_id[chosen], error, covariance, tracks.detection_index[chosen] >= 0)
        )
    nees = np.concatenate(squared)
    share = float(np.mean([len(ids) for ids, *_ in each]) / targets)
    return Followed(each, DT_S), {"nees": float(nees.mean()), "tracked": share}


def measure(targets: int, scans: int, seed: int) -> dict[str, Any]:
    """All that the table shows."""
    found: dict[str, Any] = {"targets": targets, "scans": scans, "seed": seed, "methods": {}}
    for method in METHODS:
        followed, known = follow(method, targets, scans, seed)
        found["methods"][method] = {
            **known,
            **{
                name: {truth: rate(quantity, truth, followed, 0.05, **more) for truth in TRUTHS}
                for name, (quantity, more) in TESTS.items()
            },
        }
    return found


def table(found: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for method, entry in found["methods"].items():
        for name in TESTS:
            both = [entry[name][truth] for truth in TRUTHS]
            rows.append(
                (
                    f"`{method}`" if name == "lane" else "",
                    f"{entry['nees']:.2f}" if name == "lane" else "",
                    name,
                    *(f"{100 * e['rate']:.2f} +- {100 * e['standard_error']:.2f} %" for e in both),
                    *(f"{e['delay_s']:.0f} s" for e in both),
                )
            )
    head = ("method", "NEES", "test", "h0 true", "h1 true", "delay, h0 true", "delay, h1 true")
    begin = f"{found['targets']} targets, {found['scans']} scans, designed for at most 5 %:"
    return f"{begin}\n\n{markdown(head, rows)}"


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--scans", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    found = measure(args.targets, args.scans, args.seed)
    FIGURES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write_section(PAGE, "ring", table(found))
    print(table(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
