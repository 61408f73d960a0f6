"""Where detections may lie that are no points: rays, circles, ellipses, hyperbolas."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.gaussian_sum_starts import Reach, curve
from gda_tracker.kinematics.measurement_models import observed
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Scan

PIECES = 48
# A ray begins so near its sensor, as a share of how far it goes.
NEAREST = 1e-3


def measurement_curves(scan: Scan, farthest_m: float) -> FloatArray:
    """Points on the curve that each detection leaves.

    Parameters
    ----------
    scan
        Of a sensor with a model of its own.
    farthest_m
        How far rays and hyperbolas are followed [m].

    Returns
    -------
    FloatArray
        (n, P, 2) [m] in the tracking plane; (0, P, 2) for a model of range rates alone, which
        bounds no position.
    """
    seen = observed(scan)
    if not seen.model.starts:
        return np.zeros((0, 2 * PIECES + 1, 2))
    reach = Reach(NEAREST * farthest_m, farthest_m, PIECES, 1.0)
    return curve(seen.model, seen.sites, seen.value[:, 0], reach)
