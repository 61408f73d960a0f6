"""The association stage: which detection belongs to which hypothesis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.association.assignment import choose_by_probability, choose_most_probable
from gda_tracker.association.best_permutations import without_permutations
from gda_tracker.association.choices import COALESCENCE_REMEDIES, DECISIONS, ENGINES, JPDA
from gda_tracker.association.cluster_marginals import (
    EngineLimits,
    cluster_marginals,
)
from gda_tracker.association.clustering import Clusters, find_clusters, gated_detections
from gda_tracker.association.errors import AssociationInputError, PairListMismatch
from gda_tracker.association.generalised import (
    attribute_probability,
    attribute_weights,
    joint_weights,
    kinematic_weights,
)
from gda_tracker.association.group_decision import decide_groups
from gda_tracker.association.group_events import group_events
from gda_tracker.association.hypothesis_scores import score_hypotheses
from gda_tracker.association.joint import MAX_ELEMENTS
from gda_tracker.association.statements import statement_factors
from gda_tracker.association.weightings import JointWeights
from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.parameters import parameter
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan

PADDED_SIZE = 4
"""Small clusters up to this smaller side are padded to one shape where that saves calls."""


@dataclass(frozen=True)
class AssociationParameters:
    """Parameters of the association stage. What may change per scan travels in ``Predictions``."""

    max_exact_size: int = parameter(
        14,
        "bound on the cost of exact joint probabilities: clusters whose smaller side (tracks or "
        "detections) is larger are approximated by loopy belief propagation, unless their gates "
        "are so sparse that the exact answer takes no more operations than for a dense cluster of "
        "this size; each step up doubles the time",
        minimum=1,
        maximum=MAX_ELEMENTS,
    )
    coalescence_remedy: str = parameter(
        "none",
        "against close tracks drawn together by the decision jpda: jpda_star counts only the most "
        "probable of the joint hypotheses with the same tracks and detections; none is plain JPDA",
        choices=COALESCENCE_REMEDIES,
    )
    belief_propagation_iterations: int = parameter(
        200,
        "rounds of messages before loopy belief propagation gives up",
        minimum=1,
        maximum=100_000,
        advanced=True,
    )
    belief_propagation_tolerance: float = parameter(
        1e-6,
        "loopy belief propagation has converged when no probability moves by more in one round",
        minimum=0.0,
        maximum=0.1,
        minimum_excluded=True,
        advanced=True,
    )


@dataclass(frozen=True, slots=True)
class Groundwork:
    """What association knows of a scan before the attributes have spoken.

    ``gated`` (D,) are the detections inside any gate; ``clusters`` count only those.
    """

    gated: IntArray
    clusters: Clusters
    kinematic: JointWeights


class Associator:
    """Association of one scan; it keeps nothing between scans."""

    def __init__(self, parameters: AssociationParameters) -> None:
        self._limits = EngineLimits(
            parameters.max_exact_size,
            parameters.belief_propagation_iterations,
            parameters.belief_propagation_tolerance,
        )
        self._prunes_permutations = parameters.coalescence_remedy == "jpda_star"

    def lay_groundwork(self, scan: Scan, predictions: Predictions, pairs: GatedPairs) -> Groundwork:
        """Do the part of the work that needs no attribute scores."""
        gated, place = gated_detections(pairs.detection, len(scan))
        clusters = find_clusters(
            pairs.hypothesis,
            place,
            len(predictions),
            len(gated),
            min(PADDED_SIZE, self._limits.max_exact_size),
        )
        kinematic = kinematic_weights(
            pairs.hypothesis,
            pairs.log_likelihood,
            predictions.detection_probability,
            predictions.settings.clutter_density,
            len(gated),
        )
        return Groundwork(gated, clusters, kinematic)

    def __call__(
        self,
        scan: Scan,
        predictions: Predictions,
        scores: AttributeScores | None,
        pairs: GatedPairs,
        groundwork: Groundwork | None = None,
    ) -> Associations:
        """Associate the detections of a scan with the predicted hypotheses.

        Decision ``gda``: smallest sum of 1 - P_k P_a. With a term that has a distance, P_k is of
        the kinematics alone; with one that has a likelihood only, P_k is of the joint likelihood
        and P_a = 1. Decision ``map``: the most probable joint hypothesis under the joint
        likelihood. Decision ``jpda``: the same is chosen, and ``joint_marginal`` follows the
        coalescence remedy. Decision ``mht``: nothing is chosen, each hypothesis is scored alone
        (:mod:`gda_tracker.association.hypothesis_scores`). Without scores kinematics alone decide,
        the result is marked degraded and its attribute term is ``none``. (Tchamova et al. 2004,
        14.4) Where two targets may not be resolved the joint hypotheses know of groups
        (:mod:`gda_tracker.association.group_joint`). Statements on where a track is weigh with the
        kinematics.

        Parameters
        ----------
        scan : Scan
        predictions : Predictions
            With the settings that hold for this scan.
        scores : AttributeScores or None
            For exactly the pairs of ``pairs``; ``None`` if the attribute was given up.
        pairs : GatedPairs
            From :func:`gda_tracker.kinematics.gating.gate`.
        groundwork : Groundwork, optional
            From :meth:`lay_groundwork` with the same scan, predictions and pairs.

        Raises
        ------
        PairListMismatch
            If the scores are for other pairs.
        AssociationInputError
            For scores of another term or of a wrong size, a likelihood that is NaN or infinite, a
            negative distance, or an unknown decision.
        """
        settings = predictions.settings
        if settings.decision not in DECISIONS:
            raise AssociationInputError(
                f"decision = {settings.decision!r}: allowed is one of {', '.join(DECISIONS)}"
            )
        n_hypotheses = len(predictions)
        if scores is not None:
            _check_scores(scores, pairs, settings.attribute_term, len(scan))

        factors = None
        if scan.statements:
            factors = statement_factors(
                scan, predictions, scores, pairs.hypothesis, pairs.detection
            )
        groups = group_events(scan, predictions)
        if settings.decision == "mht":
            scored = score_hypotheses(scan, predictions, scores, pairs, factors)
            if np.isnan(scored.joint_marginal).any():
                _name_culprit(predictions, scores, pairs)
            return scored if groups is None else replace(scored, **groups.fields())
        known = groundwork or self.lay_groundwork(scan, predictions, pairs)
        gated, clusters, kinematic = known.gated, known.clusters, known.kinematic
        if factors is not None:
            kinematic = factors.of(kinematic)
        joint = kinematic
        if scores is not None and (
            scores.log_likelihood.any() or scores.clutter_log_likelihood.any()
        ):
            joint = joint_weights(
                kinematic, scores.log_likelihood, scores.clutter_log_likelihood[gated]
            )
        by_distance = settings.decision == "gda" and scores is not None and scores.has_distance
        by_likelihood = (
            settings.decision == "gda"
            and settings.attribute_term != "none"
            and scores is not None
            and not scores.has_distance
        )

        weightings = [joint] if by_likelihood or joint is kinematic else [kinematic, joint]
        likelihoods = list(weightings)
        if by_distance:
            assert scores is not None
            weightings.append(
                attribute_weights(
                    clusters,
                    scores.distance,
                    scores.informative,
                    settings.missed_track_hypotheses,
                    n_hypotheses,
                    len(gated),
                )
            )
        try:
            found = cluster_marginals(clusters, weightings, self._limits)
        except AssociationInputError:
            _name_culprit(predictions, scores, pairs)
            raise
        p_kinematic = found.marginals[0]
        joint_marginal = found.marginals[0 if weightings[0] is joint else 1]
        engine = found.engine
        if settings.decision == JPDA and self._prunes_permutations:
            joint_marginal, engine = without_permutations(clusters, joint, joint_marginal, engine)
        shared = None
        if groups is not None:
            said = None if factors is None else factors.log_idle
            shared = decide_groups(
                groups, scan, predictions, scores, pairs, likelihoods, said, self._limits
            )
            p_kinematic = shared.marginals(p_kinematic, 0)
            joint_marginal = shared.marginals(joint_marginal, -1)
        if by_distance:
            assert scores is not None
            p_attribute = attribute_probability(clusters, found.marginals[-1], scores.informative)
            p_generalised = p_kinematic * p_attribute
        else:
            p_attribute = np.ones(len(pairs))
            p_generalised = p_kinematic

        if settings.decision == "gda":
            taken = None if shared is None else shared.taken
            chosen = _decide_gda(clusters, p_generalised, taken)
        else:
            chosen = _decide_map(clusters, joint)
            if shared is not None:
                chosen[shared.answer.rows] = shared.answer.chosen
        assigned = np.full(n_hypotheses, -1, dtype=np.int32)
        assigned[pairs.hypothesis[chosen]] = pairs.detection[chosen]
        if shared is not None:
            shared.assign(assigned)
        return Associations(
            key=scan.key,
            decision=settings.decision,
            attribute_term="none" if scores is None else settings.attribute_term,
            degraded=scores is None,
            hypothesis=pairs.hypothesis,
            detection=pairs.detection,
            mahalanobis_squared=pairs.mahalanobis_squared,
            kinematic_log_likelihood=pairs.log_likelihood,
            attribute_log_likelihood=(
                np.zeros(len(pairs)) if scores is None else scores.log_likelihood
            ),
            p_kinematic=p_kinematic,
            p_attribute=p_attribute,
            p_generalised=p_generalised,
            joint_marginal=joint_marginal,
            chosen=chosen,
            cluster=clusters.pair_cluster,
            assigned_detection=assigned,
            cluster_engine=engine,
            cluster_converged=found.converged,
            engine_names=ENGINES,
            **({} if shared is None else shared.fields),
        )


def _decide_gda(
    clusters: Clusters, p_generalised: FloatArray, taken: BoolArray | None = None
) -> BoolArray:
    """Pairs (P,) chosen by the assignment matrix of 1 - P_gen; not those ``taken`` by groups."""
    chosen = np.zeros(len(p_generalised), dtype=np.bool_)
    for group in clusters.groups:
        outside = -1.0 - group.shape[2]
        if taken is not None:
            p_generalised = np.where(taken, outside, p_generalised)
        picked = choose_by_probability(group.dense(p_generalised, outside), group.sizes)
        chosen[group.pairs] = picked[group.place]
    return chosen


def _decide_map(clusters: Clusters, joint: JointWeights) -> BoolArray:
    """Pairs (P,) of the most probable joint hypothesis."""
    chosen = np.zeros(len(joint.log_pair), dtype=np.bool_)
    for group in clusters.groups:
        picked = choose_most_probable(
            group.dense(joint.log_pair, -np.inf),
            joint.log_idle[group.steps[:, :-1]],
            joint.log_idle[group.elements],
            group.sizes,
        )
        chosen[group.pairs] = picked[group.place]
    return chosen


def _check_scores(
    scores: AttributeScores, pairs: GatedPairs, attribute_term: str, n_detections: int
) -> None:
    if not (
        _same(scores.hypothesis, pairs.hypothesis) and _same(scores.detection, pairs.detection)
    ):
        raise PairListMismatch(
            f"attribute scores list {len(scores.hypothesis)} pairs, the gate {len(pairs)}, and "
            "they are not the same: both stages must gate the same scan and predictions"
        )
    if scores.attribute_term != attribute_term:
        raise AssociationInputError(
            f"attribute scores of term {scores.attribute_term!r}: the settings of the scan ask for "
            f"{attribute_term!r}"
        )
    n = len(pairs)
    sizes = [("log_likelihood", n), ("clutter_log_likelihood", n_detections)]
    if scores.has_distance:
        sizes += [("distance", n), ("informative", n)]
    for name, size in sizes:
        shape = getattr(scores, name).shape
        if shape != (size,):
            raise AssociationInputError(
                f"attribute scores: {name} has shape {shape}, allowed is ({size},)"
            )


def _same(one: Int32Array, other: Int32Array) -> bool:
    """Whether two lists of indices are equal; comparing bytes is many times faster where it can."""
    if one.dtype == other.dtype:
        return one.tobytes() == other.tobytes()
    return bool(np.array_equal(one, other))


def _name_culprit(
    predictions: Predictions, scores: AttributeScores | None, pairs: GatedPairs
) -> None:
    """Raise an error that names the input which makes a log weight NaN or +inf."""
    inputs = [
        ("kinematic log likelihood", pairs.log_likelihood, -np.inf, "finite values and -inf"),
        ("detection probability", predictions.detection_probability, 0.0, "values from 0 to 1"),
    ]
    if scores is not None:
        text = "finite values and -inf"
        inputs += [
            ("attribute log likelihood", scores.log_likelihood, -np.inf, text),
            ("clutter log likelihood", scores.clutter_log_likelihood, -np.inf, text),
            ("attribute distance", scores.distance, 0.0, "finite values >= 0"),
        ]
    for name, values, lowest, allowed in inputs:
        wrong = ~((values >= lowest) & (values < np.inf))  # True for NaN
        if name == "detection probability":
            wrong |= values > 1.0
        if wrong.any():
            raise AssociationInputError(f"{name} {values[wrong][0]}: allowed are {allowed}")
