"""Parameters of the track manager: what decides and what speaks: the parts of a method."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.association.choices import DECISIONS, MISSED_TRACK_HYPOTHESES
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.motion_models import FILTERS
from gda_tracker.parameters import parameter


@dataclass(frozen=True)
class MethodParameters:
    """Decision, attribute term and filter."""

    decision: str = parameter(
        "mht",
        "how detections are assigned: mht (over several scans, multiple hypothesis tracking), map "
        "(most probable joint hypothesis of each scan), gda (2004 chapter: 1 - P_k P_a and "
        "Munkres) or jpda (every track takes all detections in its gate, each as far as it is "
        "probable; see coalescence_remedy)",
        choices=DECISIONS,
    )
    attribute_term: str = parameter(
        "bayes", "how the attribute speaks in the association", choices=ATTRIBUTE_TERMS
    )
    filter: str = parameter(
        "imm",
        "motion of targets: cv constant velocity; imm interacting models, two of constant velocity "
        "or those of imm_models; gpb2 the same models by the second-order generalised "
        "pseudo-Bayesian filter",
        choices=FILTERS,
    )
    missed_track_hypotheses: str = parameter(
        "zero",
        "attribute hypotheses that miss a track: zero weight when a fuller one exists, or the "
        "products of table 14.3",
        choices=MISSED_TRACK_HYPOTHESES,
        advanced=True,
    )
