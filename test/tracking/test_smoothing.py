"""Smoothing of a whole recording: against filterpy, the delayed tracks of the trees, properties."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from model_examples import models_of
from tracking_examples import SECOND, initial_tracks, moving, ring_of, scan_at, simulated

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.tracking.smoothing import Smoother


def smoothing_ring(**values):
    ring = ring_of(**values)
    ring.smoother = Smoother()
    return ring


def test_a_track_equals_the_smoother_of_filterpy():
    """Rauch, Tung and Striebel over all scans, also those without a detection."""
    ring = smoothing_ring(initiation="labelled", deletion_misses=0)
    ring.initialise(initial_tracks(1))
    rng = np.random.default_rng(2)
    stamps = np.array([11.0, 12.5, 13.0, 15.0, 15.5, 18.0, 19.0])
    online = []
    for k, stamp in enumerate(stamps):
        seen = [] if k == 3 else [moving(stamp) + rng.normal(0.0, 5.0, 2)]
        online.append(ring.process(scan_at(stamp, seen)).tracks)
    steps = [
        constant_velocity(dt, ring.manager.parameters.process_noise_std_mps2)
        for dt in np.diff(stamps)
    ]
    peer = KalmanFilter(dim_x=4, dim_z=2)
    # Its entry k leads to scan k.
    f, q = ([np.eye(4), *(one[part] for one in steps)] for part in (0, 1))
    mean, covariance = (
        np.array([t.mean[0] for t in online]),
        np.array([t.covariance[0] for t in online]),
    )
    expected, spread, _, _ = peer.rts_smoother(mean, covariance, f, q)
    told = ring.smoother.tracks()
    np.testing.assert_array_equal([t.key.stamp_ns for t in told], stamps * SECOND)
    np.testing.assert_allclose([t.mean[0] for t in told], expected, rtol=1e-9)
    np.testing.assert_allclose([t.covariance[0] for t in told], spread, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", ["velocity", "all"])
def test_trees_that_look_to_the_end_tell_the_same(name):
    """With more scans of delay than there are, the delayed tracks are the smoothed ones."""
    ring = smoothing_ring(
        **models_of(name), decision="mht", mht_scans=30, initiation="labelled", deletion_misses=0
    )
    ring.initialise(initial_tracks(2))
    for scan in simulated(9, seed=6):
        scan.stamp_ns -= 89 * SECOND
        ring.process(scan)
    told, delayed = ring.smoother.tracks(), ring.rest_of_delayed()
    assert len(told) == len(delayed) == 9
    for one, other in zip(told, delayed, strict=True):
        np.testing.assert_array_equal(one.track_id, other.track_id)
        np.testing.assert_allclose(one.mean, other.mean, rtol=1e-12)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-12)


@pytest.mark.parametrize("decision", ["gda", "map", "jpda"])
def test_tracks_live_as_long_as_online_and_are_known_better(decision):
    ring = smoothing_ring(decision=decision)
    online = [ring.process(scan).tracks for scan in simulated(25, seed=9)]
    told = ring.smoother.tracks()
    better = 0
    for k, (one, before) in enumerate(zip(told, online, strict=True)):
        np.testing.assert_array_equal(one.track_id, before.track_id)
        np.testing.assert_array_equal(one.status, before.status)
        assert one.key == before.key
        later = online[k + 1].track_id if k + 1 < len(online) else []
        for row, track in enumerate(one.track_id):
            if track not in later:
                # Nothing came after it.
                np.testing.assert_array_equal(one.mean[row], before.mean[row])
            elif decision != "jpda":
                gain = before.covariance[row] - one.covariance[row]
                assert np.linalg.eigvalsh(gain).min() > -1e-6
                better += 1
    ended = {int(i) for t in online for i in t.deleted_track_id}
    assert ended
    assert better > 20 or decision == "jpda"


def test_scans_that_wait_for_each_other_are_all_kept():
    """A reorder window works off several scans at once."""
    ring, plain = smoothing_ring(reorder_window_s=2.5), smoothing_ring()
    for scan in simulated(12, seed=4):
        ring.feed(scan)
        plain.process(scan)
    ring.finish()
    told, expected = ring.smoother.tracks(), plain.smoother.tracks()
    assert len(told) == len(expected) == 12
    for one, other in zip(told, expected, strict=True):
        np.testing.assert_array_equal(one.mean, other.mean)
