"""Recordings with an earlier definition of our messages."""

import math
import re

import message_examples as examples
import numpy as np
import pytest
from message_examples import assert_identical
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gda_tracker.io import bag_types, messages
from gda_tracker.io.bags import Bag, BagError, DamagedBagWarning, read_bag
from gda_tracker.resources import resource

KIND = "gda_tracker_msgs/msg/DetectionArray"
NEW_FIELDS = (
    "attribute_names",
    "attribute_values",
    "attribute_valid",
    "sensor_velocity_mps",
    "reference_position_m",
    "reference_velocity_mps",
)


def store_with(change):
    """Return a type store in which the definition of ``DetectionArray`` is changed."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text = (resource("msg_schemas", "msg") / "DetectionArray.msg").read_text(encoding="utf-8")
    store.register(get_types_from_msg(change(text), KIND))
    return store


def without_the_new_fields(text):
    later = r"attribute_\w+|reference_\w+|sensor_velocity_mps"
    return re.sub(rf"(?m)^.*\] ({later}) .*\n", "", text)


def write(path, change, plugin=StoragePlugin.MCAP, count=3):
    """Write scans with a changed definition; return them as they should come back."""
    store = store_with(change)
    written = []
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("detections", KIND, typestore=store)
        for number in range(count):
            scan = examples.detections(number + 2)
            scan.stamp_ns += number
            for name in NEW_FIELDS:
                setattr(scan, name, () if name == "attribute_names" else None)
            message = bag_types._store_message(messages.detections_to_message(scan), KIND, store)
            writer.write(connection, scan.stamp_ns, store.serialize_cdr(message, KIND))
            written.append(scan)
    return written


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_an_earlier_definition_is_read_with_the_new_fields_empty(tmp_path, plugin):
    written = write(tmp_path / "bag", without_the_new_fields, plugin)
    records = list(read_bag(tmp_path / "bag"))
    assert [record.stamp_ns for record in records] == [scan.stamp_ns for scan in written]
    for record, scan in zip(records, written, strict=True):
        # In the class of rosbags, in that of rclpy, and as the bytes of the present definition.
        assert_identical(messages.detections_from_message(record.message()), scan)
        assert_identical(messages.detections_from_message(record.ros_message()), scan)
        assert record.data == bag_types.serialize(messages.detections_to_message(scan))


def test_an_earlier_definition_in_a_cut_file_is_read(tmp_path):
    written = write(tmp_path / "bag", without_the_new_fields)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    (mcap,) = (tmp_path / "bag").glob("*.mcap")
    content = mcap.read_bytes()
    mcap.write_bytes(content[: len(content) - 30])
    with pytest.warns(DamagedBagWarning):
        records = list(read_bag(tmp_path / "bag"))
    assert len(records) == len(written)
    assert_identical(messages.detections_from_message(records[0].message()), written[0])


def test_fields_in_another_order_are_read(tmp_path):
    def reordered(text):
        text = without_the_new_fields(text)
        return text.replace("string sensor_id", "#").replace(
            "uint64 seq", "string sensor_id\nuint64 seq"
        )

    written = write(tmp_path / "bag", reordered, count=1)
    (record,) = read_bag(tmp_path / "bag")
    assert_identical(messages.detections_from_message(record.message()), written[0])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: without_the_new_fields(text) + "float64[] colour\n",
        lambda text: text.replace("uint64 sequence", "uint32 sequence"),
        # A number that is missing has no value that stands for "not measured".
        lambda text: text.replace("uint64 sequence", "#"),
    ],
    ids=["unknown field", "other type", "number missing"],
)
def test_a_definition_that_is_no_earlier_one_is_refused(tmp_path, change):
    store = store_with(change)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("detections", KIND, typestore=store)
    with pytest.raises(
        BagError, match=f"detections was recorded with another definition of {KIND}$"
    ):
        Bag(tmp_path / "bag")


def test_bytes_that_are_no_message_of_the_earlier_definition_are_named(tmp_path):
    store = store_with(without_the_new_fields)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("detections", KIND, typestore=store)
        writer.write(connection, 5, bytes([0, 1, 0, 0, 1, 2, 3]))
    with pytest.raises(
        BagError, match=r"^topic detections, stamp 5: not a gda_tracker_msgs/msg/Det"
    ):
        list(Bag(tmp_path / "bag").records())


def test_messages_of_messages_are_upgraded(tmp_path):
    """Tracks without some fields of ``Track``, nested arrays of messages: empty arrays, NaN."""
    kind = "gda_tracker_msgs/msg/TrackArray"
    store = get_typestore(Stores.ROS2_JAZZY)
    folder, types = resource("msg_schemas", "msg"), {}
    for name in ("ScanKey", "Track", "TrackArray"):
        text = (folder / f"{name}.msg").read_text(encoding="utf-8")
        if name == "Track":
            text = re.sub(r"(?m)^float64(\[\] masses| existence_probability) .*\n", "", text)
        types.update(get_types_from_msg(text, f"gda_tracker_msgs/msg/{name}"))
    store.register(types)
    message = messages.tracks_to_message(examples.tracks(2))
    for track in message.tracks:
        track.masses, track.existence_probability = [], math.nan
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("tracks", kind, typestore=store)
        old = bag_types._store_message(message, kind, store)
        writer.write(connection, 7, store.serialize_cdr(old, kind))
    (record,) = read_bag(tmp_path / "bag")
    assert record.data == bag_types.serialize(message)
    np.testing.assert_array_equal(record.message().tracks[1].masses, [])
    assert math.isnan(record.message().tracks[1].existence_probability)
