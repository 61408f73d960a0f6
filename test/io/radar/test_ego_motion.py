"""The radar's own velocity from range rates: simulated, and on real scans from a moving car."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.io.adapters import continental_yaml
from gda_tracker.io.radar.conversion import detections_of_fields
from gda_tracker.io.radar.ego_motion import estimate_sensor_velocity, static_range_rate
from gda_tracker.io.radar.frames import detections_of_frame, sensor_velocity
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.parameters import from_mapping
from gda_tracker.resources import resource

SRR520 = resource("data", "continental", "srr520_1708578209_45566935_near_detection.yaml")


def table(**values):
    return from_mapping(RadarInputParameters, values)


@settings(max_examples=40, deadline=None)
@given(st.floats(-40, 40), st.floats(-40, 40), st.integers(0, 1000))
def test_a_velocity_is_found_among_movers_and_noise(ahead, left, seed):
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-1.2, 1.2, 120), rng.uniform(-0.2, 0.2, 120)
    rate = static_range_rate(azimuth, elevation, ahead, left) + rng.normal(0.0, 0.1, 120)
    rate[:30] += rng.uniform(3.0, 20.0, 30)  # a quarter moves
    found = estimate_sensor_velocity(azimuth, elevation, rate)
    assert found.ahead_mps == pytest.approx(ahead, abs=0.5)
    assert found.left_mps == pytest.approx(left, abs=0.5)
    assert found.share >= 0.74


def test_the_range_rate_of_what_stands_still_by_hand():
    """Ahead it comes at the full speed, at 60 degrees at half of it, to the side by the other."""
    azimuth = np.array([0.0, math.pi / 3, math.pi / 2])
    np.testing.assert_allclose(static_range_rate(azimuth, None, 10.0, 0.0), [-10, -5, 0], atol=1e-9)
    assert static_range_rate(azimuth, None, 0.0, 3.0)[2] == pytest.approx(-3.0)
    tilted = static_range_rate(azimuth, np.full(3, math.pi / 3), 10.0, 0.0)
    np.testing.assert_allclose(tilted, [-5, -2.5, 0], atol=1e-9)


def test_too_little_to_go_by():
    few = np.linspace(-1, 1, 9)
    assert estimate_sensor_velocity(few, None, few) is None
    one_way = np.full(30, 0.3)
    assert estimate_sensor_velocity(one_way, None, one_way) is None
    unknown = np.full(30, np.nan)
    assert estimate_sensor_velocity(np.linspace(-1, 1, 30), None, unknown) is None


def test_a_corner_radar_finds_the_speed_that_the_car_told_it():
    """6.78 m/s is the speed of the car in the sensor's own object list, 53 ms before."""
    (frame,) = continental_yaml.frames(SRR520)
    found = sensor_velocity([frame], table())
    assert math.hypot(found.ahead_mps, found.left_mps) == pytest.approx(6.78, abs=0.1)
    assert found.share > 0.85
    assert found.share_at_rest < 0.2
    for motion, least, most in (("estimated", 0.85, 0.9), ("declared", 0.0, 0.2)):
        scan = detections_of_frame(frame, table(sensor_motion=motion, moving_above_mps=1.0))
        assert least < np.mean(scan.still) < most
    declared = table(
        sensor_speed_mps=found.ahead_mps, sensor_speed_left_mps=found.left_mps, moving_above_mps=1.0
    )
    assert np.mean(detections_of_frame(frame, declared).still) == pytest.approx(found.share)


def test_where_no_speed_explains_most_points_the_declared_one_holds():
    rng = np.random.default_rng(2)
    fields = {
        "range": np.full(50, 10.0),
        "azimuth": np.linspace(-1, 1, 50),
        "range_rate": rng.uniform(-50, 50, 50),
    }
    parameters = table(
        sensor_motion="estimated", sensor_speed_mps=2.0, range_rate_reference="ground"
    )
    scan = detections_of_fields(fields, parameters, 0)
    assert scan.counts["sensor_motion_unknown"] == 1
    expected = fields["range_rate"] + 2.0 * np.cos(fields["azimuth"])
    np.testing.assert_allclose(scan.detections.range_rate_mps, expected)


def test_range_rates_are_passed_on_as_measured_or_over_ground():
    """A car ahead at 15 m/s seen from 10 m/s behind goes away with 5; what stands comes with 10."""
    fields = {"range": [50.0, 30.0], "azimuth": [0.0, 0.0], "range_rate": [5.0, -10.0]}
    fields = {name: np.array(values) for name, values in fields.items()}
    for reference, passed in (("sensor", 5.0), ("ground", 15.0)):
        parameters = table(
            sensor_speed_mps=10.0, moving_above_mps=1.0, range_rate_reference=reference
        )
        scan = detections_of_fields(fields, parameters, 0)
        assert scan.still.tolist() == [False, True]
        assert scan.detections.range_rate_mps.tolist() == [passed]
