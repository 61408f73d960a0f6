"""Purity on tables made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.evaluation.purity import confusion, confusion_counts, purity
from gda_tracker.vocabulary import ScanKey, ScanTruth, Tracks


def scan(assignments: dict[int, int], sources: list[int]) -> tuple[Tracks, ScanTruth]:
    """One scan: detection row by track id, and the source of every detection row."""
    ids = sorted(assignments)
    tracks = Tracks(
        key=ScanKey(0, "radar", 0),
        track_id=np.array(ids, dtype=np.int64),
        detection_index=np.array([assignments[i] for i in ids], dtype=np.int32),
    )
    truth = ScanTruth(
        "radar",
        0,
        target_id=np.array([10, 20], dtype=np.int32),
        source_id=np.array(sources, dtype=np.int32),
    )
    return tracks, truth


def count(*scans: tuple[Tracks, ScanTruth]) -> np.ndarray:
    return confusion_counts(
        [t for t, _ in scans], [t for _, t in scans], np.array([1, 2]), np.array([10, 20])
    )


def test_own_other_missed_and_false_alarm():
    counts = count(
        scan({1: 0, 2: 1}, [10, 20]),
        scan({1: 1, 2: 0}, [20, 10, -1]),
        scan({1: 1, 2: 0}, [10, 20]),
        scan({1: -1, 2: 2}, [20, 10, -1]),
        scan({1: -1, 2: -1}, []),
    )
    np.testing.assert_array_equal(counts, [[2, 1, 2, 0], [1, 2, 1, 1]])
    np.testing.assert_allclose(purity(counts), [0.4, 0.4])


def test_rows_add_up_to_one_scan_by_scan():
    counts = count(scan({1: 0, 2: -1}, [10]), scan({1: -1, 2: -1}, [-1]))
    np.testing.assert_allclose(confusion(counts).sum(axis=1), 1.0)


def test_an_undetected_target_leaves_its_track_without_a_correct_answer():
    # Target 20 was not detected: its track has missed, which the chapter counts against purity.
    counts = count(scan({1: 0, 2: -1}, [10]))
    np.testing.assert_allclose(purity(counts), [1.0, 0.0])
    np.testing.assert_allclose(confusion(counts)[1], [0.0, 0.0, 1.0, 0.0])


def test_a_track_that_ended_missed():
    counts = count(scan({1: 0}, [10, 20]), scan({}, [10, 20]))
    np.testing.assert_array_equal(counts, [[1, 0, 1, 0], [0, 0, 2, 0]])


def test_tracks_outside_the_list_do_not_count():
    counts = count(scan({1: 0, 2: 1, 7: 2}, [10, 20, -1]))
    np.testing.assert_array_equal(counts, [[1, 0, 0, 0], [0, 1, 0, 0]])


def test_no_scans_give_zero_counts():
    np.testing.assert_array_equal(count(), np.zeros((2, 4)))
    np.testing.assert_array_equal(confusion(count()), np.zeros((2, 4)))


def test_purity_of_many_runs_at_once():
    counts = np.array([[[3, 1, 0, 0], [0, 2, 1, 1]], [[4, 0, 0, 0], [1, 0, 3, 0]]])
    np.testing.assert_allclose(purity(counts), [[0.75, 0.5], [1.0, 0.0]])


def test_truth_without_sources_is_refused():
    tracks, truth = scan({1: 0, 2: 1}, [10, 20])
    truth.source_id = None
    with pytest.raises(ValueError, match="source_id of its detections is missing"):
        count((tracks, truth))


def test_an_index_beyond_the_truth_is_refused():
    first, second = scan({1: 0, 2: 2}, [10, 20]), scan({1: 0, 2: 1}, [10, 20])
    with pytest.raises(ValueError, match="beyond the detections"):
        count(first, second)


def test_a_source_that_is_no_target_is_refused():
    with pytest.raises(ValueError, match=r"source_id 30 .*allowed are \[10, 20\] and -1"):
        count(scan({1: 0, 2: 1}, [10, 30]))
