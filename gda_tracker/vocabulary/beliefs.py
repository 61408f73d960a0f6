"""Beliefs about classes: what a detection says, and what a pair would make of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.scans import ScanKey


@dataclass(slots=True)
class Evidence:
    """Attribute evidence of n detections; message ``Evidence``.

    ``frame`` names the k elements of the frame of discernment, ``focal`` (F,) holds the Venn
    bitmask of each focal column, ``masses`` (n, F) sums to one along rows.
    ``log_class_likelihood`` (n, C) is log f(attributes | class), up to one constant per row (the
    RCS alone: [log 1/m2]), 0 where no attribute is known. Class c goes with frame element c, class
    0 is the false alarm.
    ``class_probability`` (n, C) is the prior updated by this detection alone: the first belief of
    a new track. ``informative`` (n,) is False where nothing is known.
    """

    key: ScanKey
    frame: tuple[str, ...]
    focal: MaskArray
    masses: FloatArray
    class_names: tuple[str, ...]
    log_class_likelihood: FloatArray
    class_probability: FloatArray
    informative: BoolArray


@dataclass(slots=True)
class AttributeScores:
    """What each of P gated pairs would make of the attribute; message ``AttributeScores``.

    ``hypothesis`` and ``detection`` (P,) are rows of the predictions and the scan, row-major.
    ``distance`` (P,) is the term's distance of history and candidate history (meaningful if
    ``has_distance``), ``log_likelihood`` (P,) log sum_c P(c | history) f(attribute | c),
    ``clutter_log_likelihood`` (n,) log f(attribute | false alarm). ``masses`` (P, E) over ``focal``
    and ``class_probability`` (P, C) are the candidate beliefs. Statements have changed the
    histories of the hypotheses ``updated_hypothesis`` (U,): ``updated_masses`` (U, E) and
    ``updated_class_probability`` (U, C) are what they are without a detection too.
    """

    key: ScanKey
    attribute_term: str
    has_distance: bool
    hypothesis: Int32Array
    detection: Int32Array
    distance: FloatArray
    log_likelihood: FloatArray
    conflict: FloatArray
    informative: BoolArray
    clutter_log_likelihood: FloatArray
    frame: tuple[str, ...]
    focal: MaskArray
    masses: FloatArray
    class_names: tuple[str, ...]
    class_probability: FloatArray
    updated_hypothesis: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    updated_masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    updated_class_probability: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
