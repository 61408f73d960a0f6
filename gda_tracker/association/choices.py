"""Names of the choices of an association; imports nothing, for use in parameter tables."""

from __future__ import annotations

DECISIONS = ("gda", "map")
"""``gda``: minimal sum of 1 - P_k P_a (14.4); ``map``: most probable joint hypothesis."""

MISSED_TRACK_HYPOTHESES = ("zero", "table_14_3")
"""Weight, in the attribute term, of a joint hypothesis that misses a track.

``zero``: none when a fuller hypothesis exists. ``table_14_3``: the product over its assigned
pairs, as printed; only the empty hypothesis weighs nothing.
"""

SUBSET_DYNAMIC_PROGRAMMING = "subset_dynamic_programming"
FRONTIER_DYNAMIC_PROGRAMMING = "frontier_dynamic_programming"
LOOPY_BELIEF_PROPAGATION = "loopy_belief_propagation"
ENGINES = (
    SUBSET_DYNAMIC_PROGRAMMING,
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
)
"""Engines that compute joint marginals: two exact ones, and the approximation beyond."""
