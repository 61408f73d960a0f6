"""A recording: the scans of one experiment in order, with truth where it is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.statements import Statement


@dataclass(slots=True)
class Recording:
    """Scans of one experiment, from a simulator, a bag or a file.

    ``truth`` is ``None`` or has one entry per scan. ``preset`` gives, per node name, the parameters
    that suit the sensor; ``preset_name`` says where they come from, ``preset_is_base`` that the
    user's own parameters go on top of them rather than in their place. ``origin`` is a line about
    the source with licence and citation, ``notes`` are lines about how it was read. ``statements``
    were made during the experiment, each with the number of scans that came before it, in this
    order. ``match_distance_m`` is how far a track may be from its target, if that is known.
    """

    name: str
    detections: list[Detections]
    truth: list[ScanTruth] | None = None
    preset_name: str = "default"
    preset: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    preset_is_base: bool = False
    origin: str = ""
    warnings: list[str] = field(default_factory=list)
    statements: list[tuple[int, Statement]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    match_distance_m: float | None = None
