"""What is told of formations after a scan."""

from __future__ import annotations

from dataclasses import dataclass, field

from gda_tracker.formations.likelihood import expected_number
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanKey

FORMED, SPLIT, MERGED, ENDED = "formed", "split", "merged", "ended"
NUMBER_CHANGED = "number_changed"
KINDS = (FORMED, SPLIT, MERGED, NUMBER_CHANGED, ENDED)
NO_TRACK = -1


@dataclass(frozen=True, slots=True)
class Formation:
    """One formation; message ``Formation``, which states every field.

    ``track_ids``, ``parent_track_ids`` (T,); ``position``, ``velocity`` (2,) and their covariances
    (2, 2); ``extent`` (2, 2) [m2]; ``number_probabilities`` (N,).
    """

    formation_id: int
    since_ns: int
    track_ids: IntArray
    parent_track_ids: IntArray
    position: FloatArray
    position_covariance: FloatArray
    velocity: FloatArray
    velocity_covariance: FloatArray
    extent: FloatArray
    number_probabilities: FloatArray
    number: int
    number_since_ns: int
    samples: int
    log_likelihood_ratio: float
    parent_ids: tuple[int, ...] = ()
    child_ids: tuple[int, ...] = ()

    @property
    def expected_number(self) -> float:
        """The mean of the number's probabilities."""
        return float(expected_number(self.number_probabilities))


@dataclass(frozen=True, slots=True)
class FormationEvent:
    """What happened to a formation; message ``FormationEvent``, which states every field."""

    kind: str
    formation_id: int
    stamp_ns: int
    began_ns: int
    track_ids: tuple[int, ...] = ()
    other_formation_ids: tuple[int, ...] = ()
    number: int = 0
    previous_number: int = 0
    samples: int = 0
    log_likelihood_ratio: float = 0.0
    false_alarm_probability: float = 0.0
    miss_probability: float = 0.0


@dataclass(frozen=True, slots=True)
class Formations:
    """All formations after one scan, by rising id; message ``FormationArray``."""

    key: ScanKey
    frame_id: str = ""
    system_uuid: bytes = bytes(16)
    formations: list[Formation] = field(default_factory=list)
    events: list[FormationEvent] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.formations)
