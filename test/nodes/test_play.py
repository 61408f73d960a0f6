"""The command ``play``: messages of a bag on their topics, in order, as they are."""

from __future__ import annotations

import signal
from itertools import pairwise

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from live_helpers import call, spinning_on
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header, String
from test_run_and_record import start, stop
from tf2_msgs.msg import TFMessage

from gda_tracker.io.bag_types import serialize, type_store
from gda_tracker.io.bags import Bag, BagRecord, BagTopic, BagWriter
from gda_tracker.io.messages import stamp_from_time, stamp_to_time
from gda_tracker.nodes.bag_player import BagPlayerNode, Turn, moved, quality_of
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.runner import Nodes

WAIT_S = 30.0
S = 1_000_000_000
FIRST_NS, STEP_NS, SCANS = 1_700_000_000 * S, S // 10, 12
POINTS, WORDS, STATIC = "/radar/points", "/words", "/tf_static"


def cloud(number):
    message = PointCloud2(height=1, width=number, point_step=4, row_step=4 * number)
    message.header.frame_id = "radar" * (1 + number % 2)
    # The radar stamps its scans a little before they are received.
    message.header.stamp = stamp_to_time(FIRST_NS + number * STEP_NS - 7_000_000)
    message.data = np.full(4 * number, number, np.uint8).tobytes()
    return serialize(message)


def transforms(parent):
    transform = TransformStamped(header=Header(frame_id=parent), child_frame_id="radar")
    transform.header.stamp = stamp_to_time(FIRST_NS)
    return serialize(TFMessage(transforms=[transform]))


@pytest.fixture
def bag(tmp_path):
    """Scans, words, transforms of two nodes, a clock, and a type that is not installed."""
    topics = [
        BagTopic(POINTS, "sensor_msgs/msg/PointCloud2"),
        BagTopic(WORDS, "std_msgs/msg/String", reliable=False),
        BagTopic(STATIC, "tf2_msgs/msg/TFMessage", depth=1),
        BagTopic("/clock", "rosgraph_msgs/msg/Clock"),
        BagTopic("/metrics", "statistics_msgs/msg/MetricsMessage"),
        BagTopic("/silent", "std_msgs/msg/String"),
    ]
    with BagWriter(tmp_path / "played", topics) as writer:
        for name in ("car", "boat"):
            writer.write(STATIC, transforms(name), FIRST_NS)
        writer.write("/clock", serialize(Clock()), FIRST_NS)
        writer.write("/metrics", b"\x00\x01\x00\x00\x00", FIRST_NS)
        writer.write(WORDS, b"\x00", FIRST_NS)
        for number in range(SCANS):
            writer.write(POINTS, cloud(number), FIRST_NS + number * STEP_NS)
            word = serialize(String(data=f"scan {number}"))
            writer.write(WORDS, word, FIRST_NS + number * STEP_NS)
    return tmp_path / "played"


class Listener(Node):
    """Keeps the bytes of what is published."""

    def __init__(self, late=False, **options):
        super().__init__("listener", **options)
        self.heard = {POINTS: [], WORDS: [], STATIC: [], "/clock": []}
        for topic, kind, quality in (
            (POINTS, PointCloud2, stream(1000)),
            (WORDS, String, stream(1000)),
            (STATIC, TFMessage, latched(10)),
            ("/clock", Clock, stream(10000)),
        ):
            if topic == WORDS:
                quality.reliability = ReliabilityPolicy.BEST_EFFORT
            self.create_subscription(kind, topic, self.heard[topic].append, quality, raw=True)

    def autostart(self):
        """Nothing to start."""


def stamp_of(data):
    return stamp_from_time(deserialize_message(data, PointCloud2).header.stamp)


def test_all_messages_arrive_in_order_and_as_they_are(domain, bag, capfd):
    with Nodes(lambda **o: [Listener(**o)], domain) as nodes:
        heard = nodes.nodes[0].heard
        with spinning_on(nodes):
            assert call("play", bag, "--rate", "5") == 0
        # What has arrived but was not taken yet.
        nodes.spin_until(lambda: len(heard[POINTS]) == len(heard[WORDS]) == SCANS, WAIT_S)
    assert heard[POINTS] == [cloud(number) for number in range(SCANS)]
    words = [deserialize_message(data, String).data for data in heard[WORDS]]
    assert words == [f"scan {number}" for number in range(SCANS)]
    assert heard[STATIC] == [transforms("car"), transforms("boat")]
    assert len(heard["/clock"]) == 1
    out, err = capfd.readouterr()
    assert f"{POINTS}: {SCANS} sensor_msgs/msg/PointCloud2" in out
    assert f"{2 * SCANS + 4} messages played" in out
    assert "/metrics is left out: statistics_msgs/msg/MetricsMessage is not installed here" in err
    assert f"{WORDS}: 1 messages are cut off" in err
    assert "/silent" not in out + err


def test_turns_go_on_in_time_until_it_is_told_to_stop(environment, bag):
    domain = int(environment["ROS_DOMAIN_ID"])
    options = ("--loop", "--restamp", "--clock", "--rate", "4", "--topic", POINTS, "tf_static")
    with Nodes(lambda **o: [Listener(**o)], domain) as nodes:
        heard = nodes.nodes[0].heard
        process = start(environment, "play", str(bag), *options)
        try:
            assert nodes.spin_until(lambda: len(heard[POINTS]) > 2 * SCANS + 2, WAIT_S)
            with Nodes(lambda **o: [Listener(**o)], domain) as late:
                static = late.nodes[0].heard[STATIC]
                assert late.spin_until(lambda: len(static) >= 2, WAIT_S)
        finally:
            said = stop(process, signal.SIGTERM)
    assert "messages played" in said
    assert heard[WORDS] == []
    stamps = [stamp_of(data) for data in heard[POINTS]]
    assert {b - a for a, b in pairwise(stamps)} <= {STEP_NS, STEP_NS + 1}
    first = deserialize_message(heard[POINTS][0], PointCloud2).width
    for number, data in enumerate(heard[POINTS], first):
        was = cloud(number % SCANS)
        # Between processes a message is filled up to a multiple of four bytes.
        assert 0 <= len(data) - len(was) < 4
        assert data[:4] + data[12 : len(was)] == was[:4] + was[12:]
    times = [stamp_from_time(deserialize_message(d, Clock).clock) for d in heard["/clock"]]
    assert all(b >= a for a, b in pairwise(times))
    assert max(b - a for a, b in pairwise(times)) <= STEP_NS
    # The stamps lie as far before the time of the clock as in the bag.
    received = {stamp + 7_000_000 for stamp in stamps}
    assert {time for time in received if times[0] <= time <= times[-1]} <= set(times)
    assert sum(times[0] <= time <= times[-1] for time in received) > SCANS


def test_what_cannot_be_played_is_named(environment, domain, bag, tmp_path, monkeypatch, capsys):
    assert call("play", bag, "--topic", "/radar/point") == 2
    assert "--topic /radar/point: not in" in capsys.readouterr().err
    assert call("play", bag, "--rate", "0") == 2
    assert "--rate 0.0: allowed is a number > 0" in capsys.readouterr().err
    assert call("play", tmp_path / "none") == 2
    assert "does not exist" in capsys.readouterr().err
    assert call("play", bag, "--topic", "/metrics") == 2
    assert "no message that can be played" in capsys.readouterr().err
    monkeypatch.setattr(Bag, "type_hash", lambda *_: "RIHS01_" + 64 * "0")
    with Nodes(lambda **o: [BagPlayerNode(Bag(bag), [POINTS], **o)], domain) as nodes:
        player = nodes.nodes[0]
        assert player.played_topics == ()
        assert "defined otherwise in the bag than here" in player.skipped[POINTS]


@pytest.mark.parametrize(
    ("topic", "reliable", "kept", "depth"),
    [
        (BagTopic("/points", "a/msg/B", depth=5, reliable=False), False, False, 10),
        (BagTopic("/points", "a/msg/B", depth=50), True, False, 50),
        (
            BagTopic("/scans", "a/msg/B", depth=1, transient_local=True, message_count=9),
            True,
            True,
            1,
        ),
        (BagTopic("/tf_static", "a/msg/B", depth=1, message_count=9), True, True, 9),
        (BagTopic("/car/tf_static", "a/msg/B", message_count=10**6), True, True, 1000),
    ],
)
def test_qualities_are_those_of_the_recording(topic, reliable, kept, depth):
    found = quality_of(topic)
    assert (found.reliability == ReliabilityPolicy.RELIABLE) == reliable
    assert (found.durability == DurabilityPolicy.TRANSIENT_LOCAL) == kept
    assert found.depth == depth


def record(kind, data):
    return BagRecord("/topic", kind, FIRST_NS, data, type_store())


def test_stamps_of_headers_and_transforms_are_moved():
    found = moved(record("sensor_msgs/msg/PointCloud2", cloud(3)), 5 * S + 1)
    assert stamp_of(found.data) == stamp_of(cloud(3)) + 5 * S + 1
    big = cloud(3)
    big = b"\x00\x00" + big[2:4] + big[4:8][::-1] + big[8:12][::-1]
    found = moved(record("sensor_msgs/msg/PointCloud2", big), 5 * S)
    assert int.from_bytes(found.data[4:8], "big") == stamp_of(cloud(3)) // S + 5
    found = moved(record("tf2_msgs/msg/TFMessage", transforms("car")), -S)
    (transform,) = deserialize_message(found.data, TFMessage).transforms
    assert stamp_from_time(transform.header.stamp) == FIRST_NS - S
    assert (transform.header.frame_id, transform.child_frame_id) == ("car", "radar")


@pytest.mark.parametrize(
    ("kind", "data", "shift_ns"),
    [
        ("std_msgs/msg/String", serialize(String(data="x" * 20)), S),
        ("sensor_msgs/msg/PointCloud2", serialize(PointCloud2()), S),
        ("sensor_msgs/msg/PointCloud2", cloud(1), 2**31 * S),
        ("sensor_msgs/msg/PointCloud2", cloud(1), -(2**31) * S),
        ("sensor_msgs/msg/PointCloud2", cloud(1)[:9], S),
        ("unknown_msgs/msg/Thing", cloud(1), S),
        ("tf2_msgs/msg/TFMessage", transforms("car"), 2**31 * S),
    ],
    ids=["no header", "unset", "too late", "too early", "cut", "unknown", "transform too late"],
)
def test_what_has_no_stamp_or_none_that_can_be_moved_stays(kind, data, shift_ns):
    assert moved(record(kind, data), shift_ns).data == data


def test_turns_follow_each_other_after_a_mean_interval():
    assert Turn(5 * S, 7 * S, 50, 41).period_ns == 2 * S + S // 20
    assert Turn(5 * S, 5 * S, 1, 1).period_ns == 1
    assert Turn(0, 0, 0, 0).period_ns == 1
