"""Extended targets: several detections a scan, from all over an ellipse that points ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.attributes.rcs import sample
from gda_tracker.kinematics.extended.ellipses import extent_of
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.schema import key
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Extent:
    """Section ``extent`` of a target: its outline is an ellipse, its long axis the course."""

    semi_axes_m: tuple[float, float] = key("along and across the course", unit="m")
    mean_detections: float = key(
        "Poisson mean of its detections in a scan in which it is detected",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1000.0,
    )

    def __post_init__(self) -> None:
        """Refuse an ellipse without an area."""
        if not min(self.semi_axes_m) > 0.0:
            along, across = self.semi_axes_m
            raise ParameterError(
                f"semi_axes_m = [{along:g}, {across:g}]: allowed are two numbers > 0"
            )


@dataclass(frozen=True)
class ExtendedKnowledge:
    """Section ``extended``: what the tracker is told about extended targets."""

    max_speed_mps: float = key("of a target", unit="m/s", minimum=0.0, minimum_excluded=True)
    match_distance_m: float = key(
        "how far a track may be from its target", unit="m", minimum=0.0, minimum_excluded=True
    )
    cell_least_distance_m: float = key("always one object", unit="m", minimum=0.0)
    cell_largest_distance_m: float = key("one object without a larger gap", unit="m", minimum=0.0)
    extent_radius_m: float = key("expected radius", unit="m", minimum=0.0)
    detections_per_object: float = key("expected of a new object", minimum=0.0)
    extent_memory_s: float = key("for which size and shape are known", unit="s", minimum=0.0)

    def parameters(self) -> dict[str, Any]:
        """Parameters of the track manager."""
        names = (
            "cell_least_distance_m",
            "cell_largest_distance_m",
            "extent_radius_m",
            "detections_per_object",
            "extent_memory_s",
        )
        return {
            "max_speed_mps": self.max_speed_mps,
            "extraction": "sequential",
            "extended_objects": "random_matrix",
            **{name: getattr(self, name) for name in names},
        }


def true_extents(states: FloatArray, extents: tuple[Extent | None, ...]) -> FloatArray:
    """Matrices (K, T, 2, 2) [m2] of targets with states (K, T, 4), zeros for points."""
    axes = np.array([(0.0, 0.0) if e is None else e.semi_axes_m for e in extents])
    course = np.arctan2(states[..., 3], states[..., 2])
    return extent_of(np.broadcast_to(axes, (*course.shape, 2)), course)


def detections_of(
    states: FloatArray,
    extents: tuple[Extent | None, ...],
    rcs_mean_m2: FloatArray,
    rcs_swerling: IntArray,
    seen: BoolArray,
    streams: list[np.random.Generator],
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Draw where the targets that are seen reflect.

    Parameters
    ----------
    states, extents
        (K, T, 4) states and the extents (T,) of the targets; a point gives one detection.
    rcs_mean_m2, rcs_swerling
        (T,) of the whole target; each detection has its share, and fluctuates on its own.
    seen
        (K, T) whether a target is seen.
    streams
        Of cross sections, and of extents.

    Returns
    -------
    scan, target, position, rcs
        (m,), (m,), (m, 2) [m] and (m,) [m2].
    """
    rcs_stream, rng = streams
    mean = np.array([1.0 if e is None else e.mean_detections for e in extents])
    point = np.array([e is None for e in extents])
    count = rng.poisson(np.broadcast_to(mean, seen.shape))
    count = np.where(point, 1, count) * seen
    scan, target = np.nonzero(count)
    number = count[scan, target]
    scan, target = np.repeat(scan, number), np.repeat(target, number)
    radius = np.sqrt(rng.uniform(0.0, 1.0, len(scan)))
    turn = rng.uniform(0.0, 2.0 * math.pi, len(scan))
    axes = np.array([(0.0, 0.0) if e is None else e.semi_axes_m for e in extents])[target]
    along, across = (radius * np.cos(turn) * axes[:, 0], radius * np.sin(turn) * axes[:, 1])
    own = states[scan, target]
    ahead = np.arctan2(own[:, 3], own[:, 2])
    offset = np.stack(
        [
            along * np.cos(ahead) - across * np.sin(ahead),
            along * np.sin(ahead) + across * np.cos(ahead),
        ],
        axis=1,
    )
    share = rcs_mean_m2[target] / mean[target]
    rcs = sample(rcs_stream, share, rcs_swerling[target], len(scan))
    return scan, target, own[:, :2] + offset, rcs
