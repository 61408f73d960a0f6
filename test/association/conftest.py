"""A second implementation to compare with: enumeration of all joint hypotheses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.vocabulary import (
    AssociationSettings,
    AttributeScores,
    Predictions,
    Scan,
    ScanKey,
)

KEY = ScanKey(epoch=3, sensor_id="radar", stamp_ns=5_000_000_000)


def joint_hypotheses(n: int, m: int) -> Iterator[tuple[int, ...]]:
    """All assignments of n tracks to m measurements, -1 for none, depth first."""
    if n == 0:
        yield ()
        return
    for head in joint_hypotheses(n - 1, m):
        yield (*head, -1)
        for j in range(m):
            if j not in head:
                yield (*head, j)


class BruteForce:
    """Marginals, log partition and best hypotheses of one cluster by enumeration."""

    def __init__(self, log_weight, log_idle_track, log_idle_measurement, least_assigned=0):
        n, m = log_weight.shape
        self.hypotheses, self.log_weights = [], []
        for hypothesis in joint_hypotheses(n, m):
            if sum(j >= 0 for j in hypothesis) < least_assigned:
                continue
            terms = [
                log_weight[i, j] if j >= 0 else log_idle_track[i] for i, j in enumerate(hypothesis)
            ]
            terms += [log_idle_measurement[j] for j in range(m) if j not in hypothesis]
            self.hypotheses.append(hypothesis)
            self.log_weights.append(-math.inf if -math.inf in terms else math.fsum(terms))
        self.best = max(self.log_weights, default=-math.inf)
        self.feasible = self.best > -math.inf
        self.marginals = np.zeros((n, m))
        self.log_partition = -math.inf
        if not self.feasible:
            return
        weights = [math.exp(value - self.best) for value in self.log_weights]
        total = math.fsum(weights)
        self.log_partition = self.best + math.log(total)
        for hypothesis, weight in zip(self.hypotheses, weights, strict=True):
            for i, j in enumerate(hypothesis):
                if j >= 0:
                    self.marginals[i, j] += weight / total

    @property
    def most_pairs(self):
        """Number of pairs of the fullest hypothesis that has weight."""
        return max(
            sum(j >= 0 for j in hypothesis)
            for hypothesis, log_weight in zip(self.hypotheses, self.log_weights, strict=True)
            if log_weight > -math.inf
        )


@pytest.fixture(scope="session")
def brute_force():
    return BruteForce


@pytest.fixture(scope="session")
def random_cluster():
    """Draw (log_weight, log_idle_track, log_idle_measurement), a share of them -inf."""

    def draw(rng, n, m, spread, zeros=0.0):
        arrays = [rng.uniform(-spread, spread, shape) for shape in ((n, m), n, m)]
        for values in arrays:
            values[rng.random(values.shape) < zeros] = -np.inf
        return arrays

    return draw


@pytest.fixture(scope="session")
def chain():
    """Draw a cluster of n tracks in a row, each with the next ``reach`` measurements."""

    def draw(rng, n, reach, spread, shuffled=True):
        m = n + reach - 1
        log_weight = np.full((n, m), -np.inf)
        for i in range(n):
            log_weight[i, i : i + reach] = rng.uniform(-spread, spread, reach)
        if shuffled:
            log_weight = log_weight[np.ix_(rng.permutation(n), rng.permutation(m))]
        return [log_weight, rng.uniform(-spread, spread, n), rng.uniform(-spread, spread, m)]

    return draw


@pytest.fixture(scope="session")
def make_stage_input():
    """Build (scan, predictions, scores, pairs) of the stage from matrices over H x n."""

    def make(
        log_likelihood,
        *,
        decision="gda",
        attribute_term="none",
        missed_track_hypotheses="zero",
        clutter_density=1e-6,
        detection_probability=0.9,
        distance=None,
        attribute_log_likelihood=None,
        clutter_log_likelihood=None,
        informative=None,
    ):
        log_likelihood = np.asarray(log_likelihood, dtype=np.float64)
        h, n = log_likelihood.shape
        hypothesis, detection = (
            index.astype(np.int32) for index in np.nonzero(log_likelihood > -np.inf)
        )
        p = len(hypothesis)

        def per_pair(matrix, default):
            if matrix is None:
                return np.full(p, default)
            return np.asarray(matrix)[hypothesis, detection]

        scan = Scan(
            key=KEY,
            frame_id="map",
            sensor_position_m=np.zeros(3),
            sensor_orientation_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
            source_index=np.arange(n, dtype=np.int32),
            range_m=np.full(n, 1e4),
            azimuth_rad=np.zeros(n),
            noise_covariance=np.tile(np.diag([3600.0, 2.7e-5]), (n, 1, 1)),
            rcs_m2=np.ones(n),
            rcs_valid=np.ones(n, dtype=bool),
        )
        predictions = Predictions(
            key=KEY,
            settings=AssociationSettings(
                decision=decision,
                attribute_term=attribute_term,
                missed_track_hypotheses=missed_track_hypotheses,
                clutter_density=clutter_density,
            ),
            hypothesis_id=np.arange(1, h + 1),
            parent_id=np.zeros(h, dtype=np.int64),
            track_id=np.arange(1, h + 1),
            detection_probability=np.broadcast_to(
                np.asarray(detection_probability, dtype=np.float64), h
            ).copy(),
            component_start=np.arange(h + 1, dtype=np.int32),
            component_weight=np.ones(h),
            component_model=np.zeros(h, dtype=np.int32),
            component_mean=np.zeros((h, 4)),
            component_covariance=np.tile(np.eye(4), (h, 1, 1)),
        )
        pairs = GatedPairs(
            hypothesis,
            detection,
            np.linspace(0.0, 9.0, p),
            log_likelihood[hypothesis, detection],
        )
        scores = AttributeScores(
            key=KEY,
            attribute_term=attribute_term,
            has_distance=attribute_term not in ("none", "bayes"),
            hypothesis=hypothesis.copy(),
            detection=detection.copy(),
            distance=per_pair(distance, 0.0),
            log_likelihood=per_pair(attribute_log_likelihood, 0.0),
            conflict=np.zeros(p),
            informative=(
                np.ones(p, dtype=bool)
                if informative is None
                else np.asarray(informative, dtype=bool)[detection]
            ),
            clutter_log_likelihood=(
                np.zeros(n)
                if clutter_log_likelihood is None
                else np.asarray(clutter_log_likelihood, dtype=np.float64)
            ),
            frame=("VS", "S", "B"),
            focal=np.array([1, 2, 4], dtype=np.uint32),
            masses=np.zeros((p, 3)),
            class_names=("false_alarm", "fighter", "cargo"),
            class_probability=np.zeros((p, 3)),
        )
        return scan, predictions, scores, pairs

    return make
