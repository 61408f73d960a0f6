#!/usr/bin/env python3
"""Make PointCloud2 bags of the two real radar recordings that come with the package.

    python scripts/make_radar_bags.py OUTPUT

OUTPUT/ars548: the scan of a Continental ARS548 in data/continental, as the Nebula driver would
publish it, 40 times at 20 Hz (the car does not move on between the scans, as it would).
OUTPUT/walk: the person walking away from a 4-D mmWave radar in data/mmwave_walk. Neither names its
preset.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.io.adapters import continental_yaml, mmwave  # noqa: E402
from gda_tracker.io.bags import BagTopic, BagWriter  # noqa: E402
from gda_tracker.io.radar.frames import RadarFrame  # noqa: E402
from gda_tracker.io.radar.messages import POINT_CLOUD  # noqa: E402
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns  # noqa: E402

ARS548 = ROOT / "data" / "continental" / "ars548_1708578204_202447652_detection.yaml"
WALK = ROOT / "data" / "mmwave_walk" / "SOT.tar.xz"
PERIOD_NS = 50_000_000
ARS548_STAMP_NS = 1708578204_202447652
ARS548_TYPES = {
    **dict.fromkeys(("x", "y", "z"), "float32"),
    **dict.fromkeys(("azimuth", "azimuth_std", "elevation", "elevation_std"), "float32"),
    **dict.fromkeys(("range", "range_std", "range_rate", "range_rate_std"), "float32"),
    "rcs": "int8",
    "measurement_id": "uint16",
    "positive_predictive_value": "uint8",
    "classification": "uint8",
    "multi_target_probability": "uint8",
    "object_id": "uint16",
    "ambiguity_flag": "uint8",
}
# As the C++ structure of the driver lies in memory: 16 bytes for x, y, z, then by alignment.
ARS548_OFFSETS = dict(
    zip(
        ARS548_TYPES,
        (0, 4, 8, 16, 20, 24, 28, 32, 36, 40, 44, 48, 50, 52, 53, 54, 56, 58),
        strict=True,
    )
)
ARS548_STEP = 64
WALK_FIELDS = ("x", "y", "z", "range", "azimuth", "elevation", "doppler", "power")


def ars548_columns() -> dict[str, np.ndarray]:
    """Return the fields of the driver's point cloud for the scan."""
    (frame,) = continental_yaml.frames(ARS548)
    columns = frame.read(list(frame.types), {})
    for name in ("positive_predictive_value", "multi_target_probability", "ambiguity_flag"):
        columns[name] = columns[f"raw_{name}"]
    ground = columns["range"] * np.cos(columns["elevation"])
    columns["x"] = ground * np.cos(columns["azimuth"])
    columns["y"] = ground * np.sin(columns["azimuth"])
    columns["z"] = columns["range"] * np.sin(columns["elevation"])
    return {name: columns[name] for name in ARS548_TYPES}


def ars548_cloud(columns: dict[str, np.ndarray], scan: int) -> tuple[int, object]:
    """Return stamp and message of scan number ``scan``."""
    stamp_ns = ARS548_STAMP_NS + scan * PERIOD_NS
    return stamp_ns, point_cloud_of_columns(
        columns, ARS548_TYPES, stamp_ns, "front_radar", ARS548_OFFSETS, ARS548_STEP
    )


def ars548_clouds(scans: int) -> Iterable[tuple[int, object]]:
    """Yield stamp and message of the one scan, again and again."""
    columns = ars548_columns()
    for scan in range(scans):
        yield ars548_cloud(columns, scan)


def walk_clouds(frames: Iterable[RadarFrame]) -> Iterable[tuple[int, object]]:
    """Yield stamp and message of the frames, each once."""
    seen = set()
    types = dict.fromkeys(WALK_FIELDS, "float32")
    for frame in frames:
        if frame.stamp_ns in seen:
            continue
        seen.add(frame.stamp_ns)
        columns = frame.read(WALK_FIELDS, {})
        yield (
            frame.stamp_ns,
            point_cloud_of_columns(columns, types, frame.stamp_ns, frame.frame_id),
        )


def write_bag(path: Path, topic: str, clouds: Iterable[tuple[int, object]]) -> Path:
    """Write messages as a bag of one topic, best effort as drivers offer it."""
    with BagWriter(path, [BagTopic(topic, POINT_CLOUD, reliable=False)]) as bag:
        for stamp_ns, cloud in clouds:
            bag.write(topic, cloud, stamp_ns)
    return path


def main(arguments: list[str] | None = None) -> int:
    """Write both bags."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path, help="folder for the bags")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    print(write_bag(options.output / "ars548", "/front_radar/points", ars548_clouds(40)))
    print(write_bag(options.output / "walk", "/mmwave/points", walk_clouds(mmwave.frames(WALK))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
