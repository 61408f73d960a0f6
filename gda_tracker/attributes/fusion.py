"""Attribute fusion: what each gated pair of a hypothesis and a detection makes of the attribute.

Four attribute terms (:mod:`gda_tracker.attributes.terms`), each batched over all pairs:

``none``
    No attribute: nothing is scored, beliefs stay as they are.
``dsm_classic``
    Histories on the free DSm model, fused by the classic DSm rule; the distance of history and
    candidate history is Euclidean over D^Theta (Tchamova et al. 2004, 14.3.2.1 and 14.4.2).
``dempster``
    Histories on Shafer's model, fused by Dempster's rule, the same distance; in total conflict the
    history stays as it is. A history that carries masses of intersections is projected first.
``bayes``
    Class probabilities, updated by Bayes' rule (Mahler 2011, (94)); no masses, no distance.

The log likelihood of a pair is log sum_c P(c | history) f(attribute | c) (Mahler 2011, (88)); under
the terms with masses P(c | history) is the pignistic probability of the history on Shafer's model,
to which it is projected for that purpose alone. A detection whose attribute is unknown leaves the
history as it is and scores nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.attributes.bayes import class_update, forget, log_class_mixture
from gda_tracker.attributes.decisions import pignistic_matrix
from gda_tracker.attributes.frames import Model, free_model, shafer_model, total_ignorance
from gda_tracker.attributes.rules import (
    ConjunctionTable,
    conjunction_table,
    conjunctive,
    dempster,
    discount,
)
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.parameters import parameter
from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    MaskArray,
    empty_floats,
)
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Predictions

_NO_FOCAL: MaskArray = np.zeros(0, dtype=np.uint32)
_NO_FOCAL.flags.writeable = False


@dataclass(frozen=True)
class AttributeFusionParameters:
    """How histories are carried on; which term is used travels with the predictions."""

    forgetting_factor: float = parameter(
        1.0,
        "share of the history kept at each detection with a known attribute, the rest becomes "
        "ignorance (bayes: is spread over the possible classes); 1 forgets nothing, but a history "
        "of dsm_classic then drifts into the total intersection and its distances shrink",
        minimum=0.0,
        maximum=1.0,
    )


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


@dataclass(slots=True)
class _Pairs:
    """Histories of P pairs and the detections that they meet, as the terms take them."""

    history_focal: MaskArray
    history_masses: FloatArray
    history_class_probability: FloatArray
    evidence: Evidence
    detection: Int32Array
    forgetting_factor: float


def _no_attribute(pairs: _Pairs) -> PairBeliefs:
    n = len(pairs.detection)
    return PairBeliefs(
        focal=_NO_FOCAL,
        masses=empty_floats(n, 0),
        class_probability=pairs.history_class_probability,
        distance=np.zeros(n),
        log_likelihood=np.zeros(n),
        conflict=np.zeros(n),
        informative=np.zeros(n, dtype=np.bool_),
    )


def _dsm_classic(pairs: _Pairs) -> PairBeliefs:
    return _fuse_masses(pairs, *_tables(pairs, free_model), conjunctive)


def _dempster(pairs: _Pairs) -> PairBeliefs:
    return _fuse_masses(pairs, *_tables(pairs, shafer_model), _dempster_or_history)


def _dempster_or_history(
    table: ConjunctionTable, history: FloatArray, measurement: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return dempster(table, history, measurement, keep_history=True)


def _tables(
    pairs: _Pairs, make_model: Callable[[Sequence[str]], Model]
) -> tuple[ConjunctionTable, FloatArray]:
    """Table of the columns on a model, and the matrix from its columns to class probabilities."""
    evidence = pairs.evidence
    return _cached_tables(
        make_model, evidence.frame, pairs.history_focal.tobytes(), evidence.focal.tobytes()
    )


@lru_cache(maxsize=128)
def _cached_tables(
    make_model: Callable[[Sequence[str]], Model],
    frame: tuple[str, ...],
    history_focal: bytes,
    measurement_focal: bytes,
) -> tuple[ConjunctionTable, FloatArray]:
    table = conjunction_table(
        make_model(frame),
        np.frombuffer(history_focal, dtype=np.uint32),
        np.frombuffer(measurement_focal, dtype=np.uint32),
    )
    return table, pignistic_matrix(shafer_model(frame), table.focal)


def _fuse_masses(
    pairs: _Pairs,
    table: ConjunctionTable,
    to_classes: FloatArray,
    rule: Callable[[ConjunctionTable, FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> PairBeliefs:
    """Fuse masses by a rule; the part that all terms with masses share."""
    evidence, detection = pairs.evidence, pairs.detection
    untouched = history = table.embed(pairs.history_masses)
    if pairs.forgetting_factor < 1.0:
        history = discount(table, history, pairs.forgetting_factor)
    masses, conflict = rule(table, history, evidence.masses[detection])
    informative = evidence.informative[detection]
    known = bool(informative.all())
    if not known:
        # By the rules alone a vacuous measurement is neutral; the discount and rounding are not.
        history = np.where(informative[:, None], history, untouched)
        masses = np.where(informative[:, None], masses, history)
        conflict = np.where(informative, conflict, 0.0)
    difference = masses - history
    log_likelihood = log_class_mixture(
        history @ to_classes, evidence.log_class_likelihood[detection]
    )
    if not known:
        log_likelihood = np.where(informative, log_likelihood, 0.0)
    return PairBeliefs(
        focal=table.focal,
        masses=np.ascontiguousarray(masses),
        class_probability=masses @ to_classes,
        distance=np.sqrt(np.add.reduce(difference * difference, axis=1)),
        log_likelihood=log_likelihood,
        conflict=np.ascontiguousarray(conflict),
        informative=informative,
    )


def _bayes(pairs: _Pairs) -> PairBeliefs:
    evidence, detection = pairs.evidence, pairs.detection
    untouched = history = pairs.history_class_probability
    if pairs.forgetting_factor < 1.0:
        history = forget(history, pairs.forgetting_factor)
    posterior, log_likelihood = class_update(history, evidence.log_class_likelihood[detection])
    # Class probabilities are masses on the elements: agreement is the plausibility of the class.
    plausible = evidence.masses @ _compatibility(len(evidence.frame), evidence.focal.tobytes())
    conflict = np.maximum(1.0 - np.add.reduce(history * plausible[detection], axis=1), 0.0)
    informative = evidence.informative[detection]
    if not informative.all():
        posterior = np.where(informative[:, None], posterior, untouched)
        log_likelihood = np.where(informative, log_likelihood, 0.0)
        conflict = np.where(informative, conflict, 0.0)
    n = len(detection)
    return PairBeliefs(
        focal=_NO_FOCAL,
        masses=empty_floats(n, 0),
        class_probability=posterior,
        distance=np.zeros(n),
        log_likelihood=log_likelihood,
        conflict=conflict,
        informative=informative,
    )


@lru_cache(maxsize=16)
def _compatibility(size: int, focal: bytes) -> FloatArray:
    """(F, k) one where a focal element and an element of the frame meet on Shafer's model."""
    masks = np.frombuffer(focal, dtype=np.uint32)
    alone = np.array([1 << ((1 << element) - 1) for element in range(size)], dtype=np.uint32)
    return ((masks[:, None] & alone[None, :]) != 0).astype(np.float64)


_TERMS: dict[str, Callable[[_Pairs], PairBeliefs]] = {
    "none": _no_attribute,
    "dsm_classic": _dsm_classic,
    "dempster": _dempster,
    "bayes": _bayes,
}


def class_prior(evidence: Evidence) -> FloatArray:
    """Class prior (C,) behind the evidence of a scan with at least one detection.

    A detection's class probabilities are proportional to prior times likelihood; the likelihood is
    taken out again at the detection that says least, where nothing is lost to rounding.
    """
    likelihood = evidence.log_class_likelihood
    row = int(np.argmin(np.ptp(likelihood, axis=1)))
    with np.errstate(divide="ignore"):
        log_prior = np.log(evidence.class_probability[row]) - likelihood[row]
    prior = np.exp(log_prior - log_prior.max())
    return np.asarray(prior / prior.sum())


def fuse_pairs(
    term: str,
    frame: tuple[str, ...],
    history_focal: MaskArray,
    history_masses: FloatArray,
    history_class_probability: FloatArray,
    evidence: Evidence,
    detection: Int32Array,
    forgetting_factor: float = 1.0,
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
        Share of the history kept, see :class:`AttributeFusionParameters`.

    Returns
    -------
    PairBeliefs
        Candidate histories. ``dempster`` too writes its columns as elements of the free model (the
        element A of Shafer's model as A with its intersections), so that one mask is one element
        under every term and a change of term needs no translation.

    Raises
    ------
    ValueError
        For an unknown term or a mask that is not an element of the hyper-power set.
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
        _Pairs(
            history_focal,
            history_masses,
            history_class_probability,
            evidence,
            detection,
            forgetting_factor,
        )
    )


class AttributeFusion:
    """The stage: predictions, evidence and the gated pairs in, attribute scores out.

    Parameters
    ----------
    parameters
        The stage's parameters.
    """

    def __init__(self, parameters: AttributeFusionParameters) -> None:
        self.parameters = parameters

    def __call__(
        self,
        predictions: Predictions,
        evidence: Evidence,
        hypothesis: Int32Array,
        detection: Int32Array,
    ) -> AttributeScores:
        """Score the pairs (``hypothesis[p]``, ``detection[p]``) by the term of the predictions.

        Raises
        ------
        ValueError
            If the keys of predictions and evidence differ, or for an unknown term.
        """
        if predictions.key != evidence.key:
            raise ValueError(f"evidence of {evidence.key} for predictions of {predictions.key}")
        term = predictions.settings.attribute_term
        # Classes are tied to the elements of the frame: other classes make it another frame. Such
        # histories, and those of hypotheses that have none yet, need not even have rows.
        known = (
            predictions.frame == evidence.frame and predictions.class_names == evidence.class_names
        )
        believed = known and len(predictions.focal) > 0
        none = empty_floats(len(hypothesis), 0)
        pairs = fuse_pairs(
            term,
            evidence.frame,
            predictions.focal if believed else _NO_FOCAL,
            predictions.masses[hypothesis] if believed else none,
            predictions.class_probability[hypothesis] if known else none,
            evidence,
            detection,
            self.parameters.forgetting_factor,
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
        )
