"""The history window: the last rows of attribute evidence of each hypothesis.

With the history policy ``window`` of W detections the belief of a hypothesis is the fusion of its
last W detections with a known attribute. The stages keep nothing from scan to scan, so the table of
hypotheses keeps the last W - 1 of these rows and the predictions carry them; the W-th is the
detection that a pair would add. Detections without a known attribute leave the window as it is, as
they leave the history without one.

A belief that is there before the window is, of initial tracks or from another policy, enters it as
one row, the oldest, and falls out of it like a detection.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.tracking.hypotheses import HypothesisTable, move_columns
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, MaskArray
from gda_tracker.vocabulary.beliefs import Evidence
from gda_tracker.vocabulary.hypotheses import BELIEF_ROW, EVIDENCE_ROW


def with_window(table: HypothesisTable, rows: int) -> HypothesisTable:
    """Return the hypotheses with windows of so many rows; the table given stays as it is.

    Longer windows keep what they have; shorter ones keep the newest rows. Where there were none,
    what a hypothesis believes becomes the newest row.
    """
    before = table.window_kind.shape[1]
    if rows == before:
        return table
    resized = table.copy()
    resized.clear_windows(rows)
    if not before and table.frame:
        _take_beliefs(resized)
    elif before and rows:
        kept = min(rows, before)
        width = len(table.window_focal)
        resized.window_focal = table.window_focal
        resized.window_masses = np.zeros((len(table), rows, width))
        for name in ("window_kind", "window_masses", "window_log_class_likelihood"):
            getattr(resized, name)[:, -kept:] = getattr(table, name)[:, -kept:]
    return resized


def _take_beliefs(table: HypothesisTable) -> None:
    """Make the beliefs the newest rows of windows that are empty."""
    table.window_focal, masses = table.focal, table.masses
    if not len(table.focal):
        table.window_focal = np.array([total_ignorance(len(table.frame))], dtype=np.uint32)
        masses = np.ones((len(table), 1))
    table.window_masses = np.zeros((*table.window_kind.shape, len(table.window_focal)))
    table.window_masses[:, -1] = masses
    table.window_kind[:, -1] = BELIEF_ROW
    with np.errstate(divide="ignore"):
        table.window_log_class_likelihood[:, -1] = np.log(table.class_probability)


def remember(
    table: HypothesisTable, evidence: Evidence, hypothesis: Int32Array, detection: Int32Array
) -> None:
    """Add the evidence of detections to the windows of the hypotheses that they are given to.

    Parameters
    ----------
    table
        Hypotheses; they speak of the frame and the classes of the evidence.
    evidence
        Evidence of the scan.
    hypothesis, detection
        (A,) rows of the table, each at most once, and of the evidence.
    """
    if not table.window_kind.shape[1]:
        return
    known = evidence.informative[detection]
    rows, added = hypothesis[known], detection[known]
    if not len(rows):
        return
    masses = _over_columns_of(table, evidence)[added]
    for name, new in (
        ("window_kind", np.full(len(rows), EVIDENCE_ROW, dtype=np.int32)),
        ("window_masses", masses),
        ("window_log_class_likelihood", evidence.log_class_likelihood[added]),
    ):
        values = getattr(table, name).copy()
        values[rows, :-1] = values[rows, 1:]
        values[rows, -1] = new
        setattr(table, name, values)


def begin_windows(
    born: HypothesisTable, table: HypothesisTable, evidence: Evidence | None, detection: IntArray
) -> None:
    """Give new rows the windows with which they fit under ``table``.

    ``detection`` are the rows of the evidence that hold their newest detections. The columns of
    ``table`` are widened where these need more.
    """
    rows = table.window_kind.shape[1]
    if not rows:
        return
    masses = None if evidence is None else _over_columns_of(table, evidence)
    n, (width, classes) = len(born), (len(table.window_focal), len(table.class_names))
    born.window_kind = np.zeros((n, rows), dtype=np.int32)
    born.window_masses = np.zeros((n, rows, width))
    born.window_log_class_likelihood = np.zeros((n, rows, classes))
    if evidence is None or masses is None:
        return
    known = evidence.informative[detection]
    born.window_kind[known, -1] = EVIDENCE_ROW
    born.window_masses[known, -1] = masses[detection[known]]
    born.window_log_class_likelihood[known, -1] = evidence.log_class_likelihood[detection[known]]


def _over_columns_of(table: HypothesisTable, evidence: Evidence) -> FloatArray:
    """Masses of the evidence over the columns of the windows, which are made to hold them."""
    if not np.array_equal(table.window_focal, evidence.focal):
        _use_columns(table, evidence.focal)
    if len(table.window_focal) == len(evidence.focal):
        return evidence.masses
    return move_columns(evidence.masses, evidence.focal, table.window_focal)


def _use_columns(table: HypothesisTable, focal: MaskArray) -> None:
    """Let the columns of the windows be ``focal`` and those that carry mass beside."""
    old = table.window_focal
    extra = old[(table.window_masses != 0.0).any(axis=(0, 1)) & ~np.isin(old, focal)]
    columns = np.concatenate([focal, extra]).astype(np.uint32)
    h, rows = table.window_kind.shape
    flat = table.window_masses.reshape(h * rows, len(old))
    table.window_masses = move_columns(flat, old, columns).reshape(h, rows, len(columns))
    table.window_focal = columns
