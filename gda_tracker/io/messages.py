"""Every class of the vocabulary as a message and back, under one roof.

One pair of functions per class: ``detections_to_message`` and ``detections_from_message``, and so
on. They live in :mod:`~gda_tracker.io.scan_messages`, :mod:`~gda_tracker.io.belief_messages`,
:mod:`~gda_tracker.io.statement_messages`, :mod:`~gda_tracker.io.track_messages` and
:mod:`~gda_tracker.io.track_set_messages`; single fields are converted in
:mod:`~gda_tracker.io.fields`.
"""

from gda_tracker.io.belief_messages import (
    associations_from_message,
    associations_to_message,
    attribute_scores_from_message,
    attribute_scores_to_message,
    evidence_from_message,
    evidence_to_message,
    predictions_from_message,
    predictions_to_message,
)
from gda_tracker.io.fields import MessageError, stamp_from_time, stamp_to_time
from gda_tracker.io.scan_messages import (
    detections_from_message,
    detections_to_message,
    key_from_message,
    key_to_message,
    scan_from_message,
    scan_report_from_message,
    scan_report_to_message,
    scan_to_message,
    scan_truth_from_message,
    scan_truth_to_message,
)
from gda_tracker.io.statement_messages import (
    statement_from_message,
    statement_report_from_message,
    statement_report_to_message,
    statement_to_message,
)
from gda_tracker.io.track_messages import tracks_from_message, tracks_to_message
from gda_tracker.io.track_set_messages import track_sets_from_message, track_sets_to_message

__all__ = [
    "MessageError",
    "associations_from_message",
    "associations_to_message",
    "attribute_scores_from_message",
    "attribute_scores_to_message",
    "detections_from_message",
    "detections_to_message",
    "evidence_from_message",
    "evidence_to_message",
    "key_from_message",
    "key_to_message",
    "predictions_from_message",
    "predictions_to_message",
    "scan_from_message",
    "scan_report_from_message",
    "scan_report_to_message",
    "scan_to_message",
    "scan_truth_from_message",
    "scan_truth_to_message",
    "stamp_from_time",
    "stamp_to_time",
    "statement_from_message",
    "statement_report_from_message",
    "statement_report_to_message",
    "statement_to_message",
    "track_sets_from_message",
    "track_sets_to_message",
    "tracks_from_message",
    "tracks_to_message",
]
