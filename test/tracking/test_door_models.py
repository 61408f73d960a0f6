"""The door for sensors with a model of their own."""

from __future__ import annotations

import numpy as np
import pytest
from door_examples import NOISE, detections_of

from gda_tracker.tracking.door import Rejected
from gda_tracker.tracking.door_models import ModelSetting, validate_with_model

NOTHING = np.full(3, np.nan)
REFERENCE = (9_000.0, 0.0, 0.0)


def _validate(model, reference=REFERENCE, **fields):
    setting = ModelSetting(model, reference)
    return validate_with_model(detections_of(**fields), setting, NOISE, "map", 100)


def test_what_is_not_measured_is_nan_whatever_was_sent():
    scan, counts = _validate("bearing", range_m=NOTHING, range_std_m=np.array([np.nan]))
    assert not counts
    assert np.isnan(scan.range_m).all()
    np.testing.assert_array_equal(scan.azimuth_rad, 0.1 * np.arange(3))
    assert scan.sensor_model == "bearing"
    scan, _ = _validate("range", azimuth_rad=np.array([9.0, np.inf, np.nan]))
    assert np.isnan(scan.azimuth_rad).all()
    assert len(scan) == 3


def test_differences_have_a_sign_and_ranges_have_none():
    sent = {"range_m": np.array([-500.0, 0.0, 700.0]), "azimuth_rad": NOTHING}
    scan, counts = _validate("tdoa", **sent)
    np.testing.assert_array_equal(scan.range_m, sent["range_m"])
    assert not counts
    scan, counts = _validate("range", **sent)
    np.testing.assert_array_equal(scan.range_m, [700.0])
    np.testing.assert_array_equal(scan.source_index, [2])
    assert counts == {"negative_range": 1, "zero_range": 1}


def test_platforms_come_with_the_detections_or_stand_still():
    scan, _ = _validate("tdoa", sensor_velocity_mps=np.array([1.0, 2.0, 0.0]))
    np.testing.assert_array_equal(scan.sensor_velocity_mps, [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(scan.reference_position_m, REFERENCE)
    np.testing.assert_array_equal(scan.reference_velocity_mps, [0.0, 0.0, 0.0])
    own = np.array([5.0, 6.0, 7.0])
    scan, _ = _validate("tdoa", reference_position_m=own)
    np.testing.assert_array_equal(scan.reference_position_m, own)


def test_noise_of_its_own_counts_for_what_is_measured():
    covariance = np.tile(np.diag([np.nan, 4e-6, np.nan]), (3, 1, 1))
    scan, counts = _validate("bearing", covariance=covariance, range_rate_mps=NOTHING)
    assert not counts
    np.testing.assert_array_equal(scan.noise_covariance[:, 1, 1], 4e-6)
    assert scan.range_rate_mps is None


def test_what_is_measured_must_be_a_number():
    rate = np.array([1.0, np.nan, 3.0])
    scan, counts = _validate("fdoa", range_m=NOTHING, azimuth_rad=NOTHING, range_rate_mps=rate)
    np.testing.assert_array_equal(scan.range_rate_mps, [1.0, 3.0])
    assert counts == {"not_finite": 1}


def test_an_empty_scan_needs_no_range_rates():
    scan, _ = _validate("tdoa_fdoa", n=0)
    assert len(scan) == 0


TILT = np.array([0.1, 0.0, 0.0, np.sqrt(0.99)])


@pytest.mark.parametrize(
    ("model", "fields", "reason"),
    [
        ("tdoa_fdoa", {}, "range_rate_missing"),
        ("bearing", {"elevation_rad": np.zeros(3)}, "elevation_with_model"),
        ("bearing", {"time_offset_s": np.zeros(3)}, "time_offset_with_model"),
        ("bearing", {"sensor_orientation_xyzw": TILT}, "tilted_sensor"),
        ("bearing", {"sensor_velocity_mps": np.array([np.nan, 0, 0])}, "bad_sensor_velocity"),
        ("bearing", {"sensor_velocity_mps": np.zeros(2)}, "array_length_mismatch"),
        ("tdoa", {"reference": None}, "reference_missing"),
        ("tdoa", {"reference_position_m": np.array([np.inf, 0, 0])}, "bad_reference"),
        ("tdoa", {"reference_velocity_mps": np.array([1e9, 0, 0])}, "bad_reference"),
        ("range", {"covariance": np.zeros((3, 3, 3))}, "array_length_mismatch"),
        ("range", {"covariance": "none"}, "malformed_array"),
        ("range", {"sensor_id": ""}, "missing_sensor_id"),
    ],
)
def test_faults_of_a_scan_have_names(model, fields, reason):
    with pytest.raises(Rejected, match=f"^{reason}$"):
        _validate(model, **fields)
