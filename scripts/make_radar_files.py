#!/usr/bin/env python3
"""Make recordings of the kinds that no shipped file is of, to try the tracker without a radar.

    python scripts/make_radar_files.py OUTPUT [NAME ...]

air_traffic.pcap   ASTERIX 048 and 034 as an air traffic control radar sends them, a capture of 30
                   turns with four simulated aircraft
radar_scan         the first two seconds of data/mmwave_walk as a bag of radar_msgs/RadarScan, of
                   the points that stand still every fourth
radar_tracks       the boats of data/autoferry/scenario16 for a minute, as a radar that tracks by
                   itself tells of them: a bag of radar_msgs/RadarTracks
plots.csv          the crossing aircraft of params/scenarios among false alarms, as a table of
                   detections
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
# The encoder of ASTERIX is that of the tests.
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "io" / "asterix")]

from asterix_examples import pcap, traffic, udp_packet  # noqa: E402

from gda_tracker.io.adapters import load_recording, mmwave  # noqa: E402
from gda_tracker.io.bag_types import type_store  # noqa: E402
from gda_tracker.io.bags import BagTopic, BagWriter  # noqa: E402
from gda_tracker.io.radar.frames import RadarFrame  # noqa: E402
from gda_tracker.io.track_output_parameters import TrackOutputParameters  # noqa: E402
from gda_tracker.io.track_outputs import RADAR_TRACKS, bag_message, radar_tracks  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402

WALK = ROOT / "data" / "mmwave_walk" / "SOT.tar.xz"
BOATS = ROOT / "data" / "autoferry" / "scenario16"
RADAR_SCAN = "radar_msgs/msg/RadarScan"
DAY_S = 20_000 * 86_400
TURNS = 30
STANDING_STILL_MPS = 0.1
KEPT_OF_THOSE = 4
SCANS = 40
FRAMES = 40
FIELDS = ("range", "azimuth", "elevation", "doppler", "power")
START_NS = 1_000 * 10**9


def aircraft(time_s: float) -> list[tuple[float, float]]:
    """East and North [m] of four aircraft: a turn, two that cross, one that overtakes."""
    t = time_s - 1000.0
    turned = math.radians(3.0) * t
    radius = 120.0 / math.radians(3.0)
    return [
        (30e3 + radius * math.sin(turned), 30e3 + radius * math.cos(turned)),
        (-20e3 + 200.0 * t, -15e3),
        (-8e3, -27e3 + 200.0 * t),
        (-26e3 + 240.0 * t, -15.5e3),
    ]


def write_air_traffic(path: Path) -> Path:
    """Write a capture of an air traffic control radar."""
    sent = traffic(aircraft, TURNS)
    path.write_bytes(pcap([(DAY_S + time_s, udp_packet(payload)) for time_s, payload in sent]))
    return path


def radar_scans() -> Iterable[tuple[int, object]]:
    """Yield stamp and RadarScan of the first frames of the walk, each once."""
    types = type_store().types
    seen: dict[int, RadarFrame] = {}
    for frame in mmwave.frames(WALK):
        seen.setdefault(frame.stamp_ns, frame)
        if len(seen) == FRAMES:
            break
    for stamp_ns, frame in seen.items():
        columns = frame.read(FIELDS, {})
        rows = np.stack([columns[name] for name in FIELDS], axis=1)
        keep = np.abs(rows[:, 3]) > STANDING_STILL_MPS
        keep[::KEPT_OF_THOSE] = True
        # The recording counts azimuths clockwise from ahead, a RadarScan counter-clockwise.
        rows[:, 1] *= -1.0
        seconds, nanoseconds = divmod(stamp_ns, 10**9)
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        yield (
            stamp_ns,
            types[RADAR_SCAN](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="radar"),
                returns=[types["radar_msgs/msg/RadarReturn"](*row) for row in rows[keep].tolist()],
            ),
        )


def tracks_of_the_radar() -> Iterable[tuple[int, object]]:
    """Yield stamp and RadarTracks of each scan, from the first object on."""
    recording = load_recording(BOATS)
    ring = Ring(with_method(recording.preset, "map/none/cv"))
    for detections in recording.detections[:SCANS]:
        tracks = ring.process(detections).tracks
        if tracks is not None and (tracks.status == CONFIRMED).any():
            yield detections.stamp_ns, radar_tracks(tracks, TrackOutputParameters(), bag_message)


def write_bag(path: Path, topic: str, kind: str, messages: Iterable[tuple[int, object]]) -> Path:
    """Write a bag of one topic."""
    with BagWriter(path, [BagTopic(topic, kind, reliable=False)]) as bag:
        for stamp_ns, message in messages:
            bag.write(topic, message, stamp_ns)
    return path


def write_plots(path: Path) -> Path:
    """Write a table of detections, as a program of one's own would."""
    lines = ["time_s,range_m,azimuth_deg,rcs_dbsm"]
    # A radar's clock does not begin at zero.
    recording = simulate(load_scenario("crossing_targets"), 1, 0, base_stamp_ns=START_NS)
    for scan in recording.detections:
        assert scan.rcs_m2 is not None
        values = (scan.range_m, np.degrees(scan.azimuth_rad), 10.0 * np.log10(scan.rcs_m2))
        for distance, azimuth, rcs in zip(*values, strict=True):
            lines.append(f"{scan.stamp_ns / 1e9:.3f},{distance:.1f},{azimuth:.4f},{rcs:.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


MAKERS: dict[str, Callable[[Path], Path]] = {
    "air_traffic.pcap": write_air_traffic,
    "radar_scan": lambda path: write_bag(path, "/front/scan", RADAR_SCAN, radar_scans()),
    "radar_tracks": lambda path: write_bag(
        path, "/front/objects", RADAR_TRACKS, tracks_of_the_radar()
    ),
    "plots.csv": write_plots,
}


def main(arguments: list[str] | None = None) -> int:
    """Write what is asked for, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path, help="folder for the recordings")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(MAKERS)}; default: all"
    )
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in MAKERS]
    if unknown:
        parser.error(f"NAME {unknown[0]}: allowed is one of {', '.join(MAKERS)}")
    options.output.mkdir(parents=True, exist_ok=True)
    for name in options.names or MAKERS:
        path = options.output / name
        if path.exists():
            parser.error(f"{path} exists already")
        print(MAKERS[name](path))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
