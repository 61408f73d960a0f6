"""Datagrams of ASTERIX made target reports and service messages, by the libasterix library.

A datagram is a row of data blocks, each with its category (one byte), its length (two bytes, these
three included) and records. EUROCONTROL, Specification for Surveillance Data Exchange, part 1
(structure), part 2b (category 034, edition 1.29) and part 4 (category 048, edition 1.32). Older
editions of both have the same items; later ones only added to them.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from gda_tracker.errors import UserError

TARGET_REPORTS, SERVICE_MESSAGES = 48, 34
NAUTICAL_MILE = 1852.0
TICKS_PER_SECOND = 128
TICK_NS = 10**9 // TICKS_PER_SECOND
NORTH_MARKER, SECTOR_CROSSING = 1, 2
HEADER_BYTES = 3
# Further quantities of a target report, NaN where it does not bring them.
QUANTITIES = (
    "detection_type",
    "mode_3a",
    "flight_level",
    "mode_s_address",
    "track_number",
    "psr_amplitude_dbm",
    "ssr_amplitude_dbm",
    "calculated_doppler_mps",
)
UNKNOWN = math.nan

Source = tuple[int, int]


class MissingAsterixError(UserError):
    """The library that decodes is not installed; the message names the command."""


@dataclass(frozen=True, slots=True)
class TargetReport:
    """One plot, category 048.

    ``time_ns`` is the time of day of detection, ``range_m`` the slant range, ``azimuth_deg``
    clockwise from North; ``values`` holds :data:`QUANTITIES`: the type of detection (I048/020), the
    codes of modes 3/A and S as whole numbers, the flight level (hundreds of feet), the track number
    that the radar gives, amplitudes [dBm], and the calculated Doppler speed [m/s].
    """

    source: Source
    time_ns: int
    range_m: float
    azimuth_deg: float
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ServiceMessage:
    """What the radar tells of itself, category 034.

    ``kind`` 1 is the passing of North, 2 that of a sector's edge, at ``azimuth_deg``. What a
    message does not bring is ``None``.
    """

    source: Source
    time_ns: int
    kind: int
    azimuth_deg: float | None = None
    rotation_period_s: float | None = None


Report = TargetReport | ServiceMessage


@lru_cache(maxsize=1)
def require_library() -> tuple[Any, Any, Any]:
    """Return the records of the two categories and the bits class of libasterix.

    Takes some seconds the first time: the library knows all categories in all editions.

    Raises
    ------
    MissingAsterixError
        If it is not installed, or the other library of the module name ``asterix`` is.
    """
    try:
        from asterix.base import Bits
        from asterix.generated import Cat_034_1_29, Cat_048_1_32
    except ImportError as error:
        raise MissingAsterixError(
            "ASTERIX needs the libasterix library: pip install gda_tracker[asterix]; the library "
            "asterix-decoder goes by the same module name and must not be installed beside it"
        ) from error
    return Cat_048_1_32, Cat_034_1_29, Bits


def split_blocks(payload: bytes, counts: Counter[str]) -> list[tuple[int, bytes]]:
    """Return category and records of each data block; what follows a wrong length is left out."""
    blocks, position = [], 0
    while position < len(payload):
        length = int.from_bytes(payload[position + 1 : position + HEADER_BYTES], "big")
        whole = len(payload) - position >= HEADER_BYTES
        if not whole or length <= HEADER_BYTES or position + length > len(payload):
            counts["malformed_datablock"] += 1
            break
        records = payload[position + HEADER_BYTES : position + length]
        blocks.append((payload[position], records))
        position += length
    return blocks


def decode(payload: bytes, counts: Counter[str]) -> list[Report]:
    """Decode a datagram.

    Parameters
    ----------
    payload
        Data blocks, one after the other.
    counts
        What is left out is added to it, by reason: ``malformed_datablock`` (a wrong length, with
        all that follows), ``malformed_records`` (a block that does not fit its category),
        ``other_category`` (blocks); and of single reports ``no_source``, ``no_time``,
        ``no_position``, ``bad_time``, ``no_detection`` (a track that the radar only predicts) and
        ``test_target`` (of a test or a fixed transponder).
    """
    target_reports, service_messages, bits = require_library()
    found: list[Report] = []
    for category, records in split_blocks(payload, counts):
        if category not in (TARGET_REPORTS, SERVICE_MESSAGES):
            counts["other_category"] += 1
            continue
        of_target = category == TARGET_REPORTS
        kind = target_reports if of_target else service_messages
        parsed = kind.cv_uap.parse(bits.from_bytes(records))
        if isinstance(parsed, ValueError):
            counts["malformed_records"] += 1
            continue
        for record in parsed:
            one = _target_report(record) if of_target else _service_message(record)
            if isinstance(one, str):
                counts[one] += 1
            else:
                found.append(one)
    return found


def _target_report(record: Any) -> TargetReport | str:
    """Return the report, or the reason why it is left out."""
    head = _source_and_time(record, "140")
    if isinstance(head, str):
        return head
    descriptor = record.get_item("020")
    kind = UNKNOWN
    if descriptor is not None:
        kind = float(descriptor.variation.get_item("TYP").as_uint())
        if kind == 0.0:
            return "no_detection"
        monitor = descriptor.variation.get_item("RAB").as_uint()
        test = descriptor.variation.get_item("TST")
        if monitor or (test is not None and test.as_uint()):
            return "test_target"
    position = record.get_item("040")
    if position is None:
        return "no_position"
    values = dict.fromkeys(QUANTITIES, UNKNOWN)
    values["detection_type"] = kind
    values |= _identity(record) | _signal(record)
    return TargetReport(
        *head,
        range_m=_quantity(position.variation.get_item("RHO"), "NM") * NAUTICAL_MILE,
        azimuth_deg=_quantity(position.variation.get_item("THETA"), "°"),
        values=values,
    )


def _service_message(record: Any) -> ServiceMessage | str:
    head = _source_and_time(record, "030")
    if isinstance(head, str):
        return head
    kind, azimuth, period = (record.get_item(name) for name in ("000", "020", "041"))
    return ServiceMessage(
        *head,
        kind=0 if kind is None else kind.as_uint(),
        azimuth_deg=None if azimuth is None else _quantity(azimuth, "°"),
        rotation_period_s=None if period is None else _quantity(period, "s"),
    )


def _source_and_time(record: Any, name: str) -> tuple[Source, int] | str:
    source, time = record.get_item("010"), record.get_item(name)
    if source is None:
        return "no_source"
    if time is None:
        return "no_time"
    ticks = time.as_uint()
    if ticks >= 86400 * TICKS_PER_SECOND:
        return "bad_time"
    codes = (source.variation.get_item("SAC").as_uint(), source.variation.get_item("SIC").as_uint())
    return codes, ticks * TICK_NS


def _identity(record: Any) -> dict[str, float]:
    """Codes and height, those that the radar calls invalid or garbled left out."""
    found = {}
    code, level = record.get_item("070"), record.get_item("090")
    if code is not None and not _flagged(code):
        found["mode_3a"] = float(code.variation.get_item("MODE3A").as_uint())
    if level is not None and not _flagged(level):
        found["flight_level"] = _quantity(level.variation.get_item("FL"), "FL")
    address, number = record.get_item("220"), record.get_item("161")
    if address is not None:
        found["mode_s_address"] = float(address.as_uint())
    if number is not None:
        found["track_number"] = float(number.variation.get_item("TRN").as_uint())
    return found


def _signal(record: Any) -> dict[str, float]:
    """Amplitudes and Doppler speed."""
    found = {}
    plot, doppler = record.get_item("130"), record.get_item("120")
    if plot is not None:
        for name, item in (("psr_amplitude_dbm", "PAM"), ("ssr_amplitude_dbm", "SAM")):
            amplitude = plot.variation.get_item(item)
            if amplitude is not None:
                found[name] = _quantity(amplitude, "dBm")
    calculated = None if doppler is None else doppler.variation.get_item("CAL")
    if calculated is not None and not calculated.variation.get_item("D").as_uint():
        found["calculated_doppler_mps"] = _quantity(calculated.variation.get_item("CAL"), "m/s")
    return found


def _flagged(item: Any) -> bool:
    """Whether a code is marked as not validated or garbled."""
    return bool(item.variation.get_item("V").as_uint() or item.variation.get_item("G").as_uint())


def _quantity(item: Any, unit: str) -> float:
    return float(item.variation.content.as_quantity(unit))
