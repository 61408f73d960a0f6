"""Whether the answers of the other stages fit the open scan."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import ScanKey

MARGINAL_TOLERANCE = 1e-3
"""By how much the marginals of a hypothesis may sum to more than 1: an engine may approximate."""


class Inconsistent(ValueError):
    """A stage's answer does not fit the open scan; the message says what is wrong."""


def check_answers(
    key: ScanKey,
    n_hypotheses: int,
    n_detections: int,
    evidence: Evidence | None,
    scores: AttributeScores | None,
    associations: Associations,
) -> None:
    """Check all that the track manager is about to apply to its state.

    Raises
    ------
    Inconsistent
        If a key is not that of the open scan, a size or an index is wrong, a detection is assigned
        twice, the chosen pairs are not the assigned ones, marginals are no probabilities, the pair
        lists of scores and associations differ, or a belief is not finite.
    """
    for answer in (evidence, scores, associations):
        if answer is not None and answer.key != key:
            raise Inconsistent(f"key {tuple(answer.key)} is not the open scan's {tuple(key)}")
    _check_associations(associations, n_hypotheses, n_detections)
    if evidence is not None:
        _check_beliefs("evidence", evidence, n_detections)
    if scores is None:
        return
    if not (
        np.array_equal(scores.hypothesis, associations.hypothesis)
        and np.array_equal(scores.detection, associations.detection)
    ):
        raise Inconsistent("attribute scores: pair list differs from the associations'")
    _check_beliefs("attribute scores", scores, len(scores.hypothesis))
    updated = scores.updated_hypothesis
    if len(updated) and not (0 <= updated.min() and updated.max() < n_hypotheses):
        raise Inconsistent("attribute scores: updated hypothesis out of range")
    if evidence is not None and (scores.frame, scores.class_names) != (
        evidence.frame,
        evidence.class_names,
    ):
        raise Inconsistent("attribute scores: frame or classes differ from the evidence's")


def _check_associations(associations: Associations, n_hypotheses: int, n_detections: int) -> None:
    assigned = associations.assigned_detection
    if assigned.shape != (n_hypotheses,):
        raise Inconsistent("associations: one assigned detection per hypothesis expected")
    hypothesis, detection = associations.hypothesis, associations.detection
    pairs = (hypothesis, detection, associations.chosen, associations.joint_marginal)
    in_group = _check_groups(associations, n_hypotheses, n_detections)
    if len({part.shape for part in pairs}) > 1:
        raise Inconsistent("associations: arrays of the pairs differ in length")
    for name, rows, lowest, count in (
        ("assigned detection", assigned, -1, n_detections),
        ("hypothesis", hypothesis, 0, n_hypotheses),
        ("detection", detection, 0, n_detections),
    ):
        if len(rows) and not (lowest <= rows.min() and rows.max() < count):
            raise Inconsistent(f"associations: {name} out of range")
    taken = assigned[(assigned >= 0) & ~in_group].tolist()
    shared = associations.group_detection[associations.group_chosen]
    taken += shared[shared >= 0].tolist()  # once for both members
    if len(set(taken)) != len(taken):
        raise Inconsistent("associations: a detection is assigned twice")
    chosen = np.flatnonzero(associations.chosen)
    if len(chosen) + np.count_nonzero(shared >= 0) != len(taken) or not np.array_equal(
        assigned[hypothesis[chosen]], detection[chosen]
    ):
        raise Inconsistent("associations: the chosen pairs are not the assigned detections")
    marginal = associations.joint_marginal
    sums = np.bincount(hypothesis, marginal, minlength=n_hypotheses)
    for members in (associations.group_first, associations.group_second):
        shares = np.bincount(members, associations.group_marginal, minlength=n_hypotheses)
        sums = sums + shares
    if not ((marginal >= 0.0).all() and (sums <= 1.0 + MARGINAL_TOLERANCE).all()):
        raise Inconsistent("associations: the joint marginals of a hypothesis are no probabilities")


def _check_groups(associations: Associations, n_hypotheses: int, n_detections: int) -> BoolArray:
    """Check the events of unresolved targets; return who is in a group that was decided for."""
    first, second = associations.group_first, associations.group_second
    columns = associations.group_detection
    in_group = np.zeros(n_hypotheses, dtype=np.bool_)
    shapes = {part.shape for part in (first, second, columns, associations.group_chosen)}
    shapes |= {associations.group_marginal.shape, associations.group_unresolved.shape}
    if len(shapes | {associations.group_log_likelihood.shape}) > 1:
        raise Inconsistent("associations: arrays of the groups differ in length")
    if not len(first):
        return in_group
    for name, rows, lowest, count in (
        ("group member", first, 0, n_hypotheses),
        ("group member", second, 0, n_hypotheses),
        ("group detection", columns, -1, n_detections),
    ):
        if not (lowest <= rows.min() and rows.max() < count):
            raise Inconsistent(f"associations: {name} out of range")
    if (first == second).any():
        raise Inconsistent("associations: a hypothesis is in a group with itself")
    probability = associations.group_marginal
    share = associations.group_unresolved
    if not ((probability >= 0.0).all() and ((share >= 0.0) & (share <= 1.0)).all()):
        raise Inconsistent("associations: the marginals of the groups are no probabilities")
    if not (associations.group_log_likelihood < np.inf).all():
        raise Inconsistent("associations: the likelihoods of the groups are no numbers")
    chosen = np.flatnonzero(associations.group_chosen)
    members = np.concatenate([first[chosen], second[chosen]])
    if len(np.unique(members)) != len(members):
        raise Inconsistent("associations: a hypothesis is in two groups")
    in_group[members] = True
    if not np.array_equal(associations.assigned_detection[members], np.tile(columns[chosen], 2)):
        raise Inconsistent("associations: a group's detection is not assigned to its members")
    return in_group


def _check_beliefs(name: str, answer: Evidence | AttributeScores, rows: int) -> None:
    """Check sizes and values of masses and class probabilities, (rows, F) and (rows, C)."""
    sizes = (
        ("masses", answer.masses, len(answer.focal)),
        ("class_probability", answer.class_probability, len(answer.class_names)),
    )
    for part, values, columns in sizes:
        if values.shape != (rows, columns):
            raise Inconsistent(
                f"{name}: {part} has shape {values.shape}, expected is ({rows}, {columns})"
            )
        if not np.isfinite(values).all():
            raise Inconsistent(f"{name}: {part} is not finite")
    if isinstance(answer, Evidence):
        _check_evidence_rows(answer, rows)
        return
    _check_updated(name, answer)
    if answer.conflict.shape != (rows,):
        raise Inconsistent(
            f"{name}: conflict has shape {answer.conflict.shape}, expected ({rows},)"
        )


def _check_evidence_rows(evidence: Evidence, rows: int) -> None:
    """Check what only a history window takes over from the evidence."""
    likelihood, expected = evidence.log_class_likelihood, (rows, len(evidence.class_names))
    if likelihood.shape != expected or evidence.informative.shape != (rows,):
        raise Inconsistent(
            f"evidence: log_class_likelihood and informative have shapes {likelihood.shape} and "
            f"{evidence.informative.shape}, expected are {expected} and ({rows},)"
        )
    # Minus infinity is an answer: the class never gives such a detection.
    if not (likelihood < np.inf).all():
        raise Inconsistent("evidence: log_class_likelihood is not a number below infinity")


def _check_updated(name: str, scores: AttributeScores) -> None:
    """Check the histories that statements have changed, (U, E) and (U, C)."""
    count = len(scores.updated_hypothesis)
    for part, values, columns in (
        ("updated_masses", scores.updated_masses, len(scores.focal)),
        ("updated_class_probability", scores.updated_class_probability, len(scores.class_names)),
    ):
        if count and values.shape != (count, columns):
            raise Inconsistent(
                f"{name}: {part} has shape {values.shape}, expected is ({count}, {columns})"
            )
        if not np.isfinite(values).all():
            raise Inconsistent(f"{name}: {part} is not finite")
