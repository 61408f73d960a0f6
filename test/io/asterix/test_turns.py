"""Turns of the antenna, days, and frames: every plot in the scan of its turn, once."""

from collections import Counter
from datetime import UTC, date, datetime

import numpy as np
import pytest
from asterix_examples import block, north, plot, sector, service, traffic
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.io.asterix.day_clock import DAY_NS, DayClock
from gda_tracker.io.asterix.reader import AsterixReader, first_day, parse_source
from gda_tracker.parameters import ParameterError


def frames_of(datagrams, reader=None, received=False):
    reader = reader or AsterixReader()
    found = []
    for time_s, payload in datagrams:
        found += reader.take(payload, round(time_s * 1e9) if received else None)
    return found + list(reader.flush()), reader


def columns(frame, *names):
    found = frame.read(names, {})
    return [found[name] for name in names]


def sizes(frames):
    return [len(columns(frame, "range")[0]) for frame in frames]


def two_aircraft(time_s):
    """One that flies North past the radar in the East, one in the North-West."""
    return [(30e3, -20e3 + 150.0 * (time_s - 1000.0)), (-25e3 + 100.0 * (time_s - 1000.0), 28e3)]


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("service_messages", [True, False])
def test_each_turn_has_each_aircraft_once(told, service_messages):
    datagrams = traffic(two_aircraft, 20, service_messages=service_messages, told=told)
    frames, reader = frames_of(datagrams)
    assert sizes(frames) == [2] * 20
    assert not reader.counts
    stamps = np.array([frame.stamp_ns for frame in frames])
    if service_messages:  # the middle between two north markers
        np.testing.assert_allclose(stamps * 1e-9, 1002.0 + 4.0 * np.arange(20), atol=0.01)
    else:
        assert (np.diff(stamps) > 3_800_000_000).all()
    for frame in frames:
        distance, azimuth, offset = columns(frame, "range", "azimuth", "time_offset")
        assert (np.abs(offset) <= 2.001).all()
        for row in range(2):
            time_s = frame.stamp_ns * 1e-9 + offset[row]
            x, y = distance[row] * np.sin(azimuth[row]), distance[row] * np.cos(azimuth[row])
            gap = min(np.hypot(x - a, y - b) for a, b in two_aircraft(time_s))
            assert gap < 8.0  # 1/256 NM, 1/65536 of a turn, 1/128 s
    assert frames[0].sensor_id == frames[0].frame_id == "sac25_sic201"


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    period_s=st.sampled_from((1.0, 4.0, 12.0)),
    number=st.integers(1, 6),
)
def test_late_and_lost_messages_change_no_turn(seed, period_s, number):
    """Plots come up to a sixteenth of a turn late, in any order; north markers get lost."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi, number)
    place = [(30e3 * np.sin(a), 30e3 * np.cos(a)) for a in angles]
    sent = traffic(lambda _: place, 12, period_s=period_s)
    lost = [rng.random() < 0.3 and payload[0] == 34 and index > 0 for index, (_, payload) in
            enumerate(sent)]  # fmt: skip
    delay = rng.uniform(0.0, period_s / 16, len(sent))
    delay[0] = 0.0
    order = np.argsort([time_s + late for (time_s, _), late in zip(sent, delay, strict=True)])
    frames, reader = frames_of([sent[i] for i in order if not lost[i]])
    found = Counter()
    for frame in frames:
        for code, offset in zip(*columns(frame, "mode_3a", "time_offset"), strict=True):
            time_s = frame.stamp_ns * 1e-9 + offset
            found[int((time_s - 1000.0 + 1e-3 * period_s) // period_s), int(code)] += 1
    assert not reader.counts
    assert set(found.values()) == {1}
    assert len(found) == 12 * number
    # No frame holds an aircraft twice.
    for frame in frames:
        (codes,) = columns(frame, "mode_3a")
        assert len(set(codes)) == len(codes)


def test_turns_without_plots_are_scans_if_the_radar_says_that_it_turned():
    nothing = traffic(lambda _: [], 6)
    some = traffic(lambda _: [(1e4, 1e4)], 2, start_s=1000.0 + 6 * 4.0)
    frames, _ = frames_of([*nothing, *some])
    assert sizes(frames) == [0] * 6 + [1, 1]
    frames, _ = frames_of([event for event in [*nothing, *some] if event[1][0] == 48])
    assert sizes(frames) == [1, 1]


def test_a_single_aircraft_without_service_messages():
    for period_s in (4.0, 6.0, 12.0):
        sent = traffic(
            lambda t: [(20e3 + 3.0 * (t - 1000.0), 20e3)], 8, period_s, service_messages=False
        )
        frames, _ = frames_of(sent)
        assert sizes(frames) == [1] * 8


def test_a_silence_and_a_recording_that_begins_again():
    first = traffic(two_aircraft, 3)
    later = traffic(lambda t: two_aircraft(t - 200.0), 3, start_s=1200.0)
    frames, reader = frames_of([*first, *later, *first])
    assert sizes(frames) == [2] * 9
    assert reader.counts == {"time_jump": 2}
    # One report with a wrong time costs no more than its turn.
    wrong = (1005.0, block(48, plot(1090.0, 10.0, 100.0)))
    sent = sorted([*traffic(two_aircraft, 8), wrong], key=lambda event: event[0])
    frames, reader = frames_of(sent)
    assert sum(sizes(frames)) == 17
    assert reader.counts == {"time_jump": 2}


def test_a_plot_of_a_turn_that_went_out_is_late():
    sent = traffic(two_aircraft, 3)
    late = block(48, plot(1006.0, 10.0, 180.0))
    frames, reader = frames_of([*sent[:-1], (0.0, late), sent[-1]])
    assert reader.counts == {"late_plot": 1}
    assert sizes(frames) == [2, 2, 2]


def test_radars_are_apart_by_their_codes():
    one = traffic(two_aircraft, 5)
    other = [
        (time_s + 0.3, block(48, plot(time_s + 0.3, 40.0, 10.0, source=(1, 2))))
        for time_s in 1000.0 + 5.0 * np.arange(4)
    ]
    mixed = sorted([*one, *other], key=lambda event: event[0])
    frames, reader = frames_of(mixed)
    assert reader.plots == {(25, 201): 10, (1, 2): 4}
    by_name = {frame.sensor_id for frame in frames}
    assert by_name == {"sac25_sic201", "sac1_sic2"}
    frames, reader = frames_of(mixed, AsterixReader((1, 2)))
    assert sizes(frames) == [1] * 4
    assert reader.counts["other_radar"] == len(one)
    frames, reader = frames_of(mixed, AsterixReader(first_radar_only=True))
    assert {frame.sensor_id for frame in frames} == {"sac1_sic2"}


def test_midnight():
    start_s = 86400.0 - 20.0
    sent = traffic(lambda t: two_aircraft(t - start_s + 1000.0), 10, start_s=start_s)
    frames, reader = frames_of(sent, AsterixReader(first_day=date(2026, 11, 22)))
    assert sizes(frames) == [2] * 10
    assert not reader.counts
    stamps = np.array([frame.stamp_ns for frame in frames])
    assert (np.diff(stamps) == 4 * 10**9).all()
    begin = datetime.fromtimestamp(stamps[0] * 1e-9, UTC)
    assert begin == datetime(2026, 11, 22, 23, 59, 42, tzinfo=UTC)
    # By the time of reception, which may be some hours wrong.
    day = datetime(2026, 11, 22, tzinfo=UTC).timestamp()
    for wrong_s in (0.0, -3600.0, 3600.0):
        received = [(day + time_s + wrong_s, payload) for time_s, payload in sent]
        found, _ = frames_of(received, received=True)
        assert [frame.stamp_ns for frame in found] == stamps.tolist()


@given(
    days=st.integers(0, 30_000),
    time_ns=st.integers(0, DAY_NS - 1),
    gap_ns=st.integers(-DAY_NS // 2 + 1, DAY_NS // 2 - 1),
)
def test_the_day_is_that_closest_to_the_reference(days, time_ns, gap_ns):
    stamp = (days + 1) * DAY_NS + time_ns
    assert DayClock().stamp_ns(time_ns, stamp + gap_ns) == stamp
    clock = DayClock()
    clock.stamp_ns(stamp % DAY_NS, stamp)
    assert clock.stamp_ns((stamp + gap_ns) % DAY_NS) == stamp + gap_ns


def test_without_a_day_times_count_from_midnight():
    assert DayClock().stamp_ns(5) == 5
    assert first_day("") is None


@pytest.mark.parametrize("text", ["25", "25/", "/3", "256/1", "1/2/3", "a/b", "-1/2"])
def test_names_of_radars_that_are_none(text):
    with pytest.raises(ParameterError, match="allowed is SAC/SIC"):
        parse_source(text)
    assert parse_source("0/255") == (0, 255)
    with pytest.raises(ParameterError, match="allowed is a date such as 2026-11-22"):
        first_day("22.11.2026")


def test_the_period_is_that_of_north_markers_where_the_radar_does_not_say_it():
    reader = AsterixReader()
    for turn in range(4):
        list(reader.take(block(34, service(1000.0 + 5.0 * turn, 1))))
        list(reader.take(sector(1002.5 + 5.0 * turn, 180.0)))
    # One aircraft right after a long way without any other message.
    found = list(reader.take(block(48, plot(1024.9, 10.0, 353.0))))
    found += reader.take(north(1025.0)) or []
    found += list(reader.take(sector(1026.0, 72.0)))
    assert sizes(found)[-1] == 1
