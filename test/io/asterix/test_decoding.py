"""Every item that is read, byte for byte; nothing that comes raises."""

import math
from collections import Counter

import pytest
from asterix_examples import block, north, plot, record, sector, service, time_of_day
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.io.asterix.decoding import (
    SERVICE_MESSAGES,
    TARGET_REPORTS,
    ServiceMessage,
    TargetReport,
    decode,
    split_blocks,
)


def decoded(payload):
    counts = Counter()
    return decode(payload, counts), dict(counts)


def test_a_report_written_out_by_hand():
    # CAT 48, length 24; FSPEC fd 90: 010 140 020 040 070 090, 220 and 161.
    payload = bytes.fromhex(
        "30 0018 fd 90"
        "19c9"  # SAC 25, SIC 201
        "356d4d"  # 3501389 / 128 s = 27354.6015625 s
        "a0"  # TYP 5: single Mode S roll-call
        "c5aff1e0"  # 50607 / 256 NM, 61920 / 65536 of a turn
        "0200"  # 3/A code 1000 (octal)
        "0528"  # 1320 quarters: flight level 330
        "3c660c"
        "0deb"  # track 3563
    )
    assert len(payload) == 0x18
    (one,), counts = decoded(payload)
    assert counts == {}
    assert one.source == (25, 201)
    assert one.time_ns == 27_354_601_562_500
    assert one.range_m == pytest.approx(50607 / 256 * 1852, rel=1e-12)
    assert one.azimuth_deg == pytest.approx(61920 / 65536 * 360, rel=1e-12)
    known = {name: value for name, value in one.values.items() if not math.isnan(value)}
    assert known == {
        "detection_type": 5.0,
        "mode_3a": 0o1000,
        "flight_level": 330.0,
        "mode_s_address": 0x3C660C,
        "track_number": 3563.0,
    }


@settings(max_examples=60, deadline=None)
@given(
    time_ticks=st.integers(0, 86400 * 128 - 1),
    rho=st.integers(0, 65535),
    theta=st.integers(0, 65535),
    source=st.tuples(st.integers(0, 255), st.integers(0, 255)),
    code=st.none() | st.integers(0, 0o7777),
    level=st.none() | st.integers(-8192, 8191),
    address=st.none() | st.integers(0, 2**24 - 1),
    track=st.none() | st.integers(0, 4095),
    amplitudes=st.none() | st.tuples(st.integers(-128, 127), st.integers(-128, 127)),
    doppler=st.none() | st.integers(-512, 511),
)
def test_what_is_encoded_is_decoded(
    time_ticks, rho, theta, source, code, level, address, track, amplitudes, doppler
):
    one = plot(
        time_ticks / 128,
        rho / 256,
        theta * 360 / 65536,
        source,
        code,
        None if level is None else level / 4,
        address,
        track,
        amplitudes,
        doppler,
    )
    (found,), counts = decoded(block(48, one))
    assert counts == {}
    assert isinstance(found, TargetReport)
    assert found.source == source
    assert found.time_ns * 128 == time_ticks * 10**9
    assert found.range_m == pytest.approx(rho / 256 * 1852, rel=1e-12)
    assert found.azimuth_deg == pytest.approx(theta * 360 / 65536, rel=1e-12)
    ssr, psr = amplitudes or (None, None)
    expected = {
        "detection_type": 1,
        "mode_3a": code,
        "flight_level": None if level is None else level / 4,
        "mode_s_address": address,
        "track_number": track,
        "psr_amplitude_dbm": psr,
        "ssr_amplitude_dbm": ssr,
        "calculated_doppler_mps": doppler,
    }
    for name, value in expected.items():
        assert math.isnan(found.values[name]) if value is None else found.values[name] == value


def test_service_messages():
    payload = north(100.5, period_s=4.0) + sector(101.0, 45.0) + block(34, service(102.0, 3))
    found, counts = decoded(payload)
    assert counts == {}
    assert found == [
        ServiceMessage((25, 201), 100_500_000_000, 1, 0.0, 4.0),
        ServiceMessage((25, 201), 101_000_000_000, 2, 45.0, None),
        ServiceMessage((25, 201), 102_000_000_000, 3, None, None),
    ]


def test_several_records_and_blocks_of_a_datagram():
    payload = block(48, plot(1.0, 10.0, 20.0), plot(2.0, 11.0, 21.0)) + block(62, b"\x80\x01\x02")
    payload += north(3.0) + block(48, plot(4.0, 12.0, 22.0))
    found, counts = decoded(payload)
    assert [one.time_ns for one in found] == [10**9, 2 * 10**9, 3 * 10**9, 4 * 10**9]
    assert counts == {"other_category": 1}


@pytest.mark.parametrize(
    ("one", "reason"),
    [
        (record({"140": time_of_day(1.0)}, {"140": 2}), "no_source"),
        (record({"010": b"\x01\x02"}, {"010": 1}), "no_time"),
        (plot(1.0), "no_position"),
        (plot(1.0, 10.0, 20.0, descriptor=0x00), "no_detection"),
        (plot(1.0, 10.0, 20.0, descriptor=0x22), "test_target"),  # RAB: fixed transponder
        (plot(1.0, 10.0, 20.0, descriptor=b"\x21\x80"), "test_target"),  # TST
        (record({"010": b"\x01\x02", "140": b"\xff\xff\xff"}, {"010": 1, "140": 2}), "bad_time"),
    ],
)
def test_single_reports_are_left_out_by_reason(one, reason):
    found, counts = decoded(block(48, one, plot(5.0, 10.0, 20.0)))
    assert [report.time_ns for report in found] == [5 * 10**9]
    assert counts == {reason: 1}


def test_codes_that_the_radar_calls_garbled_are_unknown():
    for flags in (0b100, 0b010):  # V, G
        one = plot(1.0, 10.0, 20.0, mode_3a=0o7000, flight_level=50.0, code_flags=flags)
        ((found,), _) = decoded(block(48, one))
        assert math.isnan(found.values["mode_3a"])
        assert math.isnan(found.values["flight_level"])


def test_wrong_lengths_end_the_datagram_and_records_that_do_not_fit_their_block():
    good = block(48, plot(1.0, 10.0, 20.0))
    for wrong in (b"\x30\x00\x02", b"\x30\x00\x03", b"\x30\x00", b"\x30", b"\x30\xff\xff\x00"):
        found, counts = decoded(good + wrong + good)
        assert len(found) == 1
        assert counts == {"malformed_datablock": 1}
    cut = block(48, plot(1.0, 10.0, 20.0)[:-1])
    found, counts = decoded(cut + good)
    assert len(found) == 1
    assert counts == {"malformed_records": 1}


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_damaged_datagrams_raise_nothing_and_are_counted(data):
    payload = block(48, *(plot(t, 10.0 + t, 20.0, mode_3a=5, track=t) for t in range(1, 4)))
    payload += north(4.0)
    kind = data.draw(st.sampled_from(("cut", "flip", "noise", "records")))
    if kind == "cut":
        payload = payload[: data.draw(st.integers(1, len(payload) - 1))]
    elif kind == "flip":
        place = data.draw(st.integers(0, len(payload) - 1))
        payload = bytearray(payload)
        payload[place] ^= data.draw(st.integers(1, 255))
    elif kind == "noise":
        payload = data.draw(st.binary(min_size=1, max_size=60))
    else:
        category = data.draw(st.sampled_from((TARGET_REPORTS, SERVICE_MESSAGES)))
        payload = block(category, data.draw(st.binary(min_size=1, max_size=60)))
    found, counts = decoded(bytes(payload))
    for one in found:
        assert 0 <= one.time_ns < 86400 * 10**9
        if isinstance(one, TargetReport):
            assert 0.0 <= one.range_m < 256.0 * 1852.0
            assert 0.0 <= one.azimuth_deg < 360.0
    # A cut loses something, and says so.
    if kind == "cut":
        assert counts or len(found) == 3


@given(st.binary(max_size=200))
def test_blocks_are_the_bytes_they_were_cut_from(payload):
    counts = Counter()
    blocks = split_blocks(payload, counts)
    together = b"".join(block(category, records) for category, records in blocks)
    assert payload.startswith(together)
    assert (len(together) < len(payload)) == (counts["malformed_datablock"] == 1)
