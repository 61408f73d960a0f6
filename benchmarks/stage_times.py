"""Where the offline ring spends its time: the stages of one scan, timed one by one."""

from __future__ import annotations

import time

from gda_tracker.kinematics.gating import gate
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.scans import Detections


class StageTimes:
    """Runs the stages of a ring as the nodes do: both stages that need the gate compute it."""

    def __init__(self, ring: Ring) -> None:
        self.ring = ring

    def process(self, detections: Detections) -> dict[str, float]:
        """Take one scan round the ring; CPU time by stage, ``total`` with one gate only [s]."""
        ring, clock = self.ring, time.thread_time
        marks = [clock()]
        answer = ring.manager.admit(detections)
        if answer is not None:
            raise RuntimeError(f"scan rejected: {answer.reason}")
        opened = ring.manager.open()
        marks.append(clock())
        evidence = ring.fuzzifier(opened.scan)
        marks.append(clock())
        pairs = gate(opened.scan, opened.predictions)
        marks.append(clock())
        scores = ring.fusion(opened.predictions, evidence, pairs.hypothesis, pairs.detection)
        marks.append(clock())
        associations = ring.associate(opened.scan, opened.predictions, scores, pairs)
        marks.append(clock())
        ring.manager.close(evidence, scores, associations)
        marks.append(clock())
        door, fuzzifier, gating, fusion, association, update = (
            end - begin for begin, end in zip(marks[:-1], marks[1:], strict=True)
        )
        return {
            "total": marks[-1] - marks[0],
            "door, prediction": door,
            "rcs_fuzzifier": fuzzifier,
            "attribute_fusion": gating + fusion,
            "association": gating + association,
            "update, tracks": update,
        }
