"""What the attribute terms take in and give back: pairs of a history and a detection, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.beliefs import Evidence

NO_FOCAL: MaskArray = np.zeros(0, dtype=np.uint32)
NO_FOCAL.flags.writeable = False


@dataclass(slots=True)
class Pairs:
    """Histories of P pairs and the detections that they meet.

    ``history_masses`` (P, E0) over ``history_focal`` (E0,) and ``history_class_probability`` (P, C)
    speak of the frame and the classes of ``evidence``; ``detection`` (P,) are rows of it.
    ``forgetting_factor`` and ``class_transition`` are those of
    :func:`gda_tracker.attributes.fusion.fuse_pairs`.
    """

    history_focal: MaskArray
    history_masses: FloatArray
    history_class_probability: FloatArray
    evidence: Evidence
    detection: Int32Array
    forgetting_factor: float = 1.0
    class_transition: FloatArray | None = None


@dataclass(slots=True)
class PairBeliefs:
    """Candidate beliefs of P pairs; the fields are those of ``AttributeScores``."""

    focal: MaskArray
    masses: FloatArray
    class_probability: FloatArray
    distance: FloatArray
    log_likelihood: FloatArray
    conflict: FloatArray
    informative: BoolArray


def without_attribute(pairs: Pairs) -> PairBeliefs:
    """Term ``none``: nothing is scored, the class probabilities stay as they are."""
    n = len(pairs.detection)
    return PairBeliefs(
        focal=NO_FOCAL,
        masses=empty_floats(n, 0),
        class_probability=pairs.history_class_probability,
        distance=np.zeros(n),
        log_likelihood=np.zeros(n),
        conflict=np.zeros(n),
        informative=np.zeros(n, dtype=np.bool_),
    )
