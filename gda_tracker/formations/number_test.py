"""The number of objects, scan after scan: its probabilities at any time, and its decision.

**Probabilities.** c_k(n) is (4.12) of Koch (2014), with one addition: a number may change. Between
two scans an object leaves or joins with the probability 1 - exp(-dt / T), either with the same
chance, at the ends of 1..N the one that is possible; c follows as the state of a hidden Markov
chain. With T infinite it is (4.12) to the letter.

**Decision.** Wald's test between every two numbers at once (Armitage, "Sequential analysis with
more than two alternative hypotheses", 1950): i objects are accepted as soon as LR_i / LR_j >= 1 /
alpha_ij against *every* j. If j is true, LR_i / LR_j is a martingale of mean 1, so that i is ever
accepted with the probability alpha_ij at most, whatever the number of scans. With

    alpha_ij = P(too many) (1 - s) s^(i - j - 1)   for i > j,
    alpha_ij = P(too few)  (1 - s) s^(j - i - 1)   for i < j

the sum over all numbers above (below) the true one is at most P(too many) (P(too few)). s is small:
it is neighbours that are taken for each other, and they get nearly all of the error allowed. None
at all, false detections alone, is one of the numbers, with LR_0 = 1: a formation that a false track
makes is not one of one object.
After each decision the test begins anew, from data of later scans alone: its errors stay those of
one test, and a number that has changed is found by the next one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.formations.likelihood import cardinality
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

# Share of the allowed error that goes on from a number to the next one farther off.
FARTHER = 0.1
# Number of objects before the first decision, as of false detections alone.
NOT_YET = 0
IMPOSSIBLE = -1e300


def log_thresholds(most: int, overcount: float, undercount: float) -> FloatArray:
    """Log 1 / alpha_ij (N + 1, N + 1) by [i, j], i, j = 0..N; -inf for i = j.

    Parameters
    ----------
    most
        N.
    overcount, undercount
        P(a number larger than the true one is accepted), P(a smaller one), of one test.
    """
    number = np.arange(most + 1)
    off = number[:, None] - number[None, :]
    share = math.log1p(-FARTHER) + (np.abs(off) - 1.0) * math.log(FARTHER)
    allowed = np.where(off > 0, math.log(overcount), math.log(undercount)) + share
    return np.where(off == 0, -np.inf, -allowed)


def transition(most: int, elapsed_s: FloatArray, change_s: float) -> FloatArray:
    """P(n now | n' before) (B, N, N) by [n' - 1, n - 1]; rows sum to one.

    Parameters
    ----------
    most
        N.
    elapsed_s
        (B,) time since the scan before.
    change_s
        T, mean time between two changes; 0: the number never changes.
    """
    with np.errstate(over="ignore"):
        stay = np.exp(-elapsed_s / change_s) if change_s > 0.0 else np.ones(len(elapsed_s))
    step = np.zeros((most, most))
    if most == 1:
        step[0, 0] = 1.0
    else:
        inner = np.arange(1, most - 1)
        step[inner, inner - 1] = step[inner, inner + 1] = 0.5
        step[0, 1] = step[-1, -2] = 1.0
    moved: FloatArray = stay[:, None, None] * np.eye(most) + (1.0 - stay)[:, None, None] * step
    return moved


@dataclass(slots=True)
class NumberTests:
    """Tests of B clusters.

    ``probability`` (B, N) c(n); ``log_ratio`` (B, N) log LR_n of the test that is open, ``samples``
    (B,) its scans and ``began_ns`` (B,) the first of them; ``last_ns`` (B,) the last scan;
    ``number`` (B,) accepted last, ``NOT_YET`` before (and
    where there are false detections alone); ``since_ns`` (B,) since when.
    """

    probability: FloatArray
    log_ratio: FloatArray
    samples: IntArray
    began_ns: IntArray
    last_ns: IntArray
    number: IntArray
    since_ns: IntArray

    @classmethod
    def begin(cls, clusters: int, most: int, stamp_ns: int) -> NumberTests:
        """Return tests that know nothing, of clusters that are there since ``stamp_ns``."""
        zeros = np.zeros(clusters, dtype=np.int64)
        return cls(
            np.full((clusters, most), 1.0 / most),
            np.zeros((clusters, most)),
            zeros.copy(),
            zeros.copy(),
            np.full(clusters, stamp_ns, dtype=np.int64),
            zeros.copy(),
            zeros.copy(),
        )

    def __len__(self) -> int:
        return len(self.number)

    def select(self, rows: IntArray) -> NumberTests:
        """Return the tests of some clusters."""
        return NumberTests(*(getattr(self, name)[rows] for name in self.__slots__))

    def append(self, other: NumberTests) -> NumberTests:
        """Return these tests and those of further clusters."""
        return NumberTests(
            *(np.concatenate([getattr(self, n), getattr(other, n)]) for n in self.__slots__)
        )


@dataclass(frozen=True, slots=True)
class NumberDecisions:
    """What one scan decided, of the clusters ``rows`` (D,).

    ``number`` (D,) accepted, ``margin`` (D,) its log ratio against the strongest rival, ``samples``
    (D,) scans and ``began_ns`` (D,) the first of them.
    """

    rows: IntArray
    number: IntArray
    margin: FloatArray
    samples: IntArray
    began_ns: IntArray


def advance_numbers(
    tests: NumberTests,
    observed: BoolArray,
    log_ratio: FloatArray,
    stamp_ns: int,
    thresholds: FloatArray,
    change_s: float,
) -> NumberDecisions:
    """Take one scan; tests are changed in place, those that decide begin anew.

    Parameters
    ----------
    tests
        Of B clusters.
    observed
        (B,) which of them the scan tells something of.
    log_ratio
        (B, N) of the scan, from ``log_number_ratios``.
    stamp_ns
        Time of the scan, not before that of the last one.
    thresholds
        (N + 1, N + 1) from :func:`log_thresholds`.
    change_s
        As in :func:`transition`.
    """
    which = np.flatnonzero(observed)
    most = tests.probability.shape[1]
    elapsed_s: FloatArray = (stamp_ns - tests.last_ns[which]).astype(np.float64) * 1e-9
    moves = transition(most, elapsed_s, change_s)
    predicted: FloatArray = (tests.probability[which][:, None, :] @ moves)[:, 0]
    with np.errstate(divide="ignore"):
        tests.probability[which] = cardinality(np.log(predicted) + log_ratio[which])
    tests.last_ns[which] = stamp_ns
    tests.began_ns[which] = np.where(tests.samples[which] == 0, stamp_ns, tests.began_ns[which])
    tests.samples[which] += 1
    tests.log_ratio[which] += log_ratio[which]
    ratio = np.concatenate([np.zeros((len(which), 1)), tests.log_ratio[which]], axis=1)
    # A number that is impossible (-inf) is far behind all others, and never accepted.
    ratio = np.maximum(ratio, IMPOSSIBLE)
    accepted = (ratio[:, :, None] - ratio[:, None, :] >= thresholds).all(axis=2)
    decided = np.flatnonzero(accepted.any(axis=1))
    number = np.argmax(accepted[decided], axis=1)
    rivals = ratio[decided].copy()
    rivals[np.arange(len(decided)), number] = -np.inf
    margin = ratio[decided, number] - rivals.max(axis=1, initial=-np.inf)
    rows = which[decided]
    decisions = NumberDecisions(
        rows, number, margin, tests.samples[rows].copy(), tests.began_ns[rows].copy()
    )
    changed = tests.number[rows] != decisions.number
    tests.since_ns[rows] = np.where(changed, stamp_ns, tests.since_ns[rows])
    tests.number[rows] = decisions.number
    tests.log_ratio[rows] = 0.0
    tests.samples[rows] = 0
    return decisions


def merged_probability(first: FloatArray, second: FloatArray) -> FloatArray:
    """Probabilities (N,) of the number in two clusters that are one now: of the sum, up to N.

    Where both are sure of a sum beyond N, the largest number is all that is left.
    """
    most = len(first)
    both = np.convolve(first, second)  # of 2 .. 2N
    found = np.zeros(most)
    found[1:] = both[: most - 1]
    found[-1] += both[most - 1 :].sum()
    merged: FloatArray = found / found.sum()
    return merged
