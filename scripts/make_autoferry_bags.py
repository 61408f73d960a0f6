#!/usr/bin/env python3
"""Make the bags in data/autoferry from the files of the Autoferry sensor fusion dataset.

    python scripts/make_autoferry_bags.py FOLDER [--output data/autoferry] [--scenarios 2 3 13 16]

FOLDER holds the original ``scenarioN_detections.json`` and ``scenarioN_groundTruth.json``
(github.com/Autoferry/sensor_fusion_dataset). Each bag has the radar's scans on ``/detections`` and
the two boats' positions on ``/truth``, stamped with the time of the scan. The same input gives the
same bytes with the same version of the rosbags library.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.io.adapters import RecordingError, load_recording  # noqa: E402
from gda_tracker.io.adapters.bag import write_recording  # noqa: E402
from gda_tracker.io.bags import BagError  # noqa: E402


def make_bag(folder: Path, scenario: str, output: Path) -> str:
    """Write one scenario as the bag ``output/scenarioN``; return a line about it.

    Raises
    ------
    RecordingError, BagError
        If the files cannot be read or the bag exists already.
    """
    recording = load_recording(folder / f"scenario{scenario}_detections.json", "autoferry")
    if recording.truth is None:
        raise RecordingError(f"{folder}: scenario{scenario}_groundTruth.json is missing")
    path = output / recording.name
    write_recording(path, recording, preset="autoferry")
    count = sum(len(scan.range_m) for scan in recording.detections)
    return f"{path}: {len(recording.detections)} scans, {count} detections"


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with the original JSON files")
    parser.add_argument("--output", type=Path, default=ROOT / "data" / "autoferry")
    parser.add_argument("--scenarios", nargs="+", default=["2", "3", "13", "16"])
    options = parser.parse_args(arguments)
    for scenario in options.scenarios:
        try:
            print(make_bag(options.folder, scenario, options.output))
        except (RecordingError, BagError) as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
