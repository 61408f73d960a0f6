"""Exact paths of targets: straight legs and coordinated turns, without integration error."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.world_sections import Target
from gda_tracker.vocabulary.arrays import FloatArray

STANDARD_GRAVITY_MPS2 = 9.80665


def target_states(target: Target, times_s: FloatArray, scan_period_s: float) -> FloatArray:
    """States of one target at given times.

    The speed v is constant but for stops, which are on straight paths. A turn with lateral
    acceleration a has the rate omega = +a/v (left) or
    -a/v (right). With the heading psi counter-clockwise from North the velocity is
    v (-sin psi, cos psi), so that a turn from psi0 moves the position by
    (v/omega) (cos psi - cos psi0, sin psi - sin psi0).

    Parameters
    ----------
    target : Target
        Start, speed, heading and turns.
    times_s : (K,) array
        Times since scan 1, in s, in any order.
    scan_period_s : float
        Time between scans, in s; scan k is at (k - 1) periods.

    Returns
    -------
    (K, 4) array
        x East, y North [m], vx, vy [m/s].
    """
    times_s = np.asarray(times_s, dtype=np.float64)
    if target.stops:
        return _stop_and_go(target, times_s, scan_period_s)
    speed = target.speed_mps
    starts, rates = _legs(target, scan_period_s)
    states = np.empty((len(times_s), 4))
    x, y = target.initial_position_m
    heading = math.radians(target.initial_heading_deg_ccw_from_north)
    for index, (start, rate) in enumerate(zip(starts, rates, strict=True)):
        last = index + 1 == len(starts)
        end = math.inf if last else starts[index + 1]
        inside = (times_s >= start) | (index == 0)
        states[inside] = _move(x, y, heading, speed, rate, times_s[inside] - start)
        if not last:
            x, y, _, _ = _move(x, y, heading, speed, rate, np.array([end - start]))[0]
            heading += rate * (end - start)
    return states


def true_states(scenario: Scenario) -> FloatArray:
    """States of all targets at all scans, (n_scans, n_targets, 4): x, y [m], vx, vy [m/s]."""
    times = np.arange(scenario.time.n_scans, dtype=np.float64) * scenario.time.scan_period_s
    paths = [target_states(t, times, scenario.time.scan_period_s) for t in scenario.targets]
    return np.stack(paths, axis=1)


def _stop_and_go(target: Target, times_s: FloatArray, scan_period_s: float) -> FloatArray:
    """States (K, 4) of a target on a straight path that stops now and then."""
    v = target.speed_mps
    way, speed = v * times_s, np.full(len(times_s), v)
    for stop in target.stops:
        a = stop.braking_mps2
        begin, end = ((k - 1.0) * scan_period_s for k in (stop.start_scan, stop.end_scan))
        braked = np.clip(times_s - begin, 0.0, v / a)
        stood = np.maximum(np.minimum(times_s, end) - begin - v / a, 0.0)
        resumed = np.clip(times_s - end, 0.0, v / a)
        # What is lost of the way on each of the three.
        way -= 0.5 * a * braked**2 + v * stood + resumed * (v - 0.5 * a * resumed)
        speed -= a * braked - a * resumed
    heading = math.radians(target.initial_heading_deg_ccw_from_north)
    along = np.array([-math.sin(heading), math.cos(heading)])
    start = np.array(target.initial_position_m)
    return np.hstack([start + way[:, None] * along, speed[:, None] * along])


def _legs(target: Target, scan_period_s: float) -> tuple[list[float], list[float]]:
    """Start times and turn rates of all legs, straight ones between the turns."""
    starts, rates = [0.0], [0.0]
    for turn in target.manoeuvres:
        side = 1.0 if turn.turn == "left" else -1.0
        rate = side * turn.lateral_acceleration_g * STANDARD_GRAVITY_MPS2 / target.speed_mps
        starts += [(turn.start_scan - 1.0) * scan_period_s, (turn.end_scan - 1.0) * scan_period_s]
        rates += [rate, 0.0]
    return starts, rates


def _move(
    x: float, y: float, heading: float, speed: float, rate: float, elapsed: FloatArray
) -> FloatArray:
    """States after ``elapsed`` s on one leg, (K, 4)."""
    angle = heading + rate * elapsed
    vx, vy = -speed * np.sin(angle), speed * np.cos(angle)
    # Chord of the turn: exact, and its limit is the straight line, without a division by the rate.
    middle = heading + 0.5 * rate * elapsed
    chord = speed * elapsed * np.sinc(0.5 * rate * elapsed / np.pi)
    return np.stack([x - chord * np.sin(middle), y + chord * np.cos(middle), vx, vy], axis=1)
