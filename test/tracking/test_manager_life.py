"""Life of tracks in the manager with the real stages: start, confirmation, coasting, end, ids."""

import dataclasses

import numpy as np
import pytest
from tracking_examples import QUIET, answers, assert_same, moving, ring_of, scan_at, simulated

from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.kinematics.gating import gate
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE


def seen(ring, stamp_s, *targets):
    return ring.process(scan_at(stamp_s, [moving(stamp_s, *target) for target in targets]))


ONE = ((3000.0, 1000.0), (10.0, -5.0))
TWO = ((1000.0, 3000.0), (-5.0, 10.0))


def test_a_target_appears_is_confirmed_coasts_and_ends_on_the_right_scans():
    ring = ring_of(confirmation_hits=3, confirmation_scans=4, deletion_misses=4)
    story = []
    for k, visible in enumerate("0011110001000000"):
        result = seen(ring, k, *([ONE] if visible == "1" else []))
        tracks = result.tracks
        assert result.report.outcome == "tracked"
        assert result.report.tracks_confirmed == np.count_nonzero(tracks.status == CONFIRMED)
        assert result.report.tracks_tentative == np.count_nonzero(tracks.status == TENTATIVE)
        line = "".join(
            "tC"[s] + str(c) for s, c in zip(tracks.status, tracks.coasted_scans, strict=True)
        )
        story.append(line + "".join(f"-{i}" for i in tracks.deleted_track_id))
    # First detection on scan 2, start on 3, third hit on 4; misses from 6, a hit on 9, then none.
    assert story == [
        "", "", "", "t0", "C0", "C0", "C1", "C2", "C3", "C0", "C1", "C2", "C3", "-1", "", "",
    ]  # fmt: skip


def test_the_row_of_a_track_says_what_happened():
    ring = ring_of()
    for k, visible in enumerate("1101101"):
        tracks = seen(ring, k, *([TWO, ONE] if visible == "1" else [TWO])).tracks
    one = int(np.argmax(tracks.misses))
    assert tracks.hits.tolist()[one] == 5
    assert tracks.misses.tolist() == [0, 2] if one else [2, 0]
    np.testing.assert_array_equal(tracks.first_detection_ns, 0)
    np.testing.assert_array_equal(tracks.last_detection_ns, 6_000_000_000)
    np.testing.assert_allclose(tracks.mean[one], [*moving(6, *ONE), *ONE[1]], atol=1.0)
    assert tracks.detection_index[one] == 1
    tracks = seen(ring, 7, TWO).tracks
    assert tracks.detection_index[one] == -1
    assert tracks.coasted_scans[one] == 1
    assert tracks.last_detection_ns[one] == 6_000_000_000
    # A coasting state is the prediction.
    np.testing.assert_allclose(tracks.mean[one, :2], moving(7, *ONE), atol=2.0)


@pytest.mark.parametrize(
    ("hits", "scans", "pattern", "story"),
    [
        # The miss between the two first detections counts like any other.
        (3, 4, "1011", ["", "", "t", "C"]),
        (3, 3, "10111", ["", "", "t", "X", ""]),
        (3, 4, "10101", ["", "", "t", "X", ""]),
        (3, 5, "10101", ["", "", "t", "t", "C"]),
        (2, 3, "101", ["", "", "C"]),
    ],
)
def test_a_start_after_a_miss_remembers_the_miss(hits, scans, pattern, story):
    ring = ring_of(confirmation_hits=hits, confirmation_scans=scans, tentative_deletion_misses=0)
    seen_story, starts = [], []
    for k, visible in enumerate(pattern):
        tracks = seen(ring, k, *([ONE] if visible == "1" else [])).tracks
        line = "".join("tC"[s] for s in tracks.status)
        seen_story.append("X" if len(tracks.deleted_track_id) else line)
        starts += [(h, m) for h, m in zip(tracks.hits, tracks.misses, strict=True) if not starts]
    assert seen_story == story
    assert starts == [(2, 1)]


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_every_term_tracks_the_same_clear_scene(term):
    ring = ring_of(attribute_term=term)
    for k in range(10):
        tracks = seen(ring, k, ONE, TWO).tracks
    assert tracks.status.tolist() == [CONFIRMED, CONFIRMED]
    assert tracks.track_id.tolist() == [1, 2]
    if term != "none":
        np.testing.assert_allclose(tracks.class_probability.sum(axis=1), 1.0)
    if term in DISTANCE_TERMS:
        np.testing.assert_allclose(tracks.masses.sum(axis=1), 1.0)


def test_ids_rise_and_are_never_used_again():
    ring = ring_of(deletion_misses=2)
    issued, previous = [], set()
    for k, result in enumerate(ring.process(scan) for scan in simulated(60, 6, 8, seed=3)):
        ids = result.tracks.track_id.tolist()
        assert ids == sorted(set(ids)), k
        assert result.tracks.hypothesis_id.tolist() == sorted(result.tracks.hypothesis_id)
        new = [i for i in ids if i not in previous]
        assert all(i > max(issued, default=0) for i in new)
        assert set(result.tracks.deleted_track_id.tolist()) == previous - set(ids)
        issued += new
        previous = set(ids)
    assert len(issued) > len(previous)
    assert len(set(issued)) == len(issued)


def test_states_follow_their_targets():
    ring = ring_of(process_noise_std_mps2=0.5)
    scans = simulated(30, n_targets=1, clutter=0, seed=5)
    for scan in scans:
        tracks = ring.process(scan).tracks
    assert len(tracks) == 1
    rng = np.random.default_rng(5)
    truth = rng.uniform(1000.0, 2500.0, (1, 2)), rng.uniform(-25.0, 25.0, (1, 2))
    error = tracks.mean[0] - np.append(truth[0] + 29.0 * truth[1], truth[1])
    assert error @ np.linalg.solve(tracks.covariance[0], error) < 20.0


def test_max_tracks():
    ring = ring_of(max_tracks=3)
    targets = [((1000.0 + 300.0 * i, 500.0), (0.0, 5.0)) for i in range(5)]
    for k in range(6):
        result = seen(ring, k, *targets)
        assert len(result.tracks) <= 3
    assert result.tracks.track_id.tolist() == [1, 2, 3]
    assert ring.manager.counters["max_tracks_reached"] > 0


def test_no_start_inside_the_gate_of_a_confirmed_track_if_asked():
    counts = []
    for outside in (False, True):
        ring = ring_of(initiation_outside_gates=outside)
        for k in range(12):
            x, y = moving(k, *ONE)
            # From scan 6 the target shows a second, weaker edge 15 m behind.
            edges = [[x, y]] if k < 6 else [[x, y], [x - 15.0, y]]
            tracks = ring.process(scan_at(k, edges)).tracks
        counts.append(len(tracks))
    assert counts[0] > 1
    assert counts[1] == 1


def test_labelled_initiation_starts_nothing_by_itself():
    ring = ring_of(initiation="labelled")
    assert ring.manager.admit(scan_at(0.0, [moving(0)])) is None
    assert not ring.manager.ready
    assert ring.manager.waiting == 1


# --- giving up and degrading


def confirmed_ring(**parameters):
    ring = ring_of(**parameters)
    for k in range(5):
        seen(ring, k, ONE, TWO)
    return ring


def test_give_up_predicts_and_counts_no_miss():
    ring = confirmed_ring(deletion_misses=2)
    before = ring.manager.tracks()
    for k in range(5, 10):
        assert ring.manager.admit(scan_at(k, [])) is None
        ring.manager.open()
        tracks, report = ring.manager.give_up()
        assert report.outcome == "gave_up"
        assert tracks.degraded
    for name in ("track_id", "status", "hits", "misses", "coasted_scans", "last_detection_ns"):
        np.testing.assert_array_equal(getattr(tracks, name), getattr(before, name))
    np.testing.assert_array_equal(tracks.detection_index, -1)
    np.testing.assert_allclose(
        tracks.mean[:, :2], before.mean[:, :2] + 5.0 * before.mean[:, 2:], rtol=1e-12
    )
    assert (tracks.covariance[:, 0, 0] > before.covariance[:, 0, 0]).all()
    assert ring.manager.counters["gave_up"] == 5
    # The next answer goes on as if nothing had been.
    tracks = seen(ring, 10, ONE, TWO).tracks
    assert tracks.track_id.tolist() == [1, 2]
    assert not tracks.degraded
    np.testing.assert_array_equal(tracks.coasted_scans, 0)


def test_a_degraded_answer_moves_states_and_leaves_beliefs():
    ring = confirmed_ring(attribute_term="dsm_classic")
    before = ring.manager.tracks()
    assert ring.manager.admit(scan_at(5, [moving(5, *ONE), moving(5, *TWO)], rcs=0.2)) is None
    opened = ring.manager.open()
    evidence, scores, good = answers(ring)
    degraded = ring.associate(
        opened.scan, opened.predictions, None, gate(opened.scan, opened.predictions)
    )
    assert degraded.degraded
    tracks, report = ring.manager.close(None, None, degraded)
    assert report.outcome == "degraded"
    assert tracks.degraded
    np.testing.assert_array_equal(tracks.hits, before.hits + 1)
    for name in ("masses", "focal", "class_probability", "conflict"):
        np.testing.assert_array_equal(getattr(tracks, name), getattr(before, name))
    assert len(good.hypothesis) == len(scores.hypothesis) == 2
    assert len(evidence.masses) == 2


def test_a_track_that_starts_without_evidence_knows_nothing():
    ring = confirmed_ring(attribute_term="dsm_classic")
    newcomer = ((2000.0, 2000.0), (0.0, 0.0))
    assert ring.manager.admit(scan_at(5, [moving(5, *newcomer)])) is None
    opened = ring.manager.open()
    ring.manager.close(
        None,
        None,
        ring.associate(
            opened.scan, opened.predictions, None, gate(opened.scan, opened.predictions)
        ),
    )
    assert ring.manager.admit(scan_at(6, [moving(6, *newcomer)])) is None
    opened = ring.manager.open()
    tracks, _ = ring.manager.close(
        None,
        None,
        ring.associate(
            opened.scan, opened.predictions, None, gate(opened.scan, opened.predictions)
        ),
    )
    assert len(tracks) == 3
    total = 2 ** (2 ** len(tracks.frame) - 1) - 1
    assert tracks.masses[2, tracks.focal == total].tolist() == [1.0]
    np.testing.assert_allclose(tracks.class_probability[2], 1.0 / len(tracks.class_names))
    np.testing.assert_allclose(tracks.masses.sum(axis=1), 1.0)


def test_other_classes_make_beliefs_void_and_keep_the_tracks():
    ring = confirmed_ring(attribute_term="dsm_classic")
    other = Ring(
        {
            "track_manager": {**QUIET, "attribute_term": "dsm_classic"},
            "rcs_fuzzifier": {
                "class_names": ["false_alarm", "boat"],
                "class_labels": ["F", "T"],
                "class_rcs_mean_m2": [0.3, 50.0],
                "class_rcs_swerling": [1, 3],
                "class_prior": [0.0, 1.0],
            },
        }
    )
    ring.fuzzifier = other.fuzzifier
    tracks = seen(ring, 5, ONE, TWO).tracks
    assert tracks.track_id.tolist() == [1, 2]
    assert tracks.class_names == ("false_alarm", "boat")
    assert tracks.frame == ("F", "T")
    np.testing.assert_allclose(tracks.masses.sum(axis=1), 1.0)
    np.testing.assert_allclose(tracks.class_probability.sum(axis=1), 1.0)


# --- parameters


def test_parameters_change_at_the_next_scan_boundary_only():
    ring = confirmed_ring(deletion_misses=2)
    manager = ring.manager
    assert manager.admit(scan_at(5, [])) is None
    opened = manager.open()
    old = manager.parameters
    changed = dataclasses.replace(
        old, deletion_misses=1, gate_probability=0.5, decision="map", process_noise_std_mps2=9.0
    )
    manager.set_parameters(changed)
    assert manager.parameters is old
    assert opened.predictions.settings.gate_probability == old.gate_probability
    # One miss would end the tracks under the new rule: this scan is still under the old one.
    tracks, _ = manager.close(*answers(ring))
    assert len(tracks) == 2
    assert manager.admit(scan_at(6, [moving(6, *ONE), moving(6, *TWO)])) is None
    opened = manager.open()
    assert manager.parameters is changed
    assert opened.predictions.settings.gate_probability == 0.5
    assert opened.predictions.settings.decision == "map"
    expected = tracks.covariance[0, 2, 2] + 9.0**2
    assert opened.predictions.component_covariance[0, 2, 2] == pytest.approx(expected)
    manager.close(*answers(ring))
    tracks = seen(ring, 7).tracks
    assert len(tracks) == 0
    assert tracks.deleted_track_id.tolist() == [1, 2]


def test_parameters_change_at_once_between_scans():
    ring = confirmed_ring()
    changed = dataclasses.replace(ring.manager.parameters, range_std_m=77.0)
    ring.manager.set_parameters(changed)
    assert ring.manager.parameters is changed
    result = seen(ring, 5, ONE)
    assert result.scan.noise_covariance[0, 0, 0] == 77.0**2


def test_wrong_parameters_name_the_node_or_the_parameter():
    with pytest.raises(ParameterError, match="node radar: unknown; allowed are track_manager"):
        Ring({"radar": {}})
    with pytest.raises(ParameterError, match="parameter gate_probability = 2"):
        Ring({"track_manager": {"gate_probability": 2}})


# --- the offline ring


def test_the_ring_returns_what_every_stage_said():
    ring = confirmed_ring()
    result = seen(ring, 5, ONE, TWO)
    key = result.report.key
    assert key[1:] == ("radar", 5_000_000_000)
    for part in (result.tracks, result.scan, result.predictions, result.evidence, result.scores):
        assert part.key == key
    assert result.associations.key == key
    assert result.report.detections_received == result.report.detections_admitted == 2


def test_a_rejected_scan_has_a_report_and_nothing_else():
    ring = confirmed_ring()
    before = dataclasses.replace(ring.manager.state)
    result = ring.process(scan_at(2.5, [moving(2.5)]))
    assert result.report.outcome == "rejected"
    assert result.report.reason == "late"
    assert result.tracks is None
    assert result.scan is None
    assert_same(ring.manager.state, before)


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_two_rings_on_the_same_scans_agree_bit_for_bit(term):
    rings = [ring_of(attribute_term=term), ring_of(attribute_term=term)]
    for scan in simulated(15):
        one, other = (ring.process(scan) for ring in rings)
        assert_same(one, other)
