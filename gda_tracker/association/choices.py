"""Names of the choices of an association; imports nothing, for use in parameter tables."""

from __future__ import annotations

JPDA = "jpda"
DECISIONS = ("gda", "map", JPDA, "mht")
"""``gda``: minimal sum of 1 - P_k P_a (14.4); ``map``: most probable joint hypothesis; ``jpda``:
every detection as far as it is probable, hits and misses by the most probable joint hypothesis;
``mht``: the track manager branches, over several scans.
"""

COALESCENCE_REMEDIES = ("none", "jpda_star")
"""``jpda_star``: of the joint hypotheses that detect the same tracks and use the same measurements
only the most probable counts (Blom & Bloem 2000), in the marginals of the decision ``jpda``.
"""

MISSED_TRACK_HYPOTHESES = ("zero", "table_14_3")
"""Weight, in the attribute term, of a joint hypothesis that misses a track.

``zero``: none when a fuller hypothesis exists. ``table_14_3``: the product over its assigned
pairs, as printed; only the empty hypothesis weighs nothing.
"""

SUBSET_DYNAMIC_PROGRAMMING = "subset_dynamic_programming"
FRONTIER_DYNAMIC_PROGRAMMING = "frontier_dynamic_programming"
LOOPY_BELIEF_PROPAGATION = "loopy_belief_propagation"
BEST_PERMUTATIONS = "best_permutations"
EACH_HYPOTHESIS_ALONE = "each_hypothesis_alone"
"""Engine of ``mht``: pairs are scored, the track manager decides over several scans."""
ENGINES = (
    SUBSET_DYNAMIC_PROGRAMMING,
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
    BEST_PERMUTATIONS,
)
"""Engines that compute joint marginals: two exact ones, the approximation beyond, and JPDA*."""
