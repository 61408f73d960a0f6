"""A tracker of a few targets that may not be resolved: one joint Gaussian mixture for all.

Every scan, each component is updated by each reading of the detections (who is one group, which
detection is whose), then the mixture is pruned, merged and capped. The joint density keeps what a
single detection of a group says: of the mean, not of the distance.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.association.unresolved import ResolutionSensor, interpretations
from gda_tracker.kinematics.mixtures import GaussianMixtures, cap, merge, prune
from gda_tracker.vocabulary.arrays import FloatArray


class UnresolvedTracker:
    """Follows n <= 3 targets with the same linear motion model, known at the start.

    Parameters
    ----------
    mean, covariance
        (n, s), (n, s, s) of the targets at the time of the first scan.
    sensor
        With ``resolution`` or without.
    smallest_share, merge_distance, most
        Of the mixture's reduction (:mod:`gda_tracker.kinematics.mixtures`).
    """

    def __init__(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        sensor: ResolutionSensor,
        smallest_share: float = 1e-3,
        merge_distance: float = 0.5,
        most: int = 8,
    ) -> None:
        n, s = mean.shape
        whole = np.zeros((1, n * s, n * s))
        for i in range(n):
            whole[0, i * s : (i + 1) * s, i * s : (i + 1) * s] = covariance[i]
        self.targets = n
        self.sensor = sensor
        self.mixture = GaussianMixtures(np.array([0, 1]), np.ones(1), mean.reshape(1, -1), whole)
        self.log_likelihood = 0.0
        self._reduction = (smallest_share, merge_distance, most)

    def predict(self, transition: FloatArray, noise: FloatArray) -> None:
        """Predict by F and Q (s, s) of one target."""
        each = np.eye(self.targets)
        step, spread = np.kron(each, transition), np.kron(each, noise)
        old = self.mixture
        self.mixture = GaussianMixtures(
            old.start, old.weight, old.mean @ step.T, step @ old.covariance @ step.T + spread
        )

    def update(self, detections: FloatArray) -> float:
        """Take in the detections (m, d) of one scan.

        Returns
        -------
        float
            Log likelihood of the scan, which is also added to ``log_likelihood``.
        """
        with np.errstate(divide="ignore"):
            log_weight = np.log(self.mixture.weight)
        found = interpretations(
            log_weight, self.mixture.mean, self.mixture.covariance, detections, self.sensor
        )
        peak = found.log_weight.max()
        weight = np.exp(found.log_weight - peak)
        gained = float(peak + np.log(weight.sum()))
        smallest_share, merge_distance, most = self._reduction
        mixture = GaussianMixtures(
            np.array([0, len(weight)]), weight / weight.sum(), found.mean, found.covariance
        )
        self.mixture = cap(merge(prune(mixture, smallest_share), merge_distance), most)
        self.log_likelihood += gained
        return gained

    def estimate(self) -> tuple[FloatArray, FloatArray]:
        """Mean (n, s) and joint covariance (n s, n s) of the mixture."""
        mean, covariance = self.mixture.moments()
        return mean[0].reshape(self.targets, -1), covariance[0]

    def most_probable(self) -> FloatArray:
        """Mean (n, s) of the heaviest component."""
        row = int(np.argmax(self.mixture.weight))
        return self.mixture.mean[row].reshape(self.targets, -1)
