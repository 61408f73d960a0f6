"""What is shown of a scan agrees with what went round the ring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.tracking.ring import RingResult
from gda_tracker.view.encoding import positions
from gda_tracker.view.picture import picture_of
from gda_tracker.vocabulary.scans import ScanKey, ScanReport


def inside(picture):
    """Pairs (track id, row) that lie in the gates that are drawn."""
    gates, seen = picture.gates, picture.sightings
    found = set()
    for i, track in enumerate(gates.track_id.tolist()):
        for j, row in enumerate(seen.source_index.tolist()):
            gap = np.array(
                [
                    seen.range_m[j] - gates.range_m[i],
                    math.remainder(seen.azimuth_rad[j] - gates.azimuth_rad[i], math.tau),
                ]
            )
            if gap @ np.linalg.solve(gates.covariance[i], gap) <= gates.threshold:
                found.add((track, row))
    return found


def test_gates_that_are_drawn_hold_the_detections_that_are_gated(gda):
    """All detections of the scenario have the same noise, so the drawn gate is the true one."""
    pairs_seen = 0
    for result, (_, picture) in zip(gda.results, gda.history.between(1, 999), strict=True):
        pairs = gate(result.scan, result.predictions)
        expected = {
            (int(result.predictions.track_id[h]), int(result.scan.source_index[d]))
            for h, d in zip(pairs.hypothesis, pairs.detection, strict=True)
        }
        assert inside(picture) == expected
        pairs_seen += len(expected)
    assert pairs_seen > len(gda.results)


def test_one_gate_per_track_of_the_hypothesis_that_spoke_for_it(mht):
    several = 0
    previous = None
    for result, (_, picture) in zip(mht.results, mht.history.between(1, 999), strict=True):
        predictions, gates = result.predictions, picture.gates
        assert gates.track_id.tolist() == sorted(set(predictions.track_id.tolist()))
        several += len(predictions) > len(gates.track_id)
        if previous is not None:
            for i, track in enumerate(gates.track_id.tolist()):
                spoke = previous.hypothesis_id[previous.track_id == track][0]
                (row,) = np.flatnonzero(predictions.hypothesis_id == spoke)
                first, end = predictions.component_start[row : row + 2]
                heaviest = first + np.argmax(predictions.component_weight[first:end])
                expected = math.hypot(*predictions.component_mean[heaviest, :2])
                assert gates.range_m[i] == pytest.approx(expected)
        previous = result.tracks
    assert several  # else the test has shown nothing


def test_yaw_and_position_of_the_sensor_and_of_what_it_sees(gda):
    result = gda.results[4]
    yaw = 2.3
    pose = np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
    scan = replace(
        result.scan,
        sensor_position_m=np.array([500.0, -200.0, 12.0]),
        sensor_orientation_xyzw=pose,
    )
    picture = picture_of(replace(result, scan=scan))
    assert picture.sensor_yaw_rad == pytest.approx(yaw)
    assert picture.sensor_xy_m.tolist() == [500.0, -200.0]
    expected, _ = cartesian_positions(polar_measurements(scan))
    np.testing.assert_allclose(positions(picture), expected, rtol=1e-12)


def test_a_rejected_scan_has_no_picture():
    report = ScanReport(ScanKey(1, "radar", 5), "rejected", reason="late")
    assert picture_of(RingResult(report)) is None


def test_messages_that_have_not_come_leave_gaps(gda):
    result = gda.results[4]
    picture = picture_of(replace(result, predictions=None, associations=None, scores=None))
    assert picture.gates is None
    assert picture.decision is None
    assert len(picture.sightings.range_m) == len(result.scan)
    assert picture_of(RingResult(result.report, result.tracks)).sightings.range_m.size == 0


def test_what_is_not_shown_is_not_kept(mht):
    picture = mht.history.between(9, 9)[0][1]
    assert picture.decision.predictions.component_mean.size == 0
    assert picture.decision.scores.masses.size == 0
    assert picture.size_bytes < 30_000
