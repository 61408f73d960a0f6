"""Files of ASTERIX as recordings: replayed, inspected, the radar chosen, losses named."""

import math

import numpy as np
import pytest
from asterix_examples import block, pcap, plot, traffic, udp_packet

from gda_tracker import cli
from gda_tracker.io.adapters import InputOptions, RecordingError, guess_adapter, load_recording
from gda_tracker.tracking.ring import Ring

DAY_S = 20_000 * 86_400


def flight(time_s):
    """A standard turn of 3 degrees a second, and a straight flight."""
    turned = math.radians(3.0) * (time_s - 1000.0)
    radius = 120.0 / math.radians(3.0)
    circle = (30e3 + radius * math.sin(turned), 30e3 + radius * math.cos(turned))
    return [circle, (-20e3 + 100.0 * (time_s - 1000.0), -15e3)]


@pytest.fixture(scope="module")
def sent():
    return traffic(flight, 25)


@pytest.fixture
def capture(tmp_path, sent):
    path = tmp_path / "radar.pcap"
    path.write_bytes(pcap([(DAY_S + time_s, udp_packet(payload)) for time_s, payload in sent]))
    return path


@pytest.fixture
def raw(tmp_path, sent):
    path = tmp_path / "radar.ast"
    path.write_bytes(b"".join(payload for _, payload in sent))
    return path


def test_a_capture_and_a_raw_file_are_the_same_but_for_the_day(capture, raw):
    one, other = load_recording(capture), load_recording(raw)
    assert guess_adapter(capture) == guess_adapter(raw) == "asterix"
    assert one.preset_name == other.preset_name == "asterix_cat048"
    assert one.notes[0] == "radar 25/201 (SAC/SIC), 50 plots"
    assert one.warnings == other.warnings == []
    dated = load_recording(raw, options=InputOptions(radar_input={"asterix_date": "2024-10-04"}))
    for a, b, c in zip(one.detections, other.detections, dated.detections, strict=True):
        assert a.stamp_ns == b.stamp_ns + DAY_S * 10**9 == c.stamp_ns
        assert a.sensor_id == "sac25_sic201"
        for name in ("range_m", "azimuth_rad", "time_offset_s", "attribute_values"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_detections_are_where_the_aircraft_were(raw):
    recording = load_recording(raw)
    assert [len(scan.range_m) for scan in recording.detections] == [2] * 25
    for scan in recording.detections:
        for row in range(2):
            number = int(scan.attribute_values[scan.attribute_names.index("mode_3a"), row]) - 0o1000
            x, y = flight(scan.stamp_ns * 1e-9 + scan.time_offset_s[row])[number]
            along = scan.range_m[row] * np.array(
                [np.cos(scan.azimuth_rad[row]), np.sin(scan.azimuth_rad[row])]
            )
            # East is x: the azimuth is counter-clockwise from there.
            assert np.hypot(*(along - (x, y))) < 8.0
        # What a radar does not send is unknown.
        place = scan.attribute_names.index("psr_amplitude_dbm")
        assert not scan.attribute_valid[place].any()
        assert scan.attribute_valid[scan.attribute_names.index("flight_level")].all()


def test_the_tracker_follows_both(raw):
    recording = load_recording(raw)
    ring = Ring(recording.preset)
    ids = set()
    for detections in recording.detections:
        for result in ring.feed(detections):
            assert result.report.outcome == "tracked"
            assert not result.report.rejected
            tracks = result.tracks
            ids |= set(tracks.track_id[tracks.status == 1].tolist())
            if result.report.key.stamp_ns < 1040 * 10**9:
                continue
            for x, y in flight(tracks.key.stamp_ns * 1e-9):
                assert np.hypot(tracks.mean[:, 0] - x, tracks.mean[:, 1] - y).min() < 150.0
    assert len(ids) == 2


def test_several_radars(tmp_path, sent, capsys):
    other = [(time_s, block(48, plot(time_s, 30.0, 5.0, source=(9, 1)))) for time_s in (1003, 1007)]
    mixed = sorted([*sent, *other], key=lambda event: event[0])
    path = tmp_path / "two.pcap"
    path.write_bytes(pcap([(time_s, udp_packet(payload)) for time_s, payload in mixed]))
    with pytest.raises(RecordingError, match=r"several radars; choose with --topic: 25/201, 9/1"):
        load_recording(path)
    assert len(load_recording(path, options=InputOptions("9/1")).detections) == 2
    chosen = InputOptions(radar_input={"asterix_source": "25/201"})
    assert len(load_recording(path, options=chosen).detections) == 25
    with pytest.raises(RecordingError, match=r"radar 9/2: allowed is one of 25/201, 9/1"):
        load_recording(path, options=InputOptions("9/2"))
    with pytest.raises(RecordingError, match="allowed is SAC/SIC"):
        load_recording(path, options=InputOptions("radar"))
    assert cli.main(["inspect", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"{path} 25/201: asterix cat 048" in said
    assert f"{path} 9/1: asterix cat 048" in said
    assert cli.main(["inspect", str(path), "--topic", "9/1"]) == 0
    said = capsys.readouterr().out
    assert f"gda-tracker replay {path} --topic 9/1 --preset asterix_cat048" in said


def test_what_was_left_out_is_said(tmp_path, sent):
    path = tmp_path / "bad.pcap"
    packets = [(time_s, udp_packet(payload)) for time_s, payload in sent]
    packets.insert(9, (packets[9][0], udp_packet(b"\x30\x00\x01")))
    packets.insert(19, (packets[19][0], packets[19][1][:-2]))
    packets.insert(29, (packets[29][0], udp_packet(block(62, b"\x80\x01\x02"))))
    path.write_bytes(pcap(packets))
    recording = load_recording(path)
    assert recording.warnings == [
        "left out of the file: 1 malformed_datablock, 1 other_category, 1 truncated_packet"
    ]
    assert [len(scan.range_m) for scan in recording.detections] == [2] * 25


def test_files_without_a_plot(tmp_path):
    path = tmp_path / "none.pcap"
    path.write_bytes(pcap([(1.0, udp_packet(block(62, b"\x80\x01\x02")))]))
    with pytest.raises(
        RecordingError,
        match="no target report of ASTERIX category 048; left out: 1 other_category",
    ):
        load_recording(path)


def test_replay_from_the_command_line(raw, capsys):
    assert cli.main(["replay", str(raw), "--offline", "--method", "map/none/cv"]) == 0
    said = capsys.readouterr().out
    assert "radar 25/201 (SAC/SIC), 50 plots" in said
    assert "scans: 25 tracked" in said
    assert "confirmed tracks: 2" in said
