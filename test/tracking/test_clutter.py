"""Clutter density: worked values, convergence on simulated clutter, regions, forgetting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.kinematics.sensor_models import PolarMeasurements
from gda_tracker.tracking.clutter import (
    AZIMUTH_CELLS,
    FIRST_PRIOR_SCANS,
    LEAST_PRIOR_SCANS,
    RANGE_CELLS,
    ClutterMap,
    densities,
    observe,
)

GIVEN = 1e-4
MEMORY = 50.0


def measured(range_m, azimuth_rad):
    range_m = np.asarray(range_m, dtype=float)
    n = len(range_m)
    return PolarMeasurements(
        range_m, np.asarray(azimuth_rad, dtype=float), np.zeros((n, 2, 2)), np.zeros(2), None
    )


def watched(scans, clutter=None, sensor_id="radar", memory=MEMORY):
    """The map after scans of (range, azimuth), none of them of a track."""
    clutter = clutter or ClutterMap()
    for range_m, azimuth_rad in scans:
        points = measured(range_m, azimuth_rad)
        clutter = observe(clutter, sensor_id, points, np.arange(len(points)), memory)
    return clutter


def at(clutter, range_m, azimuth_rad, given_density=GIVEN, memory=MEMORY, sensor_id="radar"):
    return densities(
        clutter,
        sensor_id,
        np.atleast_1d(np.asarray(range_m, dtype=float)),
        np.atleast_1d(np.asarray(azimuth_rad, dtype=float)),
        given_density,
        memory,
    )


def test_before_any_scan_it_is_the_density_given():
    np.testing.assert_array_equal(at(ClutterMap(), [10.0, 1e6], [0.0, 1.0]), [GIVEN, GIVEN])
    other = watched([([100.0], [0.1])])
    assert at(other, 100.0, 0.1, sensor_id="another")[0] == GIVEN


def test_two_scans_by_hand():
    # Farthest 1500 m: the grid reaches 2048 m in 16 cells of 128 m and 12 of 30 degrees.
    clutter = watched([([700.0, 1500.0, 720.0], [0.1, 2.0, 0.2]), ([650.0], [0.3])])
    assert clutter.extent_m[0] == 2048.0
    exposure = 1.0 + (1.0 - 1.0 / MEMORY)
    prior = FIRST_PRIOR_SCANS * (1.0 - exposure / MEMORY)
    volume = 128.0 * math.pi / 6.0
    count = 2.0 * (1.0 - 1.0 / MEMORY) + 1.0
    expected = (prior * GIVEN + count / volume) / (prior + exposure)
    assert at(clutter, 650.0, 0.4)[0] == pytest.approx(expected)
    empty = prior * GIVEN / (prior + exposure)
    np.testing.assert_allclose(at(clutter, [650.0, 800.0], [0.6, 0.1]), empty)
    assert at(clutter, 2048.0, 0.1)[0] == GIVEN


def uniform(rng, mean, far=8000.0, scans=400):
    for _ in range(scans):
        n = rng.poisson(mean)
        yield rng.uniform(0.0, far, n), rng.uniform(-math.pi, math.pi, n)


@pytest.mark.parametrize("given_density", [1e-5, 1e-3, 0.1])
def test_it_converges_to_the_density_of_simulated_clutter(given_density):
    """Whatever was given before; the scatter of a cell is that of its Poisson count."""
    rng = np.random.default_rng(1)
    mean, far = 400.0, 8192.0 * 0.999
    truth = mean / (far * 2.0 * math.pi)
    clutter = watched(uniform(rng, mean, far, 500), memory=200.0)
    assert clutter.extent_m[0] == 8192.0
    r = (np.arange(RANGE_CELLS) + 0.5) * (8192.0 / RANGE_CELLS)
    a = (np.arange(AZIMUTH_CELLS) + 0.5) * (2.0 * math.pi / AZIMUTH_CELLS) - math.pi
    grid = [values.ravel() for values in np.meshgrid(r, a)]
    found = at(clutter, *grid, given_density, memory=200.0)
    exposure = clutter.exposure_scans[0]
    left = max(FIRST_PRIOR_SCANS * (1.0 - exposure / 200.0), LEAST_PRIOR_SCANS)
    biased = (left * given_density + exposure * truth) / (left + exposure)
    # sum of w counts: variance of the mean truth sum w^2 / (sum w)^2, here 1 / (2 memory).
    scatter = math.sqrt(truth / (8192.0 / RANGE_CELLS * math.pi / 6.0) / 400.0)
    assert found.mean() == pytest.approx(biased, abs=4.0 * scatter / math.sqrt(len(found)))
    assert found.std() == pytest.approx(scatter, rel=0.2)
    if given_density <= 10.0 * truth:
        assert found.mean() == pytest.approx(truth, rel=0.02)


def test_regions_have_densities_of_their_own():
    rng = np.random.default_rng(2)
    scans = []
    for _ in range(300):
        sea, land = rng.poisson(100), rng.poisson(200)
        r = np.concatenate([rng.uniform(0.0, 1000.0, sea), rng.uniform(500.0, 1000.0, land)])
        a = np.concatenate([rng.uniform(0, 2 * math.pi, sea), rng.uniform(0, math.pi, land)])
        scans.append((r, a))
    clutter = watched(scans)
    sea, land = 100 / (1000 * 2 * math.pi), 200 / (500 * math.pi)
    # Cells of 64 m: none of these straddles a border.
    azimuth = np.array([0.3, 1.3, 2.3, 2.8])
    np.testing.assert_allclose(at(clutter, np.full(4, 700.0), azimuth).mean(), sea + land, rtol=0.1)
    np.testing.assert_allclose(at(clutter, np.full(4, 700.0), -azimuth).mean(), sea, rtol=0.35)
    np.testing.assert_allclose(at(clutter, np.full(4, 300.0), azimuth).mean(), sea, rtol=0.35)


def test_it_forgets():
    rng = np.random.default_rng(3)
    busy = watched(uniform(rng, 500.0, 1000.0, 100), memory=20.0)
    quiet = watched(uniform(rng, 50.0, 1000.0, 100), busy, memory=20.0)
    r, a = rng.uniform(0.0, 960.0, 2000), rng.uniform(-3.0, 3.0, 2000)
    before, after = (at(m, r, a, memory=20.0).mean() for m in (busy, quiet))
    assert before / after == pytest.approx(10.0, rel=0.15)


def test_tracks_do_not_count_and_sensors_are_apart():
    points = measured([100.0, 110.0], [0.1, 0.1])
    none = observe(ClutterMap(), "a", points, np.zeros(0, dtype=np.int64), MEMORY)
    one = observe(none, "b", points, np.array([1]), MEMORY)
    assert one.sensor_ids == ("a", "b")
    np.testing.assert_array_equal(one.count.sum(axis=(1, 2)), [0.0, 1.0])
    # What was there before stays as it was.
    assert none.sensor_ids == ("a",)
    again = observe(one, "a", points, np.array([0, 1]), MEMORY)
    np.testing.assert_array_equal(one.count.sum(axis=(1, 2)), [0.0, 1.0])
    np.testing.assert_allclose(again.exposure_scans, [1.98, 1.0])


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=6), st.integers(0, 10))
def test_a_growing_grid_loses_no_detection(ranges, seed):
    azimuth = np.random.default_rng(seed).uniform(-math.pi, math.pi, len(ranges))
    step_by_step = watched([([r], [a]) for r, a in zip(ranges, azimuth, strict=True)], memory=1e12)
    assert step_by_step.count.sum() == pytest.approx(len(ranges))
    assert step_by_step.extent_m[0] > max(ranges)
    # As if the grid had been as large from the start.
    first = watched([([max(ranges)], [0.0])], memory=1e12)
    whole = watched([([r], [a]) for r, a in zip(ranges, azimuth, strict=True)], first, memory=1e12)
    np.testing.assert_allclose(step_by_step.count[0], whole.count[0] - first.count[0], atol=1e-9)
