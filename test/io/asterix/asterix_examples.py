"""An encoder of ASTERIX 048 and 034 and of captures, written from the public specifications alone.

EUROCONTROL-SPEC-0149-4 (category 048) and 0149-2b (category 034): each item as its bits, most
significant first; the field specification (FSPEC) names the items by their number in the user
application profile, seven to a byte, the last bit says that another byte follows.
"""

from __future__ import annotations

import math
import socket
import struct

# Numbers of the items in the profiles.
FRN_048 = {
    "010": 1, "140": 2, "020": 3, "040": 4, "070": 5, "090": 6, "130": 7, "220": 8, "240": 9,
    "250": 10, "161": 11, "042": 12, "200": 13, "170": 14, "210": 15, "030": 16, "080": 17,
    "100": 18, "110": 19, "120": 20, "230": 21,
}  # fmt: skip
FRN_034 = {"010": 1, "000": 2, "030": 3, "020": 4, "041": 5, "050": 6, "120": 11}
# Classical pcap: little endian, microseconds, Ethernet.
PCAP_HEAD = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)


def record(items: dict[str, bytes], numbers: dict[str, int]) -> bytes:
    """FSPEC and items in the order of their numbers."""
    present = {numbers[name]: content for name, content in items.items()}
    size = (max(present) + 6) // 7
    spec = bytearray(size)
    for number in present:
        place, bit = divmod(number - 1, 7)
        spec[place] |= 0x80 >> bit
    for place in range(size - 1):
        spec[place] |= 1
    return bytes(spec) + b"".join(present[number] for number in sorted(present))


def block(category: int, *records: bytes) -> bytes:
    """Category, length with these three bytes, records."""
    content = b"".join(records)
    return struct.pack(">BH", category, len(content) + 3) + content


def time_of_day(seconds: float) -> bytes:
    """128ths of a second since midnight, three bytes."""
    return (round(seconds * 128) % (86400 * 128)).to_bytes(3, "big")


def plot(
    time_s,
    range_nmi=None,
    azimuth_deg=None,
    source=(25, 201),
    mode_3a=None,
    flight_level=None,
    address=None,
    track=None,
    amplitudes=None,
    doppler=None,
    descriptor=0x20,
    code_flags=0,
):
    """A target report as a record; ``amplitudes`` are (SSR, PSR) in dBm."""
    items = {"010": bytes(source), "140": time_of_day(time_s)}
    if descriptor is not None:  # TYP in the three highest bits
        items["020"] = descriptor if isinstance(descriptor, bytes) else bytes([descriptor])
    if range_nmi is not None:
        azimuth = round(azimuth_deg * 65536 / 360) % 65536
        items["040"] = struct.pack(">HH", round(range_nmi * 256), azimuth)
    if mode_3a is not None:  # V, G, L, spare, then twelve bits; given as in 0o7700
        items["070"] = struct.pack(">H", code_flags << 13 | mode_3a)
    if flight_level is not None:  # quarters of a level, two's complement in fourteen bits
        items["090"] = struct.pack(">H", code_flags >> 1 << 14 | round(flight_level * 4) & 0x3FFF)
    if amplitudes is not None:  # subfields SAM (third) and PAM (fifth)
        items["130"] = struct.pack(">Bbb", 0x28, *amplitudes)
    if address is not None:
        items["220"] = address.to_bytes(3, "big")
    if track is not None:
        items["161"] = struct.pack(">H", track)
    if doppler is not None:  # subfield CAL: D, five spare bits, ten bits of speed
        items["120"] = struct.pack(">BH", 0x80, doppler & 0x3FF)
    return record(items, FRN_048)


def service(time_s, kind, azimuth_deg=None, period_s=None, source=(25, 201)):
    """A service message as a record: 1 north marker, 2 sector crossing."""
    items = {"010": bytes(source), "000": bytes([kind]), "030": time_of_day(time_s)}
    if azimuth_deg is not None:
        items["020"] = bytes([round(azimuth_deg * 256 / 360) % 256])
    if period_s is not None:
        items["041"] = struct.pack(">H", round(period_s * 128))
    return record(items, FRN_034)


def north(time_s, **more):
    return block(34, service(time_s, 1, 0.0, **more))


def sector(time_s, azimuth_deg, **more):
    return block(34, service(time_s, 2, azimuth_deg, **more))


def traffic(
    aircraft, turns, period_s=4.0, start_s=1000.0, service_messages=True, sectors=8, told=True
):
    """Datagrams of a turning antenna as (time [s], bytes), the times not turned over at midnight.

    ``aircraft`` is a function of the time [s] that returns x East, y North [m] of each. A plot is
    of the moment at which the antenna points to the aircraft.
    """
    events = []
    for turn in range(turns):
        begin = start_s + turn * period_s
        if service_messages:
            events.append((begin, north(begin, period_s=period_s if told else None)))
            for part in range(1, sectors):
                time_s = begin + period_s * part / sectors
                events.append((time_s, sector(time_s, 360.0 * part / sectors)))
        for number, _ in enumerate(aircraft(begin)):
            time_s = begin
            for _ in range(20):  # the azimuth depends on the time, the time on the azimuth
                x, y = aircraft(time_s)[number]
                azimuth = math.degrees(math.atan2(x, y)) % 360.0
                time_s = begin + period_s * azimuth / 360.0
            one = plot(
                time_s,
                math.hypot(x, y) / 1852.0,
                azimuth,
                mode_3a=0o1000 + number,
                flight_level=100.0 + number,
                address=0x3C0000 + number,
            )
            events.append((time_s, block(48, one)))
    return sorted(events, key=lambda event: event[0])


def udp_packet(payload, port=8600, group="239.1.2.3", fragment=0, protocol=17):
    """Ethernet, IPv4 and UDP around a payload."""
    udp = struct.pack(">HHHH", 50000, port, len(payload) + 8, 0) + payload
    head = struct.pack(
        ">BBHHHBBH4s4s",
        0x45, 0, 20 + len(udp), 1, fragment, 16, protocol, 0,
        socket.inet_aton("10.0.0.1"), socket.inet_aton(group),
    )  # fmt: skip
    return bytes.fromhex("01005e010203" + "020000000001" + "0800") + head + udp


def pcap(packets, head=PCAP_HEAD):
    """A capture of (time [s], packet)."""
    return head + b"".join(
        struct.pack("<IIII", int(time_s), round(time_s % 1 * 1e6), len(packet), len(packet))
        + packet
        for time_s, packet in packets
    )
