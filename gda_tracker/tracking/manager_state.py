"""What the track manager holds: the state at rest between scans, and the scan that is open."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.tracking.class_motion import MotionHistories
from gda_tracker.tracking.clutter import ClutterMap
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import StartPoints
from gda_tracker.tracking.looks import DetectionMap
from gda_tracker.tracking.measurement_clutter import MeasurementClutter
from gda_tracker.tracking.mht.couplings import Couplings
from gda_tracker.tracking.mht.generations import Generation
from gda_tracker.tracking.statement_desk import StatementDesk
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan, ScanKey, ScanReport


@dataclass(slots=True)
class OpenScan:
    """The scan that goes round the ring, and the hypotheses predicted to its time."""

    scan: Scan
    predictions: Predictions
    table: HypothesisTable
    ended_track_id: IntArray
    started: bool
    admitted_at: float
    received: int
    rejected: Counter[str]
    clutter_density: FloatArray


@dataclass(slots=True)
class ManagerState:
    """What a restart needs: hypotheses, start points, ids, the last closed scan, statements.

    ``generations`` are the trees of the scans before the last closed one, oldest first; there are
    none but under ``mht``, and no ``couplings`` of tracks that may have shared detections.
    ``motion`` is there with ``class_motion`` alone.
    """

    table: HypothesisTable = field(default_factory=HypothesisTable)
    points: StartPoints = field(default_factory=StartPoints)
    next_track_id: int = 1
    next_hypothesis_id: int = 1
    next_detection_number: int = 0
    last_ns: int | None = None
    last_sensors: tuple[str, ...] = ()
    last_key: ScanKey | None = None
    last_report: ScanReport | None = None
    deleted_track_id: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    degraded: bool = False
    initialised_from: tuple[bytes, int] | None = None
    scans_closed: int = 0
    clutter: ClutterMap = field(default_factory=ClutterMap)
    measurement_clutter: MeasurementClutter = field(default_factory=MeasurementClutter)
    looks: DetectionMap = field(default_factory=DetectionMap)
    generations: list[Generation] = field(default_factory=list)
    desk: StatementDesk = field(default_factory=StatementDesk)
    couplings: Couplings = field(default_factory=Couplings)
    motion: MotionHistories | None = None
