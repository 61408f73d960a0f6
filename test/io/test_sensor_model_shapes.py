"""What is drawn of sensors that do not give a position: tracks, curves, no gates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.io.markers import shapes
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.kinematics.measurement_models import measure, observed
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking.gates import gates_of
from gda_tracker.tracking.ring import Ring
from gda_tracker.view.encoding import past_json, scan_json
from gda_tracker.view.history import History
from gda_tracker.view.matrix import matrix_json
from gda_tracker.view.picture import picture_of


def third_result(model):
    scenario = load_scenario("two_sensors")
    sensors = tuple(
        replace(sensor, model=model, detection_probability=1.0) for sensor in scenario.sensors
    )
    scenario = replace(scenario, sensors=sensors)
    ring = Ring(tracker_preset(scenario))
    results = [ring.process(d) for d in simulate_network(scenario, 1, 0).detections[:3]]
    return results[-1]


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        ("bearing", shapes.LINE_LIST),
        ("range", shapes.LINE_LIST),
        ("bistatic", shapes.LINE_LIST),
        ("tdoa", shapes.LINE_LIST),
        ("doppler", shapes.SPHERE_LIST),
        ("fdoa", None),
    ],
)
def test_detections_are_drawn_as_places_or_as_curves(model, kind):
    result = third_result(model)
    scan, tracks = result.scan, result.tracks
    parameters = MarkerParameters(curve_farthest_m=9000.0)
    drawn = shapes.detections(scan, 0, parameters)
    assert [shape.kind for shape in drawn] == [kind] * (kind is not None)
    located = kind == shapes.SPHERE_LIST
    assert len(shapes.associations(scan, tracks, parameters)) == located
    assert np.isfinite(shapes.detection_positions(scan)).all() == located
    assert gates_of(scan, result.predictions, None) is None
    picture = picture_of(result, None)
    assert len(picture.sightings.range_m) == len(scan) == 1
    assert len(picture.sightings.curves) == (kind == shapes.LINE_LIST)
    assert picture.gates is None
    history = History()
    history.add(picture)
    drawn_on_page = scan_json(history, 1, picture)["detections"]
    assert len(drawn_on_page["x"]) == len(drawn_on_page["row"]) == located
    assert len(past_json(1, picture)["x"]) == located
    # The association matrix has the detections all the same.
    assert (matrix_json(picture, None) is None) == (not len(result.associations.hypothesis))
    lines = drawn_on_page["curves"]
    assert np.shape(lines)[2:] == ((2,) if len(lines) else ())
    if kind == shapes.LINE_LIST:
        # From every point that is drawn the sensor would have measured what it has.
        seen = observed(scan)
        of_curve = replace(MEASUREMENT_MODELS[model], quantities=seen.model.quantities[:1])
        for points in (drawn[0].points, picture.sightings.curves[0]):
            state = np.concatenate([points, np.zeros_like(points)], axis=1)
            found = measure(of_curve, seen.sites, state)[:, 0]
            assert found == pytest.approx(np.full(len(points), seen.value[0, 0]), abs=1e-6)
        reach = np.hypot(*(drawn[0].points - seen.sites.position_m.mean(axis=0)).T).max()
        if model in ("bearing", "tdoa"):
            assert reach == pytest.approx(9000.0, rel=0.6)


def test_a_curve_that_is_not_a_number_is_not_drawn():
    scan = third_result("bearing").scan
    scan = replace(scan, azimuth_rad=np.full(len(scan), np.nan))
    assert shapes.detections(scan, 0, MarkerParameters()) == []
