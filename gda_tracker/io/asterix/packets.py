"""Datagrams out of files: captures of a network (pcap, pcapng; by dpkt), or raw bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from gda_tracker.errors import UserError
from gda_tracker.io.asterix.decoding import (
    HEADER_BYTES,
    SERVICE_MESSAGES,
    TARGET_REPORTS,
    split_blocks,
)

PCAP_MAGIC = (
    b"\xd4\xc3\xb2\xa1",
    b"\xa1\xb2\xc3\xd4",
    b"\x4d\x3c\xb2\xa1",  # times in nanoseconds
    b"\xa1\xb2\x3c\x4d",
    b"\x0a\x0d\x0d\x0a",  # pcapng
)
# Blocks that must follow one another for bytes without a magic number to count as ASTERIX.
BLOCKS_TO_KNOW_BY = 3
RAW_IP = 101  # LINKTYPE_RAW as it stands in files
ETHERTYPES_IP = (0x0800, 0x86DD)


class CaptureError(UserError):
    """A capture cannot be read; the message is one line and names the file."""


class Datagram(NamedTuple):
    """Bytes, and when they were captured (Unix time [ns]), ``None`` where nobody knows."""

    payload: bytes
    received_ns: int | None


def is_capture(start: bytes) -> bool:
    """Whether these are the first bytes of a pcap or pcapng file."""
    return start.startswith(PCAP_MAGIC)


def is_raw(start: bytes, size: int) -> bool:
    """Whether these first bytes of a file of ``size`` bytes begin with ASTERIX 034 or 048.

    Block must follow block: the first three, or all up to the end of the file.
    """
    position = 0
    for _ in range(BLOCKS_TO_KNOW_BY):
        header = start[position : position + HEADER_BYTES]
        length = int.from_bytes(header[1:], "big")
        if len(header) < HEADER_BYTES or length <= HEADER_BYTES or position + length > size:
            return False
        if header[0] not in (SERVICE_MESSAGES, TARGET_REPORTS):
            return False
        position += length
        if position == size:
            return True
        if position + HEADER_BYTES > len(start):
            return True
    return True


def read_datagrams(path: Path, counts: Counter[str]) -> Iterator[Datagram]:
    """Yield the datagrams of a file, in its order.

    A raw file is cut into its data blocks. Packets of a capture that hold none are counted:
    ``not_udp``, ``ip_fragment``, ``truncated_packet`` (captured in part, or cut off at the end of
    the file), ``malformed_packet``.

    Raises
    ------
    CaptureError
        If the file cannot be read, or dpkt is missing.
    """
    try:
        with path.open("rb") as file:
            if is_capture(file.read(4)):
                file.seek(0)
                yield from _of_capture(path, file, counts)
                return
            file.seek(0)
            content = file.read()
    except OSError as error:
        raise CaptureError(f"{path}: {error.strerror}") from error
    for category, records in split_blocks(content, counts):
        length = len(records) + HEADER_BYTES
        yield Datagram(bytes([category]) + length.to_bytes(2, "big") + records, None)


def _of_capture(path: Path, file: Any, counts: Counter[str]) -> Iterator[Datagram]:
    try:
        import dpkt
    except ImportError as error:
        raise CaptureError(
            f"{path}: captures need the dpkt library: pip install gda_tracker[asterix]"
        ) from error
    broken = (dpkt.UnpackError, ValueError, IndexError)
    try:
        packets = dpkt.pcap.UniversalReader(file)
        link = packets.datalink()
    except broken as error:
        raise CaptureError(f"{path}: not a capture that can be read: {error}") from error
    kinds = {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
        dpkt.pcap.DLT_LOOP: dpkt.loopback.Loopback,
        dpkt.pcap.DLT_RAW: dpkt.ip.IP,
        RAW_IP: dpkt.ip.IP,
    }
    if link not in kinds:
        raise CaptureError(f"{path}: link type {link}: allowed is one of {sorted(kinds)}")
    iterator = iter(packets)
    while True:
        try:
            time_s, frame = next(iterator)
        except StopIteration:
            return
        except broken:
            counts["truncated_packet"] += 1
            return
        try:
            payload = _udp_payload(dpkt, kinds[link](frame), counts)
        except broken:
            counts["malformed_packet"] += 1
            continue
        if payload is not None:
            yield Datagram(payload, round(float(time_s) * 1e9))


def _udp_payload(dpkt: Any, packet: Any, counts: Counter[str]) -> bytes | None:
    """Return what a packet carries by UDP, or count why it carries nothing."""
    kind = 0
    while isinstance(packet, dpkt.Packet) and not isinstance(packet, dpkt.ip.IP | dpkt.ip6.IP6):
        kind = getattr(packet, "type", 0) or getattr(packet, "ethtype", 0)
        packet = packet.data
    if not isinstance(packet, dpkt.ip.IP | dpkt.ip6.IP6):
        # dpkt leaves what it could not unpack as bytes.
        counts["truncated_packet" if kind in ETHERTYPES_IP else "not_udp"] += 1
        return None
    if isinstance(packet, dpkt.ip.IP) and (packet.mf or packet.offset):
        counts["ip_fragment"] += 1
        return None
    udp = packet.data
    if not isinstance(udp, dpkt.udp.UDP):
        cut = packet.p == dpkt.ip.IP_PROTO_UDP
        counts["truncated_packet" if cut else "not_udp"] += 1
        return None
    length = udp.ulen - 8
    if length < 0 or length > len(udp.data):
        counts["truncated_packet"] += 1
        return None
    return bytes(udp.data[:length])
