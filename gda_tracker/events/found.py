"""Events: what a test has decided of a track."""

from __future__ import annotations

from dataclasses import dataclass, field

from gda_tracker.events.samples import States
from gda_tracker.events.sequential import H1, Decisions
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import ScanKey

# Kinds of each test: h1 accepted, h0 accepted.
LEAVES_LANE, WRONG_WAY, KEEPS_LANE = "leaves_lane", "wrong_way", "keeps_lane"
OFF_PLAN, ON_PLAN = "off_plan", "on_plan"
STOPPED, MOVES = "stopped", "moves"
ACCELERATES, STEADY = "accelerates", "steady"
SPLIT_OFF = "split_off"
KINDS = (
    LEAVES_LANE,
    WRONG_WAY,
    KEEPS_LANE,
    OFF_PLAN,
    ON_PLAN,
    STOPPED,
    MOVES,
    ACCELERATES,
    STEADY,
    SPLIT_OFF,
)
NO_TRACK = -1


@dataclass(frozen=True, slots=True)
class Finding:
    """A decision worth telling, before it is told with time, place and errors.

    ``track`` is the row of the states, ``decision`` that of the decisions.
    """

    kind: str
    track: int
    decision: int
    value: float
    context: str = ""
    other_track_id: int = NO_TRACK


@dataclass(frozen=True, slots=True)
class TrackEvent:
    """One event; message ``TrackEvent``, which states every field.

    ``position`` (2,) [m], ``position_covariance`` (2, 2) [m2].
    """

    kind: str
    track_id: int
    other_track_id: int
    context: str
    began_ns: int
    stamp_ns: int
    hypothesis: str
    log_likelihood_ratio: float
    lower_threshold: float
    upper_threshold: float
    false_alarm_probability: float
    miss_probability: float
    samples: int
    value: float
    position: FloatArray
    position_covariance: FloatArray


@dataclass(frozen=True, slots=True)
class TrackEvents:
    """Events of one scan; message ``TrackEventArray``."""

    key: ScanKey
    frame_id: str = ""
    system_uuid: bytes = bytes(16)
    events: list[TrackEvent] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.events)


@dataclass(frozen=True, slots=True)
class Design:
    """Thresholds and error probabilities that all events of a run have in common."""

    lower_threshold: float
    upper_threshold: float
    false_alarm_probability: float
    miss_probability: float

    def event(self, finding: Finding, states: States, decisions: Decisions) -> TrackEvent:
        """Return a finding as an event."""
        row, decision = finding.track, finding.decision
        return TrackEvent(
            kind=finding.kind,
            track_id=int(states.track_id[row]),
            other_track_id=finding.other_track_id,
            context=finding.context,
            began_ns=int(decisions.began_ns[decision]),
            stamp_ns=states.stamp_ns,
            hypothesis="h1" if decisions.verdict[decision] == H1 else "h0",
            log_likelihood_ratio=float(decisions.log_ratio[decision]),
            lower_threshold=self.lower_threshold,
            upper_threshold=self.upper_threshold,
            false_alarm_probability=self.false_alarm_probability,
            miss_probability=self.miss_probability,
            samples=int(decisions.samples[decision]),
            value=finding.value,
            position=states.position[row].copy(),
            position_covariance=states.position_covariance()[row].copy(),
        )
