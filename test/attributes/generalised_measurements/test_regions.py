from __future__ import annotations

import numpy as np
import pytest
from covering_examples import (
    plane_integral,
    polygon_slices,
    random_covariance,
    sector_slices,
    star_polygon,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import log_ndtr
from scipy.stats import norm

from gda_tracker.attributes.generalised_measurements import Box, Polygon, Sector, annular_sector

examples = settings(derandomize=True, deadline=None, max_examples=20)
seeds = st.integers(0, 2**32 - 1)


def log_probability(statements, mean, covariance):
    return statements.log_expectation(
        np.asarray(mean, dtype=float)[..., None, :], np.asarray(covariance)[..., None, :, :]
    )


@examples
@given(seeds, st.integers(3, 8))
def test_polygons_equal_numerical_integration(seed, corners):
    random = np.random.default_rng(seed)
    vertices = star_polygon(random, corners)
    mean = random.normal(scale=5.0, size=2)
    covariance = random_covariance(random, 2)
    found = np.exp(log_probability(Polygon(vertices[None]), mean, covariance))[0]
    wanted = plane_integral(polygon_slices(vertices), mean, covariance, vertices[:, 0])
    assert found == pytest.approx(wanted, abs=1e-12, rel=1e-9)


@examples
@given(seeds, st.floats(-9.0, 2.0))
def test_polygons_of_any_size_keep_their_digits(seed, log_size):
    random = np.random.default_rng(seed)
    vertices = 10.0**log_size * star_polygon(random, 5) + random.normal(scale=3.0, size=2)
    # Chords of vertices that carry rounding of 1e-16 beside a size of 1e-9 are good to 1e-6.
    size = np.ptp(vertices, axis=0).min()
    covariance = random_covariance(random, 2)
    found = np.exp(log_probability(Polygon(vertices[None]), np.zeros(2), covariance))[0]
    wanted = plane_integral(polygon_slices(vertices), np.zeros(2), covariance, vertices[:, 0])
    assert found == pytest.approx(wanted, rel=1e-9 + 1e-14 / size, abs=1e-300)


@examples
@given(seeds)
def test_sectors_equal_numerical_integration(seed):
    random = np.random.default_rng(seed)
    apex, mean = random.normal(scale=4.0, size=(2, 2))
    first, opening = random.uniform(-np.pi, np.pi), random.uniform(0.01, 3.1)
    covariance = random_covariance(random, 2)
    found = np.exp(log_probability(Sector(apex[None], [first], [opening]), mean, covariance))[0]
    slices = sector_slices(apex, first, opening)
    wanted = plane_integral(slices, mean, covariance, apex[:1])
    assert found == pytest.approx(wanted, abs=1e-12, rel=1e-9)


@examples
@given(seeds)
def test_sectors_around_a_sensor_share_out_the_probability(seed):
    random = np.random.default_rng(seed)
    apex, mean = random.normal(scale=4.0, size=(2, 2))
    opening = random.dirichlet(np.ones(3)) * 2.0 * np.pi
    first = random.uniform(-9.0, 9.0) + np.concatenate([[0.0], np.cumsum(opening)[:-1]])
    parts = Sector(np.tile(apex, (3, 1)), first, opening)
    covariance = random_covariance(random, 2)
    shares = np.exp(log_probability(parts, mean, covariance))
    assert shares.sum() == pytest.approx(1.0, abs=1e-13)
    rest = Sector(apex[None], first[1:2], 2.0 * np.pi - opening[:1])
    assert np.exp(log_probability(rest, mean, covariance))[0] == pytest.approx(
        shares[1:].sum(), abs=1e-13
    )


@pytest.mark.parametrize("sigmas", [0.9999, 1.0001, 2.0, 10.0, 60.0, 3000.0])
def test_tails_of_half_planes(sigmas):
    mean, covariance = np.array([5.0, -7.0]), np.array([[4.0, 0.0], [0.0, 9.0]])
    edge = 5.0 + 2.0 * sigmas
    half_plane = Sector([[edge, 0.0]], [-0.5 * np.pi], [np.pi])
    strip = Box([[edge, -np.inf]], [[np.inf, np.inf]])
    far = 1e5
    square = Polygon([[[edge, -far], [edge + far, -far], [edge + far, far], [edge, far]]])
    for region in (half_plane, strip, square):
        found = log_probability(region, mean, covariance)[0]
        assert found == pytest.approx(log_ndtr(-sigmas), rel=1e-12)


@examples
@given(seeds)
def test_the_tail_joins_the_closed_form(seed):
    # Without correlation a box is a product, exact in the tails.
    random = np.random.default_rng(seed)
    low = random.uniform(1.0, 6.0, 2)
    high = low + 10.0 ** random.uniform(-3.0, 1.0, 2)
    found = log_probability(Box(low[None], high[None]), np.zeros(2), np.eye(2))[0]
    sides = [
        log_ndtr(-a) + np.log1p(-np.exp(log_ndtr(-b) - log_ndtr(-a)))
        for a, b in zip(low, high, strict=True)
    ]
    assert found == pytest.approx(sum(sides), abs=1e-9)


@examples
@given(seeds)
def test_boxes_are_products_of_normal_probabilities(seed):
    random = np.random.default_rng(seed)
    low, high = np.sort(random.normal(scale=2.0, size=(2, 3, 2)), axis=0)
    low[0, 1], high[1, 0] = -np.inf, np.inf
    low[2], high[2, 1] = -np.inf, np.inf
    mean, deviation = random.normal(scale=2.0, size=(5, 2)), random.uniform(0.2, 3.0, (5, 2))
    covariance = deviation[:, :, None] ** 2 * np.eye(2)
    found = np.exp(log_probability(Box(low, high), mean, covariance))
    place, scale = mean[:, None], deviation[:, None]
    wanted = np.prod(norm.cdf(high, place, scale) - norm.cdf(low, place, scale), axis=-1)
    np.testing.assert_allclose(found, wanted, atol=1e-14)


def test_batch_is_one_by_one():
    random = np.random.default_rng(4)
    polygons = np.array([star_polygon(random, 5) for _ in range(4)])
    sectors = Sector(random.normal(size=(4, 2)), [0.0, 1.0, -2.0, 3.0], [0.3, 3.0, 4.0, 6.0])
    mean = random.normal(scale=6.0, size=(7, 2))
    covariance = np.array([random_covariance(random, 2) for _ in range(7)])
    for statements in (Polygon(polygons), sectors):
        together = log_probability(statements, mean, covariance)
        assert together.shape == (7, 4)
        for m in range(4):
            one = (
                Polygon(polygons[m : m + 1])
                if statements is not sectors
                else Sector(
                    sectors.apex[[m]], sectors.first_bearing_rad[[m]], sectors.opening_rad[[m]]
                )
            )
            for t in range(7):
                np.testing.assert_allclose(
                    log_probability(one, mean[t], covariance[t])[0], together[t, m], rtol=1e-12
                )


def test_grades_by_hand():
    bow = Polygon([[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]]])
    inside = bow([[1.0, 1.0], [2.0, 2.0], [3.5, 3.0], [2.0, 0.0], [4.0, 2.0], [5.0, 0.0]])
    np.testing.assert_array_equal(inside[:, 0], [1, 0, 1, 1, 1, 0])
    sectors = Sector(np.zeros((4, 2)), [0.0, 0.0, 3.0, 0.0], [0.5, 4.0, 0.6, 2.0 * np.pi])
    points = [[1.0, 0.1], [-1.0, 0.0], [0.0, -1.0], [0.0, 0.0]]
    np.testing.assert_array_equal(
        sectors(points), [[1, 1, 0, 1], [0, 1, 1, 1], [0, 0, 0, 1], [1, 1, 1, 1]]
    )


def test_order_of_vertices_does_not_matter():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]])
    either = Polygon([square, square[::-1]])
    logs = log_probability(either, [0.3, 5.0], np.eye(2))
    assert logs[0] == pytest.approx(logs[1], rel=1e-13)
    padded = Polygon(np.concatenate([square, square[-1:], square[-1:]])[None])
    assert log_probability(padded, [0.3, 5.0], np.eye(2))[0] == pytest.approx(logs[0], rel=1e-13)


def test_average_over_a_box():
    low, high = np.array([0.0, 0.0]), np.array([4.0, 2.0])
    polygons = Polygon(
        [
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]],
            [[9.0, 9.0], [10.0, 9.0], [10.0, 10.0], [9.0, 9.5]],
        ]
    )
    np.testing.assert_allclose(polygons.average(low, high), [1.0 / 8.0, 0.0])
    boxes = Box([[-np.inf, 1.0], [5.0, 0.0]], [[1.0, np.inf], [6.0, 2.0]])
    np.testing.assert_allclose(boxes.average(low, high), [1.0 / 8.0, 0.0])
    sectors = Sector(
        [[0.0, 0.0]] * 3, [0.0, 0.25 * np.pi, 0.5 * np.pi], [0.25 * np.pi, 1.75 * np.pi, np.pi]
    )
    np.testing.assert_allclose(sectors.average(low, high), [6.0 / 8.0, 2.0 / 8.0, 0.0], atol=1e-15)


def test_annular_sector_approaches_its_area():
    ring = annular_sector([3.0, 4.0], 0.2, 1.0, 1000.0, 2000.0, tolerance_m=0.01)
    low, high = np.full(2, -3000.0), np.full(2, 3000.0)
    area = ring.average(low, high)[0] * 6000.0**2
    assert area == pytest.approx(0.5 * 1.0 * (2000.0**2 - 1000.0**2), rel=1e-4)
    bearing = np.array([0.1, 0.3, 1.1, 1.3])
    direction = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    np.testing.assert_array_equal(ring([3.0, 4.0] + 1500.0 * direction)[:, 0], [0, 1, 1, 0])
    np.testing.assert_array_equal(ring([3.0, 4.0] + 500.0 * direction)[:, 0], 0)


def test_bad_regions_are_refused():
    with pytest.raises(ValueError, match="do not cross"):
        Polygon([[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.5]]])
    with pytest.raises(ValueError, match="area > 0"):
        Polygon([[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]])
    with pytest.raises(ValueError, match="infinite"):
        Polygon([[[0.0, 0.0], [np.inf, 1.0], [2.0, 2.0]]])
    with pytest.raises(ValueError, match="low <= high"):
        Box([[0.0, 1.0]], [[1.0, 0.0]])
    with pytest.raises(ValueError, match="2 pi"):
        Sector([[0.0, 0.0]], [0.0], [0.0])
    with pytest.raises(ValueError, match="positive definite"):
        log_probability(Box([[0.0, 0.0]], [[1.0, 1.0]]), [0.0, 0.0], np.zeros((2, 2)))
    for wrong in ({"opening_rad": 7.0}, {"nearest_m": 5.0}, {"tolerance_m": 0.0}):
        given_ = {"opening_rad": 1.0, "nearest_m": 1.0, "farthest_m": 2.0, "tolerance_m": 1.0}
        with pytest.raises(ValueError, match="allowed"):
            annular_sector([0.0, 0.0], 0.0, **{**given_, **wrong})
