"""Detections in axes of their own, in which their errors are uncorrelated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.converted_measurements import unbiased_positions
from gda_tracker.kinematics.set_valued.positions import positions_of_scan
from gda_tracker.tracking.door import DefaultNoise, validate
from gda_tracker.vocabulary.scans import Detections

NOISE = DefaultNoise(30.0, 0.01, 0.02, 1.0)


def scan_of(range_m, azimuth, **further):
    detections = Detections(
        "radar", 1, np.atleast_1d(float(range_m)), np.atleast_1d(float(azimuth)), **further
    )
    return validate(detections, NOISE, "map", 100)[0]


def covariance_in_the_plane(positions):
    axes = positions.observing[:, :, :2]
    return axes.transpose(0, 2, 1) @ positions.noise() @ axes


@given(
    range_m=st.floats(1.0, 2e5),
    azimuth=st.floats(-3.14, 3.14),
    std=st.floats(1e-4, 0.4),
    yaw=st.floats(-3.0, 3.0),
)
@settings(max_examples=40, deadline=None)
def test_uncorrelated_errors_are_those_of_the_unbiased_conversion(range_m, azimuth, std, yaw):
    turn = np.array([0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])
    place = np.array([500.0, -300.0, 0.0])
    positions = positions_of_scan(
        scan_of(
            range_m,
            azimuth,
            azimuth_std_rad=np.array([std]),
            sensor_orientation_xyzw=turn,
            sensor_position_m=place,
        )
    )
    measured = np.array([[range_m, azimuth + yaw]])
    expected, covariance = unbiased_positions(measured, np.diag([30.0**2, std**2])[None])
    size = np.abs(covariance).max() + range_m**2 * 1e-9
    np.testing.assert_allclose(positions.position_m, expected + place[:2], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        covariance_in_the_plane(positions), covariance, rtol=1e-6, atol=1e-7 * size
    )
    # z = H x for the state at that position, whatever its velocity.
    state = np.array([*positions.position_m[0], 7.0, -8.0])
    np.testing.assert_allclose(
        positions.observing[0] @ state, positions.observation[0], rtol=1e-9, atol=1e-6
    )
    assert np.array_equal(positions.noise()[0], np.diag(positions.std[0] ** 2))


def test_the_axes_are_along_and_across_the_line_of_sight():
    positions = positions_of_scan(scan_of(1e4, 0.7))
    sight = np.array([math.cos(0.7), math.sin(0.7)])
    np.testing.assert_allclose(np.abs(positions.observing[0, 0, :2] @ sight), 1.0, rtol=1e-12)
    assert positions.std[0] == pytest.approx([30.0, 100.0], rel=1e-3)
    assert positions.observation[0] == pytest.approx([1e4, 0.0], abs=1.0)


def test_correlated_errors_take_their_principal_axes():
    noise = np.array([[[900.0, 0.2], [0.2, 1e-4]]])
    positions = positions_of_scan(scan_of(1e4, 0.7, covariance=noise))
    jacobian = np.array(
        [[math.cos(0.7), -1e4 * math.sin(0.7)], [math.sin(0.7), 1e4 * math.cos(0.7)]]
    )
    np.testing.assert_allclose(
        covariance_in_the_plane(positions)[0], jacobian @ noise[0] @ jacobian.T, rtol=1e-9
    )


def test_a_tilted_radar_and_elevations_still_give_a_diagonal():
    tilt = np.array([math.sin(0.1), 0.0, 0.0, math.cos(0.1)])
    scan = scan_of(1e4, 0.7, elevation_rad=np.array([0.2]), sensor_orientation_xyzw=tilt)
    positions = positions_of_scan(scan)
    assert positions.left_out == 0
    assert np.isfinite(positions.std).all()
    assert (positions.std > 0.0).all()


def test_a_detection_with_a_time_offset_observes_its_own_time():
    positions = positions_of_scan(scan_of(1e3, 0.0, time_offset_s=np.array([0.5])))
    state = np.array([0.0, 0.0, 100.0, -40.0])
    np.testing.assert_allclose(
        np.abs(positions.observing[0] @ state), np.abs([50.0, -20.0]), rtol=1e-12
    )


def test_what_tells_no_position_is_left_out():
    detections = Detections(
        "radar",
        1,
        np.array([100.0, 200.0, 300.0]),
        np.zeros(3),
        azimuth_std_rad=np.array([0.01, 0.6, 0.02]),
    )
    positions = positions_of_scan(validate(detections, NOISE, "map", 10)[0])
    assert positions.left_out == 1
    assert positions.source_index.tolist() == [0, 2]
    assert len(positions) == 2


def test_far_away_no_digits_are_lost():
    positions = positions_of_scan(scan_of(1e9, 0.3, azimuth_std_rad=np.array([1e-9])))
    assert positions.std[0] == pytest.approx([30.0, 1.0], rel=1e-6)
