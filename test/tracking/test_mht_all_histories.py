"""Without pruning the trees hold every association history, and choose the most probable one."""

import math

import numpy as np
import pytest
from association_histories import Model, Node, enumerate_histories
from scipy.stats import chi2
from tracking_examples import SECOND, initial_tracks

from gda_tracker.tracking.mht.decision import global_hypothesis
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import Detections

MEANS = (0.3, 1.2, 4.0)
DT = 2.0
UNPRUNED = {
    "mht_scans": 60,
    "mht_leaf_probability": 0.0,
    "mht_leaves_per_track": 10_000,
    "mht_merge_scans": 0,
}


def class_densities(rcs):
    """Exponential for clutter, Swerling 3 for the others."""
    return np.array(
        [math.exp(-rcs / MEANS[0]) / MEANS[0]]
        + [4 * rcs / a**2 * math.exp(-2 * rcs / a) for a in MEANS[1:]]
    )


def case(seed, n_tracks, n_scans, most):
    """Close tracks, and scans with detections near them."""
    rng = np.random.default_rng(seed)
    start = np.array([3000.0, 1000.0]) + rng.normal(0.0, 40.0, (n_tracks, 2))
    velocity = rng.normal(0.0, 15.0, (n_tracks, 2))
    scans = []
    for k in range(1, n_scans + 1):
        count = int(rng.integers(0, most + 1))
        place = start[rng.integers(0, n_tracks, count)] + k * DT * velocity.mean(axis=0)
        place = place + rng.normal(0.0, 35.0, (count, 2))
        rcs = [None if rng.random() < 0.2 else float(rng.gamma(2.0, 1.0)) for _ in range(count)]
        scans.append(
            [(math.hypot(*p), math.atan2(p[1], p[0]), s) for p, s in zip(place, rcs, strict=True)]
        )
    classes = rng.dirichlet(np.ones(3), n_tracks)
    covariance = np.tile(np.diag([400.0, 400.0, 60.0, 60.0]), (n_tracks, 1, 1))
    return np.hstack([start, velocity]), covariance, classes, scans


def tracked(term, mean, covariance, classes, scans, model):
    """The ring after the scans, from labelled tracks."""
    manager = {
        "decision": "mht",
        "attribute_term": term,
        "initiation": "labelled",
        "range_std_m": model.range_std,
        "azimuth_std_rad": model.azimuth_std,
        "filter": "cv",
        "process_noise_std_mps2": model.process_noise,
        "detection_probability": model.p_d,
        "clutter_density_per_m_rad": model.clutter,
        "gate_probability": 0.99,
        "deletion_misses": 0,
        **UNPRUNED,
    }
    fuzzifier = {
        "class_names": ["false_alarm", "fighter", "cargo"],
        "class_rcs_mean_m2": list(MEANS),
        "class_rcs_swerling": [2, 3, 3],
    }
    ring = Ring({"track_manager": manager, "rcs_fuzzifier": fuzzifier})
    n = len(mean)
    initial = initial_tracks(n, mean=mean, covariance=covariance, class_probability=classes)
    assert ring.initialise(initial).outcome == "initialised"
    for k, scan in enumerate(scans, 1):
        values = np.array([[r, a, np.nan if s is None else s] for r, a, s in scan]).reshape(-1, 3)
        result = ring.process(
            Detections(
                "radar",
                round((10.0 + k * DT) * SECOND),
                values[:, 0],
                values[:, 1],
                rcs_m2=values[:, 2],
            )
        )
    return ring, result


def histories(table, scans):
    """Detection per scan (-1 none) of each leaf, from the running numbers."""
    first = np.concatenate([[0], np.cumsum([len(scan) for scan in scans])])[:-1]
    numbers = table.detection_numbers[:, : len(scans)][:, ::-1]
    return [tuple(row) for row in np.where(numbers >= 0, numbers - first, -1).tolist()]


@pytest.mark.parametrize("term", ["none", "bayes"])
@pytest.mark.parametrize(
    ("n_tracks", "n_scans", "most"), [(2, 3, 3), (2, 4, 2), (3, 3, 2), (2, 5, 2), (1, 4, 3)]
)
def test_leaves_scores_and_choice_are_those_of_exhaustive_enumeration(
    term, n_tracks, n_scans, most
):
    model = Model(DT, 3.0, 15.0, 0.005, 0.9, 2e-4, chi2.ppf(0.99, 2), class_densities)
    contested = 0
    for seed in range(4):
        mean, covariance, classes, scans = case(seed, n_tracks, n_scans, most)
        starts = [
            Node(m, p, None if term == "none" else c)
            for m, p, c in zip(mean, covariance, classes, strict=True)
        ]
        truth = enumerate_histories(starts, scans, model)
        ring, _ = tracked(term, mean, covariance, classes, scans, model)
        table = ring.manager.state.table
        known = histories(table, scans)
        tracks = table.track_id - 1
        for track, leaves in enumerate(truth.leaves):
            rows = np.flatnonzero(tracks == track)
            assert {known[r] for r in rows} == set(leaves)
            for r in rows:
                node = leaves[known[r]]
                assert table.log_score[r] == pytest.approx(node.log_score, abs=1e-8)
                np.testing.assert_allclose(table.mean[r], node.mean, rtol=1e-9, atol=1e-6)
                if term == "bayes":
                    np.testing.assert_allclose(table.class_probability[r], node.classes, atol=1e-10)
        # The best global hypothesis, and its weight.
        best = max(truth.joint, key=truth.joint.get)
        chosen = tuple(known[r] for r in np.flatnonzero(table.chosen))
        assert len(chosen) == n_tracks
        weight = table.log_score[table.chosen].sum()
        assert weight == pytest.approx(truth.joint[best], abs=1e-8)
        assert truth.joint[chosen] == pytest.approx(truth.joint[best], abs=1e-8)
        alone = [max(leaves.values(), key=lambda n: n.log_score) for leaves in truth.leaves]
        contested += sum(n.log_score for n in alone) > truth.joint[best] + 1e-6
        # And the probability of every leaf over all joint histories.
        _, probability, _ = global_hypothesis(
            table.log_score, tracks, table.detection_numbers, np.zeros(0, dtype=np.int64)
        )
        peak = truth.joint[best]
        weights = {joint: math.exp(value - peak) for joint, value in truth.joint.items()}
        total = math.fsum(weights.values())
        expected = np.zeros(len(table))
        place = {(int(t), h): r for r, (t, h) in enumerate(zip(tracks, known, strict=True))}
        for joint, value in weights.items():
            for track, history in enumerate(joint):
                expected[place[track, history]] += value / total
        np.testing.assert_allclose(probability, expected, rtol=0, atol=1e-6)
    if n_tracks > 1:
        assert contested, "the best leaves of the tracks never shared a detection"
