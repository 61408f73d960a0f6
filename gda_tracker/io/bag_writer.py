"""Writing rosbag2 bags as MCAP, by the rosbags library.

A bag written here can be played by ``ros2 bag play``: it has its ``metadata.yaml``, the definition
and hash of every type, and the quality of service each topic was offered with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.io import bag_types

METADATA_VERSION = 9  # of ROS 2 Jazzy


class BagError(UserError):
    """A bag cannot be written or read; the message is one line and names the bag."""


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic in a bag: its type, and the quality of service it is offered with (keep last)."""

    name: str
    type: str
    depth: int = 10
    reliable: bool = True
    transient_local: bool = False
    message_count: int = field(default=0, compare=False)


class BagWriter:
    """A new bag (a folder with one MCAP file), to be used in a ``with`` statement.

    Messages are gathered in chunks; :meth:`flush` puts what was written so far on the disk, so that
    a bag whose writer is killed can still be read (without its index).

    Parameters
    ----------
    path
        Folder of the bag; must not exist.
    topics
        Topics that are known from the start.
    notes
        Texts by name that go into the metadata (``custom_data``).

    Raises
    ------
    BagError
        If the folder exists already or cannot be made.
    MissingLibraryError
        If the rosbags library is not installed.
    """

    def __init__(
        self,
        path: str | Path,
        topics: Sequence[BagTopic] = (),
        notes: Mapping[str, str] | None = None,
    ) -> None:
        bag_types.require_rosbags()
        from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

        self.path = Path(path)
        self._connections: dict[str, Any] = {}
        self._pending = 0
        try:
            self._writer = Writer(
                self.path, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP
            )
            for name, text in (notes or {}).items():
                self._writer.set_custom_data(name, text)
            self._writer.open()
        except WriterError as error:
            raise BagError(f"{self.path} exists already: a bag needs a new folder") from error
        except OSError as error:
            raise BagError(f"{self.path} cannot be made: {error.strerror}") from error
        for topic in topics:
            self.add_topic(topic)

    def add_topic(self, topic: BagTopic) -> None:
        """Announce a topic; a second announcement of the same name must be equal.

        Raises
        ------
        BagError
            If the type is unknown, or the topic is known with another type or profile.
        """
        known = self._connections.get(topic.name)
        if known is not None:
            if known[0] != topic:
                raise BagError(f"{self.path}: topic {topic.name} is already there as {known[0]}")
            return
        store = bag_types.type_store()
        if topic.type not in store.fielddefs:
            raise BagError(f"{self.path}: topic {topic.name} has the unknown type {topic.type}")
        connection = self._writer.add_connection(
            topic.name, topic.type, typestore=store, offered_qos_profiles=[_profile(topic)]
        )
        self._connections[topic.name] = (topic, connection)

    def write(self, topic: str, message: Any, stamp_ns: int) -> None:
        """Write one message, or its CDR bytes, with the time it was received [ns].

        Raises
        ------
        BagError
            If the topic was not announced, has another type, or the stamp is negative.
        """
        if topic not in self._connections:
            raise BagError(f"{self.path}: topic {topic} was not announced")
        if stamp_ns < 0:
            raise BagError(f"{self.path}: topic {topic} has the negative stamp {stamp_ns}")
        announced, connection = self._connections[topic]
        if not isinstance(message, bytes | bytearray | memoryview):
            name = bag_types.type_name(message)
            if name != announced.type:
                raise BagError(f"{self.path}: topic {topic} is {announced.type}, not {name}")
            message = bag_types.serialize(message)
        self._writer.write(connection, int(stamp_ns), bytes(message))
        self._pending += 1

    def flush(self) -> None:
        """Put everything written so far on the disk."""
        if self._pending and self._writer.storage is not None:
            self._writer.storage.close_chunk()
            self._writer.storage.bio.flush()
            self._pending = 0

    def close(self) -> None:
        """Write index and metadata; the bag is complete afterwards. A second call does nothing."""
        if self._writer.storage is not None:
            self._writer.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _profile(topic: BagTopic) -> Any:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    infinite = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=topic.depth,
        reliability=QosReliability.RELIABLE if topic.reliable else QosReliability.BEST_EFFORT,
        durability=(
            QosDurability.TRANSIENT_LOCAL if topic.transient_local else QosDurability.VOLATILE
        ),
        deadline=infinite,
        lifespan=infinite,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=infinite,
        avoid_ros_namespace_conventions=False,
    )
