"""What an adapter is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.vocabulary.recordings import Recording


class RecordingError(UserError):
    """A recording cannot be read; the message is one line and names the file."""


@dataclass(frozen=True, slots=True)
class InputOptions:
    """What the user says about a recording whose meaning is not in itself.

    ``topic`` names a topic of a bag, ``preset`` a radar; ``radar_input`` are parameters of
    :class:`~gda_tracker.io.radar.input_parameters.RadarInputParameters` by name, on top of the
    preset, be it named here or guessed. ``seed`` and ``run`` choose the random numbers of a
    simulated radar.
    """

    topic: str | None = None
    preset: str | None = None
    radar_input: Mapping[str, Any] | None = None
    seed: int = 1
    run: int = 0


NO_OPTIONS = InputOptions()


@dataclass(frozen=True, slots=True)
class Adapter:
    """Reads one kind of recording.

    ``recognises`` tells by the content whether a path is of this kind and raises nothing; ``load``
    reads it and raises :class:`RecordingError`. ``frames`` is there where a recording holds what a
    radar published, whose meaning a table declares: it yields it as it stands. ``by_radar`` is in
    its place where a recording may hold several radars: it returns the frames of each by name.
    """

    name: str
    description: str
    recognises: Callable[[Path], bool]
    load: Callable[[Path, InputOptions], Recording]
    frames: Callable[[Path], Iterator[RadarFrame]] | None = None
    by_radar: Callable[[Path], dict[str, list[RadarFrame]]] | None = None


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a file, none if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""
