from __future__ import annotations

import itertools
from dataclasses import replace

import message_examples as examples
import numpy as np
import pytest
from gda_tracker_msgs.msg import TrackArray
from message_examples import assert_identical
from rclpy.serialization import deserialize_message, serialize_message

from gda_tracker.io.messages import MessageError, tracks_from_message, tracks_to_message
from gda_tracker.io.track_cdr import tracks_to_cdr


@pytest.mark.parametrize(
    ("count", "state", "classes", "focal", "frame_id"),
    list(
        itertools.product(
            (0, 1, 2, 7), (2, 3, 4, 6), (0, 3), ((), (1, 3), (1, 3, 7)), ("m", "map4")
        )
    ),
)
def test_the_middleware_reads_what_it_would_have_written(count, state, classes, focal, frame_id):
    tracks = examples.tracks(count, focal)
    names = tuple(f"class {k}" for k in range(classes))
    tracks = replace(
        tracks,
        frame_id=frame_id,
        mean=examples.floats(count, state, seed=7),
        covariance=examples.floats(count, state, state, seed=8),
        class_names=names,
        class_probability=examples.floats(count, classes, seed=9),
    )
    message = tracks_to_message(tracks)
    # The middleware leaves padding as it finds it, and more than needed at the end.
    theirs, ours = serialize_message(message), tracks_to_cdr(tracks)
    assert len(ours) <= len(theirs)
    assert_identical(*(tracks_from_message(_read(content)) for content in (ours, theirs)))
    assert repr(_read(ours)) == repr(message)


def _read(content):
    return deserialize_message(content, TrackArray)


def test_tracks_survive():
    original = examples.tracks(5, (1, 3, 7))
    assert_identical(tracks_from_message(_read(tracks_to_cdr(original))), original)


def test_arrays_of_any_order_and_kind():
    original = examples.tracks(5, (1, 3, 7))
    strange = replace(
        original,
        mean=np.asfortranarray(original.mean),
        covariance=original.covariance.transpose(0, 2, 1).copy().transpose(0, 2, 1),
        hits=original.hits.astype(np.uint16),
        masses=np.repeat(original.masses, 2, axis=0)[::2],
    )
    assert tracks_to_cdr(strange) == tracks_to_cdr(original)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("hits", -1),
        ("misses", 2**32),
        ("status", 256),
        ("detection_index", 2**31),
        ("first_detection_ns", -1),
        ("last_detection_ns", 2**31 * 1_000_000_000),
    ],
)
def test_numbers_that_do_not_fit_are_refused_as_in_a_message(field, value):
    original = examples.tracks(2)
    values = np.array(getattr(original, field), dtype=np.int64)
    values[1] = value
    setattr(original, field, values)
    name = field.removesuffix("_ns")
    with pytest.raises(MessageError, match=name) as one:
        tracks_to_cdr(original)
    with pytest.raises(MessageError, match=name) as other:
        tracks_to_message(original)
    assert str(one.value).split(":")[0].split()[0] == str(other.value).split(":")[0].split()[0]
