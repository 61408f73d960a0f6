"""Labelled initiation: states and beliefs by hand, identities, and what it refuses."""

import dataclasses

import numpy as np
import pytest
from door_examples import NOISE
from tracking_examples import SECOND, ring_of, scan_at

from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.tracking.door import validate
from gda_tracker.tracking.initiation import two_point_states
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, AssociationSettings, Predictions, Recording, ScanTruth

VELOCITY = {7: (20.0, 0.0), 3: (0.0, -30.0)}
START = {7: (4000.0, 1000.0), 3: (1000.0, 5000.0)}
RCS = {7: 1.1, 3: 4.5, -1: 0.2}


def recording_of(n_scans=4, period_s=2.0):
    """Two targets, 7 and 3, and a false alarm, in an order that changes from scan to scan."""
    scans, truth = [], []
    for k in range(n_scans):
        order = np.roll([7, -1, 3], k)
        t = 5.0 + k * period_s
        place = {i: np.add(START[i], t * np.array(VELOCITY[i])) for i in START}
        place[-1] = np.array([2000.0, 2000.0])
        scan = scan_at(t, [place[i] for i in order])
        scan.rcs_m2 = np.array([RCS[i] * (1.0 + 0.2 * k) for i in order])
        scans.append(scan)
        truth.append(
            ScanTruth("radar", scan.stamp_ns, np.array([7, 3], dtype=np.int32), source_id=order)
        )
    return Recording("two", scans, truth)


def parameters(term, forgetting=1.0):
    manager = {
        "attribute_term": term,
        "history_policy": "forgetting" if forgetting < 1.0 else "none",
        "forgetting_factor": forgetting,
        "range_std_m": NOISE.range_std_m,
        "azimuth_std_rad": NOISE.azimuth_std_rad,
    }
    return {"track_manager": manager}


def test_states_are_two_point_states_of_the_last_two_scans():
    recording = recording_of()
    tracks = labelled_tracks(recording, 3, Ring(parameters("none")))
    # By rising id: target 3, then 7; the scan of initiation is the third, at 9 s.
    expected = [
        np.append(np.add(START[i], 9.0 * np.array(VELOCITY[i])), VELOCITY[i]) for i in (3, 7)
    ]
    np.testing.assert_allclose(tracks.mean, expected, rtol=1e-9, atol=1e-7)
    assert tracks.key == (0, "radar", 9 * SECOND)
    assert tracks.track_id.tolist() == [1, 2]
    assert tracks.status.tolist() == [CONFIRMED, CONFIRMED]
    assert tracks.hits.tolist() == [3, 3]
    assert tracks.first_detection_ns.tolist() == [5 * SECOND] * 2
    assert tracks.last_detection_ns.tolist() == [9 * SECOND] * 2
    # roll([7, -1, 3], 2) = [-1, 3, 7]
    assert tracks.detection_index.tolist() == [1, 2]
    parts = []
    for k, rows in ((1, [0, 1]), (2, [1, 2])):
        scan, _ = validate(recording.detections[k], NOISE, "map", 100)
        position, covariance = cartesian_positions(polar_measurements(scan))
        parts += [position[rows], covariance[rows]]
    _, covariance = two_point_states(*parts, np.full(2, 2.0))
    np.testing.assert_array_equal(tracks.covariance, covariance)


@pytest.mark.parametrize("forgetting", [1.0, 0.7])
@pytest.mark.parametrize("term", [term for term in ATTRIBUTE_TERMS if term != "none"])
def test_beliefs_are_those_of_the_stages_in_a_row(term, forgetting):
    """The same detections through fuzzifier and fusion stage, one scan after the other."""
    recording = recording_of()
    tracks = labelled_tracks(recording, 3, Ring(parameters(term, forgetting)))
    fuzzifier = RcsFuzzifier(RcsFuzzifierParameters())
    fusion = AttributeFusion(AttributeFusionParameters())
    belief = None
    for detections, truth in zip(recording.detections[:3], recording.truth, strict=False):
        scan, _ = validate(detections, NOISE, "map", 100)
        evidence = fuzzifier(scan)
        rows = np.array([np.flatnonzero(truth.source_id == i)[0] for i in (3, 7)])
        if belief is None:
            belief = evidence.focal, evidence.masses[rows], evidence.class_probability[rows]
            continue
        focal, masses, classes = belief
        zeros = np.zeros(2, dtype=np.int64)
        predictions = Predictions(
            key=scan.key,
            settings=AssociationSettings(
                attribute_term=term, history_policy="forgetting", forgetting_factor=forgetting
            ),
            hypothesis_id=zeros,
            parent_id=zeros,
            track_id=zeros,
            detection_probability=np.ones(2),
            component_start=np.arange(3, dtype=np.int32),
            component_weight=np.ones(2),
            component_model=np.zeros(2, dtype=np.int32),
            component_mean=np.zeros((2, 4)),
            component_covariance=np.zeros((2, 4, 4)),
            frame=evidence.frame,
            focal=focal,
            masses=masses,
            class_names=evidence.class_names,
            class_probability=classes,
        )
        scores = fusion(predictions, evidence, np.arange(2, dtype=np.int32), rows.astype(np.int32))
        if scores.masses.shape[1]:
            focal, masses = scores.focal, scores.masses
        belief = focal, masses, scores.class_probability
    np.testing.assert_array_equal(tracks.focal, belief[0])
    np.testing.assert_allclose(tracks.masses, belief[1], rtol=1e-12)
    np.testing.assert_allclose(tracks.class_probability, belief[2], rtol=1e-12)
    # Target 3 is the big one.
    cargo = list(tracks.class_names).index("cargo")
    assert tracks.class_probability[0, cargo] > tracks.class_probability[1, cargo]


@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_the_tracks_are_what_a_manager_takes(term):
    recording = recording_of()
    ring = ring_of(initiation="labelled", attribute_term=term)
    assert (
        ring.initialise(labelled_tracks(recording, 2, Ring(parameters(term)))).outcome
        == "initialised"
    )
    for detections in recording.detections[2:]:
        tracks = ring.process(detections).tracks
    assert tracks.track_id.tolist() == [1, 2]
    np.testing.assert_array_equal(tracks.coasted_scans, 0)
    np.testing.assert_array_equal(tracks.hits, 4)


def without_truth(recording):
    recording.truth = None


def without_labels(recording):
    recording.truth[1].source_id = None


def missed(recording):
    recording.truth[1].source_id = np.array([-1, -1, 3])


def twice(recording):
    recording.truth[1].source_id = np.array([3, 7, 3])


def short(recording):
    del recording.detections[1:], recording.truth[1:]


def standing_still(recording):
    recording.detections[1].stamp_ns = recording.detections[0].stamp_ns


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (without_truth, "labelled initiation needs truth"),
        (without_labels, "scan 1 has 0 detections labelled target 3"),
        (missed, "scan 1 has 0 detections labelled target 7"),
        (twice, "scan 1 has 2 detections labelled target 3"),
        (short, "two: 1 scans, labelled initiation needs 2"),
        (standing_still, "do not rise"),
    ],
)
def test_what_it_cannot_start_from_is_named(spoil, message):
    recording = recording_of()
    spoil(recording)
    with pytest.raises(ValueError, match=message):
        labelled_tracks(recording, 2, Ring(parameters("none")))


def test_one_scan_is_not_enough():
    with pytest.raises(ValueError, match="at least two scans"):
        labelled_tracks(recording_of(), 1, Ring(parameters("none")))


def test_a_labelled_detection_that_the_door_refuses_is_missing():
    recording = recording_of()
    scan = recording.detections[1]
    ranges = scan.range_m.copy()
    ranges[recording.truth[1].source_id == 7] = np.nan
    recording.detections[1] = dataclasses.replace(scan, range_m=ranges)
    with pytest.raises(ValueError, match="scan 1 has 0 detections labelled target 7"):
        labelled_tracks(recording, 2, Ring(parameters("none")))
