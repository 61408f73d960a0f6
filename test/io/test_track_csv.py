from __future__ import annotations

import csv

import message_examples as examples
import numpy as np
import pytest

from gda_tracker.io.track_csv import COLUMNS, TrackCsvWriter, decimal_seconds
from gda_tracker.vocabulary import ScanKey, Tracks


def simple_tracks() -> Tracks:
    """Two tracks with readable numbers."""
    covariance = np.zeros((2, 4, 4))
    covariance[:, 0, 0], covariance[:, 1, 1] = [4.0, 9.0], [0.25, 2.0]
    return Tracks(
        key=ScanKey(1, "radar", 1_620_205_606_919_338_123),
        track_id=np.array([3, 5]),
        hypothesis_id=np.array([30, 50]),
        status=np.array([1, 0]),
        mean=np.array([[1.5, -2.0, 0.1, 1 / 3], [1e-7, 2e9, 0.0, -0.0]]),
        covariance=covariance,
        class_names=("false_alarm", "fighter", "cargo, big"),
        class_probability=np.array([[0.0, 0.75, 0.25], [0.1, 0.2, 0.7]]),
        conflict=np.zeros(2),
        existence_probability=np.array([0.9989486841884, 0.125]),
        signal_strength=np.array([4.5, np.nan]),
        signal_strength_std_db=np.array([1.25, np.nan]),
        detection_probability=np.array([0.5, np.nan]),
        hits=np.array([7, 2]),
        misses=np.array([1, 0]),
        coasted_scans=np.array([1, 0]),
        first_detection_ns=np.array([0, 0]),
        last_detection_ns=np.array([0, 0]),
        detection_index=np.array([-1, 4], dtype=np.int32),
    )


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_columns_are_in_their_order(tmp_path):
    with TrackCsvWriter(tmp_path / "tracks.csv"):
        pass
    assert (tmp_path / "tracks.csv").read_text() == (
        "scan,stamp_s,track_id,status,x_m,y_m,vx_mps,vy_mps,x_std_m,y_std_m,coasted_scans,hits,"
        "misses,detection_index,class,class_probability,existence_probability,semi_axis_m,"
        "other_semi_axis_m,orientation_rad,expected_detections,detections,"
        "signal_strength,signal_strength_std_db,detection_probability\n"
    )


def test_one_row_per_track_and_scan(tmp_path):
    with TrackCsvWriter(tmp_path / "tracks.csv") as writer:
        writer.write(0, Tracks(key=ScanKey(1, "radar", 0)))
        writer.write(1, simple_tracks())
    lines = (tmp_path / "tracks.csv").read_text().splitlines()
    assert lines[1:] == [
        "1,1620205606.919338123,3,confirmed,1.5,-2.0,0.1,0.3333333333333333,2.0,0.5,1,7,1,-1,fighter,0.75,0.9989486841884,,,,,,"
        "4.5,1.25,0.5",
        "1,1620205606.919338123,5,tentative,1e-07,2000000000.0,0.0,-0.0,3.0,1.4142135623730951,0,2,0,4,"
        '"cargo, big",0.7,0.125,,,,,,,,',
    ]


def test_numbers_come_back_exactly(tmp_path):
    tracks = examples.tracks(50)
    tracks.mean = np.random.default_rng(3).standard_normal((50, 4)) * 1e5
    tracks.covariance = np.abs(tracks.covariance)
    with TrackCsvWriter(tmp_path / "tracks.csv") as writer:
        writer.write(9, tracks)
    rows = rows_of(tmp_path / "tracks.csv")
    read = np.array([[float(row[name]) for name in COLUMNS[4:8]] for row in rows])
    assert read.tobytes() == tracks.mean.tobytes()
    assert [int(row["track_id"]) for row in rows] == tracks.track_id.tolist()


def test_without_classes_the_columns_are_empty(tmp_path):
    tracks = simple_tracks()
    tracks.class_names, tracks.class_probability = (), np.zeros((2, 0))
    with TrackCsvWriter(tmp_path / "tracks.csv") as writer:
        writer.write(0, tracks)
    assert [row["class"] + row["class_probability"] for row in rows_of(writer.path)] == ["", ""]


@pytest.mark.parametrize(
    ("stamp", "text"),
    [
        (0, "0.000000000"),
        (1, "0.000000001"),
        (999_999_999, "0.999999999"),
        (10**9, "1.000000000"),
        (2**62, "4611686018.427387904"),
        (-1, "-0.000000001"),
        (-1_500_000_000, "-1.500000000"),
    ],
)
def test_stamps_are_exact(stamp, text):
    assert decimal_seconds(stamp) == text


def test_a_file_that_cannot_be_written(tmp_path):
    with pytest.raises(OSError, match="No such file or directory"):
        TrackCsvWriter(tmp_path / "nowhere" / "tracks.csv")


def test_ellipses_of_extended_objects(tmp_path):
    tracks = simple_tracks()
    tracks.extent = np.array([[[4.0, 0.0], [0.0, 25.0]], [[1.0, 0.0], [0.0, 1.0]]])
    tracks.extent_weight = np.array([7.0, 9.0])
    tracks.expected_detections = np.array([6.5, 0.25])
    tracks.detection_count = np.array([3, 0], dtype=np.int32)
    tracks.detection_rows = np.array([4, 7, 8], dtype=np.int32)
    with TrackCsvWriter(tmp_path / "tracks.csv") as writer:
        writer.write(0, tracks)
    first, second = rows_of(tmp_path / "tracks.csv")
    assert float(first["semi_axis_m"]) == 5.0
    assert float(first["other_semi_axis_m"]) == 2.0
    assert float(first["orientation_rad"]) == pytest.approx(np.pi / 2)
    assert first["expected_detections"] == "6.5"
    assert [first["detections"], second["detections"]] == ["3", "0"]
