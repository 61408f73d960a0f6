"""Fused tracks and associations as messages and back; what does not fit is refused."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from gda_tracker.fusion.fuser import TrackFuser
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.io.fields import MessageError
from gda_tracker.io.fusion_messages import (
    fused_tracks_from_message,
    fused_tracks_to_message,
    track_associations_from_message,
    track_associations_to_message,
)
from gda_tracker.simulation.kalman_radars import KalmanRadars


@pytest.fixture(scope="module")
def fusions():
    """One with targets of one radar, of both, and no target at all."""
    seen = np.array([[True, True, False], [False, True, True]])
    radars = KalmanRadars(1, [[0.0, 0.0], [-800.0, 600.0]], n_targets=3, seen=seen)
    fuser = TrackFuser(TrackFusionParameters())
    belief = np.tile([0.1, 0.6, 0.3], (3, 1))
    made = []
    for _ in range(3):
        radars.step()
        for radar, name in enumerate(("radar_1", "radar_2")):
            made += fuser.take(name, radars.message(radar, belief))
    radars.seen[:] = False
    radars.step()
    for radar, name in enumerate(("radar_1", "radar_2")):
        made += fuser.take(name, radars.message(radar))
    assert [len(fused) for fused, _ in made] == [2, 3, 3, 0]
    return made


def test_there_and_back_nothing_changes(fusions):
    for fused, found in fusions:
        for sent, back in (
            (fused, fused_tracks_from_message(fused_tracks_to_message(fused))),
            (found, track_associations_from_message(track_associations_to_message(found))),
        ):
            for item in fields(sent):
                one, other = getattr(sent, item.name), getattr(back, item.name)
                np.testing.assert_array_equal(one, other, err_msg=item.name)


@pytest.mark.parametrize("name", ["state", "covariance", "class_probability", "track_ids"])
def test_fields_of_the_wrong_size_are_refused(fusions, name):
    message = fused_tracks_to_message(fusions[1][0])
    setattr(message.tracks[0], name, getattr(message.tracks[0], name)[:-1])
    with pytest.raises(MessageError, match=name):
        fused_tracks_from_message(message)


def test_a_track_of_an_unknown_radar_is_refused(fusions):
    message = fused_tracks_to_message(fusions[1][0])
    message.tracks[0].radars = ["elsewhere"] * len(message.tracks[0].radars)
    with pytest.raises(MessageError, match="elsewhere"):
        fused_tracks_from_message(message)


@pytest.mark.parametrize(
    "name", ["pair_probability", "labels", "bias", "bias_covariance", "track_ids", "track_counts"]
)
def test_associations_of_the_wrong_size_are_refused(fusions, name):
    message = track_associations_to_message(fusions[1][1])
    setattr(message, name, getattr(message, name)[:-1])
    with pytest.raises(MessageError):
        track_associations_from_message(message)
