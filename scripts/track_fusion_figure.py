"""The picture of docs/track-fusion.md: tracks of two radars, what is fused, and the bias."""

from __future__ import annotations

import io

import numpy as np

from gda_tracker.evaluation.figures.canvas import GREY, INK, canvas, colour
from scripts.track_fusion_case import RADARS, RELATIVE_BIAS_M, RingCase, confirmed

KM = 1e-3


def picture(case: RingCase) -> bytes:
    """Draw one run as a PNG."""
    fusions = case.offline()
    frame = np.array(RADARS[0].bias_m)
    with canvas(10.0, 6.2) as figure:
        left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.1])
        truth = np.stack([case.truth(scan)[:, :2] for scan in range(len(fusions))]) - frame
        left.plot(*(truth.transpose(2, 0, 1) * KM), color=GREY, lw=5, alpha=0.35, zorder=1)
        for number, radar in enumerate(RADARS):
            points = np.concatenate([confirmed(live[radar.name]).mean for live in case.tracks])
            left.plot(*(points[:, :2].T * KM), ".", ms=2.5, color=colour(number), zorder=2)
        fused = np.concatenate([one.mean[one.member.all(axis=1)] for one, _ in fusions])
        left.plot(*(fused[:, :2].T * KM), ".", ms=3.5, color=INK, zorder=3)
        left.set_aspect("equal")
        left.set_xlabel("East [km]")
        left.set_ylabel("North [km]")
        left.set_title("Six targets, two radars 1.4 km apart in bias")
        for label, style in (
            ("truth as radar_1 sees it", {"color": GREY, "lw": 5, "alpha": 0.35}),
            ("tracks of radar_1", {"color": colour(0), "marker": ".", "lw": 0}),
            ("tracks of radar_2", {"color": colour(1), "marker": ".", "lw": 0}),
            ("fused of both", {"color": INK, "marker": ".", "lw": 0}),
        ):
            left.plot([], [], label=label, **style)
        left.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2)
        scans = np.arange(1, len(fusions) + 1)
        error = np.array([found.bias[1] for _, found in fusions]) - RELATIVE_BIAS_M
        sigma = np.sqrt(np.array([np.diag(found.bias_covariance[1]) for _, found in fusions]))
        for axis, name in enumerate(("East", "North")):
            right.fill_between(
                scans, -2 * sigma[:, axis], 2 * sigma[:, axis], color=colour(axis), alpha=0.15, lw=0
            )
            right.plot(scans, error[:, axis], color=colour(axis), lw=1.8, label=name)
        right.axhline(0.0, color=GREY, lw=1.0)
        right.set_xlabel("scan")
        right.set_ylabel("error of the relative bias [m]")
        right.set_title("Bias of radar_2 relative to radar_1, band: 2 sigma")
        right.legend(loc="upper right")
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=110, metadata={"Software": None})
    return stream.getvalue()
