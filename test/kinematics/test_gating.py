"""Gating: against loops over all pairs, against the chi-square law, with mixtures and offsets."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematic_examples import predictions_of, quaternion, random_states, scan_of
from scipy.stats import chi2

from gda_tracker.kinematics.gating import gate, gate_threshold
from gda_tracker.kinematics.sensor_models import wrap_angle

R = np.diag([60.0**2, 0.005**2])


def brute_force(scan, predictions):
    """Gated pairs of a level sensor by plain loops, one number at a time.

    ``{(hypothesis, detection): (d2 of the nearest component, density of the mixture)}``
    """
    threshold = chi2.ppf(predictions.settings.gate_probability, 2)
    sensor, found = scan.sensor_position_m[:2], {}
    for h in range(len(predictions)):
        for d in range(len(scan)):
            distances, density = [], 0.0
            for k in range(predictions.component_start[h], predictions.component_start[h + 1]):
                f = np.eye(4)
                if scan.time_offset_s is not None:
                    f[0, 2] = f[1, 3] = scan.time_offset_s[d]
                x, y = (f @ predictions.component_mean[k])[:2] - sensor
                p = (f @ predictions.component_covariance[k] @ f.T)[:2, :2]
                r = math.hypot(x, y)
                jacobian = np.array([[x / r, y / r], [-y / r**2, x / r**2]])
                s = jacobian @ p @ jacobian.T + scan.noise_covariance[d, :2, :2]
                v = np.array([scan.range_m[d] - r, scan.azimuth_rad[d] - math.atan2(y, x)])
                v[1] = math.remainder(v[1], 2 * math.pi)
                distances.append(v @ np.linalg.solve(s, v))
                normaliser = 2 * math.pi * math.sqrt(np.linalg.det(s))
                gaussian = math.exp(-0.5 * distances[-1]) / normaliser
                density += predictions.component_weight[k] * gaussian
            if distances and min(distances) <= threshold:
                found[(h, d)] = (min(distances), density)
    return found


def random_scan(rng, mean, clutter, offsets=False, sensor=(0.0, 0.0)):
    """One detection near each state and some anywhere."""
    x, y = mean[:, 0] - sensor[0], mean[:, 1] - sensor[1]
    ranges = np.concatenate(
        [np.hypot(x, y) + rng.normal(0, 200, len(x)), rng.uniform(4e3, 5e4, clutter)]
    )
    azimuths = np.concatenate(
        [np.arctan2(y, x) + rng.normal(0, 0.02, len(x)), rng.uniform(-np.pi, np.pi, clutter)]
    )
    n = len(ranges)
    order = rng.permutation(n)
    return scan_of(
        ranges[order],
        wrap_angle(azimuths[order]),
        R,
        position=(*sensor, 10.0),
        time_offset_s=rng.uniform(-2.0, 2.0, n) if offsets else None,
    )


def assert_equal(pairs, expected):
    got = list(zip(pairs.hypothesis.tolist(), pairs.detection.tolist(), strict=True))
    assert got == sorted(expected)
    values = np.array([expected[pair] for pair in got]).reshape(-1, 2)
    np.testing.assert_allclose(pairs.mahalanobis_squared, values[:, 0], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(np.exp(pairs.log_likelihood), values[:, 1], rtol=1e-7)


def test_threshold_is_the_chi_square_quantile():
    for probability in (0.5, 0.99, 0.9999, 0.999999999):
        assert gate_threshold(probability) == pytest.approx(chi2.ppf(probability, 2), rel=1e-6)
    # The scenarios' reading of the 2004 chapter.
    assert gate_threshold(0.99) == pytest.approx(9.21, abs=0.001)
    assert gate_threshold(0.99, dimension=3) == pytest.approx(chi2.ppf(0.99, 3))


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 6),
    st.integers(0, 6),
    st.sampled_from([0.5, 0.99, 0.999999]),
    st.booleans(),
    st.sampled_from([30.0, 3000.0]),
)
def test_equals_loops_over_all_pairs(seed, states, clutter, probability, offsets, spread):
    rng = np.random.default_rng(seed)
    mean, covariance = random_states(rng, states, spread_m=spread)
    scan = random_scan(rng, mean, clutter, offsets, sensor=tuple(rng.normal(0, 2e3, 2)))
    predictions = predictions_of(mean, covariance, probability)
    assert_equal(gate(scan, predictions), brute_force(scan, predictions))


def test_detections_on_either_side_of_the_azimuth_cut_are_gated():
    mean = np.array([[-20e3, 1.0, 0.0, 0.0], [-20e3, -1.0, 0.0, 0.0]])
    covariance = np.tile(np.diag([100.0, 100.0, 1.0, 1.0]), (2, 1, 1))
    scan = scan_of([20e3, 20e3], [math.pi - 1e-4, -math.pi + 1e-4], R)
    pairs = gate(scan, predictions_of(mean, covariance))
    assert pairs.hypothesis.tolist() == [0, 0, 1, 1]
    assert pairs.detection.tolist() == [0, 1, 0, 1]
    assert (pairs.mahalanobis_squared < 0.01).all()


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(1, 4), min_size=1, max_size=4),
    st.booleans(),
)
def test_mixtures_equal_explicit_sums(seed, sizes, offsets):
    rng = np.random.default_rng(seed)
    start = np.concatenate([[0], np.cumsum(sizes)])
    centre, _ = random_states(rng, len(sizes))
    mean, covariance = random_states(rng, start[-1])
    mean[:, :2] = np.repeat(centre[:, :2], sizes, axis=0) + rng.normal(0, 800, (start[-1], 2))
    weight = np.concatenate([rng.dirichlet(np.ones(size)) for size in sizes])
    scan = random_scan(rng, mean, 3, offsets)
    predictions = predictions_of(mean, covariance, 0.9, start, weight)
    assert_equal(gate(scan, predictions), brute_force(scan, predictions))


def test_two_components_worked():
    """Gated by the near component alone; the far one still counts in the density."""
    mean = np.array([[10e3, 0.0, 0, 0], [10.5e3, 0.0, 0, 0]])
    covariance = np.tile(np.diag([80.0**2, 1.0, 1.0, 1.0]), (2, 1, 1))
    predictions = predictions_of(mean, covariance, 0.99, [0, 2], [0.25, 0.75])
    pairs = gate(scan_of([10e3], 0.0, R), predictions)
    assert len(pairs) == 1
    assert pairs.mahalanobis_squared[0] == 0.0
    s_a = [1.0 / mean[k, 0] ** 2 + 0.005**2 for k in (0, 1)]
    density = [math.exp(-0.5 * d2) for d2 in (0.0, 25.0)]
    expected = sum(
        w * g / (2 * math.pi * 100.0 * math.sqrt(a))
        for w, g, a in zip((0.25, 0.75), density, s_a, strict=True)
    )
    assert pairs.log_likelihood[0] == pytest.approx(math.log(expected), rel=1e-12)


def test_equal_components_are_one_gaussian():
    rng = np.random.default_rng(6)
    mean, covariance = random_states(rng, 4)
    scan = random_scan(rng, mean, 5)
    one = gate(scan, predictions_of(mean, covariance))
    twice = predictions_of(
        np.repeat(mean, 2, axis=0),
        np.repeat(covariance, 2, axis=0),
        component_start=np.arange(5) * 2,
        weight=np.tile([0.3, 0.7], 4),
    )
    both = gate(scan, twice)
    np.testing.assert_array_equal(one.hypothesis, both.hypothesis)
    np.testing.assert_array_equal(one.detection, both.detection)
    np.testing.assert_allclose(one.log_likelihood, both.log_likelihood, rtol=1e-12)


@pytest.mark.parametrize("offset", [None, 1.5], ids=["one_time", "time_offset"])
@pytest.mark.parametrize("probability", [0.9, 0.99])
def test_share_of_own_detections_is_the_gate_probability(probability, offset):
    """Truth drawn from the prediction, detection from the truth: Monte Carlo with its own error."""
    rng = np.random.default_rng(12)
    n = 40_000
    state = np.array([30e3, 12e3, -120.0, 200.0])
    root = rng.normal(size=(4, 4)) * np.array([[150.0], [150.0], [20.0], [20.0]])
    covariance = root @ root.T
    truth = state + rng.normal(size=(n, 4)) @ root.T
    tau = 0.0 if offset is None else offset
    x, y = truth[:, 0] + tau * truth[:, 2], truth[:, 1] + tau * truth[:, 3]
    noise = rng.normal(size=(n, 2)) * np.sqrt(np.diag(R))
    scan = scan_of(
        np.hypot(x, y) + noise[:, 0], np.arctan2(y, x) + noise[:, 1], R, time_offset_s=offset
    )
    pairs = gate(scan, predictions_of(state[None], covariance[None], probability))
    error = math.sqrt(probability * (1 - probability) / n)
    assert len(pairs) / n == pytest.approx(probability, abs=4 * error + 0.002)


def test_log_likelihood_integrates_to_the_gate_probability():
    """The density lives on range times azimuth: its sum over a fine grid of the gate is P_G."""
    mean, covariance = np.array([[20e3, 0.0, 0, 0]]), np.diag([1e4, 4e4, 1.0, 1.0])[None]
    r, a = np.linspace(19e3, 21e3, 401), np.linspace(-0.08, 0.08, 401)
    grid_r, grid_a = (g.ravel() for g in np.meshgrid(r, a))
    pairs = gate(scan_of(grid_r, grid_a, R), predictions_of(mean, covariance, 0.95))
    total = np.exp(pairs.log_likelihood).sum() * (r[1] - r[0]) * (a[1] - a[0])
    assert total == pytest.approx(0.95, abs=0.002)


def test_tilted_sensor_gates_its_own_target():
    q = quaternion((1.0, 0.0, 0.0), 0.2)
    noise = np.diag([60.0**2, 0.005**2, 0.005**2])
    scan = scan_of([20e3], 0.6, noise, orientation=q, elevation_rad=0.1)
    c, s = math.cos(0.2), math.sin(0.2)
    x, y, z = 20e3 * np.array(
        [math.cos(0.6) * math.cos(0.1), math.sin(0.6) * math.cos(0.1), math.sin(0.1)]
    )
    state = np.array([[x, c * y - s * z, 0.0, 0.0]])
    pairs = gate(scan, predictions_of(state, np.diag([100.0, 100.0, 1.0, 1.0])[None]))
    assert len(pairs) == 1
    assert pairs.mahalanobis_squared[0] < 1e-12


@pytest.mark.parametrize(("states", "detections"), [(0, 0), (0, 3), (3, 0)])
@pytest.mark.parametrize("offset", [None, 0.5])
def test_nothing_to_gate(states, detections, offset):
    mean, covariance = random_states(np.random.default_rng(0), states)
    scan = scan_of(np.full(detections, 1e4), 0.0, R, time_offset_s=offset)
    pairs = gate(scan, predictions_of(mean, covariance))
    assert len(pairs) == 0
    assert pairs.hypothesis.dtype == pairs.detection.dtype == np.int32


def test_mixtures_with_nothing_gated():
    mean, covariance = random_states(np.random.default_rng(0), 4)
    scan = scan_of([1.0], 0.0, R)
    pairs = gate(
        scan, predictions_of(mean, covariance, component_start=[0, 2, 4], weight=[0.5] * 4)
    )
    assert len(pairs) == 0
    assert pairs.log_likelihood.shape == (0,)


def test_permuting_states_and_detections_permutes_the_pairs():
    rng = np.random.default_rng(21)
    mean, covariance = random_states(rng, 8)
    scan = random_scan(rng, mean, 10)
    order, rows = rng.permutation(8), rng.permutation(len(scan))
    turned = scan_of(scan.range_m[rows], scan.azimuth_rad[rows], R, position=(0, 0, 10.0))
    one = gate(scan, predictions_of(mean, covariance, 0.999))
    other = gate(turned, predictions_of(mean[order], covariance[order], 0.999))
    back = {
        (int(order[h]), int(rows[d])): value
        for h, d, value in zip(other.hypothesis, other.detection, other.log_likelihood, strict=True)
    }
    assert len(one) >= 8
    for h, d, value in zip(one.hypothesis, one.detection, one.log_likelihood, strict=True):
        assert back.pop((int(h), int(d))) == pytest.approx(value, rel=1e-12)
    assert not back


@pytest.mark.parametrize("offset", [None, -1.5, 1.5])
@pytest.mark.parametrize("axis", [0, 1], ids=["range", "azimuth"])
def test_the_gate_ends_at_its_threshold(axis, offset):
    """Detections a hair inside and outside on one axis, uncertain along this axis alone."""
    tau = 0.0 if offset is None else offset
    mean = np.array([[20e3, 0.0, 10.0, 0.0]])
    covariance = np.zeros((1, 4, 4))
    # Position and velocity go together, so that the offset takes away or adds to the variance.
    along = np.array([500.0, 200.0])
    covariance[0][np.ix_([axis, axis + 2], [axis, axis + 2])] = np.outer(along, along)
    spread = along[0] + tau * along[1]
    distance = 20e3 + tau * 10.0
    sigma = [math.hypot(spread, 60.0), math.hypot(spread / distance, 0.005)][axis]
    edge = (
        math.sqrt(chi2.ppf(0.99, 2)) * sigma * np.array([-1 - 1e-6, -1 + 1e-6, 1 - 1e-6, 1 + 1e-6])
    )
    ranges = distance + (edge if axis == 0 else np.zeros(4))
    azimuths = edge if axis == 1 else np.zeros(4)
    pairs = gate(
        scan_of(ranges, azimuths, R, time_offset_s=offset), predictions_of(mean, covariance)
    )
    assert pairs.detection.tolist() == [1, 2]


@pytest.mark.parametrize("seed", range(6))
def test_looked_up_by_range_the_pairs_are_the_same(monkeypatch, seed):
    """Noise of many sizes, gates that reach beyond all ranges, equal ranges, few detections."""
    rng = np.random.default_rng(seed)
    mean, covariance = random_states(rng, 40)
    covariance *= 10.0 ** rng.uniform(-2.0, 3.0, 40)[:, None, None]
    scan = random_scan(rng, mean, (0, 1, 20, 60, 60, 200)[seed])
    scan.noise_covariance[:] = (
        scan.noise_covariance * rng.uniform(0.1, 9.0, len(scan))[:, None, None]
    )
    scan.range_m[::3] = scan.range_m[0]
    predictions = predictions_of(mean, covariance)
    found = []
    for limit in (10**9, 0):
        monkeypatch.setattr("gda_tracker.kinematics.gating.MANY_PAIRS", limit)
        found.append(gate(scan, predictions))
    assert len(found[0].hypothesis) > 0
    for name in ("hypothesis", "detection", "mahalanobis_squared", "log_likelihood"):
        np.testing.assert_array_equal(*(getattr(pairs, name) for pairs in found))
