"""Computed probabilities against what came true."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.evaluation.calibration import LARGEST_DEVIATION, Tally
from gda_tracker.evaluation.figures.canvas import GREY, INK, canvas, colour

TICKS = (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999)


def reliability(tally: Tally, title: str) -> Any:
    """Draw the share of correct associations of each bin against its mean probability.

    Error bars are two standard deviations of the share that is expected (Ferry 2010, 6.5); the
    lower panel has the deviations in units of one. Bins without associations or without correct
    ones have no point above, as the axes are logarithms of odds.
    """
    seen = tally.total[:-1] > 0
    total = np.where(seen, tally.total[:-1], 1.0)
    mean = tally.expected[:-1] / total
    share = tally.correct[:-1] / total
    spread = np.sqrt(tally.variance[:-1]) / total
    shown = seen & (share > 0.0) & (share < 1.0)
    with canvas(6.4, 7.2) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        above.plot([1e-7, 1 - 1e-4], [1e-7, 1 - 1e-4], color=GREY, lw=1.2, label="_diagonal")
        above.errorbar(
            mean[shown],
            share[shown],
            # Bars end within the axes: the logarithm of odds ends at 0 and 1.
            np.stack(
                [
                    np.minimum(2.0 * spread, 0.999 * share)[shown],
                    np.minimum(2.0 * spread, 0.999 * (1.0 - share))[shown],
                ]
            ),
            fmt="o",
            ms=5,
            color=colour(0),
            capsize=3,
            lw=1.2,
            label="_bins",
        )
        above.set_xscale("logit")
        above.set_yscale("logit")
        low = 0.3 * min(float(mean[seen].min()), float(share[shown].min(initial=0.5)))
        above.set_ylim(low, 1 - 2e-4)
        above.set_ylabel("share of correct associations [1]")
        above.set_title(title)
        for axis in (above.xaxis, above.yaxis, below.xaxis):
            axis.set_ticks(TICKS, [f"{tick:g}" for tick in TICKS])
            axis.set_ticks([], minor=True)
        below.axhline(0.0, color=GREY, lw=1.2)
        for bound in (-LARGEST_DEVIATION, LARGEST_DEVIATION):
            below.axhline(bound, color=INK, lw=1.0, ls="--")
        below.plot(mean[seen], tally.deviation[:-1][seen], "o", ms=5, color=colour(0))
        below.set_xlim(low, 1 - 2e-4)
        below.set_xlabel("mean computed probability of the bin [1]")
        below.set_ylabel("deviation [sigma]")
    return figure
