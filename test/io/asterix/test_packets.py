"""Captures and raw files: datagrams out of packets, the others counted by reason."""

import struct
from collections import Counter
from pathlib import Path

import pytest
from asterix_examples import PCAP_HEAD, block, north, pcap, plot, udp_packet
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.io.adapters import asterix
from gda_tracker.io.asterix.packets import CaptureError, is_raw, read_datagrams

ONE = block(48, plot(1.0, 10.0, 20.0))
TWO = north(2.0)


def read(path):
    counts = Counter()
    return list(read_datagrams(path, counts)), dict(counts)


def written(tmp_path, content, name="capture"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def test_a_capture(tmp_path):
    path = written(tmp_path, pcap([(1000.25, udp_packet(ONE)), (1001.5, udp_packet(ONE + TWO))]))
    found, counts = read(path)
    assert found == [(ONE, 1_000_250_000_000), (ONE + TWO, 1_001_500_000_000)]
    assert counts == {}


def test_other_packets_are_counted(tmp_path):
    arp = bytes.fromhex("ffffffffffff" + "020000000001" + "0806") + bytes(28)
    packets = [
        udp_packet(ONE),
        arp,
        udp_packet(ONE, protocol=6),  # TCP
        udp_packet(ONE, fragment=0x2000),  # more fragments follow
        udp_packet(ONE, fragment=5),
        udp_packet(ONE)[:-4],
        udp_packet(ONE)[:30],
        udp_packet(ONE)[:10],
        udp_packet(TWO),
    ]
    found, counts = read(written(tmp_path, pcap([(1.0, packet) for packet in packets])))
    assert [datagram.payload for datagram in found] == [ONE, TWO]
    assert counts.pop("ip_fragment") == 2
    assert counts.pop("not_udp") == 2
    assert counts == {"truncated_packet": 2, "malformed_packet": 1}


def big_endian(packets):
    head = struct.pack(">IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    return head + b"".join(
        struct.pack(">IIII", 7, 5, len(packet), len(packet)) + packet for packet in packets
    )


def cooked(packets):
    """Linux cooked capture, as ``tcpdump -i any`` makes it."""
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 113)
    link = struct.pack(">HHH8sH", 0, 1, 6, b"\x02\0\0\0\0\1\0\0", 0x0800)
    return pcap([(7.000005, link + packet[14:]) for packet in packets], head)


def raw_ip(packets):
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)
    return pcap([(7.000005, packet[14:]) for packet in packets], head)


def pcapng(packets):
    """Section header, interface description, enhanced packets; microseconds."""

    def part(kind, body):
        body += bytes(-len(body) % 4)
        size = struct.pack("<I", len(body) + 12)
        return struct.pack("<I", kind) + size + body + size

    content = part(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    content += part(1, struct.pack("<HHI", 1, 0, 65535))
    for packet in packets:
        head = struct.pack("<IIIII", 0, 0, 7_000_005, len(packet), len(packet))
        content += part(6, head + packet)
    return content


@pytest.mark.parametrize("form", [big_endian, cooked, raw_ip, pcapng])
def test_forms_of_captures(tmp_path, form):
    path = written(tmp_path, form([udp_packet(ONE), udp_packet(TWO)]))
    assert asterix.recognises(path)
    found, counts = read(path)
    assert found == [(ONE, 7_000_005_000), (TWO, 7_000_005_000)]
    assert counts == {}


def test_a_capture_cut_off_anywhere_gives_what_is_whole(tmp_path):
    content = pcap([(1.0, udp_packet(ONE)), (2.0, udp_packet(TWO))])
    first = len(pcap([(1.0, udp_packet(ONE))]))
    for end in range(len(PCAP_HEAD), len(content)):
        found, _ = read(written(tmp_path, content[:end]))
        assert [datagram.payload for datagram in found] == ([ONE] if end >= first else [])


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_damaged_captures_raise_one_line_or_nothing(tmp_path_factory, data):
    content = bytearray(pcap([(1.0, udp_packet(ONE)), (2.0, udp_packet(TWO))]))
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(4, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = written(tmp_path_factory.mktemp("damaged"), content)
    problem = ""
    try:
        found, _ = read(path)
    except CaptureError as error:
        found, problem = [], str(error)
    assert all(isinstance(datagram.payload, bytes) for datagram in found)
    assert not problem or (str(path) in problem and "\n" not in problem)


def test_raw_files_are_cut_into_blocks(tmp_path):
    found, counts = read(written(tmp_path, ONE + TWO + ONE))
    assert found == [(ONE, None), (TWO, None), (ONE, None)]
    assert counts == {}
    found, counts = read(written(tmp_path, ONE + TWO + ONE[:-1]))
    assert found == [(ONE, None), (TWO, None)]
    assert counts == {"malformed_datablock": 1}


def test_what_is_no_asterix(tmp_path):
    for content in (
        b"",
        b"0.0,85.2,12.5\n0.05,84.5,12.6\n",
        b'"sensorID": 2',
        ONE[:-1],
        ONE + b"time_s,range_m",
        block(62, b"\x80\x01\x02"),
    ):
        assert not asterix.recognises(written(tmp_path, content)), content
    assert asterix.recognises(written(tmp_path, ONE + TWO))
    assert is_raw(ONE, len(ONE))
    assert not asterix.recognises(Path(tmp_path))


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CaptureError, match="No such file"):
        read(tmp_path / "none")
    with pytest.raises(CaptureError, match="not a capture that can be read"):
        read(written(tmp_path, PCAP_HEAD[:12]))
    strange = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 147)
    with pytest.raises(CaptureError, match="link type 147: allowed is one of"):
        read(written(tmp_path, strange))
