"""White noise in continuous time, constant acceleration, van Keuk, Singer: integrals and laws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from gda_tracker.kinematics.motion_models import (
    constant_acceleration,
    constant_velocity,
    embedded,
    singer,
    van_keuk,
    white_noise_acceleration,
)

steps = st.floats(0.0, 60.0)
MODELS = {
    "white_noise_acceleration": lambda dt, d=2: white_noise_acceleration(dt, 3.0, d),
    "constant_acceleration": lambda dt, d=2: constant_acceleration(dt, 0.7, d),
    "singer": lambda dt, d=2: singer(dt, 4.0, 12.0, d),
}


def by_matrix_exponential(drift, diffusion, dt):
    """F and Q of x' = A x + white noise by van Loan's block matrix."""
    n = len(drift)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -drift, diffusion, drift.T
    whole = expm(block * dt)
    transition = whole[n:, n:].T
    return transition, transition @ whole[:n, n:]


@pytest.mark.parametrize("dt", [0.05, 1.0, 5.0, 20.0])
def test_continuous_models_equal_the_matrix_exponential(dt):
    cases = [
        (white_noise_acceleration(dt, 3.0, 1), np.diag([1.0], 1), np.diag([0.0, 3.0])),
        (
            constant_acceleration(dt, 0.7, 1),
            np.diag([1.0, 1.0], 1),
            np.diag([0.0, 0.0, 0.7]),
        ),
    ]
    for theta in (3.0, 12.0, 400.0):
        drift = np.diag([1.0, 1.0], 1)
        drift[2, 2] = -1.0 / theta
        cases.append((singer(dt, 4.0, theta, 1), drift, np.diag([0.0, 0.0, 32.0 / theta])))
    for (transition, noise), drift, diffusion in cases:
        f, q = by_matrix_exponential(drift, diffusion, dt)
        np.testing.assert_allclose(transition, f, rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(noise, q, rtol=1e-7)


@pytest.mark.parametrize("units", [1e-6, 1e-3, 0.3, 0.999, 1.0, 2.7, 39.9, 40.1, 300.0])
def test_singer_equals_quadrature_at_any_step(units):
    """Entry by entry with an adaptive rule; for short steps by the leading power of the step."""
    theta, q = 10.0, 2.0
    dt = units * theta
    _, noise = singer(dt, q, theta, 1)
    if units < 1e-2:
        density = 2.0 * q * q / theta
        expected = constant_acceleration(dt, density, 1)[1]
        np.testing.assert_allclose(noise, expected, rtol=2.0 * units)
        return

    def column(u):
        e = np.exp(-u)
        return np.array([theta**2 * (u - 1.0 + e), theta * (1.0 - e), e])

    for i in range(3):
        for j in range(3):
            integral, _ = quad(
                lambda u, i=i, j=j: column(u)[i] * column(u)[j] * theta,
                0.0,
                units,
                epsrel=1e-12,
                limit=400,
                points=[1.0] if units > 1.0 else None,
            )
            assert noise[i, j] == pytest.approx(2.0 * q * q / theta * integral, rel=1e-9)


@settings(derandomize=True, deadline=None)
@given(st.sampled_from(sorted(MODELS)), steps, steps)
def test_two_steps_are_one_of_their_length(name, first, second):
    """F(b) F(a) = F(a + b), and the noise composes as well."""
    (fa, qa), (fb, qb) = MODELS[name](first), MODELS[name](second)
    f, q = MODELS[name](first + second)
    np.testing.assert_allclose(fb @ fa, f, rtol=1e-12, atol=1e-9)
    scale = np.sqrt(np.outer(np.diag(q), np.diag(q))) + 1e-300
    np.testing.assert_allclose((fb @ qa @ fb.T + qb) / scale, q / scale, atol=1e-9)


def test_white_acceleration_in_discrete_time_and_van_keuk_do_not_compose():
    """What sets them apart from the models in continuous time."""
    fa, qa = constant_velocity(2.0, 3.0)
    assert not np.allclose(fa @ qa @ fa.T + qa, constant_velocity(4.0, 3.0)[1], rtol=0.01)
    fa, _ = van_keuk(2.0, 4.0, 12.0)
    assert not np.allclose(fa @ fa, van_keuk(4.0, 4.0, 12.0)[0], rtol=1e-3)


def test_van_keuk_worked_values():
    """Koch 2014, (2.5), (2.6) with dt = theta ln 2, so that e = 1/2."""
    transition, noise = van_keuk(10.0 * np.log(2.0), 4.0, 10.0, 1)
    t = 10.0 * np.log(2.0)
    np.testing.assert_allclose(transition, [[1, t, t * t / 2], [0, 1, t], [0, 0, 0.5]], rtol=1e-14)
    np.testing.assert_allclose(noise, np.diag([0.0, 0.0, 16.0 * 0.75]), rtol=1e-14)


@pytest.mark.parametrize("model", [van_keuk, singer])
@pytest.mark.parametrize("dt", [0.5, 7.0])
def test_acceleration_keeps_its_variance_and_correlation(model, dt):
    """Stationary: e^2 q^2 + D33 = q^2; the covariance over a step is q^2 exp(-dt/theta) (2.7)."""
    transition, noise = model(dt, 3.0, 8.0, 2)
    a = slice(4, 6)
    np.testing.assert_allclose(
        9.0 * transition[a, a] @ transition[a, a] + noise[a, a], 9 * np.eye(2)
    )
    np.testing.assert_allclose(9.0 * transition[a, a], 9.0 * np.exp(-dt / 8.0) * np.eye(2))


def test_singer_between_white_acceleration_and_constant_acceleration():
    """Short correlation: white acceleration of density 2 q^2 theta; long: constant acceleration."""
    _, noise = singer(10.0, 2.0, 1e-4, 1)
    _, white = white_noise_acceleration(10.0, 2.0 * 2.0**2 * 1e-4, 1)
    np.testing.assert_allclose(noise[:2, :2], white, rtol=1e-4)
    np.testing.assert_allclose(
        singer(10.0, 2.0, 1e9, 1)[0], constant_acceleration(10.0, 0.0, 1)[0], rtol=1e-7, atol=1e-7
    )


@settings(derandomize=True, deadline=None)
@given(st.sampled_from([*sorted(MODELS), "van_keuk"]), steps, st.integers(1, 3))
def test_noise_is_symmetric_and_semidefinite(name, dt, dimension):
    made = van_keuk(dt, 4.0, 9.0, dimension) if name == "van_keuk" else MODELS[name](dt, dimension)
    transition, noise = made
    order = 2 if name == "white_noise_acceleration" else 3
    assert transition.shape == noise.shape == (order * dimension, order * dimension)
    np.testing.assert_allclose(noise, noise.T, rtol=1e-14)
    scale = np.sqrt(np.diag(noise)) + 1e-150
    assert np.linalg.eigvalsh(noise / np.outer(scale, scale)).min() > -1e-9
    # The coordinates do not mix: every one has the model of one alone.
    one_f, one_q = van_keuk(dt, 4.0, 9.0, 1) if name == "van_keuk" else MODELS[name](dt, 1)
    for c in range(dimension):
        np.testing.assert_array_equal(transition[c::dimension, c::dimension], one_f)
        np.testing.assert_array_equal(noise[c::dimension, c::dimension], one_q)


def test_embedded_model_moves_what_it_knows_and_draws_the_rest():
    transition, noise = embedded(*constant_velocity(2.0, 1.5), 6, np.array([3.0, 4.0]))
    f, q = constant_velocity(2.0, 1.5)
    np.testing.assert_array_equal(transition[:4, :4], f)
    np.testing.assert_array_equal(noise[:4, :4], q)
    state = np.array([1.0, 2.0, 3.0, 4.0, 50.0, 60.0])
    np.testing.assert_array_equal(transition @ state, [7.0, 10.0, 3.0, 4.0, 0.0, 0.0])
    np.testing.assert_array_equal(np.diag(noise)[4:], [9.0, 16.0])
    assert not noise[:4, 4:].any()


@pytest.mark.parametrize(
    ("size", "extra"), [(6, [1.0]), (3, []), (5, [0.0]), (5, [-1.0]), (5, [np.nan])]
)
def test_embedding_refuses_what_does_not_fit(size, extra):
    with pytest.raises(ValueError, match="extra_std"):
        embedded(*constant_velocity(1.0, 1.0), size, np.array(extra))


@pytest.mark.parametrize("model", [*MODELS.values(), lambda dt: van_keuk(dt, 1.0, 5.0)])
def test_no_time_no_change_and_read_only(model):
    transition, noise = model(0.0)
    np.testing.assert_array_equal(transition, np.eye(len(transition)))
    np.testing.assert_array_equal(noise, np.zeros_like(noise))
    with pytest.raises(ValueError, match="read-only"):
        noise[0, 0] = 1.0
