"""Histories from windows: what the last detections of each hypothesis make together.

The recursion over two sources that makes a history out of all detections is started anew at the
oldest row of the window. So a window that holds all detections gives what there is without one, for
every term, and a window without rows gives a history that knows nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.class_terms import class_history
from gda_tracker.attributes.mass_terms import fuse_rows
from gda_tracker.attributes.pair_beliefs import NO_FOCAL
from gda_tracker.attributes.terms import DISTANCE_TERMS
from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.hypotheses import BELIEF_ROW, EVIDENCE_ROW, NO_ROW, Predictions

# Columns (E,), masses (R, E), class probabilities (R, C).
Histories = tuple[MaskArray, FloatArray, FloatArray]


@dataclass(slots=True)
class Windows:
    """Windows of R hypotheses with L rows each; the fields are those of ``Predictions``."""

    focal: MaskArray
    kind: Int32Array
    masses: FloatArray
    log_class_likelihood: FloatArray

    @property
    def first(self) -> IntArray:
        """(R,) the oldest row of each window, L where there is none."""
        end = np.ones((len(self.kind), 1), dtype=np.bool_)
        return np.argmax(np.hstack([self.kind != NO_ROW, end]), axis=1)


def windows_of(predictions: Predictions, rows: Int32Array) -> Windows:
    """Return the windows of hypotheses, (R,) rows of the predictions."""
    if not predictions.window_kind.size:
        # A window of one detection: what came before does not count.
        kind = np.zeros((len(rows), 0), dtype=np.int32)
        none = empty_floats(len(rows), 0, 0)
        return Windows(NO_FOCAL, kind, none, none)
    return Windows(
        predictions.window_focal,
        predictions.window_kind[rows],
        predictions.window_masses[rows],
        predictions.window_log_class_likelihood[rows],
    )


def window_histories(
    term: str,
    frame: tuple[str, ...],
    windows: Windows,
    prior: FloatArray,
    class_transition: FloatArray | None = None,
) -> Histories:
    """Fuse the rows of each window, the oldest first, by an attribute term.

    Parameters
    ----------
    term
        Attribute term.
    frame
        Frame of the windows' masses.
    windows
        The windows.
    prior
        (C,) class prior.
    class_transition
        (C, C) p(c | c') for the term ``bayes``, ``None``: no change.

    Returns
    -------
    focal, masses, class_probability
        (E,) columns, (R, E) masses (no columns under terms without masses) and (R, C) class
        probabilities (the prior under terms with masses, which do not look at them).
    """
    count = len(windows.kind)
    classes = np.tile(prior, (count, 1))
    if term in DISTANCE_TERMS:
        focal, masses = _fused_masses(term, frame, windows)
        return focal, masses, classes
    if term == "bayes":
        classes = _fused_classes(windows, classes, class_transition)
    return NO_FOCAL, empty_floats(count, 0), classes


def replace_rows(
    histories: Histories, others: Histories, chosen: BoolArray, ignorance: int
) -> Histories:
    """Return histories with the ``chosen`` (R,) rows of others, over columns for both.

    Others without columns know nothing: they have their mass on total ``ignorance``.
    """
    focal, masses, classes = histories
    other_focal, other_masses, other_classes = others
    if masses.shape[1]:
        if not len(other_focal):
            other_focal = np.array([ignorance], dtype=np.uint32)
            other_masses = np.ones((len(masses), 1))
        columns = np.append(focal, other_focal[~np.isin(other_focal, focal)]).astype(np.uint32)
        place = np.array([columns.tolist().index(mask) for mask in other_focal.tolist()])
        wide = np.zeros((len(masses), len(columns)))
        wide[:, : len(focal)] = masses
        wide[chosen] = 0.0
        wide[np.flatnonzero(chosen)[:, None], place] = other_masses[chosen]
        focal, masses = columns, wide
    return focal, masses, np.where(chosen[:, None], other_classes, classes)


def _fused_masses(
    term: str, frame: tuple[str, ...], windows: Windows
) -> tuple[MaskArray, FloatArray]:
    first = windows.first
    ignorance = np.uint32(total_ignorance(len(frame)))
    focal = windows.focal
    if ignorance not in focal:
        focal = np.append(focal, ignorance).astype(np.uint32)
    masses = np.zeros((len(first), len(focal)))
    masses[:, focal == ignorance] = 1.0
    begun = np.flatnonzero(first < windows.kind.shape[1])
    masses[begun] = 0.0
    masses[begun, : len(windows.focal)] = windows.masses[begun, first[begun]]
    for row in range(1, windows.kind.shape[1]):
        # All rows behind the oldest are detections.
        later = first < row
        if later.any():
            focal, masses = fuse_rows(
                term, frame, focal, masses, windows.focal, windows.masses[:, row], later
            )
    return focal, masses


def _fused_classes(
    windows: Windows, prior: FloatArray, class_transition: FloatArray | None
) -> FloatArray:
    first, classes = windows.first, prior
    for row in range(windows.kind.shape[1]):
        kind, likelihood = windows.kind[:, row], windows.log_class_likelihood[:, row]
        updated = class_history(classes, likelihood, class_transition, first < row)
        classes = np.where((kind == EVIDENCE_ROW)[:, None], updated, classes)
        classes = np.where((kind == BELIEF_ROW)[:, None], np.exp(likelihood), classes)
    return classes
