"""Scores of several runs and their table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from report_examples import swapping_run

from gda_tracker.evaluation.summary import (
    Run,
    Summary,
    format_table,
    pair_with_truth,
    paired_difference,
    run_purity,
    summarise,
    summary_table,
)


def make_summary(**changes) -> Summary:
    values = {
        "method": "gda/none/cv",
        "runs": 2,
        "scans": 46,
        "lost_scans": 0,
        "purity": np.array([0.5, 0.7]),
        "completeness": 0.9,
        "switches": 0.5,
        "position_rmse_m": 12.34,
        "match_distance_m": 25.0,
        "latency_ms": np.array([1.0, 3.0]),
    }
    return Summary(**{**values, **changes})


def two_runs() -> list[Run]:
    """Two runs with track ids that go on counting."""
    runs = []
    for number, ids in enumerate([(1, 2), (3, 4)]):
        _, truth, tracks = swapping_run(number, ids)
        runs.append(Run(tracks, truth))
    return runs


def test_purity_of_a_run_by_hand():
    # Track 1 took 1, 1, 2, 2 and track 2 took 2, 2, a false alarm, 1: half of each is its own.
    assert run_purity(two_runs()[0]) == 0.5


def test_later_track_ids_belong_to_the_same_targets():
    first, second = two_runs()
    assert run_purity(first) == run_purity(second)


def test_scans_are_sorted_into_runs_by_their_truth():
    runs = two_runs()
    tracks = {("radar", t.key.stamp_ns): t for run in runs for t in reversed(run.tracks)}
    truth = {("radar", t.stamp_ns): t for run in runs for t in run.truth}
    lost = truth[("radar", runs[1].truth[2].stamp_ns)]
    del tracks[("radar", lost.stamp_ns)]
    found = pair_with_truth(tracks, truth)
    assert [len(run.tracks) for run in found] == [4, 3]
    for run in found:
        assert [t.key.stamp_ns for t in run.tracks] == [t.stamp_ns for t in run.truth]
        assert run.truth == sorted(run.truth, key=lambda t: t.stamp_ns)


def test_new_tracks_of_a_new_run_are_no_switches():
    found = summarise("m", two_runs(), [1.0], 0, labelled=True, match_distance_m=25.0)
    # Each target has another track from the third scan on, which does not last three scans.
    assert found.switches == 0.0
    assert (found.runs, found.scans) == (2, 8)
    assert found.completeness == 1.0
    assert found.position_rmse_m == pytest.approx(0.0)
    assert found.purity.tolist() == [0.5, 0.5]


def test_position_error_counts_samples_not_runs():
    near, far = two_runs()
    for tracks in far.tracks[1:]:
        tracks.mean[:, 1] += 1000.0  # out of reach: only one scan of this run is matched
    far.tracks[0].mean[:, 0] += 10.0
    found = summarise("m", [near, far], [1.0], 0, labelled=False, match_distance_m=25.0)
    assert found.position_rmse_m == pytest.approx(math.sqrt(2 * 10.0**2 / (8 + 2)))
    assert found.completeness == pytest.approx((1.0 + 0.25) / 2)
    assert found.purity is None


def test_nothing_to_score_is_an_error():
    with pytest.raises(ValueError, match="no scan has both"):
        summarise("m", [], [], 0, labelled=True, match_distance_m=25.0)


def test_difference_is_paired():
    mean, stderr = paired_difference(np.array([0.6, 0.9, 0.4]), np.array([0.5, 0.8, 0.3]))
    assert mean == pytest.approx(0.1)
    assert stderr == pytest.approx(0.0, abs=1e-12)


def test_table_has_units_differences_and_gaps():
    columns = {
        "boats": make_summary(purity=None, runs=1, latency_ms=np.zeros(0)),
        "off": make_summary(),
        "on": make_summary(purity=np.array([0.8, 0.7]), position_rmse_m=math.nan, lost_scans=3),
    }
    rows = {row[0]: row[1:] for row in summary_table(columns, "off")}
    assert rows[""] == ["boats", "off", "on"]
    assert rows["track purity [0..1]"] == ["n/a", "0.600 +- 0.100", "0.750 +- 0.050"]
    assert rows["purity, paired difference [0..1]"] == ["n/a", "-", "+0.150 +- 0.150"]
    assert rows["scans lost"] == ["0", "0", "3"]
    assert rows["position error [m RMS]"] == ["12.3", "12.3", "n/a"]
    assert rows["latency per scan, median [ms]"] == ["n/a", "2.0", "2.0"]
    assert rows["latency per scan, 99 % [ms]"][1] == "3.0"


def test_a_single_run_has_no_standard_error():
    rows = {
        row[0]: row[1:] for row in summary_table({"a": make_summary(purity=np.array([0.5]))}, "a")
    }
    assert rows["track purity [0..1]"] == ["0.500"]


def test_plain_text_is_aligned():
    text = format_table([["", "a", "long name"], ["x [m]", "1.0", "2"]])
    assert text.split("\n") == [
        "         a  long name",
        "---------------------",
        "x [m]  1.0          2",
        "---------------------",
    ]
