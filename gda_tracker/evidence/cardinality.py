"""Sizes under a model: Venn parts of an element, elements of a hyper-power set.

>>> from gda_tracker.evidence.frames import constrained_model, free_model, parse_element
>>> names = ("A", "B", "C")
>>> dsm_cardinality(free_model(names), parse_element(names, "A&B"))
2
>>> len(elements(free_model(names))), len(elements(constrained_model(names, ["A&B"])))
(18, 12)
"""

from __future__ import annotations

import numpy as np

from gda_tracker.evidence.frames import (
    Model,
    free_element,
    hyper_power_set,
    sort_elements,
)
from gda_tracker.vocabulary.arrays import MaskArray


def dsm_cardinality(model: Model, mask: int) -> int:
    """C_M(X): number of Venn parts of an element that exist in the model, 0 if it is dead.

    ``mask`` is an element of the free model or as reduced by the model. (Dezert, Smarandache and
    Daniel 2004)
    """
    return (free_element(model, mask) & model.alive).bit_count()


def elements(model: Model) -> MaskArray:
    """Non-empty elements of the hyper-power set of a model, reduced by it, in column order.

    On the free model 1, 4, 18, 166, 7579 for one to five elements of the frame, on Shafer's model
    2^n - 1; elements that the model merges count once.
    """
    reduced = np.unique(model.reduce(hyper_power_set(model.size)))
    return sort_elements(reduced[reduced > 0].tolist())
