"""Error rates of the test of the number of objects, by simulated scans that match its model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.formations.likelihood import log_number_ratios
from gda_tracker.formations.number_test import NumberTests, advance_numbers, log_thresholds
from gda_tracker.formations.resolution import detection_counts, group_probabilities
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

OPEN = -1


@dataclass(frozen=True, slots=True)
class Decided:
    """What R tests came to: ``number`` (R,), ``OPEN`` where none was decided; ``scans`` (R,)."""

    number: IntArray
    scans: IntArray


def decided_numbers(
    truth: int,
    runs: int,
    generator: np.random.Generator,
    *,
    detection_probability: float = 0.9,
    false_detections: float = 0.2,
    resolution_ratio: float = np.inf,
    design: float = 0.01,
    most: int = 6,
    scans: int = 500,
) -> Decided:
    """Run tests of a cluster of which only the number of detections is known, until they decide.

    Parameters
    ----------
    truth
        Objects that there are.
    runs, scans
        Tests, and the longest that they are followed.
    generator
        Random numbers.
    detection_probability, false_detections
        P_D, and the mean number of false detections in the gate.
    resolution_ratio
        Both eigenvalues of R_u^-1 X; infinite: all objects are resolved.
    design
        P(too many) and P(too few) of one test.
    most
        N.
    """
    ratio = np.full((1, 2), resolution_ratio)
    counts = detection_counts(np.array([detection_probability]), group_probabilities(ratio, most))
    # The ratio depends on the number of detections alone: one table for all scans.
    largest = truth + 60
    table = np.stack([_ratios(counts, m, false_detections) for m in range(largest + 1)])
    thresholds = log_thresholds(most, design, design)
    tests = NumberTests.begin(runs, most, 0)
    number = np.full(runs, OPEN, dtype=np.int64)
    taken = np.full(runs, scans, dtype=np.int64)
    for k in range(scans):
        open_ = number == OPEN
        if not open_.any():
            break
        own = generator.choice(most + 1, size=runs, p=counts[0, truth])
        m = np.minimum(own + generator.poisson(false_detections, runs), largest)
        found = advance_numbers(tests, open_, table[m], k, thresholds, 0.0)
        number[found.rows] = found.number
        taken[found.rows] = found.samples
    return Decided(number, taken)


def _ratios(counts: FloatArray, detections: int, false_detections: float) -> FloatArray:
    """Log ratios (N,) of a scan with so many detections, somewhere in the gate."""
    log_ratio = np.full((1, detections), -np.log(false_detections))
    return log_number_ratios(counts, log_ratio)[0]
