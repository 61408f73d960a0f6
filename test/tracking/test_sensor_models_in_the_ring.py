"""Sensors with a model of their own round the ring: every decision and filter, ghosts, restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.evaluation.runs import method_parameters
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.scans import Detections
from gda_tracker.vocabulary.statements import Statement, StatementPiece, StatementRegion
from gda_tracker.vocabulary.tracks import CONFIRMED


def _scenario(name, **timing):
    scenario = load_scenario(name)
    reach = replace(scenario.reach, components=min(scenario.reach.components, 16))
    return replace(scenario, time=replace(scenario.time, **timing), reach=reach)


def _play(scenario, method, run=0, seed=1, **changes):
    recording = simulate_network(scenario, seed, run)
    parameters = with_method(tracker_preset(scenario), method)
    parameters["track_manager"].update(changes)
    ring = Ring(parameters)
    return ring, [ring.process(scan) for scan in recording.detections], recording


def _errors(result, truth):
    """Distance [m] of the nearest confirmed track to each target."""
    tracks = result.tracks
    mean = tracks.mean[tracks.status == CONFIRMED, :2]
    gap = truth.target_state[:, None, :2] - mean
    return np.hypot(gap[..., 0], gap[..., 1]).min(axis=1, initial=np.inf)


@pytest.mark.parametrize("method", ["gda/none/cv", "map/none/imm", "jpda/none/imm", "mht/bayes/cv"])
def test_time_and_frequency_differences_lead_to_the_emitter(method):
    _, results, recording = _play(_scenario("moving_emitter", n_scans=45), method)
    assert _errors(results[-1], recording.truth[-1]).max() < 400.0
    assert max(len(r.predictions.component_weight) for r in results) > 10
    # In the end one component, or one for each model, is left of the emitter's own track.
    last = results[-1].predictions
    assert np.diff(last.component_start).min() <= 3


def test_second_order_models_are_merged_with_sums():
    _, results, _ = _play(_scenario("moving_emitter", n_scans=8), "mht/none/gpb2")
    assert all(np.isfinite(r.tracks.covariance).all() for r in results)
    assert results[-1].predictions.component_model.max() == 1


def test_trees_resolve_the_ghosts_of_crossing_bearings():
    scenario = _scenario("crossing_bearings", n_scans=21)
    errors = {}
    for method in ("map/none/cv", "mht/none/cv"):
        _, results, recording = _play(scenario, method, run=0)
        errors[method] = _errors(results[-1], recording.truth[-1])
    assert errors["mht/none/cv"].max() < 100.0
    # The most probable assignment of each scan holds on to the two ghosts.
    assert errors["map/none/cv"].min() > 500.0


def test_three_kinds_of_sensors_find_one_target():
    _, results, recording = _play(_scenario("mixed_sensors"), "mht/none/cv")
    errors = [
        _errors(result, truth).max()
        for result, truth in zip(results[60:], recording.truth[60:], strict=True)
    ]
    assert np.median(errors) < 120.0


def test_the_gate_has_the_dimension_and_density_of_the_sensor():
    """A quantile of chi-square with as many degrees of freedom as quantities; P_D by sensor."""
    _, results, _ = _play(_scenario("mixed_sensors", n_scans=12), "map/none/cv")
    told = {r.scan.key.sensor_id: r.predictions for r in results if len(r.predictions)}
    density = {name: p.settings.clutter_density for name, p in told.items()}
    assert density["finder"] == pytest.approx(0.5 / (2.0 * np.pi))
    assert density["passive"] == pytest.approx(1.0 / (61_000.0 * 800.0))
    assert density["beacon"] == pytest.approx(0.5 / 39_000.0)
    assert told["passive"].detection_probability[0] == 0.8
    largest = {"finder": 10.83, "passive": 13.82, "beacon": 10.83}  # tables, 99.9 %
    for name, limit in largest.items():
        squared = [
            r.associations.mahalanobis_squared
            for r in results
            if r.scan.key.sensor_id == name and len(r.associations.detection)
        ]
        assert np.concatenate(squared).max() <= limit


def test_sensors_may_keep_up_tracks_that_a_radar_starts():
    """A bearing finder off to the side takes the cross-range error from a radar's track."""
    parameters = {
        "filter": "cv",
        "attribute_term": "none",
        "range_std_m": 10.0,
        "azimuth_std_rad": 0.02,
        "sensor_ids": ["finder"],
        "sensor_models": ["bearing"],
        "sensor_azimuth_stds_rad": [0.001],
        "sensor_clutter_densities": [0.01],
        "gaussian_sum_start": False,
    }
    spread = []
    for finds in (False, True):
        ring = Ring({"track_manager": parameters})
        for k in range(6):
            scan = Detections("radar", 2 * k * 10**9, np.array([10_000.0]), np.array([0.0]))
            result = ring.process(scan)
            if finds:
                seen = Detections(
                    "finder",
                    (2 * k + 1) * 10**9,
                    np.array([np.nan]),
                    np.array([0.0]),
                    sensor_position_m=np.array([-2_000.0, 0.0, 0.0]),
                )
                result = ring.process(seen)
                assert len(result.tracks) == (k > 0)
        spread.append(np.sqrt(result.tracks.covariance[0, 1, 1]))
    assert spread[1] < 0.25 * spread[0]


def test_a_restart_in_the_middle_of_a_sum_changes_nothing(tmp_path):
    scenario = _scenario("moving_emitter", n_scans=12)
    parameters = with_method(tracker_preset(scenario), "mht/none/imm")
    scans = simulate_network(scenario, 3, 0).detections
    through, stopped = Ring(parameters), Ring(parameters)
    for scan in scans[:5]:
        for ring in (through, stopped):
            ring.process(scan)
    assert stopped.manager.state.table.spread > 1
    checkpoint.save(stopped.manager, tmp_path / "state")
    again = Ring(parameters)
    assert checkpoint.load(again.manager, tmp_path / "state")
    assert again.manager.state.table.spread == stopped.manager.state.table.spread
    for scan in scans[5:]:
        one, other = through.process(scan).tracks, again.process(scan).tracks
        np.testing.assert_array_equal(one.mean, other.mean)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_the_filter_may_change_while_states_are_sums():
    scenario = _scenario("moving_emitter", n_scans=12)
    ring = Ring(with_method(tracker_preset(scenario), "map/none/cv"))
    for k, scan in enumerate(simulate_network(scenario, 3, 0).detections):
        if k in (3, 6):
            ring.set_parameters({"track_manager": {"filter": "imm" if k == 3 else "cv"}})
        result = ring.process(scan)
        assert np.isfinite(result.tracks.covariance).all()
    assert ring.manager.state.table.models == ()


def test_a_pair_that_does_not_say_where_it_is_is_refused():
    parameters = tracker_preset(load_scenario("moving_emitter"))
    ring = Ring(parameters)
    scan = Detections("pair", 0, np.array([1.0]), np.array([np.nan]), range_rate_mps=np.ones(1))
    report = ring.process(scan).report
    assert (report.outcome, report.reason) == ("rejected", "reference_missing")


def test_labelled_tracks_need_positions():
    with pytest.raises(ParameterError, match="allowed is automatic"):
        method_parameters(load_scenario("moving_emitter"), "map/none/cv", "labelled")


def test_somebody_who_knows_where_it_is_shortens_the_ray():
    """A statement weighs the components of a sum, and what a detection makes of them."""
    scenario = _scenario("two_sensors", n_scans=3)
    ring = Ring(with_method(tracker_preset(scenario), "mht/none/cv"))
    recording = simulate_network(scenario, 1, 0)
    seen = [scan for scan in recording.detections if scan.sensor_id == "west"]
    before = ring.process(seen[0]).tracks
    x, y = recording.truth[0].target_state[0, :2]
    near = StatementRegion("gaussian", centre_m=(x, y), covariance_m2=(1e6, 0.0, 0.0, 1e6))
    said = Statement(
        "lookout", 1, seen[1].stamp_ns, "fuzzy", "track", (StatementPiece(near),), 1, frame_id="map"
    )
    assert ring.say(said).outcome == "admitted"
    after = ring.process(seen[1]).tracks
    assert np.trace(before.covariance[0, :2, :2]) > 5_000.0**2
    assert np.trace(after.covariance[0, :2, :2]) < 1_500.0**2
    assert np.hypot(*(after.mean[0, :2] - (x, y))) < 1_000.0


def test_a_place_spoken_of_says_nothing_about_what_has_no_place():
    scenario = _scenario("two_sensors", n_scans=3)
    scan = simulate_network(scenario, 1, 0).detections[0]
    rings = [Ring(with_method(tracker_preset(scenario), "map/bayes/cv")) for _ in range(2)]
    box = StatementRegion("box", low_m=(-1e5, -1e5), high_m=(1e5, 1e5))
    piece = StatementPiece(box, ("ship",), (1.0,))
    said = Statement("lookout", 1, 0, "fuzzy", "place", (piece,), frame_id="map")
    assert rings[1].say(said).outcome == "admitted"
    evidence = [ring.process(scan).evidence.log_class_likelihood for ring in rings]
    np.testing.assert_array_equal(*evidence)
