"""The parameter table of the track manager."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.association.choices import DECISIONS, MISSED_TRACK_HYPOTHESES
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.motion_models import FILTERS
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.extraction import sequential_test
from gda_tracker.tracking.lifecycle import LONGEST_WINDOW
from gda_tracker.vocabulary.hypotheses import HISTORY_POLICIES

M_OF_N, SEQUENTIAL = "m_of_n", "sequential"
GIVEN, ESTIMATED = "given", "estimated"
CLUTTER_DENSITIES = (GIVEN, ESTIMATED)
EXTRACTIONS = (M_OF_N, SEQUENTIAL)
INITIATIONS = ("automatic", "labelled")
# The number of a model travels in one byte; more than a few gain nothing.
MOST_MODELS = 16
LONGEST_HISTORY_WINDOW = 100


@dataclass(frozen=True)
class TrackManagerParameters:
    """What the track manager is told: sensor, motion, association, life of a track, transport."""

    decision: str = parameter(
        "mht",
        "how detections are assigned: mht (over several scans, multiple hypothesis tracking), map "
        "(most probable joint hypothesis of each scan), gda (2004 chapter: 1 - P_k P_a and "
        "Munkres) or jpda (every track takes all detections in its gate, each as far as it is "
        "probable; see coalescence_remedy)",
        choices=DECISIONS,
    )
    attribute_term: str = parameter(
        "bayes", "how the attribute speaks in the association", choices=ATTRIBUTE_TERMS
    )
    filter: str = parameter(
        "imm",
        "motion of targets: cv constant velocity, imm interacting models of it with different "
        "process noise",
        choices=FILTERS,
    )
    range_std_m: float = parameter(
        30.0,
        "range noise of detections that bring none of their own",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    azimuth_std_rad: float = parameter(
        0.005,
        "azimuth noise of detections that bring none of their own",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        minimum_excluded=True,
    )
    process_noise_std_mps2: float = parameter(
        2.0,
        "acceleration of targets, standard deviation per scan; with imm the unit of "
        "imm_process_noise_factors",
        unit="m/s2",
        minimum=0.0,
        minimum_excluded=True,
    )
    max_speed_mps: float = parameter(
        300.0,
        "largest speed of a target; bounds the pairs that may start a track",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
    )
    detection_probability: float = parameter(
        0.9, "chance that a target is detected on a scan", minimum=0.0, maximum=1.0
    )
    gate_probability: float = parameter(
        0.99,
        "chance that a target's own detection lies in its gate",
        minimum=0.0,
        maximum=0.999999,
        minimum_excluded=True,
    )
    clutter_density_per_m_rad: float = parameter(
        1e-6,
        "detections per scan, metre of range and radian of azimuth that belong to no track",
        unit="1/(m rad)",
        minimum=0.0,
    )
    clutter_density: str = parameter(
        GIVEN,
        "given: clutter_density_per_m_rad everywhere; estimated: by region of range and azimuth, "
        "from detections without a confirmed track, beginning with it",
        choices=CLUTTER_DENSITIES,
    )
    clutter_memory_scans: float = parameter(
        50.0,
        "estimated: scans after which a detection has faded to 1/e",
        minimum=2.0,
        advanced=True,
    )
    extraction: str = parameter(
        M_OF_N,
        "what confirms and ends tracks: m_of_n (M detections within N scans, misses in a row) or "
        "sequential (likelihood ratio test with the two error probabilities)",
        choices=EXTRACTIONS,
    )
    false_track_probability: float = parameter(
        0.001,
        "sequential: chance that a track started by false detections is confirmed",
        minimum=0.0,
        maximum=1.0,
        minimum_excluded=True,
        advanced=True,
    )
    missed_track_probability: float = parameter(
        0.05,
        "sequential: chance that the track of a target is given up before it is confirmed",
        minimum=0.0,
        maximum=1.0,
        minimum_excluded=True,
        advanced=True,
    )
    confirmation_hits: int = parameter(
        3,
        "M of m_of_n: scans with a detection that confirm a track",
        minimum=2,
        maximum=LONGEST_WINDOW,
    )
    confirmation_scans: int = parameter(
        4, "N of m_of_n: the last scans that are looked at", minimum=2, maximum=LONGEST_WINDOW
    )
    deletion_misses: int = parameter(
        4,
        "m_of_n: scans in a row without a detection that end a confirmed track; 0: never, whatever "
        "the extraction",
        minimum=0,
    )
    mht_scans: int = parameter(
        8,
        "N of mht: the assignment of a scan is decided for good N scans later; tracks_delayed "
        "follows by so many",
        minimum=1,
        maximum=LONGEST_WINDOW,
    )
    history_policy: str = parameter(
        "none",
        "what a track's attribute history is made of: none, all its detections; forgetting, all, "
        "each counting less with every further one; window, the last ones; what this does to "
        "purity is measured in docs/attribute-terms.md",
        choices=HISTORY_POLICIES,
    )
    forgetting_factor: float = parameter(
        1.0,
        "history_policy forgetting: share of the history kept at each detection with a known "
        "attribute, the rest becomes ignorance (bayes: is spread over the possible classes)",
        minimum=0.0,
        maximum=1.0,
    )
    history_window: int = parameter(
        0,
        "history_policy window: how many of a track's last detections with a known attribute its "
        "belief is made of",
        minimum=0,
        maximum=LONGEST_HISTORY_WINDOW,
    )
    tracking_frame: str = parameter(
        "map", "frame in which sensor poses are given and tracks are published", live=False
    )
    checkpoint_path: str = parameter(
        "",
        "file that keeps the tracker's state after each scan, so that a restart goes on; "
        "empty: none",
        live=False,
    )
    initiation: str = parameter(
        "automatic",
        "automatic: tracks start from detections; labelled: only from initial_tracks, for which "
        "the first scan waits",
        choices=INITIATIONS,
        live=False,
        advanced=True,
    )
    initiation_outside_gates: bool = parameter(
        False,
        "start no track from a detection inside the gate of a confirmed one (several detections "
        "per object)",
        advanced=True,
    )
    initiation_memory_scans: int = parameter(
        2,
        "scans for which a detection without a track waits for a second one",
        minimum=1,
        maximum=LONGEST_WINDOW,
        advanced=True,
    )
    tentative_deletion_misses: int = parameter(
        2,
        "m_of_n: scans in a row without a detection that end a tentative track; 0: never",
        minimum=0,
        advanced=True,
    )
    missed_track_hypotheses: str = parameter(
        "zero",
        "attribute hypotheses that miss a track: zero weight when a fuller one exists, or the "
        "products of table 14.3",
        choices=MISSED_TRACK_HYPOTHESES,
        advanced=True,
    )
    mht_retrodiction: bool = parameter(
        True,
        "mht: states of tracks_delayed are retrodicted: they know the detections of the N scans "
        "after them",
        advanced=True,
    )
    mht_leaf_probability: float = parameter(
        1e-3,
        "mht: branches less probable are cut",
        minimum=0.0,
        maximum=0.5,
        advanced=True,
    )
    mht_leaves_per_track: int = parameter(
        10, "mht: branches kept per track", minimum=1, maximum=10_000, advanced=True
    )
    mht_merge_scans: int = parameter(
        0,
        "mht: branches of a track with the same detections in so many last scans are merged if "
        "they are near each other; 0: never",
        minimum=0,
        maximum=LONGEST_WINDOW,
        advanced=True,
    )
    mht_merge_distance: float = parameter(
        0.5,
        "mht: Mahalanobis distance of the states of branches that are merged",
        minimum=0.0,
        advanced=True,
    )
    mht_merge_belief: float = parameter(
        0.05,
        "mht: largest difference of a class probability or mass of branches that are merged",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )
    mht_max_leaves: int = parameter(
        20_000, "mht: branches kept in all", minimum=1, maximum=1_000_000, advanced=True
    )
    mht_new_target_ratio: float = parameter(
        0.1,
        "mht: new targets per false alarm; the score with which a track starts",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    elevation_std_rad: float = parameter(
        0.01,
        "elevation noise of detections that bring none of their own",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        minimum_excluded=True,
        advanced=True,
    )
    range_rate_std_mps: float = parameter(
        1.0,
        "range-rate noise of detections that bring none of their own",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    max_tracks: int = parameter(
        2000, "no track starts while so many live", minimum=1, maximum=100_000, advanced=True
    )
    max_detections_per_scan: int = parameter(
        5000, "a scan with more is rejected", minimum=1, maximum=100_000, advanced=True
    )
    max_gap_s: float = parameter(
        60.0,
        "silence after which the tracks end and new ones start",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    time_jump_s: float = parameter(
        10.0,
        "a stamp older than the newest by less is late, by more a restarted time axis (tracks are "
        "reset, ids go on)",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    reorder_window_s: float = parameter(
        0.0,
        "a scan waits until one newer by this has come, so that scans of several sensors that "
        "arrive out of order are worked off in order; 0: each is taken as it comes",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    reorder_sensors: list[str] = parameter(
        [],
        "sensor ids that send regularly: a scan waits no longer once each has sent one at least "
        "as new; only with a reorder_window_s",
        advanced=True,
    )
    reorder_timeout_s: float = parameter(
        1.0,
        "a scan waits for newer ones no longer than this on the clock on the wall; 0: for ever",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    statement_max_age_s: float = parameter(
        60.0,
        "a statement older than the newest scan by more is rejected",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    statement_max_ahead_s: float = parameter(
        60.0,
        "a statement ahead of the newest scan by more is rejected; by less, it waits for its time",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    max_statements: int = parameter(
        20, "statements that may wait for a scan", minimum=1, maximum=1000, advanced=True
    )
    statements_depth: int = parameter(
        100,
        "history depth of the statements subscription",
        minimum=1,
        maximum=10_000,
        live=False,
        advanced=True,
    )
    queue_depth: int = parameter(
        100, "scans that may wait", minimum=1, maximum=10_000, live=False, advanced=True
    )
    detections_depth: int = parameter(
        100,
        "history depth of the detections subscription, at least queue_depth",
        minimum=1,
        maximum=10_000,
        live=False,
        advanced=True,
    )
    detections_reliability: str = parameter(
        "best_effort",
        "reliability of the detections subscription; best_effort takes both kinds",
        choices=("best_effort", "reliable"),
        live=False,
        advanced=True,
    )
    retry_period_s: float = parameter(
        2.0,
        "age of an open scan at which it is sent again; doubles up to 30 s",
        unit="s",
        minimum=0.1,
        maximum=30.0,
        live=False,
        advanced=True,
    )
    attribute_timeout_s: float = parameter(
        0.0,
        "age of an open scan at which association goes on with kinematics alone; 0: never",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    scan_timeout_s: float = parameter(
        0.0,
        "age of an open scan at which it is given up and tracks are only predicted; 0: never",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    stale_after_s: float = parameter(
        10.0,
        "silence of the input after which diagnostics say stale",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    use_range_rate: bool = parameter(
        True,
        "update states also with the range rates that detections bring; false for a sensor whose "
        "own motion is still in them",
        advanced=True,
    )
    imm_process_noise_factors: list[float] = parameter(
        [0.2, 1.3],
        "process noise of each model of imm, as a multiple of process_noise_std_mps2",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    imm_mean_sojourn_s: list[float] = parameter(
        [20.0, 20.0],
        "mean time that a target stays in each model of imm before it changes to another",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def __post_init__(self) -> None:
        models = len(self.imm_process_noise_factors)
        if not 1 <= models <= MOST_MODELS:
            raise ParameterError(
                f"parameter imm_process_noise_factors = {self.imm_process_noise_factors}: allowed "
                f"are 1 to {MOST_MODELS} numbers"
            )
        if len(self.imm_mean_sojourn_s) != models:
            raise ParameterError(
                f"parameter imm_mean_sojourn_s = {self.imm_mean_sojourn_s}: allowed are {models} "
                f"numbers, one for each of imm_process_noise_factors"
            )
        if self.confirmation_hits > self.confirmation_scans:
            raise ParameterError(
                f"parameter confirmation_hits = {self.confirmation_hits}: allowed is at most "
                f"confirmation_scans = {self.confirmation_scans}"
            )
        if self.reorder_window_s > self.time_jump_s:
            raise ParameterError(
                f"parameter reorder_window_s = {self.reorder_window_s}: allowed is at most "
                f"time_jump_s = {self.time_jump_s}"
            )
        if self.reorder_sensors and not self.reorder_window_s:
            raise ParameterError(
                f"parameter reorder_sensors = {self.reorder_sensors}: allowed only with a "
                "reorder_window_s above 0, after which a silent sensor is not waited for"
            )
        sequential_test(self.false_track_probability, self.missed_track_probability)
        if self.detections_depth < self.queue_depth:
            raise ParameterError(
                f"parameter detections_depth = {self.detections_depth}: allowed is at least "
                f"queue_depth = {self.queue_depth}"
            )
        if self.history_policy == "forgetting" and self.forgetting_factor >= 1.0:
            raise ParameterError(
                "parameter history_policy = 'forgetting': allowed with a forgetting_factor below "
                f"1, which is {self.forgetting_factor:g}"
            )
        if self.history_policy == "window" and self.history_window < 1:
            raise ParameterError(
                "parameter history_policy = 'window': allowed with a history_window of at least "
                f"1, which is {self.history_window}"
            )

    @property
    def share_kept(self) -> float:
        """Share of the history kept at each detection: the forgetting factor, if that acts."""
        return self.forgetting_factor if self.history_policy == "forgetting" else 1.0

    @property
    def window_rows(self) -> int:
        """Rows of evidence kept of each hypothesis: one less than the window, 0 without one."""
        return self.history_window - 1 if self.history_policy == "window" else 0
