"""The decision jpda: the mixture over all joint hypotheses, reduced by its moments."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from tracking_examples import ring_of, scan_at

from gda_tracker.association.choices import JPDA
from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements
from gda_tracker.tracking.answers import Inconsistent
from gda_tracker.tracking.jpda_update import (
    missed_probability,
    update_beliefs_by_marginals,
    update_states_by_marginals,
)
from gda_tracker.tracking.ring import Ring
from gda_tracker.tracking.state_update import update_beliefs, update_states

CROSSING = {
    "decision": JPDA,
    "initiation": "automatic",
    "process_noise_std_mps2": 3.0,
    "range_std_m": 40.0,
    "azimuth_std_rad": 0.02,
    "max_speed_mps": 60.0,
    "clutter_density_per_m_rad": 1e-4,
    "gate_probability": 0.9999,
}


def close_group(k):
    """Scan k of three targets that close in on each other, with two false alarms among them."""
    rng = np.random.default_rng([9, k])
    apart = max(900.0 - 100.0 * k, 80.0)
    truth = np.array([[3000.0 + 10 * k, 1000.0 + apart * i] for i in range(3)])
    false = truth[[0, 1]] + rng.normal(0.0, 80.0, (2, 2))
    detections = scan_at(k, np.concatenate([truth + rng.normal(0.0, 25.0, (3, 2)), false]))
    detections.rcs_m2 = rng.gamma(2.0, 1.0, 5)
    return detections


def opened_with_competition(filter_name="cv", attribute_term="bayes", **further):
    """A ring with an open scan in which several tracks compete, and all the answers to it."""
    ring = ring_of(**CROSSING, filter=filter_name, attribute_term=attribute_term, **further)
    for k in range(15):
        ring.manager.admit(close_group(k))
        opened = ring.manager.open()
        evidence = ring.fuzzifier(opened.scan)
        pairs = gate(opened.scan, opened.predictions)
        scores = ring.fusion(opened.predictions, evidence, pairs.hypothesis, pairs.detection)
        answer = ring.associate(opened.scan, opened.predictions, scores, pairs)
        shared = np.bincount(answer.detection, minlength=len(opened.scan)) > 1
        if k >= 9 and shared.sum() >= 2 and 3 <= len(opened.table) <= 7:
            return ring, opened, evidence, scores, answer
        ring.manager.close(evidence, scores, answer)
    raise AssertionError("no scan of the simulation has competing tracks")


def joint_hypotheses(opened, scores, answer):
    """Every joint hypothesis of the whole scan with its probability, straight from 14.4.1."""
    settings = opened.predictions.settings
    p_d = opened.predictions.detection_probability
    weight = {}
    for h, d, g, lik in zip(
        answer.hypothesis.tolist(),
        answer.detection.tolist(),
        answer.kinematic_log_likelihood,
        scores.log_likelihood,
        strict=True,
    ):
        weight.setdefault(h, {})[d] = p_d[h] * np.exp(g + lik)
    clutter = settings.clutter_density * np.exp(scores.clutter_log_likelihood)
    hypotheses = []
    ways = [[None, *weight.get(h, {})] for h in range(len(p_d))]
    gated = sorted(set(answer.detection.tolist()))
    for way in itertools.product(*ways):
        used = [d for d in way if d is not None]
        if len(set(used)) < len(used):
            continue
        value = np.prod([1.0 - p_d[h] if d is None else weight[h][d] for h, d in enumerate(way)])
        value *= np.prod([clutter[d] for d in gated if d not in used])
        hypotheses.append((value, way))
    total = sum(value for value, _ in hypotheses)
    return [(value / total, way) for value, way in hypotheses]


@pytest.mark.parametrize("filter_name", ["cv", "imm"])
def test_equals_the_mixture_over_all_joint_hypotheses(filter_name):
    _, opened, evidence, scores, answer = opened_with_competition(filter_name)
    hypotheses = joint_hypotheses(opened, scores, answer)
    assert len(hypotheses) > 20
    assert max(probability for probability, _ in hypotheses) < 0.99
    prior = opened.table.copy()
    prior.use_frame(evidence.frame, evidence.class_names)
    count = len(prior)
    posterior = []
    for probability, way in hypotheses:
        table = prior.copy()
        assigned = np.array([-1 if d is None else d for d in way], dtype=np.int32)
        update_states(table, opened.scan, assigned)
        chosen = assigned[answer.hypothesis] == answer.detection
        update_beliefs(table, scores, chosen)
        posterior.append((probability, table))
    found = prior.copy()
    update_states_by_marginals(
        found, opened.scan, answer.hypothesis, answer.detection, answer.joint_marginal
    )
    update_beliefs_by_marginals(found, scores, answer.joint_marginal)
    for h in range(count):
        mean = sum(p * table.mean[h] for p, table in posterior)
        spread = [(p, table.covariance[h], table.mean[h] - mean) for p, table in posterior]
        covariance = sum(p * (c + np.outer(gap, gap)) for p, c, gap in spread)
        belief = sum(p * table.class_probability[h] for p, table in posterior)
        np.testing.assert_allclose(found.mean[h], mean, rtol=1e-9)
        np.testing.assert_allclose(found.covariance[h], covariance, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(found.class_probability[h], belief, rtol=1e-9)
    for m in range(prior.model_weight.shape[1]):
        for h in range(count):
            weight = [p * table.model_weight[h, m] for p, table in posterior]
            assert found.model_weight[h, m] == pytest.approx(sum(weight), rel=1e-9)
            share = np.array(weight) / sum(weight)
            means = np.array([table.model_mean[h, m] for _, table in posterior])
            np.testing.assert_allclose(found.model_mean[h, m], share @ means, rtol=1e-9)
            gap = means - share @ means
            inner = sum(
                s * table.model_covariance[h, m]
                for s, (_, table) in zip(share, posterior, strict=True)
            )
            np.testing.assert_allclose(
                found.model_covariance[h, m], inner + (share * gap.T) @ gap, rtol=1e-7, atol=1e-9
            )


def test_one_track_is_the_probabilistic_data_association_of_the_textbook():
    ring = ring_of(**{**CROSSING, "attribute_term": "none", "initiation": "automatic"})
    for k in range(6):
        ring.process(scan_at(k, [[3000.0 + 10.0 * k, 1000.0 - 5.0 * k]]))
    opened_scan = scan_at(6, [[3060.0, 970.0], [3095.0, 985.0], [3040.0, 930.0], [500.0, 3000.0]])
    ring.manager.admit(opened_scan)
    opened = ring.manager.open()
    assert len(opened.table) == 1
    pairs = gate(opened.scan, opened.predictions)
    assert len(pairs) == 3
    evidence = ring.fuzzifier(opened.scan)
    scores = ring.fusion(opened.predictions, evidence, pairs.hypothesis, pairs.detection)
    answer = ring.associate(opened.scan, opened.predictions, scores, pairs)
    # b = lambda (1 - P_d), e_j = P_d N(v_j; 0, S), all detections with the noise R.
    x, p = opened.table.mean[0], opened.table.covariance[0]
    each = innovations(
        polar_measurements(opened.scan), x[None].repeat(3, 0), p[None].repeat(3, 0), pairs.detection
    )
    h, s, v = each.jacobian(4)[0], each.covariance[0], each.residual
    density = np.exp(-0.5 * np.einsum("ji,ik,jk->j", v, np.linalg.inv(s), v)) / (
        2.0 * np.pi * np.sqrt(np.linalg.det(s))
    )
    b = CROSSING["clutter_density_per_m_rad"] * (1.0 - 0.9)
    beta = 0.9 * density / (b + (0.9 * density).sum())
    beta_0 = b / (b + (0.9 * density).sum())
    assert 0.01 < beta.min() < beta.max() < 0.99
    np.testing.assert_allclose(answer.joint_marginal, beta, rtol=1e-12)
    gain = p @ h.T @ np.linalg.inv(s)
    combined = beta @ v
    spread = (beta * v.T) @ v - np.outer(combined, combined)
    expected = beta_0 * p + (1.0 - beta_0) * (p - gain @ s @ gain.T) + gain @ spread @ gain.T
    tracks, _ = ring.manager.close(evidence, scores, answer)
    np.testing.assert_allclose(tracks.mean[0], x + gain @ combined, rtol=1e-12)
    np.testing.assert_allclose(tracks.covariance[0], expected, rtol=1e-9)


@pytest.mark.parametrize("filter_name", ["cv", "imm"])
@pytest.mark.parametrize("attribute_term", ["none", "bayes", "dsm_classic", "pcr5"])
def test_certain_marginals_are_the_update_of_map(filter_name, attribute_term):
    _, opened, evidence, scores, answer = opened_with_competition(filter_name, attribute_term)
    hard, soft = opened.table.copy(), opened.table.copy()
    for table in (hard, soft):
        table.use_frame(evidence.frame, evidence.class_names)
    update_states(hard, opened.scan, answer.assigned_detection)
    update_beliefs(hard, scores, answer.chosen)
    certain = answer.chosen.astype(float)
    update_states_by_marginals(soft, opened.scan, answer.hypothesis, answer.detection, certain)
    update_beliefs_by_marginals(soft, scores, certain)
    for name in ("mean", "covariance", "model_weight", "model_mean", "model_covariance"):
        np.testing.assert_allclose(getattr(soft, name), getattr(hard, name), rtol=1e-9, atol=1e-9)
    for name in ("masses", "class_probability", "conflict"):
        np.testing.assert_allclose(getattr(soft, name), getattr(hard, name), rtol=0, atol=1e-12)


@pytest.mark.parametrize("attribute_term", ["dsm_classic", "dempster"])
def test_masses_are_mixed(attribute_term):
    _, opened, evidence, scores, answer = opened_with_competition("cv", attribute_term)
    table = opened.table.copy()
    table.use_frame(evidence.frame, evidence.class_names)
    history = {int(f): table.masses[:, k] for k, f in enumerate(table.focal)}
    update_beliefs_by_marginals(table, scores, answer.joint_marginal)
    missed = missed_probability(len(table), answer.hypothesis, answer.joint_marginal)
    for h in range(len(table)):
        mine = answer.hypothesis == h
        for k, f in enumerate(table.focal.tolist()):
            candidate = np.zeros(mine.sum())
            if f in scores.focal:
                candidate = scores.masses[mine, scores.focal.tolist().index(f)]
            expected = missed[h] * history.get(f, np.zeros(len(table)))[h]
            expected += answer.joint_marginal[mine] @ candidate
            assert table.masses[h, k] == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(table.masses.sum(axis=1), 1.0, rtol=0, atol=1e-12)


def test_hits_and_misses_follow_the_most_probable_joint_hypothesis():
    ring, opened, evidence, scores, answer = opened_with_competition()
    before = opened.table
    tracks, report = ring.manager.close(evidence, scores, answer)
    assert report.outcome == "tracked"
    hit = answer.assigned_detection >= 0
    kept = np.isin(before.track_id, tracks.track_id)
    ours = np.isin(tracks.track_id, before.track_id)
    np.testing.assert_array_equal(tracks.hits[ours], (before.hits + hit)[kept])
    np.testing.assert_array_equal(
        tracks.detection_index[ours],
        np.append(opened.scan.source_index, -1)[answer.assigned_detection][kept],
    )


def test_a_degraded_scan_leaves_the_beliefs_alone():
    ring, opened, evidence, scores, _ = opened_with_competition()
    pairs = gate(opened.scan, opened.predictions)
    answer = ring.associate(opened.scan, opened.predictions, None, pairs)
    tracks, report = ring.manager.close(evidence, None, answer)
    assert report.outcome == "degraded"
    ours = np.isin(tracks.track_id, opened.table.track_id)
    kept = np.isin(opened.table.track_id, tracks.track_id)
    np.testing.assert_array_equal(
        tracks.class_probability[ours], opened.table.class_probability[kept]
    )
    assert (tracks.mean[ours] != opened.table.mean[kept]).any()


@pytest.mark.parametrize("wrong", [-0.1, np.nan, 1.2])
def test_marginals_that_are_no_probabilities_are_refused(wrong):
    ring, _, evidence, scores, answer = opened_with_competition()
    answer.joint_marginal = answer.joint_marginal.copy()
    answer.joint_marginal[0] = wrong
    with pytest.raises(Inconsistent, match="joint marginals"):
        ring.manager.close(evidence, scores, answer)


def test_without_pairs_nothing_moves():
    ring, opened, *_ = opened_with_competition()
    table = opened.table.copy()
    none = np.zeros(0, dtype=np.int32)
    update_states_by_marginals(table, opened.scan, none, none, np.zeros(0))
    assert table.mean is opened.table.mean


def test_two_tracks_that_run_side_by_side_coalesce_without_the_remedy():
    """Parallel targets 40 m apart, noise 25 m: how far apart the tracks are on the average."""

    def mean_distance(decision, remedy):
        rng = np.random.default_rng(1)
        ring = Ring(
            {
                "track_manager": {
                    **CROSSING,
                    "decision": decision,
                    "attribute_term": "none",
                    "azimuth_std_rad": 0.01,
                    "clutter_density_per_m_rad": 1e-7,
                    "deletion_misses": 0,
                    "detection_probability": 0.95,
                },
                "association": {"coalescence_remedy": remedy},
            }
        )
        distances = []
        for k in range(80):
            # Apart at first, so that both are found; then side by side.
            apart = max(600.0 - 60.0 * k, 40.0)
            truth = np.array([[3000.0 + 10 * k, 1000.0], [3000.0 + 10 * k, 1000.0 + apart]])
            tracks = ring.process(scan_at(k, truth + rng.normal(0.0, 25.0, (2, 2)))).tracks
            if k >= 30:
                first, second = tracks.mean[tracks.track_id <= 2][:2, :2]
                distances.append(second - first)
        return np.hypot(*np.mean(distances, axis=0))

    plain, pruned, hard = (
        mean_distance(*choice) for choice in ((JPDA, "none"), (JPDA, "jpda_star"), ("map", "none"))
    )
    assert plain < 15.0
    assert 35.0 < pruned < 60.0
    assert 35.0 < hard < 60.0
