"""Gaussian sums from single measurements: where a target may be that is on a ray or a curve.

A target is thought equally likely anywhere within the sensor's reach, with a velocity of which only
the largest speed is known. A measurement leaves of that a ray (bearing), a circle (range), an
ellipse (bistatic range) or a branch of a hyperbola (time difference), as wide as the noise makes
it. It is cut into pieces, each as long as the curve lets it be nearly straight, and each piece is
one Gaussian (Koch 2014, section 2.3.1 on TDoA and FDoA; along a bearing that is the
range-parametrised filter). What else was measured, such as a frequency difference, then updates
the pieces and their weights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.kinematics.measurement_kinds import AZIMUTH, RANGE_RATE, MeasurementModel
from gda_tracker.kinematics.measurement_models import (
    Compared,
    Observed,
    Sites,
    compare,
    derivatives,
    expected,
    update,
)
from gda_tracker.vocabulary.arrays import FloatArray

# A hyperbola or an ellipse whose half axis is so near the half distance of the sensors is a line.
NEARLY = 1e-3


@dataclass(frozen=True)
class Reach:
    """Where targets may be: from ``nearest_m`` to ``farthest_m`` of the sensor, of any speed.

    With a reference it is from the middle between the two. ``components`` is the number of pieces,
    ``max_speed_mps`` the largest speed of a target.
    """

    nearest_m: float
    farthest_m: float
    components: int
    max_speed_mps: float


@dataclass(slots=True)
class Sums:
    """D Gaussian sums of K components: ``weight`` (D, K), ``mean`` (D, K, 4), ``covariance``.

    The weights of each sum to one. ``log_likelihood`` (D,) is that of what was measured beyond the
    curve, 0 if nothing was.
    """

    weight: FloatArray
    mean: FloatArray
    covariance: FloatArray
    log_likelihood: FloatArray


def start_sums(measured: Observed, reach: Reach) -> Sums:
    """Gaussian sums of the D measurements of a scan.

    Raises
    ------
    ValueError
        For a model of range rates alone, which bound no position.
    """
    model = measured.model
    if not model.starts:
        raise ValueError(f"sensor model {model.name}: a measurement of it bounds no position")
    if model.locates:
        weight, position, covariance = _points(measured)
    else:
        weight, position, covariance = _pieces(measured, reach)
    d, k = weight.shape
    mean = np.zeros((d, k, 4))
    mean[:, :, :2] = position
    full = np.zeros((d, k, 4, 4))
    full[:, :, :2, :2] = covariance
    # The moments of the uniform distribution over the disc of possible velocities.
    full[:, :, 2:, 2:] = (reach.max_speed_mps / 2.0) ** 2 * np.eye(2)
    sums = Sums(weight, mean, full, np.zeros(d))
    return _with_rates(sums, measured) if RANGE_RATE in model.quantities else sums


def _points(measured: Observed) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One component for each measurement of range and azimuth."""
    r, azimuth = measured.value[:, 0], measured.value[:, 1]
    u = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    jacobian = np.stack([u, r[:, None] * np.stack([-u[:, 1], u[:, 0]], axis=1)], axis=2)
    covariance = jacobian @ measured.noise[:, :2, :2] @ jacobian.transpose(0, 2, 1)
    position = measured.sites.position_m[0] + r[:, None] * u
    return np.ones((len(r), 1)), position[:, None], covariance[:, None]


def _pieces(measured: Observed, reach: Reach) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (D, K), centres (D, K, 2) and covariances of the pieces of each curve."""
    model, sites = measured.model, measured.sites
    points = curve(model, sites, measured.value[:, 0], reach)
    begin, centre, end = points[:, 0:-1:2], points[:, 1::2], points[:, 2::2]
    chord = end - begin
    length = np.hypot(chord[..., 0], chord[..., 1])
    along = chord / np.maximum(length, 1e-9)[..., None]
    d, k = length.shape
    state = np.zeros((d * k, 4))
    state[:, :2] = centre.reshape(-1, 2)
    one = MeasurementModel("curve", model.quantities[:1], model.reference_sign)
    slope = np.hypot(*derivatives(one, sites, state)[0][:, 0, :2].T).reshape(d, k)
    # Beyond the reach there is no target, however little the measurement says.
    wide = np.sqrt(measured.noise[:, 0, 0])[:, None]
    wide = np.minimum(wide / np.maximum(slope, 1e-12), reach.farthest_m)
    bow = centre - 0.5 * (begin + end)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    sagitta = np.sum(bow * across, axis=-1)
    # Half a piece is the deviation along it: neighbours overlap, the sum is smooth. Across it the
    # piece is bent: of the parabola through its ends the mean lies a third of the sagitta inside.
    centre = centre - (sagitta / 3.0)[..., None] * across
    covariance = (length / 2.0)[..., None, None] ** 2 * along[..., :, None] * along[..., None, :]
    spread = (wide**2 + sagitta**2 / 5.0)[..., None, None]
    covariance = covariance + spread * across[..., :, None] * across[..., None, :]
    area = length * wide
    return area / area.sum(axis=1, keepdims=True), centre, covariance


def curve(model: MeasurementModel, sites: Sites, value: FloatArray, reach: Reach) -> FloatArray:
    """Points (D, 2 K + 1, 2) [m] on the curve of each measurement: ends and middles of the pieces.

    ``value`` (D,) are azimuths [rad], ranges, sums or differences of ranges [m].
    """
    steps = 2 * reach.components
    first = sites.position_m[0]
    if model.quantities[0] == AZIMUTH:
        ratio = np.linspace(0.0, 1.0, steps + 1)
        r = reach.nearest_m * (reach.farthest_m / reach.nearest_m) ** ratio
        # The middle of a piece is that of its length.
        r[1::2] = 0.5 * (r[0:-1:2] + r[2::2])
        u = np.stack([np.cos(value), np.sin(value)], axis=1)
        points: FloatArray = first + r[None, :, None] * u[:, None, :]
        return points
    turn = np.linspace(0.0, 2.0 * np.pi, steps + 1)
    if not model.has_reference:
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        r = np.maximum(value, reach.nearest_m)
        return np.asarray(first + r[:, None, None] * circle)
    gap = sites.position_m[1] - first
    half = max(float(np.hypot(*gap)) / 2.0, 1e-6)
    axis = gap / (2.0 * half)
    aside = np.array([-axis[1], axis[0]])
    middle = first + 0.5 * gap
    if model.reference_sign > 0.0:
        a = np.maximum(value / 2.0, half * (1.0 + NEARLY))[:, None]
        x, y = a * np.cos(turn), np.sqrt(a**2 - half**2) * np.sin(turn)
    else:
        a = np.clip(value / 2.0, -half * (1.0 - NEARLY), half * (1.0 - NEARLY))[:, None]
        b = np.sqrt(half**2 - a**2)
        # x = a cosh t, y = b sinh t reaches the distance d from the middle at
        # sinh^2 t = (d^2 - a^2) / (a^2 + b^2).
        last = np.arcsinh(np.sqrt(np.maximum(reach.farthest_m**2 - a**2, 0.0)) / half)
        t = last * np.linspace(-1.0, 1.0, steps + 1)
        x, y = a * np.cosh(t), b * np.sinh(t)
    return np.asarray(middle + x[..., None] * axis + y[..., None] * aside)


def _with_rates(sums: Sums, measured: Observed) -> Sums:
    """The sums updated by the range rates, which the curves have not used."""
    model = measured.model
    place = [i for i, quantity in enumerate(model.quantities) if quantity == RANGE_RATE]
    alone = replace(model, quantities=(RANGE_RATE,), rotated=False)
    d, k = sums.weight.shape
    mean, covariance = sums.mean.reshape(-1, 4), sums.covariance.reshape(-1, 4, 4)
    row = np.repeat(np.arange(d), k)
    noise = measured.noise[row][:, place][:, :, place]
    pair: Compared = compare(
        expected(alone, measured.sites, mean, covariance), measured.value[row][:, place], noise
    )
    mean, covariance = update(mean, covariance, pair)
    with np.errstate(divide="ignore"):
        joint = np.log(sums.weight) + pair.log_likelihood().reshape(d, k)
    peak = joint.max(axis=1, keepdims=True)
    scaled = np.exp(joint - peak)
    total = scaled.sum(axis=1, keepdims=True)
    return Sums(
        scaled / total,
        mean.reshape(d, k, 4),
        covariance.reshape(d, k, 4, 4),
        (peak + np.log(total))[:, 0],
    )
