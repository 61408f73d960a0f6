"""Objects of every vocabulary class filled with hard numbers, and their exact comparison."""

from __future__ import annotations

import dataclasses

import numpy as np

from gda_tracker.vocabulary import (
    Associations,
    AssociationSettings,
    AttributeScores,
    Detections,
    Evidence,
    Predictions,
    Scan,
    ScanKey,
    ScanReport,
    ScanTruth,
    Statement,
    StatementPiece,
    StatementRegion,
    StatementReport,
    Tracks,
    TrackSetArray,
)
from gda_tracker.vocabulary.extents import PredictedExtents, ScanCells

KEY = ScanKey(2**64 - 1, "radar north", 1_620_205_606_919_338_123)
FRAME = ("VS", "S", "B")
CLASSES = ("false_alarm", "fighter", "cargo")
# a NaN with a payload, signed zero, the smallest subnormal, infinities, 1/3
HARD = np.array(
    [0x7FF8_0000_DEAD_BEEF, 1 << 63, 1, 0x7FF << 52, 0xFFF << 52, 0x3FD5_5555_5555_5555],
    dtype=np.uint64,
).view(np.float64)


def floats(*shape: int, seed: int = 0) -> np.ndarray:
    """Return normal numbers, the first ones replaced by the hard ones."""
    values = np.random.default_rng([seed, *shape]).standard_normal(shape)
    count = min(len(HARD), values.size)
    values.reshape(-1)[:count] = HARD[:count]
    return values


def assert_identical(actual: object, expected: object) -> None:
    """Compare two vocabulary objects field by field: types, shapes and every bit."""
    assert type(actual) is type(expected)
    for item in dataclasses.fields(expected):
        left, right = getattr(actual, item.name), getattr(expected, item.name)
        if isinstance(right, np.ndarray):
            assert isinstance(left, np.ndarray), item.name
            assert left.dtype == right.dtype, item.name
            assert left.shape == right.shape, item.name
            assert left.tobytes() == right.tobytes(), item.name
        else:
            assert type(left) is type(right), item.name
            assert left == right, item.name


def statement_region(shape: str = "sector") -> StatementRegion:
    """Return a region with every field set."""
    hard = tuple(HARD[1:].tolist())  # without NaN, which is equal to nothing
    return StatementRegion(shape, hard[:2], hard[1:5], hard[2:4], (), hard, *hard[:4])


def statement_piece(count: int = 2) -> StatementPiece:
    """Return a piece with so many classes."""
    grades = tuple(HARD[1 : 1 + count].tolist())
    return StatementPiece(statement_region(), CLASSES[:count], grades, 1.0 / 3.0)


def statement(pieces: int = 3) -> Statement:
    """Return a statement with every field set."""
    return Statement(
        source="Ausguck",
        sequence=2**64 - 1,
        stamp_ns=KEY.stamp_ns,
        kind="fds",
        about="track",
        pieces=tuple(statement_piece(count) for count in range(pieces)),
        track_id=-(2**63),
        reliability=1.0 / 3.0,
        rule="classes_imply_region",
        frame_id="map",
    )


def statement_report() -> StatementReport:
    """Return a report with every field set."""
    return StatementReport("Ausguck", 2**64 - 1, KEY.stamp_ns, "rejected", "too_old", 2**32 - 1)


def detections(count: int = 7, full: bool = True) -> Detections:
    """Return detections, with every optional quantity if ``full``."""
    optional = {
        "elevation_rad": floats(count, seed=3),
        "range_rate_mps": floats(count, seed=4),
        "rcs_m2": floats(count, seed=5),
        "rcs_valid": np.arange(count) % 2 == 1,
        "range_std_m": floats(1, seed=6),
        "azimuth_std_rad": floats(count, seed=7),
        "elevation_std_rad": floats(1, seed=8),
        "range_rate_std_mps": floats(count, seed=9),
        "covariance": floats(count, 4, 4, seed=10),
        "time_offset_s": floats(count, seed=11),
        "sensor_position_m": np.array([1.5, -0.0, np.nan]),
        "sensor_orientation_xyzw": np.array([0.1, 0.2, 0.3, 0.9]),
        "attribute_names": ("length_m", "esm_class"),
        "attribute_values": floats(2, count, seed=12),
        "attribute_valid": np.arange(2 * count).reshape(2, count) % 3 == 1,
        "sensor_velocity_mps": floats(3, seed=13),
        "reference_position_m": floats(3, seed=14),
        "reference_velocity_mps": floats(3, seed=15),
    }
    return Detections(
        sensor_id=KEY.sensor_id,
        stamp_ns=KEY.stamp_ns,
        range_m=floats(count, seed=1),
        azimuth_rad=floats(count, seed=2),
        frame_id="radar_link",
        sequence=2**64 - 1,
        **(optional if full else {}),
    )


def scan(count: int = 7, full: bool = True) -> Scan:
    """Return an admitted scan."""
    optional = {
        "elevation_rad": floats(count, seed=3),
        "range_rate_mps": floats(count, seed=4),
        "time_offset_s": floats(count, seed=5),
        "attribute_names": ("length_m", "esm_class", "länge"),
        "attribute_values": floats(3, count, seed=8),
        "attribute_valid": np.arange(3 * count).reshape(3, count) % 2 == 1,
        "statements": (statement(), statement(0)),
        "sensor_model": "tdoa_fdoa",
        "sensor_velocity_mps": floats(3, seed=9),
        "reference_position_m": floats(3, seed=10),
        "reference_velocity_mps": floats(3, seed=11),
        "relative_clutter_density": floats(count, seed=12),
    }
    size = 4 if full else 2
    return Scan(
        key=KEY,
        frame_id="map",
        sensor_position_m=np.array([1.5, -2.5, 3.5]),
        sensor_orientation_xyzw=np.array([0.0, 0.0, 0.6, 0.8]),
        source_index=np.arange(count, dtype=np.int32) * 3,
        range_m=floats(count, seed=1),
        azimuth_rad=floats(count, seed=2),
        noise_covariance=floats(count, size, size, seed=6),
        rcs_m2=floats(count, seed=7),
        rcs_valid=np.arange(count) % 3 == 0,
        **(optional if full else {}),
    )


def scan_of_cells(count: int = 3) -> Scan:
    """Return an admitted scan of extended objects."""
    size = np.arange(1, count + 1, dtype=np.int32)
    cells = ScanCells(
        count=size,
        scatter=floats(count, 2, 2, seed=21),
        noise=floats(count, 2, 2, seed=22),
        log_false=floats(count, seed=23),
        member=np.arange(size.sum(), dtype=np.int32)[::-1].copy(),
        probability=1.0 / 3.0,
    )
    return dataclasses.replace(scan(count, full=False), cells=cells)


def extended_predictions(count: int = 5) -> Predictions:
    """Return predictions of extended objects."""
    extents = PredictedExtents(
        floats(count, 2, 2, seed=24),
        floats(count, seed=25),
        floats(count, seed=26),
        floats(count, seed=27),
        0.25,
    )
    return dataclasses.replace(predictions(count), extents=extents)


def extended_tracks(count: int = 4) -> Tracks:
    """Return tracks of extended objects."""
    number = np.arange(count, dtype=np.int32)
    return dataclasses.replace(
        tracks(count),
        extent=floats(count, 2, 2, seed=28),
        extent_weight=floats(count, seed=29),
        expected_detections=floats(count, seed=30),
        detection_count=number,
        detection_rows=np.arange(number.sum(), dtype=np.int32) * 3,
    )


def evidence(count: int = 7, focal: int = 4) -> Evidence:
    """Return evidence on n detections."""
    return Evidence(
        key=KEY,
        frame=FRAME,
        focal=np.arange(1, focal + 1, dtype=np.uint32),
        masses=floats(count, focal, seed=1),
        class_names=CLASSES,
        log_class_likelihood=floats(count, len(CLASSES), seed=2),
        class_probability=floats(count, len(CLASSES), seed=3),
        informative=np.arange(count) % 2 == 0,
    )


def predictions(
    count: int = 5, components: int = 2, focal: int = 19, policy: str = "none", rows: int = 0
) -> Predictions:
    """Return predictions of Gaussian mixtures, with history windows of so many rows."""
    total = count * components
    window = {
        "window_focal": np.arange(3, 7, dtype=np.uint32),
        "window_kind": (np.arange(count * rows, dtype=np.int32) % 3).reshape(count, rows),
        "window_masses": floats(count, rows, 4, seed=7),
        "window_log_class_likelihood": floats(count, rows, len(CLASSES), seed=8),
    }
    settings = AssociationSettings(
        "map",
        "bayes",
        "table_14_3",
        0.9999,
        1.0 / 3.0,
        True,
        history_policy=policy,
        forgetting_factor=1.0 / 7.0 if policy == "forgetting" else 1.0,
    )
    return Predictions(
        key=KEY,
        settings=settings,
        hypothesis_id=np.arange(count, dtype=np.int64) + 2**62,
        parent_id=np.arange(count, dtype=np.int64),
        track_id=np.arange(count, dtype=np.int64) // 2,
        detection_probability=floats(count, seed=1),
        component_start=np.arange(0, total + 1, components, dtype=np.int32),
        component_weight=floats(total, seed=2),
        component_model=(np.arange(total) % 256).astype(np.int32),
        component_mean=floats(total, 4, seed=3),
        component_covariance=floats(total, 4, 4, seed=4),
        frame=FRAME if focal else (),
        focal=np.arange(1, focal + 1, dtype=np.uint32),
        masses=floats(count, focal, seed=5),
        class_names=CLASSES,
        class_probability=floats(count, len(CLASSES), seed=6),
        **(window if rows else {}),
    )


def attribute_scores(
    pairs: int = 11, detections: int = 7, focal: int = 19, updated: int = 0
) -> AttributeScores:
    """Return candidate beliefs of gated pairs."""
    return AttributeScores(
        key=KEY,
        attribute_term="dsm_classic",
        has_distance=True,
        hypothesis=np.arange(pairs, dtype=np.int32) // 3,
        detection=np.arange(pairs, dtype=np.int32) % max(detections, 1),
        distance=floats(pairs, seed=1),
        log_likelihood=floats(pairs, seed=2),
        conflict=floats(pairs, seed=3),
        informative=np.arange(pairs) % 2 == 0,
        clutter_log_likelihood=floats(detections, seed=4),
        frame=FRAME,
        focal=np.arange(1, focal + 1, dtype=np.uint32),
        masses=floats(pairs, focal, seed=5),
        class_names=CLASSES,
        class_probability=floats(pairs, len(CLASSES), seed=6),
        updated_hypothesis=np.arange(updated, dtype=np.int32),
        updated_masses=floats(updated, focal, seed=7),
        updated_class_probability=floats(updated, len(CLASSES), seed=8),
    )


def associations(pairs: int = 11, hypotheses: int = 5, clusters: int = 3) -> Associations:
    """Return a decision."""
    return Associations(
        key=KEY,
        decision="gda",
        attribute_term="dsm_classic",
        degraded=True,
        hypothesis=np.arange(pairs, dtype=np.int32) // 3,
        detection=np.arange(pairs, dtype=np.int32),
        mahalanobis_squared=floats(pairs, seed=1),
        kinematic_log_likelihood=floats(pairs, seed=2),
        attribute_log_likelihood=floats(pairs, seed=3),
        p_kinematic=floats(pairs, seed=4),
        p_attribute=floats(pairs, seed=5),
        p_generalised=floats(pairs, seed=6),
        joint_marginal=floats(pairs, seed=7),
        chosen=np.arange(pairs) % 4 == 0,
        cluster=np.arange(pairs, dtype=np.int32) % max(clusters, 1),
        assigned_detection=np.arange(hypotheses, dtype=np.int32) - 1,
        cluster_engine=np.arange(clusters, dtype=np.int32) % 2,
        cluster_converged=np.arange(clusters) % 2 == 1,
        engine_names=("subset", "propagation"),
    )


def shared_associations(events: int = 5) -> Associations:
    """Return a decision with events of unresolved targets."""
    rows = np.arange(events, dtype=np.int32)
    return dataclasses.replace(
        associations(),
        group_first=rows,
        group_second=rows + 1,
        group_detection=rows - 1,
        group_unresolved=floats(events, seed=8),
        group_log_likelihood=floats(events, seed=9),
        group_marginal=floats(events, seed=10),
        group_chosen=rows % 2 == 0,
    )


def shared_predictions() -> Predictions:
    """Return predictions of a sensor that does not resolve all."""
    found = predictions()
    settings = dataclasses.replace(
        found.settings,
        resolution_range_m=1.0 / 3.0,
        resolution_azimuth_rad=1.0 / 7.0,
        unresolved_detection_probability=0.8,
    )
    return dataclasses.replace(
        found, settings=settings, group_candidate=np.arange(len(found)) % 2 == 0
    )


def tracks(count: int = 4, focal: tuple[int, ...] = ()) -> Tracks:
    """Return tracks."""
    ids = np.arange(count, dtype=np.int64)
    return Tracks(
        key=KEY,
        frame_id="map",
        system_uuid=bytes(range(16)),
        track_id=ids + 2**61,
        hypothesis_id=ids + 2**62,
        status=ids % 2,
        mean=floats(count, 4, seed=1),
        covariance=floats(count, 4, 4, seed=2),
        frame=FRAME if focal else (),
        focal=np.array(focal, dtype=np.uint32),
        masses=floats(count, len(focal), seed=3),
        class_names=CLASSES,
        class_probability=floats(count, len(CLASSES), seed=4),
        conflict=floats(count, seed=5),
        existence_probability=floats(count, seed=6),
        hits=ids + 3,
        misses=ids * 2,
        coasted_scans=ids,
        first_detection_ns=ids + 1_999_999_999,
        last_detection_ns=ids + KEY.stamp_ns,
        detection_index=np.arange(count, dtype=np.int32) - 1,
        deleted_track_id=np.array([4, 9], dtype=np.int64),
        degraded=True,
    )


def scan_report() -> ScanReport:
    """Return a report with every field set."""
    return ScanReport(
        key=KEY,
        outcome="rejected",
        reason="stamp is late by 3 ns",
        repeated=True,
        latency_s=1.0 / 3.0,
        detections_received=9,
        detections_admitted=7,
        rejected={"range_m is negative": 1, "azimuth_rad is not finite": 1},
        tracks_confirmed=2,
        tracks_tentative=2**32 - 1,
        queue_length=4,
        retries=5,
    )


def scan_truth(targets: int = 3, labelled: bool = True) -> ScanTruth:
    """Return the truth of one scan."""
    return ScanTruth(
        sensor_id=KEY.sensor_id,
        stamp_ns=KEY.stamp_ns,
        target_id=np.arange(targets, dtype=np.int32),
        target_state=floats(targets, 4, seed=1),
        source_id=np.array([0, -1, 2], dtype=np.int32) if labelled else None,
        target_class=CLASSES[:targets],
        run=-1,
        frame_id="map",
    )


def track_sets(count: int = 3) -> TrackSetArray:
    """Return track sets; the second may own two detections, the last none."""
    own = [[4], [2, 0], []][:count]
    return TrackSetArray(
        key=KEY,
        frame_id="map",
        system_uuid=bytes(range(16)),
        track_id=np.array([1, 1, 2**63 - 1][:count], dtype=np.int64),
        branch_id=np.array([2**62, 5, 6][:count], dtype=np.int64),
        parent_branch_id=np.arange(count, dtype=np.int64),
        status=np.array([1, 1, 0][:count], dtype=np.int64),
        best=np.array([True, False, True][:count], dtype=bool),
        centroid=floats(count, 4),
        covariance=floats(count, 4, 4, seed=1),
        matrix=floats(count, 4, 4, seed=2),
        position_radius_m=floats(count, seed=3),
        speed_radius_mps=floats(count, seed=4),
        score=floats(count, seed=5),
        detection_index=np.array([4, 2, -1][:count], dtype=np.int64),
        may_own_start=np.cumsum([0, *map(len, own)], dtype=np.int64),
        may_own_index=np.array([i for some in own for i in some], dtype=np.int64),
        hits=np.array([2**32 - 1, 3, 1][:count], dtype=np.int64),
        misses=np.arange(count, dtype=np.int64),
        coasted_scans=np.array([0, 0, 1][:count], dtype=np.int64),
        first_detection_ns=np.full(count, KEY.stamp_ns, dtype=np.int64),
        last_detection_ns=np.full(count, KEY.stamp_ns + 1, dtype=np.int64),
        deleted_track_id=np.array([7, 8], dtype=np.int64),
        deleted_branch_id=np.array([9], dtype=np.int64),
    )
