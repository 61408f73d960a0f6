from __future__ import annotations

import message_examples as examples
import numpy as np
import pytest
from message_examples import FRAME, assert_identical
from rclpy.serialization import deserialize_message, serialize_message

from gda_tracker.evidence.frames import hyper_power_set, shafer_model
from gda_tracker.io.messages import MessageError, tracks_from_message, tracks_to_message
from gda_tracker.io.track_messages import focal_name, parse_focal_name

FREE = tuple(hyper_power_set(3).tolist())
SHAFER = tuple(dict.fromkeys(shafer_model(FRAME).reduce(hyper_power_set(3)).tolist()))[1:]


@pytest.mark.parametrize("focal", [FREE, SHAFER, (SHAFER[0], FREE[-1]), (7, 128 - 1)])
def test_masses_of_every_model_survive(focal):
    original = examples.tracks(3, focal)
    message = tracks_to_message(original)
    read = tracks_from_message(deserialize_message(serialize_message(message), type(message)))
    assert_identical(read, original)
    assert len(set(message.focal_elements)) == len(focal)


def test_names_are_for_people():
    original = examples.tracks(1, (0b1010101, 0b1110101, 0b1000100, 0b1111111, 0b1, 0b11, 0b100))
    names = tracks_to_message(original).focal_elements
    assert list(names) == ["VS", "VS|S&B", "VS&S", "VS|S|B", "<VS>", "<VS>|<S>", "<VS&S>"]


@pytest.mark.parametrize("mask", range(1, 128))
def test_every_mask_of_three_elements_has_its_own_name(mask):
    assert parse_focal_name(FRAME, focal_name(FRAME, mask)) == mask


@pytest.mark.parametrize("mask", [0, 128])
def test_masks_of_no_element_are_refused(mask):
    with pytest.raises(MessageError, match=f"focal mask {mask:#x}"):
        focal_name(FRAME, mask)


@pytest.mark.parametrize("name", ["XL", "", "<XL>", "<VS", "<VS>|S", "VS&", "<VS&S>|<>"])
def test_names_without_meaning_are_refused(name):
    message = tracks_to_message(examples.tracks(1, (1,)))
    message.focal_elements = [name]
    with pytest.raises(MessageError, match="focal_elements"):
        tracks_from_message(message)


@pytest.mark.parametrize("field", ["state", "covariance", "masses", "class_probability"])
def test_a_track_that_lacks_an_element_is_refused(field):
    message = tracks_to_message(examples.tracks(3, FREE[:3]))
    setattr(message.tracks[1], field, getattr(message.tracks[1], field)[:-1])
    with pytest.raises(MessageError, match=f"^{field} has"):
        tracks_from_message(message)


@pytest.mark.parametrize(
    ("field", "value"),
    [("hits", -1), ("status", 256), ("detection_index", 2**31), ("first_detection_ns", -1)],
)
def test_numbers_that_do_not_fit_are_refused(field, value):
    original = examples.tracks(2)
    values = np.array(getattr(original, field), dtype=np.int64)
    values[1] = value
    setattr(original, field, values)
    with pytest.raises(MessageError, match=field.removesuffix("_ns")):
        tracks_to_message(original)


def test_uuid_of_another_length_is_refused():
    original = examples.tracks(1)
    original.system_uuid = b"short"
    with pytest.raises(MessageError, match="system_uuid has 5 bytes, 16 expected"):
        tracks_to_message(original)
