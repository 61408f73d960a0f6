"""What number and scatter of a cell's detections say in the likelihood of a pair.

A scan of extended objects has a row for each cell: its centroid is compared with a track as the
position of a detection is. This is the other factor of the likelihood ratio of the pair, against
the cell's detections being false: with n detections in the cell

    n! p(n | track, n > 0) p(scatter | track, n) / f,

where p(n) is negative binomial, p(scatter) the Wishart density of which Koch 2014, (2.54), has the
part with X, averaged over the extent, and f the density of these detections as false ones, the
first of which the clutter density counts.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from gda_tracker.kinematics.extended.detection_rate import log_count_probability
from gda_tracker.kinematics.extended.random_matrix import Cells, log_scatter_likelihood
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan


def silent_probability(shape: FloatArray, rate: FloatArray) -> FloatArray:
    """Probability (N,) that an object in view gives no detection: (b / (b + 1))^a."""
    silent: FloatArray = np.exp(shape * (np.log(rate) - np.log1p(rate)))
    return silent


def log_cell_ratios(
    scan: Scan, predictions: Predictions, hypothesis: Int32Array, detection: Int32Array
) -> FloatArray:
    """Log of that factor (P,) for pairs of hypotheses and rows of the scan.

    0 where the scan has no cells or the predictions no extents.
    """
    seen, known = scan.cells, predictions.extents
    if seen is None or known is None:
        return np.zeros(len(hypothesis))
    n = seen.count[detection]
    shape, rate = known.rate_shape[hypothesis], known.rate_rate[hypothesis]
    own = Cells(
        seen.count[detection].astype(np.int64),
        np.zeros((len(n), 2)),
        seen.scatter[detection],
        seen.noise[detection],
    )
    found: FloatArray = (
        gammaln(n + 1.0)
        + log_count_probability(shape, rate, own.count)
        - np.log1p(-silent_probability(shape, rate))
        + log_scatter_likelihood(
            known.extent[hypothesis], known.weight[hypothesis], own, known.spread
        )
        - seen.log_false[detection]
    )
    return found
