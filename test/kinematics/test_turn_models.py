"""Nearly coordinated turn: circles, numeric Jacobians, the limit of a straight line."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.turn_models import coordinated_turn

rates = st.one_of(
    st.floats(-0.5, 0.5), st.sampled_from([0.0, 1e-12, -1e-9, 1e-5, 1.999e-3, 2.001e-3])
)


def moved(state, dt):
    return coordinated_turn(np.atleast_2d(state), dt, 1.0, 0.01)[0][0]


def test_quarter_circle_worked():
    """Speed 100 m/s, 90 degrees in 10 s: radius 2000/pi m, from heading North to West."""
    rate = np.pi / 20.0
    radius = 100.0 / rate
    state = moved([radius, 0.0, 0.0, 100.0, rate], 10.0)
    np.testing.assert_allclose(state, [0.0, radius, -100.0, 0.0, rate], atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(rates, st.floats(0.1, 20.0))
def test_equals_the_differential_equation(rate, dt):
    state = np.array([100.0, -50.0, 30.0, 120.0, -80.0, 5.0, rate])

    def slope(_, s):
        return [s[3], s[4], s[5], -s[6] * s[4], s[6] * s[3], 0.0, 0.0]

    end = solve_ivp(slope, (0.0, dt), state, rtol=1e-11, atol=1e-9).y[:, -1]
    np.testing.assert_allclose(moved(state, dt), end, rtol=1e-8, atol=1e-5)
    flat = np.delete(state, [2, 5])
    np.testing.assert_allclose(moved(flat, dt), np.delete(end, [2, 5]), rtol=1e-8, atol=1e-5)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(rates, st.sampled_from([5, 7]), st.floats(0.5, 10.0))
def test_jacobian_equals_central_differences(rate, size, dt):
    rng = np.random.default_rng(size)
    state = np.concatenate([rng.normal(0, 1e3, (size - 1) // 2), rng.normal(0, 100, size // 2)])
    state = np.append(state, rate)
    _, jacobian, _ = coordinated_turn(state[None], dt, 1.0, 0.01)
    for i in range(size):
        step = np.zeros(size)
        step[i] = 1e-4 if i == size - 1 else 1.0
        numeric = (moved(state + step, dt) - moved(state - step, dt)) / (2 * step[i])
        np.testing.assert_allclose(jacobian[0][:, i], numeric, rtol=1e-4, atol=1e-2)


@settings(derandomize=True, deadline=None)
@given(rates, st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_two_steps_are_one_and_the_speed_stays(rate, first, second):
    state = np.array([10.0, 20.0, 150.0, -90.0, rate])
    both = moved(state, first + second)
    np.testing.assert_allclose(moved(moved(state, first), second), both, atol=1e-6)
    assert np.hypot(*both[2:4]) == pytest.approx(np.hypot(150.0, 90.0), rel=1e-12)


def test_no_turn_is_constant_velocity():
    state = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0]])
    mean, jacobian, noise = coordinated_turn(state, 3.0, 2.0, 0.1)
    f, q = constant_velocity(3.0, 2.0, 3)
    np.testing.assert_allclose(jacobian[0, :6, :6], f, atol=1e-15)
    np.testing.assert_allclose(mean[0, :6], f @ state[0, :6], rtol=1e-15)
    np.testing.assert_array_equal(noise[:6, :6], q)
    assert noise[6, 6] == pytest.approx(0.09)
    # A turn that begins pushes sideways: d(x, y)/dw = T^2/2 (-vy, vx).
    np.testing.assert_allclose(jacobian[0, :2, 6], [4.5 * -5.0, 4.5 * 4.0], rtol=1e-12)


def test_states_of_another_size_are_refused():
    with pytest.raises(ValueError, match="4 components"):
        coordinated_turn(np.zeros((1, 4)), 1.0, 1.0, 1.0)
