"""What is drawn of sensors that do not give a position: tracks, no detections, no gates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.io.markers import shapes
from gda_tracker.io.markers.parameters import MarkerParameters
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking.gates import gates_of
from gda_tracker.tracking.ring import Ring
from gda_tracker.view.picture import picture_of


@pytest.mark.parametrize(("model", "drawn"), [("bearing", 0), ("tdoa", 0), ("doppler", 1)])
def test_detections_are_drawn_where_they_are_places(model, drawn):
    scenario = load_scenario("two_sensors")
    sensors = tuple(
        replace(sensor, model=model, detection_probability=1.0) for sensor in scenario.sensors
    )
    scenario = replace(scenario, sensors=sensors)
    ring = Ring(tracker_preset(scenario))
    for detections in simulate_network(scenario, 1, 0).detections[:3]:
        result = ring.process(detections)
    scan, tracks = result.scan, result.tracks
    parameters = MarkerParameters()
    assert len(shapes.detections(scan, 0, parameters)) == drawn
    assert len(shapes.associations(scan, tracks, parameters)) == drawn
    assert np.isfinite(shapes.detection_positions(scan)).all() == bool(drawn)
    assert gates_of(scan, result.predictions, None) is None
    picture = picture_of(result, None)
    assert len(picture.sightings.range_m) == drawn
    assert picture.gates is None
