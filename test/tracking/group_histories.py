"""Joint histories of tracks that the sensor may not resolve, by plain recursion and filters.

Nothing of the tracker is used: an extended Kalman filter of single states, the formulas of the
group written out, and every joint hypothesis scan by scan.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np


@dataclass
class Radar:
    """Sensor and motion; ``resolution`` half-distances in range and azimuth."""

    dt_s: float
    process_noise: float
    range_std: float
    azimuth_std: float
    p_d: float
    p_group: float
    clutter: float
    gate: float
    resolution: tuple


LEAST = 0.01


def predicted(mean, covariance, radar):
    """State one scan later."""
    t, q = radar.dt_s, radar.process_noise**2
    f = np.eye(4)
    f[0, 2] = f[1, 3] = t
    g = np.array([[t * t / 2, 0], [0, t * t / 2], [t, 0], [0, t]])
    return f @ mean, f @ covariance @ f.T + q * g @ g.T


def seen(x, p):
    """h, H and H P H'."""
    r2 = x[0] ** 2 + x[1] ** 2
    r = math.sqrt(r2)
    h = np.array([[x[0] / r, x[1] / r, 0, 0], [-x[1] / r2, x[0] / r2, 0, 0]])
    return np.array([r, math.atan2(x[1], x[0])]), h, h @ p @ h.T


def gaussian(v, s):
    """Log density and squared distance."""
    d2 = float(v @ np.linalg.inv(s) @ v)
    return -0.5 * d2 - 0.5 * math.log(np.linalg.det(2 * math.pi * s)), d2


def noise(radar):
    return np.diag([radar.range_std**2, radar.azimuth_std**2])


def single(x, p, z, radar):
    """Log N, squared distance and the updated state."""
    at, h, a = seen(x, p)
    s = a + noise(radar)
    log_density, d2 = gaussian(z - at, s)
    gain = p @ h.T @ np.linalg.inv(s)
    return log_density, d2, (x + gain @ (z - at), p - gain @ s @ gain.T)


def unresolved(one, two, radar):
    """Mean P_u of two predicted states, by the Gaussian integral; 0 where it is small."""
    (at, _, a), (at2, _, b) = seen(*one), seen(*two)
    r_u = np.diag(np.square(radar.resolution)) / (2 * math.log(2))
    log_density, _ = gaussian(at - at2, a + b + r_u)
    value = math.exp(log_density + 0.5 * math.log(np.linalg.det(2 * math.pi * r_u)))
    return value if value > LEAST else 0.0


def group(one, two, z, radar):
    """Log density of a group's detection, its squared distance, and the members' new states.

    Density: of the stacked measurement (mean of both, distance), the second of which is 0 with
    covariance R_u. States: Kalman filter of both stacked, with the first alone.
    """
    (at, h, a), (at2, h2, b) = seen(*one), seen(*two)
    r_u = np.diag(np.square(radar.resolution)) / (2 * math.log(2))
    stacked = np.zeros((4, 4))
    stacked[:2, :2] = (a + b) / 4 + noise(radar)
    stacked[:2, 2:] = (a - b) / 2
    stacked[2:, :2] = (a - b) / 2
    stacked[2:, 2:] = a + b + r_u
    both, distance = gaussian(np.concatenate([z - (at + at2) / 2, at2 - at]), stacked)
    alone, short = gaussian(at2 - at, a + b + r_u)
    joint = np.zeros((8, 8))
    joint[:4, :4], joint[4:, 4:] = one[1], two[1]
    wide = np.hstack([h, h2]) / 2
    gain = joint @ wide.T @ np.linalg.inv(wide @ joint @ wide.T + noise(radar))
    mean = np.concatenate([one[0], two[0]]) + gain @ (z - (at + at2) / 2)
    after = joint - gain @ wide @ joint
    # Half of what independence would take off each of them.
    after = 0.5 * (joint + after)
    states = (mean[:4], after[:4, :4]), (mean[4:], after[4:, 4:])
    return both - alone, distance - short, states


def group_of_three(members, links, z, radar):
    """Log density of the detection of three, squared distance, new states and probability.

    ``links`` are P_u by pair. For each way to be linked the stacked measurement (mean of all,
    distances of the linked), as in :func:`group`.
    """
    places, jacobians, spreads = zip(*(seen(*one) for one in members), strict=True)
    r_u = np.diag(np.square(radar.resolution)) / (2 * math.log(2))
    stacked, whole = np.concatenate(places), np.zeros((6, 6))
    for i, spread in enumerate(spreads):
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = spread
    middle = np.hstack([np.eye(2)] * 3) / 3
    density, least, total = -math.inf, math.inf, 0.0
    pairs = list(itertools.combinations(range(3), 2))
    for way in (pairs, pairs[:2], pairs[::2], pairs[1:]):
        share = math.prod(
            links.get(pair, 0.0) if pair in way else 1 - links.get(pair, 0.0) for pair in pairs
        )
        if not share:
            continue
        total += share
        apart = np.zeros((2 * len(way), 6))
        for row, (a, b) in enumerate(way):
            apart[2 * row : 2 * row + 2, 2 * a : 2 * a + 2] = np.eye(2)
            apart[2 * row : 2 * row + 2, 2 * b : 2 * b + 2] = -np.eye(2)
        far = np.kron(np.eye(len(way)), r_u)
        alone, short = gaussian(apart @ stacked, apart @ whole @ apart.T + far)
        every = np.vstack([middle, apart])
        error = np.block([[noise(radar), np.zeros((2, len(far)))], [np.zeros((len(far), 2)), far]])
        measured = np.concatenate([z, np.zeros(len(far))])
        both, distance = gaussian(measured - every @ stacked, every @ whole @ every.T + error)
        density = np.logaddexp(density, math.log(share) + both - alone)
        least = min(least, distance - short)
    joint = np.zeros((12, 12))
    for i, (_, p) in enumerate(members):
        joint[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = p
    wide = np.hstack(jacobians) / 3
    gain = joint @ wide.T @ np.linalg.inv(wide @ joint @ wide.T + noise(radar))
    mean = np.concatenate([x for x, _ in members]) + gain @ (z - middle @ stacked)
    after = joint - 0.5 * gain @ wide @ joint
    rows = [slice(4 * i, 4 * i + 4) for i in range(3)]
    return density - math.log(total), least, [(mean[r], after[r, r]) for r in rows], total


def whole_group(states, scan, radar, links):
    """All of three tracks as one group: its joint hypotheses, as :func:`joint_scan` gives them."""
    total = group_of_three(states, links, scan[0], radar)[3]
    if total <= LEAST:
        return
    name = tuple(range(3))
    yield math.log(total * (1 - radar.p_group)), (-1,) * 3, {name: -1}, list(states)
    for j, z in enumerate(scan):
        density, d2, after, _ = group_of_three(states, links, np.array(z), radar)
        if d2 <= radar.gate:
            log_weight = math.log(total * radar.p_group / radar.clutter) + density
            yield log_weight, (j,) * 3, {name: j}, after


def joint_scan(states, scan, radar, threes=False):
    """All joint hypotheses of one scan; ``threes``: three tracks may be one group.

    Yields the log weight against false alarms, the detection of each track, the groups as
    {(a, b): detection or -1}, and the states after it.
    """
    n = len(states)
    links = {
        pair: unresolved(states[pair[0]], states[pair[1]], radar)
        for pair in itertools.combinations(range(n), 2)
    }
    links = {pair: value for pair, value in links.items() if value}
    if threes and len(links) > 1:
        yield from whole_group(states, scan, radar, links)
    for size in range(len(links) + 1):
        for groups in itertools.combinations(links, size):
            members = [m for pair in groups for m in pair]
            if len(set(members)) < len(members):
                continue
            units = [*groups, *((i,) for i in range(n) if i not in members)]
            for taken in itertools.product(range(-1, len(scan)), repeat=len(units)):
                used = [j for j in taken if j >= 0]
                if len(set(used)) < len(used):
                    continue
                log_weight, after, detection = 0.0, list(states), [-1] * n
                for pair, value in links.items():
                    log_weight += math.log(value if pair in groups else 1 - value)
                for unit, j in zip(units, taken, strict=True):
                    p_d = radar.p_d if len(unit) == 1 else radar.p_group
                    if j < 0:
                        log_weight += math.log(1 - p_d)
                        continue
                    z = np.array(scan[j])
                    if len(unit) == 1:
                        density, d2, state = single(*states[unit[0]], z, radar)
                        found = (state,)
                    else:
                        density, d2, found = group(states[unit[0]], states[unit[1]], z, radar)
                    if d2 > radar.gate:
                        log_weight = -math.inf
                        break
                    log_weight += math.log(p_d / radar.clutter) + density
                    for member, state in zip(unit, found, strict=True):
                        after[member], detection[member] = state, j
                if log_weight > -math.inf:
                    shared = dict(zip(units[: len(groups)], taken, strict=False))
                    yield log_weight, tuple(detection), shared, after
