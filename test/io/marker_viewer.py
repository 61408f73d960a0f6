"""A viewer of markers that is as strict as RViz: what it refuses fails the test."""

from __future__ import annotations

import math

import numpy as np
from visualization_msgs.msg import Marker

SOLID = (Marker.SPHERE, Marker.CYLINDER, Marker.SPHERE_LIST)


class Viewer:
    """Shows what has come on the topic of one layer.

    ``from_the_start``: it has had every message; over DDS the first ones may pass it by.
    """

    def __init__(self, from_the_start=True):
        self.shown, self._from_the_start = {}, from_the_start
        self.messages = 0

    def take(self, array):
        self.messages += 1
        names = [(m.ns, m.id) for m in array.markers if m.action != Marker.DELETEALL]
        assert len(names) == len(set(names)), "a marker stands twice in one array"
        for marker in array.markers:
            if marker.action == Marker.DELETEALL:
                self.shown.clear()
            elif marker.action == Marker.DELETE:
                there = self.shown.pop((marker.ns, marker.id), None)
                assert there or not self._from_the_start, "deletes what is not shown"
            else:
                assert marker.action == Marker.ADD
                self._check(marker)
                self.shown[marker.ns, marker.id] = marker

    @staticmethod
    def _check(m):
        assert m.header.frame_id
        at, turn, size, colour = m.pose.position, m.pose.orientation, m.scale, m.color
        numbers = [at.x, at.y, at.z, size.x, size.y, size.z, colour.r, colour.g, colour.b, colour.a]
        points = np.array([(p.x, p.y, p.z) for p in m.points]).reshape(-1, 3)
        assert np.isfinite(numbers).all()
        assert np.isfinite(points).all()
        norm = math.sqrt(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2)
        assert math.isclose(norm, 1.0, abs_tol=1e-9)
        assert 0.0 < colour.a <= 1.0
        if m.type in SOLID or m.type == Marker.ARROW:
            assert min(size.x, size.y, size.z) > 0.0
        if m.type in (Marker.LINE_STRIP, Marker.LINE_LIST):
            assert size.x > 0.0
            assert len(points) >= 2
        if m.type == Marker.LINE_LIST:
            assert len(points) % 2 == 0
        if m.type == Marker.SPHERE_LIST:
            assert len(points)
        if m.type == Marker.TEXT_VIEW_FACING:
            assert size.z > 0.0
            assert m.text.strip()

    def ids(self, namespace=None):
        return sorted(number for ns, number in self.shown if namespace in (None, ns))

    def points(self, name):
        return np.array([(p.x, p.y) for p in self.shown[name].points])
