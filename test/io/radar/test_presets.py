"""Presets of radars: guessed by the fields of the driver, and by nothing else."""

import numpy as np
import pytest

from gda_tracker.io.parameter_files import RADAR_INPUT, read_preset
from gda_tracker.io.radar.frames import RadarFrame, detections_of_frame, frame_of_columns
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.messages import POINT_CLOUD, RADAR_SCAN, RADAR_TRACKS
from gda_tracker.io.radar.presets import SIGNATURES, best_preset, fits, presets_of
from gda_tracker.parameters import from_mapping
from gda_tracker.tracking.ring import stage_parameters


def frame(kind, types, values=None):
    rng = np.random.default_rng(1)

    def read(names, overrides):
        return {name: (values or {}).get(name, rng.uniform(1.0, 9.0, 20)) for name in names}

    return RadarFrame(kind, 5, "radar", types, read)


@pytest.mark.parametrize("signature", SIGNATURES, ids=lambda signature: signature.preset)
def test_each_driver_is_told_by_its_fields(signature):
    zeros = {signature.zero: np.zeros(20)} if signature.zero else {}
    one = frame(signature.kind, signature.types, zeros)
    assert best_preset([one]) == signature.preset
    reordered = frame(signature.kind, dict(reversed(signature.types.items())), zeros)
    assert best_preset([reordered]) == signature.preset


@pytest.mark.parametrize("signature", SIGNATURES, ids=lambda signature: signature.preset)
def test_the_preset_makes_detections_of_the_drivers_fields(signature):
    preset = read_preset(signature.preset)
    values = {**preset.pop(RADAR_INPUT), "moving_above_mps": 0.0, "cluster_distance_m": 0.0}
    parameters = from_mapping(RadarInputParameters, values)
    found = detections_of_frame(frame(signature.kind, signature.types), parameters).detections
    assert len(found.range_m) == 20
    assert np.isfinite(found.azimuth_rad).all()
    assert (found.rcs_m2 is not None) == (parameters.rcs_unit != "none")
    assert found.range_rate_mps is not None
    # A preset without a radar cross section decides by kinematics alone.
    manager = stage_parameters(preset)["track_manager"]
    assert (manager.attribute_term == "none") == (parameters.rcs_unit == "none")


def test_drivers_differ_in_small_things():
    types = dict.fromkeys(("x", "y", "z", "intensity", "range", "doppler"), "float32")
    assert best_preset([frame(POINT_CLOUD, types)]) == "ti_mmwave"
    # One more field, one less, another type: still told, and the reason says what differs.
    more = {**types, "snr": "float32"}
    (first, *_) = fits([frame(POINT_CLOUD, {**more, "doppler": "float64"})])
    assert first.preset == "ti_mmwave"
    assert "doppler is float64, not float32" in first.reason
    without = {name: kind for name, kind in types.items() if name != "z"}
    assert best_preset([frame(POINT_CLOUD, without)]) == "ti_mmwave"


def test_a_lidar_is_no_radar():
    for names in ("x y z", "x y z intensity", "x y z intensity ring time"):
        types = dict.fromkeys(names.split(), "float32")
        assert best_preset([frame(POINT_CLOUD, types)]) is None
        assert all(fit.share == 0.0 and fit.reason for fit in fits([frame(POINT_CLOUD, types)]))


def test_an_amplitude_that_is_always_zero_tells_the_ars408():
    names = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
    columns = {name: np.arange(1.0, 4.0) for name in names}
    assert best_preset([frame_of_columns(RADAR_SCAN, 0, "", columns)]) == "radar_scan"
    silent = {**columns, "amplitude": np.zeros(3)}
    assert best_preset([frame_of_columns(RADAR_SCAN, 0, "", silent)]) == "continental_ars408"
    both = [frame_of_columns(RADAR_SCAN, 0, "", part) for part in (silent, columns)]
    assert best_preset(both) == "radar_scan"
    # Without a single return nobody knows.
    empty = {name: np.zeros(0) for name in names}
    assert best_preset([frame_of_columns(RADAR_SCAN, 0, "", empty)]) == "radar_scan"


def test_presets_by_kind():
    assert presets_of(RADAR_TRACKS) == ["radar_tracks"]
    assert presets_of(RADAR_SCAN) == ["continental_ars408", "radar_scan"]
    assert presets_of("csv") == []
    assert best_preset([]) is None
