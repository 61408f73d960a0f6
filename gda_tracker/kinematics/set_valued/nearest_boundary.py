"""Where in an ellipsoid and a box the association ratio is largest.

The logarithm of the ratio is, but for a constant, g(v) = - v' M v / 2 - log |v|, v the predicted
minus the actual observation. It falls along every ray from v = 0. Outside the origin the largest
value over {m + A u : |u| <= 1} within |v_l| <= w_l therefore lies on the ellipsoid's boundary, on
the side that faces the origin, and a ray whose first point of the ellipsoid is outside the box has
no point inside both.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

# What counts as inside the box: its edge is met by computation.
EDGE = 1.0 + 1e-9
# A distance from the origin that is nothing but rounding, relative to the width of the box.
NOTHING = 1e-14
SAMPLES = 16
# Row k + 4 of coefficients: the polynomial (s + i)^(4 + k) (s - i)^(4 - k), highest power first.
_POLYNOMIALS = np.array([np.poly([-1j] * (4 + k) + [1j] * (4 - k)) for k in range(-4, 5)])
# For three and more dimensions.
_DIRECTIONS, _STARTS, _NEAR, _ROUNDS = 1024, 6, 96, 28


def log_height(v: FloatArray, exponent: FloatArray) -> FloatArray:
    """Heights g of points (M, ..., r) with the matrices M (M, r, r); infinite at the origin."""
    square = np.einsum("m...i,mij,m...j->m...", v, exponent, v)
    with np.errstate(divide="ignore"):
        distance = np.sqrt(np.sum(v * v, axis=-1))
        return np.where(distance > 0.0, -0.5 * square - np.log(distance), np.inf)


def contains_origin(centre: FloatArray, shape: FloatArray) -> BoolArray:
    """Whether 0 lies in {centre + sqrt(shape) u}; (M,) bool of (M, r) and (M, r, r) of any rank."""
    values, turn = np.linalg.eigh(shape)
    along = (turn.transpose(0, 2, 1) @ centre[:, :, None])[:, :, 0]
    there = values > 1e-14 * np.maximum(values[:, -1:], np.finfo(float).tiny)
    reach = np.sum(np.where(there, along, 0.0) ** 2 / np.where(there, values, 1.0), axis=1)
    beside = np.sum(np.where(there, 0.0, along) ** 2, axis=1)
    inside: BoolArray = (reach <= 1.0) & (beside <= 1e-28 * np.sum(centre * centre, axis=1))
    return inside


def highest_on_interval(
    centre: FloatArray, shape: FloatArray, exponent: FloatArray, width: FloatArray
) -> FloatArray:
    """One dimension: g at the end of the interval that is nearer to 0, - inf outside the box."""
    near = np.abs(centre) - np.sqrt(shape[:, :, 0])
    height = log_height(near, exponent)
    return np.where(near[:, 0] <= width[:, 0] * EDGE, height, -np.inf)


def highest_on_ellipse(
    centre: FloatArray, shape: FloatArray, exponent: FloatArray, width: FloatArray
) -> FloatArray:
    """Two dimensions: the largest g exactly, - inf where ellipse and box do not meet.

    Parameters
    ----------
    centre, shape
        m (M, 2) and A A' (M, 2, 2), of any rank; 0 not inside.
    exponent
        M (M, 2, 2), positive semidefinite.
    width
        w (M, 2).

    Notes
    -----
    On the boundary v(t) = m + sqrt(A A') (cos t, sin t) the condition g'(t) = 0 is, times |v|^2, a
    trigonometric polynomial of degree four. Its eight roots, from a companion matrix, and the
    points where the boundary crosses the box are all there is to compare: no step can leave the
    cone of directions that meet the ellipse, and no far point can win.
    """
    root = _square_root(shape)
    turn = 2.0 * np.pi / SAMPLES * np.arange(SAMPLES)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    points = centre[:, :, None] + root @ circle
    slope = root @ np.stack([-circle[1], circle[0]])
    square = np.sum(points * points, axis=1)
    condition = np.sum((square[:, None] * (exponent @ points) + points) * slope, axis=1)
    # The sample of the largest value goes to infinity in s = cot((t - t0)/2), where it becomes the
    # leading coefficient: it never vanishes.
    first = np.abs(condition).argmax(axis=1)
    rows = np.arange(len(centre))[:, None]
    rolled = condition[rows, (first[:, None] + np.arange(SAMPLES)) % SAMPLES]
    flat = np.abs(rolled[:, 0]) < np.finfo(float).tiny
    rolled = np.where(flat[:, None], 1.0, rolled / np.where(flat, 1.0, rolled[:, 0])[:, None])
    harmonics = np.fft.fft(rolled, axis=1)[:, np.arange(-4, 5)] / SAMPLES
    polynomial = (harmonics @ _POLYNOMIALS).real
    companion = np.zeros((len(centre), 8, 8))
    companion[:, np.arange(1, 8), np.arange(7)] = 1.0
    companion[:, 0] = -polynomial[:, 1:] / polynomial[:, :1]
    # The real parts of complex roots are points as good as any.
    stationary = np.linalg.eigvals(companion).real
    angles = turn[first][:, None] + 2.0 * np.arctan2(1.0, stationary)

    reach = np.sqrt(np.maximum(np.diagonal(shape, axis1=1, axis2=2), np.finfo(float).tiny))
    signed = np.stack([width, -width], axis=2)
    ratio = (signed - centre[:, :, None]) / reach[:, :, None]
    crossing = np.arccos(np.clip(ratio, -1.0, 1.0))
    towards = np.arctan2(root[:, :, 1], root[:, :, 0])[:, :, None]
    edges = np.concatenate([towards + crossing, towards - crossing], axis=2).reshape(-1, 8)

    angles = np.concatenate([angles, edges, np.broadcast_to(turn, (len(centre), SAMPLES))], axis=1)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found = (centre[:, :, None] + root @ around).transpose(0, 2, 1)
    return _highest_inside(found, exponent, width)


def highest_on_ellipsoid(
    centre: FloatArray, shape: FloatArray, exponent: FloatArray, width: FloatArray
) -> FloatArray:
    """Three and more dimensions: the largest g by a search over directions on a sphere.

    Arguments as of :func:`highest_on_ellipse`. Directions u spread over the unit sphere, the same
    ones at each call, give boundary points m + sqrt(A A') u; the best of them are followed by ever
    smaller steps. Points outside the box count by how far they are out, so that a small part of the
    ellipsoid in the box is found too. The result is a point of the boundary, hence never too
    large; it may fall short of the largest.
    """
    r = centre.shape[1]
    values, axes = np.linalg.eigh(shape)
    root = (axes * np.sqrt(np.maximum(values, 0.0))[:, None]) @ axes.transpose(0, 2, 1)
    generator = np.random.default_rng(1991)
    sphere = _unit(generator.standard_normal((_DIRECTIONS, r)))
    steps = _unit(generator.standard_normal((_NEAR, r)))
    steps *= generator.uniform(0.0, 1.0, (_NEAR, 1))

    def rank(u: FloatArray) -> FloatArray:
        v = centre[:, None] + u @ root
        out = (np.abs(v) / width[:, None]).max(axis=2)
        height = np.minimum(log_height(v, exponent), 1e6)
        return np.where(out <= EDGE, height, -1e7 * out)

    # And the direction in which the origin is seen from the centre, in the coordinates of u.
    facing = _unit(-(np.linalg.pinv(root) @ centre[:, :, None])[:, None, :, 0])
    start = np.broadcast_to(sphere, (len(centre), *sphere.shape))
    start = np.concatenate([start, facing], axis=1)
    order = np.argsort(-rank(start), axis=1)[:, :_STARTS]
    best = np.take_along_axis(start, order[:, :, None], axis=1)
    size = 0.3
    for _ in range(_ROUNDS):
        around = _unit(best[:, :, None] + size * steps)
        trial = np.concatenate([best[:, :, None], around], axis=2)
        worth = rank(trial.reshape(len(centre), -1, r)).reshape(trial.shape[:3])
        chosen = worth.argmax(axis=2)[:, :, None, None]
        best = np.take_along_axis(trial, chosen, axis=2)[:, :, 0]
        size *= 0.65
    return _highest_inside(centre[:, None] + best @ root, exponent, width)


def _highest_inside(points: FloatArray, exponent: FloatArray, width: FloatArray) -> FloatArray:
    inside = (np.abs(points) <= width[:, None] * EDGE).all(axis=2)
    height = np.where(inside, log_height(points, exponent), -np.inf)
    highest: FloatArray = height.max(axis=1)
    return highest


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(length, np.finfo(float).tiny)


def _square_root(shape: FloatArray) -> FloatArray:
    """Symmetric square roots of (M, 2, 2), of any rank."""
    determinant = shape[:, 0, 0] * shape[:, 1, 1] - shape[:, 0, 1] ** 2
    middle = np.sqrt(np.maximum(determinant, 0.0))
    sum_of_roots = np.sqrt(shape[:, 0, 0] + shape[:, 1, 1] + 2.0 * middle)
    divisor = np.maximum(sum_of_roots, np.finfo(float).tiny)[:, None, None]
    return (shape + middle[:, None, None] * np.eye(2)) / divisor
