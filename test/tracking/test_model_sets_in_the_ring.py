"""Sets of motion models in the ring, imm and gpb2: against plain loops, limits, whole lives."""

import numpy as np
import pytest
from model_examples import SETS, loop_moments, models_of, polar_update
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

from gda_tracker.kinematics.imm import acceleration_dependent_transition, sojourn_transition
from gda_tracker.kinematics.retrodiction import fixed_interval
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.state_retrodiction import retrodict_states

FILTERS = ("imm", "gpb2")
DECISIONS = ("gda", "map", "jpda", "mht")


class PlainFilter:
    """One track by loops over models, or over pairs of them; measurements by filterpy."""

    def __init__(self, mean, covariance, parameters):
        self.p, self.models = parameters, parameters.model_set
        self.pairs = parameters.filter == "gpb2"
        mean, covariance = self.models.extended(mean[None], covariance[None])
        sojourn = np.array(parameters.imm_mean_sojourn_s)
        self.weight = sojourn / sojourn.sum()
        count = len(sojourn)
        self.mean, self.covariance = [mean[0]] * count, [covariance[0]] * count

    def change(self, dt):
        stay = sojourn_transition(dt, self.p.imm_mean_sojourn_s)
        if self.p.imm_switching != "acceleration":
            return stay
        q = self.p.imm_switching_acceleration_mps2
        e1, e2 = (np.exp(-0.5 * (m[4:6] @ m[4:6]) / q**2) for m in self.mean)
        p11, p22 = stay[0, 0] * e1, stay[1, 1] * (1.0 - e2)
        return np.array([[p11, 1.0 - p22], [1.0 - p11, p22]])

    def moved(self, j, mean, covariance, dt):
        """A state moved by model j alone."""
        every = np.tile(mean, (1, len(self.weight), 1))
        at, f = self.models.moved(every, dt)
        f = f[0] if f.ndim == 4 else f
        return at[0, j], f[j] @ covariance @ f[j].T + self.models.matrices(dt)[1][j]

    def predict(self, dt):
        """Components of the prediction: weights, means, covariances."""
        count, change = len(self.weight), self.change(dt)
        self.components = []
        for j in range(count):
            shares = change[j] * self.weight
            if self.pairs:
                for i in range(count):
                    state = self.moved(j, self.mean[i], self.covariance[i], dt)
                    self.components.append((shares[i], *state))
            else:
                mixed = loop_moments(shares / shares.sum(), self.mean, self.covariance)
                self.components.append((shares.sum(), *self.moved(j, *mixed, dt)))
        return self.components

    def close(self, z):
        if z is not None:
            noise = np.diag([self.p.range_std_m**2, self.p.azimuth_std_rad**2])
            updated = [(w, *polar_update(m, c, z, noise)) for w, m, c in self.components]
            total = sum(w * likelihood for w, _, _, likelihood in updated)
            self.components = [(w * n / total, m, c) for w, m, c, n in updated]
        each = len(self.components) // len(self.weight)
        groups = [self.components[k : k + each] for k in range(0, len(self.components), each)]
        self.weight = np.array([sum(w for w, _, _ in group) for group in groups])
        self.mean, self.covariance = [], []
        for group, total in zip(groups, self.weight, strict=True):
            weights, means, covariances = zip(*group, strict=True)
            mean, covariance = loop_moments(np.array(weights) / total, means, covariances)
            self.mean.append(mean)
            self.covariance.append(covariance)


@pytest.mark.parametrize("decision", ["map", "mht", "jpda"])
@pytest.mark.parametrize("filter_", FILTERS)
@pytest.mark.parametrize("name", SETS)
def test_a_track_equals_plain_loops_also_over_a_miss(name, filter_, decision):
    ring = ring_of(
        **models_of(name, filter_),
        decision=decision,
        initiation="labelled",
        gate_probability=0.999999,
        # Certain: jpda takes its only detection whole.
        clutter_density_per_m_rad=0.0,
        detection_probability=0.9,
    )
    ring.initialise(initial_tracks(1))
    start = initial_tracks(1)
    plain = PlainFilter(start.mean[0], start.covariance[0], ring.manager.parameters)
    aside = np.array([0, 0, 0, 3, 9, 18, 30, 45, 63])
    for k, offset in enumerate(aside, 1):
        seen = [] if k == 4 else [moving(10.0 + k) + [offset, offset]]
        scan = scan_at(10.0 + k, seen)
        result = ring.process(scan)
        weight, mean, covariance = (np.array(v) for v in zip(*plain.predict(1.0), strict=True))
        got = result.predictions
        count = len(plain.weight)
        each = count if filter_ == "gpb2" else 1
        np.testing.assert_array_equal(got.component_start, [0, count * each])
        np.testing.assert_array_equal(got.component_model, np.repeat(np.arange(count), each))
        np.testing.assert_allclose(got.component_weight, weight, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(got.component_mean, mean[:, :4], rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(
            got.component_covariance, covariance[:, :4, :4], rtol=1e-6, atol=1e-6
        )
        z = np.array([scan.range_m[0], scan.azimuth_rad[0]]) if seen else None
        plain.close(z)
        table = ring.manager.state.table
        np.testing.assert_allclose(table.model_weight[0], plain.weight, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(table.model_mean[0], plain.mean, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(
            table.model_covariance[0], plain.covariance, rtol=1e-5, atol=1e-5
        )
        mean, covariance = loop_moments(plain.weight, plain.mean, plain.covariance)
        np.testing.assert_allclose(result.tracks.mean[0], mean[:4], rtol=1e-7)
        np.testing.assert_allclose(result.tracks.covariance[0], covariance[:4, :4], rtol=1e-5)
    # The manoeuvre is seen: by another model, or by the acceleration of both.
    assert table.model_weight[0, 0] < 0.5 or (
        np.linalg.norm(table.model_mean[0, :, 4:6], axis=1).min(initial=9.0) > 1.0
    )


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize("filter_", FILTERS)
@pytest.mark.parametrize("name", ["all", "acceleration"])
def test_whole_lives_of_tracks_and_restarts_bit_for_bit(name, filter_, decision, tmp_path):
    """Whatever decides: mixtures fit, a restart at every scan and the stages by hand change none.

    What the stages get has position and velocity alone.
    """
    values = {**models_of(name, filter_), "decision": decision, "attribute_term": "bayes"}
    path = tmp_path / "state"
    through, restarting, by_hand = (ring_of(**values) for _ in range(3))
    size, count = through.manager.parameters.model_set.size, len(values["imm_models"])
    for scan in simulated(14, seed=3):
        expected, result = through.process(scan), restarting.process(scan)
        assert_same(result.tracks, expected.tracks)
        assert_same(list(result.delayed), list(expected.delayed))
        assert expected.predictions.component_mean.shape[1] == 4
        checkpoint.save(restarting.manager, path)
        restarting = ring_of(**values)
        assert checkpoint.load(restarting.manager, path)
        assert_same(restarting.manager.state, through.manager.state)
        by_hand.manager.admit(scan)
        by_hand.manager.open()
        assert_same(by_hand.manager.close(*answers(by_hand))[0], expected.tracks)
        table = through.manager.state.table
        assert table.model_mean.shape == (len(table), count, size)
        np.testing.assert_allclose(table.model_weight.sum(axis=1), 1.0, rtol=1e-12)
        if len(table):
            np.linalg.cholesky(table.model_covariance)
            np.linalg.cholesky(table.covariance)
    assert len(expected.tracks) >= 3


@pytest.mark.parametrize("models", [1, 2])
def test_gpb2_of_identical_models_gives_the_tracks_of_cv(models):
    same = {
        "filter": "gpb2",
        "imm_process_noise_factors": [1.0] * models,
        "imm_mean_sojourn_s": [7.0, 11.0][:models],
    }
    one, other = ring_of(), ring_of(**same)
    for scan in simulated(20, seed=5):
        expected, result = one.process(scan), other.process(scan)
        np.testing.assert_array_equal(result.tracks.track_id, expected.tracks.track_id)
        np.testing.assert_allclose(result.tracks.mean, expected.tracks.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            result.tracks.covariance, expected.tracks.covariance, rtol=1e-7, atol=1e-9
        )
    assert len(expected.tracks) >= 3


def test_without_a_detection_gpb2_and_imm_are_the_same():
    """Only the measurement tells the pairs apart."""
    rings = [ring_of(**models_of("singer", f), initiation="labelled") for f in FILTERS]
    for ring in rings:
        ring.initialise(initial_tracks(2))
        ring.process(scan_at(11.0, []))
        ring.process(scan_at(13.0, []))
    one, other = (ring.manager.state.table for ring in rings)
    np.testing.assert_allclose(other.model_weight, one.model_weight, rtol=1e-12)
    np.testing.assert_allclose(other.model_mean, one.model_mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.model_covariance, one.model_covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("filter_", FILTERS)
def test_a_scan_at_the_same_time_and_one_that_is_given_up(filter_):
    ring = ring_of(**models_of("all", filter_))
    for k in range(4):
        ring.process(scan_at(k, [moving(k)]))
    table = ring.manager.state.table
    ring.manager.admit(scan_at(3.0, [], sensor_id="other"))
    np.testing.assert_array_equal(
        ring.manager.open().predictions.component_weight, table.model_weight[0]
    )
    tracks, _ = ring.manager.give_up()
    np.testing.assert_array_equal(tracks.mean, table.mean)
    ring.manager.admit(scan_at(5.0, [moving(5.0)]))
    opened = ring.manager.open()
    tracks, _ = ring.manager.give_up()
    np.testing.assert_allclose(tracks.mean, opened.table.mean, rtol=1e-12)
    assert ring.manager.state.table.model_weight.shape == (1, 4)


def test_the_models_change_at_a_scan_boundary():
    """Sets of other states, filters and orders follow each other; tracks live on."""
    ring = ring_of()
    turned = {**models_of("singer"), "imm_models": ["singer", "constant_velocity"]}
    plan = [
        models_of("singer"),
        turned,
        models_of("all", "gpb2"),
        {},
        models_of("turn", "gpb2"),
        models_of("turn"),
        {**models_of("velocity"), "imm_models": []},
    ]
    for k, scan in enumerate(simulated(42, seed=2)):
        stage, first = divmod(k, 6)
        if not first:
            values = {**QUIET, **plan[stage]}
            ring.manager.set_parameters(from_mapping(TrackManagerParameters, values))
            before = ring.manager.state.table.track_id
        result = ring.process(scan)
        table, p = ring.manager.state.table, ring.manager.parameters
        size = p.model_set.size if plan[stage] else 4
        assert table.models == (p.model_names if plan[stage] else ())
        assert table.model_mean.shape == (len(table), len(table.models), size)
        if not first:
            assert np.isin(before, np.append(table.track_id, result.tracks.deleted_track_id)).all()
    assert len(table) >= 3


def test_probabilities_for_each_scan_act_whatever_the_time_between_them():
    """Long gone: the weights are those of the chain, whose columns Koch writes."""
    stay = {
        "imm_switching": "per_scan",
        "imm_transition": [0.9, 0.1, 0.3, 0.7],  # from the first model, then from the second
        "imm_process_noise_factors": [0.5, 2.0],
        "imm_mean_sojourn_s": [1.0, 1.0],
    }
    ring = ring_of(filter="imm", initiation="labelled", deletion_misses=0, **stay)
    ring.initialise(initial_tracks(1))
    weight = np.array([0.75, 0.25])  # the stationary shares: 0.75 * 0.1 = 0.25 * 0.3
    for stamp in (11.0, 11.5, 15.0):
        got = ring.process(scan_at(stamp, [])).predictions
        np.testing.assert_allclose(got.component_weight, weight, rtol=1e-12)
    seen = ring.process(scan_at(16.0, [moving(16.0) + [40.0, 40.0]]))
    after = ring.manager.state.table.model_weight[0]
    assert seen.tracks.detection_index[0] == 0
    assert after[1] > 0.3
    got = ring.process(scan_at(16.1, [])).predictions
    np.testing.assert_allclose(
        got.component_weight, np.array([[0.9, 0.3], [0.1, 0.7]]) @ after, rtol=1e-12
    )


def test_an_acceleration_calls_the_second_model():
    """(2.12) with e = exp(-1/2) and stays of 20 s and 5 s: worked by hand."""
    matrix = acceleration_dependent_transition((0.9, 0.8), np.array([[3.0, 0.0]]), 3.0)[0]
    e = 0.6065306597126334
    np.testing.assert_allclose(matrix, [[0.9 * e, 1 - 0.8 * (1 - e)], [1 - 0.9 * e, 0.8 * (1 - e)]])
    ring = ring_of(**models_of("acceleration"), initiation="labelled", deletion_misses=0)
    ring.initialise(initial_tracks(1))
    ring.process(scan_at(11.0, [moving(11.0)]))
    table = ring.manager.state.table
    shares = []
    # Both leave with the rates 1/20 and 1/5: the first one stays for a second with this chance.
    stays = (0.2 + 0.05 * np.exp(-0.25)) / 0.25
    first = table.model_weight[0, 0]
    for acceleration in (0.0, 1.0, 3.0, 9.0):
        table.model_mean[:, :, 4] = acceleration
        table.model_mean[:, :, 5] = 0.0
        ring.manager.admit(scan_at(12.0 + acceleration, []))
        opened = ring.manager.open()
        shares.append(opened.predictions.component_weight[1])
        ring.manager.opened = None
    assert shares == sorted(shares)
    # Without an acceleration none stays in the second model.
    np.testing.assert_allclose(shares[0], (1.0 - stays) * first, rtol=1e-12)
    assert shares[-1] > 0.9


@pytest.mark.parametrize("name", ["singer", "van_keuk", "constant_acceleration"])
def test_one_model_is_its_plain_filter_and_smoother(name):
    """The tracks delayed to the end are those of the fixed-interval smoother of the library."""
    values = {
        "filter": "imm",
        "imm_models": [name],
        "imm_process_noise_factors": [1.0],
        "imm_mean_sojourn_s": [9.0],
        "decision": "mht",
        "mht_scans": 30,
        "initiation": "labelled",
    }
    ring = ring_of(**values)
    ring.initialise(initial_tracks(1))
    rng = np.random.default_rng(5)
    mean, covariance = [], []
    for k in range(1, 9):
        ring.process(scan_at(10.0 + k, [moving(10.0 + k) + rng.normal(0.0, 8.0, 2)]))
        table = ring.manager.state.table
        mean.append(table.model_mean[table.chosen][:, 0])
        covariance.append(table.model_covariance[table.chosen][:, 0])
    models = ring.manager.parameters.model_set
    f, q = (np.repeat(part[None], 7, axis=0) for part in models.matrices(1.0))
    expected, spread = fixed_interval(np.array(mean), np.array(covariance), f, q)
    told = ring.rest_of_delayed()
    np.testing.assert_allclose([t.mean[0] for t in told], expected[:, 0, :4], rtol=1e-9)
    np.testing.assert_allclose([t.covariance[0] for t in told], spread[:, 0, :4, :4], rtol=1e-6)


def test_retrodiction_with_a_turn_equals_plain_loops():
    """Pairs of models with their own derivatives, Koch 3.4.3, written out."""
    values = {**models_of("turn"), "decision": "mht", "initiation": "labelled"}
    ring = ring_of(**values)
    ring.initialise(initial_tracks(1))
    tables = []
    for k in range(1, 7):
        angle = 0.1 * k
        at = moving(10.0) + 100.0 * np.array([np.sin(angle), np.cos(angle) - 1.0])
        ring.process(scan_at(10.0 + k, [at]))
        tables.append(ring.manager.state.table.select(ring.manager.state.table.chosen))
    earlier, later = tables[-2:]
    p, models = ring.manager.parameters, ring.manager.parameters.model_set
    got = retrodict_states(earlier, later, 1.0, p)
    change, noise = sojourn_transition(1.0, p.imm_mean_sojourn_s), models.matrices(1.0)[1]
    pair, back, spread = np.zeros((2, 2)), {}, {}
    for j in (0, 1):
        share = np.zeros(2)
        for i in (0, 1):
            x, c = earlier.model_mean[0, i], earlier.model_covariance[0, i]
            moved, f = models.moved(np.tile(x, (1, 2, 1)), 1.0)
            s = f[0, j] @ c @ f[0, j].T + noise[j]
            gap = later.model_mean[0, j] - moved[0, j]
            inverse = np.linalg.inv(s)
            density = np.exp(-0.5 * gap @ inverse @ gap) / np.sqrt(np.linalg.det(2 * np.pi * s))
            share[i] = change[j, i] * earlier.model_weight[0, i] * density
            w = c @ f[0, j].T @ inverse
            back[j, i] = x + w @ gap
            spread[j, i] = c + w @ (later.model_covariance[0, j] - s) @ w.T
        pair[j] = share / share.sum() * later.model_weight[0, j]
    for i in (0, 1):
        mean, covariance = loop_moments(
            pair[:, i] / pair[:, i].sum(),
            [back[j, i] for j in (0, 1)],
            [spread[0, i], spread[1, i]],
        )
        np.testing.assert_allclose(got.model_mean[0, i], mean, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(got.model_covariance[0, i], covariance, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(got.model_weight[0], pair.sum(axis=0), rtol=1e-7)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"imm_models": ["singer"]}, "imm_models"),
        ({"imm_models": ["singer", "jerk"]}, "imm_models"),
        ({"imm_switching": "per_scan"}, "imm_transition"),
        ({"imm_switching": "per_scan", "imm_transition": [0.5] * 3}, "imm_transition"),
        ({"imm_switching": "per_scan", "imm_transition": [0.5, 0.5, 0.9, 0.2]}, "imm_transition"),
        ({"imm_transition": [0.5] * 4}, "imm_transition"),
        ({"imm_switching": "acceleration"}, "imm_switching"),
        (
            {"imm_switching": "acceleration", "imm_models": ["singer", "coordinated_turn"]},
            "imm_switching",
        ),
        (
            {
                "imm_switching": "acceleration",
                "imm_models": ["singer"],
                "imm_process_noise_factors": [1.0],
                "imm_mean_sojourn_s": [1.0],
            },
            "imm_switching",
        ),
        ({"imm_correlation_time_s": 0.0}, "imm_correlation_time_s"),
        ({"imm_turn_rate_std_radps": 0.0}, "imm_turn_rate_std_radps"),
    ],
)
def test_combinations_that_make_no_sense_are_refused(values, named):
    with pytest.raises(ParameterError, match=f"parameter {named} = .*allowed"):
        from_mapping(TrackManagerParameters, values)
