"""The seriously possible region of an observation (Stirling & Thompson 1991, equations 9, 10, 25).

It is the box |zeta_l - z_l| <= theta rho_l about the observation z, rho_l its standard deviations.
Distance from z, divided by its integral over the box, is the density that says what rejecting an
association is worth.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import erf

from gda_tracker.vocabulary.arrays import FloatArray

# Quadrature over x = log y in _in_many_dimensions; beyond these ends in closed form.
_LOW, _HIGH = -9.0, 12.0
_NODES, _WEIGHTS = (np.asarray(a, dtype=np.float64) for a in leggauss(160))


def distance_integral(half_width: FloatArray) -> FloatArray:
    """Integral of the distance from its centre over each of M boxes.

    Parameters
    ----------
    half_width
        (M, r) theta rho_l, > 0.

    Returns
    -------
    (M,) integral of |zeta| over |zeta_l| <= half_width_l. In closed form for r = 1 (a^2) and r = 2,
    4/3 a b hypot(a, b) + 2/3 (a^3 asinh(b/a) + b^3 asinh(a/b)); by quadrature, to ten digits,
    beyond.

    Raises
    ------
    ValueError
        If r = 0.
    """
    r = half_width.shape[1]
    if r == 0:
        raise ValueError("observations with r = 0 components: allowed is r >= 1")
    if r == 1:
        return half_width[:, 0] ** 2
    if r == 2:
        a, b = half_width[:, 0], half_width[:, 1]
        logarithms = a**3 * np.arcsinh(b / a) + b**3 * np.arcsinh(a / b)
        return 4.0 / 3.0 * a * b * np.hypot(a, b) + 2.0 / 3.0 * logarithms
    return _in_many_dimensions(half_width)


def _in_many_dimensions(half_width: FloatArray) -> FloatArray:
    """|v| = (1/sqrt(pi)) times the integral of (1 - exp(-y^2 |v|^2)) / y^2 over y > 0.

    Under it the box factors: the mean of exp(-y^2 v^2) over |v| <= a is sqrt(pi) erf(a y)/(2 a y).
    """
    scale = half_width.max(axis=1)
    a = half_width / scale[:, None]
    x = (_HIGH - _LOW) / 2.0 * _NODES + (_HIGH + _LOW) / 2.0
    y = np.exp(x)
    reach = a[:, :, None] * y
    mean = np.prod(np.sqrt(np.pi) * erf(reach) / (2.0 * reach), axis=1)
    middle = ((1.0 - mean) / y) @ _WEIGHTS * (_HIGH - _LOW) / 2.0
    # Below: 1 - mean = y^2 sum a^2/3 + O(y^4); above: the mean has vanished.
    below = np.exp(_LOW) * np.sum(a * a, axis=1) / 3.0
    total = (below + middle + np.exp(-_HIGH)) / np.sqrt(np.pi)
    return total * scale * np.prod(2.0 * half_width, axis=1)
