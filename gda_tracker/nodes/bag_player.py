"""Playing the messages of a bag on their topics, as the bytes in which they were recorded."""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.type_support import NoTypeSupportImportedException
from rosgraph_msgs.msg import Clock

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.bags import Bag, BagError, BagRecord, BagTopic
from gda_tracker.io.messages import stamp_to_time
from gda_tracker.nodes.qualities import stream

NS_PER_S = 1_000_000_000
CLOCK = "/clock"
CLOCK_PERIOD_S = 0.02
LONGEST_WAIT_S = 0.1
# Subscribers that are there already are found within this; the last messages reach them within it.
SETTLE_S = 1.0
LEAST_DEPTH = 10
MOST_LATCHED = 1000
# A CDR header: its second byte says the order of bytes; the stamp of a message that begins with a
# std_msgs/Header follows it.
CDR_HEADER, STAMP_END = 4, 12
LATEST_S = 2**31 - 1
HEADER, TRANSFORMS = "std_msgs/msg/Header", "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True)
class Turn:
    """Bag times of the first and the last message that was played, and how many there were."""

    first_ns: int
    last_ns: int
    messages: int
    most_of_a_topic: int

    @property
    def period_ns(self) -> int:
        """From one turn to the next [ns]: the length, and a mean interval of the busiest topic."""
        length = max(self.last_ns - self.first_ns, 0)
        return length + max(length // max(self.most_of_a_topic - 1, 1), 1)


class BagPlayerNode(Node):
    """Publishes what a bag holds, with the qualities of service that it was recorded with.

    Topics whose type is not installed here, or has another definition here than in the bag, are
    left out; ``skipped`` names them with the reason. ``malformed`` counts messages, by topic, that
    are too short to be any.

    Parameters
    ----------
    bag
        The bag.
    topics
        Those to play; without them all.
    clock
        Publish the time of the bag on ``/clock``. Such a topic of the bag is then left out.
    """

    def __init__(
        self, bag: Bag, topics: Collection[str] = (), clock: bool = False, **options: Any
    ) -> None:
        super().__init__("bag_player", **options)
        self.skipped: dict[str, str] = {}
        self.malformed: Counter[str] = Counter()
        self._outputs: dict[str, Any] = {}
        self._clock_output = self.create_publisher(Clock, CLOCK, stream()) if clock else None
        for topic in bag.topics.values():
            if topic.message_count and (not topics or topic.name in topics):
                self._advertise(topic, bag.type_hash(topic.name))

    def autostart(self) -> None:
        """Nothing to start."""

    @property
    def played_topics(self) -> tuple[str, ...]:
        """Names of the topics that are published."""
        return tuple(self._outputs)

    def _advertise(self, topic: BagTopic, bag_hash: str) -> None:
        if topic.name == CLOCK and self._clock_output is not None:
            self.skipped[topic.name] = "the time comes from --clock"
            return
        try:
            kind = message_class(topic.type)
            publisher = self.create_publisher(kind, topic.name, quality_of(topic))
        except InvalidTopicNameException:
            self.skipped[topic.name] = "no name that a topic can have"
        except (ImportError, AttributeError, ValueError, NoTypeSupportImportedException):
            self.skipped[topic.name] = f"{topic.type} is not installed here"
        else:
            here = {
                str(info.topic_type_hash)
                for info in self.get_publishers_info_by_topic(publisher.topic_name)
                if info.node_name == self.get_name()
            }
            if bag_hash and here and bag_hash not in here:
                self.destroy_publisher(publisher)
                self.skipped[topic.name] = f"{topic.type} is defined otherwise in the bag than here"
            else:
                self._outputs[topic.name] = publisher

    def heard(self) -> bool:
        """Whether every topic has a subscriber, ``/clock`` too."""
        clock = [] if self._clock_output is None else [self._clock_output]
        return all(o.get_subscription_count() for o in (*self._outputs.values(), *clock))

    def play(
        self,
        records: Iterable[BagRecord],
        wait: Callable[[float], None],
        rate: float = 1.0,
        begun: float | None = None,
        start_ns: int | None = None,
    ) -> Turn:
        """Publish records at the pace of their times in the bag.

        Parameters
        ----------
        records
            Those of topics that are not in :attr:`played_topics` are passed over.
        wait
            Is called with seconds to wait, and may come back earlier.
        rate
            Seconds of the bag in a second.
        begun
            Monotonic time [s] at which the first message is due; without it now.
        start_ns
            Time [ns] that the first message shall have in place of its own; the stamps in headers
            are moved by as much. Without it messages stay as they are.
        """
        begun = time.monotonic() if begun is None else begun
        first_ns, last_ns, shift_ns, count = None, 0, 0, 0
        of_topic: Counter[str] = Counter()
        for record in records:
            if record.topic not in self._outputs:
                continue
            if first_ns is None:
                first_ns = last_ns = record.stamp_ns
                shift_ns = 0 if start_ns is None else start_ns - first_ns
            last_ns = max(last_ns, record.stamp_ns)
            due = begun + (record.stamp_ns - first_ns) / NS_PER_S / rate
            self._pause(due, record.stamp_ns + shift_ns, rate, wait)
            self._publish(record, None if start_ns is None else shift_ns)
            count += 1
            of_topic[record.topic] += 1
        return Turn(first_ns or 0, last_ns, count, max(of_topic.values(), default=0))

    def _pause(self, due: float, time_ns: int, rate: float, wait: Callable[[float], None]) -> None:
        """Wait for the monotonic time ``due`` [s], when it is ``time_ns``; the clock goes on."""
        longest = LONGEST_WAIT_S if self._clock_output is None else CLOCK_PERIOD_S
        while (left := due - time.monotonic()) > 0.0:
            wait(min(left, longest))
            left = max(due - time.monotonic(), 0.0)
            self._tell_time(time_ns - round(left * rate * NS_PER_S))
        self._tell_time(time_ns)

    def _publish(self, record: BagRecord, shift_ns: int | None) -> None:
        try:
            data = record.data if shift_ns is None else moved(record, shift_ns).data
        except BagError:
            data = b""
        if len(data) < CDR_HEADER:
            self.malformed[record.topic] += 1
        else:
            self._outputs[record.topic].publish(data)

    def _tell_time(self, stamp_ns: int) -> None:
        if self._clock_output is not None:
            self._clock_output.publish(Clock(clock=stamp_to_time(stamp_ns)))

    def close(self) -> None:
        """Give the last messages the time to arrive."""
        end = time.monotonic() + SETTLE_S
        for output in self._outputs.values():
            if output.get_subscription_count():
                left = max(end - time.monotonic(), 0.0)
                output.wait_for_all_acked(Duration(seconds=left))


def quality_of(topic: BagTopic) -> QoSProfile:
    """The quality of service to play a topic with: as it was recorded; static transforms latched.

    What was latched by several nodes has a single publisher here, which keeps it for all of them.
    """
    static = topic.name.endswith("/tf_static")
    latched = topic.transient_local or static
    depth = max(topic.depth, 1) if latched else max(topic.depth, LEAST_DEPTH)
    if static:
        depth = min(max(depth, topic.message_count), MOST_LATCHED)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=(
            ReliabilityPolicy.RELIABLE
            if topic.reliable or static
            else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def moved(record: BagRecord, shift_ns: int) -> BagRecord:
    """Return a record with the stamp of its header moved by a time, or of all of its transforms.

    Other messages stay as they are, as do stamps of zero, which say that there is none, and those
    that would leave the range of a stamp.

    Raises
    ------
    BagError
        If transforms cannot be read.
    """
    if record.type == TRANSFORMS:
        return _moved_transforms(record, shift_ns)
    fields = record.store.fielddefs.get(record.type, ((), ()))[1]
    if not fields or fields[0][1][1] != HEADER or len(record.data) < STAMP_END:
        return record
    order = "<" if record.data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", record.data, CDR_HEADER)
    if not seconds and not nanoseconds:
        return record
    stamp = divmod(seconds * NS_PER_S + nanoseconds + shift_ns, NS_PER_S)
    if not 0 <= stamp[0] <= LATEST_S:
        return record
    as_bytes = struct.pack(f"{order}iI", *stamp)
    return _with_data(record, record.data[:CDR_HEADER] + as_bytes + record.data[STAMP_END:])


def _moved_transforms(record: BagRecord, shift_ns: int) -> BagRecord:
    message = record.message()
    for transform in message.transforms:
        header = transform.header
        stamp_ns = header.stamp.sec * NS_PER_S + header.stamp.nanosec
        stamp = divmod(stamp_ns + shift_ns, NS_PER_S)
        if stamp_ns and 0 <= stamp[0] <= LATEST_S:
            header.stamp = type(header.stamp)(*stamp)
    return _with_data(record, bytes(record.store.serialize_cdr(message, record.type)))


def _with_data(record: BagRecord, data: bytes) -> BagRecord:
    return BagRecord(record.topic, record.type, record.stamp_ns, data, record.store)
