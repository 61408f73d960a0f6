"""What can still be read of a bag file that was cut: MCAP record by record, sqlite3 row by row.

The rosbags library refuses a file without its index or footer. Here the file is read from the front
as far as it goes (MCAP specification 1.0: a record is an opcode, a 64-bit length and its content).
"""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06


@dataclass(slots=True)
class SalvagedRow:
    """One message as it stands in the file."""

    topic: str
    type_name: str
    definition: str
    stamp_ns: int
    data: bytes


@dataclass(slots=True)
class Salvage:
    """All messages before the damage, in the order of the file, and the damage in words."""

    rows: list[SalvagedRow] = field(default_factory=list)
    damage: str = ""


class _Cut(Exception):
    """The file ends, or makes no sense, here."""


def salvage(path: Path) -> Salvage:
    """Read a damaged ``.mcap`` or ``.db3`` file as far as it goes.

    Returns
    -------
    Salvage
        Perhaps without a message; ``damage`` says where and why reading ended, and is empty if the
        file is complete.
    """
    found = Salvage()
    try:
        rows = _mcap_rows(path) if path.suffix == ".mcap" else _sqlite_rows(path)
        for row in rows:
            found.rows.append(row)
    except (_Cut, sqlite3.Error, struct.error, OSError) as error:
        found.damage = str(error)
    return found


# --- MCAP -----------------------------------------------------------------------------------------


def _text(data: bytes, start: int) -> tuple[str, int]:
    if start + 4 > len(data):
        raise _Cut("a text is cut")
    (size,) = struct.unpack_from("<I", data, start)
    end = start + 4 + size
    if end > len(data):
        raise _Cut("a text is cut")
    return data[start + 4 : end].decode("utf-8", "replace"), end


def _records(data: bytes, start: int, where: str) -> Iterator[tuple[int, bytes, int, bool]]:
    """Yield (opcode, content, offset, whether it is cut) of the records in ``data``."""
    while start < len(data):
        if start + 9 > len(data):
            raise _Cut(f"it ends inside a record {where}{start}")
        opcode, size = struct.unpack_from("<BQ", data, start)
        end = start + 9 + size
        yield opcode, data[start + 9 : end], start, end > len(data)
        if end > len(data):
            raise _Cut(f"it ends inside a record {where}{start}")
        start = end


def _mcap_rows(path: Path) -> Iterator[SalvagedRow]:
    data = path.read_bytes()
    if not data.startswith(_MAGIC):
        raise _Cut("it does not begin as an MCAP file" if data else "it is empty")
    schemas: dict[int, tuple[str, str]] = {}
    channels: dict[int, tuple[str, int]] = {}
    for opcode, content, offset, cut in _records(data, len(_MAGIC), "at byte "):
        if opcode == _FOOTER:
            return
        if opcode == _CHUNK:
            chunk = _chunk(content, cut, offset)
            for inner, inner_content, _, inner_cut in _records(
                chunk, 0, f"of the chunk at byte {offset}, "
            ):
                if not inner_cut:
                    yield from _row(inner, inner_content, schemas, channels)
        elif not cut:
            yield from _row(opcode, content, schemas, channels)
    raise _Cut(f"it ends without a footer at byte {len(data)}")


def _chunk(content: bytes, cut: bool, offset: int) -> bytes:
    if len(content) < 36:
        raise _Cut(f"it ends inside the chunk at byte {offset}")
    _, _, size, checksum = struct.unpack_from("<QQQI", content, 0)
    compression, start = _text(content, 28)
    records = content[start + 8 :]
    if compression and cut:
        raise _Cut(f"it ends inside the compressed chunk at byte {offset}")
    if compression:
        records = _decompress(records, compression, offset)
    if not cut and (len(records) != size or (checksum and zlib.crc32(records) != checksum)):
        raise _Cut(f"the chunk at byte {offset} does not match its checksum")
    return records


def _decompress(records: bytes, compression: str, offset: int) -> bytes:
    # with the packages that the rosbags library itself depends on
    if compression == "lz4":
        from lz4.frame import decompress

        damage: type[Exception] = RuntimeError
    elif compression == "zstd":
        try:
            from compression.zstd import ZstdError as damage
            from compression.zstd import decompress
        except ImportError:
            from backports.zstd import ZstdError as damage
            from backports.zstd import decompress
    else:
        raise _Cut(f"the chunk at byte {offset} has the unknown compression {compression!r}")
    try:
        return bytes(decompress(records))
    except damage as error:
        raise _Cut(f"the chunk at byte {offset} cannot be decompressed: {error}") from error


def _row(
    opcode: int,
    content: bytes,
    schemas: dict[int, tuple[str, str]],
    channels: dict[int, tuple[str, int]],
) -> Iterator[SalvagedRow]:
    if opcode == _SCHEMA:
        (number,) = struct.unpack_from("<H", content, 0)
        name, start = _text(content, 2)
        encoding, start = _text(content, start)
        definition, _ = _text(content, start)
        schemas[number] = (name, definition if encoding == "ros2msg" else "")
    elif opcode == _CHANNEL:
        number, schema = struct.unpack_from("<HH", content, 0)
        topic, _ = _text(content, 4)
        channels[number] = (topic, schema)
    elif opcode == _MESSAGE and len(content) >= 22:
        number, _, stamp_ns, _ = struct.unpack_from("<HIQQ", content, 0)
        if number in channels and channels[number][1] in schemas:
            topic, schema = channels[number]
            yield SalvagedRow(topic, *schemas[schema], stamp_ns, content[22:])


# --- sqlite3 --------------------------------------------------------------------------------------


def _sqlite_rows(path: Path) -> Iterator[SalvagedRow]:
    connection = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
    try:
        # without this, sqlite refuses a file that is shorter than its header says
        connection.execute("PRAGMA writable_schema=ON")
        topics = {
            number: (name, kind)
            for number, name, kind in connection.execute("SELECT id, name, type FROM topics")
        }
        for topic, stamp_ns, data in connection.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        ):
            if topic in topics:
                yield SalvagedRow(*topics[topic], "", int(stamp_ns), bytes(data))
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        size = connection.execute("PRAGMA page_size").fetchone()[0]
        (written,) = struct.unpack_from(">I", path.read_bytes()[:100], 28)
        if written > pages:
            raise _Cut(f"it has {pages * size} of {written * size} bytes")
    finally:
        connection.close()
