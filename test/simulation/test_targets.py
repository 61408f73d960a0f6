"""Paths of targets against geometry and against numerical integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.targets import STANDARD_GRAVITY_MPS2, target_states, true_states
from gda_tracker.simulation.world_sections import Manoeuvre, Target


def make_target(*manoeuvres: Manoeuvre, heading: float = 0.0, speed: float = 250.0) -> Target:
    return Target(
        id=1,
        class_name="fighter",
        rcs_mean_m2=1.2,
        rcs_swerling=3,
        initial_position_m=(1000.0, 2000.0),
        speed_mps=speed,
        initial_heading_deg_ccw_from_north=heading,
        manoeuvres=manoeuvres,
    )


@pytest.mark.parametrize(
    ("heading", "direction"),
    [(0.0, (0.0, 1.0)), (90.0, (-1.0, 0.0)), (180.0, (0.0, -1.0)), (270.0, (1.0, 0.0))],
)
def test_heading_is_counter_clockwise_from_north(heading, direction):
    states = target_states(make_target(heading=heading), np.array([0.0, 4.0]), 5.0)
    np.testing.assert_allclose(states[:, 2:], [np.multiply(250.0, direction)] * 2, atol=1e-10)
    np.testing.assert_allclose(
        states[1, :2], np.add([1000.0, 2000.0], np.multiply(1000.0, direction)), atol=1e-9
    )


@pytest.mark.parametrize(("turn", "sign"), [("left", 1.0), ("right", -1.0)])
def test_a_turn_has_radius_v2_over_a_and_the_angle_a_t_over_v(turn, sign):
    acceleration = 2.5 * STANDARD_GRAVITY_MPS2
    target = make_target(Manoeuvre(10.0, 14.0, 2.5, turn), heading=37.0)
    times = np.linspace(45.0, 65.0, 41)
    states = target_states(target, times, 5.0)
    radius = 250.0**2 / acceleration
    # The centre lies at right angles to the velocity, to the left for a left turn.
    left = np.stack([-states[:, 3], states[:, 2]], axis=1) / 250.0
    centres = states[:, :2] + sign * radius * left
    np.testing.assert_allclose(centres, np.broadcast_to(centres[0], centres.shape), atol=1e-7)
    heading = np.unwrap(np.arctan2(-states[:, 2], states[:, 3]))
    assert heading[-1] - heading[0] == pytest.approx(sign * acceleration * 20.0 / 250.0, abs=1e-12)
    assert math.degrees(heading[-1] - heading[0]) == pytest.approx(sign * 112.4, abs=0.05)


def test_speed_is_constant_through_all_turns():
    for name, speed in [("crossing_targets", 250.0), ("closely_spaced_targets", 100.0)]:
        states = true_states(load_scenario(name))
        np.testing.assert_allclose(np.hypot(states[..., 2], states[..., 3]), speed, rtol=1e-14)


def test_path_equals_numerical_integration_with_fractional_scans():
    turns = (Manoeuvre(2.3, 4.0, 0.85, "right"), Manoeuvre(4.0, 7.5, 1.7, "left"))
    target = make_target(*turns, heading=155.0, speed=100.0)

    def rate(t: float) -> float:
        scan = 1.0 + t / 5.0
        for turn in turns:
            if turn.start_scan <= scan < turn.end_scan:
                side = 1.0 if turn.turn == "left" else -1.0
                return side * turn.lateral_acceleration_g * STANDARD_GRAVITY_MPS2 / 100.0
        return 0.0

    def flow(t: float, s: np.ndarray) -> list[float]:
        return [-100.0 * math.sin(s[2]), 100.0 * math.cos(s[2]), rate(t)]

    times = np.linspace(0.0, 45.0, 19)
    start = [1000.0, 2000.0, math.radians(155.0)]
    expected = solve_ivp(flow, (0.0, 45.0), start, t_eval=times, max_step=0.01, rtol=1e-9)
    states = target_states(target, times, 5.0)
    np.testing.assert_allclose(states[:, :2], expected.y[:2].T, atol=0.5)


def test_crossing_separations_are_the_published_reconstruction():
    states = true_states(load_scenario("crossing_targets"))
    separation = states[9:15, 0, 1] - states[9:15, 1, 1]
    # The file gives start positions rounded to a metre, so a separation is known to about one.
    np.testing.assert_allclose(separation, [1237, -36, -159, 896, 2881, 5189], atol=1.5)


def test_closely_spaced_targets_keep_their_gaps():
    states = true_states(load_scenario("closely_spaced_targets"))
    gaps = np.linalg.norm(np.diff(states[..., :2], axis=1), axis=2)
    np.testing.assert_allclose(gaps, np.broadcast_to([450.0, 600.0, 450.0], gaps.shape), atol=1.0)
