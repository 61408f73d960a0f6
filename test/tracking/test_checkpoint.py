"""Checkpoints: a restored manager goes on bit for bit; a broken file is one line and no state."""

import copy
import dataclasses
import json
import os
import pathlib
import struct
import zlib

import numpy as np
import pytest
from tracking_examples import (
    UUID,
    assert_same,
    initial_tracks,
    moving,
    ring_of,
    scan_at,
    simulated,
)

from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.checkpoint import CheckpointError
from gda_tracker.tracking.hypotheses import ROW_FIELDS

SCANS = simulated(30, n_targets=4, clutter=6, seed=11)


def fresh_ring(epoch=0, **parameters):
    ring = ring_of(**parameters)
    ring.manager.epoch = epoch
    return ring


def restored(path, **parameters):
    ring = fresh_ring(**parameters)
    assert checkpoint.load(ring.manager, path)
    return ring


WINDOW = {"history_policy": "window", "history_window": 4}


@pytest.mark.parametrize(
    ("term", "policy"),
    [
        *[(term, {}) for term in ("none", "dsm_classic", "dempster", "pcr5", "bayes")],
        *[(term, WINDOW) for term in ("none", "dsm_classic", "bayes")],
    ],
)
def test_restarted_at_every_scan_it_goes_on_bit_for_bit(tmp_path, term, policy):
    """One manager runs through; the other is saved, thrown away and loaded after each scan."""
    path = tmp_path / "state"
    through = fresh_ring(attribute_term=term, **policy)
    through.manager.system_uuid = UUID
    restarting = fresh_ring(attribute_term=term, **policy)
    restarting.manager.system_uuid = UUID
    for k, scan in enumerate(SCANS):
        expected = through.process(scan)
        result = restarting.process(scan)
        assert_same(result.tracks, expected.tracks, f"scan {k}")
        assert_same(result.predictions, expected.predictions, f"scan {k}")
        assert_same(result.report, expected.report, f"scan {k}")
        checkpoint.save(restarting.manager, path)
        restarting = restored(path, attribute_term=term, **policy)
        assert_same(restarting.manager.state, through.manager.state, f"scan {k}")
        assert restarting.manager.counters == through.manager.counters
        assert restarting.manager.system_uuid == UUID
    assert len(expected.tracks) >= 3
    assert through.manager.state.next_track_id > 5


@pytest.mark.parametrize("start", [1, 2, 7, 15])
def test_restarted_once_it_equals_the_uninterrupted_run_at_every_later_scan(tmp_path, start):
    path = tmp_path / "state"
    through = fresh_ring()
    for scan in SCANS[:start]:
        through.process(scan)
    checkpoint.save(through.manager, path)
    other = restored(path)
    for scan in SCANS[start:]:
        assert_same(other.process(scan), through.process(scan))


def test_the_state_is_laid_out_alike_before_and_after():
    """Sums and products of arrays may depend on their layout in the last bit."""
    ring = fresh_ring()
    for scan in SCANS:
        ring.process(scan)
        for name in ROW_FIELDS:
            assert getattr(ring.manager.state.table, name).flags.c_contiguous, name


def test_the_last_scan_is_answered_again_after_a_restart(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring(epoch=5)
    for scan in SCANS[:10]:
        result = ring.process(scan)
    checkpoint.save(ring.manager, path)
    other = fresh_ring(epoch=6)
    checkpoint.load(other.manager, path)
    again = other.process(SCANS[9])
    assert again.report.repeated
    assert again.report.key == (6, *result.report.key[1:])
    assert dataclasses.replace(again.report, repeated=False, key=result.report.key) == result.report
    again.tracks.key = result.tracks.key
    assert_same(again.tracks, result.tracks)
    # And nothing older is taken for new.
    assert other.process(SCANS[8]).report.reason == "late"


def test_that_the_last_scan_was_given_up_is_remembered(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring()
    for scan in SCANS[:5]:
        ring.process(scan)
    ring.manager.admit(SCANS[5])
    ring.manager.open()
    tracks, report = ring.manager.give_up()
    assert tracks.degraded
    checkpoint.save(ring.manager, path)
    again = restored(path).process(SCANS[5])
    assert again.report.outcome == report.outcome == "gave_up"
    assert_same(again.tracks, tracks)


def test_sensors_of_the_last_stamp_are_remembered(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring()
    for sensor in ("north", "south"):
        ring.process(scan_at(3, [moving(3)], sensor_id=sensor))
    checkpoint.save(ring.manager, path)
    other = restored(path)
    assert other.process(scan_at(3, [moving(3)], sensor_id="north")).report.reason == "late"
    assert other.process(scan_at(3, [moving(3)], sensor_id="south")).report.repeated
    assert other.process(scan_at(3, [moving(3)], sensor_id="west")).report.outcome == "tracked"


def test_initial_tracks_act_once_over_a_restart(tmp_path):
    path = tmp_path / "state"
    ring = ring_of(initiation="labelled")
    initial = initial_tracks()
    ring.initialise(initial)
    checkpoint.save(ring.manager, path)
    other = restored(path, initiation="labelled")
    assert_same(other.manager.state, ring.manager.state)
    assert other.initialise(initial).repeated
    # The time axis too is where it was.
    for late in (10.0, 9.0):
        assert other.process(scan_at(late, [])).report.reason == "late"
    result = other.process(scan_at(11, [moving(11)]))
    assert_same(result.tracks, ring.process(scan_at(11, [moving(11)])).tracks)


def test_ids_are_not_used_again_after_a_restart(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring(deletion_misses=1)
    for k in range(4):
        ring.process(scan_at(k, [moving(k)]))
    ring.process(scan_at(4, []))
    assert len(ring.manager.state.table) == 0
    checkpoint.save(ring.manager, path)
    other = restored(path)
    for k in (5, 6):
        tracks = other.process(scan_at(k, [moving(k)])).tracks
    assert tracks.track_id.tolist() == [2]
    assert tracks.hypothesis_id.tolist() == [2]


def test_a_manager_that_has_closed_nothing_can_be_saved(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring()
    checkpoint.save(ring.manager, path)
    assert_same(restored(path).manager.state, ring.manager.state)


def test_integers_of_numpy_are_written_as_integers(tmp_path):
    path = tmp_path / "state"
    ring = ring_of(initiation="labelled")
    initial = initial_tracks()
    initial.key = initial.key._replace(stamp_ns=np.int64(initial.key.stamp_ns))
    ring.initialise(initial)
    checkpoint.save(ring.manager, path)
    assert restored(path).manager.state.last_ns == initial.key.stamp_ns


def test_counters_are_those_of_the_file(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring()
    ring.process(SCANS[0])
    ring.process(scan_at(50, []))
    checkpoint.save(ring.manager, path)
    counters = ring.manager.counters
    kept = dict(counters)
    checkpoint.load(ring.manager, path)
    assert ring.manager.counters is counters
    assert dict(counters) == kept


# --- files


def saved(tmp_path):
    path = tmp_path / "state"
    ring = fresh_ring()
    for scan in SCANS[:12]:
        ring.process(scan)
    checkpoint.save(ring.manager, path)
    return path


def rewrite_header(content, change):
    """A file with another header and a right checksum."""
    start = len(checkpoint.MAGIC) + 8
    end = start + struct.unpack("<Q", content[start - 8 : start])[0]
    header = json.loads(content[start:end])
    change(header)
    new = json.dumps(header).encode()
    body = checkpoint.MAGIC + struct.pack("<Q", len(new)) + new + content[end:-4]
    return body + struct.pack("<I", zlib.adler32(body))


def test_no_file_is_no_state(tmp_path):
    ring = fresh_ring()
    assert not checkpoint.load(ring.manager, tmp_path / "none")
    assert not checkpoint.load(ring.manager, tmp_path / "no" / "folder" / "none")


def test_cut_anywhere_it_is_refused(tmp_path):
    path = saved(tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for length in [0, 1, 10, 25, 30, 33, 200, len(whole) - 1, *rng.integers(0, len(whole), 40)]:
        path.write_bytes(whole[:length])
        with pytest.raises(CheckpointError, match="not readable") as error:
            checkpoint.load(fresh_ring().manager, path)
        assert "\n" not in str(error.value)
        assert str(path) in str(error.value)


def test_any_changed_byte_is_noticed(tmp_path):
    path = saved(tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        with pytest.raises(CheckpointError, match="not readable"):
            checkpoint.load(fresh_ring().manager, path)


@pytest.mark.parametrize(
    "content",
    [b"", b"\x00" * 1000, b"PK\x03\x04 not a checkpoint", b"{}\n", "säuglich".encode() * 99],
)
def test_garbage_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "state"
    path.write_bytes(content)
    ring = fresh_ring()
    before = copy.deepcopy(ring.manager.state)
    with pytest.raises(CheckpointError, match="it is not a checkpoint of this version"):
        checkpoint.load(ring.manager, path)
    assert_same(ring.manager.state, before)


@pytest.mark.parametrize(
    "change",
    [
        lambda h: h.pop("rest"),
        lambda h: h.pop("arrays"),
        lambda h: h["rest"].pop("next_track_id"),
        lambda h: h["rest"].update(system_uuid="xyz"),
        lambda h: h["rest"].update(last_key=[1]),
        lambda h: h["arrays"].pop(),
        lambda h: h["arrays"][0].__setitem__(1, "|O"),
        lambda h: h["arrays"][0].__setitem__(1, "nonsense"),
        lambda h: h["arrays"][0].__setitem__(2, [10**12]),
        lambda h: h["arrays"][0].__setitem__(2, [-3]),
    ],
)
def test_a_wrong_header_under_a_right_checksum_is_refused_too(tmp_path, change):
    path = saved(tmp_path)
    path.write_bytes(rewrite_header(path.read_bytes(), change))
    ring = fresh_ring()
    before = copy.deepcopy(ring.manager.state)
    with pytest.raises(CheckpointError, match="not readable") as error:
        checkpoint.load(ring.manager, path)
    assert "\n" not in str(error.value)
    assert_same(ring.manager.state, before)
    assert not ring.manager.counters


def test_a_folder_in_its_place_is_one_line(tmp_path):
    with pytest.raises(CheckpointError, match="cannot be read"):
        checkpoint.load(fresh_ring().manager, tmp_path)
    path = tmp_path / "state"
    (path / "inside").mkdir(parents=True)
    with pytest.raises(CheckpointError, match="cannot be written"):
        checkpoint.save(fresh_ring().manager, path)
    assert os.listdir(tmp_path) == ["state"]


def test_missing_folders_are_made_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "some" / "where" / "state"
    ring = fresh_ring()
    for scan in SCANS[:5]:
        ring.process(scan)
        checkpoint.save(ring.manager, path)
    assert os.listdir(path.parent) == ["state"]


def test_a_crash_while_writing_keeps_the_old_state(tmp_path, monkeypatch):
    path = saved(tmp_path)
    whole = path.read_bytes()
    ring = restored(path)
    ring.process(SCANS[12])

    def crash(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", crash)
    with pytest.raises(CheckpointError, match="cannot be written .No space left on device."):
        checkpoint.save(ring.manager, path)
    monkeypatch.undo()
    assert path.read_bytes() == whole
    assert os.listdir(tmp_path) == ["state"]
    # What a killed process leaves behind is overwritten by the next one.
    pathlib.Path(f"{path}.tmp").write_bytes(b"half")
    checkpoint.save(ring.manager, path)
    assert os.listdir(tmp_path) == ["state"]
    assert_same(restored(path).manager.state, ring.manager.state)
