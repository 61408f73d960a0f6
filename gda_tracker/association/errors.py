"""Errors of the association."""

from __future__ import annotations


class AssociationInputError(ValueError):
    """The inputs of the association do not fit each other, or hold values without meaning."""


class PairListMismatch(AssociationInputError):
    """Attribute scores were made for another list of gated pairs."""


class NoFeasibleHypothesis(ValueError):
    """Every joint hypothesis has weight zero, so that probabilities are not defined."""


class ClusterTooLarge(ValueError):
    """A cluster is too large for exact marginals."""
