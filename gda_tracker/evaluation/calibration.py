"""Calibration: are the probabilities of associations true (Ferry 2010, 6.2).

Scenes are simulated with the truth; all associations of all scenes are put into bins by computed
probability, and the share of correct ones in each bin must be what the probabilities say, up to the
spread of so many coins (6.5). A formula with an error does not pass.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammainc, gammaincc, ndtri

from gda_tracker.association.xmap.model import SensorModel
from gda_tracker.association.xmap.partitions import enumerate_associations
from gda_tracker.association.xmap.problem import example, read_problem
from gda_tracker.association.xmap.scoring import log_weights, probabilities, structure_of
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.cross_sensor import FERRY_6_2, CovarianceGenerator, simulate_scenes
from gda_tracker.threads import THREAD_VARIABLES
from gda_tracker.vocabulary.arrays import FloatArray

EDGES = np.array(
    [0, 1e-4, 1e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 0.999, 1]
)
"""Bins of Table V."""

EXACT = "exact"
NOISE_IGNORED = "noise_ignored"
JUMP_IGNORED = "jump_ignored"
BIAS_IGNORED = "bias_ignored"
VARIANTS = (EXACT, NOISE_IGNORED, JUMP_IGNORED, BIAS_IGNORED)

LARGEST_DEVIATION = 4.0
"""A bin that is off by more standard deviations is taken for an error."""

BATCH = 50
CHUNK = 500
FEW = 25.0
"""Below this variance the number of correct associations is judged as Poisson, not as normal."""


Progress = Callable[[int], None]


@dataclass(frozen=True)
class Tally:
    """Associations counted by bin, axis (bins,); the last entry is the most probable of each run.

    Attributes
    ----------
    total, correct
        Number of associations, and of correct ones.
    expected, variance
        Of the number of correct ones: sums of p and of p (1 - p).
    squares
        Sum over runs of the squared number of associations in the bin.
    runs
        Number of scenes.
    """

    total: FloatArray
    correct: FloatArray
    expected: FloatArray
    variance: FloatArray
    squares: FloatArray
    runs: int

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.total + other.total,
            self.correct + other.correct,
            self.expected + other.expected,
            self.variance + other.variance,
            self.squares + other.squares,
            self.runs + other.runs,
        )

    @property
    def zeta(self) -> FloatArray:
        """(6.5): deviation of the correct ones from what is expected, in standard deviations."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((self.correct - self.expected) / np.sqrt(self.variance))

    @property
    def deviation(self) -> FloatArray:
        """Zeta; where few are expected, by the tail of a Poisson distribution; 0 for none."""
        hits, expected = self.correct, self.expected
        mostly = expected > 0.5 * self.total
        count = np.where(mostly, self.total - hits, hits)
        mean = np.where(mostly, self.total - expected, expected)
        # Probability of so many or more, and of so many or fewer (scipy.stats is slow to import).
        above = np.where(count > 0, gammainc(np.maximum(count, 1.0), mean), 1.0)
        below = gammaincc(count + 1.0, mean)
        tail = np.clip(np.minimum(above, below), 1e-300, 0.5)
        rare = np.where(above < below, 1.0, -1.0) * -ndtri(tail)
        rare = np.where(mostly, -rare, rare)
        with np.errstate(invalid="ignore"):
            return np.where(self.total == 0, 0.0, np.where(self.variance < FEW, rare, self.zeta))


def scored_model(model: SensorModel, variant: str) -> SensorModel:
    """Return the model that scores: the one that simulates, or one that ignores something.

    Raises
    ------
    ParameterError
        If there is no such variant.
    """
    if variant == EXACT:
        return model
    if variant == BIAS_IGNORED:
        return replace(
            model,
            bias_covariances=tuple(np.zeros_like(model.prior_covariance) for _ in model.sizes),
        )
    feature = model.feature
    if variant not in VARIANTS or feature is None:
        raise ParameterError(f"variant = {variant!r}: allowed are {', '.join(VARIANTS)}")
    if variant == NOISE_IGNORED:
        feature = replace(feature, obeys_model=np.ones_like(feature.std))
    else:
        feature = replace(feature, jump_probability=np.zeros_like(feature.std))
    return replace(model, feature=feature)


def calibrate_ferry(
    runs: int,
    seed: int = 0,
    variant: str = EXACT,
    workers: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Calibrate on scenes as in section 6.1 with covariances as in 6.2.

    The result depends on runs, seed and variant alone.

    Parameters
    ----------
    runs
        Number of scenes, 778 associations each.
    workers
        Processes; 1 works in this one.
    progress
        Called with the runs done.

    Raises
    ------
    ParameterError
        If an argument is not allowed.
    """
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0), ("workers", workers, 1)):
        if value < least:
            raise ParameterError(f"{name} = {value}: allowed is an integer >= {least}")
    scored_model(_model(), variant)
    tasks = [
        (seed, chunk, min(CHUNK, runs - chunk * CHUNK), variant)
        for chunk in range(-(-runs // CHUNK))
    ]
    found: dict[int, Tally] = {}
    done = 0
    for place, tally in _tallies(tasks, min(workers, len(tasks))):
        found[place] = tally
        done += tally.runs
        if progress is not None:
            progress(done)
    # In the order of the tasks, so that sums do not depend on who was first.
    result = found[0]
    for place in range(1, len(tasks)):
        result = result + found[place]
    return result


Task = tuple[int, int, int, str]


def _tallies(tasks: list[Task], workers: int) -> Iterator[tuple[int, Tally]]:
    numbered = list(enumerate(tasks))
    if workers == 1:
        yield from map(_task, numbered)
        return
    with _one_thread_per_worker():
        # Leaving the block, also by Ctrl-C, ends the workers.
        with multiprocessing.get_context("spawn").Pool(workers, _start_worker) as pool:
            yield from pool.imap_unordered(_task, numbered)


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's to handle


@contextmanager
def _one_thread_per_worker() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _model() -> SensorModel:
    return read_problem(example("ferry_6_1")).model


def _task(numbered: tuple[int, Task]) -> tuple[int, Tally]:
    place, (seed, chunk, runs, variant) = numbered
    rng = np.random.default_rng([seed, chunk])
    return place, calibrate(_model(), FERRY_6_2, runs, rng, variant)


def calibrate(
    model: SensorModel,
    generator: CovarianceGenerator,
    runs: int,
    rng: np.random.Generator,
    variant: str = EXACT,
) -> Tally:
    """Simulate scenes of a model, score all their associations and count them by bin."""
    labels = enumerate_associations(model.sizes)
    simulated = structure_of(model, labels)
    scoring = scored_model(model, variant)
    result: Tally | None = None
    for begin in range(0, runs, BATCH):
        scenes = min(BATCH, runs - begin)
        data, truth = simulate_scenes(model, labels, simulated, generator, scenes, rng)
        share = probabilities(log_weights(scoring, data, simulated))
        part = tally_of(share, truth)
        result = part if result is None else result + part
    assert result is not None
    return result


def tally_of(share: FloatArray, truth: np.ndarray) -> Tally:
    """Count associations with probabilities (A, B), of which ``truth`` (B,) are correct."""
    n_associations, runs = share.shape
    n_bins = len(EDGES) - 1
    # Nearly all are in the first bin, which is what the others leave.
    row, run = (share >= EDGES[1]).nonzero()
    value = share[row, run]
    place = np.minimum(np.searchsorted(EDGES, value, side="right") - 1, n_bins - 1)

    def by_bin(weight: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(place, weight, n_bins), dtype=np.float64)

    right = truth[run] == row
    counts = np.bincount(place * runs + run, minlength=n_bins * runs).reshape(n_bins, runs)
    counts[0] = n_associations - counts.sum(axis=0)
    correct = by_bin(right.astype(np.float64))
    expected = by_bin(value)
    variance = by_bin(value * (1.0 - value))
    small = np.where(share < EDGES[1], share, 0.0)
    correct[0] = runs - correct.sum()
    expected[0] = small.sum()
    variance[0] = small.sum() - (small**2).sum()
    best = share.max(axis=0)
    hit = (share.argmax(axis=0) == truth).sum()
    return Tally(
        total=np.append(counts.sum(axis=1), runs).astype(np.float64),
        correct=np.append(correct, hit),
        expected=np.append(expected, best.sum()),
        variance=np.append(variance, (best * (1.0 - best)).sum()),
        squares=np.append((counts.astype(np.float64) ** 2).sum(axis=1), runs),
        runs=runs,
    )
