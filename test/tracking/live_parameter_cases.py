"""For each live parameter of the ring a change, and where it shows in what the ring does.

What is fed is a list of scans and statements; the change is made before the one numbered ``AT``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tracking_examples import QUIET, scan_at, simulated

from gda_tracker.vocabulary.scans import Detections
from gda_tracker.vocabulary.statements import Statement, StatementPiece, StatementRegion

AT = 10
TRACKS, DELAYED, ASSOCIATIONS, ANSWERS = "tracks", "delayed", "associations", "answers"

JPDA = {"decision": "jpda"}
MHT = {"decision": "mht"}
UNRESOLVED = {**JPDA, "resolution_range_m": 200.0, "resolution_azimuth_rad": 0.05}
STRENGTH = {"signal_strength": "swerling_1"}
SEQUENTIAL = {"extraction": "sequential"}
BELIEF_PROPAGATION = {"association": {"max_exact_size": 1}}
MAP = str(Path(__file__).with_name("crossing_context.yaml"))
WITH_MAP = {"context_file": MAP}
PER_SCAN = {"filter": "imm", "imm_switching": "per_scan", "imm_transition": [0.9, 0.1, 0.1, 0.9]}


def with_model(name: str) -> dict[str, Any]:
    """Constant velocity beside another model."""
    return {"filter": "imm", "imm_models": ["constant_velocity", name]}


BY_ACCELERATION = {**with_model("singer"), "imm_switching": "acceleration"}


@lru_cache
def crossing() -> list[Any]:
    """Four targets with misses and clutter, a scan each second."""
    return simulated(22)


@lru_cache
def arrivals() -> list[Any]:
    """The same, with further targets that come one after the other and stay for 2 to 8 scans."""
    scans = []
    for k, scan in enumerate(crossing()):
        x, y = scan.range_m * np.cos(scan.azimuth_rad), scan.range_m * np.sin(scan.azimuth_rad)
        new = [
            (500.0 + 220.0 * j, 2800.0 + 15.0 * (k - first))
            for j, first in enumerate(range(7, 22))
            # Some are missed on their second or third scan, some on two in a row.
            if first <= k < first + 2 + j % 7
            and (k - first != 1 + j % 2 or j % 3)
            and (k - first not in (2, 3) or j % 4 < 3)
        ]
        position = np.vstack([np.column_stack([x, y]), np.array(new).reshape(-1, 2)])
        rcs = np.append(np.asarray(scan.rcs_m2), np.full(len(new), 2.0))
        scans.append(replace(scan_at(100.0 + k, position), rcs_m2=rcs))
    return scans


@lru_cache
def crowd() -> list[Any]:
    """Five targets side by side, closer to each other than their gates are wide."""
    rng = np.random.default_rng(5)
    scans = []
    for k in range(18):
        position = np.array([[2000.0 + 10.0 * k, 1000.0 + 18.0 * i] for i in range(5)])
        seen = rng.random(5) < 0.95
        position = position[seen] + rng.normal(0.0, 8.0, (np.count_nonzero(seen), 2))
        scans.append(replace(scan_at(100.0 + k, position), rcs_m2=rng.gamma(2.0, 1.0, seen.sum())))
    return scans


@lru_cache
def doubles() -> list[Any]:
    """Two targets; from scan 8 on each is often seen twice."""
    rng = np.random.default_rng(6)
    scans = []
    for k in range(22):
        body = np.array([[2000.0 + 10.0 * k, 1000.0], [3000.0, 1500.0 - 10.0 * k]])
        again = body[rng.random(2) < (0.7 if k >= 8 else 0.0)]
        position = np.vstack([body, again + rng.normal(0.0, 12.0, again.shape)])
        scans.append(scan_at(100.0 + k, position + rng.normal(0.0, 3.0, position.shape)))
    return scans


@lru_cache
def measured_in_full() -> list[Any]:
    """Elevations and range rates too, with noise."""
    rng = np.random.default_rng(7)
    scans = []
    for scan in crossing():
        n = len(scan.range_m)
        scans.append(
            replace(
                scan,
                elevation_rad=rng.normal(0.1, 0.01, n),
                range_rate_mps=rng.normal(0.0, 5.0, n),
            )
        )
    return scans


@lru_cache
def with_strengths() -> list[Any]:
    """Each detection with the strength of its signal, above a threshold of about 4.6."""
    rng = np.random.default_rng(8)
    return [
        replace(
            scan,
            attribute_names=("snr", "power"),
            attribute_values=4.7 + rng.exponential(6.0, (2, len(scan.range_m))),
        )
        for scan in arrivals()
    ]


@lru_cache
def with_a_gap() -> list[Any]:
    """Silence of 20 s."""
    return [
        replace(scan, stamp_ns=scan.stamp_ns + (19 * 10**9 if place > 15 else 0))
        for place, scan in enumerate(crossing())
    ]


@lru_cache
def with_a_step_back() -> list[Any]:
    """The time axis begins anew, 12 s back."""
    return [
        replace(scan, stamp_ns=scan.stamp_ns - (12 * 10**9 if place > 15 else 0))
        for place, scan in enumerate(crossing())
    ]


def _statements(offset_s: float, each: int) -> list[Any]:
    """Statements about a place, some seconds from each scan, ``each`` before every scan."""
    around = StatementRegion("gaussian", centre_m=(2e3, 2e3), covariance_m2=(1e4, 0.0, 0.0, 1e4))
    piece = StatementPiece(around, ("fighter",), (1.0,))
    fed: list[Detections | Statement] = []
    for place, scan in enumerate(crossing()):
        fed += [
            Statement(
                f"s{number}",
                place,
                crossing()[place - 1].stamp_ns + round(offset_s * 1e9),
                "fuzzy",
                "place",
                (piece,),
                frame_id="map",
            )
            for number in range(each if place else 0)
        ]
        fed.append(scan)
    return fed


@lru_cache
def old_statements() -> list[Any]:
    """Statements of 5 s ago."""
    return _statements(-5.0, 1)


@lru_cache
def early_statements() -> list[Any]:
    """Statements of a time 5 s ahead."""
    return _statements(5.0, 1)


@lru_cache
def many_statements() -> list[Any]:
    """Two statements a scan."""
    return _statements(0.0, 2)


@lru_cache
def extended() -> list[Any]:
    """Two extended objects, several detections each, one of them missed once."""
    rng = np.random.default_rng(9)
    scans = []
    for k in range(14):
        bodies = [
            np.array([2000.0 + 10.0 * k, 1000.0 + 4.0 * k * (k > 8)]),
            np.array([2500.0, 1200.0 - 10.0 * k]),
        ]
        points = [body + rng.normal(0.0, [20.0, 6.0], (rng.poisson(6), 2)) for body in bodies]
        far = rng.uniform(500.0, 3000.0, (2, 2))
        scans.append(scan_at(100.0 + k, np.concatenate([*points[k == 12 :], far])))
    return scans


@dataclass(frozen=True)
class Case:
    """A change of one parameter.

    Attributes
    ----------
    value
        The new value.
    base
        Parameters of the track manager from the beginning.
    also
        Parameters of the other nodes from the beginning.
    fed
        Makes what is fed.
    shows
        Where the change shows.
    later
        It need not show on the very next scan, only where the situation comes.
    """

    value: Any
    base: dict[str, Any] = field(default_factory=dict)
    fed: Callable[[], list[Any]] = crossing
    shows: str = TRACKS
    later: bool = False
    also: dict[str, dict[str, Any]] = field(default_factory=dict)

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Parameters from the beginning."""
        return {"track_manager": {**QUIET, **self.base}, **self.also}


CLASS_MOTION = {
    "attribute_term": "bayes",
    "class_motion_names": ["fighter", "cargo"],
    "class_speed_mps": [0.0, 0.0, 15.0, 20.0, 0.0, 0.0, 100.0, 200.0],
}
EXTENDED = {
    "extended_objects": "random_matrix",
    "cell_least_distance_m": 5.0,
    "cell_largest_distance_m": 40.0,
    "extent_radius_m": 20.0,
}
WIDE = {"cell_largest_distance_m": 400.0, "extent_radius_m": 3.0, "extent_prior_weight": 50.0}
STAYS = [0.8, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8]

CASES: dict[str, dict[str, Case]] = {
    "track_manager": {
        "decision": Case("jpda", fed=crowd),
        "attribute_term": Case("none", {"attribute_term": "bayes"}),
        "filter": Case("imm"),
        "range_std_m": Case(20.0),
        "azimuth_std_rad": Case(0.002),
        "process_noise_std_mps2": Case(5.0),
        "max_speed_mps": Case(200.0, later=True),
        "detection_probability": Case(0.5, JPDA, crowd),
        "blind_speed_mps": Case(10.0),
        "context_file": Case(MAP),
        "lane_keeping_share": Case(0.2, WITH_MAP),
        "lane_keeping_s": Case(5.0, WITH_MAP),
        "lane_correlation_s": Case(3.0, WITH_MAP),
        "plan_keeping_share": Case(0.2, WITH_MAP),
        "plan_keeping_s": Case(5.0, WITH_MAP),
        "blind_longest_s": Case(1.0, {"blind_speed_mps": 50.0}, later=True),
        "class_motion": Case("ranges", CLASS_MOTION, later=True),
        "class_motion_reliability": Case(0.5, {**CLASS_MOTION, "class_motion": "ranges"}),
        "detection_probability_map": Case("estimated", JPDA, crowd, later=True),
        "detection_memory_scans": Case(
            3.0, {**JPDA, "detection_probability_map": "estimated"}, crowd, later=True
        ),
        "gate_probability": Case(0.5, JPDA, crowd),
        "clutter_density_per_m_rad": Case(1e-4, JPDA, crowd),
        "clutter_density": Case("estimated", JPDA, crowd, later=True),
        "clutter_memory_scans": Case(3.0, {**JPDA, "clutter_density": "estimated"}, later=True),
        "extraction": Case("sequential", fed=arrivals, later=True),
        "false_track_probability": Case(0.3, SEQUENTIAL, fed=arrivals, later=True),
        "missed_track_probability": Case(0.5, SEQUENTIAL, fed=arrivals, later=True),
        "confirmation_hits": Case(2, fed=arrivals, later=True),
        "confirmation_scans": Case(12, {"tentative_deletion_misses": 5}, arrivals, later=True),
        "deletion_misses": Case(1, later=True),
        "mht_scans": Case(3, MHT, shows=DELAYED),
        "resolution_range_m": Case(900.0, UNRESOLVED, crowd),
        "resolution_azimuth_rad": Case(0.4, UNRESOLVED, crowd),
        "unresolved_detection_probability": Case(0.3, UNRESOLVED, crowd),
        "history_policy": Case("forgetting", {"forgetting_factor": 0.5}),
        "forgetting_factor": Case(0.3, {"history_policy": "forgetting", "forgetting_factor": 0.9}),
        "history_window": Case(2, {"history_policy": "window", "history_window": 8}, later=True),
        "signal_strength": Case("swerling_1", fed=with_strengths),
        "signal_strength_attribute": Case("power", STRENGTH, with_strengths),
        "signal_strength_unit": Case("decibel", STRENGTH, with_strengths),
        "signal_strength_memory_s": Case(5.0, STRENGTH, with_strengths),
        "false_alarm_probability": Case(0.02, STRENGTH, with_strengths),
        "clutter_signal_strength": Case(3.0, STRENGTH, with_strengths, shows=ASSOCIATIONS),
        "initial_signal_strength": Case(50.0, STRENGTH, with_strengths, later=True),
        "initial_signal_strength_shape": Case(20.0, STRENGTH, with_strengths, later=True),
        "initiation_outside_gates": Case(True, fed=doubles, later=True),
        "initiation_memory_scans": Case(6, fed=arrivals, later=True),
        "tentative_deletion_misses": Case(1, fed=arrivals, later=True),
        "missed_track_hypotheses": Case(
            "table_14_3",
            {"decision": "gda", "attribute_term": "dsm_classic"},
            crowd,
            shows=ASSOCIATIONS,
        ),
        "mht_retrodiction": Case(False, MHT, shows=DELAYED),
        "mht_leaf_probability": Case(0.4, MHT, crowd, later=True),
        "mht_leaves_per_track": Case(1, MHT, crowd, later=True),
        "mht_merge_scans": Case(1, {**MHT, "mht_merge_distance": 5.0}, crowd, later=True),
        "mht_merge_distance": Case(
            50.0, {**MHT, "mht_merge_scans": 1, "mht_merge_belief": 1.0}, crowd, later=True
        ),
        "mht_merge_belief": Case(
            1.0,
            {**MHT, "mht_merge_scans": 1, "mht_merge_distance": 50.0, "mht_merge_belief": 0.0},
            crowd,
            later=True,
        ),
        "mht_max_leaves": Case(6, MHT, crowd, later=True),
        "mht_new_target_ratio": Case(1e-9, MHT, doubles, later=True),
        "elevation_std_rad": Case(0.2, fed=measured_in_full),
        "range_rate_std_mps": Case(50.0, fed=measured_in_full),
        "use_range_rate": Case(False, fed=measured_in_full),
        "max_tracks": Case(3, fed=arrivals, later=True),
        "max_detections_per_scan": Case(4, shows=ANSWERS),
        "max_gap_s": Case(5.0, fed=with_a_gap, later=True),
        "time_jump_s": Case(1000.0, fed=with_a_step_back, shows=ANSWERS, later=True),
        "reorder_window_s": Case(2.0, shows=ANSWERS),
        "reorder_sensors": Case(["radar"], {"reorder_window_s": 3.0}, shows=ANSWERS),
        "statement_max_age_s": Case(1.0, fed=old_statements, shows=ANSWERS),
        "statement_max_ahead_s": Case(1.0, fed=early_statements, shows=ANSWERS),
        "max_statements": Case(1, fed=many_statements, shows=ANSWERS, later=True),
        "extended_objects": Case("random_matrix", fed=extended),
        "cell_least_distance_m": Case(100.0, {**EXTENDED, **WIDE}, extended, later=True),
        "cell_largest_distance_m": Case(6.0, EXTENDED, extended, later=True),
        "cell_partitions": Case(1, EXTENDED, extended, later=True),
        "extent_radius_m": Case(300.0, EXTENDED, extended, later=True),
        "extent_prior_weight": Case(200.0, EXTENDED, extended, later=True),
        "extent_spread": Case(1.0, EXTENDED, extended),
        "extent_memory_s": Case(0.5, EXTENDED, extended),
        "extent_turns_with_course": Case(False, EXTENDED, extended),
        "detections_per_object": Case(0.5, EXTENDED, extended, later=True),
        "detection_rate_memory_s": Case(0.5, EXTENDED, extended),
        "false_group_ratio": Case(1e3, {**EXTENDED, **JPDA}, extended, later=True),
        "imm_process_noise_factors": Case([1.0, 6.0], {"filter": "imm"}),
        "imm_mean_sojourn_s": Case([2.0, 2.0], {"filter": "imm"}),
        "imm_models": Case(["constant_velocity", "coordinated_turn"], {"filter": "imm"}),
        "imm_switching": Case("acceleration", with_model("singer")),
        "imm_transition": Case([0.6, 0.4, 0.4, 0.6], PER_SCAN),
        "imm_switching_acceleration_mps2": Case(0.5, BY_ACCELERATION),
        "imm_correlation_time_s": Case(2.0, with_model("singer")),
        "imm_acceleration_std_mps2": Case(50.0, with_model("constant_acceleration"), later=True),
        "imm_turn_rate_std_radps": Case(0.5, with_model("coordinated_turn"), later=True),
        "imm_turn_noise_std_radps2": Case(0.2, with_model("coordinated_turn"), later=True),
    },
    "rcs_fuzzifier": {
        "rcs_min_m2": Case(1.5),
        "rcs_max_m2": Case(1.0),
    },
    "attribute_fusion": {"class_transition": Case(STAYS)},
    "association": {
        "max_exact_size": Case(1, JPDA, crowd, later=True),
        "coalescence_remedy": Case("jpda_star", JPDA, crowd, later=True),
        "belief_propagation_iterations": Case(1, JPDA, crowd, also=BELIEF_PROPAGATION),
        "belief_propagation_tolerance": Case(0.1, JPDA, crowd, also=BELIEF_PROPAGATION),
    },
}

# These act by the clock on the wall, which the ring offline does not have: test/nodes.
IN_THE_NODE = {
    "track_manager": (
        "reorder_timeout_s",
        "attribute_timeout_s",
        "scan_timeout_s",
        "stale_after_s",
    )
}
# What a service of the node acts by: test/nodes/test_services.py.
BY_SERVICE = {"track_manager": ("state_path",)}
