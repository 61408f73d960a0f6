"""The ring offline: the four stages in a row on arrays, the same functions as in the nodes.

>>> ring = Ring({"track_manager": {"decision": "map"}})                       # doctest: +SKIP
>>> result = ring.process(detections)                                         # doctest: +SKIP
>>> result.tracks.mean                                                        # doctest: +SKIP
"""

from __future__ import annotations

import operator
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.attributes.class_terms import fault_of_transition, transition_matrix
from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.kinematics.gating import GatedPairs, gate
from gda_tracker.parameters import ParameterError, from_mapping, specifications, to_mapping
from gda_tracker.tracking.class_motion import fault_of_class_motion
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.smoothing import Smoother
from gda_tracker.vocabulary.arrays import Int32Array
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Detections, Scan, ScanReport
from gda_tracker.vocabulary.statements import Statement, StatementReport
from gda_tracker.vocabulary.tracks import Tracks

STAGE_TABLES: dict[str, type] = {
    "track_manager": TrackManagerParameters,
    "rcs_fuzzifier": RcsFuzzifierParameters,
    "attribute_fusion": AttributeFusionParameters,
    "association": AssociationParameters,
}

# What a round consists of, in the order in which its parts are timed.
PARTS_OF_A_ROUND = (
    "prediction",
    "rcs_fuzzifier",
    "gating",
    "attribute_fusion",
    "association",
    "update",
)

Associate = Callable[[Scan, Predictions, AttributeScores | None, GatedPairs], Associations]


@dataclass(slots=True)
class RingResult:
    """Everything that one scan brought about; ``None`` where the scan was rejected.

    ``delayed``: tracks of earlier scans with a past that is final now (decision ``mht``).
    ``assigned`` (H,): for each hypothesis of the predictions the detection that it was given by
    what speaks for its track after the scan, -1 for none. ``stage_s`` says how long each part of
    the round took [s].
    """

    report: ScanReport
    tracks: Tracks | None = None
    scan: Scan | None = None
    predictions: Predictions | None = None
    evidence: Evidence | None = None
    scores: AttributeScores | None = None
    associations: Associations | None = None
    delayed: tuple[Tracks, ...] = ()
    assigned: Int32Array | None = None
    stage_s: dict[str, float] = field(default_factory=dict, compare=False)


@dataclass(frozen=True, slots=True)
class Prepared:
    """What a scan is whatever the tracks are: the admitted scan with its counts, the evidence."""

    validated: tuple[Scan, Counter[str]]
    evidence: Evidence


def stage_parameters(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Build the four parameter tables from ``{node: {name: value}}``; missing ones take defaults.

    Raises
    ------
    ParameterError
        For an unknown node or parameter, a value that is not allowed, or a class transition of
        another number of classes than the fuzzifier's, or motion of classes that it has not.
    """
    for node in parameters:
        if node not in STAGE_TABLES:
            raise ParameterError(f"node {node}: unknown; allowed are {', '.join(STAGE_TABLES)}")
    tables: dict[str, Any] = {
        node: from_mapping(table, parameters.get(node, {})) for node, table in STAGE_TABLES.items()
    }
    transition = transition_matrix(tables["attribute_fusion"].class_transition)
    names = tables["rcs_fuzzifier"].class_names
    fault = fault_of_transition(transition, names)
    fault = fault or fault_of_class_motion(tables["track_manager"], names)
    if fault:
        raise ParameterError(fault)
    return tables


class Ring:
    """The four stages joined, without ROS.

    Parameters
    ----------
    parameters
        ``{node: {parameter: value}}`` for track_manager, rcs_fuzzifier, attribute_fusion,
        association.
    associate
        Takes the place of the association stage, e.g. to decide by the truth.
    """

    def __init__(
        self,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
        associate: Associate | None = None,
    ) -> None:
        self._tables = tables = stage_parameters(parameters or {})
        self.manager = TrackManager(tables["track_manager"])
        self.fuzzifier = RcsFuzzifier(tables["rcs_fuzzifier"])
        self.fusion = AttributeFusion(tables["attribute_fusion"])
        # Keeps every scan, if somebody wants the tracks in the light of all of them.
        self.smoother: Smoother | None = None
        self.associate: Associate = associate or Associator(tables["association"])

    def set_parameters(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change live parameters ``{node: {name: value}}``, all or none; acts at the next scan.

        An association that was given in place of the stage stays.

        Raises
        ------
        ParameterError
            For a parameter that is fixed at start-up, and as :func:`stage_parameters`.
        """
        for node, values in changes.items():
            declared = specifications(STAGE_TABLES[node]) if node in STAGE_TABLES else {}
            fixed = [name for name in values if name in declared and not declared[name].live]
            if fixed:
                raise ParameterError(f"parameter {fixed[0]} of {node}: fixed at start-up")
        merged = {node: to_mapping(table) for node, table in self._tables.items()}
        for node, values in changes.items():
            merged[node] = {**merged.get(node, {}), **values}
        self._tables = tables = stage_parameters(merged)
        if "track_manager" in changes:
            self.manager.set_parameters(tables["track_manager"])
        if "rcs_fuzzifier" in changes:
            self.fuzzifier = RcsFuzzifier(tables["rcs_fuzzifier"], self.fuzzifier.counters)
        if "attribute_fusion" in changes:
            self.fusion = AttributeFusion(tables["attribute_fusion"])
        if "association" in changes and isinstance(self.associate, Associator):
            self.associate = Associator(tables["association"])

    def initialise(self, initial: Tracks) -> ScanReport:
        """Start from labelled tracks."""
        return self.manager.initialise(initial)

    def say(self, statement: Statement) -> StatementReport:
        """Take in a statement; the next scan that is not older uses it."""
        return self.manager.tell(statement)

    def prepare(self, detections: Detections) -> Prepared:
        """Do what depends on the parameters alone, for several rings to use.

        Raises
        ------
        Rejected
            If the scan is refused.
        """
        validated = self.manager.validate(detections)
        return Prepared(validated, self.fuzzifier(validated[0]))

    def process(self, detections: Detections, prepared: Prepared | None = None) -> RingResult:
        """Take one scan round the ring.

        ``prepared`` comes from :meth:`prepare` of a ring with the same door and fuzzifier. With a
        reorder window the scan that is answered may be an earlier one, or none: use :meth:`feed`.

        Raises
        ------
        RuntimeError
            If not exactly this scan was answered.
        """
        results = self.feed(detections, prepared)
        if len(results) != 1 or results[0].report.key[1:] != (
            detections.sensor_id,
            detections.stamp_ns,
        ):
            raise RuntimeError(
                "the scan waits for initial tracks or in the reorder window: use feed()"
            )
        return results[0]

    def feed(self, detections: Detections, prepared: Prepared | None = None) -> list[RingResult]:
        """Admit a scan, and take round the ring what needs to wait no longer; return the answers.

        ``prepared`` is for rings without a reorder window.
        """
        validated = None if prepared is None else prepared.validated
        answer = self.manager.admit(detections, validated=validated)
        if answer is not None:
            tracks = self.manager.tracks() if answer.repeated else None
            return [RingResult(answer, tracks)]
        return self._work_off(None if prepared is None else prepared.evidence)

    def finish(self) -> list[RingResult]:
        """Take round the ring what waits in the reorder window: the recording has ended."""
        self.manager.release()
        return self._work_off(None)

    def _work_off(self, evidence: Evidence | None) -> list[RingResult]:
        results = []
        while self.manager.ready:
            results.append(self._once_round(evidence))
        return results

    def _once_round(self, prepared: Evidence | None) -> RingResult:
        clock = time.perf_counter
        marks = [clock()]
        opened = self.manager.open()
        scan, predictions = opened.scan, opened.predictions
        marks.append(clock())
        # What was prepared knows of no statements and no cells.
        known = None if scan.statements or scan.cells is not None else prepared
        evidence = self.fuzzifier(scan) if known is None else known
        marks.append(clock())
        pairs = gate(scan, predictions)
        marks.append(clock())
        scores = self.fusion(
            predictions, evidence, pairs.hypothesis, pairs.detection, scan.statements
        )
        marks.append(clock())
        associations = self.associate(scan, predictions, scores, pairs)
        marks.append(clock())
        tracks, report = self.manager.close(evidence, scores, associations, trusted=True)
        marks.append(clock())
        if self.smoother is not None:
            self.smoother.add(self.manager)
        return RingResult(
            report,
            tracks,
            scan,
            predictions,
            evidence,
            scores,
            associations,
            tuple(self.manager.delayed),
            self.manager.assigned,
            dict(zip(PARTS_OF_A_ROUND, map(operator.sub, marks[1:], marks), strict=True)),
        )

    def rest_of_delayed(self) -> list[Tracks]:
        """Tracks of the last scans with their revised past, as if no further scan came."""
        return self.manager.rest_of_delayed()
