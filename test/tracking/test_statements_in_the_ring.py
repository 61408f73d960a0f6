"""Statements in the offline ring: which detection a track gets, its class, its state; once each."""

from dataclasses import replace

import numpy as np
import pytest
from tracking_examples import answers, assert_same, ring_of, same_tracks, scan_at, simulated

from gda_tracker.association.choices import DECISIONS
from gda_tracker.association.statements import statement_factors
from gda_tracker.attributes.statement_meaning import track_meaning
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.gaussian_filters import update
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements
from gda_tracker.tracking import checkpoint
from gda_tracker.vocabulary import Statement, StatementPiece, StatementRegion

SECOND = 1_000_000_000


def gaussian(x, y, std_m):
    v = float(std_m) ** 2
    return StatementRegion("gaussian", centre_m=(x, y), covariance_m2=(v, 0.0, 0.0, v))


def said(sequence, stamp_s, about, region=None, track_id=1, kind="fuzzy", **fields):
    grades = fields.pop("grades", {})
    piece = StatementPiece(region or StatementRegion(), tuple(grades), tuple(grades.values()))
    return Statement(
        "pilot",
        sequence,
        round(stamp_s * SECOND),
        kind,
        about,
        (piece,),
        track_id=track_id,
        frame_id="map",
        **fields,
    )


def side_by_side(ring, until=6):
    """Two tracks of different class, 120 m apart, flying along x; rows: fighter, cargo."""
    for k in range(until):
        y = np.array([1000.0, 1120.0])
        places = np.stack([np.full(2, 3000.0 + 10.0 * k), y], axis=1)
        detections = scan_at(k, places)
        detections.rcs_m2[:] = [0.8, 6.0]
        result = ring.process(detections)
    assert len(result.tracks) == 2
    return result.tracks


# After a gap: two detections between the tracks, of an RCS that tells nothing.
def crossing_scan(stamp_s=26.0):
    detections = scan_at(stamp_s, [[3260.0, 1045.0], [3260.0, 1075.0]], rcs=2.2)
    return replace(detections)


def track_at(tracks, low):
    """Index of the track that got the southern (0) or northern (1) detection."""
    return int(np.flatnonzero(tracks.detection_index == low)[0])


@pytest.mark.parametrize("decision", DECISIONS)
def test_a_region_decides_which_detection_a_track_gets(decision):
    for term in ("none", "bayes"):
        silent = ring_of(decision=decision, attribute_term=term)
        side_by_side(silent)
        alone = silent.process(crossing_scan()).tracks
        assert alone.detection_index.tolist() == [0, 1]
        ring = ring_of(decision=decision, attribute_term=term)
        side_by_side(ring)
        report = ring.say(said(1, 26.0, "track", gaussian(3260.0, 1090.0, 10.0)))
        assert (report.outcome, report.waiting) == ("admitted", 1)
        result = ring.process(crossing_scan())
        assert result.tracks.detection_index.tolist() == [1, 0]
        assert result.scan.statements[0].sequence == 1
        # The state has gone on towards what was said, and is surer.
        assert result.tracks.mean[0, 1] > 1075.0 - 5.0
        assert np.linalg.det(result.tracks.covariance[0]) < np.linalg.det(alone.covariance[0])


@pytest.mark.parametrize("term", [t for t in ATTRIBUTE_TERMS if t != "none"])
def test_a_class_said_of_a_place_reaches_the_association(term):
    """The fighter is in the north: the detection there becomes one, the fighter's track gets it."""
    decision = "map"
    silent, ring = (ring_of(decision=decision, attribute_term=term) for _ in range(2))
    for each in (silent, ring):
        side_by_side(each)
    region = StatementRegion("box", low_m=(3000.0, 1060.0), high_m=(3500.0, 1300.0))
    assert silent.process(crossing_scan()).tracks.detection_index.tolist() == [0, 1]
    ring.say(said(1, 26.0, "place", region, kind="region", grades={"fighter": 1.0}))
    result = ring.process(crossing_scan())
    assert result.tracks.detection_index.tolist() == [1, 0]


@pytest.mark.parametrize("term", [t for t in ATTRIBUTE_TERMS if t != "none"])
def test_a_class_said_of_a_track_stays_without_a_detection(term):
    ring, silent = (ring_of(attribute_term=term) for _ in range(2))
    for each in (ring, silent):
        side_by_side(each)
    ring.say(said(1, 6.0, "track", track_id=2, grades={"fighter": 1.0, "cargo": 0.001}))
    empty = scan_at(6.0, [])
    heard, same = ring.process(empty).tracks, silent.process(empty).tracks
    fighter = heard.class_names.index("fighter")
    now, before = (t.class_probability[1, fighter] for t in (heard, same))
    assert now > before + 0.1 or now > 100.0 * before
    np.testing.assert_allclose(
        heard.class_probability[0], same.class_probability[0], rtol=1e-9, atol=1e-12
    )
    assert heard.mean.tobytes() == same.mean.tobytes()
    np.testing.assert_allclose(heard.class_probability.sum(axis=1), 1.0)


def test_with_no_attribute_term_classes_have_no_effect():
    ring, silent = (ring_of(attribute_term="none") for _ in range(2))
    for each in (ring, silent):
        side_by_side(each)
    ring.say(said(1, 26.0, "track", grades={"cargo": 1.0}))
    ring.say(said(2, 26.0, "place", gaussian(3260.0, 1090.0, 10.0), grades={"fighter": 1.0}))
    same_tracks(ring.process(crossing_scan()).tracks, silent.process(crossing_scan()).tracks)


def test_a_statement_far_from_everything_changes_nothing_much():
    ring, silent = (ring_of() for _ in range(2))
    for each in (ring, silent):
        side_by_side(each)
    ring.say(said(1, 26.0, "place", gaussian(-9e4, 0.0, 10.0), grades={"fighter": 1.0}))
    same_tracks(ring.process(crossing_scan()).tracks, silent.process(crossing_scan()).tracks)


def test_the_factors_are_the_joint_likelihood():
    """Pairs and misses against sampling of place and class together (Mahler 2011, (46), (86))."""
    ring = ring_of(attribute_term="bayes")
    side_by_side(ring)
    region = StatementRegion("box", low_m=(3200.0, 1050.0), high_m=(3300.0, 1400.0))
    pieces = (
        StatementPiece(region, ("fighter",), (0.9,), 0.7),
        StatementPiece(gaussian(3260.0, 1000.0, 60.0), ("cargo",), (0.8,), 0.3),
    )
    statement = replace(said(1, 26.0, "track"), kind="fds", pieces=pieces, reliability=0.95)
    assert ring.say(statement).outcome == "admitted"
    ring.manager.admit(crossing_scan())
    opened = ring.manager.open()
    scan, predictions = opened.scan, opened.predictions
    pairs = gate(scan, predictions)
    evidence = ring.fuzzifier(scan)
    scores = ring.fusion(predictions, evidence, pairs.hypothesis, pairs.detection, scan.statements)
    factors = statement_factors(scan, predictions, scores, pairs.hypothesis, pairs.detection)
    meaning = track_meaning(scan.statements[0], evidence.class_names)
    prior = predictions.class_probability[0]
    mean, covariance = predictions.component_mean[:1], predictions.component_covariance[:1]
    idle = meaning.expectation(mean[:, :2], covariance[:, :2, :2])[0] @ prior
    assert factors.log_idle[0] == pytest.approx(np.log(idle))
    for pair in np.flatnonzero(pairs.hypothesis == 0):
        j = pairs.detection[pair : pair + 1]
        new, spread = update(
            mean, covariance, innovations(polar_measurements(scan), mean, covariance, j)
        )
        by_class = meaning.expectation(new[:, :2], spread[:, :2, :2])[0]
        likelihood = np.exp(evidence.log_class_likelihood[j[0]])
        joint = (prior * likelihood * by_class).sum()
        found = scores.log_likelihood[pair] + factors.log_pair[pair]
        assert found == pytest.approx(np.log(joint), rel=1e-9)
    assert (factors.log_pair[pairs.hypothesis == 1] == 0.0).all()
    assert factors.log_idle[1] == 0.0


@pytest.mark.parametrize("term", ["none", "bayes"])
def test_the_factors_of_a_mixture_are_those_of_its_components(term):
    """A Gaussian in two equal halves is the same track; different halves lie between the two."""
    ring = ring_of(attribute_term=term)
    side_by_side(ring)
    ring.say(said(1, 26.0, "track", gaussian(3260.0, 1090.0, 30.0), grades={"fighter": 0.9}))
    ring.manager.admit(crossing_scan())
    opened = ring.manager.open()
    scan, single = opened.scan, opened.predictions
    pairs = gate(scan, single)
    scores = ring.fusion(
        single, ring.fuzzifier(scan), pairs.hypothesis, pairs.detection, scan.statements
    )
    expected = statement_factors(scan, single, scores, pairs.hypothesis, pairs.detection)

    def halves(shift_m):
        mean = np.repeat(single.component_mean, 2, axis=0)
        mean[0, 1] += shift_m
        return replace(
            single,
            component_start=2 * single.component_start,
            component_weight=np.full(2 * len(single), 0.5),
            component_model=np.zeros(2 * len(single), dtype=np.int32),
            component_mean=mean,
            component_covariance=np.repeat(single.component_covariance, 2, axis=0),
        )

    found = statement_factors(scan, halves(0.0), scores, pairs.hypothesis, pairs.detection)
    np.testing.assert_allclose(found.log_idle, expected.log_idle, rtol=1e-9)
    np.testing.assert_allclose(found.log_pair, expected.log_pair, rtol=1e-9)
    moved = replace(single, component_mean=halves(50.0).component_mean[::2])
    other = statement_factors(scan, moved, scores, pairs.hypothesis, pairs.detection)
    mixed = statement_factors(scan, halves(50.0), scores, pairs.hypothesis, pairs.detection)
    low, high = sorted([expected.log_idle[0], other.log_idle[0]])
    assert low < mixed.log_idle[0] < high
    mean = np.log(0.5 * (np.exp(expected.log_idle[0]) + np.exp(other.log_idle[0])))
    assert mixed.log_idle[0] == pytest.approx(mean, rel=1e-9)


# --- once, and again


def test_each_statement_goes_into_one_scan_in_its_time():
    ring = ring_of()
    side_by_side(ring)
    ring.say(said(1, 6.2, "track", grades={"fighter": 1.0}))
    ring.say(said(2, 3.0, "track", grades={"fighter": 1.0}))
    used = []
    for k in (6.0, 6.1, 6.2, 7.0):
        result = ring.process(scan_at(k, []))
        used.append([s.sequence for s in result.scan.statements])
    assert used == [[2], [], [1], []]
    assert ring.say(said(1, 7.0, "track", grades={"cargo": 1.0})).reason == "duplicate"
    assert ring.manager.counters["statement_rejected_duplicate"] == 1


def test_a_scan_given_up_keeps_its_statements():
    ring = ring_of()
    side_by_side(ring)
    ring.say(said(1, 6.0, "track", grades={"fighter": 1.0}))
    ring.manager.admit(scan_at(6.0, []))
    assert len(ring.manager.open().scan.statements) == 1
    ring.manager.give_up()
    assert len(ring.process(scan_at(7.0, [])).scan.statements) == 1
    assert ring.process(scan_at(8.0, [])).scan.statements == ()


def test_unknown_tracks_and_wrong_answers():
    ring = ring_of()
    tracks = side_by_side(ring)
    gone = int(tracks.track_id.max()) + 1
    assert ring.say(said(1, 6.0, "track", gaussian(0, 0, 9), gone)).reason == "unknown_track"
    ring.say(said(1, 6.0, "track", grades={"fighter": 1.0}))
    ring.manager.admit(scan_at(6.0, []))
    ring.manager.open()
    evidence, scores, associations = answers(ring)
    for name, value in (
        ("updated_hypothesis", np.array([5], dtype=np.int32)),
        ("updated_masses", np.zeros((2, 2))),
        ("updated_class_probability", np.full((1, 3), np.nan)),
    ):
        with pytest.raises(ValueError, match="updated"):
            ring.manager.close(evidence, replace(scores, **{name: value}), associations)
    assert len(ring.manager.state.desk.waiting) == 1


@pytest.mark.parametrize("term", ["none", "dsm_classic", "bayes"])
def test_restarted_at_any_point_no_statement_is_lost_or_used_twice(tmp_path, term):
    """The manager is saved when a statement is admitted and when a scan is closed, as the node."""
    path = tmp_path / "state"
    scans = simulated(16, n_targets=3, clutter=2, seed=4)
    through, restarting = ring_of(attribute_term=term), ring_of(attribute_term=term)
    used = []
    for k, scan in enumerate(scans):
        ids = through.manager.state.table.track_id.tolist()
        stamp_s = scan.stamp_ns / 1e9 - (0.0 if k % 3 else 0.5)
        statement = said(k + 1, stamp_s, "track", gaussian(2000.0, 2000.0, 2000.0), 1)
        if ids:
            statement = replace(statement, track_id=ids[k % len(ids)])
            pieces = (replace(statement.pieces[0], class_names=("cargo",), class_grades=(0.9,)),)
            statement = replace(statement, pieces=pieces)
        assert through.say(statement) == restarting.say(statement)
        checkpoint.save(restarting.manager, path)
        if k % 2:
            # It dies while the scan is open, and the source sends the scan again.
            restarting.manager.admit(scan)
            restarting.manager.open()
        restarting = ring_of(attribute_term=term)
        checkpoint.load(restarting.manager, path)
        expected, result = through.process(scan), restarting.process(scan)
        result.tracks.system_uuid = expected.tracks.system_uuid
        assert_same(result.tracks, expected.tracks, f"scan {k}")
        assert result.scan.statements == expected.scan.statements
        used += [s.sequence for s in result.scan.statements]
    assert len(used) == len(set(used)) >= 10
    assert restarting.manager.counters == through.manager.counters
