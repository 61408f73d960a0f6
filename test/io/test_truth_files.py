"""True positions from elsewhere, at the time of each scan."""

from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.io.adapters import RecordingError, load_recording
from gda_tracker.io.truth_files import read_truth, truth_of_scans
from gda_tracker.resources import resource
from gda_tracker.vocabulary.scans import Detections

BOATS = resource("data", "autoferry", "scenario13")


def scans_at(*seconds):
    return [Detections("r", round(s * 1e9), np.zeros(0), np.zeros(0)) for s in seconds]


def written(tmp_path, text):
    path = tmp_path / "truth.csv"
    path.write_text(text)
    return path


def test_positions_are_interpolated_and_unknown_outside(tmp_path):
    path = written(
        tmp_path,
        "# a log\ntime_s,target_id,x_m,y_m,vx_mps,vy_mps\n"
        "10,7,0,100,1,\n12.5,7,5,90,3,\n30,7,100,0,1,\n11,3,-1,-2,0,0\n",
    )
    found = truth_of_scans([read_truth(path)], scans_at(9.9, 10, 11, 12.5, 20, 30, 31))
    assert found[0].target_id.tolist() == [3, 7]
    states = np.stack([scan.target_state for scan in found])
    # Target 3 is known at one moment; target 7 not before, not after, not in the long gap.
    assert np.isfinite(states[:, 0, 0]).tolist() == [False, False, True, *[False] * 4]
    assert states[2, 0].tolist() == [-1, -2, 0, 0]
    known = np.isfinite(states[:, 1, 0]).tolist()
    assert known == [False, True, True, True, False, True, False]
    assert states[2, 1, :3] == pytest.approx([2.0, 96.0, 1.8])
    assert np.isnan(states[2, 1, 3])
    assert states[1, 1, :2].tolist() == [0, 100]
    assert states[5, 1, :2].tolist() == [100, 0]


def test_times_are_exact_to_the_nanosecond(tmp_path):
    for column, text in (
        ("time_s", "1620205606.919338123"),
        ("time_ms", "1620205606919.338123"),
        ("stamp_ns", "1620205606919338123"),
    ):
        path = written(tmp_path, f"{column},target_id,x_m,y_m\n{text},1,2,3\n")
        assert read_truth(path).stamp_ns.tolist() == [1620205606919338123]


def test_several_files_are_taken_together(tmp_path):
    one = read_truth(written(tmp_path, "time_s,target_id,x_m,y_m\n1,1,1,1\n"))
    two = read_truth(written(tmp_path, "time_s,target_id,x_m,y_m\n2,1,2,2\n1,2,5,5\n"))
    (scan,) = truth_of_scans([one, two], scans_at(1.5)[:1])
    assert scan.target_state[0, :2].tolist() == [1.5, 1.5]
    assert np.isnan(scan.target_state[1]).all()


def test_the_truth_of_a_recording_is_that_of_its_scans():
    recording = load_recording(BOATS)
    found = truth_of_scans([read_truth(BOATS)], recording.detections)
    for mine, theirs in zip(found, recording.truth, strict=True):
        assert mine.target_id.tolist() == sorted(theirs.target_id.tolist())
        order = np.argsort(theirs.target_id)
        assert np.array_equal(mine.target_state, theirs.target_state[order], equal_nan=True)


ERRORS = {
    "time_s,x_m,y_m\n1,2,3\n": "columns target_id: missing",
    "target_id,x_m,y_m\n1,2,3\n": "one of stamp_ns, time_ms, time_s",
    "time_s,target_id,x_m,y_m\n": "no row",
    "time_s,target_id,x_m,y_m\nnoon,1,2,3\n": "row 2: 'noon' is not a time",
    "time_s,target_id,x_m,y_m\n1,1,2,3\n1,boat,2,3\n": "row 3",
    "time_s,target_id,x_m,y_m\n1,1,inf,3\n": "row 2: inf is not finite",
}


@pytest.mark.parametrize("text", ERRORS)
def test_errors_name_file_and_row(text, tmp_path):
    with pytest.raises(RecordingError) as error:
        read_truth(written(tmp_path, text))
    assert str(tmp_path) in str(error.value)
    assert ERRORS[text] in str(error.value)


def test_clocks_that_do_not_agree_are_an_error(tmp_path):
    table = read_truth(written(tmp_path, "time_s,target_id,x_m,y_m\n1,1,2,3\n"))
    with pytest.raises(RecordingError, match="are clocks equal"):
        truth_of_scans([table], scans_at(1000.0, 1001.0))
    with pytest.raises(RecordingError, match="does not exist"):
        read_truth(tmp_path / "none.csv")
