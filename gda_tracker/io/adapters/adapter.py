"""What an adapter is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.vocabulary.recordings import Recording


class RecordingError(UserError):
    """A recording cannot be read; the message is one line and names the file."""


@dataclass(frozen=True, slots=True)
class Adapter:
    """Reads one kind of recording.

    ``recognises`` tells by the content whether a path is of this kind and raises nothing; ``load``
    reads it and raises :class:`RecordingError`.
    """

    name: str
    description: str
    recognises: Callable[[Path], bool]
    load: Callable[[Path], Recording]


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a file, none if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""
