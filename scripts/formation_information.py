"""How much a scan says of the number of objects that are partly unresolved, at best.

The number of detections alone, without false ones: its true distribution, from objects that keep
their places and pairs that are linked by their distances, against that of one object more, of which
nobody knows where it is.
"""

from __future__ import annotations

import math
from itertools import combinations, product

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.stats import binom

from gda_tracker.formations.resolution import detection_counts, group_probabilities

P_D = 0.9
# Right against wrong number at the default errors.
ODDS = 1000.0


def true_counts(places_m: np.ndarray, half_m: float, most: int) -> np.ndarray:
    """Probability (most + 1,) of so many detections of objects at places (n, 2), over all links.

    A pair at the distance ``half_m`` is resolved half of the time.
    """
    n = len(places_m)
    pairs = list(combinations(range(n), 2))
    apart = np.array([np.sum((places_m[a] - places_m[b]) ** 2) for a, b in pairs])
    linked = 0.5 ** (apart / half_m**2)
    found = np.zeros(most + 1)
    for there in product((False, True), repeat=len(pairs)):
        chosen = np.array(there)
        graph = np.zeros((n, n), dtype=bool)
        for (a, b), link in zip(pairs, there, strict=True):
            graph[a, b] = link
        groups = connected_components(graph, directed=False)[0]
        weight = float(np.prod(np.where(chosen, linked, 1.0 - linked)))
        found += weight * binom.pmf(np.arange(most + 1), groups, P_D)
    return found


def information(places_m: np.ndarray, half_m: float, spread_m: float) -> dict[str, float]:
    """Mean log ratio of a scan, n objects against n + 1 [nat], and scans to a ratio of 1000.

    ``draws``: as :mod:`gda_tracker.formations.resolution` has it, places unknown but for their
    spread. ``places``: if those of the n objects were known, which no model of the number of
    detections can surpass.
    """
    n, most = len(places_m), len(places_m) + 1
    out = places_m - places_m.mean(axis=0)
    spread = out.T @ out / n + spread_m**2 * np.eye(2)
    ratio = np.linalg.eigvalsh(spread) / (half_m**2 / (2.0 * math.log(2.0)))
    model = detection_counts(np.array([P_D]), group_probabilities(ratio[None], most))[0]
    truth = true_counts(places_m, half_m, most)
    seen = truth > 0.0
    draws = float(np.sum(truth[seen] * np.log(model[n][seen] / model[n + 1][seen])))
    places = float(np.sum(truth[seen] * np.log(truth[seen] / model[n + 1][seen])))
    return {
        "n": n,
        "draws_nat": draws,
        "places_nat": places,
        "draws_scans": math.log(ODDS) / draws,
        "places_scans": math.log(ODDS) / places,
    }
