"""What the counters of the nodes mean and what to do about them.

Every name that a node of the tracker counts stands here; a test compares it with the source.
"""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING


@dataclass(frozen=True)
class Explanation:
    """What a counter means; ``level`` is that of a finding when it rises, empty if all is well."""

    level: str
    meaning: str
    fix: str = ""


def _of(level: str, meaning: str, fix: str = "") -> Explanation:
    return Explanation(level, meaning, fix)


_VERSIONS = "restart all nodes from one installation; gda-tracker doctor compares the messages"
_RESTARTED = "nothing, if the track_manager was restarted; else look for a second one"
_DRIVER = "mend the driver: msg_schemas/msg/DetectionArray.msg states every field"
_MODEL = "change the driver, or the sensor's entry in sensor_models (docs/sensor-models.md)"

EXPLANATIONS: dict[str, Explanation] = {
    # classes
    "class_motion_unknown_class": _of(
        ERROR,
        "class_motion_names speaks of a class that class_names of rcs_fuzzifier has not",
        "make class_motion_names names of class_names (docs/class-motion.md)",
    ),
    "class_motion_window_too_short": _of(
        WARNING,
        "class_motion_scans scans last less than class_motion_span_s: acceleration tells nothing",
        "make class_motion_scans larger, or class_motion_span_s smaller (docs/class-motion.md)",
    ),
    # scans that were refused as a whole
    "rejected_late": _of(
        ERROR,
        "scans are older than the newest one of that time axis",
        "several sensors out of order: gda-tracker params set reorder_window_s=0.2 (as long as the "
        "slowest is late); one sensor: its stamps step back, see the driver's clock",
    ),
    "rejected_queue_full": _of(
        ERROR,
        "scans come faster than they are worked off",
        "gda-tracker params set mht_leaves_per_track=3, or decision=map; or fewer detections "
        "(minimum_snr_db, moving_above_mps)",
    ),
    "rejected_missing_sensor_id": _of(ERROR, "scans without a sensor_id", _DRIVER),
    "rejected_stamp_out_of_range": _of(ERROR, "scans with a negative stamp", _DRIVER),
    "rejected_too_many_detections": _of(
        ERROR,
        "scans with more detections than max_detections_per_scan",
        "gda-tracker params set max_detections_per_scan=20000, or leave out the weak ones "
        "(minimum_snr_db) and what stands still (moving_above_mps)",
    ),
    "rejected_malformed": _of(ERROR, "messages that cannot be read", _DRIVER),
    "rejected_malformed_array": _of(ERROR, "scans with an array that holds no numbers", _DRIVER),
    "rejected_array_length_mismatch": _of(
        ERROR, "scans whose arrays have different lengths", _DRIVER
    ),
    "rejected_bad_attribute_names": _of(
        ERROR, "scans with attribute names that are empty or stand twice", _DRIVER
    ),
    "rejected_bad_sensor_pose": _of(
        ERROR, "scans whose sensor pose is not finite or no unit quaternion", _DRIVER
    ),
    "rejected_range_rate_missing": _of(
        ERROR, "scans without the range rates that the sensor's model measures", _MODEL
    ),
    "rejected_elevation_with_model": _of(
        ERROR, "scans with elevations of a sensor whose model is one of the plane", _MODEL
    ),
    "rejected_time_offset_with_model": _of(
        ERROR, "scans with time offsets of a sensor with a model of its own", _MODEL
    ),
    "rejected_tilted_sensor": _of(
        ERROR, "scans with azimuths of a tilted sensor, whose model is one of the plane", _MODEL
    ),
    "rejected_bad_sensor_velocity": _of(
        ERROR, "scans whose sensor_velocity_mps is not finite or beyond 1e6 m/s", _DRIVER
    ),
    "rejected_reference_missing": _of(
        ERROR,
        "scans of a pair of sensors that do not say where the second one is",
        "set reference_position_m in the detections, or sensor_references_m in the parameters",
    ),
    "rejected_bad_reference": _of(
        ERROR, "scans whose reference position or velocity is not finite or too large", _DRIVER
    ),
    "rejected_initial_tracks_malformed": _of(ERROR, "initial tracks that cannot be used", _DRIVER),
    "rejected_initial_tracks_not_finite": _of(ERROR, "initial tracks with NaN or inf", _DRIVER),
    "rejected_initial_tracks_bad_covariance": _of(
        ERROR, "initial tracks whose covariance is not positive definite", _DRIVER
    ),
    "malformed_initial_tracks": _of(ERROR, "initial tracks that cannot be read", _DRIVER),
    # detections that were left out or mended
    "not_finite": _of(WARNING, "detections with NaN or inf in position or range rate", _DRIVER),
    "negative_range": _of(WARNING, "detections with a negative range", _DRIVER),
    "zero_range": _of(
        WARNING,
        "detections with range 0, often padding",
        "gda-tracker params set padding_zeros=true",
    ),
    "range_too_large": _of(WARNING, "detections beyond 1e9 m: is the range in m?", _DRIVER),
    "time_offset_too_large": _of(WARNING, "detections more than 60 s from the stamp", _DRIVER),
    "bad_noise": _of(
        WARNING, "detections whose noise is no variance (negative, zero, infinite)", _DRIVER
    ),
    "azimuth_wrapped": _of(
        NOTE,
        "azimuths beyond +-pi, taken modulo 2 pi: degrees taken for radians?",
        "gda-tracker params set angle_unit=deg, if the driver publishes degrees",
    ),
    "rcs_not_finite": _of(NOTE, "radar cross sections that are NaN or inf: count as unknown"),
    "rcs_negative": _of(
        WARNING,
        "negative radar cross sections, which no m2 can be: dBsm taken for m2?",
        "gda-tracker params set rcs_unit=dbsm, or convert in the driver: 10^(dBsm / 10)",
    ),
    "attribute_not_finite": _of(NOTE, "further attributes that are NaN or inf: count as unknown"),
    "signal_strength_out_of_range": _of(
        WARNING,
        "signal strengths below the threshold or beyond any receiver: taken as the nearest that is "
        "possible; another unit, or another false alarm probability than the detector's?",
        "gda-tracker params set signal_strength_unit=decibel, or false_alarm_probability to that "
        "of the detector",
    ),
    "max_tracks_reached": _of(
        WARNING,
        "tracks that found no room: too much clutter starts tracks, or max_tracks is too small",
        "gda-tracker params set confirmation_hits=4 confirmation_scans=5, or max_tracks=5000",
    ),
    # time
    "reset_time_jump": _of(
        WARNING,
        "stamps went back by more than time_jump_s, so the tracks were reset (a bag loops?)",
        "play the bag without --loop, or stop the second source of the same sensor",
    ),
    "reset_reset": _of("", "resets that somebody asked for"),
    "reset_gap": _of(
        WARNING,
        "silence of more than max_gap_s, after which all tracks end",
        "gda-tracker params set max_gap_s=300, if the sensor is that slow",
    ),
    "repeated": _of(NOTE, "scans that had been answered before and came again"),
    "duplicate": _of(
        WARNING,
        "scans that waited already: somebody publishes each scan twice",
        "ros2 topic info -v detections; stop one of the publishers",
    ),
    "sequence_gap": _of(
        WARNING,
        "scans that the driver numbered and that never came",
        "gda-tracker params get detections_depth; start with detections_reliability: reliable if "
        "the driver publishes reliably",
    ),
    "message_lost": _of(
        WARNING,
        "messages that the middleware lost in the queue of the subscription",
        "start with a larger detections_depth, or make the ring faster (decision=map)",
    ),
    "dropped_at_initialisation": _of(NOTE, "scans of the run before the initial tracks"),
    # the ring
    "retry": _of(
        ERROR,
        "open scans that a stage did not answer and that were sent again",
        "look at the nodes above; gda-tracker run --processes restarts a node that ends",
    ),
    "not_open": _of(NOTE, "answers to a scan that is closed already, after a retry or restart"),
    "inconsistent_answer": _of(
        ERROR, "answers of a stage that do not fit the open scan", _VERSIONS
    ),
    "older_epoch": _of(NOTE, "messages of a track_manager that was restarted", _RESTARTED),
    "incomplete": _of(NOTE, "scans that a stage began and did not finish", _RESTARTED),
    "overflow": _of(WARNING, "more scans at a time than a stage holds", _RESTARTED),
    "failed": _of(
        ERROR,
        "scans on which a stage failed",
        "read the node's log: the error stands there; gda-tracker params list --changed",
    ),
    "checkpoint_failed": _of(
        WARNING,
        "states that could not be written: a restart would begin with an older one",
        "df -h, and the rights of the folder of checkpoint_path",
    ),
    "malformed_scans": _of(ERROR, "scans that a stage cannot read", _VERSIONS),
    "malformed_predictions": _of(ERROR, "predictions that a stage cannot read", _VERSIONS),
    "malformed_evidence": _of(ERROR, "evidence that a node cannot read", _VERSIONS),
    "malformed_attribute_scores": _of(ERROR, "scores that a node cannot read", _VERSIONS),
    "malformed_associations": _of(ERROR, "associations that cannot be read", _VERSIONS),
    "tracked": _of("", "scans that were tracked"),
    "degraded": _of(
        WARNING,
        "scans decided by kinematics alone, because attribute_fusion did not answer in time",
        "gda-tracker params set attribute_timeout_s=0, or find out why attribute_fusion is slow",
    ),
    "gave_up": _of(
        ERROR,
        "scans given up, because the stages did not answer within scan_timeout_s",
        "gda-tracker params set scan_timeout_s=0, or find out which stage is slow",
    ),
    # statements
    "statement_admitted": _of("", "statements that were taken in"),
    "statement_of_unknown_class": _of(
        WARNING,
        "statements that name a class that the tracker does not have",
        "gda-tracker params get class_names, and use these names",
    ),
    "dropped_statement_too_old": _of(
        NOTE, "statements that waited too long", "gda-tracker params set statement_max_age_s=120"
    ),
    "dropped_statement_too_far_ahead": _of(
        NOTE, "statements of a time that lies too far ahead, after a jump of time"
    ),
    "dropped_statement_gone_track": _of(NOTE, "statements about a track that ended before"),
    # radar_input
    "received": _of("", "messages of the radar"),
    "malformed_cloud": _of(
        ERROR, "clouds whose fields and bytes do not fit", "gda-tracker inspect TOPIC"
    ),
    "fields_do_not_fit": _of(
        ERROR,
        "messages without the fields that the parameters name",
        "gda-tracker inspect TOPIC --yaml my_radar.yaml",
    ),
    "bad_stamp": _of(
        ERROR, "messages whose stamp is no time", "gda-tracker params set stamp_source=received"
    ),
    "stamp_unset": _of(
        ERROR,
        "messages with stamp 0: the driver leaves it empty",
        "gda-tracker params set stamp_source=received",
    ),
    "stamp_repeated": _of(
        WARNING,
        "messages with the stamp of the one before",
        "gda-tracker params set stamp_source=received, if the driver's clock stands",
    ),
    "stamp_stepped_back": _of(
        WARNING, "messages with a stamp before that of the one before", "one driver per topic"
    ),
    "no_clock": _of(
        ERROR,
        "messages that came before there was a time: use_sim_time is true and /clock is silent",
        "play the bag with --clock, or start with use_sim_time:=false",
    ),
    "tilted_too_far": _of(
        ERROR,
        "scans of a radar without elevation that is tilted by more than maximum_tilt_deg",
        "mend the radar's pose, or gda-tracker params set maximum_tilt_deg=45",
    ),
    "tf_queue_full": _of(
        ERROR,
        "scans dropped because too many waited for their transforms",
        "ros2 run tf2_ros tf2_echo map RADAR_FRAME: who publishes the radar's pose, and how late?",
    ),
    "odometry_received": _of("", "reports of odometry"),
    "odometry_refused": _of(
        ERROR,
        "reports of odometry without a frame, or whose stamp, twist or pose are no numbers",
        "ros2 topic echo odom --once: child_frame_id, and orientation of length one",
    ),
    "odometry_unknown_frame": _of(
        ERROR,
        "reports of odometry of another vehicle, or told in another frame than tracking_frame",
        "gda-tracker params get odometry_frame tracking_frame; one publisher per topic",
    ),
    "odometry_jumped_back": _of(
        NOTE, "times the clock of the odometry was set back (a bag loops): it began anew"
    ),
    "rejected_reset": _of("", "scans that waited when somebody asked for a reset"),
    "renewed_subscription": _of(
        "", "subscriptions made anew because nothing was heard though somebody publishes"
    ),
    "topics_without_type": _of(
        WARNING,
        "topics that are not recorded because the package of their type is not installed",
        "install the package that the log names",
    ),
    "padding": _of("", "points at 0, 0, 0 that fill up the message"),
    "too_close": _of("", "detections closer than minimum_range_m"),
    "too_far": _of("", "detections beyond maximum_range_m"),
    "too_weak": _of("", "detections below minimum_snr_db"),
    "standing_still": _of("", "detections that stand still (moving_above_mps)"),
    "small_cluster": _of("", "points of clusters of fewer than cluster_minimum_points"),
    "sensor_motion_unknown": _of(
        WARNING,
        "scans in which the radar's own speed could not be estimated",
        "gda-tracker params set sensor_motion=declared sensor_speed_mps=...",
    ),
    "rcs_unknown": _of(
        NOTE,
        "radar cross sections that cannot be one",
        "gda-tracker inspect TOPIC says what they look like",
    ),
    "rcs_all_equal": _of(
        WARNING,
        "scans in which all radar cross sections are the same, so they tell nothing",
        "gda-tracker params set rcs_unit=none",
    ),
    # set_valued_tracker
    "azimuth_too_coarse": _of(
        WARNING,
        "detections with an azimuth error above 0.5 rad, which tell no position",
        "azimuth_std_rad of the detections, or a radar that is tilted: elevation too high",
    ),
    "tracks_started": _of("", "tracks begun"),
    "tracks_ended": _of("", "tracks of which the last set ended"),
    "sets_coasted_out": _of("", "sets that ended without detections"),
    "sets_far_below_best": _of("", "sets that ended because their score was too low"),
    "sets_merged": _of("", "sets that became one with another of their track"),
    "sets_duplicate": _of("", "sets that followed the same detections as another track's"),
    "sets_over_track_limit": _of(
        NOTE,
        "sets beyond max_sets_per_track: more associations are possible than are kept",
        "set_valued_tracker: a smaller theta, a larger boldness, or max_sets_per_track",
    ),
    "sets_over_limit": _of(
        WARNING,
        "sets beyond max_sets: clutter starts too many tracks",
        "set_valued_tracker: a larger max_sets, or a smaller initial_speed_radius_mps",
    ),
    # fusion of the tracks of several radars
    "malformed_radar_tracks": _of(ERROR, "tracks of a radar that cannot be read", _VERSIONS),
    "refused_repeated": _of(NOTE, "tracks of a radar that had come with the same stamp before"),
    "refused_backwards": _of(
        WARNING,
        "tracks of a radar that are older than its last ones",
        "ros2 topic info -v on its tracks: a second track_manager may publish there",
    ),
    "refused_too_old": _of(
        WARNING,
        "tracks far behind the last fusion: the radars' clocks differ, or one is very late",
        "compare the clocks (age_s of each radar in /diagnostics), or raise silent_after_s",
    ),
    "refused_frame": _of(
        ERROR,
        "tracks in another frame than fusion_frame",
        "start with alignment: tf or poses, or give all trackers the same tracking_frame",
    ),
    "refused_no_transform": _of(
        WARNING,
        "tracks for which /tf has no transform into fusion_frame at their time",
        "ros2 topic echo /tf_static; is the frame of the tracks connected to fusion_frame?",
    ),
    "refused_tilted_frame": _of(
        ERROR, "tracks in a frame that leans against fusion_frame, but tracks lie in the plane"
    ),
    "refused_too_many_tracks": _of(
        ERROR,
        "messages with more tracks than max_tracks_per_radar",
        "gda-tracker params set confirmation_hits=4, or raise max_tracks_per_radar",
    ),
    "refused_state_size": _of(ERROR, "tracks whose states are not x, y, vx, vy", _VERSIONS),
    "track_not_finite": _of(WARNING, "tracks of a radar with NaN, inf or beyond 1e9 m"),
    "track_covariance_not_valid": _of(
        WARNING, "tracks of a radar whose covariance is not positive definite"
    ),
    "track_id_twice": _of(WARNING, "tracks with the id of another one in the same message"),
    "class_belief_not_valid": _of(
        NOTE, "tracks whose class probabilities are not valid: they tell nothing of the class"
    ),
    "radar_restarted": _of(NOTE, "tracker of a radar started anew: its tracks are other ones"),
    "radar_resumed": _of(NOTE, "tracker of a radar came back with the tracks that it had"),
    "fusion_began_anew": _of(
        WARNING,
        "stamps of a radar went back by more than time_jump_s, so the fusion began anew (a bag "
        "loops?)",
        "play the bag without --loop",
    ),
    "biases_begun_anew": _of(
        WARNING,
        "other biases join more tracks than those that were learnt, which were dropped: a radar "
        "was moved, or tracks had been joined wrongly",
        "look at association_bias on track_associations; gda-tracker params set bias_memory_s=600",
    ),
    "track_noise_larger_than_told": _of(
        NOTE,
        "updates of tracks that grew less certain than their motion model says: the part that "
        "would count negative is left out",
        "track_process_noise_std_mps2 of track_fusion must be that of the trackers or less",
    ),
    "tracks_left_as_they_were": _of(
        WARNING,
        "fusions in which tracks were too many to associate anew, or no association was possible",
        "raise max_associated_tracks, or give bias_std_m: known biases divide the problem",
    ),
    "fusion_failed": _of(ERROR, "tracks on which the fusion broke and began anew", _VERSIONS),
    "fusion_without_message": _of(ERROR, "fusions that do not fit into a message", _VERSIONS),
    # source and evaluator
    "resent": _of(NOTE, "scans that the source sent again, since no answer came"),
    "statement_resent": _of(NOTE, "statements that the source sent again"),
    "too_many_scans": _of(NOTE, "scans that the evaluator does not score any more"),
    "malformed_tracks": _of(ERROR, "tracks that a node cannot read", _VERSIONS),
    "not_drawn": _of(
        WARNING, "messages with tracks that are not shown: their state is not finite", _VERSIONS
    ),
    "tracks_time_backwards": _of(
        ERROR,
        "tracks older than the last ones: they are not tested for events",
        "two trackers on one topic? gda-tracker doctor",
    ),
    "tracks_other_frame": _of(
        ERROR,
        "tracks in another frame than the lanes and plans of track_events",
        "frame_id in the context_file must be the tracking_frame of the track_manager",
    ),
    "tracks_state_too_small": _of(ERROR, "tracks without position and velocity", _VERSIONS),
    "tracks_duplicate_track_id": _of(
        ERROR, "messages in which a track stands twice: they are not tested for events", _VERSIONS
    ),
    "event_track_not_finite": _of(
        WARNING, "tracks not tested for events: state or covariance is no number", _VERSIONS
    ),
    "event_track_bad_covariance": _of(
        WARNING, "tracks not tested for events: covariance not positive definite", _VERSIONS
    ),
    "formation_track_not_finite": _of(
        WARNING, "tracks in no formation: state or covariance is no number", _VERSIONS
    ),
    "formation_track_bad_covariance": _of(
        WARNING, "tracks in no formation: covariance not positive definite", _VERSIONS
    ),
    "formation_scan_repeated": _of(
        "", "answers that came again: their detections are not counted twice"
    ),
    "formation_scans_without_count": _of(
        "", "scans with tracks alone: formations were kept, their objects not counted"
    ),
    "formations_began_anew": _of("", "times that all formations began anew with the tracker"),
    "began_anew": _of("", "times that all tests of track_events began anew with the tracker"),
    "passed_over_a_lane": _of("", "tracks that crossed a lane without having kept to it"),
    "malformed_truth": _of(ERROR, "truth that the evaluator cannot read", _VERSIONS),
}

# Why a scan found no odometry, as OdometryError names it.
_ODOMETRY_LATE = "gda-tracker params set tf_timeout_s=1.0; compare the clocks of radar and odometry"
ODOMETRY_REASONS = {
    "missing": _of(
        ERROR,
        "scans dropped before any odometry came",
        "ros2 topic hz odom; gda-tracker params get odometry_topic",
    ),
    "too_late": _of(ERROR, "scans newer than all odometry", _ODOMETRY_LATE),
    "too_early": _of(NOTE, "scans older than all odometry, at the start or after a jump of time"),
    "gap": _of(
        ERROR,
        "scans between two reports of odometry that are too far apart",
        "gda-tracker params set odometry_gap_s=1.0, if it comes that slowly",
    ),
    "no_pose": _of(
        ERROR,
        "scans whose pose should come from a topic that tells twists alone",
        "start with odometry_topic: a nav_msgs/Odometry, or pose_source: tf",
    ),
}
OUT_OF_RANGE = "_out_of_range"
STATEMENT_REJECTED = "statement_rejected_"
RECORDED = "recorded "


def explanation(counter: str) -> Explanation | None:
    """Return what a counter means, ``None`` for a name that no node of this version counts."""
    if counter in EXPLANATIONS:
        return EXPLANATIONS[counter]
    if counter.startswith("odometry_"):
        return ODOMETRY_REASONS.get(counter.removeprefix("odometry_"))
    if counter.startswith(STATEMENT_REJECTED):
        from gda_tracker.tracking.statement_door import EXPLANATIONS as STATEMENTS

        reason = counter.removeprefix(STATEMENT_REJECTED)
        if reason not in STATEMENTS:
            return None
        return Explanation(
            WARNING,
            f"statements that were refused ({reason}): required is that {STATEMENTS[reason]}",
            "gda-tracker say FILE.yaml --check",
        )
    if counter.endswith(OUT_OF_RANGE):
        name = counter.removesuffix(OUT_OF_RANGE)
        return Explanation(
            NOTE,
            f"values of {name} that count as unknown",
            "compare rcs_min_m2 and rcs_max_m2, or attribute_minimum and attribute_maximum",
        )
    if counter.startswith("formation event "):
        return Explanation("", f"formations that {counter.removeprefix('formation event ')}")
    if counter.startswith("event "):
        return Explanation("", f"events of kind {counter.removeprefix('event ')}")
    return Explanation("", "messages in the bag") if counter.startswith(RECORDED) else None
