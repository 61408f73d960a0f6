from __future__ import annotations

import numpy as np
import pytest
from recording_examples import npz, npz_arrays

from gda_tracker.io.adapters import RecordingError, load_recording
from gda_tracker.io.parameter_files import read_preset


def test_scan_npz_is_turned_to_rep_103(tmp_path):
    recording = load_recording(npz(tmp_path), "scan_npz")
    assert [len(scan.range_m) for scan in recording.detections] == [2, 0, 3]
    assert [scan.stamp_ns for scan in recording.detections] == [0, 5 * 10**9, 10**10]
    first, _, last = recording.detections
    np.testing.assert_allclose(first.azimuth_rad, [np.pi / 2, 0.0], atol=1e-15)
    np.testing.assert_allclose(last.azimuth_rad, [-np.pi / 2, np.pi, 3.0 - 1.5 * np.pi], atol=1e-15)
    azimuth = npz_arrays()["azimuth"][2:]
    np.testing.assert_allclose(np.cos(last.azimuth_rad), np.sin(azimuth), atol=1e-15)
    np.testing.assert_allclose(np.sin(last.azimuth_rad), np.cos(azimuth), atol=1e-15)
    assert last.rcs_m2.tolist() == [0.3, 4.0, 5.0]
    assert last.range_std_m.tolist() == [60.0]
    assert last.azimuth_std_rad.tolist() == [0.005]
    assert last.sensor_position_m.tolist() == [0.0, 0.0, 0.0]


def test_scan_npz_azimuth_stays_in_half_open_circle(tmp_path):
    angles = np.linspace(-np.pi, np.pi, 10_001)[1:]
    path = npz(
        tmp_path,
        times=np.array([0.0]),
        scan_ptr=np.array([0, len(angles)]),
        azimuth=angles,
        range=np.ones(len(angles)),
        rcs=None,
        truth_id=None,
        truth_state=None,
        truth_type=None,
    )
    recording = load_recording(path, "scan_npz")
    azimuth = recording.detections[0].azimuth_rad
    assert azimuth.min() > -np.pi
    assert azimuth.max() <= np.pi
    assert recording.truth is None
    assert recording.detections[0].rcs_m2 is None


def test_scan_npz_truth(tmp_path):
    recording = load_recording(npz(tmp_path), "scan_npz")
    assert [truth.source_id.tolist() for truth in recording.truth] == [[0, 1], [], [-1, 1, 0]]
    truth = recording.truth[1]
    assert truth.target_id.tolist() == [0, 1]
    assert truth.target_class == ("fighter", "cargo")
    # x, vx, y, vy in the file
    assert truth.target_state[0].tolist() == [8.0, 10.0, 9.0, 11.0]


def test_scan_npz_preset_takes_the_data_sheet(tmp_path):
    told = load_recording(npz(tmp_path), "scan_npz").preset["track_manager"]
    assert told["detection_probability"] == 0.97
    assert told["clutter_density_per_m_rad"] == 2e-5
    silent = load_recording(npz(tmp_path, meta=None), "scan_npz")
    assert silent.preset == read_preset("scan_npz")
    assert silent.detections[0].range_std_m is None


BAD_ARRAYS = {
    "array range (D,) is missing": {"range": None},
    "array scan_ptr (K + 1,) is missing": {"scan_ptr": None},
    "array scan_ptr does not rise from 0 to 5": {"scan_ptr": np.array([0, 3, 2, 5])},
    "array times is not 3 numbers": {"times": np.array([0.0, 1.0])},
    "array azimuth has the shape (4,), not (5,)": {"azimuth": np.zeros(4)},
    "array azimuth holds <U1, not numbers": {"azimuth": np.array(["a"] * 5)},
    "array rcs has the shape (5, 1)": {"rcs": np.zeros((5, 1))},
    "array truth_state has the shape (2, 2, 4), not (3, N, 4)": {
        "truth_state": np.zeros((2, 2, 4))
    },
    "array truth_id is not one of -1 to 1": {"truth_id": np.array([0, 1, -1, 1, 2])},
    "array truth_type is not one of 0, 1": {"truth_type": np.array([0, 2])},
    "array truth_type (N,) is missing": {"truth_type": None},
    "meta is not JSON": {"meta": np.array("{")},
    "meta is not an object": {"meta": np.array("[]")},
    "meta: sigma_range = -1: allowed is a number > 0": {"meta": np.array('{"sigma_range": -1}')},
    "meta: node track_manager: parameter detection_probability = 2": {
        "meta": np.array('{"p_detect": 2}')
    },
}


@pytest.mark.parametrize("text", BAD_ARRAYS)
def test_scan_npz_errors_name_file_and_array(tmp_path, text):
    path = npz(tmp_path, **BAD_ARRAYS[text])
    with pytest.raises(RecordingError) as caught:
        load_recording(path, "scan_npz")
    assert str(caught.value).startswith(f"{path}: ")
    assert text in str(caught.value)


def test_scan_npz_files_that_are_none(tmp_path):
    path = npz(tmp_path)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(path.read_bytes()[:500])
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, **npz_arrays(meta=np.array([{}], dtype=object)))
    single = tmp_path / "single.npz"
    with single.open("wb") as file:
        np.save(file, np.zeros(3))
    text = tmp_path / "text.npz"
    text.write_text("nothing")
    for bad in (cut, pickled, single, text, tmp_path):
        with pytest.raises(RecordingError) as caught:
            load_recording(bad, "scan_npz")
        assert str(bad) in str(caught.value)
        assert "\n" not in str(caught.value)
