"""Recordings of every kind, read into one: detections, truth where known, and a preset.

>>> recording = load_recording("data/autoferry/scenario16")  # doctest: +SKIP

A new kind of recording is one more :class:`Adapter` in :data:`ADAPTERS`.
"""

from __future__ import annotations

from pathlib import Path

from gda_tracker.io.adapters import (
    asterix,
    autoferry,
    bag,
    continental_yaml,
    csv_file,
    mmwave,
    scan_npz,
    trajectory_files,
)
from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
)
from gda_tracker.vocabulary.recordings import Recording

__all__ = [
    "ADAPTERS",
    "Adapter",
    "InputOptions",
    "RecordingError",
    "guess_adapter",
    "is_recording",
    "load_recording",
]

ADAPTERS: dict[str, Adapter] = {
    adapter.name: adapter
    for adapter in (
        bag.ADAPTER,
        autoferry.ADAPTER,
        scan_npz.ADAPTER,
        mmwave.ADAPTER,
        continental_yaml.ADAPTER,
        csv_file.ADAPTER,
        asterix.ADAPTER,
        trajectory_files.AIS,
        trajectory_files.UAV,
    )
}


def is_recording(path: str | Path) -> bool:
    """Tell whether an adapter knows the content of this path."""
    return any(adapter.recognises(Path(path)) for adapter in ADAPTERS.values())


def guess_adapter(path: str | Path) -> str:
    """Return the name of the adapter whose kind of recording this is, told by its content.

    Raises
    ------
    RecordingError
        If the path does not exist or no adapter knows its content.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    for name, adapter in ADAPTERS.items():
        if adapter.recognises(path):
            return name
    kinds = "; ".join(f"{name}: {adapter.description}" for name, adapter in ADAPTERS.items())
    raise RecordingError(f"{path}: no adapter knows this content. Known are {kinds}")


def load_recording(
    path: str | Path, adapter: str = "auto", options: InputOptions = NO_OPTIONS
) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path
        File or folder.
    adapter
        Name of an adapter, or ``auto`` to tell by the content; ``origin`` of the result then says
        which adapter was taken.
    options
        What the user says about a recording of a foreign radar: topic, preset, parameters.

    Raises
    ------
    RecordingError
        If the recording cannot be read, in one line that names the file and what is wrong; also if
        a library that it needs is not installed.
    """
    path = Path(path)
    name = guess_adapter(path) if adapter == "auto" else adapter
    if name not in ADAPTERS:
        raise RecordingError(f"adapter {name!r}: allowed is one of auto, {', '.join(ADAPTERS)}")
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    several = name == bag.ADAPTER.name or ADAPTERS[name].by_radar is not None
    if options.topic is not None and not several:
        raise RecordingError(
            f"--topic {options.topic}: allowed with bags and ASTERIX only, {path} is {name}"
        )
    recording = ADAPTERS[name].load(path, options)
    if adapter == "auto":
        recording.origin = f"{recording.origin} (read as {name}, guessed from the content)".lstrip()
    return recording
