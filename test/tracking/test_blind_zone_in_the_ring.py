"""A blind zone round the ring: stops survived, likelihoods that sum to one, NEES, restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.stats import chi2
from tracking_examples import SECOND, assert_same, initial_tracks, same_tracks

from gda_tracker.kinematics.blind_zone import BlindZone, detection_probability_at, notched_share
from gda_tracker.kinematics.gating import gate
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario, scenario_from_mapping, shipped_scenarios
from gda_tracker.simulation.schema import ScenarioError
from gda_tracker.simulation.simulate import simulate
from gda_tracker.simulation.targets import true_states
from gda_tracker.simulation.world_sections import Stop
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, Detections

METHODS = ["gda/none/imm", "map/none/imm", "jpda/none/imm", "mht/none/imm"]


def stop_and_go(**manager):
    """Parameters and scans of one vehicle that stops, with little clutter."""
    scenario = load_scenario("stop_and_go")
    scenario = replace(
        scenario,
        targets=(replace(scenario.targets[0], stops=(Stop(12.0, 28.0, 2.5),)),),
        time=replace(scenario.time, n_scans=40),
        clutter=replace(scenario.clutter, mean_false_alarms_per_scan=0.5),
        tracker=replace(scenario.tracker, extraneous_return_density_per_rad_m=1.2e-4),
    )
    parameters = tracker_preset(scenario, "automatic")
    parameters["track_manager"].update(manager)
    return parameters, simulate(scenario, 4, 0, initiation="automatic"), scenario


def play(parameters, method, scans):
    ring = Ring(with_method(parameters, method))
    return ring, [ring.process(scan) for scan in scans]


def on_target(results, truth):
    """Id of the confirmed track within 60 m of the target on each scan, -1 for none."""
    found = []
    for result, true in zip(results, truth, strict=True):
        tracks = result.tracks
        gap = np.hypot(*(tracks.mean[:, :2] - true.target_state[0, :2]).T)
        near = np.flatnonzero((gap < 60.0) & (tracks.status == CONFIRMED))
        found.append(int(tracks.track_id[near[0]]) if len(near) else -1)
    return np.array(found)


@pytest.mark.parametrize("method", METHODS)
def test_a_track_lives_through_its_stop(method):
    parameters, recording, _ = stop_and_go()
    _, aware = play(parameters, method, recording.detections)
    parameters["track_manager"]["blind_speed_mps"] = 0.0
    _, unaware = play(parameters, method, recording.detections)
    # Scans 15 to 28: it stands. Before and after it drives.
    with_zone, without = (on_target(r, recording.truth) for r in (aware, unaware))
    assert len(set(with_zone[8:].tolist())) == 1
    assert with_zone[8] >= 0
    assert (without[22:27] == -1).all()
    assert without[11] != without[-1]
    # Where it stands it is not expected to be seen, and it is known to stand.
    stands = aware[26]
    row = int(np.flatnonzero(stands.tracks.track_id == with_zone[26])[0])
    asked = np.flatnonzero(stands.predictions.track_id == with_zone[26])
    assert stands.predictions.detection_probability[asked].max() < 0.4
    assert np.hypot(*stands.tracks.mean[row, 2:]) < 1.0
    assert stands.tracks.existence_probability[row] > 0.9


def test_without_a_standstill_model_a_track_gains_little_and_breaks_nothing():
    parameters, recording, _ = stop_and_go()
    for method in ("map/none/cv", "jpda/none/gpb2"):
        _, results = play(parameters, method, recording.detections)
        told = np.concatenate([r.predictions.detection_probability for r in results])
        assert told.min() >= 0.0
        assert told.max() <= 0.9
        assert all(np.isfinite(r.tracks.covariance).all() for r in results)


def test_detection_and_miss_of_a_hypothesis_sum_to_one():
    """P N integrated over the gate's plane is P, component by component P_d w (1 - E)."""
    parameters, recording, _ = stop_and_go(
        gate_probability=0.999999, max_detections_per_scan=20_000
    )
    ring = Ring(with_method(parameters, "map/none/imm"))
    for scan in recording.detections[:14]:
        result = ring.process(scan)
    opened_scan = replace(recording.detections[14])
    ring.manager.admit(opened_scan)
    opened = ring.manager.open()
    told, table = opened.predictions, opened.table
    zone = BlindZone(2.0, 0.9, np.zeros(2))
    m = table.model_weight.shape[1]
    share = notched_share(
        table.model_mean.reshape(-1, 4), table.model_covariance.reshape(-1, 4, 4), zone
    ).reshape(-1, m)
    seen = 0.9 * (1.0 - share)
    np.testing.assert_allclose(
        told.detection_probability, (table.model_weight * seen).sum(axis=1), rtol=1e-12
    )
    conditional = told.detection_probability[:, None] * told.component_weight.reshape(-1, m)
    np.testing.assert_allclose(conditional, table.model_weight * seen, rtol=1e-12)
    # Over a fine lattice of detections around the hypothesis the likelihoods sum to P.
    row = int(np.argmax(table.age_scans))
    centre, spread = table.mean[row, :2], np.sqrt(np.trace(table.covariance[row, :2, :2]))
    r0, a0 = np.hypot(*centre), np.arctan2(centre[1], centre[0])
    reach = 7.0 * (spread + 20.0)
    r = np.linspace(r0 - reach, r0 + reach, 120)
    a = np.linspace(a0 - reach / r0, a0 + reach / r0, 120)
    rr, aa = np.meshgrid(r, a)
    lattice = Detections("radar", opened_scan.stamp_ns, rr.ravel(), aa.ravel())
    scan, _ = Ring(parameters).manager.validate(lattice)
    pairs = gate(scan, told)
    mine = pairs.hypothesis == row
    cell = (r[1] - r[0]) * (a[1] - a[0])
    total = np.exp(pairs.log_likelihood[mine]).sum() * cell
    assert total == pytest.approx(1.0, abs=2e-3)
    assert result.report.outcome == "tracked"


def test_checkpoint_in_the_middle_of_a_stop(tmp_path):
    parameters, recording, _ = stop_and_go()
    ring, _ = play(parameters, "mht/none/imm", recording.detections[:22])
    assert ring.manager.state.table.blind_scans.max() > 2.0
    checkpoint.save(ring.manager, tmp_path / "state")
    other = Ring(with_method(parameters, "mht/none/imm"))
    assert checkpoint.load(other.manager, tmp_path / "state")
    for scan in recording.detections[22:32]:
        same_tracks(ring.process(scan).tracks, other.process(scan).tracks)


def test_a_zone_is_not_for_sensors_that_have_none():
    """Of a bearing finder the zone changes no bit; each sensor has its own speed."""
    manager = {
        "filter": "cv",
        "attribute_term": "none",
        "decision": "map",
        "sensor_ids": ["finder", "blind", "keen"],
        "sensor_models": ["bearing", "range_azimuth", "doppler"],
        "sensor_clutter_densities": [0.01, 1e-6, 1e-6],
        "gaussian_sum_start": False,
    }
    told = {}
    for name, change in (
        ("off", {}),
        ("own", {"sensor_blind_speeds_mps": [30.0, 5.0, 20.0]}),
        ("all", {"blind_speed_mps": 5.0}),
    ):
        ring = Ring({"track_manager": {**manager, **change}})
        for k in range(3):
            ring.process(
                Detections("blind", k * SECOND, np.array([5000.0 + 3.0 * k]), np.array([0.1]))
            )
        found = {}
        for k, sensor in enumerate(("finder", "blind", "keen")):
            nothing = np.zeros(0)
            scan = Detections(sensor, (3 + k) * SECOND, nothing, nothing, range_rate_mps=nothing)
            found[sensor] = ring.process(scan).predictions.detection_probability
        told[name] = found
    assert told["off"]["finder"] == told["own"]["finder"] == told["all"]["finder"] == 0.9
    assert told["own"]["blind"] == told["all"]["blind"] < 0.9
    assert told["own"]["keen"] < told["all"]["keen"] < 0.9


def test_a_target_that_never_comes_back_is_given_up():
    parameters, recording, _ = stop_and_go(blind_longest_s=30.0)
    scans = recording.detections[:22]
    nothing = np.zeros(0)
    silent = [
        Detections("radar", scans[-1].stamp_ns + 2 * k * SECOND, nothing, nothing)
        for k in range(1, 20)
    ]
    for method in ("map/none/imm", "mht/none/imm"):
        _, results = play(parameters, method, scans + silent)
        assert (results[21].tracks.status == CONFIRMED).sum() == 1
        assert not len(results[-1].tracks)


MODELS = np.array([[0.95, 0.08], [0.05, 0.92]])
"""p(j | i) of driving and standing: columns sum to one."""
STANDING_MPS = 0.1


def matched(zone, n=64, scans=30, seed=8, q=0.5, stops=False):
    """Slow targets that move as the filter believes, far from each other, and what is seen.

    ``stops``: they change between the filter's two models, driving and standing.
    """
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2)[:n]
    start = np.hstack([3000.0 + 600.0 * cells, np.zeros((n, 2))])
    spread = np.diag([25.0, 25.0, 16.0, 16.0])
    state = start + rng.multivariate_normal(np.zeros(4), spread, n)
    stands = np.zeros(n, dtype=bool)
    if stops:
        stands = rng.random(n) < MODELS[1, 0] / (MODELS[1, 0] + MODELS[0, 1])
    states, told = [], []
    for k in range(scans):
        a = rng.normal(0.0, q, (n, 2))
        state_before = state
        state = np.hstack([state[:, :2] + state[:, 2:] + 0.5 * a, state[:, 2:] + a])
        if stops:
            stands = rng.random(n) < np.where(stands, MODELS[1, 1], MODELS[1, 0])
            slow = rng.normal(0.0, STANDING_MPS, (n, 2))
            rests = np.hstack([state_before[:, :2] + slow, slow])
            state = np.where(stands[:, None], rests, state)
        r = np.hypot(*state[:, :2].T)
        rate = np.sum(state[:, :2] * state[:, 2:], axis=1) / r
        seen = rng.random(n) < detection_probability_at(rate, zone)
        told.append(
            Detections(
                "radar",
                (11 + k) * SECOND,
                r[seen] + rng.normal(0.0, 5.0, seen.sum()),
                np.arctan2(state[seen, 1], state[seen, 0]) + rng.normal(0.0, 0.001, seen.sum()),
                range_rate_mps=rate[seen] + rng.normal(0.0, 0.3, seen.sum()),
            )
        )
        states.append(state)
    first = initial_tracks(n, mean=start, covariance=np.tile(spread, (n, 1, 1)))
    return first, told, np.array(states)


def followed(first, scans, **manager):
    """Tracks after each scan of targets as :func:`matched` makes them."""
    parameters = {
        "initiation": "labelled",
        "attribute_term": "none",
        "filter": "cv",
        "process_noise_std_mps2": 0.5,
        "range_std_m": 5.0,
        "azimuth_std_rad": 0.001,
        "range_rate_std_mps": 0.3,
        "detection_probability": 0.95,
        "gate_probability": 0.99999,
        "clutter_density_per_m_rad": 1e-9,
        "deletion_misses": 0,
        "blind_longest_s": 0.0,
    }
    ring = Ring({"track_manager": parameters | manager})
    ring.initialise(first)
    return [ring.process(scan).tracks for scan in scans]


def squared_errors(tracks, states):
    """NEES (K, n) of all targets on all scans."""
    gap = np.array([one.mean for one in tracks]) - states
    covariance = np.array([one.covariance for one in tracks])
    return np.sum(gap * np.linalg.solve(covariance, gap[..., None])[..., 0], axis=2)


@pytest.mark.parametrize("decision", ["map", "jpda", "mht"])
def test_the_filter_is_consistent_on_matched_targets(decision):
    """NEES of all targets over all scans, hits and misses, is 4; range rates gain."""
    zone = BlindZone(2.5, 0.95, np.zeros(2))
    first, scans, states = matched(zone)
    squared: dict[float, np.ndarray] = {}
    wrong: dict[float, list] = {}
    for speed in (2.5, 0.0):
        told = followed(first, scans, decision=decision, blind_speed_mps=speed)
        squared[speed], wrong[speed] = squared_errors(told, states), []
        for tracks, truth in zip(told, states, strict=True):
            gap = tracks.mean - truth
            along = np.sum(gap[:, 2:] * truth[:, :2], axis=1) / np.hypot(*truth[:, :2].T)
            wrong[speed].append(along[tracks.coasted_scans > 0] ** 2)
    assert_consistent(squared[2.5])
    # On any one scan the targets are independent; nearly all scans lie in the 99 % interval. (With
    # several models the errors are no Gaussians, and scatter more.)
    low, high = chi2.ppf([0.005, 0.995], 4 * states.shape[1])
    total = squared[2.5].sum(axis=1)
    assert ((total > low) & (total < high)).mean() >= 0.9
    # What misses tell makes velocities better known.
    aware, unaware = (np.concatenate(wrong[speed]).mean() for speed in (2.5, 0.0))
    assert aware < 0.8 * unaware


@pytest.mark.parametrize("decision", ["map", "jpda", "mht"])
def test_imm_is_consistent_on_targets_that_drive_and_stand(decision):
    zone = BlindZone(2.5, 0.95, np.zeros(2))
    first, scans, states = matched(zone, stops=True)
    told = followed(
        first,
        scans,
        decision=decision,
        blind_speed_mps=2.5,
        filter="imm",
        imm_models=["constant_velocity", "standstill"],
        imm_process_noise_factors=[1.0, STANDING_MPS / 0.5],
        imm_switching="per_scan",
        imm_transition=MODELS.T.ravel().tolist(),
    )
    assert_consistent(squared_errors(told, states))


def assert_consistent(squared):
    """The mean of the NEES (K, n) of n independent targets is 4."""
    n = squared.shape[1]
    # One value for each target, a mean over scans that hang together: their own scatter tells how
    # far the mean of all may be from 4.
    mean = np.mean(squared, axis=0)
    error = mean.std(ddof=1) / np.sqrt(n)
    assert error < 0.3
    assert abs(mean.mean() - 4.0) < 2.6 * error


def test_scenario_with_a_stop():
    scenario = load_scenario("stop_and_go")
    states = true_states(scenario)
    way = np.diff(states[..., :2], axis=0)
    # Positions are the integral of the velocities: Simpson's rule is exact but where it changes.
    middle = 0.5 * (states[1:, :, 2:] + states[:-1, :, 2:]) * scenario.time.scan_period_s
    assert np.abs(way - middle).max() < 1.5
    assert np.count_nonzero(np.hypot(*states[:, 0, 2:].T) == 0.0) == 16
    np.testing.assert_allclose(np.hypot(*states[-1, :, 2:].T), [15.0, 12.0, 10.0])
    recording = simulate(scenario, 1, 0, initiation="automatic")
    standing = np.hypot(*states[:, 0, 2:].T) == 0.0
    seen = np.array([1 in t.source_id for t in recording.truth])
    assert not seen[standing].any()
    assert recording.detections[5].range_rate_mps is not None
    unaware = simulate(load_scenario("stop_and_go_unaware"), 1, 0, initiation="automatic")
    assert_same(unaware.detections, recording.detections)


def test_scenarios_with_stops_on_bends_are_refused():
    content = yaml.safe_load(shipped_scenarios()["stop_and_go"].read_text())
    content["tracker"]["extraneous_return_density_per_rad_m"] = 1e-3
    turn = {"start_scan": 2, "end_scan": 9, "lateral_acceleration_g": 0.1, "turn": "left"}
    content["targets"][0]["manoeuvres"] = [turn]
    with pytest.raises(ScenarioError, match="stops: allowed are none"):
        scenario_from_mapping(content)


def test_models_that_are_not_combined_are_refused():
    for change, other in (
        ({"signal_strength": "swerling_1"}, "signal_strength"),
        ({"resolution_range_m": 50.0, "resolution_azimuth_rad": 0.01}, "resolution_range_m"),
        ({"detection_probability_map": "estimated"}, "detection_probability_map"),
    ):
        with pytest.raises(ParameterError, match=f"blind_speed_mps.*{other}"):
            Ring({"track_manager": {"blind_speed_mps": 2.0, **change}})
