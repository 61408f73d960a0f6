"""Targets that keep to a lane: their motion along it, and the offset across it.

Along the lane a keeper's speed does what white acceleration does. Across it the offset d and its
rate are a stationary Gauss-Markov process, the one whose impulse response is critically damped:

    d'' = -2 a d' - a^2 d + w,  a = 1 / correlation time,
    P = diag(s^2, a^2 s^2) at any time, E[d(t) d(t + u)] = s^2 (1 + a u) exp(-a u).

So "offset zero, heading along the lane, each within its tolerance" holds *at every time with the
same one error*, which fades within the correlation time. Were it taken for a new measurement on
each scan (Koch 2014, 1.3.6, read to the letter), a hundred scans would tell the offset ten times as
well as the lane does. As an artificial measurement it is used once, where a target begins to keep
to the lane: :func:`entered`.

The way is Koch's with road maps (2014, 9.1): predict in road coordinates, and back to the ground by
the moments over the uncertain place along the road, here by Gauss-Hermite quadrature. Corners of a
polyline are rounded, as no vehicle turns on the spot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from gda_tracker.kinematics.context import FORWARD, Lane
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.kinematics.motion_models import white_noise_acceleration
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

# Places along the lane at which the moments are taken: exact up to the 17th power.
_NODES, _WEIGHTS = (np.asarray(a) for a in np.polynomial.hermite_e.hermegauss(9))
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
# A corner becomes an arc of this many lane widths before and after it, in steps of an angle.
ROUNDED_WIDTHS = 2.0
STEP_RAD = math.radians(1.0)
MOST_STEPS = 32
PIECES_OF_A_BOX = 16
# Pairs of a state and a piece that are looked at together: each takes some 150 bytes.
MOST_PAIRS = 1_000_000
# What is farther off, in standard deviations of lane and state together, is on no lane.
FARTHEST_STDS = 6.0
# A uniform distribution over a width has this standard deviation.
OF_WIDTH = 1.0 / math.sqrt(12.0)


@lru_cache(maxsize=256)
def offset_motion(dt_s: float, correlation_s: float) -> tuple[FloatArray, FloatArray]:
    """Motion of offset and rate across a lane over a step, for an offset of standard deviation 1.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    correlation_s
        Correlation time 1/a [s], > 0.

    Returns
    -------
    F, Q
        (2, 2) each; read-only, since they are cached. F = exp(-a dt) [[1 + a dt, dt],
        [-a^2 dt, 1 - a dt]], Q = P - F P F' with P = diag(1, a^2): P stays as it is. Two steps make
        the same as one of their length.
    """
    a = 1.0 / correlation_s
    step = math.exp(-a * dt_s) * np.array(
        [[1.0 + a * dt_s, dt_s], [-(a**2) * dt_s, 1.0 - a * dt_s]]
    )
    stationary = np.diag([1.0, a**2])
    noise = stationary - step @ stationary @ step.T
    step.flags.writeable = noise.flags.writeable = False
    return step, noise


@dataclass(frozen=True, slots=True)
class Entries:
    """States (N,) that begin to keep to a lane: how probably, and what they are then.

    ``probability`` (N,), relative to a target in the middle of the lane that moves exactly along
    it; ``mean`` (N, 4), ``covariance`` (N, 4, 4).
    """

    probability: FloatArray
    mean: FloatArray
    covariance: FloatArray


class LaneCourse:
    """The middle lines of all lanes, rounded, as S straight pieces one after the other.

    Parameters
    ----------
    lanes
        One at least.
    correlation_s
        Time after which an offset across the lane has been forgotten [s], > 0.
    """

    def __init__(self, lanes: tuple[Lane, ...], correlation_s: float) -> None:
        self.correlation_s = correlation_s
        courses = [rounded(lane.points, ROUNDED_WIDTHS * lane.width_m) for lane in lanes]
        steps = [np.diff(course, axis=0) for course in courses]
        counts = np.array([len(step) for step in steps])
        step = np.concatenate(steps)
        self.lane = np.repeat(np.arange(len(lanes)), counts)
        self.first = (np.cumsum(counts) - counts)[self.lane]
        self.last = (np.cumsum(counts) - 1)[self.lane]
        self.start = np.concatenate([course[:-1] for course in courses])
        self.length = np.hypot(step[:, 0], step[:, 1])
        self.along = step / self.length[:, None]
        # Way to the start of each piece, one lane after the other.
        self.way = np.concatenate([[0.0], np.cumsum(self.length)[:-1]])
        self.std_m = np.array([lane.width_m * OF_WIDTH for lane in lanes])[self.lane]
        self.one_way = np.array([lane.direction == FORWARD for lane in lanes])[self.lane]
        self._is_first = self.first == np.arange(len(step))
        self._is_last = self.last == np.arange(len(step))
        # Boxes around runs of pieces: most of a map is far from any one state.
        place = np.arange(len(step)) - self.first
        self._chunk_first = np.flatnonzero(place % PIECES_OF_A_BOX == 0)
        self._chunk_count = np.diff(np.append(self._chunk_first, len(step)))
        ends = self.start + step
        self._low = np.minimum.reduceat(np.minimum(self.start, ends), self._chunk_first)
        self._high = np.maximum.reduceat(np.maximum(self.start, ends), self._chunk_first)
        self._chunk_std = self.std_m[self._chunk_first]

    def piece_of(self, mean: FloatArray, covariance: FloatArray) -> IntArray:
        """Piece (N,) of a lane that each state is most probably on, -1 where it is on none.

        That with the least squared distance of offset and speed across from 0, in the standard
        deviations of lane and state. Past its ends there is no lane, none against its direction,
        and none farther off than 6 of these deviations.
        """
        block = max(MOST_PAIRS // len(self.way), 1)
        if len(mean) > block:
            starts = range(0, len(mean), block)
            each = [self.piece_of(mean[k : k + block], covariance[k : k + block]) for k in starts]
            return np.concatenate(each)
        # Half the trace: the same from every side, which will do for a choice.
        spread = 0.5 * np.trace(covariance[:, :2, :2], axis1=1, axis2=2)
        row, piece = self._near(mean[:, :2], spread)
        found = np.full(len(mean), -1, dtype=np.int64)
        if not len(row):
            return found
        relative = mean[row, :2] - self.start[piece]
        direction, velocity = self.along[piece], mean[row, 2:]
        along = np.sum(relative * direction, axis=1)
        aside = relative - np.clip(along, 0.0, self.length[piece])[:, None] * direction
        forward = np.sum(velocity * direction, axis=1)
        across = velocity[:, 1] * direction[:, 0] - velocity[:, 0] * direction[:, 1]
        speed_spread = 0.5 * np.trace(covariance[:, 2:, 2:], axis1=1, axis2=2)[row]
        variance = self.std_m[piece] ** 2
        cost = np.sum(aside**2, axis=1) / (variance + spread[row])
        cost += across**2 / (variance / self.correlation_s**2 + speed_spread)
        none = (along < 0.0) & self._is_first[piece]
        none |= (along > self.length[piece]) & self._is_last[piece]
        none |= self.one_way[piece] & (forward < -np.sqrt(speed_spread))
        cost[none] = np.inf
        begins = np.flatnonzero(np.append(True, row[1:] != row[:-1]))
        least = np.minimum.reduceat(cost, begins)
        counts = np.diff(np.append(begins, len(row)))
        best = np.flatnonzero((cost == np.repeat(least, counts)) & (cost <= FARTHEST_STDS**2))
        # Of equal ones the first.
        found[row[best[::-1]]] = piece[best[::-1]]
        return found

    def _near(self, position: FloatArray, spread: FloatArray) -> tuple[IntArray, IntArray]:
        """Rows and pieces, by rows, of all pairs that may be near enough; ``spread`` (N,) [m2]."""
        reach = FARTHEST_STDS * np.sqrt(spread[:, None] + self._chunk_std**2)
        inside = np.ones(reach.shape, dtype=bool)
        for axis in (0, 1):
            place = position[:, axis, None]
            inside &= place >= self._low[:, axis] - reach
            inside &= place <= self._high[:, axis] + reach
        rows, chunks = np.nonzero(inside)
        counts = self._chunk_count[chunks]
        ends = np.cumsum(counts)
        within = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - counts, counts)
        return np.repeat(rows, counts), np.repeat(self._chunk_first[chunks], counts) + within

    def entered(self, mean: FloatArray, covariance: FloatArray, piece: IntArray) -> Entries:
        """What begins to keep to a lane: the artificial measurement, used once.

        A target begins with a probability that falls with offset d and rate d' as
        g = exp(-d^2 / (2 s^2) - d'^2 / (2 a^2 s^2)), so that of all that pass by, those that begin
        have the distribution of the keepers. Of a Gaussian the share that does is the integral of
        g N(x; m, P), and what becomes of it the update with the measurement d = d' = 0 of
        covariance diag(s^2, a^2 s^2).

        Parameters
        ----------
        mean, covariance
            (N, 4), (N, 4, 4).
        piece
            (N,) as of :meth:`piece_of`; where it is -1 nothing begins.
        """
        at = np.maximum(piece, 0)
        local, inner = self._on_lane(mean, covariance, at)
        gap = -local[:, 1::2]
        across = inner[:, 1::2, 1::2]
        noise = np.zeros_like(across)
        noise[:, 0, 0] = self.std_m[at] ** 2
        noise[:, 1, 1] = noise[:, 0, 0] / self.correlation_s**2
        total = across + noise
        gain = np.swapaxes(np.linalg.solve(total, inner[:, 1::2, :]), -1, -2)
        squared = np.sum(gap * np.linalg.solve(total, gap[..., None])[..., 0], axis=-1)
        share = np.sqrt(np.linalg.det(noise) / np.linalg.det(total)) * np.exp(-0.5 * squared)
        local = local + (gain @ gap[..., None])[..., 0]
        inner = inner - gain @ inner[:, 1::2, :]
        # Against the direction of a lane nobody begins to keep to it.
        ahead = ndtr(local[:, 2] / np.sqrt(np.maximum(inner[:, 2, 2], 1e-12)))
        share = share * np.where(self.one_way[at], ahead, 1.0) * (piece >= 0)
        return Entries(share, *self._on_ground(local, inner, at))

    def moved(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        piece: IntArray,
        dt_s: float,
        acceleration_density_m2ps3: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Keepers ``dt_s`` [s] > 0 later: (N, 4), (N, 4, 4); ``piece`` (N,) >= 0.

        Past its end a lane goes straight on.
        """
        local, inner = self._on_lane(mean, covariance, piece)
        ahead, ahead_noise = white_noise_acceleration(dt_s, acceleration_density_m2ps3, 1)
        aside, aside_noise = offset_motion(float(dt_s), self.correlation_s)
        step, noise = np.zeros((4, 4)), np.zeros((len(mean), 4, 4))
        step[0::2, 0::2], step[1::2, 1::2] = ahead, aside
        noise[:, 0::2, 0::2] = ahead_noise
        noise[:, 1::2, 1::2] = self.std_m[piece][:, None, None] ** 2 * aside_noise
        local = local @ step.T
        inner = step @ inner @ step.T + noise
        return self._on_ground(local, inner, piece)

    def _on_lane(
        self, mean: FloatArray, covariance: FloatArray, piece: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Moments in way along the lane, offset to the left, and their rates.

        On a bend who is farther along goes in another direction: to a rate across that is of the
        lane, not of the road's axes where the mean is.
        """
        points, rest = _nodes(mean, covariance, self._turn(piece)[:, :, 0])
        each = np.repeat(rest, len(_NODES), axis=0)
        at = np.repeat(piece, len(_NODES))
        flat = points.reshape(-1, 4)
        for _ in range(2):
            at = self._piece_at(self._local(flat, each, at)[0][:, 0], at)
        return _moments_of(*self._local(flat, each, at), points.shape)

    def _on_ground(
        self, local: FloatArray, covariance: FloatArray, piece: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """The reverse of :meth:`_on_lane`; ``piece`` (N,) says which lane."""
        along = np.zeros_like(local)
        along[:, 0] = 1.0
        points, rest = _nodes(local, covariance, along)
        flat = points.reshape(-1, 4)
        at = self._piece_at(flat[:, 0], np.repeat(piece, len(_NODES)))
        each = np.repeat(rest, len(_NODES), axis=0)
        return _moments_of(*self._ground(flat, each, at), points.shape)

    def _local(
        self, mean: FloatArray, covariance: FloatArray, piece: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """States as way along, offset to the left, and their rates; in the axes of a piece."""
        turn = self._turn(piece)
        relative = mean.copy()
        relative[:, :2] -= self.start[piece]
        local = (np.swapaxes(turn, -1, -2) @ relative[..., None])[..., 0]
        local[:, 0] += self.way[piece]
        return local, np.swapaxes(turn, -1, -2) @ covariance @ turn

    def _ground(
        self, local: FloatArray, covariance: FloatArray, piece: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """The reverse of :meth:`_local`."""
        turn = self._turn(piece)
        relative = local.copy()
        relative[:, 0] -= self.way[piece]
        ground = (turn @ relative[..., None])[..., 0]
        ground[:, :2] += self.start[piece]
        return ground, turn @ covariance @ np.swapaxes(turn, -1, -2)

    def _turn(self, piece: IntArray) -> FloatArray:
        """Axes (N, 4, 4) of pieces: columns along, left, and the same for velocities."""
        c, s = self.along[piece].T
        turn = np.zeros((len(piece), 4, 4))
        turn[:, 0, 0] = turn[:, 1, 1] = turn[:, 2, 2] = turn[:, 3, 3] = c
        turn[:, 1, 0] = turn[:, 3, 2] = s
        turn[:, 0, 1] = turn[:, 2, 3] = -s
        return turn

    def _piece_at(self, way: FloatArray, piece: IntArray) -> IntArray:
        """Piece (N,) at ways (N,) along the lane of ``piece`` (N,)."""
        found = np.searchsorted(self.way, way, side="right") - 1
        return np.clip(found, self.first[piece], self.last[piece])


def _nodes(
    mean: FloatArray, covariance: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gaussians (N, J, 4) of which each is known in a direction (N, 4), and the rest (N, 4, 4).

    Given that component, at the nodes of a quadrature, all else is Gaussian with one covariance.
    """
    slope = (covariance @ direction[:, :, None])[:, :, 0]
    variance = np.sum(slope * direction, axis=-1)
    slope = slope / np.sqrt(np.maximum(variance, 1e-12))[:, None]
    rest = covariance - slope[:, :, None] * slope[:, None, :]
    return mean[:, None, :] + _NODES[:, None] * slope[:, None, :], rest


def _moments_of(
    points: FloatArray, covariance: FloatArray, shape: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Moments (N, 4), (N, 4, 4) over the nodes, which stand one after the other."""
    weights = np.broadcast_to(_WEIGHTS, shape[:2])
    return moments(weights, points.reshape(shape), covariance.reshape(*shape, 4))


def rounded(points: FloatArray, reach_m: float) -> FloatArray:
    """Polyline whose corners are parabolas, in steps of a degree of heading or so.

    Parameters
    ----------
    points
        (M, 2) [m], M >= 2, neighbours apart.
    reach_m
        So far before and after a corner the rounding reaches, but never past the middle between two
        corners [m].

    Returns
    -------
    (K, 2) array
        Beginning and ending as ``points`` do.
    """
    parts = [points[:1]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        back, on = before - corner, after - corner
        lengths = np.hypot(*back), np.hypot(*on)
        turned = math.pi - math.acos(
            float(np.clip(back @ on / (lengths[0] * lengths[1]), -1.0, 1.0))
        )
        reach = min(reach_m, 0.5 * lengths[0], 0.5 * lengths[1])
        steps = min(math.ceil(turned / STEP_RAD), MOST_STEPS)
        if steps < 2:
            parts.append(corner[None])
            continue
        t = np.linspace(0.0, 1.0, steps + 1)[:, None]
        begin, end = corner + back * (reach / lengths[0]), corner + on * (reach / lengths[1])
        parts.append((1 - t) ** 2 * begin + 2 * t * (1 - t) * corner + t**2 * end)
    course = np.concatenate([*parts, points[-1:]])
    # Where two arcs meet in the middle between their corners a point stands twice.
    new = np.append(True, np.hypot(*np.diff(course, axis=0).T) > 1e-9)
    return course[new]
