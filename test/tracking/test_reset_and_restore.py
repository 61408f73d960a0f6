"""A reset is a fresh start but for the ids; a state restored while running goes on from there."""

from dataclasses import replace

import numpy as np
import pytest
from tracking_examples import UUID, answers, initial_tracks, ring_of, same_tracks, simulated

from gda_tracker.tracking import checkpoint

SCANS = simulated(30, n_targets=3, clutter=4, seed=5)


@pytest.mark.parametrize("decision", ["map", "mht", "jpda"])
def test_after_a_reset_the_same_scans_make_the_same_tracks_under_new_ids(decision):
    ring = ring_of(decision=decision)
    first = [ring.process(scan).tracks for scan in SCANS]
    living = set(first[-1].track_id.tolist())
    issued = ring.manager.state.next_track_id - 1
    assert living
    assert ring.manager.reset(epoch=1) == []
    assert len(ring.manager.state.table) == 0
    second = [ring.process(scan).tracks for scan in SCANS]
    assert set(second[0].deleted_track_id.tolist()) == living
    assert not second[1].deleted_track_id.size
    for one, other in zip(first, second, strict=True):
        assert other.key == (1, *one.key[1:])
        assert not set(other.track_id) & set(range(1, issued + 1))
        np.testing.assert_array_equal(one.track_id + issued, other.track_id)
        for name in ("mean", "covariance", "class_probability", "hits", "status"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def test_what_was_under_way_is_answered_and_old_answers_are_refused():
    ring = ring_of(decision="map")
    for scan in SCANS[:10]:
        ring.process(scan)
    manager = ring.manager
    for scan in SCANS[10:13]:
        assert manager.admit(scan) is None
    manager.open()
    late = answers(ring)
    told = manager.reset(epoch=7)
    assert [r.key[2] for r in told] == [scan.stamp_ns for scan in SCANS[10:13]]
    assert {(r.outcome, r.reason, r.key.epoch) for r in told} == {("rejected", "reset", 7)}
    assert (manager.counters["reset_reset"], manager.counters["rejected_reset"]) == (1, 3)
    assert manager.waiting == 0
    assert manager.opened is None
    # The same scan again: what the stages still say of the former one is another epoch's.
    manager.admit(SCANS[10])
    manager.open()
    with pytest.raises(ValueError):
        manager.close(*late)


def test_tracks_that_ended_by_a_reset_are_told_with_the_first_scan_that_is_closed():
    ring = ring_of(decision="map")
    for scan in SCANS[:10]:
        tracks = ring.process(scan).tracks
    living = set(tracks.track_id.tolist())
    ring.manager.reset(epoch=1)
    ring.manager.admit(SCANS[11])
    ring.manager.open()
    ring.manager.reset(epoch=2)
    assert set(ring.process(SCANS[12]).tracks.deleted_track_id.tolist()) == living


def test_a_reset_needs_a_new_epoch_and_waits_for_labelled_tracks_again():
    ring = ring_of(decision="map", initiation="labelled")
    ring.initialise(initial_tracks())
    with pytest.raises(ValueError, match="epoch = 0: allowed is an integer > 0"):
        ring.manager.reset(epoch=0)
    ring.manager.reset(epoch=1)
    assert ring.manager.state.initialised_from is None
    assert ring.initialise(initial_tracks()).outcome == "initialised"


@pytest.mark.parametrize("decision", ["map", "mht"])
def test_a_state_loaded_while_running_goes_on_as_it_did(tmp_path, decision):
    path = tmp_path / "state"
    ring = ring_of(decision=decision)
    ring.manager.system_uuid = UUID
    for scan in SCANS[:15]:
        ring.process(scan)
    checkpoint.save(ring.manager, path)
    after = [ring.process(scan).tracks for scan in SCANS[15:]]
    issued = ring.manager.state.next_track_id
    counted = ring.manager.counters["tracked"]
    assert checkpoint.restore(ring.manager, path, epoch=3) == []
    assert ring.manager.counters["tracked"] == counted
    assert ring.manager.state.next_track_id == issued
    again = ring.process(SCANS[15]).tracks
    assert again.key.epoch == 3
    for name in ("mean", "covariance", "class_probability", "hits"):
        assert getattr(again, name).tobytes() == getattr(after[0], name).tobytes(), name
    # What lived and is not in the file has ended, and no id comes a second time.
    ended = set(after[-1].track_id.tolist()) - set(after[0].track_id.tolist())
    assert ended <= set(again.deleted_track_id.tolist())


def test_a_state_of_another_system_brings_its_ids(tmp_path):
    path = tmp_path / "state"
    other = ring_of(decision="map")
    other.manager.system_uuid = UUID
    for scan in SCANS[:15]:
        expected = other.process(scan).tracks
    checkpoint.save(other.manager, path)
    ring = ring_of(decision="map")
    for scan in SCANS:
        ring.process(scan)
    checkpoint.restore(ring.manager, path, epoch=1)
    assert ring.manager.system_uuid == UUID
    found = ring.manager.tracks()
    assert found.key == (1, *expected.key[1:])
    found.key = expected.key
    same_tracks(found, expected)


def test_a_file_that_is_no_state_changes_nothing(tmp_path):
    ring = ring_of(decision="map")
    for scan in SCANS[:5]:
        ring.process(scan)
    ring.manager.admit(SCANS[5])
    before = ring.manager.state
    (tmp_path / "text").write_text("something else")
    for name, reason in (("text", "not readable"), ("none", "there is no such file")):
        with pytest.raises(checkpoint.CheckpointError, match=reason):
            checkpoint.restore(ring.manager, tmp_path / name, epoch=9)
    assert ring.manager.state is before
    assert (ring.manager.epoch, ring.manager.waiting) == (0, 1)


def test_a_bag_that_is_shorter_than_a_time_jump_may_loop():
    """Two scans of a lap are late; the third starts the time anew."""
    ring = ring_of(decision="map")
    short = SCANS[:8]
    assert 1e-9 * (short[-1].stamp_ns - short[0].stamp_ns) < ring.manager.parameters.time_jump_s
    for lap in range(3):
        outcomes = [ring.process(scan).report.outcome for scan in short]
        late = ["rejected"] * 2 if lap else ["tracked"] * 2
        assert outcomes == late + ["tracked"] * 6
    assert ring.manager.counters["reset_time_jump"] == 2
    assert ring.manager.counters["rejected_late"] == 4


def test_sensors_that_are_late_for_others_start_no_time_anew():
    """One whose scans always come after those of another, and one that comes out of order once."""
    ring = ring_of(decision="map")
    for k, scan in enumerate(SCANS):
        ring.process(scan)
        late = replace(scan, sensor_id="slow", stamp_ns=scan.stamp_ns - 500_000_000)
        assert ring.process(late).report.reason == "late", k
        if k % 5 == 4:
            swapped = replace(scan, stamp_ns=scan.stamp_ns - 100_000_000)
            assert ring.process(swapped).report.reason == "late"
    assert ring.manager.counters["reset_time_jump"] == 0
