"""Several radars that look at the same targets, each with a bias of its positions.

The bias is what is to be added to a radar's positions: its detections are made from where it
really stands, and it says that it stands so much beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.vocabulary.recordings import Recording


@dataclass(frozen=True)
class BiasedRadar:
    """A radar: name, true place [x East, y North] and bias [m]."""

    name: str
    position_m: tuple[float, float]
    bias_m: tuple[float, float]


def simulate_radars(
    scenario: Scenario, radars: Sequence[BiasedRadar], seed: int, run: int = 0
) -> list[Recording]:
    """Simulate one run as each radar sees it, with random numbers of its own.

    The sensor of the scenario stands for all but the places. Tracks start by themselves.
    """
    recordings = []
    for number, radar in enumerate(radars):
        own = replace(scenario, sensor=replace(scenario.sensor, position_m=radar.position_m))
        recording = simulate(
            own, seed, run * len(radars) + number, base_stamp_ns=1_000_000_000,
            initiation="automatic",
        )  # fmt: skip
        shift = np.array([*radar.bias_m, 0.0])
        detections = [
            replace(scan, sensor_id=radar.name, sensor_position_m=scan.sensor_position_m - shift)
            for scan in recording.detections
        ]
        recordings.append(replace(recording, detections=detections))
    return recordings
