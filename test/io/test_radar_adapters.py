"""Recordings of foreign radars: text frames, YAML scans, tables, bags; what is wrong is named."""

from __future__ import annotations

import shutil
import tarfile

import numpy as np
import pytest

from gda_tracker.io.adapters import (
    InputOptions,
    RecordingError,
    continental_yaml,
    csv_file,
    guess_adapter,
    load_recording,
    mmwave,
)
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.io.radar.messages import POINT_CLOUD
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.resources import resource

WALK = resource("data", "mmwave_walk", "SOT.tar.xz")
ARS548 = resource("data", "continental", "ars548_1708578204_202447652_detection.yaml")
SRR520 = resource("data", "continental", "srr520_1708578209_45566935_near_detection.yaml")


def options(topic=None, preset=None, **radar_input):
    return InputOptions(topic, preset, radar_input or None)


# --- text frames of the mmWave radar


@pytest.fixture(scope="module")
def walk_folder(tmp_path_factory):
    """Ten frames of the walk, the archive unpacked."""
    folder = tmp_path_factory.mktemp("walk")
    with tarfile.open(WALK) as archive:
        (folder / "SOT").mkdir()
        for member in [item for item in archive.getmembers() if item.isfile()][:12]:
            (folder / member.name).write_bytes(archive.extractfile(member).read())
    return folder


def test_the_archive_is_read_as_it_stands():
    recording = load_recording(WALK)
    assert "mmwave, guessed from the content" in recording.origin
    assert "MIT" in recording.origin
    assert len(recording.detections) == 139
    stamps = np.array([scan.stamp_ns for scan in recording.detections])
    assert (np.diff(stamps) >= 50_000_000).all()
    assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(7.72)
    assert any(line.startswith("92 scans were sent again") for line in recording.warnings)
    assert recording.preset_name == "mmwave_walk"
    assert "radar_input" not in recording.preset


def test_the_unpacked_folder_is_the_same(walk_folder):
    assert guess_adapter(walk_folder) == "mmwave"
    everything = options(moving_above_mps=0.0, cluster_distance_m=0.0)
    found = load_recording(walk_folder, options=everything).detections
    again = load_recording(walk_folder / "SOT", "mmwave", everything).detections
    whole = load_recording(WALK, "mmwave", everything).detections
    assert len(found) == len(again) > 3
    for one, two, three in zip(found, again, whole, strict=False):
        assert one.stamp_ns == two.stamp_ns == three.stamp_ns
        np.testing.assert_array_equal(one.range_m, three.range_m)
    # x to the right is a negative azimuth.
    raw = np.loadtxt(walk_folder / "SOT" / "8600.txt")
    np.testing.assert_allclose(found[0].azimuth_rad, -raw[:, 4])
    np.testing.assert_allclose(found[0].range_rate_mps, raw[:, 6], atol=1e-12)


def test_frames_that_are_none_are_named(tmp_path):
    (tmp_path / "1.txt").write_text("1 2 3\n")
    with pytest.raises(RecordingError, match=r"1\.txt: expected rows of 10 numbers"):
        load_recording(tmp_path, "mmwave")
    (tmp_path / "1.txt").write_text("a b\n")
    with pytest.raises(RecordingError, match=r"1\.txt: not rows of numbers"):
        load_recording(tmp_path, "mmwave")
    row = " ".join(["1"] * 9)
    (tmp_path / "1.txt").write_text(f"{row} 5\n{row} 6\n")
    with pytest.raises(RecordingError, match="column 10 is not one time"):
        load_recording(tmp_path, "mmwave")
    assert not mmwave.recognises(tmp_path / "nowhere")
    broken = tmp_path / "broken.tar.xz"
    broken.write_bytes(WALK.read_bytes()[:1000])
    assert not mmwave.recognises(broken)
    whole = bytearray(WALK.read_bytes())
    whole[1000:1100] = bytes(100)
    spoilt = tmp_path / "spoilt.tar.xz"
    spoilt.write_bytes(whole)
    assert not mmwave.recognises(spoilt)
    with pytest.raises(RecordingError, match="not a .tar.xz archive"):
        load_recording(broken, "mmwave")


# --- scans of Continental radars as YAML


def test_the_ars548_scan_and_the_speed_of_the_car():
    recording = load_recording(ARS548, options=options(sensor_speed_mps=6.25))
    assert recording.preset_name == "continental_ars548"
    (scan,) = recording.detections
    assert scan.stamp_ns == 1708578204_202447652
    assert len(scan.range_m) == 0
    assert "standing still: 99.7% of the points" in recording.notes
    assert not recording.warnings


def test_who_forgets_the_speed_of_the_car_is_told():
    (warning,) = load_recording(ARS548).warnings
    assert "the radar moves: with sensor_speed_mps 6.18" in warning
    assert "98% of the points would stand still" in warning
    assert not load_recording(ARS548, options=options(sensor_motion="estimated")).warnings


def test_the_srr520_scan_keeps_its_radar_cross_sections():
    every = options(moving_above_mps=0.0, cluster_distance_m=0.0)
    (scan,) = load_recording(SRR520, options=every).detections
    assert len(scan.range_m) == 194
    assert 10 * np.log10(scan.rcs_m2[0]) == pytest.approx(-25.7143)
    assert scan.rcs_valid.all()


def test_a_folder_of_scans_goes_by_stamp_and_holds_one_radar(tmp_path):
    later = tmp_path / "a.yaml"
    later.write_text(SRR520.read_text().replace("nanosec: 45566935", "nanosec: 145566935"))
    shutil.copy(SRR520, tmp_path / "b.yaml")
    assert guess_adapter(tmp_path) == "continental_yaml"
    stamps = [scan.stamp_ns for scan in load_recording(tmp_path).detections]
    assert np.diff(stamps).tolist() == [100_000_000]
    shutil.copy(ARS548, tmp_path / "c.yaml")
    with pytest.raises(RecordingError, match="different radars: continental ars548 scan, cont"):
        load_recording(tmp_path)


def test_values_that_the_sensor_calls_invalid_are_left_out(tmp_path):
    path = tmp_path / "scan.yaml"
    path.write_text(
        ARS548.read_text().replace("invalid_azimuth: false", "invalid_azimuth: true", 3)
    )
    every = options(moving_above_mps=0.0, cluster_distance_m=0.0)
    recording = load_recording(path, options=every)
    assert len(recording.detections[0].range_m) == 305
    assert any("3 not_finite" in note for note in recording.notes)


def test_yaml_that_is_no_scan_is_named(tmp_path):
    path = tmp_path / "scan.yaml"
    for text, message in (
        ("header: {}\nobjects: []\n", "the sensor's own objects"),
        ("header: {}\ndetections: []\n", "not a scan with header and detections"),
        ("header: [\n", "not YAML"),
        ("- 1\n", "not a scan"),
    ):
        path.write_text(text)
        with pytest.raises(RecordingError, match=message):
            load_recording(path, "continental_yaml")
    assert not continental_yaml.recognises(tmp_path)
    with pytest.raises(RecordingError, match="no YAML file with detections"):
        load_recording(tmp_path, "continental_yaml")


# --- tables of text


def table(tmp_path, text, name="plots.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_table_with_units_in_the_names(tmp_path):
    path = table(
        tmp_path,
        "# plots of the day\n"
        "time_s, range_nmi, azimuth_deg, range_rate_kn, rcs_m2, length_m\n"
        "100.5, 10, 90, 36, 2.0, 12\n"
        "100.5, 20, -45, , 0, \n"
        "104.5, , , , , \n"
        "108.5, 1, 0, 0, 4.0, 7\n",
    )
    assert guess_adapter(path) == "csv"
    every = options(attribute_fields=["length_m=length_m"], range_rate_used=False)
    recording = load_recording(path, options=every)
    first, second, third = recording.detections
    assert [scan.stamp_ns for scan in recording.detections] == [
        100_500_000_000,
        104_500_000_000,
        108_500_000_000,
    ]
    assert first.range_m.tolist() == [18520.0, 37040.0]
    np.testing.assert_allclose(first.azimuth_rad, np.deg2rad([90, -45]))
    np.testing.assert_allclose(first.rcs_m2, [2.0, 0.0])
    assert first.rcs_valid.tolist() == [True, False]
    assert first.attribute_names == ("length_m",)
    assert len(second.range_m) == 0
    assert third.range_m.tolist() == [1852.0]
    # With the range rate, a detection without one is left out.
    rated = load_recording(path).detections[0]
    np.testing.assert_allclose(rated.range_rate_mps, [36 * 1852 / 3600])


def test_a_table_of_an_air_traffic_control_radar(tmp_path):
    """Clockwise from North, and closer than a kilometre is clutter."""
    path = table(tmp_path, "time_s,range_nmi,azimuth_deg\n5,10,0\n5,10,90\n5,0.3,10\n")
    (scan,) = load_recording(path, options=options(preset="asterix_cat048")).detections
    np.testing.assert_allclose(scan.azimuth_rad, [np.pi / 2, 0.0], atol=1e-12)


def test_cartesian_tables_and_whole_nanoseconds(tmp_path):
    stamp = 1708578204_202447653
    path = table(tmp_path, f"stamp_ns,x_m,y_m,rcs_dbsm\n{stamp},3,4,10\n")
    (scan,) = load_recording(path).detections
    assert scan.stamp_ns == stamp
    assert scan.range_m.tolist() == [5.0]
    np.testing.assert_allclose(scan.rcs_m2, [10.0])
    exact = table(tmp_path, "time_s,x_m,y_m\n1708578204.202447653,3,4\n")
    assert load_recording(exact).detections[0].stamp_ns == stamp
    rough = table(tmp_path, "time_ms,x_m,y_m\n1.5e3,3,4\n")
    assert load_recording(rough).detections[0].stamp_ns == 1_500_000_000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("range_m,azimuth_deg\n1,2\n", "needed is one of time_s, time_ms, stamp_ns"),
        ("time_s,stamp_ns,x_m,y_m\n", "needed is one of time_s"),
        ("time_s,range_m\n1,2\n", "needed are range_m"),
        ("time_s,range_m,range_km,azimuth_deg\n", "columns for range: allowed is one"),
        ("time_s,x_m,y_m\n1,2\n", "line 2: 2 cells, 3 expected"),
        ("time_s,x_m,y_m\n1,2,far\n", "line 2: y_m = 'far': allowed is a number"),
        ("time_s,x_m,y_m\n-1,2,3\n", "line 2: time_s = '-1': allowed is a number >= 0"),
        ("time_s,x_m,y_m\nnan,2,3\n", "line 2: time_s = 'nan'"),
        ("time_s,x_m,y_m\n", "no scan could be read"),
        ("", "needed is one of time_s"),
    ],
)
def test_a_table_that_is_none_is_named(tmp_path, text, message):
    with pytest.raises(RecordingError, match=message):
        load_recording(table(tmp_path, text), "csv")
    assert not csv_file.recognises(tmp_path)


# --- bags


def write(path, topics, notes=None):
    """Write a bag of point clouds: {topic: [(stamp, columns)]}."""
    with BagWriter(path, [BagTopic(name, POINT_CLOUD) for name in topics], notes) as bag:
        for name, clouds in topics.items():
            for stamp_ns, columns in clouds:
                types = dict.fromkeys(columns, "float32")
                message = point_cloud_of_columns(columns, types, stamp_ns, "r")
                bag.write(name, message, 10**9 + stamp_ns)
    return path


def ti(*stamps, **more):
    columns = {
        name: np.array([3.0, 4.0]) for name in ("x", "y", "z", "intensity", "range", "doppler")
    }
    return [(stamp, {**columns, **more}) for stamp in stamps]


def test_of_several_radars_one_is_chosen(tmp_path):
    path = write(tmp_path / "bag", {"/left": ti(1, 2), "/right": ti(1, 2, 3)})
    with pytest.raises(RecordingError, match="several topics of radars.*--topic: /left, /right"):
        load_recording(path)
    assert len(load_recording(path, options=options("right")).detections) == 3
    with pytest.raises(RecordingError, match="topic /up: allowed is one of /left, /right"):
        load_recording(path, options=options("/up"))
    with pytest.raises(RecordingError, match="--topic /left: allowed with bags and ASTERIX only"):
        load_recording(ARS548, options=options("/left"))


def test_the_preset_of_a_bag_is_guessed_named_or_noted(tmp_path):
    path = write(tmp_path / "bag", {"/radar": ti(5)})
    recording = load_recording(path)
    assert recording.preset_name == "ti_mmwave (guessed from the fields)"
    assert recording.preset["track_manager"]["attribute_term"] == "none"
    assert recording.notes[0] == f"topic /radar ({POINT_CLOUD})"
    with pytest.raises(RecordingError, match="range_rate=radar_relative_radial_velocity, but the"):
        load_recording(path, options=options(preset="provizio"))
    noted = write(tmp_path / "noted", {"/radar": ti(5)}, {"preset": "carla"})
    assert load_recording(noted).preset_name == "carla"
    with pytest.raises(RecordingError, match="preset 'x': allowed is one of altos"):
        load_recording(path, options=options(preset="x"))
    with pytest.raises(RecordingError, match="parameter azimuth_sign = 0"):
        load_recording(path, options=options(azimuth_sign=0))


def test_fields_that_no_preset_fits_have_to_be_declared(tmp_path):
    columns = {name: np.arange(1.0, 4.0) for name in ("u", "v", "w")}
    path = write(tmp_path / "bag", {"/cloud": [(5, columns)]})
    with pytest.raises(RecordingError, match="no preset fits the fields u, v, w; name one with"):
        load_recording(path)
    found = load_recording(path, options=options(field_names=["x=u", "y=v"]))
    np.testing.assert_allclose(found.detections[0].range_m, np.hypot([1, 2, 3], [1, 2, 3]))
    with pytest.raises(RecordingError, match="no scan could be read; frame 1.*no position"):
        load_recording(path, options=options(preset="none"))


def test_stamps_of_the_recording_where_the_driver_leaves_them_empty(tmp_path):
    columns = ti(0)[0][1]
    path = tmp_path / "bag"
    with BagWriter(path, [BagTopic("/radar", POINT_CLOUD)]) as bag:
        for received in (7, 8, 9):
            types = dict.fromkeys(columns, "float32")
            bag.write("/radar", point_cloud_of_columns(columns, types, 0, "r"), received)
    assert len(load_recording(path).detections) == 1
    recording = load_recording(path, options=options(stamp_source="received"))
    assert [scan.stamp_ns for scan in recording.detections] == [7, 8, 9]
    assert "stamped with the time of recording" in recording.notes


def test_clouds_that_contradict_themselves_are_left_out_and_named(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path, [BagTopic("/radar", POINT_CLOUD)]) as bag:
        for stamp_ns, columns in ti(1, 2, 3):
            message = point_cloud_of_columns(
                columns, dict.fromkeys(columns, "float32"), stamp_ns, ""
            )
            if stamp_ns == 2:
                message.data = message.data[:-4]
            bag.write("/radar", message, stamp_ns)
    recording = load_recording(path)
    assert [scan.stamp_ns for scan in recording.detections] == [1, 3]
    (warning,) = recording.warnings
    assert warning.startswith("frame 2 is left out: data has 44 bytes, 48 are needed")


def test_of_many_bad_messages_a_few_are_named(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path, [BagTopic("/radar", POINT_CLOUD)]) as bag:
        for stamp_ns, columns in ti(*range(1, 10)):
            types = dict.fromkeys(columns, "float32")
            message = point_cloud_of_columns(columns, types, stamp_ns, "")
            if stamp_ns < 9:
                message.header.stamp.sec = -1
            bag.write("/radar", message, stamp_ns)
    recording = load_recording(path)
    assert [scan.stamp_ns for scan in recording.detections] == [9]
    assert len(recording.warnings) == 6
    assert "message 0 on /radar is left out: header.stamp = -1 s" in recording.warnings[0]
    assert recording.warnings[-1] == "3 more messages on /radar are left out"


def test_radar_cross_sections_that_cannot_be_are_reported(tmp_path):
    n = 12
    columns = {name: np.linspace(1.0, 2.0, n) for name in ("x", "y", "z", "h", "v")}
    same = write(tmp_path / "same", {"/altos": [(5, {**columns, "s": np.full(n, 7.0)})]})
    assert any("the same for every point" in line for line in load_recording(same).warnings)
    negative = {**columns, "s": np.linspace(-2.0, 9.0, n)}
    odd = write(tmp_path / "odd", {"/altos": [(5, negative)]})
    assert any("3 values cannot be one" in line for line in load_recording(odd).warnings)
    none = write(tmp_path / "none", {"/altos": [(5, {**columns, "s": negative["s"]})]})
    warnings = load_recording(none, options=options(field_names=["range_rate=h"])).warnings
    assert any("rcs_unit is m2, but there is no such field" in line for line in warnings)
