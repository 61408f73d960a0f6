"""Attribute fusion: what each gated pair of a hypothesis and a detection makes of the attribute.

The attribute terms (:mod:`gda_tracker.attributes.terms`), each batched over all pairs:

``none``
    No attribute: nothing is scored, beliefs stay as they are.
``dsm_classic``
    Histories on the free DSm model, fused by the classic DSm rule; the distance of history and
    candidate history is Euclidean over D^Theta (Tchamova et al. 2004, 14.3.2.1 and 14.4.2).
``dempster``
    Histories on Shafer's model, fused by Dempster's rule, the same distance; in total conflict the
    history stays as it is.
``dsm_hybrid``, ``yager``, ``dubois_prade``, ``pcr5``, ``pcr6``
    Histories on Shafer's model, fused by the rule of that name, the same distance. For two sources
    ``pcr6`` is ``pcr5``; on Shafer's model ``dsm_hybrid`` is ``dubois_prade``.
``bayes``
    Class probabilities, predicted and updated by Bayes' rule (Mahler 2011, (93) and (94)); no
    masses, no distance.

Under the terms on Shafer's model a history that carries masses of intersections, from another term,
is projected first. The log likelihood of a pair is log sum_c P(c | history) f(attribute | c)
(Mahler 2011, (88)); under the terms with masses P(c | history) is the pignistic probability of the
history. A detection whose attribute is unknown leaves the history as it is and scores nothing.
Statements about a track change its history before the pairs are scored
(:mod:`gda_tracker.attributes.statement_histories`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from gda_tracker.attributes.class_terms import (
    CLASS_COUNTS,
    class_prior,
    fuse_classes,
    transition_matrix,
)
from gda_tracker.attributes.mass_terms import fuse_masses
from gda_tracker.attributes.pair_beliefs import NO_FOCAL, PairBeliefs, Pairs, without_attribute
from gda_tracker.attributes.statement_histories import Histories, hear_statements
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.attributes.window_histories import (
    Histories as WindowHistories,
)
from gda_tracker.attributes.window_histories import (
    replace_rows,
    window_histories,
    windows_of,
)
from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.parameters import ParameterError, parameter, specifications
from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import HISTORY_POLICIES, Predictions
from gda_tracker.vocabulary.statements import TRACK, Statement

_NO_ROWS: IntArray = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class AttributeFusionParameters:
    """How classes change; term and history policy travel with the predictions."""

    class_transition: list[float] = parameter(
        [],
        "bayes: probabilities that a target changes its class from one detection with a known "
        "attribute to the next, row by row: to class 1 from class 1, 2, ..., to class 2 from class "
        "1, 2, ...; the numbers from one class have the sum 1; empty: classes never change",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Refuse values out of range and transitions that are no probabilities."""
        for name, specification in specifications(type(self)).items():
            specification.check(getattr(self, name))
        try:
            transition_matrix(self.class_transition)
        except ValueError as error:
            sizes = ", ".join(str(count * count) for count in CLASS_COUNTS)
            raise ParameterError(
                f"parameter class_transition = {self.class_transition}: {error}; allowed are an "
                f"empty list and the rows of a square matrix ({sizes} numbers), one row per class, "
                "each column with the sum 1"
            ) from None


_TERMS: dict[str, Callable[[Pairs], PairBeliefs]] = {
    "none": without_attribute,
    **{term: partial(fuse_masses, term) for term in DISTANCE_TERMS},
    "bayes": fuse_classes,
}


def fuse_pairs(
    term: str,
    frame: tuple[str, ...],
    history_focal: MaskArray,
    history_masses: FloatArray,
    history_class_probability: FloatArray,
    evidence: Evidence,
    detection: Int32Array,
    forgetting_factor: float = 1.0,
    class_transition: FloatArray | None = None,
) -> PairBeliefs:
    """Fuse the histories of P pairs with the evidence of their detections.

    Parameters
    ----------
    term
        Attribute term, one of ``ATTRIBUTE_TERMS``.
    frame
        Frame of the histories. If it is not that of the evidence, the histories count as vacuous
        and their class probabilities as the prior.
    history_focal
        (E0,) Venn bitmasks of the histories' columns, none for vacuous histories.
    history_masses
        (P, E0) masses of the histories.
    history_class_probability
        (P, C) class probabilities of the histories, (P, 0) for the prior.
    evidence
        Evidence of the scan's detections.
    detection
        (P,) row of each pair's detection in the evidence.
    forgetting_factor
        Share of the history kept; the rest becomes ignorance (``bayes``: is spread over the
        possible classes).
    class_transition
        (C, C) p(c | c') in row c and column c', for the term ``bayes``; ``None``: no change.

    Returns
    -------
    PairBeliefs
        Candidate histories. All terms write their columns as elements of the free model (the
        element A of Shafer's model as A with its intersections), so that one mask is one element
        under every term and a change of term needs no translation.

    Raises
    ------
    ValueError
        For an unknown term, a mask that is not an element of the hyper-power set, or a class
        transition (under ``bayes``) of another number of classes than the evidence's.
    """
    if term not in _TERMS:
        raise ValueError(
            f"attribute_term = {term!r}: allowed is one of {', '.join(ATTRIBUTE_TERMS)}"
        )
    n, n_classes = len(detection), len(evidence.class_names)
    strange = frame != evidence.frame
    if strange or not len(history_focal):
        history_focal = np.array([total_ignorance(len(evidence.frame))], dtype=np.uint32)
        history_masses = np.ones((n, 1))
    if strange or history_class_probability.shape[1] != n_classes:
        prior = class_prior(evidence) if n else empty_floats(n_classes)
        history_class_probability = np.tile(prior, (n, 1))
    return _TERMS[term](
        Pairs(
            history_focal,
            history_masses,
            history_class_probability,
            evidence,
            detection,
            forgetting_factor,
            class_transition,
        )
    )


class AttributeFusion:
    """The stage: predictions, evidence and the gated pairs in, attribute scores out.

    Parameters
    ----------
    parameters
        The stage's parameters.

    Attributes
    ----------
    class_transition
        (C, C) matrix of the parameter of that name, ``None`` if it is empty.
    """

    def __init__(self, parameters: AttributeFusionParameters) -> None:
        self.parameters = parameters
        self.class_transition = transition_matrix(parameters.class_transition)

    def __call__(
        self,
        predictions: Predictions,
        evidence: Evidence,
        hypothesis: Int32Array,
        detection: Int32Array,
        statements: tuple[Statement, ...] = (),
    ) -> AttributeScores:
        """Score the pairs (``hypothesis[p]``, ``detection[p]``) by the term of the predictions.

        ``statements`` are those of the scan.

        Raises
        ------
        ValueError
            If the keys of predictions and evidence differ, or as in :func:`fuse_pairs`.
        """
        if predictions.key != evidence.key:
            raise ValueError(f"evidence of {evidence.key} for predictions of {predictions.key}")
        settings = predictions.settings
        term = settings.attribute_term
        if settings.history_policy not in HISTORY_POLICIES:
            raise ValueError(
                f"history_policy = {settings.history_policy!r}: allowed is one of "
                f"{', '.join(HISTORY_POLICIES)}"
            )
        # Classes are tied to the elements of the frame: other classes make it another frame. Such
        # histories, and those of hypotheses that have none yet, need not even have rows.
        known = (
            predictions.frame == evidence.frame and predictions.class_names == evidence.class_names
        )
        believed = known and len(predictions.focal) > 0
        none = empty_floats(len(predictions), 0)
        histories = Histories(
            predictions.focal if believed else NO_FOCAL,
            predictions.masses if believed else none,
            predictions.class_probability if known else none,
            _NO_ROWS,
        )
        if term != "none" and any(each.about == TRACK for each in statements):
            histories = self._hear(statements, predictions, evidence, histories)
        of_pairs = (
            histories.focal,
            histories.masses[hypothesis],
            histories.class_probability[hypothesis],
        )
        if settings.history_policy == "window" and known and len(hypothesis):
            # A window holds detections alone: a statement counts with the belief that it changes.
            heard = np.isin(hypothesis, histories.updated)
            of_pairs = self._of_windows(
                predictions, evidence, hypothesis, detection, of_pairs, heard
            )
        pairs = fuse_pairs(
            term,
            evidence.frame,
            *of_pairs,
            evidence,
            detection,
            settings.forgetting_factor if settings.history_policy == "forgetting" else 1.0,
            self.class_transition,
        )
        if term == "none":
            clutter = np.zeros(len(evidence.masses))
        else:
            clutter = evidence.log_class_likelihood[:, 0].copy()
        return AttributeScores(
            key=predictions.key,
            attribute_term=term,
            has_distance=term in DISTANCE_TERMS,
            hypothesis=np.ascontiguousarray(hypothesis, dtype=np.int32),
            detection=np.ascontiguousarray(detection, dtype=np.int32),
            distance=pairs.distance,
            log_likelihood=pairs.log_likelihood,
            conflict=pairs.conflict,
            informative=pairs.informative,
            clutter_log_likelihood=clutter,
            frame=evidence.frame,
            focal=pairs.focal,
            masses=pairs.masses,
            class_names=evidence.class_names,
            class_probability=pairs.class_probability,
            updated_hypothesis=histories.updated.astype(np.int32),
            updated_masses=_over(pairs.focal, histories),
            updated_class_probability=histories.class_probability[histories.updated].reshape(
                -1, pairs.class_probability.shape[1]
            ),
        )

    def _of_windows(
        self,
        predictions: Predictions,
        evidence: Evidence,
        hypothesis: Int32Array,
        detection: Int32Array,
        beliefs: WindowHistories,
        heard: BoolArray,
    ) -> WindowHistories:
        """Histories of the pairs from the windows of their hypotheses.

        A pair without a known attribute would not move the window: it keeps the belief itself, and
        so do the pairs of which something was ``heard`` (P,).
        """
        # Each hypothesis once, however many pairs it has.
        rows, of_pair = np.unique(hypothesis, return_inverse=True)
        focal, masses, classes = window_histories(
            predictions.settings.attribute_term,
            evidence.frame,
            windows_of(predictions, rows),
            class_prior(evidence),
            self.class_transition,
        )
        histories = focal, masses[of_pair], classes[of_pair]
        kept = heard | ~evidence.informative[detection]
        if not kept.any():
            return histories
        return replace_rows(histories, beliefs, kept, total_ignorance(len(evidence.frame)))

    def _hear(
        self,
        statements: tuple[Statement, ...],
        predictions: Predictions,
        evidence: Evidence,
        histories: Histories,
    ) -> Histories:
        """Histories after the statements about tracks."""
        classes = len(evidence.class_names)
        known = len(evidence.masses) > 0
        prior = class_prior(evidence) if known else np.full(classes, 1.0 / classes)
        rows = np.arange(len(predictions), dtype=np.int32)

        def fuse(
            focal: MaskArray, masses: FloatArray, probability: FloatArray, said: Evidence
        ) -> PairBeliefs:
            term = predictions.settings.attribute_term
            return fuse_pairs(term, evidence.frame, focal, masses, probability, said, rows)

        return hear_statements(statements, predictions, evidence, prior, histories, fuse)


def _over(focal: MaskArray, histories: Histories) -> FloatArray:
    """Masses of the updated histories over the columns of the candidates, which hold all theirs."""
    masses = np.zeros((len(histories.updated), len(focal)))
    if len(focal) and len(histories.updated):
        place = {int(mask): column for column, mask in enumerate(focal)}
        columns = [place[int(mask)] for mask in histories.focal]
        masses[:, columns] = histories.masses[histories.updated]
    return masses
