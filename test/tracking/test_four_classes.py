"""A frame of four classes and further attributes, by a parameter file alone."""

from dataclasses import replace

import numpy as np
import pytest
from four_class_examples import CLASSES, parameters, recording

from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.ring import Ring

RUNS = 10
LABELLED = {"track_manager__initiation": "labelled", "track_manager__deletion_misses": 0}
RCS_ALONE = {
    f"rcs_fuzzifier__attribute_{name}": []
    for name in ("names", "models", "numbers", "reliability", "unknown_classes")
}
TARGETS = np.array([1, 2, 3])


def play(item, **changes):
    """Tracks after each scan, started from the first two; track i is target i."""
    ring = Ring(parameters(**LABELLED, **changes))
    assert ring.initialise(labelled_tracks(item, 2, ring)).outcome == "initialised"
    results = [ring.process(detections) for detections in item.detections[2:]]
    assert {result.report.outcome for result in results} == {"tracked"}
    return [result.tracks for result in results]


def scores(**changes):
    """Mean probability of the true class, share of right classes at the end, purity of tracks."""
    probability, right, pure = [], [], []
    for run in range(RUNS):
        item = recording(run)
        tracks = play(item, **changes)
        for one, truth in zip(tracks, item.truth[2:], strict=True):
            probability.append(one.class_probability[[0, 1, 2], TARGETS])
            source = np.where(one.detection_index < 0, -9, truth.source_id[one.detection_index])
            pure.extend((source == TARGETS)[one.detection_index >= 0])
        right.append(tracks[-1].class_probability.argmax(axis=1) == TARGETS)
        assert tracks[-1].class_names == CLASSES
    return np.mean(probability), np.mean(right, axis=0), np.mean(pure)


def test_attributes_classify_drone_fighter_and_cargo_and_help_the_association():
    single_scan = {"track_manager__decision": "map", "track_manager__filter": "cv"}
    believed, right, pure = scores(**single_scan)
    believed_alone, right_alone, pure_alone = scores(**single_scan, **RCS_ALONE)
    assert (right >= 0.9).all()
    # The radar cross section alone is right in most runs, and later.
    assert (right_alone >= 0.7).all()
    assert 1.0 - believed < 0.5 * (1.0 - believed_alone)
    # Detections of the two aircraft side by side are told apart better.
    assert 1.0 - pure < 0.5 * (1.0 - pure_alone)


@pytest.mark.parametrize(
    ("term", "decision", "rule"),
    [
        ("dsm_classic", "gda", "dsm_classic"),
        ("dempster", "map", "dempster"),
        ("none", "map", "dempster"),
    ],
)
def test_every_attribute_term_takes_the_evidence(term, decision, rule):
    tracks = play(
        recording(0),
        track_manager__attribute_term=term,
        track_manager__decision=decision,
        rcs_fuzzifier__attribute_rule=rule,
    )
    for one in tracks:
        np.testing.assert_allclose(one.class_probability.sum(axis=1), 1.0, atol=1e-9)
        if one.masses.size:
            np.testing.assert_allclose(one.masses.sum(axis=1), 1.0, atol=1e-9)
    if term == "dempster":
        assert (tracks[-1].class_probability.argmax(axis=1) == TARGETS).all()


def test_attributes_of_an_undeclared_name_change_nothing():
    item = recording(1)
    # In the other order, beside one that the tracker does not know.
    other = replace(
        item,
        detections=[
            replace(
                d,
                attribute_names=("length_m", "colour", "esm_class"),
                attribute_values=np.stack(
                    [d.attribute_values[1], np.ones(len(d.range_m)), d.attribute_values[0]]
                ),
                attribute_valid=np.stack(
                    [d.attribute_valid[1], np.ones(len(d.range_m), bool), d.attribute_valid[0]]
                ),
            )
            for d in item.detections
        ],
    )
    for one, two in zip(play(item), play(other), strict=True):
        np.testing.assert_array_equal(one.mean, two.mean)
        np.testing.assert_array_equal(one.class_probability, two.class_probability)


def test_tracks_that_start_by_themselves_are_classified():
    item = recording(2)
    ring = Ring(parameters(track_manager__confirmation_hits=3))
    for detections in item.detections:
        tracks = ring.process(detections).tracks
    for target, state in enumerate(item.truth[-1].target_state, start=1):
        nearest = np.hypot(*(tracks.mean[:, :2] - state[:2]).T).argmin()
        assert tracks.class_probability[nearest].argmax() == target
