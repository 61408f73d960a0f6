"""All association histories of a few tracks over a few scans, by plain recursion and filters.

Nothing of the tracker is used: an extended Kalman filter of single states, Bayes' rule on class
probabilities, and joint hypotheses scan by scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Model:
    """Sensor, motion and classes; ``likelihood``: RCS to one density per class, 0 the clutter."""

    dt_s: float
    process_noise: float
    range_std: float
    azimuth_std: float
    p_d: float
    clutter: float
    gate: float
    likelihood: object = None


@dataclass
class Node:
    """A track after an association history."""

    mean: np.ndarray
    covariance: np.ndarray
    classes: np.ndarray | None
    log_score: float = 0.0


@dataclass
class Enumeration:
    """``leaves``: by track and history (detection per scan, -1 none); ``joint``: the same for all
    tracks at once, with log weight against all detections being false alarms."""

    leaves: list[dict] = field(default_factory=list)
    joint: dict = field(default_factory=dict)


def step(node: Node, detection, model: Model) -> Node | None:
    """The track one scan later with a detection (range, azimuth, RCS), or None for a miss."""
    t, q = model.dt_s, model.process_noise**2
    f = np.eye(4)
    f[0, 2] = f[1, 3] = t
    g = np.array([[t * t / 2, 0], [0, t * t / 2], [t, 0], [0, t]])
    x, p = f @ node.mean, f @ node.covariance @ f.T + q * g @ g.T
    if detection is None:
        return Node(x, p, node.classes, node.log_score + math.log(1 - model.p_d))
    r2 = x[0] ** 2 + x[1] ** 2
    r = math.sqrt(r2)
    h = np.array([[x[0] / r, x[1] / r, 0, 0], [-x[1] / r2, x[0] / r2, 0, 0]])
    s = h @ p @ h.T + np.diag([model.range_std**2, model.azimuth_std**2])
    v = np.array([detection[0] - r, detection[1] - math.atan2(x[1], x[0])])
    d2 = float(v @ np.linalg.solve(s, v))
    if d2 > model.gate:
        return None
    gain = p @ h.T @ np.linalg.inv(s)
    score = math.log(model.p_d / model.clutter)
    score += -0.5 * d2 - math.log(2 * math.pi) - 0.5 * math.log(np.linalg.det(s))
    classes = node.classes
    if classes is not None and detection[2] is not None:
        density = model.likelihood(detection[2])
        joint = classes * density
        score += math.log(joint.sum()) - math.log(density[0])
        classes = joint / joint.sum()
    return Node(x + gain @ v, p - gain @ s @ gain.T, classes, node.log_score + score)


def enumerate_histories(starts: list[Node], scans: list[list], model: Model) -> Enumeration:
    """Every leaf of every track, and every joint history in which no detection is used twice."""
    found = Enumeration()
    for start in starts:
        level = {(): start}
        for scan in scans:
            following = {}
            for history, node in level.items():
                for j, detection in [(-1, None), *enumerate(scan)]:
                    after = step(node, detection, model)
                    if after is not None:
                        following[(*history, j)] = after
            level = following
        found.leaves.append(level)

    def extend(track: int, taken: list[set], chosen: tuple, weight: float) -> None:
        if track == len(starts):
            found.joint[chosen] = weight
            return
        for history, node in found.leaves[track].items():
            if any(j in taken[k] for k, j in enumerate(history)):
                continue
            more = [t | {j} if j >= 0 else t for t, j in zip(taken, history, strict=True)]
            extend(track + 1, more, (*chosen, history), weight + node.log_score)

    extend(0, [set() for _ in scans], (), 0.0)
    return found
