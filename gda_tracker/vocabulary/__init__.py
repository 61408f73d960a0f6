"""The vocabulary of the ring: what the stages say to each other, as dataclasses of arrays.

Every class here has a message of the same name in ``gda_tracker_msgs`` (``Detections`` travels as
``DetectionArray``, ``Tracks`` as ``TrackArray``). Units are SI, angles in rad counter-clockwise
from the x axis (REP-103), radar cross sections in m2, stamps integer nanoseconds.
"""

from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations, AssociationSettings, Predictions
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, Scan, ScanKey, ScanReport, ScanTruth
from gda_tracker.vocabulary.statements import (
    Statement,
    StatementPiece,
    StatementRegion,
    StatementReport,
)
from gda_tracker.vocabulary.track_sets import TrackSetArray
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE, Tracks

__all__ = [
    "CONFIRMED",
    "TENTATIVE",
    "AssociationSettings",
    "Associations",
    "AttributeScores",
    "Detections",
    "Evidence",
    "Predictions",
    "Recording",
    "Scan",
    "ScanKey",
    "ScanReport",
    "ScanTruth",
    "Statement",
    "StatementPiece",
    "StatementRegion",
    "StatementReport",
    "TrackSetArray",
    "Tracks",
]
