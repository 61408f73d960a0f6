"""Motion models: how a state moves between two scans.

A state holds all positions, then all velocities, then all accelerations where the model has them:
in the plane ``[x, y, vx, vy]``. The matrices are cached and read-only.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import leggauss

from gda_tracker.vocabulary.arrays import FloatArray

CV, IMM, GPB2 = "cv", "imm", "gpb2"
FILTERS = (CV, IMM, GPB2)
# Gauss-Legendre quadrature on [-1, 1].
_NODES, _NODE_WEIGHTS = (np.asarray(a, dtype=np.float64) for a in leggauss(20))


@lru_cache(maxsize=256)
def constant_velocity(
    dt_s: float, process_noise_std_mps2: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Constant velocity driven by white acceleration in discrete time, one value per step.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    process_noise_std_mps2
        Standard deviation sigma_v of the acceleration, which is constant within a step [m/s2].
    dimension
        Number of position coordinates.

    Returns
    -------
    F, Q
        (s, s) with s = 2 ``dimension``; read-only, since they are cached.

    Notes
    -----
    Tchamova et al. 2004, section 14.2.2: Q = sigma_v^2 [[T^4/4, T^3/2], [T^3/2, T^2]] per
    coordinate.
    """
    step = np.array([[1.0, dt_s], [0.0, 1.0]])
    effect = np.array([process_noise_std_mps2 * dt_s**2 / 2.0, process_noise_std_mps2 * dt_s])
    return _per_coordinate(step, effect[:, None] * effect, dimension)


@lru_cache(maxsize=256)
def standstill(
    dt_s: float, velocity_std_mps: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """A target that stands: its velocity is small and drawn anew on every step.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    velocity_std_mps
        Standard deviation sigma of the velocity, constant within a step [m/s].
    dimension
        Number of position coordinates.

    Returns
    -------
    F, Q
        (s, s) with s = 2 ``dimension``; read-only, since they are cached. Per coordinate
        F = [[1, 0], [0, 0]] and Q = sigma^2 [[dt^2, dt], [dt, 1]]: whatever speed it had, it has
        lost it.
    """
    step = np.array([[1.0, 0.0], [0.0, 0.0]])
    effect = np.array([velocity_std_mps * dt_s, velocity_std_mps])
    return _per_coordinate(step, effect[:, None] * effect, dimension)


@lru_cache(maxsize=256)
def white_noise_acceleration(
    dt_s: float, acceleration_density_m2ps3: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Constant velocity driven by white acceleration in continuous time.

    Two steps make the same as one of their length, which is not so with
    :func:`constant_velocity`, whose acceleration is constant within each step.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    acceleration_density_m2ps3
        Power spectral density of the acceleration [m2/s3], >= 0.
    dimension
        Number of position coordinates.

    Returns
    -------
    F, Q
        (s, s) with s = 2 ``dimension``: Q = density [[T^3/3, T^2/2], [T^2/2, T]] per coordinate.
    """
    step = np.array([[1.0, dt_s], [0.0, 1.0]])
    noise = np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
    return _per_coordinate(step, acceleration_density_m2ps3 * noise, dimension)


@lru_cache(maxsize=256)
def constant_acceleration(
    dt_s: float, jerk_density_m2ps5: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Constant acceleration driven by white jerk in continuous time.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    jerk_density_m2ps5
        Power spectral density of the jerk [m2/s5], >= 0.
    dimension
        Number of position coordinates.

    Returns
    -------
    F, Q
        (s, s) with s = 3 ``dimension``: positions, velocities, accelerations.
    """
    t = dt_s
    step = np.array([[1.0, t, t * t / 2.0], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
    noise = np.array(
        [
            [t**5 / 20.0, t**4 / 8.0, t**3 / 6.0],
            [t**4 / 8.0, t**3 / 3.0, t**2 / 2.0],
            [t**3 / 6.0, t**2 / 2.0, t],
        ]
    )
    return _per_coordinate(step, jerk_density_m2ps5 * noise, dimension)


@lru_cache(maxsize=256)
def van_keuk(
    dt_s: float, acceleration_std_mps2: float, correlation_time_s: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Correlated acceleration as van Keuk models it.

    The acceleration is a stationary Gauss-Markov process of standard deviation q and correlation
    time theta; position and velocity move as if it were constant within the step. Hence two steps
    are not one of their length: for scans at irregular times use :func:`singer`.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    acceleration_std_mps2
        Standard deviation q of the acceleration in each coordinate [m/s2], >= 0.
    correlation_time_s
        Manoeuvre correlation time theta [s], > 0.
    dimension
        Number of position coordinates.

    Returns
    -------
    F, D
        (s, s) with s = 3 ``dimension``: positions, velocities, accelerations.

    Notes
    -----
    Koch 2014, (2.5)-(2.8); the autocorrelation of the acceleration is q^2 exp(-dt/theta).
    """
    t, decay = dt_s, math.exp(-dt_s / correlation_time_s)
    step = np.array([[1.0, t, t * t / 2.0], [0.0, 1.0, t], [0.0, 0.0, decay]])
    noise = np.zeros((3, 3))
    noise[2, 2] = -(acceleration_std_mps2**2) * math.expm1(-2.0 * dt_s / correlation_time_s)
    return _per_coordinate(step, noise, dimension)


@lru_cache(maxsize=256)
def singer(
    dt_s: float, acceleration_std_mps2: float, correlation_time_s: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Correlated acceleration, exactly: the Singer model.

    The same process as in :func:`van_keuk`, integrated exactly, so that F(a) F(b) = F(a + b) and
    the noise composes likewise.

    Parameters
    ----------
    dt_s, acceleration_std_mps2, correlation_time_s, dimension
        As in :func:`van_keuk`.

    Returns
    -------
    F, D
        (s, s) with s = 3 ``dimension``: positions, velocities, accelerations.

    Notes
    -----
    F13 = theta^2 (dt/theta - 1 + e), F23 = theta (1 - e), F33 = e with e = exp(-dt/theta), and
    D = (2 q^2/theta) integral over 0..dt of f f', f the third column of F (compare Koch 2014,
    (2.5)-(2.7)).
    """
    theta = correlation_time_s
    step = np.array([[1.0, dt_s, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    step[:, 2] = _singer_column(np.array([dt_s / theta]), theta)[0]
    # One panel for every correlation time or part of it: 20 nodes are then exact to rounding. After
    # 40 of them only the growth of the position's variance is left, which the closed form has.
    units = dt_s / theta
    if units <= 40.0:
        panels = max(math.ceil(units), 1)
        edges = np.linspace(0.0, units, panels + 1)
        half = np.diff(edges) / 2.0
        nodes = (edges[:-1] + half)[:, None] + half[:, None] * _NODES
        column = _singer_column(nodes.ravel(), theta)
        weight = (half[:, None] * _NODE_WEIGHTS).ravel() * theta
        integral = (column * weight[:, None]).T @ column
    else:
        integral = _singer_integral(units, theta)
    return _per_coordinate(step, 2.0 * acceleration_std_mps2**2 / theta * integral, dimension)


def _singer_column(units: FloatArray, theta: float) -> FloatArray:
    """Third column (n, 3) of the exact F after ``units`` (n,) correlation times."""
    fall = np.expm1(-units)
    # u - 1 + exp(-u) by its series where the difference would lose digits.
    series = np.zeros_like(units)
    for order in range(20, 1, -1):
        series = (1.0 - series) * units / order
    # (the loop ends with u/2 (1 - u/3 (1 - ...)), the series divided by u)
    rise = np.where(units < 1.0, series * units, units + fall)
    return np.stack([theta**2 * rise, -theta * fall, 1.0 + fall], axis=1)


def _singer_integral(u: float, theta: float) -> FloatArray:
    """Integral of f f' over u correlation times, for large u."""
    e, e2 = math.exp(-u), math.exp(-2.0 * u)
    f11 = 1.0 - e2 + 2.0 * u + 2.0 * u**3 / 3.0 - 2.0 * u**2 - 4.0 * u * e
    f12 = e2 + 1.0 - 2.0 * e + 2.0 * u * e - 2.0 * u + u**2
    f13 = 1.0 - e2 - 2.0 * u * e
    f22 = 4.0 * e - 3.0 - e2 + 2.0 * u
    f23 = e2 + 1.0 - 2.0 * e
    f33 = 1.0 - e2
    scale = np.array([theta**2, theta, 1.0])
    integral: FloatArray = (
        np.array([[f11, f12, f13], [f12, f22, f23], [f13, f23, f33]])
        * np.outer(scale, scale)
        * (theta / 2.0)
    )
    return integral


def embedded(
    transition: FloatArray, noise: FloatArray, size: int, extra_std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A model in the larger state of another one, so that an IMM can run both.

    The components that the model does not know, the last ones of the larger state (accelerations,
    a turn rate), are drawn anew on every step: zero mean, standard deviation ``extra_std``. They
    have no effect on the others.

    Parameters
    ----------
    transition, noise
        F and Q (s, s) of the model.
    size
        Size of the larger state, >= s.
    extra_std
        (``size`` - s,) in the unit of these components, > 0 so that no covariance is singular.

    Returns
    -------
    F, Q
        (``size``, ``size``).

    Raises
    ------
    ValueError
        If sizes do not fit or a standard deviation is not positive.
    """
    s = len(transition)
    extra = np.asarray(extra_std, dtype=np.float64)
    if size < s or extra.shape != (size - s,) or not (extra > 0.0).all():
        raise ValueError(
            f"extra_std = {extra_std} for a state of {s} in one of {size}: allowed are "
            f"{max(size - s, 0)} positive numbers"
        )
    larger, larger_noise = np.zeros((size, size)), np.zeros((size, size))
    larger[:s, :s], larger_noise[:s, :s] = transition, noise
    larger_noise[range(s, size), range(s, size)] = extra**2
    return larger, larger_noise


def _per_coordinate(
    step: FloatArray, noise: FloatArray, dimension: int
) -> tuple[FloatArray, FloatArray]:
    """F and Q of all coordinates from those of one; read-only, since they are cached."""
    eye = np.eye(dimension)
    full: FloatArray = np.array(np.kron(step, eye), dtype=np.float64)
    full_noise: FloatArray = np.array(np.kron(noise, eye), dtype=np.float64)
    full.flags.writeable = False
    full_noise.flags.writeable = False
    return full, full_noise
