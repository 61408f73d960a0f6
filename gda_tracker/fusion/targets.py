"""The fused targets over time, and what they have told of the biases.

Each target is a Gaussian over its state and the unknown biases (``biases``). It takes in what the
radars learnt, scan by scan, so nothing is counted twice. Where it turns out that its tracks did
not belong together it begins anew, and its vote on the biases is withdrawn.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from gda_tracker.fusion.biases import (
    Biases,
    BiasUnknowns,
    absorb,
    biases_of,
    forget,
    states,
    votes,
)
from gda_tracker.fusion.motion import STATE, predict_information
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

NANOSECONDS = 1_000_000_000


class _Votes(NamedTuple):
    """Votes on the biases as they were at a time; ``ended`` is the sum of ended targets'."""

    stamp_ns: int
    lineage: IntArray
    information: FloatArray
    vector: FloatArray
    ended_information: FloatArray
    ended_vector: FloatArray


class FusedTargets:
    """Gaussians of the fused targets and the biases.

    Attributes
    ----------
    identity : (N,)
        Fused track ids, rising.
    probability : (N,)
        That the tracks of each target belong together, as of the last fusion.
    fusions : (N,), first_ns : (N,)
        Fusions and time of the first one.
    """

    def __init__(self, unknowns: BiasUnknowns, n_radars: int) -> None:
        self.unknowns = unknowns
        self._n_radars = n_radars
        size = STATE + unknowns.size
        self.stamp_ns = -1
        self.identity = np.zeros(0, dtype=np.int64)
        self.probability = np.zeros(0)
        self.fusions = np.zeros(0, dtype=np.int64)
        self.first_ns = np.zeros(0, dtype=np.int64)
        self._lineage = np.zeros(0, dtype=np.int64)
        self._seen_by = np.zeros((0, n_radars), dtype=np.bool_)
        self._information = np.zeros((0, size, size))
        self._vector = np.zeros((0, size))
        self._next_lineage = 0
        self._history: deque[_Votes] = deque()
        self._withdrawn: set[int] = set()
        self._drop_ended()

    def _drop_ended(self) -> None:
        self._ended = np.zeros_like(self.unknowns.prior)
        self._ended_vector = np.zeros(self.unknowns.size)

    # --- time and information ---------------------------------------------------------------

    def predict(self, stamp_ns: int, density_m2ps3: float, bias_memory_s: float) -> None:
        """Go on to a time; earlier ones change nothing."""
        if stamp_ns <= self.stamp_ns:
            return
        dt_s = (stamp_ns - self.stamp_ns) / NANOSECONDS if self.stamp_ns >= 0 else 0.0
        self.stamp_ns = stamp_ns
        self._information, self._vector = predict_information(
            self._information, self._vector, dt_s, density_m2ps3
        )
        if bias_memory_s > 0.0 and self.unknowns.size:
            share = float(np.exp(-dt_s / bias_memory_s))
            self._information, self._vector = forget(self._information, self._vector, share)
            self._ended *= share
            self._ended_vector *= share

    def learn(
        self,
        radar: int,
        identity: IntArray,
        learnt: tuple[FloatArray, FloatArray],
    ) -> None:
        """Take in what a radar learnt of targets (k,), all different, as of the present time."""
        rows = np.searchsorted(self.identity, identity)
        absorb(self._information, self._vector, rows, learnt, self.unknowns, radar)
        self._seen_by[rows, radar] |= learnt[0].any(axis=(1, 2))

    # --- life -------------------------------------------------------------------------------

    def begin(self, identity: IntArray) -> None:
        """Add targets of which nothing is known; the ids are above all others."""
        n, size = len(identity), STATE + self.unknowns.size
        self.identity = np.concatenate([self.identity, identity])
        self.probability = np.concatenate([self.probability, np.zeros(n)])
        self.fusions = np.concatenate([self.fusions, np.zeros(n, dtype=np.int64)])
        self.first_ns = np.concatenate([self.first_ns, np.full(n, self.stamp_ns)])
        self._lineage = np.concatenate([self._lineage, self._next_lineage + np.arange(n)])
        self._next_lineage += n
        self._seen_by = np.concatenate(
            [self._seen_by, np.zeros((n, self._n_radars), dtype=np.bool_)]
        )
        self._information = np.concatenate([self._information, np.zeros((n, size, size))])
        self._vector = np.concatenate([self._vector, np.zeros((n, size))])

    def begin_anew(self, identity: IntArray) -> None:
        """Forget the states of targets and withdraw what they said of the biases."""
        rows = np.searchsorted(self.identity, identity)
        self._withdrawn.update(self._lineage[rows].tolist())
        self._lineage[rows] = self._next_lineage + np.arange(len(rows))
        self._next_lineage += len(rows)
        self._seen_by[rows] = False
        self._information[rows] = 0.0
        self._vector[rows] = 0.0

    def end(self, identity: IntArray, sound: BoolArray, minimum_probability: float) -> None:
        """Remove targets; the votes of the ``sound`` (k,) ones stay."""
        rows = np.searchsorted(self.identity, identity)
        counted = self._counted(minimum_probability)[rows] & sound
        information, vector = self._votes()
        self._ended += information[rows[counted]].sum(axis=0)
        self._ended_vector += vector[rows[counted]].sum(axis=0)
        self._withdrawn.update(self._lineage[rows[~counted]].tolist())
        left = np.ones(len(self.identity), dtype=np.bool_)
        left[rows] = False
        self.identity, self.probability = self.identity[left], self.probability[left]
        self.fusions, self.first_ns = self.fusions[left], self.first_ns[left]
        self._lineage, self._seen_by = self._lineage[left], self._seen_by[left]
        self._information, self._vector = self._information[left], self._vector[left]

    def forget_biases(self) -> None:
        """Drop all that was learnt of the biases; all targets begin anew."""
        self.begin_anew(self.identity)
        self._history.clear()
        self._drop_ended()

    # --- what is known ----------------------------------------------------------------------

    def _counted(self, minimum_probability: float) -> BoolArray:
        """Whose vote (N,) counts: of two radars at least, that surely saw the same target."""
        several = self._seen_by.sum(axis=1) > 1
        return np.asarray(several & (self.probability >= minimum_probability))

    def _votes(self) -> tuple[FloatArray, FloatArray]:
        """Votes (N, n, n) and (N, n); zero where a single radar told of the target."""
        several = self._seen_by.sum(axis=1) > 1
        information = np.zeros((len(several), *self.unknowns.prior.shape))
        vector = np.zeros(information.shape[:2])
        information[several], vector[several] = votes(
            self._information[several], self._vector[several]
        )
        return information, vector

    def remember(self, minimum_probability: float, memory_s: float) -> None:
        """Keep the votes as they are now, for :meth:`biases_before`."""
        information, vector = self._votes()
        counted = self._counted(minimum_probability)
        self._history.append(
            _Votes(
                self.stamp_ns,
                self._lineage[counted].copy(),
                information[counted],
                vector[counted],
                self._ended.copy(),
                self._ended_vector.copy(),
            )
        )
        until = self.stamp_ns - round(memory_s * NANOSECONDS)
        while len(self._history) > 1 and self._history[1].stamp_ns <= until:
            self._history.popleft()

    def biases_before(self, memory_s: float) -> tuple[Biases, bool]:
        """Biases as they were known ``memory_s`` ago, and whether there was more than the prior."""
        until = self.stamp_ns - round(memory_s * NANOSECONDS)
        known = [entry for entry in self._history if entry.stamp_ns <= until]
        if not known:
            return self.prior(), False
        last = known[-1]
        kept = ~np.isin(last.lineage, list(self._withdrawn))
        information = last.ended_information + last.information[kept].sum(axis=0)
        vector = last.ended_vector + last.vector[kept].sum(axis=0)
        found = biases_of(self.unknowns, self.unknowns.prior + information, vector)
        return found, bool(information.any())

    def prior(self) -> Biases:
        """Biases before anything was learnt."""
        return biases_of(self.unknowns, self.unknowns.prior, np.zeros(self.unknowns.size))

    def biases(self, minimum_probability: float) -> Biases:
        """Biases with all that was learnt."""
        information, vector = self._total(minimum_probability)
        return biases_of(self.unknowns, information, vector)

    def _total(self, minimum_probability: float) -> tuple[FloatArray, FloatArray]:
        information, vector = self._votes()
        counted = self._counted(minimum_probability)
        return (
            self.unknowns.prior + self._ended + information[counted].sum(axis=0),
            self._ended_vector + vector[counted].sum(axis=0),
        )

    def states(self, minimum_probability: float) -> tuple[FloatArray, FloatArray]:
        """States (N, 4) and covariances (N, 4, 4), biases integrated out.

        Exact if all is linear and the tracks are associated rightly: what one central filter over
        all targets and biases would find from the radars' detections.
        """
        information, vector = self._votes()
        counted = self._counted(minimum_probability)
        total, total_vector = self._total(minimum_probability)
        rest = total - np.where(counted[:, None, None], information, 0.0)
        rest_vector = total_vector - np.where(counted[:, None], vector, 0.0)
        return states(self._information, self._vector, rest, rest_vector)
