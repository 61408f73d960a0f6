"""Attribute terms whose histories are masses of belief (Tchamova et al. 2004, 14.3 and 14.4.2).

A history is fused with a measurement, two sources at a time; the outcome is the history of the next
scan. The rules that move conflict (hybrid DSm, Yager, Dubois-Prade, PCR) are not associative:
such a history depends on the order of the detections, and is not what the rule would make of all
detections jointly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from gda_tracker.attributes.bayes import log_class_mixture
from gda_tracker.attributes.pair_beliefs import PairBeliefs, Pairs
from gda_tracker.attributes.terms import RULE_OF_TERM
from gda_tracker.evidence.batches import combine_rows, discount_columns, history_table
from gda_tracker.evidence.decisions import pignistic_matrix
from gda_tracker.evidence.frames import free_model, shafer_model
from gda_tracker.evidence.rules import conjunction_table, conjunctive, dempster, discount
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, MaskArray

Fused = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class _Fusion:
    """A term on given columns.

    Attributes
    ----------
    focal
        (E,) columns of the candidates, elements of the free model; total ignorance among them.
    embedding
        (E0, E) zeros and ones from the columns of the histories, ``None`` if they are the same.
        On Shafer's model it moves the masses of dead elements, of histories of another term.
    to_classes
        (E, k) pignistic probabilities of the elements of the frame on Shafer's model.
    discount
        (P, E) histories and a factor to histories of which the rest has gone to total ignorance.
    fuse
        (P, E) histories and (P, F) measurements to (P, E) candidates and (P,) the mass of the
        products that are empty on Shafer's model.
    """

    focal: MaskArray
    embedding: FloatArray | None
    to_classes: FloatArray
    discount: Callable[[FloatArray, float], FloatArray]
    fuse: Callable[[FloatArray, FloatArray], Fused]


def fuse_masses(term: str, pairs: Pairs) -> PairBeliefs:
    """Fuse histories and measurements by the rule of a term.

    The distance of a pair is that of history and candidate, Euclidean over the focal elements. Its
    log likelihood is log sum_c P(c) f(attribute | c), P(c) being the pignistic probability of the
    history on Shafer's model, to which it is projected for that purpose alone.
    """
    evidence, detection = pairs.evidence, pairs.detection
    term_on = _fusion(term, evidence.frame, pairs.history_focal.tobytes(), evidence.focal.tobytes())
    embedding = term_on.embedding
    untouched = history = (
        pairs.history_masses if embedding is None else pairs.history_masses @ embedding
    )
    if pairs.forgetting_factor < 1.0:
        history = term_on.discount(history, pairs.forgetting_factor)
    masses, conflict = term_on.fuse(history, evidence.masses[detection])
    informative = evidence.informative[detection]
    known = bool(informative.all())
    if not known:
        # By the rules alone a vacuous measurement is neutral; the discount and rounding are not.
        history = np.where(informative[:, None], history, untouched)
        masses = np.where(informative[:, None], masses, history)
        conflict = np.where(informative, conflict, 0.0)
    difference = masses - history
    log_likelihood = log_class_mixture(
        history @ term_on.to_classes, evidence.log_class_likelihood[detection]
    )
    if not known:
        log_likelihood = np.where(informative, log_likelihood, 0.0)
    return PairBeliefs(
        focal=term_on.focal,
        masses=np.ascontiguousarray(masses),
        class_probability=masses @ term_on.to_classes,
        distance=np.sqrt(np.add.reduce(difference * difference, axis=1)),
        log_likelihood=log_likelihood,
        conflict=np.ascontiguousarray(conflict),
        informative=informative,
    )


def fuse_rows(
    term: str,
    frame: tuple[str, ...],
    history_focal: MaskArray,
    history: FloatArray,
    measurement_focal: MaskArray,
    measurement: FloatArray,
    chosen: BoolArray,
) -> tuple[MaskArray, FloatArray]:
    """Fuse history with measurement, row with row, by the rule of a term.

    Parameters
    ----------
    term
        A term with masses.
    frame
        Frame of the masses.
    history_focal, history
        (E0,) columns and (R, E0) masses.
    measurement_focal, measurement
        (F,) columns and (R, F) masses.
    chosen
        (R,) rows that are fused; the others stay as they are.

    Returns
    -------
    focal, masses
        (E,) columns and (R, E) masses.
    """
    term_on = _fusion(term, frame, history_focal.tobytes(), measurement_focal.tobytes())
    masses = history if term_on.embedding is None else history @ term_on.embedding
    if chosen.all():
        return term_on.focal, term_on.fuse(masses, measurement)[0]
    masses = masses.copy()
    masses[chosen] = term_on.fuse(masses[chosen], measurement[chosen])[0]
    return term_on.focal, masses


@lru_cache(maxsize=128)
def _fusion(
    term: str, frame: tuple[str, ...], history_focal: bytes, measurement_focal: bytes
) -> _Fusion:
    history = np.frombuffer(history_focal, dtype=np.uint32)
    measurement = np.frombuffer(measurement_focal, dtype=np.uint32)
    make = _conjunctive_fusion if term in ("dsm_classic", "dempster") else _conflict_fusion
    return make(term, frame, history, measurement)


def _conjunctive_fusion(
    term: str, frame: tuple[str, ...], history: MaskArray, measurement: MaskArray
) -> _Fusion:
    """Terms that are conjunctive but for a factor: for few pairs twice as quick as any rule."""
    on_free = term == "dsm_classic"
    model = free_model(frame) if on_free else shafer_model(frame)
    table = conjunction_table(model, history, measurement)

    def classic(history: FloatArray, measurement: FloatArray) -> Fused:
        return conjunctive(table, history, measurement)

    def normalised(history: FloatArray, measurement: FloatArray) -> Fused:
        return dempster(table, history, measurement, keep_history=True)

    return _Fusion(
        focal=table.focal,
        embedding=table.embedding,
        to_classes=pignistic_matrix(shafer_model(frame), table.focal),
        discount=partial(discount, table),
        fuse=classic if on_free else normalised,
    )


def _conflict_fusion(
    term: str, frame: tuple[str, ...], history: MaskArray, measurement: MaskArray
) -> _Fusion:
    """Terms that give the conflict to some element, on Shafer's model."""
    model = shafer_model(frame)
    table, embedding = history_table(RULE_OF_TERM[term], model, history, measurement)

    def by_rule(history: FloatArray, measurement: FloatArray) -> Fused:
        return combine_rows(table, (history, measurement))

    return _Fusion(
        focal=table.focal,
        embedding=embedding,
        to_classes=pignistic_matrix(model, table.focal),
        discount=partial(discount_columns, table),
        fuse=by_rule,
    )
