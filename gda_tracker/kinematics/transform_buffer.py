"""Transforms between frames as they come, and what they were at a time: a tree with a history.

The frames form a tree: each has at most one parent, and the transform between the two is fixed or
has a history. A look-up walks from both frames up to the one that they share. Between two times a
transform is interpolated; beyond the first and the last it is never made up.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.kinematics.rigid_transforms import RigidTransform, interpolate, rotation_matrix
from gda_tracker.vocabulary.arrays import FloatArray

NANOSECONDS = 1_000_000_000
# A step back of a history by more than this is taken for a clock that was set back (a bag loops).
JUMP_NS = NANOSECONDS
# How far the length of a quaternion may be off one before the transform is refused.
QUATERNION_TOLERANCE = 1e-3
# Reasons that time may mend: the transform may still be on its way.
MAY_STILL_COME = ("unknown_frame", "not_connected", "too_late")


class TransformError(UserError):
    """A transform is not to be had; ``reason`` is one word for counters.

    ``unknown_frame``, ``not_connected`` (no common frame), ``loop`` (a frame is its own ancestor),
    ``too_early`` and ``too_late`` (would have to be extrapolated), ``unavailable`` (there are no
    transforms at all).
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


@dataclass(slots=True)
class _Link:
    """A frame's transform to its parent: one for all times, or one per stamp."""

    parent: str
    fixed: RigidTransform | None = None
    stamps: list[int] = field(default_factory=list)
    transforms: dict[int, RigidTransform] = field(default_factory=dict)

    def at(self, child: str, stamp_ns: int) -> RigidTransform:
        if self.fixed is not None:
            return self.fixed
        place = bisect_left(self.stamps, stamp_ns)
        if place < len(self.stamps) and self.stamps[place] == stamp_ns:
            return self.transforms[stamp_ns]
        link = f"{self.parent} to {child}"
        if place == 0:
            early = (self.stamps[0] - stamp_ns) / NANOSECONDS
            raise TransformError(
                "too_early", f"transform {link}: asked for {early:.3f} s before the first known"
            )
        if place == len(self.stamps):
            late = (stamp_ns - self.stamps[-1]) / NANOSECONDS
            raise TransformError(
                "too_late", f"transform {link}: asked for {late:.3f} s after the last known"
            )
        before, after = self.stamps[place - 1], self.stamps[place]
        share = (stamp_ns - before) / (after - before)
        return interpolate(self.transforms[before], self.transforms[after], share)


class TransformBuffer:
    """The tree of frames.

    Parameters
    ----------
    keep_s
        How long a history reaches back from its last stamp [s].
    """

    def __init__(self, keep_s: float = 10.0) -> None:
        self._keep_ns = math.inf if math.isinf(keep_s) else round(keep_s * NANOSECONDS)
        self._links: dict[str, _Link] = {}

    def frames(self) -> list[str]:
        """Return all frames by name."""
        return sorted(set(self._links) | {link.parent for link in self._links.values()})

    def clear(self) -> None:
        """Forget all histories; what is fixed stays."""
        self._links = {c: link for c, link in self._links.items() if link.fixed is not None}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        transform: RigidTransform,
        fixed: bool = False,
    ) -> str:
        """Take a transform from ``child`` to ``parent`` in.

        Returns
        -------
        str
            Nothing, or what was special: ``tf_refused`` (names, numbers or quaternion are none),
            ``tf_new_parent`` (the history begins anew) or ``tf_jumped_back`` (the clock was set
            back: all histories begin anew).
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        sound = self._sound(transform)
        if not parent or not child or parent == child or sound is None:
            return "tf_refused"
        link, special = self._links.get(child), ""
        if link is not None and link.parent != parent:
            link, special = None, "tf_new_parent"
        if fixed:
            self._links[child] = _Link(parent, fixed=sound)
            return special
        if link is not None and link.stamps and stamp_ns < link.stamps[-1] - JUMP_NS:
            self.clear()
            link, special = None, "tf_jumped_back"
        if link is None or link.fixed is not None:
            link = self._links[child] = _Link(parent)
        if stamp_ns not in link.transforms:
            insort(link.stamps, stamp_ns)
        link.transforms[stamp_ns] = sound
        self._prune(link)
        return special

    @staticmethod
    def _sound(transform: RigidTransform) -> RigidTransform | None:
        """Return the transform with a rotation of length one, ``None`` if it is none."""
        length = float(np.linalg.norm(transform.rotation))
        # NaN fails the comparison.
        if not (
            abs(length - 1.0) <= QUATERNION_TOLERANCE and np.isfinite(transform.translation).all()
        ):
            return None
        return RigidTransform(transform.translation, transform.rotation / length)

    def _prune(self, link: _Link) -> None:
        oldest = link.stamps[-1] - self._keep_ns
        # One stamp before the oldest stays, to interpolate from.
        while len(link.stamps) > 2 and link.stamps[1] < oldest:
            del link.transforms[link.stamps.pop(0)]

    def _path(self, frame: str) -> list[str]:
        """Return the frame and its ancestors."""
        path = [frame]
        while (link := self._links.get(path[-1])) is not None:
            if link.parent in path:
                raise TransformError(
                    "loop", f"transforms go round in a circle: {' to '.join([*path, link.parent])}"
                )
            path.append(link.parent)
        return path

    def lookup(self, target: str, source: str, stamp_ns: int) -> RigidTransform:
        """Return what takes points of ``source`` into ``target`` at a time.

        Raises
        ------
        TransformError
            If it is not known for this time.
        """
        target, source = target.lstrip("/"), source.lstrip("/")
        if target == source:
            return RigidTransform()
        known = self.frames()
        for name in (source, target):
            if name not in known:
                raise TransformError(
                    "unknown_frame",
                    f"frame {name or '(empty)'}: no transform names it; known are "
                    f"{', '.join(known) or 'none'}",
                )
        up, down = self._path(source), self._path(target)
        shared = next((name for name in up if name in down), None)
        if shared is None:
            raise TransformError(
                "not_connected",
                f"no transform leads from {source} (below {up[-1]}) to {target} (below {down[-1]})",
            )

        def climb(path: list[str]) -> RigidTransform:
            found = RigidTransform()
            for name in path[: path.index(shared)]:
                found = self._links[name].at(name, stamp_ns).after(found)
            return found

        return climb(down).inverse().after(climb(up))

    def velocity(self, target: str, source: str, stamp_ns: int, interval_s: float) -> FloatArray:
        """Return the velocity (3,) [m/s] of the origin of ``source``, along the axes of ``source``.

        It is the mean over the last ``interval_s`` before the time, as seen from ``target``.

        Raises
        ------
        TransformError
            As :meth:`lookup`.
        """
        interval_ns = round(interval_s * NANOSECONDS)
        now = self.lookup(target, source, stamp_ns)
        before = self.lookup(target, source, stamp_ns - interval_ns)
        moved = (now.translation - before.translation) * (NANOSECONDS / interval_ns)
        return rotation_matrix(now.rotation).T @ moved
