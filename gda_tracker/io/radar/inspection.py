"""What a radar publishes, looked at: fields, values, rates, stamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.radar.frames import Fields, RadarFrame
from gda_tracker.vocabulary.arrays import FloatArray

# Values kept for medians; of longer recordings every second, fourth, ... frame.
MOST_POINTS = 400_000
# A pause longer than so many usual periods is a gap.
GAP_PERIODS = 2.5
EXAMPLES = 10


@dataclass(frozen=True, slots=True)
class FieldStatistics:
    """A field: declared type, number of values, range, and the share that is NaN.

    ``minimum``, ``median`` and ``maximum`` are NaN where no value is finite.
    """

    name: str
    type: str
    number: int
    minimum: float
    median: float
    maximum: float
    nan_share: float


@dataclass(frozen=True, slots=True)
class Stamps:
    """The stamps of F frames, in the order in which they came [s].

    ``period_s`` is the median distance of those that go forward (NaN with fewer than two),
    ``gaps`` those longer than 2.5 of it, the longest of which is ``longest_gap_s``.
    """

    number: int
    duration_s: float
    period_s: float
    jitter_s: float
    gaps: int
    longest_gap_s: float
    steps_back: int
    repeated: int
    unset: int

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return 1.0 / self.period_s if self.period_s > 0.0 else float("nan")


@dataclass(slots=True)
class Inspection:
    """What was seen of one topic or file.

    ``values`` (m,) by field are the ones kept, of the same points in every field; ``examples`` are
    the first frames with points. ``unreadable`` counts frames that contradict themselves, by what
    was wrong; ``layouts`` those with points by their fields: more than one if the driver changes
    them.
    """

    source: str
    kind: str = ""
    frame_ids: list[str] = field(default_factory=list)
    points: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    statistics: list[FieldStatistics] = field(default_factory=list)
    values: Fields = field(default_factory=dict)
    examples: list[RadarFrame] = field(default_factory=list)
    unreadable: Counter[str] = field(default_factory=Counter)
    layouts: Counter[str] = field(default_factory=Counter)

    @property
    def stamps(self) -> Stamps:
        """Rate, order and gaps of the stamps."""
        return look_at_stamps(self.stamps_ns)

    def of(self, name: str) -> FieldStatistics | None:
        """Return the statistics of a field."""
        return next((item for item in self.statistics if item.name == name), None)


def inspect_frames(source: str, frames: Iterable[RadarFrame]) -> Inspection:
    """Look at all frames of a topic or file.

    Parameters
    ----------
    source
        Name for the report.
    frames
        In the order in which they came. A frame with other fields than the first one with points
        is counted in ``layouts``, but its values are left out.
    """
    found = Inspection(source)
    kept = _Kept()
    extremes: dict[str, _Extremes] = {}
    types: dict[str, str] = {}
    for frame in frames:
        found.kind = found.kind or frame.kind
        if frame.frame_id not in found.frame_ids:
            found.frame_ids.append(frame.frame_id)
        found.stamps_ns.append(frame.stamp_ns)
        # The fields of RadarTracks are those that its tracks bring: without any nothing is known.
        own = dict(frame.types)
        if not found.examples:
            types = own
        names = [name for name, kind in own.items() if not kind.startswith("datatype")]
        try:
            values = frame.read(names, {})
        except UserError as error:
            found.unreadable[str(error)] += 1
            continue
        number = len(next(iter(values.values()), ()))
        found.points.append(number)
        if number:
            found.layouts[", ".join(f"{name} {kind}" for name, kind in own.items())] += 1
            if own != types:
                continue
            if len(found.examples) < EXAMPLES:
                found.examples.append(frame)
            for name, column in values.items():
                extremes.setdefault(name, _Extremes()).add(column)
            kept.add(values, number)
    found.values = kept.columns()
    for name, kind in types.items():
        seen = extremes.get(name, _Extremes())
        finite = found.values.get(name, np.zeros(0))
        finite = finite[np.isfinite(finite)]
        found.statistics.append(
            FieldStatistics(
                name,
                kind,
                seen.number,
                seen.minimum if seen.minimum <= seen.maximum else float("nan"),
                float(np.median(finite)) if len(finite) else float("nan"),
                seen.maximum if seen.minimum <= seen.maximum else float("nan"),
                seen.nan / seen.number if seen.number else 0.0,
            )
        )
    return found


def look_at_stamps(stamps_ns: list[int]) -> Stamps:
    """Return rate, order and gaps of stamps [ns] in the order in which they came."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    steps = np.diff(stamps) * 1e-9
    forward = steps[steps > 0.0]
    period = float(np.median(forward)) if len(forward) else float("nan")
    gaps = forward[forward > GAP_PERIODS * period] if len(forward) else forward
    return Stamps(
        number=len(stamps),
        duration_s=float(np.ptp(stamps)) * 1e-9 if len(stamps) else 0.0,
        period_s=period,
        jitter_s=float(np.median(np.abs(forward - period))) if len(forward) else float("nan"),
        gaps=len(gaps),
        longest_gap_s=float(gaps.max()) if len(gaps) else 0.0,
        steps_back=int(np.count_nonzero(steps < 0.0)),
        repeated=int(np.count_nonzero(steps == 0.0)),
        unset=int(np.count_nonzero(stamps == 0)),
    )


@dataclass(slots=True)
class _Extremes:
    number: int = 0
    nan: int = 0
    minimum: float = float("inf")
    maximum: float = float("-inf")

    def add(self, column: FloatArray) -> None:
        finite = column[np.isfinite(column)]
        self.number += len(column)
        self.nan += int(np.count_nonzero(np.isnan(column)))
        if len(finite):
            self.minimum = min(self.minimum, float(finite.min()))
            self.maximum = max(self.maximum, float(finite.max()))


class _Kept:
    """Values of every n-th frame; n doubles whenever there are too many."""

    def __init__(self) -> None:
        self._frames: list[tuple[int, Fields]] = []
        self._index = -1
        self._stride = 1
        self._points = 0

    def add(self, values: Fields, number: int) -> None:
        self._index += 1
        if self._index % self._stride:
            return
        self._frames.append((number, values))
        self._points += number
        while self._points > MOST_POINTS and len(self._frames) > 1:
            self._stride *= 2
            self._frames = self._frames[::2]
            self._points = sum(count for count, _ in self._frames)

    def columns(self) -> Fields:
        if not self._frames:
            return {}
        names = self._frames[0][1]
        return {
            name: np.concatenate([values[name] for _, values in self._frames]) for name in names
        }
