#!/usr/bin/env python3
"""Measure the error rates and delays of the tests behind track events: docs/track-events.md.

    python scripts/measure_track_events.py [--runs 400] [--scans 400] [--seed 0]

Tracks of matched Kalman filters, laid on paths that stay at the bounds of the hypotheses. Writes
docs/track-events.json, and from it the tables and the picture of the page; with --from-json only
these.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.events.monte_carlo import (  # noqa: E402
    QUANTITIES,
    Matched,
    count_decisions,
    expected_rate,
    matched_tracks,
)
from gda_tracker.events.parameters import EventParameters  # noqa: E402
from gda_tracker.events.sequential import H0, H1  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

PAGE = ROOT / "docs" / "track-events.md"
FIGURES = ROOT / "docs" / "track-events.json"
PICTURE = ROOT / "docs" / "images" / "track_events.png"
DESIGNS = (0.1, 0.05, 0.02, 0.01)
MARGINS_M = (6.0, 10.0, 16.0, 30.0)
# Of the comparison of distances between states: small, so that one state does not decide.
FACTOR_MARGIN_M = 10.0
# Small margins take long: fewer tracks, more scans.
LONG_RUNS, LONG_SCANS = 100, 3000
FACTORS = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0)
LANE_SIDES = 3
TRUTHS = {"h0": H0, "h1": H1}


def parameters(error: float) -> EventParameters:
    """Both errors alike, hypotheses that the simulated tracks can tell apart."""
    return EventParameters(
        false_alarm_probability=error,
        miss_probability=error,
        moving_speed_mps=10.0,
        stopped_speed_mps=1.0,
        steady_acceleration_mps2=0.3,
        event_acceleration_mps2=1.0,
    )


def rate(quantity: str, truth: str, matched: Matched, error: float, **more: Any) -> dict[str, Any]:
    """Share of wrong decisions with its standard error, and how long tests take."""
    counted = count_decisions(quantity, TRUTHS[truth], matched, parameters(error), **more)
    wrong = counted.h1 if truth == "h0" else counted.h0
    share = wrong / counted.total
    return {
        "truth": truth,
        "design": error,
        "decisions": counted.total,
        "wrong": wrong,
        "rate": share,
        "standard_error": math.sqrt(max(wrong, 1)) / counted.total,
        "delay_s": float(counted.duration_s.mean()),
    }


def measure(runs: int, scans: int, seed: int) -> dict[str, Any]:
    """All that the page shows."""
    matched = matched_tracks(runs, scans, np.random.default_rng(seed))
    long = matched_tracks(LONG_RUNS, LONG_SCANS, np.random.default_rng(seed + 1))
    std = math.sqrt(matched.covariance[-1][1, 1])
    found: dict[str, Any] = {
        "runs": runs,
        "scans": scans,
        "seed": seed,
        "position_std_m": std,
        "designs": [
            {"quantity": quantity, **rate(quantity, truth, matched, error)}
            for quantity in QUANTITIES
            for truth in TRUTHS
            for error in DESIGNS
        ],
        "margins": [],
        "factors": [
            {
                "factor": f,
                **rate(
                    "lane",
                    truth,
                    long,
                    0.05,
                    independence_factor=f,
                    lane_margin_m=FACTOR_MARGIN_M,
                ),
            }
            for truth in TRUTHS
            for f in FACTORS
        ],
    }
    for truth in TRUTHS:
        for margin in MARGINS_M:
            expected = expected_rate(TRUTHS[truth], margin / std, LANE_SIDES, parameters(0.05))
            measured = rate("lane", truth, long, 0.05, lane_margin_m=margin)
            found["margins"].append({"margin_m": margin, "expected": expected, **measured})
    return found


def _percent(entry: dict[str, Any]) -> str:
    return f"{100 * entry['rate']:.2f} +- {100 * entry['standard_error']:.2f} %"


def tables(found: dict[str, Any]) -> str:
    """The tables of the page."""
    designs = [["test", "h0 true", "h1 true", "delay, h0 true", "delay, h1 true"]]
    for quantity in QUANTITIES:
        both = [e for e in found["designs"] if e["quantity"] == quantity and e["design"] == 0.05]
        designs.append([quantity, *map(_percent, both), *(f"{e['delay_s']:.0f} s" for e in both)])
    margins = [["margin", "h0 true", "theory", "h1 true", "theory"]]
    for margin in MARGINS_M:
        row = [f"{margin:g} m"]
        for entry in found["margins"]:
            if entry["margin_m"] == margin:
                row += [_percent(entry), f"{100 * entry['expected']:.2f} %"]
        margins.append(row)
    factors = [["memories between states", "h0 true", "h1 true"]]
    for factor in FACTORS:
        chosen = [_percent(e) for e in found["factors"] if e["factor"] == factor]
        factors.append([f"{factor:g}" if factor else "every state", *chosen])
    return (
        "Wrong decisions of finished tests, designed for at most 5 %, and the time from the first "
        f"state of a test to its decision:\n\n{markdown(designs[0], designs[1:])}\n\n"
        "The lane test by the margin between its hypotheses:\n\n"
        f"{markdown(margins[0], margins[1:])}\n\n"
        f"The lane test by `independence_factor`, with a margin of {FACTOR_MARGIN_M:g} m:\n\n"
        f"{markdown(factors[0], factors[1:])}"
    )


def draw(found: dict[str, Any], path: Path) -> None:
    """The picture of the page."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12.5, 4.8), layout="constrained")
    colours = dict(zip(QUANTITIES, ("#0072b2", "#e69f00", "#009e73", "#cc79a7"), strict=True))
    for quantity in QUANTITIES:
        for truth, style in (("h0", "o-"), ("h1", "s--")):
            chosen = [
                e
                for e in found["designs"]
                if e["quantity"] == quantity and e["truth"] == truth and e["wrong"]
            ]
            left.errorbar(
                [e["design"] for e in chosen],
                [e["rate"] for e in chosen],
                [e["standard_error"] for e in chosen],
                fmt=style,
                color=colours[quantity],
                label=f"{quantity}, {truth} true",
                markersize=4,
            )
    ends = [min(DESIGNS), max(DESIGNS)]
    left.plot(ends, ends, color="black", label="design: at most this")
    left.set(xscale="log", yscale="log", xlabel="designed error", ylabel="wrong decisions")
    left.set_title("At the bounds, usual margins", fontsize=10)
    for truth, colour in (("h0", "#0072b2"), ("h1", "#e69f00")):
        chosen = [e for e in found["margins"] if e["truth"] == truth]
        steps = [e["margin_m"] / found["position_std_m"] for e in chosen]
        middle.plot(steps, [e["expected"] for e in chosen], color=colour, label=f"theory, {truth}")
        middle.errorbar(
            steps,
            [e["rate"] for e in chosen],
            [e["standard_error"] for e in chosen],
            fmt="o",
            color=colour,
            label=f"measured, {truth} true",
        )
        chosen = [e for e in found["factors"] if e["truth"] == truth]
        right.errorbar(
            [e["factor"] for e in chosen],
            [e["rate"] for e in chosen],
            [e["standard_error"] for e in chosen],
            fmt="o-",
            color=colour,
            label=f"lane, {truth} true",
        )
    for axes in (middle, right):
        axes.axhline(0.05, color="black", linewidth=1, label="design: at most 5 %")
        axes.set(yscale="log", ylabel="wrong decisions")
    middle.set(xlabel="margin / standard deviation of a state")
    middle.set_title("Lane: the overshoot makes errors rarer", fontsize=10)
    right.set(xlabel="filter memories between states (0: every state)")
    right.set_title(f"Lane, {FACTOR_MARGIN_M:g} m: correlated states err more", fontsize=10)
    for axes in (left, middle, right):
        axes.legend(fontsize=7, ncol=3, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> int:
    """Measure, and write the page's tables and picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=400, help="tracks (default 400)")
    parser.add_argument("--scans", type=int, default=400, help="scans of each (default 400)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--from-json", action="store_true", help="measure nothing")
    args = parser.parse_args()
    if args.from_json:
        found = json.loads(FIGURES.read_text())
    else:
        found = measure(args.runs, args.scans, args.seed)
        FIGURES.write_text(json.dumps(found, indent=1) + "\n")
    write_section(PAGE, "rates", tables(found))
    draw(found, PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
