"""Parameters of sensors with a model of their own: what fits together, what each sensor gets."""

from __future__ import annotations

import pytest

from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking.parameters import TrackManagerParameters

TWO = {
    "sensor_ids": ["finder", "pair"],
    "sensor_models": ["bearing", "tdoa"],
    "sensor_clutter_densities": [0.1, 1e-5],
}


def _parameters(**changes) -> TrackManagerParameters:
    return from_mapping(TrackManagerParameters, {**TWO, **changes})


def test_every_sensor_has_its_own_values_and_the_others_those_of_all():
    p = _parameters(sensor_detection_probabilities=[0.5, 0.7], detection_probability=0.8)
    finder, other = p.of_sensor("finder"), p.of_sensor("radar")
    assert finder.detection_probability == 0.5
    assert finder.clutter_density_per_m_rad == 0.1
    assert finder.range_std_m == p.range_std_m
    assert p.of_sensor("pair").detection_probability == 0.7
    assert other is p
    assert [p.model_of(name) for name in ("finder", "pair", "radar")] == ["bearing", "tdoa", ""]


def test_a_sensor_of_range_and_azimuth_may_have_values_of_its_own():
    p = _parameters(sensor_models=["range_azimuth", "tdoa"])
    assert p.model_of("finder") == ""
    assert p.of_sensor("finder").clutter_density_per_m_rad == 0.1


def test_references_stand_one_after_the_other():
    p = _parameters(sensor_references_m=[0, 0, 0, 1, 2, 3])
    assert p.reference_of("pair") == (1.0, 2.0, 3.0)
    assert p.reference_of("radar") is None
    assert _parameters().reference_of("pair") is None


def test_without_sensors_nothing_is_made():
    p = TrackManagerParameters()
    assert p.of_sensor("radar") is p
    assert p.model_of("radar") == ""


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"sensor_ids": ["a", "a"]}, "sensor_ids"),
        ({"sensor_ids": ["a", ""]}, "sensor_ids"),
        ({"sensor_models": ["bearing"]}, "sensor_models"),
        ({"sensor_models": ["bearing", "sonar"]}, "sensor_models"),
        ({"sensor_clutter_densities": []}, "sensor_clutter_densities"),
        ({"sensor_clutter_densities": [0.1]}, "sensor_clutter_densities"),
        ({"sensor_references_m": [1.0, 2.0, 3.0]}, "sensor_references_m"),
        ({"sensor_range_stds_m": [0.0, 1.0]}, "sensor_range_stds_m"),
        (
            {"clutter_density": "estimated", "sensor_clutter_densities": [0.1, 0.0]},
            "clutter_density = 'estimated' and sensor_clutter_densities",
        ),
        ({"gaussian_sum_nearest_m": 60_000.0}, "gaussian_sum_nearest_m"),
    ],
)
def test_what_does_not_fit_is_named(changes, named):
    with pytest.raises(ParameterError, match=named):
        _parameters(**changes)
