"""Prices on contested detections: Lagrangian relaxation of "no detection twice".

With a price on each detection, every track may take its best leaf on its own, and the sum of their
scores less prices, plus all prices, bounds the log weight of every hypothesis from above. Prices
that make the bound small are found by subgradients: a detection wanted more than once gets dearer,
one that nobody wants cheaper (Poore 1994, "Multidimensional assignment formulation of data
association problems arising from multitarget and multisensor tracking").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.association.leaves.problem import LeafProblem
from gda_tracker.association.leaves.search import Closing
from gda_tracker.association.leaves.stages import WORD, Stages
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

PATIENCE = 4
"""Rounds without a smaller bound until the step is halved."""


@dataclass(frozen=True, slots=True)
class Priced:
    """One cluster with prices: its stages with reduced scores.

    The log weight of a hypothesis is the bound less its deficit, less the ``closing`` costs of
    detections left unused, less ``unused``, the cost of those that no leaf uses any more. ``order``
    (O,) are the leaves as indices into the former stages.
    """

    stages: Stages
    unused: float
    closing: Closing
    order: IntArray


def price(
    stages: Stages, problem: LeafProblem, target: float, rounds: int
) -> tuple[FloatArray, float]:
    """Prices (bits,) of the detections of a batch of one cluster, and the bound with them.

    Parameters
    ----------
    stages : Stages
    problem : LeafProblem
    target : float
        Log weight that is aimed at: that of a known hypothesis.
    rounds : int
        Prices tried.
    """
    used, n_bits = _used_bits(stages, problem)
    # One row per track, padded by leaves that nobody takes.
    width = int(stages.count.max())
    scores = np.full((stages.n_steps, width), -np.inf)
    wanted = np.full((used.shape[1], stages.n_steps, width), n_bits)
    column = np.arange(len(used)) - stages.first[stages.step, 0]
    scores[stages.step, column] = stages.log_score
    wanted[:, stages.step, column] = used.T
    tracks = np.arange(stages.n_steps)
    price = np.zeros(n_bits + 1)  # the last one for no detection
    best_price, best_bound = price, np.inf
    pace, waited = 1.0, 0
    for _ in range(rounds + 1):
        reduced = scores - price[wanted].sum(axis=0)
        taken = reduced.argmax(axis=1)
        bound = float(reduced[tracks, taken].sum() + price.sum())
        if bound < best_bound - 1e-12 * abs(bound):
            best_price, best_bound, waited = price, bound, 0
        else:
            waited += 1
            if waited > PATIENCE:
                pace, waited, price = pace / 2, 0, best_price
                continue
        excess = np.bincount(wanted[:, tracks, taken].ravel(), minlength=n_bits + 1) - 1.0
        excess[n_bits] = 0.0
        excess[(price == 0.0) & (excess < 0.0)] = 0.0
        length = float(excess @ excess)
        if length == 0.0 or bound - target <= 0.0:
            break
        price = np.maximum(price + pace * (bound - target) / length * excess, 0.0)
    return best_price[:n_bits], best_bound


def with_prices(stages: Stages, problem: LeafProblem, prices: FloatArray, budget: float) -> Priced:
    """Reduce the scores by prices and leave out leaves whose deficit exceeds the budget."""
    used, _ = _used_bits(stages, problem)
    reduced = stages.log_score - np.append(prices, 0.0)[used].sum(axis=1)
    top = np.maximum.reduceat(reduced, stages.first[:, 0])
    order = ((top[stages.step] - reduced) <= budget).nonzero()[0]
    order = order[np.lexsort((-reduced[order], stages.step[order]))]
    used = used[order]
    priced = replace(
        stages,
        leaf=stages.leaf[order],
        log_score=reduced[order],
        mask=stages.mask[:, order],
        step=stages.step[order],
    ).keep(np.ones(len(order), dtype=np.bool_))
    last = np.full(len(prices) + 1, -1)
    np.maximum.at(last, used, np.broadcast_to(priced.step[:, None], used.shape))
    closing: list[list[tuple[int, int, float]]] = [[] for _ in range(stages.n_steps)]
    unused = 0.0
    for bit, cost in enumerate(prices.tolist()):
        if cost > 0.0 and last[bit] >= 0:
            closing[last[bit]].append((bit // WORD, bit % WORD, cost))
        elif cost > 0.0:
            unused += cost
    return Priced(priced, unused, closing, order)


def _used_bits(stages: Stages, problem: LeafProblem) -> tuple[IntArray, int]:
    """Bits of the detections of each leaf (O, N), and their number, which stands for none."""
    used = np.append(stages.bit, -1)[problem.contested[stages.leaf]]  # -1 is the last one
    n_bits = int(used.max(initial=-1)) + 1
    used[used < 0] = n_bits
    return used, n_bits
