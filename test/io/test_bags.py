from __future__ import annotations

import dataclasses
import json
import os
import sqlite3
import struct
import sys
import warnings
from pathlib import Path

import message_examples as examples
import pytest
import yaml
from message_examples import assert_identical

from gda_tracker.io import bag_types, messages
from gda_tracker.io.bag_types import MissingLibraryError
from gda_tracker.io.bags import Bag, BagError, BagTopic, BagWriter, DamagedBagWarning, read_bag
from gda_tracker.resources import resource

DETECTIONS = BagTopic("detections", "gda_tracker_msgs/msg/DetectionArray", depth=100)
SCANS = BagTopic("scans", "gda_tracker_msgs/msg/Scan", depth=1, transient_local=True)
TRUTH = BagTopic("truth", "gda_tracker_msgs/msg/ScanTruth", reliable=False)
OUR_TYPES = [
    f"gda_tracker_msgs/msg/{path.stem}" for path in resource("msg_schemas/msg").glob("*.msg")
]


def write_example(path: Path, count: int = 20) -> None:
    """Write a bag of three topics, one chunk for each quarter of the messages."""
    with BagWriter(path, [DETECTIONS, SCANS, TRUTH]) as bag:
        for number in range(count):
            bag.write("detections", messages.detections_to_message(examples.detections()), number)
            bag.write("scans", messages.scan_to_message(examples.scan(number)), number)
            bag.write("truth", messages.scan_truth_to_message(examples.scan_truth()), number)
            if number % max(count // 4, 1) == 0:
                bag.flush()


def the_mcap(path: Path) -> Path:
    (found,) = path.glob("*.mcap")
    return found


# --- writing and reading --------------------------------------------------------------------------


def test_what_is_written_is_read(tmp_path):
    write_example(tmp_path / "bag")
    records = list(read_bag(tmp_path / "bag"))
    assert [record.topic for record in records] == ["detections", "scans", "truth"] * 20
    assert [record.stamp_ns for record in records] == sorted(list(range(20)) * 3)
    assert_identical(messages.detections_from_message(records[0].message()), examples.detections())
    assert_identical(messages.scan_from_message(records[7].message()), examples.scan(2))
    assert_identical(messages.scan_truth_from_message(records[5].message()), examples.scan_truth())


EVERY = {
    "DetectionArray": examples.detections(),
    "Scan": examples.scan(),
    "Evidence": examples.evidence(),
    "Predictions": examples.predictions(),
    "AttributeScores": examples.attribute_scores(),
    "Associations": examples.associations(),
    "TrackArray": examples.tracks(),
    "TrackSetArray": examples.track_sets(),
    "Statement": examples.statement(),
    "StatementReport": examples.statement_report(),
    "ScanReport": examples.scan_report(),
    "ScanTruth": examples.scan_truth(),
}
STEMS = {
    "DetectionArray": "detections",
    "Scan": "scan",
    "Evidence": "evidence",
    "Predictions": "predictions",
    "AttributeScores": "attribute_scores",
    "Associations": "associations",
    "TrackArray": "tracks",
    "TrackSetArray": "track_sets",
    "Statement": "statement",
    "StatementReport": "statement_report",
    "ScanReport": "scan_report",
    "ScanTruth": "scan_truth",
}


@pytest.mark.parametrize("name", EVERY)
def test_every_message_survives_a_bag_in_both_classes(tmp_path, name):
    from_message = getattr(messages, f"{STEMS[name]}_from_message")
    message = getattr(messages, f"{STEMS[name]}_to_message")(EVERY[name])
    with BagWriter(tmp_path / "bag", [BagTopic("t", f"gda_tracker_msgs/msg/{name}")]) as bag:
        bag.write("t", message, 1)
    (record,) = read_bag(tmp_path / "bag")
    assert_identical(from_message(record.message()), EVERY[name])
    assert_identical(from_message(record.ros_message()), EVERY[name])


def test_bytes_of_the_middleware_are_written_as_they_are(tmp_path):
    from rclpy.serialization import serialize_message

    # This function, unlike a topic, may leave bytes behind the message: of nested ones many.
    scan = dataclasses.replace(examples.scan(), statements=())
    data = serialize_message(messages.scan_to_message(scan))
    with BagWriter(tmp_path / "bag", [SCANS]) as bag:
        bag.write("scans", data, 5)
    (record,) = read_bag(tmp_path / "bag")
    assert record.data == data
    assert_identical(messages.scan_from_message(record.message()), scan)


def test_messages_of_other_packages(tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from visualization_msgs.msg import Marker, MarkerArray

    status = DiagnosticStatus(level=b"\x02", name="ring", values=[KeyValue(key="late", value="3")])
    marker = Marker(ns="tracks", id=7, text="boat")
    topics = [
        BagTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
        BagTopic("markers", "visualization_msgs/msg/MarkerArray"),
    ]
    with BagWriter(tmp_path / "bag", topics) as bag:
        bag.write("/diagnostics", DiagnosticArray(status=[status]), 1)
        bag.write("markers", MarkerArray(markers=[marker]), 2)
    first, second = read_bag(tmp_path / "bag")
    assert first.ros_message().status == [status]
    assert second.ros_message().markers == [marker]


def test_equal_messages_give_equal_files(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_example(tmp_path / name / "bag")
    for file in ("bag.mcap", "metadata.yaml"):
        left, right = (tmp_path / name / "bag" / file for name in ("a", "b"))
        assert left.read_bytes() == right.read_bytes()


def test_only_the_topics_asked_for(tmp_path):
    write_example(tmp_path / "bag")
    assert {record.topic for record in read_bag(tmp_path / "bag", ["truth"])} == {"truth"}
    assert list(read_bag(tmp_path / "bag", ["nothing"])) == []


def test_metadata_is_what_ros2_bag_play_needs(tmp_path):
    write_example(tmp_path / "bag")
    metadata = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == [the_mcap(tmp_path / "bag").name]
    assert information["message_count"] == 60
    topics = {
        item["topic_metadata"]["name"]: item["topic_metadata"]
        for item in information["topics_with_message_count"]
    }
    assert topics["scans"]["serialization_format"] == "cdr"
    (profile,) = topics["scans"]["offered_qos_profiles"]
    assert (profile["reliability"], profile["durability"]) == ("reliable", "transient_local")
    assert (profile["history"], profile["depth"]) == ("keep_last", 1)
    (profile,) = topics["truth"]["offered_qos_profiles"]
    assert (profile["reliability"], profile["durability"]) == ("best_effort", "volatile")
    for name, topic in (("scans", SCANS), ("truth", TRUTH), ("detections", DETECTIONS)):
        assert topics[name]["type_description_hash"] == bag_types.type_hash(topic.type)
        assert Bag(tmp_path / "bag").topics[name] == topic


def test_notes_are_kept_and_read_where_messages_are_damaged(tmp_path):
    with BagWriter(tmp_path / "bag", [SCANS], {"preset": "x", "origin": 'a: "b"'}) as bag:
        bag.write("scans", messages.scan_to_message(examples.scan()), 1)
        bag.flush()
    mcap = the_mcap(tmp_path / "bag")
    mcap.write_bytes(mcap.read_bytes()[:-20])
    for path in (tmp_path / "bag", mcap):
        assert Bag(path).notes == {"preset": "x", "origin": 'a: "b"'}
    other = mcap.with_name("other.mcap")
    mcap.rename(other)
    assert Bag(other).notes == {}
    (tmp_path / "bag" / "metadata.yaml").write_text("[]")
    assert Bag(other).notes == {}


def test_a_bag_without_messages(tmp_path):
    with BagWriter(tmp_path / "bag", [SCANS]):
        pass
    assert list(read_bag(tmp_path / "bag")) == []


# --- types ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OUR_TYPES)
def test_type_hashes_are_those_of_the_built_package(name):
    share = Path(sys.prefix) / "share" / "gda_tracker_msgs" / "msg"
    if not share.is_dir():
        from ament_index_python.packages import get_package_share_directory

        share = Path(get_package_share_directory("gda_tracker_msgs")) / "msg"
    built = json.loads((share / f"{name.split('/')[-1]}.json").read_text())
    hashes = {item["type_name"]: item["hash_string"] for item in built["type_hashes"]}
    assert bag_types.type_hash(name) == hashes[name]


def test_type_hash_is_what_the_middleware_announces():
    import rclpy
    from gda_tracker_msgs.msg import TrackArray

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=90)
    try:
        node = rclpy.create_node("bag_types", context=context)
        node.create_publisher(TrackArray, "tracks", 10)
        (information,) = node.get_publishers_info_by_topic("tracks")
        announced = str(information.topic_type_hash)
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    assert announced == bag_types.type_hash("gda_tracker_msgs/msg/TrackArray")


def test_another_definition_of_our_type_is_refused(tmp_path):
    write_example(tmp_path / "bag", 2)
    metadata = tmp_path / "bag" / "metadata.yaml"
    text = metadata.read_text()
    right = bag_types.type_hash("gda_tracker_msgs/msg/Scan")
    metadata.write_text(text.replace(right, right[:-1] + ("0" if right[-1] != "0" else "1")))
    with pytest.raises(BagError, match=r"another definition of gda_tracker_msgs/msg/Scan$"):
        list(read_bag(tmp_path / "bag"))


def test_another_definition_is_seen_without_metadata(tmp_path):
    write_example(tmp_path / "bag", 2)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    mcap = the_mcap(tmp_path / "bag")
    mcap.write_bytes(mcap.read_bytes().replace(b"float64[] rcs_m2", b"float64[] rcs_km"))
    with pytest.raises(BagError, match="another definition"):
        list(read_bag(tmp_path / "bag"))


def test_a_type_that_only_the_bag_knows_is_read(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg

    store = bag_types.new_type_store()
    store.register(get_types_from_msg("float32 speed\nstring name", "foreign_msgs/msg/Ship"))
    ship = store.types["foreign_msgs/msg/Ship"](speed=2.5, name="Piren")
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("ship", "foreign_msgs/msg/Ship", typestore=store)
        writer.write(connection, 4, store.serialize_cdr(ship, "foreign_msgs/msg/Ship"))
    (record,) = read_bag(tmp_path / "bag")
    assert (record.message().speed, record.message().name) == (2.5, "Piren")


# --- damage ---------------------------------------------------------------------------------------


def read_with_warning(path: Path) -> tuple[list, str]:
    with pytest.warns(DamagedBagWarning) as caught:
        records = list(read_bag(path))
    assert len(caught) == 1
    text = str(caught[0].message)
    assert "\n" not in text
    return records, text


def test_a_bag_without_metadata_is_read_to_the_end(tmp_path):
    write_example(tmp_path / "bag")
    expected = list(read_bag(tmp_path / "bag"))
    (tmp_path / "bag" / "metadata.yaml").unlink()
    records, text = read_with_warning(tmp_path / "bag")
    assert records == expected
    assert "no metadata.yaml. Read 60 messages, the last of 19 ns" in text


def test_a_single_file_is_a_bag(tmp_path):
    write_example(tmp_path / "bag")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(read_bag(the_mcap(tmp_path / "bag")))) == 60


@pytest.mark.parametrize("metadata", [True, False])
def test_a_bag_cut_anywhere_gives_a_prefix_of_its_messages(tmp_path, metadata):
    write_example(tmp_path / "bag")
    expected = list(read_bag(tmp_path / "bag"))
    mcap = the_mcap(tmp_path / "bag")
    data = mcap.read_bytes()
    if not metadata:
        (tmp_path / "bag" / "metadata.yaml").unlink()
    lengths = []
    for share in (0.3, 0.5, 0.7, 0.9, 0.999):
        mcap.write_bytes(data[: int(share * len(data))])
        records, text = read_with_warning(tmp_path / "bag")
        assert records == expected[: len(records)]
        assert f"Read {len(records)} messages, the last of {records[-1].stamp_ns} ns" in text
        assert mcap.name in text
        lengths.append(len(records))
    assert lengths == sorted(lengths)
    assert 0 < lengths[0] < lengths[1]
    assert lengths[-1] == 60


def test_every_cut_of_a_small_bag_ends_in_words(tmp_path):
    write_example(tmp_path / "bag", 3)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    mcap = the_mcap(tmp_path / "bag")
    data = mcap.read_bytes()
    seen = set()
    for size in range(0, len(data), 97):
        mcap.write_bytes(data[:size])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            error, count = "", 0
            try:
                count = len(list(read_bag(tmp_path / "bag")))
            except BagError as caught_error:
                error = str(caught_error)
        if error:
            assert error.startswith(f"{tmp_path / 'bag'} is not a readable bag: ")
        else:
            assert [item.category for item in caught] == [DamagedBagWarning]
        seen.add(count)
    assert seen >= {0, 1, 2, 3, 9}


def test_a_bag_whose_writer_was_killed_has_what_was_flushed(tmp_path):
    bag = BagWriter(tmp_path / "bag", [SCANS])
    for number in range(5):
        bag.write("scans", messages.scan_to_message(examples.scan(number)), number)
    bag.flush()
    bag.write("scans", messages.scan_to_message(examples.scan(5)), 5)
    records, text = read_with_warning(tmp_path / "bag")
    assert [record.stamp_ns for record in records] == [0, 1, 2, 3, 4]
    assert "no metadata.yaml" in text
    bag.close()
    assert len(list(read_bag(tmp_path / "bag"))) == 6


def compressed_bag(path: Path) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    data = bag_types.serialize(messages.scan_to_message(examples.scan()))
    with writer:
        connection = writer.add_connection("scans", SCANS.type, typestore=bag_types.type_store())
        for number in range(9):
            writer.write(connection, number, data)
            if number % 3 == 2:
                writer.storage.close_chunk()


def test_a_compressed_bag_that_is_cut_gives_its_whole_chunks(tmp_path):
    compressed_bag(tmp_path / "bag")
    assert len(list(read_bag(tmp_path / "bag"))) == 9
    mcap = the_mcap(tmp_path / "bag")
    data = mcap.read_bytes()
    chunks = [index for index in range(len(data)) if data[index : index + 4] == b"\x28\xb5\x2f\xfd"]
    mcap.write_bytes(data[: chunks[2] + 5])
    records, text = read_with_warning(tmp_path / "bag")
    assert len(records) == 6
    assert "compressed chunk" in text
    mcap.write_bytes(data[: chunks[1]] + b"\0" * 4 + data[chunks[1] + 4 : -8])
    records, text = read_with_warning(tmp_path / "bag")
    assert len(records) == 3
    assert "cannot be decompressed" in text


def sqlite_bag(path: Path, count: int = 300) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    data = bag_types.serialize(messages.scan_to_message(examples.scan(40)))
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("scans", SCANS.type, typestore=bag_types.type_store())
        for number in range(count):
            writer.write(connection, number, data)
    (found,) = path.glob("*.db3")
    return found


def test_sqlite_bags_are_read(tmp_path):
    sqlite_bag(tmp_path / "bag")
    records = list(read_bag(tmp_path / "bag"))
    assert [record.stamp_ns for record in records] == list(range(300))
    assert_identical(messages.scan_from_message(records[-1].message()), examples.scan(40))


def test_a_sqlite_bag_that_is_cut_gives_a_prefix(tmp_path):
    file = sqlite_bag(tmp_path / "bag")
    data = file.read_bytes()
    (page_size,) = struct.unpack_from(">H", data, 16)
    lengths = []
    for share in (0.5, 0.8):
        pages = int(share * len(data) / page_size)
        file.write_bytes(data[: pages * page_size])
        records, text = read_with_warning(tmp_path / "bag")
        assert [record.stamp_ns for record in records] == list(range(len(records)))
        assert f"Read {len(records)} messages" in text
        lengths.append(len(records))
    assert 0 < lengths[0] < lengths[1] < 300


@pytest.mark.parametrize(
    ("name", "content"),
    [("empty.mcap", b""), ("noise.mcap", b"not a bag" * 9), ("noise.db3", b"x" * 999)],
)
def test_files_that_are_no_bags_give_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError) as caught:
        list(read_bag(tmp_path / name))
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_folder_that_is_no_bag(tmp_path):
    with pytest.raises(BagError, match=r"is not a readable bag: it has no metadata.yaml$"):
        list(read_bag(tmp_path))
    with pytest.raises(BagError, match=r"nowhere does not exist$"):
        list(read_bag(tmp_path / "nowhere"))


def test_bytes_that_are_no_message_are_named(tmp_path):
    with BagWriter(tmp_path / "bag", [SCANS]) as bag:
        bag.write("scans", b"\x00\x01\x00\x00abc", 3)
    (record,) = read_bag(tmp_path / "bag")
    with pytest.raises(BagError, match="topic scans, stamp 3: not a gda_tracker_msgs/msg/Scan"):
        record.message()


# --- misuse of the writer -------------------------------------------------------------------------


def test_writer_errors_are_named(tmp_path):
    scan = messages.scan_to_message(examples.scan())
    with BagWriter(tmp_path / "bag", [DETECTIONS]) as bag:
        with pytest.raises(BagError, match="topic scans was not announced"):
            bag.write("scans", scan, 1)
        with pytest.raises(BagError, match="is gda_tracker_msgs/msg/DetectionArray, not gda"):
            bag.write("detections", scan, 1)
        with pytest.raises(BagError, match="negative stamp -1"):
            bag.write("detections", b"", -1)
        with pytest.raises(BagError, match="unknown type a/msg/B"):
            bag.add_topic(BagTopic("x", "a/msg/B"))
        with pytest.raises(BagError, match="already there"):
            bag.add_topic(BagTopic("detections", SCANS.type))
        bag.add_topic(DETECTIONS)
    with pytest.raises(BagError, match="exists already"):
        BagWriter(tmp_path / "bag")


def test_a_missing_library_is_named_with_its_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    for use in (lambda: list(read_bag(tmp_path)), lambda: BagWriter(tmp_path / "new")):
        with pytest.raises(MissingLibraryError, match=r"pip install gda_tracker\[bags\]"):
            use()


def test_sqlite_files_of_other_programs(tmp_path):
    connection = sqlite3.connect(tmp_path / "other.db3")
    connection.execute("CREATE TABLE t (a INTEGER)")
    connection.commit()
    connection.close()
    with pytest.raises(BagError, match="is not a readable bag"):
        list(read_bag(tmp_path / "other.db3"))
