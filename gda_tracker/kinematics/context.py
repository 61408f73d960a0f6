"""Lanes and plans: what is known beside the measurements (Koch 2014, section 1.3.6)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

ANY_DIRECTION = "both"
FORWARD = "forward"
DIRECTIONS_OF_LANES = (FORWARD, ANY_DIRECTION)


@dataclass(frozen=True, slots=True)
class Lane:
    """A strip of ``width_m`` about a polyline.

    ``points`` (M, 2) [m], M >= 2, in the direction of travel where ``direction`` is ``forward``.
    An object has surely left it ``margin_m`` beyond its edge.
    """

    name: str
    points: FloatArray
    width_m: float
    margin_m: float
    direction: str = ANY_DIRECTION


@dataclass(frozen=True, slots=True)
class Plan:
    """Where a track shall be and when: waypoints, between them straight at constant speed.

    ``time_ns`` (K,) rising, K >= 2; ``points`` (K, 2) and ``tolerance_m`` (K,), the distance that
    still keeps the plan. An object is surely off it ``margin_m`` beyond the tolerance.
    ``tolerance_s`` (K,), 0 where nothing is said, is how much too early or too late it may be.
    """

    name: str
    track_id: int
    time_ns: IntArray
    points: FloatArray
    tolerance_m: FloatArray
    margin_m: float
    tolerance_s: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def velocity_mps(self) -> FloatArray:
        """Planned velocity (K - 1, 2) between the waypoints [m/s]."""
        return np.diff(self.points, axis=0) / (np.diff(self.time_ns) / 1e9)[:, None]

    @property
    def tolerance_along_m(self) -> FloatArray:
        """Distance (K,) that keeps the plan with what may be early or late on the way [m]."""
        if not self.tolerance_s.any():
            return self.tolerance_m
        speed = np.hypot(*self.velocity_mps.T)
        # At a waypoint the faster of the two ways that meet there.
        fastest = np.maximum(np.append(speed, 0.0), np.append(0.0, speed))
        return self.tolerance_m + self.tolerance_s * fastest

    def at(self, stamp_ns: int) -> tuple[FloatArray, float] | None:
        """Return position (2,) and tolerance at a time, ``None`` before and after the plan."""
        if not self.time_ns[0] <= stamp_ns <= self.time_ns[-1]:
            return None
        # Relative times: stamps since 1970 in ns are beyond what a double holds exactly.
        now = float(stamp_ns - int(self.time_ns[0]))
        times = (self.time_ns - self.time_ns[0]).astype(np.float64)
        point = np.array([np.interp(now, times, self.points[:, axis]) for axis in (0, 1)])
        return point, float(np.interp(now, times, self.tolerance_along_m))


@dataclass(frozen=True, slots=True)
class Context:
    """Lanes and plans of one tracking frame."""

    frame_id: str = ""
    lanes: tuple[Lane, ...] = ()
    plans: tuple[Plan, ...] = ()


@dataclass(frozen=True, slots=True)
class LanePlaces:
    """Where points lie on lanes, (N,) each.

    ``lane`` index, -1 for none; ``offset_m`` to the left of the centre line; ``normal`` (N, 2) in
    which the offset grows; ``along`` (N, 2) the lane's direction there; ``beyond`` the lane's end.
    """

    lane: IntArray
    offset_m: FloatArray
    normal: FloatArray
    along: FloatArray
    beyond: BoolArray


class LaneMap:
    """The segments of all lanes, stacked."""

    def __init__(self, lanes: tuple[Lane, ...]) -> None:
        self.lanes = lanes
        counts = np.array([len(lane.points) - 1 for lane in lanes], dtype=np.int64)
        self.lane = np.repeat(np.arange(len(lanes)), counts)
        self.half_width = np.array([lane.width_m / 2.0 for lane in lanes])
        self.margin = np.array([lane.margin_m for lane in lanes])
        self.one_way = np.array([lane.direction == FORWARD for lane in lanes], dtype=bool)
        starts = [lane.points[:-1] for lane in lanes]
        steps = [np.diff(lane.points, axis=0) for lane in lanes]
        self._start = np.concatenate(starts) if lanes else np.zeros((0, 2))
        step = np.concatenate(steps) if lanes else np.zeros((0, 2))
        self._length = np.hypot(step[:, 0], step[:, 1])
        self._along = step / self._length[:, None]
        ends = np.cumsum(counts)
        self._first = np.zeros(len(self.lane), dtype=bool)
        self._last = np.zeros(len(self.lane), dtype=bool)
        self._first[ends - counts] = True
        self._last[ends - 1] = True

    def on_lane(self, position: FloatArray, lane: IntArray) -> LanePlaces:
        """Places of points (N, 2) on given lanes (N,), by their nearest segments."""
        along, distance, delta = self._distances(position)
        other = self.lane[None, :] != np.asarray(lane)[:, None]
        return self._places(np.where(other, np.inf, distance), along, delta)

    def lane_of(
        self, position: FloatArray, velocity: FloatArray, heading_known: BoolArray, cosine: float
    ) -> IntArray:
        """Lane (N,) in which each point lies and along which it moves, -1 for none.

        Of several the one in whose middle it is most.

        Parameters
        ----------
        position, velocity
            (N, 2) each.
        heading_known
            (N,) whether the velocity tells a heading; where not, any lane will do.
        cosine
            Of the largest angle between heading and lane, in either direction.
        """
        if not len(self.lane):
            return np.full(len(position), -1, dtype=np.int64)
        along, distance, _ = self._distances(position)
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        aligned = np.abs(velocity @ self._along.T) >= cosine * speed[:, None]
        ended = ((along < 0.0) & self._first) | ((along > self._length) & self._last)
        inside = (distance <= self.half_width[self.lane]) & ~ended
        fits = inside & (aligned | ~heading_known[:, None])
        share = np.where(fits, distance / self.half_width[self.lane], np.inf)
        nearest = np.argmin(share, axis=1)
        return np.where(fits.any(axis=1), self.lane[nearest], -1).astype(np.int64)

    def _distances(self, position: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far along (N, S), how far from (N, S), and the vector (N, S, 2) from each segment."""
        relative = position[:, None, :] - self._start
        along = np.einsum("nsi,si->ns", relative, self._along)
        delta = relative - np.clip(along, 0.0, self._length)[..., None] * self._along
        return along, np.hypot(delta[..., 0], delta[..., 1]), delta

    def _places(self, distance: FloatArray, along: FloatArray, delta: FloatArray) -> LanePlaces:
        rows = np.arange(len(distance))
        segment = np.argmin(distance, axis=1)
        direction = self._along[segment]
        left = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
        vector, far = delta[rows, segment], distance[rows, segment]
        side = np.where(np.einsum("ni,ni->n", vector, left) < 0.0, -1.0, 1.0)
        # At a bend the nearest point is the corner, and the offset grows away from it.
        length, place = self._length[segment], along[rows, segment]
        corner = ((place < 0.0) | (place > length)) & (far > 0.0)
        away = side[:, None] * vector / np.where(corner, far, 1.0)[:, None]
        return LanePlaces(
            lane=self.lane[segment].astype(np.int64),
            offset_m=side * far,
            normal=np.where(corner[:, None], away, left),
            along=direction,
            beyond=((place < 0.0) & self._first[segment])
            | ((place > length) & self._last[segment]),
        )
