"""The filter imm in the ring: against plain loops, limiting cases, a whole life of tracks."""

import dataclasses

import numpy as np
import pytest
from tracking_examples import (
    QUIET,
    answers,
    assert_same,
    initial_tracks,
    moving,
    ring_of,
    scan_at,
    simulated,
)

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.polar_filters import PolarSensor, extended_update
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.hypotheses import ROW_FIELDS
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.parameters import TrackManagerParameters

IMM = {"filter": "imm", "imm_process_noise_factors": [0.3, 2.0], "imm_mean_sojourn_s": [20.0, 5.0]}


def loop_moments(weight, mean, covariance):
    centre = sum(w * m for w, m in zip(weight, mean, strict=True))
    spread = sum(
        w * (c + np.outer(m - centre, m - centre))
        for w, m, c in zip(weight, mean, covariance, strict=True)
    )
    return centre, spread


class PlainImm:
    """One track with two models by plain loops; its own transition and measurement update."""

    def __init__(self, mean, covariance, parameters):
        self.p = parameters
        sojourn = np.array(parameters.imm_mean_sojourn_s)
        self.weight = sojourn / sojourn.sum()
        self.mean, self.covariance = [mean, mean], [covariance, covariance]

    def predict(self, dt):
        a, b = (1.0 / s for s in self.p.imm_mean_sojourn_s)
        e = np.exp(-(a + b) * dt)
        # Rows: from; columns: to.
        change = np.array([[b + a * e, a * (1 - e)], [b * (1 - e), a + b * e]]) / (a + b)
        weight = self.weight @ change
        mixed = [
            loop_moments(self.weight * change[:, j] / weight[j], self.mean, self.covariance)
            for j in (0, 1)
        ]
        self.weight, self.mean, self.covariance = weight, [], []
        for (mean, covariance), factor in zip(mixed, self.p.imm_process_noise_factors, strict=True):
            f, q = constant_velocity(dt, factor * self.p.process_noise_std_mps2)
            self.mean.append(f @ mean)
            self.covariance.append(f @ covariance @ f.T + q)

    def update(self, z):
        noise = np.diag([self.p.range_std_m**2, self.p.azimuth_std_rad**2])[None]
        likelihood = np.zeros(2)
        for j in (0, 1):
            one = extended_update(
                self.mean[j][None], self.covariance[j][None], z, noise, PolarSensor(np.zeros(2))
            )
            self.mean[j], self.covariance[j] = one.mean[0], one.covariance[0]
            likelihood[j] = np.exp(one.log_likelihood[0])
        self.weight = self.weight * likelihood / np.sum(self.weight * likelihood)


def test_a_track_equals_plain_loops_also_over_a_miss():
    ring = ring_of(**IMM, initiation="labelled", gate_probability=0.999999)
    ring.initialise(initial_tracks(1))
    start = initial_tracks(1)
    plain = PlainImm(start.mean[0], start.covariance[0], ring.manager.parameters)
    turn = np.array([0, 0, 0, 3, 9, 18, 30, 45, 63])
    for k, aside in enumerate(turn, 1):
        seen = [] if k == 4 else [moving(10.0 + k) + [aside, aside]]
        scan = scan_at(10.0 + k, seen)
        result = ring.process(scan)
        plain.predict(1.0)
        got = result.predictions
        np.testing.assert_array_equal(got.component_start, [0, 2])
        np.testing.assert_array_equal(got.component_model, [0, 1])
        np.testing.assert_allclose(got.component_weight, plain.weight, rtol=1e-9)
        np.testing.assert_allclose(got.component_mean, plain.mean, rtol=1e-9)
        np.testing.assert_allclose(got.component_covariance, plain.covariance, rtol=1e-7)
        if seen:
            plain.update(np.array([[scan.range_m[0], scan.azimuth_rad[0]]]))
        mean, covariance = loop_moments(plain.weight, plain.mean, plain.covariance)
        table = ring.manager.state.table
        np.testing.assert_allclose(table.model_weight[0], plain.weight, rtol=1e-7)
        np.testing.assert_allclose(result.tracks.mean[0], mean, rtol=1e-9)
        np.testing.assert_allclose(result.tracks.covariance[0], covariance, rtol=1e-6, atol=1e-9)
    # The manoeuvre is seen.
    assert table.model_weight[0, 1] > 0.5


@pytest.mark.parametrize("models", [1, 3])
def test_identical_models_give_the_tracks_of_cv(models):
    same = {
        "filter": "imm",
        "imm_process_noise_factors": [1.0] * models,
        "imm_mean_sojourn_s": [7.0, 11.0, 30.0][:models],
    }
    one, other = ring_of(), ring_of(**same)
    for scan in simulated(25, seed=5):
        expected, result = one.process(scan), other.process(scan)
        np.testing.assert_array_equal(result.tracks.track_id, expected.tracks.track_id)
        np.testing.assert_array_equal(
            result.tracks.detection_index, expected.tracks.detection_index
        )
        np.testing.assert_allclose(result.tracks.mean, expected.tracks.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            result.tracks.covariance, expected.tracks.covariance, rtol=1e-7, atol=1e-9
        )
        np.testing.assert_allclose(
            result.associations.kinematic_log_likelihood,
            expected.associations.kinematic_log_likelihood,
            rtol=1e-7,
        )
    assert len(expected.tracks) >= 3


def test_tracks_are_born_live_and_end_with_their_mixtures():
    """Weights sum to one, published moments are those of the mixture, rows fit at all times."""
    ring = ring_of(**IMM)
    born = ended = 0
    for scan in simulated(40, seed=9):
        result = ring.process(scan)
        table = ring.manager.state.table
        h = len(table)
        assert table.model_mean.shape == (h, 2, 4)
        np.testing.assert_allclose(table.model_weight.sum(axis=1), 1.0, rtol=1e-12)
        for row in range(h):
            mean, covariance = loop_moments(
                table.model_weight[row], table.model_mean[row], table.model_covariance[row]
            )
            np.testing.assert_allclose(result.tracks.mean[row], mean, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(
                result.tracks.covariance[row], covariance, rtol=1e-9, atol=1e-9
            )
        if h:
            np.linalg.cholesky(table.model_covariance)
        ended += len(result.tracks.deleted_track_id)
        born = ring.manager.state.next_track_id - 1
    assert h >= 3
    assert born > h
    assert ended >= 1


def test_restarted_at_every_scan_it_goes_on_bit_for_bit(tmp_path):
    path = tmp_path / "state"
    through, restarting = ring_of(**IMM), ring_of(**IMM)
    for scan in simulated(20, seed=3):
        expected, result = through.process(scan), restarting.process(scan)
        assert_same(result.tracks, expected.tracks)
        assert_same(result.predictions, expected.predictions)
        for name in ROW_FIELDS:
            assert getattr(through.manager.state.table, name).flags.c_contiguous, name
        checkpoint.save(restarting.manager, path)
        restarting = ring_of(**IMM)
        assert checkpoint.load(restarting.manager, path)
        assert_same(restarting.manager.state, through.manager.state)
    assert len(expected.tracks) >= 3


def test_the_filter_changes_at_a_scan_boundary():
    """From cv to two models, to three, and back; tracks live on and others start."""
    ring = ring_of()
    three = {
        "filter": "imm",
        "imm_process_noise_factors": [0.1, 1.0, 3.0],
        "imm_mean_sojourn_s": [30.0, 30.0, 10.0],
    }
    plan = {8: ({}, 0), 16: (IMM, 2), 24: (three, 3), 32: ({}, 0), 33: (IMM, 2)}
    stage, models = 0, 0
    for k, scan in enumerate(simulated(40, seed=2)):
        if k in plan:
            changed, models = plan[k]
            values = {**QUIET, **changed}
            ring.manager.set_parameters(from_mapping(TrackManagerParameters, values))
            stage += 1
        before = ring.manager.state.table.track_id
        result = ring.process(scan)
        table = ring.manager.state.table
        assert table.model_weight.shape == (len(table), models)
        if len(before) and k in plan:
            # Moments are carried over: a new set of models starts where the old one was.
            assert np.isin(before, np.append(table.track_id, result.tracks.deleted_track_id)).all()
    assert stage == len(plan)
    assert len(table) >= 3


def test_a_scan_at_the_same_time_and_one_that_is_given_up():
    ring = ring_of(**IMM)
    for k in range(4):
        ring.process(scan_at(k, [moving(k)]))
    table = ring.manager.state.table
    ring.manager.admit(scan_at(3.0, [], sensor_id="other"))
    opened = ring.manager.open()
    np.testing.assert_array_equal(opened.predictions.component_weight, table.model_weight[0])
    tracks, report = ring.manager.give_up()
    assert report.outcome == "gave_up"
    np.testing.assert_array_equal(tracks.mean, table.mean)
    ring.manager.admit(scan_at(5.0, [moving(5.0)]))
    opened = ring.manager.open()
    tracks, _ = ring.manager.give_up()
    np.testing.assert_array_equal(tracks.mean, opened.table.mean)
    assert ring.manager.state.table.model_weight.shape == (1, 2)


def test_initial_tracks_while_a_scan_is_open_and_after_an_empty_start():
    ring = ring_of(**IMM)
    ring.process(scan_at(1.0, []))
    ring.manager.admit(scan_at(2.0, [moving(2.0)]))
    ring.manager.open()
    ring.initialise(initial_tracks(2))
    result = ring.process(scan_at(11.0, [moving(11.0)]))
    np.testing.assert_allclose(result.predictions.component_weight.reshape(2, 2).sum(axis=1), 1.0)
    assert len(result.tracks) == 2


def test_the_gate_knows_the_mixture():
    """A detection that only the agile model can explain is gated and taken."""
    ring = ring_of(
        filter="imm", imm_process_noise_factors=[0.1, 20.0], imm_mean_sojourn_s=[9.0, 9.0]
    )
    calm = ring_of(process_noise_std_mps2=0.2)
    for k in range(12):
        scan = scan_at(k, [moving(k)])
        ring.process(scan)
        calm.process(scan)
    far = scan_at(12.0, [moving(12.0) + [25.0, -25.0]])
    assert ring.process(far).tracks.detection_index[0] == 0
    assert calm.process(far).tracks.detection_index[0] == -1


def test_stages_by_hand_equal_the_ring():
    one, other = ring_of(**IMM), ring_of(**IMM)
    for scan in simulated(12, seed=4):
        expected = one.process(scan)
        other.manager.admit(scan)
        other.manager.open()
        tracks, _ = other.manager.close(*answers(other))
        assert_same(tracks, expected.tracks)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"imm_process_noise_factors": []}, "imm_process_noise_factors"),
        ({"imm_process_noise_factors": [1.0] * 17}, "imm_process_noise_factors"),
        ({"imm_process_noise_factors": [1.0, 0.0]}, "imm_process_noise_factors"),
        ({"imm_process_noise_factors": [1.0, 2.0, 3.0]}, "imm_mean_sojourn_s"),
        ({"imm_mean_sojourn_s": [5.0]}, "imm_mean_sojourn_s"),
        ({"imm_mean_sojourn_s": [5.0, -1.0]}, "imm_mean_sojourn_s"),
        ({"filter": "singer"}, "filter"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(values, named):
    with pytest.raises(ParameterError, match=f"parameter {named} = .*allowed"):
        from_mapping(TrackManagerParameters, values)


def test_a_method_names_the_filter():
    assert parse_method("map/bayes/imm")["filter"] == "imm"
    with pytest.raises(ParameterError, match=r"cv\|imm\|gpb2"):
        parse_method("map/bayes/ukf")


@pytest.mark.parametrize("filter_", [{}, IMM], ids=["cv", "imm"])
def test_range_rate_makes_the_velocity_known_and_can_be_left_out(filter_):
    """Noisy azimuths, exact rates: the speed along the line of sight; off, nothing changes."""
    rng = np.random.default_rng(6)
    settings = {**filter_, "azimuth_std_rad": 0.01, "range_std_m": 30.0, "initiation": "labelled"}
    rings = [
        ring_of(**settings),
        ring_of(**settings, range_rate_std_mps=0.2),
        ring_of(**settings, use_range_rate=False),
    ]
    for ring in rings:
        ring.initialise(initial_tracks(1))
    velocity = np.array([10.0, -5.0])
    errors = []
    for k in range(1, 9):
        position = moving(10.0 + k)
        sight = position / np.linalg.norm(position)
        scan = scan_at(10.0 + k, [position])
        scan.range_m += rng.normal(0.0, 30.0, 1)
        scan.azimuth_rad += rng.normal(0.0, 0.01, 1)
        plain = rings[0].process(scan).tracks
        rated = dataclasses.replace(scan, range_rate_mps=velocity @ sight + rng.normal(0, 0.2, 1))
        known = rings[1].process(rated).tracks
        assert_same(rings[2].process(rated).tracks.mean, plain.mean)
        errors.append([abs((t.mean[0, 2:] - velocity) @ sight) for t in (plain, known)])
        variance = [sight @ t.covariance[0, 2:, 2:] @ sight for t in (plain, known)]
        assert variance[1] < 0.25**2 < variance[0]
    assert np.mean(errors, axis=0)[1] < 0.5 * np.mean(errors, axis=0)[0]
