"""rosbag2 bags: MCAP and sqlite3, whole or damaged.

>>> with BagWriter("run", [BagTopic("tracks", "gda_tracker_msgs/msg/TrackArray")]) as bag:
...     bag.write("tracks", tracks_to_message(tracks), tracks.key.stamp_ns)  # doctest: +SKIP
>>> for record in read_bag("run"):
...     tracks = tracks_from_message(record.message())  # doctest: +SKIP
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from gda_tracker.io import bag_types
from gda_tracker.io.bag_salvage import SalvagedRow, salvage
from gda_tracker.io.bag_types import MissingLibraryError
from gda_tracker.io.bag_upgrade import Upgrade, upgrade_from
from gda_tracker.io.bag_writer import BagError, BagTopic, BagWriter
from gda_tracker.io.foreign_types import FOREIGN_MESSAGES, package_of

__all__ = [
    "Bag",
    "BagError",
    "BagRecord",
    "BagTopic",
    "BagWriter",
    "DamagedBagWarning",
    "MissingLibraryError",
    "read_bag",
]

METADATA = "metadata.yaml"


class DamagedBagWarning(UserWarning):
    """A bag is cut or incomplete: what was readable was read, the text says how far."""


@dataclass(frozen=True, slots=True)
class BagRecord:
    """One message in a bag, as the bytes in which it was sent.

    A message of an earlier definition of ours comes in the bytes of the present one.
    """

    topic: str
    type: str
    stamp_ns: int
    data: bytes
    store: Any = field(repr=False, compare=False)

    def message(self) -> Any:
        """Return the message in the rosbags library's own class, which needs no ROS.

        The ``..._from_message`` functions of :mod:`gda_tracker.io.messages` read it.

        Raises
        ------
        BagError
            If the bytes are not a message of this type.
        """
        from rosbags.serde import SerdeError

        try:
            return bag_types.deserialized(self.store, self.data, self.type)
        except (SerdeError, KeyError) as error:
            raise BagError(
                f"topic {self.topic}, stamp {self.stamp_ns}: not a {self.type} ({error})"
            ) from error

    def ros_message(self) -> Any:
        """Return the message in its rclpy class; its type must be built here."""
        from rclpy.serialization import deserialize_message

        return deserialize_message(self.data, bag_types.message_class(self.type))


class Bag:
    """A bag to read: a folder of rosbag2, or a single ``.mcap`` or ``.db3`` file.

    ``topics`` are its topics by name, ``notes`` the texts in its metadata (``custom_data``). A bag
    that is cut or lacks its metadata is read as far as it goes; ``damage`` then says what is wrong,
    else it is empty. Recordings with an earlier definition of our messages are read as if their
    fields that came later were empty.

    Raises
    ------
    BagError
        If nothing can be read, or a topic has a type of ours with a definition that is neither the
        present one nor an earlier one.
    MissingLibraryError
        If the rosbags library is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        bag_types.require_rosbags()
        self.path = Path(path)
        self.damage = ""
        self.topics: dict[str, BagTopic] = {}
        self.notes = _notes(self.path)
        self._store = bag_types.type_store()
        self._upgrades: dict[str, Upgrade] = {}
        self._salvaged: list[SalvagedRow] = []
        self._readable: list[Path] = []
        if not self.path.exists():
            raise BagError(f"{self.path} does not exist")
        reason = self._look_at(self.path)
        if reason:
            self.damage = reason
            self._look_at_the_files()
        if self.damage and not any(topic.message_count for topic in self.topics.values()):
            raise BagError(f"{self.path} is not a readable bag: {self.damage}")

    def records(self, topics: Collection[str] = ()) -> Iterator[BagRecord]:
        """Yield the messages, of some topics or all, in the order of their stamps in each file.

        Raises
        ------
        BagError
            If the bag turns out to be damaged where only its messages show it; the text says how
            many messages were read.
        """
        count, last = 0, None
        for path in self._readable:
            with self._reader(path) as reader:
                chosen = [item for item in reader.connections if self._wanted(item.topic, topics)]
                if not chosen:
                    continue
                messages = reader.messages(chosen)
                while True:
                    try:
                        connection, stamp, data = next(messages)
                    except StopIteration:
                        break
                    except Exception as error:  # whatever the library's parsers run into
                        raise BagError(
                            f"{path} is damaged: {_one_line(error)}; read {count} messages"
                            + (f", the last of {last} ns" if count else "")
                        ) from error
                    count, last = count + 1, stamp
                    yield self._record(connection.topic, connection.msgtype, stamp, bytes(data))
        for row in self._salvaged:
            if self._wanted(row.topic, topics):
                yield self._record(row.topic, row.type_name, row.stamp_ns, row.data)

    def type_hash(self, topic: str) -> str:
        """Return the RIHS01 hash of the type in which the messages of a topic come, or nothing."""
        try:
            return str(self._store.hash_rihs01(self.topics[topic].type))
        except KeyError:
            return ""  # the bag does not bring all of the definition

    def _record(self, topic: str, kind: str, stamp_ns: int, data: bytes) -> BagRecord:
        if topic in self._upgrades:
            from rosbags.serde import SerdeError

            try:
                data = self._upgrades[topic](data)
            except SerdeError as error:
                raise BagError(
                    f"topic {topic}, stamp {stamp_ns}: not a {kind} ({error})"
                ) from error
        return BagRecord(topic, kind, stamp_ns, data, self._store)

    @staticmethod
    def _wanted(topic: str, topics: Collection[str]) -> bool:
        return not topics or topic in topics

    @staticmethod
    def _reader(path: Path) -> Any:
        from rosbags.rosbag2 import Reader

        return Reader(path)

    def _look_at(self, path: Path) -> str:
        """Take the topics of a complete bag or file; return what is wrong with it, or nothing."""
        if path.is_dir() and not (path / METADATA).exists():
            return f"it has no {METADATA}"
        try:
            with self._reader(path) as reader:
                connections = list(reader.connections)
        except Exception as error:  # whatever the library's parsers run into
            return _one_line(error)
        for item in connections:
            self._add(item.topic, item.msgtype, item.digest, item.msgdef.data, item.msgcount, item)
        self._readable.append(path)
        return ""

    def _look_at_the_files(self) -> None:
        if self.path.is_dir():
            files = sorted([*self.path.glob("*.mcap"), *self.path.glob("*.db3")])
        else:
            files = [self.path] if self.path.suffix in (".mcap", ".db3") else []
        for path in files:
            if path != self.path and not self._look_at(path):
                continue
            found = salvage(path)
            if found.damage:
                self.damage += f"; {path.name}: {found.damage}"
            for row in found.rows:
                self._add(row.topic, row.type_name, "", row.definition, 1)
            self._salvaged += found.rows

    def _add(
        self, name: str, kind: str, digest: str, definition: str, count: int, connection: Any = None
    ) -> None:
        if name in self.topics:
            count += self.topics[name].message_count
        elif kind.startswith(f"{bag_types.PACKAGE}/"):
            self._require_same_definition(name, kind, digest, definition)
        elif definition and kind in FOREIGN_MESSAGES and self._differs(kind, digest, definition):
            # Other versions of the package: each bag brings its own definition.
            self._store = bag_types.new_type_store(without=[package_of(kind)])
            self._learn(kind, definition)
        elif kind not in self._store.fielddefs and definition:
            self._learn(kind, definition)
        self.topics[name] = _topic(name, kind, count, connection)

    def _require_same_definition(self, name: str, kind: str, digest: str, definition: str) -> None:
        if kind not in bag_types.type_store().fielddefs:
            raise BagError(f"{self.path}: topic {name} has the unknown type {kind}")
        if not digest and definition:
            digest = _hash_of(kind, definition)
        if digest and digest != bag_types.type_hash(kind):
            # A definition that is not the one of the hash says nothing about the messages.
            told = definition and _hash_of(kind, definition) == digest
            upgrade = upgrade_from(kind, definition) if told else None
            if upgrade is None:
                raise BagError(
                    f"{self.path}: topic {name} was recorded with another definition of {kind}"
                )
            self._upgrades[name] = upgrade

    def _differs(self, kind: str, digest: str, definition: str) -> bool:
        if kind not in self._store.fielddefs:
            return False
        return bool((digest or _hash_of(kind, definition)) != self._store.hash_rihs01(kind))

    def _learn(self, kind: str, definition: str) -> None:
        """Register a foreign type; where that fails its messages can be handed on but not read."""
        from rosbags.typesys import TypesysError, get_types_from_msg

        if self._store is bag_types.type_store():
            self._store = bag_types.new_type_store()
        with suppress(TypesysError):
            types = get_types_from_msg(definition, kind)
            known = self._store.fielddefs
            self._store.register({key: types[key] for key in types if key not in known})


def _notes(path: Path) -> dict[str, str]:
    """Return the notes in the metadata of a bag, also of one whose messages are damaged."""
    folder = path if path.is_dir() else path.parent
    try:
        content = yaml.safe_load((folder / METADATA).read_text(encoding="utf-8"))
        information = content["rosbag2_bagfile_information"]
        if path != folder and path.name not in information["relative_file_paths"]:
            return {}
        return {str(name): str(text) for name, text in (information["custom_data"] or {}).items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, yaml.YAMLError):
        return {}  # no notes; what is wrong with the metadata is found when the bag is opened


@lru_cache(maxsize=64)
def _hash_of(kind: str, definition: str) -> str:
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        types = get_types_from_msg(definition, kind)
        store.register({key: types[key] for key in types if key not in store.fielddefs})
        return str(store.hash_rihs01(kind))
    except (TypesysError, KeyError) as error:
        return f"none: {_one_line(error)}"


def _topic(name: str, kind: str, count: int, connection: Any) -> BagTopic:
    from rosbags.interfaces import QosDurability, QosReliability

    profiles = connection.ext.offered_qos_profiles if connection is not None else []
    if not profiles:
        return BagTopic(name, kind, message_count=count)
    profile = profiles[0]
    return BagTopic(
        name,
        kind,
        depth=profile.depth,
        reliable=profile.reliability != QosReliability.BEST_EFFORT,
        transient_local=profile.durability == QosDurability.TRANSIENT_LOCAL,
        message_count=count,
    )


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()).rstrip(".")
    return text or type(error).__name__


def _warn(text: str) -> None:
    warnings.warn(DamagedBagWarning(text), stacklevel=3)


def read_bag(
    path: str | Path, topics: Collection[str] = (), report: Callable[[str], None] = _warn
) -> Iterator[BagRecord]:
    """Yield the messages of a bag, of some topics or all.

    A damaged bag is read as far as it goes. A line at the end says how many messages were read and
    where it ended: a :class:`DamagedBagWarning`, or what else ``report`` makes of it.

    Raises
    ------
    BagError
        If nothing can be read.
    MissingLibraryError
        If the rosbags library is not installed.
    """
    bag = Bag(path)
    count, last, damage = 0, 0, bag.damage
    try:
        for record in bag.records(topics):
            count, last = count + 1, record.stamp_ns
            yield record
    except BagError as error:
        if not count:
            raise
        damage = f"{damage}; {error}".lstrip("; ")
    if damage:
        end = f", the last of {last} ns" if count else ""
        report(f"{bag.path} is damaged: {damage}. Read {count} messages{end}")
