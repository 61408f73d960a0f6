"""Joint probabilities with unresolved targets against enumeration, quadrature and limits."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parent.parent / "tracking"))

from group_histories import Radar, joint_scan, predicted
from tracking_examples import SECOND, initial_tracks

from gda_tracker.association.group_joint import disjoint_sets
from gda_tracker.association.unresolved import (
    ResolutionSensor,
    resolution_hypotheses,
    structure,
    terms,
)
from gda_tracker.kinematics.group_updates import GroupInnovations
from gda_tracker.kinematics.groups_of_three import (
    given_links,
    three_log_likelihood,
    way_probabilities,
)
from gda_tracker.kinematics.sensor_models import PolarMeasurements
from gda_tracker.tracking.answers import check_answers
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

RADAR = Radar(2.0, 3.0, 15.0, 0.005, 0.9, 0.8, 2e-4, chi2.ppf(0.99, 2), (60.0, 0.03))


def ring_of(decision, radar=RADAR, **more):
    manager = {
        "decision": decision,
        "attribute_term": "none",
        "initiation": "labelled",
        "range_std_m": radar.range_std,
        "azimuth_std_rad": radar.azimuth_std,
        "filter": "cv",
        "process_noise_std_mps2": radar.process_noise,
        "detection_probability": radar.p_d,
        "clutter_density_per_m_rad": radar.clutter,
        "gate_probability": 0.99,
        "deletion_misses": 0,
        "resolution_range_m": radar.resolution[0],
        "resolution_azimuth_rad": radar.resolution[1],
        "unresolved_detection_probability": radar.p_group,
    }
    return Ring({"track_manager": manager | more})


def case(seed, n, m):
    """Close tracks and detections near them."""
    rng = np.random.default_rng(seed)
    mean = np.zeros((n, 4))
    mean[:, :2] = [3000.0, 1000.0] + rng.normal(0.0, 45.0, (n, 2))
    mean[:, 2:] = rng.normal(0.0, 10.0, (n, 2))
    scale = rng.uniform(0.5, 2.0, (n, 1, 1))
    covariance = scale * np.diag([400.0, 400.0, 60.0, 60.0])
    place = mean[rng.integers(0, n, m), :2] + rng.normal(0.0, 35.0, (m, 2))
    scan = np.stack([np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])], axis=1)
    return mean, covariance, scan


def tracked(ring, mean, covariance, scan):
    n = len(mean)
    assert ring.initialise(initial_tracks(n, mean=mean, covariance=covariance)).outcome
    stamp = round((10.0 + RADAR.dt_s) * SECOND)
    return ring.process(Detections("radar", stamp, scan[:, 0], scan[:, 1]))


@pytest.mark.parametrize(("n", "m"), [(2, 0), (2, 1), (2, 3), (3, 2), (4, 2)])
def test_marginals_choice_and_states_are_those_of_enumeration(n, m):
    grouped = 0
    for seed in range(3):
        mean, covariance, scan = case(10 * n + seed, n, m)
        states = [predicted(x, p, RADAR) for x, p in zip(mean, covariance, strict=True)]
        known = list(joint_scan(states, scan, RADAR))
        weight = np.exp([one[0] for one in known])
        weight /= weight.sum()
        result = tracked(ring_of("jpda"), mean, covariance, scan)
        found = result.associations
        check_answers(result.scan.key, n, m, None, None, found)
        pairs, events = np.zeros((n, m)), {}
        for share, (_, detection, groups, _) in zip(weight, known, strict=True):
            inside = [member for pair in groups for member in pair]
            for track, j in enumerate(detection):
                if j >= 0 and track not in inside:
                    pairs[track, j] += share
            for pair, j in groups.items():
                events[*pair, j] = events.get((*pair, j), 0.0) + share
        dense = np.zeros((n, m))
        dense[found.hypothesis, found.detection] = found.joint_marginal
        np.testing.assert_allclose(dense, pairs, atol=1e-10)
        keys = zip(found.group_first, found.group_second, found.group_detection, strict=True)
        for key, value in zip(keys, found.group_marginal, strict=True):
            assert value == pytest.approx(events.pop(tuple(map(int, key)), 0.0), abs=1e-10)
        assert not events
        grouped += found.group_marginal.max(initial=0.0) > 1e-3
        # The moments of every track over all joint hypotheses.
        tracks = result.tracks
        for track in range(n):
            own = [after[track] for *_, after in known]
            centre = sum(w * x for w, (x, _) in zip(weight, own, strict=True))
            spread = sum(
                w * (p + np.outer(x - centre, x - centre))
                for w, (x, p) in zip(weight, own, strict=True)
            )
            np.testing.assert_allclose(tracks.mean[track], centre, rtol=1e-9)
            np.testing.assert_allclose(tracks.covariance[track], spread, rtol=1e-7, atol=1e-7)
        # And the most probable one of them.
        best = known[int(np.argmax(weight))]
        for decision in ("jpda", "map"):
            decided = tracked(ring_of(decision), mean, covariance, scan)
            assert decided.associations.assigned_detection.tolist() == list(best[1])
        for track, (x, p) in enumerate(best[3]):
            np.testing.assert_allclose(decided.tracks.mean[track], x, rtol=1e-9)
            np.testing.assert_allclose(decided.tracks.covariance[track], p, rtol=1e-7, atol=1e-7)
    assert grouped


def test_gda_takes_the_groups_of_the_most_probable_hypothesis():
    mean, covariance, _ = case(5, 2, 1)
    place = mean[:, :2].mean(axis=0) + RADAR.dt_s * mean[:, 2:].mean(axis=0)
    scan = np.array([[np.hypot(*place), np.arctan2(place[1], place[0])]])
    found = {
        name: tracked(ring_of(name), mean, covariance, scan).associations for name in ("gda", "map")
    }
    assert found["map"].group_chosen.sum() == 1
    assert found["map"].assigned_detection.tolist() == [0, 0]
    for name in ("assigned_detection", "group_chosen", "group_marginal", "p_kinematic"):
        np.testing.assert_array_equal(getattr(found["gda"], name), getattr(found["map"], name))
    assert not found["gda"].chosen.any()


def test_a_groups_likelihood_is_that_of_the_joint_mixture():
    rng = np.random.default_rng(1)
    draw = rng.normal(size=(2, 2, 2))
    spread = draw @ draw.swapaxes(1, 2) + np.eye(2)
    noise, resolution = np.diag([0.5, 0.8]), np.diag([2.0, 1.5])
    mean, z = rng.normal(size=(2, 2)), rng.normal(size=(1, 2))
    sensor = ResolutionSensor(np.eye(2), noise, noise, 0.9, 0.7, 0.1, resolution)
    whole = np.zeros((1, 4, 4))
    whole[0, :2, :2], whole[0, 2:, 2:] = spread
    exact = terms(mean.reshape(1, 4), whole, z, sensor)
    groups = structure(2, 1, True).groups
    row = groups.index((((0, 1), 0),))
    weight = exact.log_weight[exact.interpretation == row]
    pair = GroupInnovations(
        z - mean.mean(axis=0), (mean[0] - mean[1])[None], spread[:1], spread[1:], noise[None]
    )
    _, log_density = pair.given_unresolved(resolution)
    gap, total = mean[0] - mean[1], spread.sum(axis=0) + resolution
    share = np.sqrt(np.linalg.det(resolution) / np.linalg.det(total))
    share *= np.exp(-0.5 * gap @ np.linalg.solve(total, gap))
    assert weight.item() == pytest.approx(np.log(share * 0.7) + log_density.item(), abs=1e-12)
    # It is a density of the detection.
    grid = np.stack(np.meshgrid(*[np.linspace(-12.0, 12.0, 121)] * 2), axis=-1).reshape(-1, 2)
    many = GroupInnovations(
        grid - mean.mean(axis=0),
        *(
            np.repeat(part, len(grid), axis=0)
            for part in (pair.difference, pair.first, pair.second, pair.noise)
        ),
    )
    assert np.exp(many.given_unresolved(resolution)[1]).sum() * 0.04 == pytest.approx(1.0, abs=1e-6)


def test_far_from_each_other_and_switched_off_nothing_changes():
    mean, covariance, scan = case(3, 3, 3)
    apart = mean.copy()
    apart[:, 0] += [0.0, 3000.0, 6000.0]
    near = Radar(**{**RADAR.__dict__, "resolution": (0.0, 0.0)})
    for decision in ("jpda", "map", "gda", "mht"):
        off = tracked(ring_of(decision, near), apart, covariance, scan)
        on = tracked(ring_of(decision), apart, covariance, scan)
        assert not len(on.associations.group_first)
        for name in ("mean", "covariance", "hits", "detection_index"):
            np.testing.assert_array_equal(getattr(on.tracks, name), getattr(off.tracks, name))
        np.testing.assert_array_equal(on.associations.p_kinematic, off.associations.p_kinematic)


def test_two_at_one_place_share_the_one_detection():
    mean, covariance, _ = case(4, 2, 1)
    mean[1] = mean[0]
    place = mean[0, :2] + RADAR.dt_s * mean[0, 2:]
    scan = np.array([[np.hypot(*place), np.arctan2(place[1], place[0])]])
    wide = Radar(**{**RADAR.__dict__, "resolution": (3000.0, 1.0)})
    found = tracked(ring_of("jpda", wide), mean, covariance, scan)
    assert found.associations.group_marginal[1] > 0.99
    assert found.tracks.hits.tolist() == [found.tracks.hits[0]] * 2
    assert found.associations.assigned_detection.tolist() == [0, 0]


def test_sets_of_disjoint_groups():
    # Two pairs of four, and the two together; of a chain the ends only.
    assert len(disjoint_sets(np.array([0, 2]), np.array([1, 3]))) == 4
    chain = disjoint_sets(np.array([0, 1, 2]), np.array([1, 2, 3]))
    assert chain.tolist()[-1] == [True, False, True]
    assert len(chain) == 5


def test_three_are_one_group_as_often_as_the_groupings_say():
    u = np.array([[0.9, 0.5, 0.2], [0.3, 0.0, 0.4]])
    pairs = [(0, 1), (0, 2), (1, 2)]
    sums = {}
    for parts, polynomial in resolution_hypotheses(3).items():
        terms_of = [
            c * np.prod([u[:, pairs.index(pair)] for pair in edges], axis=0)
            for edges, c in polynomial.items()
        ]
        sums[len(parts)] = sums.get(len(parts), 0.0) + sum(terms_of)
    np.testing.assert_allclose(way_probabilities(u).sum(axis=1), sums[1], atol=1e-12)
    np.testing.assert_allclose(sums[1] + sums[2] + sums[3], 1.0)


def test_the_detection_of_three_has_a_density():
    rng = np.random.default_rng(2)
    place = np.array([3000.0, 1000.0]) + rng.normal(0.0, 30.0, (3, 2))
    mean = np.concatenate([place, np.zeros((3, 2))], axis=1)
    covariance = rng.uniform(0.5, 2.0, (3, 1, 1)) * np.diag([400.0, 900.0, 60.0, 60.0])
    polar = np.stack([np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])], axis=1)
    step = np.array([6.0, 0.0015])
    centre = polar.mean(axis=0)
    grid = np.stack(np.meshgrid(*[np.arange(-40, 41)] * 2), axis=-1).reshape(-1, 2)
    z = centre + grid * step
    noise = np.broadcast_to(np.diag([15.0**2, 0.005**2]), (len(z), 2, 2))
    measurements = PolarMeasurements(z[:, 0], z[:, 1], noise, np.zeros(2), None)
    many = (len(z), 1, 1)
    u = np.array([[0.8, 0.3, 0.6], [0.8, 0.0, 0.6]])
    resolution = np.diag([50.0**2, 0.03**2])
    for unresolved in u:
        _, log_density = three_log_likelihood(
            measurements,
            np.tile(mean[None], many),
            np.tile(covariance[None], (*many, 1)),
            np.tile(unresolved, (len(z), 1)),
            resolution,
            np.arange(len(z)),
        )
        assert np.exp(log_density).sum() * step.prod() == pytest.approx(1.0, abs=1e-3)


def test_links_of_two_are_those_of_the_pair():
    rng = np.random.default_rng(3)
    draw = rng.normal(size=(4, 3, 2, 2))
    first, second, noise = (draw @ draw.swapaxes(-1, -2) + np.eye(2)).transpose(1, 0, 2, 3)
    residual, resolution = rng.normal(size=(4, 2, 2)), np.diag([2.0, 1.5])
    pair = GroupInnovations(
        residual.mean(axis=1), residual[:, 1] - residual[:, 0], first, second, noise
    )
    found = given_links(
        residual, np.stack([first, second], axis=1), noise, np.array([[1.0, -1.0]]), resolution
    )
    np.testing.assert_allclose(found, pair.given_unresolved(resolution), rtol=1e-12)
