"""Set packing by integer programming: the last resort for a cluster."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_matrix

from gda_tracker.association.leaves.problem import LeafProblem
from gda_tracker.association.leaves.stages import Stages
from gda_tracker.vocabulary.arrays import IntArray

OPTIMAL, INFEASIBLE = 0, 2
"""Status of ``scipy.optimize.milp``."""


class Packing(NamedTuple):
    """Leaf of each step (K,) as index into the stages, ``None`` if no hypothesis was found.

    ``bound`` is an upper bound of the log weight of all hypotheses: that of the answer where it is
    proven best, -inf where there is proven to be none.
    """

    options: IntArray | None
    bound: float


def pack(stages: Stages, problem: LeafProblem, nodes: int) -> Packing:
    """Best hypothesis of a batch of one cluster by HiGHS, within ``nodes`` nodes.

    Proven to 1e-6 in the log weight, the solver's tolerance.
    """
    n_leaves = len(stages.leaf)
    leaf, scan = (problem.contested[stages.leaf] >= 0).nonzero()
    detection = stages.bit[problem.contested[stages.leaf[leaf], scan]]
    rows = np.concatenate([stages.step, stages.n_steps + detection])
    columns = np.concatenate([np.arange(n_leaves), leaf])
    n_rows = stages.n_steps + int(detection.max(initial=-1)) + 1
    matrix = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n_rows, n_leaves)).tocsc()
    least = np.zeros(n_rows)
    least[: stages.n_steps] = 1.0
    # Relative to the best leaf of the track: small numbers keep the solver's tolerances small.
    top = stages.top()[stages.step, 0]
    answer = milp(
        top - stages.log_score,
        integrality=np.ones(n_leaves),
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(matrix, least, np.ones(n_rows)),
        options={"node_limit": nodes, "mip_rel_gap": 0.0},
    )
    if answer.status == INFEASIBLE:
        return Packing(None, -np.inf)
    total = float(stages.top().sum())
    bound = total
    if answer.get("mip_dual_bound") is not None:
        bound = total - answer.mip_dual_bound
    if answer.x is None:
        return Packing(None, bound)
    chosen = (answer.x > 0.5).nonzero()[0]
    options = np.full(stages.n_steps, -1)
    options[stages.step[chosen]] = chosen
    if (options < 0).any() or len(chosen) != stages.n_steps:
        raise RuntimeError(f"integer programming chose {len(chosen)} leaves of {stages.n_steps}")
    if answer.status == OPTIMAL:
        bound = float(stages.log_score[options].sum())
    return Packing(options, bound)
