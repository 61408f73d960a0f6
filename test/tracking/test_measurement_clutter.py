"""Clutter density in the space of what a sensor measures: counts, conservation, and the ring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracking_examples import assert_same

from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.measurement_kinds import AZIMUTH, MEASUREMENT_MODELS
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.measurement_clutter import (
    CELL_PRIOR,
    MEAN_PRIOR,
    MeasurementClutter,
    densities,
    grid_shape,
    lowest_edge,
    observe,
    seen_volumes,
)
from gda_tracker.tracking.ring import Ring

BEARING = MEASUREMENT_MODELS["bearing"]
GIVEN, MEMORY = 0.3, 20.0
# Largest values of each quantity, by name.
REACH = {"range": 9000.0, "azimuth": math.pi, "range_rate": 300.0}


def watched(model, scans, known=None, sensor="a", memory=MEMORY):
    """The map after scans (n, m) without tracks."""
    known = known or MeasurementClutter()
    for value in scans:
        value = np.asarray(value, dtype=float).reshape(-1, len(model))
        known = observe(known, sensor, model, value, np.arange(len(value)), memory)
    return known


def random_scans(model, rng, count=25, mean=6.0):
    low = lowest_edge(model, np.array([REACH[q] for q in model.quantities]))
    high = np.array([REACH[q] for q in model.quantities])
    return [rng.uniform(low, high, (rng.poisson(mean), len(model))) for _ in range(count)]


def test_before_any_scan_it_is_the_density_given():
    local, mean = densities(MeasurementClutter(), "a", BEARING, np.zeros((3, 1)), GIVEN)
    np.testing.assert_array_equal(local, GIVEN)
    assert mean == GIVEN


def test_two_scans_of_bearings_by_hand():
    known = watched(BEARING, [[[0.1], [0.05], [-2.0]], [[0.1]]])
    keep = 1.0 - 1.0 / MEMORY
    exposure, total, here = 1.0 + keep, 3.0 * keep + 1.0, 2.0 * keep + 1.0
    expected = (MEAN_PRIOR + total) / (MEAN_PRIOR / GIVEN + exposure * 2.0 * math.pi)
    sector = exposure * math.radians(10.0)
    local, mean = densities(known, "a", BEARING, np.array([[0.12], [1.0]]), GIVEN)
    assert mean == pytest.approx(expected)
    assert local == pytest.approx(
        [(CELL_PRIOR + n) / (CELL_PRIOR / mean + sector) for n in (here, 0.0)]
    )


@pytest.mark.parametrize("name", ["bearing", "range", "tdoa", "bistatic_doppler", "doppler"])
def test_it_is_what_a_count_over_all_scans_gives(name):
    """Against histograms of the whole past on the final grid, each scan with its weight."""
    model, rng = MEASUREMENT_MODELS[name], np.random.default_rng(3)
    scans = random_scans(model, rng)
    known = watched(model, scans)
    # The range of the final grid: the smallest power of two beyond all that was measured.
    every = np.concatenate(scans)
    ends = [
        math.pi if q == AZIMUTH else 2.0 ** (math.floor(math.log2(farthest)) + 1)
        for q, farthest in zip(model.quantities, np.abs(every).max(axis=0), strict=True)
    ]
    begins = lowest_edge(model, np.array(ends))
    edges = [
        np.linspace(low, high, cells + 1)
        for low, high, cells in zip(begins, ends, grid_shape(model), strict=True)
    ]
    weights = (1.0 - 1.0 / MEMORY) ** np.arange(len(scans))[::-1]
    count = sum(
        w * np.histogramdd(value, edges)[0] for w, value in zip(weights, scans, strict=True)
    )
    np.testing.assert_allclose(known.counts_of(0), count, atol=1e-12)
    low, high = every.min(axis=0), every.max(axis=0)
    whole = [
        2.0 * math.pi if q == AZIMUTH else b - a
        for q, a, b in zip(model.quantities, low, high, strict=True)
    ]
    density = 1e-3
    mean = (MEAN_PRIOR + count.sum()) / (MEAN_PRIOR / density + weights.sum() * math.prod(whole))
    local, told = densities(known, "a", model, scans[0], density)
    assert told == pytest.approx(mean)
    for value, found in zip(scans[0], local, strict=True):
        cell, volume = [], 1.0
        for axis, edge in enumerate(edges):
            place = int(np.searchsorted(edge, value[axis], side="right")) - 1
            cell.append(place)
            a, b = edge[place], edge[place + 1]
            if model.quantities[axis] != AZIMUTH:
                a, b = max(a, low[axis]), min(b, high[axis])
            volume *= b - a
        expected = (CELL_PRIOR + count[tuple(cell)]) / (CELL_PRIOR / mean + weights.sum() * volume)
        assert found == pytest.approx(expected)


@given(
    st.sampled_from(sorted(MEASUREMENT_MODELS)),
    st.integers(0, 1000),
    st.floats(1e-3, 1e4),
)
@settings(max_examples=40)
def test_no_detection_is_lost_when_the_grid_grows(name, seed, factor):
    model, rng = MEASUREMENT_MODELS[name], np.random.default_rng(seed)
    turn = [1.0 if q == AZIMUTH else factor for q in model.quantities]
    scans = [scan * k / 8.0 * turn for k, scan in enumerate(random_scans(model, rng, 8), 1)]
    known = watched(model, scans, memory=1e12)
    assert known.count.sum() == pytest.approx(sum(map(len, scans)))
    # As if the grid had been as large from the start.
    largest = np.concatenate([*scans, np.zeros((1, len(model)))])
    at_once = watched(model, [largest], memory=1e12)
    extra = watched(model, [np.zeros((1, len(model)))], at_once, memory=1e12).count - at_once.count
    np.testing.assert_allclose(known.count, at_once.count - extra, atol=1e-6)


@given(st.integers(0, 1000), st.floats(0.5, 20.0))
@settings(max_examples=25)
def test_the_rates_of_all_cells_add_up_to_what_was_counted(seed, mean):
    scans = random_scans(BEARING, np.random.default_rng(seed), 30, mean)
    known = watched(BEARING, scans)
    counted = known.count.sum() / known.exposure_scans[0]
    if counted == 0.0:
        return
    centres = np.radians(np.arange(-175.0, 180.0, 10.0))[:, None]
    local, told = densities(known, "a", BEARING, centres, counted / (2.0 * math.pi))
    assert told * 2.0 * math.pi == pytest.approx(counted)
    assert local.sum() * math.radians(10.0) == pytest.approx(counted)


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
def test_it_converges_whatever_was_given(factor):
    """Three quarters of the false bearings in a sixth of the turn; the memory holds 200 scans."""
    rng = np.random.default_rng(5)
    scans = []
    for _ in range(600):
        coast = rng.uniform(0.0, math.pi / 3.0, rng.poisson(6.0))
        scans.append(np.concatenate([coast, rng.uniform(-math.pi, math.pi, rng.poisson(2.0))]))
    known = watched(BEARING, scans, memory=200.0)
    centres = np.radians(np.arange(-175.0, 180.0, 10.0))[:, None]
    told = factor * 8.0 / (2.0 * math.pi)
    local, mean = densities(known, "a", BEARING, centres, told)
    coast = (centres[:, 0] > 0.0) & (centres[:, 0] < math.pi / 3.0)
    quiet = 2.0 / (2.0 * math.pi)
    # Six sectors of 200 scans' weight: a standard error of 2 %; thirty sectors of 11 counts.
    assert local[coast].mean() == pytest.approx(quiet + 6.0 / (math.pi / 3.0), rel=0.06)
    assert local[~coast].mean() == pytest.approx(quiet, rel=0.2)
    assert mean == pytest.approx(8.0 / (2.0 * math.pi), rel=0.06)


def test_it_forgets_and_keeps_sensors_apart():
    rng = np.random.default_rng(6)
    model = MEASUREMENT_MODELS["range"]
    busy = watched(model, random_scans(model, rng, 60, 50.0))
    both = watched(model, random_scans(model, rng, 100, 5.0), busy)
    both = watched(BEARING, [[[1.0]]], both, sensor="b")
    point = np.array([[4000.0]])
    before, after = (densities(m, "a", model, point, 1e-3)[1] for m in (busy, both))
    assert before / after == pytest.approx(10.0, rel=0.3)
    assert both.counts_of(1).sum() == 1.0
    # What was there before stays as it was, and an unknown sensor has the density given.
    assert busy.sensor_ids == ("a",)
    assert densities(busy, "b", BEARING, np.zeros((1, 1)), GIVEN)[1] == GIVEN


def test_a_sensor_that_measures_something_else_begins_anew():
    known = watched(BEARING, [[[1.0], [2.0]]])
    known = watched(BEARING, [[[1.0]]], known, sensor="b")
    pair = MEASUREMENT_MODELS["tdoa_fdoa"]
    assert densities(known, "a", pair, np.zeros((1, 2)), GIVEN)[1] == GIVEN
    changed = watched(pair, [[[10.0, -3.0]]], known)
    assert dict(zip(changed.sensor_ids, changed.models, strict=True)) == {
        "a": "tdoa_fdoa",
        "b": "bearing",
    }
    assert changed.counts_of(changed.sensor_ids.index("b")).sum() == 1.0
    row = changed.sensor_ids.index("a")
    assert changed.counts_of(row).sum() == 1.0
    assert seen_volumes(changed, row).sum() == 0.0  # one point has no volume yet


# In the ring.


def _ring(method, n_scans, **changes):
    scenario = load_scenario("busy_coast")
    scenario = replace(scenario, time=replace(scenario.time, n_scans=n_scans))
    parameters = with_method(tracker_preset(scenario), method)
    parameters["track_manager"].update(mht_scans=4, gaussian_sum_components=6, **changes)
    return Ring(parameters), simulate_network(scenario, 1).detections, scenario


def _uniform(scenario, weight=1e12):
    """A map that knows for ever that false bearings are as many everywhere as the tracker is told.

    ``weight`` scans have made it.
    """
    counts = [
        np.full(36, sensor.clutter_density * math.radians(10.0) * weight)
        for sensor in scenario.sensors
    ]
    n = len(counts)
    return MeasurementClutter(
        tuple(sensor.id for sensor in scenario.sensors),
        ("bearing",) * n,
        np.tile([math.pi, 1.0, 1.0], (n, 1)),
        np.full((n, 3), -np.inf),
        np.full((n, 3), np.inf),
        np.full(n, weight),
        np.concatenate(counts),
    )


@pytest.mark.parametrize("method", ["gda/none/cv", "map/none/cv", "jpda/none/imm", "mht/none/cv"])
def test_a_uniform_map_decides_as_the_density_given_does(method):
    ring, scans, scenario = _ring(method, 8, clutter_memory_scans=1e12)
    ring.manager.state.measurement_clutter = _uniform(scenario)
    plain, _, _ = _ring(method, 8, clutter_density="given")
    for scan in scans:
        estimated, expected = ring.process(scan).tracks, plain.process(scan).tracks
        np.testing.assert_array_equal(estimated.track_id, expected.track_id)
        np.testing.assert_array_equal(estimated.status, expected.status)
        np.testing.assert_allclose(estimated.mean, expected.mean, rtol=1e-6, atol=1e-4)
        np.testing.assert_allclose(
            estimated.existence_probability, expected.existence_probability, atol=1e-8
        )


@pytest.mark.parametrize("method", ["gda/none/cv", "map/none/cv", "jpda/none/cv", "mht/none/cv"])
def test_every_pair_is_weighed_against_the_clutter_where_it_is(method):
    """With clutter in one sector alone: every decision sees the ratio that was counted."""
    ring, scans, scenario = _ring(method, 6)
    varied = 0
    for scan in scans:
        before = ring.manager.state.measurement_clutter
        result = ring.process(scan)
        seen, predictions = result.scan, result.predictions
        value = np.asarray(seen.azimuth_rad)[:, None]
        density = scenario.sensors[0].clutter_density
        local, mean = densities(before, seen.key.sensor_id, BEARING, value, density)
        np.testing.assert_allclose(seen.relative_clutter_density, local / mean)
        if len(predictions):
            assert predictions.settings.clutter_density == pytest.approx(mean)
        varied += len(seen) > 1 and np.ptp(local) > 0.0
        pairs = gate(seen, predictions)
        plain = gate(replace(seen, relative_clutter_density=None), predictions)
        np.testing.assert_allclose(
            pairs.log_likelihood - np.log(predictions.settings.clutter_density),
            plain.log_likelihood - np.log(local[pairs.detection]),
        )
        np.testing.assert_array_equal(
            result.associations.kinematic_log_likelihood, pairs.log_likelihood
        )
    assert varied > 3


def test_tracks_start_against_the_false_bearings_of_their_place():
    ring, scans, _ = _ring("mht/none/cv", 5, mht_new_target_ratio=0.02)
    started = []
    for scan in scans:
        result = ring.process(scan)
        table = ring.manager.state.table
        born = np.flatnonzero(
            (table.first_detection_ns == scan.stamp_ns) & (table.detection_index >= 0)
        )
        row = {source: place for place, source in enumerate(result.scan.source_index.tolist())}
        places = [row[source] for source in table.detection_index[born].tolist()]
        expected = np.log(0.02) - np.log(result.scan.relative_clutter_density[places])
        np.testing.assert_allclose(table.log_prior_odds[born], expected)
        np.testing.assert_allclose(table.log_score[born], expected)
        started += expected.tolist()
    assert len(set(started)) > 3


def test_detections_of_confirmed_tracks_and_scans_given_up_do_not_count():
    ring, scans, _ = _ring("map/none/cv", 20)
    before = confirmed = 0.0
    for number, scan in enumerate(scans):
        if number == 10:
            known = ring.manager.state.measurement_clutter
            ring.manager.admit(scan)
            ring.manager.open()
            ring.manager.give_up()
            assert_same(ring.manager.state.measurement_clutter, known)
            continue
        known = ring.manager.state.measurement_clutter
        before = 0.0
        if scan.sensor_id in known.sensor_ids:
            before = known.counts_of(known.sensor_ids.index(scan.sensor_id)).sum()
        result = ring.process(scan)
        known = ring.manager.state.measurement_clutter
        after = known.counts_of(known.sensor_ids.index(scan.sensor_id)).sum()
        table = ring.manager.state.table
        taken = set(table.detection_index[(table.status == 1) & (table.detection_index >= 0)])
        taken &= set(result.scan.source_index.tolist())
        own = [
            source
            for source in taken
            if (result.assigned >= 0).any()
            and source in result.scan.source_index[result.assigned[result.assigned >= 0]]
        ]
        confirmed += len(own)
        assert after == pytest.approx(0.98 * before + len(result.scan) - len(own))
    assert confirmed > 0


@pytest.mark.parametrize("method", ["mht/none/cv", "jpda/none/cv"])
def test_a_restart_goes_on_bit_for_bit(method, tmp_path):
    whole, scans, _ = _ring(method, 8)
    second, _, _ = _ring(method, 8)
    for scan in scans[:10]:
        whole.process(scan)
    save(whole.manager, tmp_path / "state")
    assert load(second.manager, tmp_path / "state")
    assert_same(second.manager.state.measurement_clutter, whole.manager.state.measurement_clutter)
    for scan in scans[10:]:
        assert_same(whole.process(scan).tracks, second.process(scan).tracks)


def test_what_no_sensor_measures_is_not_counted():
    model = MEASUREMENT_MODELS["fdoa"]
    one = np.array([[20.0], [-30.0]])
    known = observe(MeasurementClutter(), "s", model, one, np.arange(2), 50.0)
    for garbage in (1e300, -1.7e308):
        mad = np.concatenate([one, [[garbage]]])
        found = observe(MeasurementClutter(), "s", model, mad, np.arange(3), 50.0)
        np.testing.assert_array_equal(found.extent, known.extent)
        np.testing.assert_array_equal(found.count, known.count)
        local, mean = densities(found, "s", model, mad, 1e-3)
        assert np.isfinite(local).all()
        assert mean > 0.0
