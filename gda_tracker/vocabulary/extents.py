"""Extended objects on their way round the ring: cells of a scan, extents of the hypotheses."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.vocabulary.arrays import FloatArray, Int32Array


@dataclass(slots=True)
class ScanCells:
    """Which detections of an admitted scan were put together; a row of the scan is a cell.

    Per cell (n,): ``count`` of detections; ``scatter`` (n, 2, 2) [m2], the sum of the outer
    products of their deviations from the centroid, and ``noise`` (n, 2, 2) [m2], the mean
    covariance of their positions, both in the axes of the tracking plane; ``log_false``, the log
    density of these detections as false ones, over the clutter density at the cell, in
    1/m^(2 (count - 1)): 0 for a single detection unless groups may be false. ``member`` (m,) has
    the rows of the source's ``Detections``, cell by cell. ``probability`` is that of the partition
    among those compared.
    """

    count: Int32Array
    scatter: FloatArray
    noise: FloatArray
    log_false: FloatArray
    member: Int32Array
    probability: float = 1.0


@dataclass(slots=True)
class PredictedExtents:
    """Extents of H hypotheses at the time of a scan.

    ``extent`` (H, 2, 2) [m2], the mean of an inverse Wishart density of the certainty ``weight``
    (H,) > 2; ``rate_shape``, ``rate_rate`` (H,) of the Gamma density of the number of detections.
    ``spread``: covariance of the places where an object reflects, in units of the extent.
    """

    extent: FloatArray
    weight: FloatArray
    rate_shape: FloatArray
    rate_rate: FloatArray
    spread: float
