"""Normalised innovations squared (NIS) of a replay, from what went round the ring; needs no truth.

Kept of each scan are its gated pairs only, so that hours fit into memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from gda_tracker.evaluation.consistency import NormalisedErrors
from gda_tracker.kinematics.gating import MEASUREMENT_DIMENSION, gate_threshold
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.innovations import taken_pairs
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import Tracks


@dataclass(frozen=True, slots=True)
class GatedScan:
    """The P gated pairs of one scan.

    Per pair (P,): ``track_id`` and ``hypothesis_id``, ``source_row`` of the detection in the
    source's ``Detections``, ``squared`` Mahalanobis distance. ``detections`` were admitted,
    ``outside`` of them lay in no gate.
    """

    track_id: IntArray
    hypothesis_id: IntArray
    source_row: IntArray
    squared: FloatArray
    gate_probability: float
    attribute_term: str
    detections: int
    outside: int


def gated_scan(scan: Scan, predictions: Predictions, associations: Associations) -> GatedScan:
    """Keep of a scan what its innovations are made of."""
    pairs = associations
    in_a_gate = np.zeros(len(scan), dtype=bool)
    in_a_gate[pairs.detection] = True
    return GatedScan(
        predictions.track_id[pairs.hypothesis],
        predictions.hypothesis_id[pairs.hypothesis],
        scan.source_index[pairs.detection].astype(np.int64),
        np.asarray(pairs.mahalanobis_squared, dtype=np.float64),
        predictions.settings.gate_probability,
        pairs.attribute_term,
        len(scan),
        int(np.count_nonzero(~in_a_gate)),
    )


def innovations(
    tracks: Iterable[Tracks], gated: Mapping[tuple[str, int], GatedScan]
) -> NormalisedErrors:
    """NIS of the detections that confirmed tracks took, by the place of the scan in ``tracks``.

    Of a track with several hypotheses it is that of the one which spoke for it before the scan.

    Parameters
    ----------
    tracks
        After each scan, in the order in which the scans were closed.
    gated
        The pairs by sensor and stamp; scans that are missing give no value.

    Raises
    ------
    ValueError
        If the gate probability changes.
    """
    gates = {scan.gate_probability for scan in gated.values()}
    if len(gates) > 1:
        raise ValueError(f"gate_probability = {sorted(gates)}: allowed is one value for all scans")
    squared, scans = [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    previous: Tracks | None = None
    for place, live in enumerate(tracks):
        pairs = gated.get((live.key.sensor_id, live.key.stamp_ns))
        if pairs is not None and len(live):
            leads = np.ones(len(pairs.track_id), dtype=bool)
            if previous is not None:
                leads = np.isin(pairs.hypothesis_id, previous.hypothesis_id)
            taken = taken_pairs(pairs.track_id, leads, pairs.source_row, live)
            squared.append(pairs.squared[taken])
            scans.append(np.full(int(np.count_nonzero(taken)), place))
        previous = live
    return NormalisedErrors(
        np.concatenate(squared),
        np.concatenate(scans),
        MEASUREMENT_DIMENSION,
        gate_threshold(gates.pop()) if gates else math.inf,
    )
