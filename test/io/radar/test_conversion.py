"""Fields made detections: units, signs, radar cross sections, ego motion, what is left out."""

import math

import numpy as np
import pytest
import yaml

from gda_tracker.io.radar.conversion import detections_of_fields
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.resources import resource

ARS548 = resource("data", "continental", "ars548_1708578204_202447652_detection.yaml")


def convert(fields, **parameters):
    fields = {name: np.asarray(values, dtype=float) for name, values in fields.items()}
    return detections_of_fields(fields, from_mapping(RadarInputParameters, parameters), 5, "front")


def polar(**more):
    return {"range": [100.0, 50.0], "azimuth": [0.1, -0.2], **more}


def test_polar_fields_pass_as_they_are():
    found = convert(polar(elevation=[0.01, 0.02], range_rate=[3.0, -4.0])).detections
    assert (found.sensor_id, found.stamp_ns, found.frame_id) == ("radar", 5, "front")
    np.testing.assert_array_equal(found.range_m, [100.0, 50.0])
    np.testing.assert_allclose(found.azimuth_rad, [0.1, -0.2], atol=1e-15)
    np.testing.assert_array_equal(found.elevation_rad, [0.01, 0.02])
    np.testing.assert_array_equal(found.range_rate_mps, [3.0, -4.0])
    assert found.rcs_m2 is None


def test_compass_azimuth_in_degrees():
    """Clockwise from North, which is y where x is East: 30 degrees is 60 from East."""
    found = convert(
        {"range": [10.0, 10.0], "azimuth": [30.0, 200.0]},
        angle_unit="deg",
        azimuth_sign=-1,
        azimuth_zero_deg=90.0,
    ).detections
    np.testing.assert_allclose(np.rad2deg(found.azimuth_rad), [60.0, -110.0], atol=1e-12)


def test_x_right_y_ahead_is_turned_to_x_ahead_y_left():
    found = convert({"x": [1.0], "y": [2.0], "z": [0.5]}, cartesian_yaw_deg=90.0).detections
    # One metre to the right: a negative azimuth.
    assert found.azimuth_rad[0] == pytest.approx(-math.atan2(1.0, 2.0))
    assert found.range_m[0] == pytest.approx(math.sqrt(5.25))
    assert found.elevation_rad[0] == pytest.approx(math.atan2(0.5, math.sqrt(5.0)))


def test_a_radar_in_the_plane_measures_no_elevation():
    assert convert({"x": [1.0], "y": [2.0], "z": [0.0]}).detections.elevation_rad is None
    assert convert({"x": [1.0], "y": [2.0]}).detections.elevation_rad is None
    found = convert(polar(elevation=[0.1, 0.2], elevation_std=[1, 1]), elevation_used=False)
    assert found.detections.elevation_rad is None
    assert found.detections.elevation_std_rad is None


def test_the_position_source_can_be_chosen():
    both = {**polar(), "x": [1.0, 2.0], "y": [0.0, 0.0]}
    assert convert(both).detections.range_m.tolist() == [100.0, 50.0]
    cartesian = convert(both, position_source="cartesian").detections
    assert cartesian.range_m.tolist() == [1.0, 2.0]
    with pytest.raises(ParameterError, match="range and azimuth needed, found are x, y"):
        convert({"x": [1.0], "y": [2.0]}, position_source="polar")
    with pytest.raises(ParameterError, match="no position"):
        convert({"range": [1.0]})


def test_radar_cross_sections_by_unit_scale_and_offset():
    rcs = [10.0, -20.0]
    assert convert(polar(rcs=rcs)).detections.rcs_m2 is None  # not declared: not used
    found = convert(polar(rcs=rcs), rcs_unit="dbsm").detections
    np.testing.assert_allclose(found.rcs_m2, [10.0, 0.01])
    assert found.rcs_valid.tolist() == [True, True]
    found = convert(polar(rcs=rcs), rcs_unit="m2").detections
    assert found.rcs_m2.tolist() == [10.0, 0.0]
    assert found.rcs_valid.tolist() == [True, False]
    # A byte that holds the value plus 128.
    found = convert(polar(rcs=[138, 108]), rcs_unit="dbsm", rcs_offset=-128.0).detections
    np.testing.assert_allclose(found.rcs_m2, [10.0, 0.01])


def test_an_rcs_out_of_range_or_the_same_for_all_points_is_unknown():
    scan = convert(polar(rcs=[np.nan, 200.0]), rcs_unit="dbsm", rcs_maximum=60.0)
    assert scan.detections.rcs_valid.tolist() == [False, False]
    assert scan.counts["rcs_unknown"] == 2
    n = 12
    many = {"range": np.arange(1.0, n + 1), "azimuth": np.zeros(n)}
    scan = convert({**many, "rcs": np.full(n, 7.0)}, rcs_unit="dbsm")
    assert not scan.detections.rcs_valid.any()
    assert scan.counts["rcs_all_equal"] == n
    scan = convert({**many, "rcs": np.append(np.full(n - 1, 7.0), 8.0)}, rcs_unit="dbsm")
    assert scan.detections.rcs_valid.all()


def test_what_is_no_detection_is_left_out_and_counted():
    fields = {
        "x": [0.0, 3.0, np.nan, 0.5, 400.0, 20.0],
        "y": [0.0, 4.0, 1.0, 0.0, 0.0, 0.0],
        "z": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "snr": [20.0, 20.0, 20.0, 20.0, 20.0, np.nan],
    }
    scan = convert(
        fields,
        padding_zeros=True,
        minimum_range_m=1.0,
        maximum_range_m=300.0,
        minimum_snr_db=10.0,
    )
    assert scan.detections.range_m.tolist() == [5.0]
    assert scan.counts == {
        "padding": 1,
        "not_finite": 1,
        "too_close": 1,
        "too_far": 1,
        "too_weak": 1,
    }


def test_deviations_come_in_the_unit_of_their_quantity():
    found = convert(
        {
            "range": [10.0],
            "azimuth": [45.0],
            "azimuth_std": [0.5],
            "range_std": [0.2],
            "range_rate": [1.0],
            "range_rate_std": [0.1],
        },
        angle_unit="deg",
    ).detections
    assert found.range_std_m.tolist() == [0.2]
    assert found.azimuth_std_rad[0] == pytest.approx(math.radians(0.5))
    assert found.range_rate_std_mps.tolist() == [0.1]


def test_further_attributes_come_by_the_names_declared():
    parameters = from_mapping(RadarInputParameters, {"attribute_fields": ["snr_db=snr"]})
    assert parameters.attributes == {"snr_db": "snr"}
    found = convert(polar(snr=[12.0, 13.0]), attribute_fields=["snr_db=snr"]).detections
    assert found.attribute_names == ("snr_db",)
    assert found.attribute_values.tolist() == [[12.0, 13.0]]


def test_other_field_names_and_fields_not_to_be_used():
    table = from_mapping(
        RadarInputParameters, {"field_names": ["rcs=s", "range_rate=h", "snr="], "rcs_unit": "m2"}
    )
    present = ["x", "y", "z", "h", "s", "v", "snr"]
    assert table.fields_of(present) == {
        "x": "x",
        "y": "y",
        "z": "z",
        "range_rate": "h",
        "rcs": "s",
    }
    with pytest.raises(ParameterError, match=r"range_rate=h, but the fields are x, y"):
        table.fields_of(["x", "y"])


def test_no_signal_strength_is_ever_taken_for_a_radar_cross_section():
    table = from_mapping(RadarInputParameters, {"rcs_unit": "dbsm"})
    for name in ("intensity", "amplitude", "power", "snr"):
        assert "rcs" not in table.fields_of(["x", "y", name])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"azimuth_sign": 0}, "azimuth_sign = 0: allowed is 1 or -1"),
        ({"range_rate_sign": 0}, "range_rate_sign = 0: allowed is 1 or -1"),
        ({"minimum_range_m": 5.0, "maximum_range_m": 5.0}, "maximum_range_m = 5.0"),
        ({"rcs_minimum": 2.0, "rcs_maximum": 1.0}, "rcs_maximum = 1.0"),
        ({"rcs_scale": 0.0}, "rcs_scale = 0.0"),
        ({"field_names": ["size=x"]}, "quantity 'size', allowed is one of x, y"),
        ({"field_names": ["x"]}, "'x', allowed are entries name=value"),
        ({"field_names": ["x=a", "x=b"]}, "'x=b', allowed are entries name=value that differ"),
        ({"field_types": ["rcs=half"]}, "rcs=half, allowed is one of int8"),
        ({"attribute_fields": ["snr="]}, "attribute_fields"),
        ({"rcs_unit": "dBm"}, "rcs_unit = 'dBm'"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        from_mapping(RadarInputParameters, values)


# --- ego motion, on a real scan of a static scene seen from a car at 6.25 m/s


@pytest.fixture(scope="module")
def ars548():
    entries = yaml.safe_load(ARS548.read_text())["detections"]
    names = {
        "range": "range",
        "azimuth": "azimuth_angle",
        "elevation": "elevation_angle",
        "range_rate": "range_rate",
        "rcs": "rcs",
    }
    return {q: [float(entry[name]) for entry in entries] for q, name in names.items()}


def test_with_the_cars_speed_a_static_scene_stands_still_and_without_it_moves(ars548):
    scan = convert(ars548, sensor_speed_mps=6.25, moving_above_mps=1.0, rcs_unit="dbsm")
    assert len(scan.still) == 308
    assert np.mean(scan.still) >= 0.95
    assert len(scan.detections.range_m) == 308 - np.count_nonzero(scan.still)
    assert scan.counts["standing_still"] == np.count_nonzero(scan.still)
    assert scan.detections.rcs_m2.max() < 10**3.5
    scan = convert(ars548, sensor_speed_mps=0.0, moving_above_mps=1.0)
    assert np.mean(scan.still) < 0.2


# --- clusters


def group(centre, n, rng, spread=0.3):
    return np.asarray(centre) + rng.normal(0.0, spread, (n, 3))


def test_points_of_one_object_become_one_detection():
    rng = np.random.default_rng(3)
    points = np.concatenate([group([20, 5, 1], 30, rng), group([20, -5, 1], 10, rng), [[50, 0, 0]]])
    order = rng.permutation(len(points))
    x, y, z = points[order].T
    fields = {"x": x, "y": y, "z": z, "rcs": np.arange(41.0), "range_rate": np.full(41, 2.0)}
    scan = convert(
        fields,
        rcs_unit="m2",
        cluster_distance_m=2.0,
        cluster_minimum_points=2,
        attribute_fields=["rcs_raw=rcs"],
    )
    found = scan.detections
    assert scan.counts["small_cluster"] == 1
    assert len(found.range_m) == 2
    place = np.stack(
        [
            found.range_m * np.cos(found.elevation_rad) * np.cos(found.azimuth_rad),
            found.range_m * np.cos(found.elevation_rad) * np.sin(found.azimuth_rad),
            found.range_m * np.sin(found.elevation_rad),
        ],
        axis=1,
    )
    expected = np.array([points[:30].mean(axis=0), points[30:40].mean(axis=0)])
    place = place[np.argsort(-place[:, 1])]
    np.testing.assert_allclose(place, expected, atol=1e-9)
    np.testing.assert_allclose(found.range_rate_mps, 2.0)
    # The echoes of one object add up.
    kept = fields["rcs"][(order < 40) & (fields["rcs"] > 0)]
    assert found.rcs_m2.sum() == pytest.approx(kept.sum())
    assert found.covariance.shape == (2, 4, 4)
    assert (np.linalg.eigvalsh(found.covariance) > 0.0).all()
    assert found.attribute_values.shape == (1, 2)


def test_one_that_approaches_and_one_that_leaves_are_two_objects():
    fields = {"x": [10.0, 10.2], "y": [0.0, 0.0], "range_rate": [3.0, -3.0]}
    assert len(convert(fields, cluster_distance_m=1.0).detections.range_m) == 2
    same = {**fields, "range_rate": [3.0, 3.1]}
    assert len(convert(same, cluster_distance_m=1.0).detections.range_m) == 1


def test_a_cluster_behind_the_radar_lies_behind_it():
    """Azimuths turn over at pi."""
    fields = {"range": [10.0, 10.0], "azimuth": [math.pi - 0.02, -math.pi + 0.02]}
    found = convert(fields, cluster_distance_m=1.0).detections
    assert abs(found.azimuth_rad[0]) == pytest.approx(math.pi)
    assert found.covariance[0, 1, 1] < 0.01


def test_no_points_no_clusters():
    found = convert({"range": [], "azimuth": []}, cluster_distance_m=1.0).detections
    assert found.range_m.shape == (0,)
