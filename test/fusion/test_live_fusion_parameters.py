"""Every live parameter of ``track_fusion`` acts at the next fusion, and none before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.fusion.fuser import TrackFuser
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.fusion.reports import Refused
from gda_tracker.parameters import from_mapping, specifications, to_mapping
from gda_tracker.simulation.kalman_radars import KalmanRadars
from gda_tracker.vocabulary.tracks import TENTATIVE

BIAS = [[0.0, 0.0], [-800.0, 600.0]]
SCANS = 5
LEARNT = {"track_memory_s": 2.0}
CLOSE = {"max_enumerated": 1, "sampling_sweeps": 1, "track_memory_s": 1e6}

# The new value, what holds from the beginning, and what happens beside it at the change.
CASES = {
    "bias_memory_s": (5.0, {}, ""),
    "fusion_rule": ("independent", {}, ""),
    "track_process_noise_std_mps2": (0.5, {}, ""),
    "process_noise_density_m2ps3": (100.0, {}, ""),
    "track_probability": ([0.5, 0.6], {}, ""),
    "expected_false_tracks": ([4.0], {}, ""),
    "region_std_m": (500.0, {}, ""),
    "speed_std_mps": (20.0, {}, ""),
    "class_reliability": (0.3, {}, ""),
    "class_belief_prior": (["cargo=5"], {}, ""),
    "switching_odds": (1e12, LEARNT, "shift"),
    "late_after_s": (0.5, {}, "lag"),
    "silent_after_s": (0.6, {"late_after_s": 0.5}, "lag"),
    "time_jump_s": (1.0, {}, "back"),
    "tentative": (True, {}, "tentative"),
    "max_tracks_per_radar": (3, {}, ""),
    "max_associated_tracks": (3, {}, ""),
    "track_memory_s": (2.0, {}, ""),
    "bias_minimum_probability": (1.0, {}, ""),
    "bias_reset_fusions": (1, {**LEARNT, "bias_reset_fusions": 9}, "moved"),
    "max_enumerated": (1, {}, ""),
    "sampling_sweeps": (3, CLOSE, ""),
    "top_associations": (2, {}, ""),
}


def test_every_live_parameter_has_a_case():
    live = {n for n, item in specifications(TrackFusionParameters).items() if item.live}
    assert set(CASES) == live


def outcome(name, changed):
    """What comes of the scans before and after a change, or after none."""
    value, always, event = CASES[name]
    parameters = from_mapping(TrackFusionParameters, {"radars": ["a", "b"], **always})
    radars = KalmanRadars(2, BIAS, n_targets=5 if always is CLOSE else 4)
    if always is CLOSE:
        radars.states *= [[5e-3, 5e-3, 0.02, 0.02]]
    fuser = TrackFuser(parameters, system_uuid=bytes(16))
    belief = np.array([[0.0, 0.8, 0.2], [0.0, 0.3, 0.7]] * 3)[: len(radars.states)]
    before = [
        summary(f)
        for _ in range(1 if always is CLOSE else SCANS)
        for f in scan(radars, fuser, belief)
    ]
    if changed:
        fuser.parameters = from_mapping(
            TrackFusionParameters, {**to_mapping(parameters), name: value}
        )
    if event == "moved":
        radars.move(1, [1500.0, 0.0])
        radars.system_uuid[1] = b"n" * 16
    if event == "shift":
        # One track is off by so much that it is about to leave its company.
        radars.local[1][0][0, :2] += 160.0
    if event == "back":
        radars.time_s -= 3.0
    after = [
        summary(f)
        for _ in range(3 if event == "moved" else 1)
        for f in scan(radars, fuser, belief, event)
    ]
    return before, after


def scan(radars, fuser, belief, event=""):
    radars.step()
    made = []
    for radar, name in enumerate("ab"):
        message = radars.message(radar, belief)
        if event == "lag" and radar:
            message = replace(message, key=message.key._replace(
                stamp_ns=message.key.stamp_ns - 700_000_000))  # fmt: skip
        if event == "tentative":
            message.status[0] = TENTATIVE
        try:
            made += fuser.take(name, message)
        except Refused as error:
            made.append(error.reason)
    if event == "lag":
        made.append(fuser.radar_states())
    return made


def summary(made):
    """All numbers of a fusion as text."""
    if isinstance(made, str | tuple) and not hasattr(made[0], "mean"):
        return str(made)
    return "\n".join(f"{name} {getattr(part, name)!r}" for part in made for name in part.__slots__)


@pytest.mark.parametrize("name", CASES)
def test_it_acts_at_the_next_fusion(name):
    plain, changed = outcome(name, False), outcome(name, True)
    assert plain[0] == changed[0]
    assert plain[1] != changed[1]
