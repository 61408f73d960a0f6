"""Pictures as JSON for the page: columns of numbers, rounded to what can be seen.

Not a number and infinite become ``null``. Lengths are in metres, angles in radians.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gda_tracker.evidence.frames import element_name, parts, upward_closure
from gda_tracker.formations.labels import formation_text, is_finite
from gda_tracker.view.history import History
from gda_tracker.view.picture import Picture
from gda_tracker.vocabulary.arrays import FloatArray

MILLIMETRES, MICRORADIANS, THOUSANDTHS = 3, 6, 3


def numbers(values: NDArray[Any], digits: int) -> list[Any]:
    """Rounded numbers as lists; ``None`` where they are not finite."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits)
    if np.isfinite(rounded).all():
        return list(rounded.tolist())
    known = rounded.astype(object)
    known[~np.isfinite(rounded)] = None
    return list(known.tolist())


def number(value: float, digits: int = MICRORADIANS) -> float | None:
    """A rounded number, ``None`` if it is not finite."""
    return round(value, digits) if math.isfinite(value) else None


def focal_text(frame: tuple[str, ...], mask: int) -> str:
    """Name of a focal element for people.

    Where a model has emptied some of the Venn parts, the rest is named part by part, ``VS|S`` for
    VS or S where they exclude each other.

    >>> focal_text(("A", "B"), 0b01), focal_text(("A", "B"), 0b101)
    ('A', 'A')
    """
    if upward_closure(len(frame), mask) == mask:
        return element_name(frame, mask)
    return "|".join(
        "&".join(name for bit, name in enumerate(frame) if part >> bit & 1) for part in parts(mask)
    )


def decibels(rcs_m2: FloatArray) -> FloatArray:
    """Radar cross sections [m2] as dBsm, NaN where unknown, zero or less."""
    level = np.full(np.shape(rcs_m2), np.nan)
    np.log10(rcs_m2, out=level, where=np.nan_to_num(rcs_m2, nan=-1.0) > 0.0)
    return 10.0 * level


def positions(picture: Picture) -> FloatArray:
    """Positions (n, 2) of the detections [m]."""
    r, a = picture.sightings.range_m, picture.sightings.azimuth_rad
    return picture.sensor_xy_m + np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


def located(picture: Picture) -> NDArray[np.bool_]:
    """Which detections (n,) are places in the plane."""
    return np.isfinite(picture.sightings.range_m) & np.isfinite(picture.sightings.azimuth_rad)


def scan_json(history: History, at: int, picture: Picture) -> dict[str, Any]:
    """What the page draws of one scan."""
    report, settings = picture.report, picture.settings
    return {
        "number": at,
        "seconds": number(history.seconds(picture), 4),
        "stamp_ns": str(picture.stamp_ns),  # larger than JavaScript counts exactly
        "sensor_id": report.key.sensor_id,
        "outcome": report.outcome,
        "latency_ms": number(1e3 * report.latency_s, 2),
        "received": report.detections_received,
        "rejected": report.rejected,
        "sensor": {
            "x": number(picture.sensor_xy_m[0]),
            "y": number(picture.sensor_xy_m[1]),
            "yaw": number(picture.sensor_yaw_rad),
        },
        "settings": None
        if settings is None
        else {
            "decision": settings.decision,
            "attribute_term": settings.attribute_term,
            "gate_probability": settings.gate_probability,
            "clutter_density": settings.clutter_density,
            "degraded": settings.degraded,
        },
        "detections": _detections(picture),
        "tracks": _tracks(picture),
        "gates": _gates(picture),
        "formations": _formations(picture),
    }


def past_json(at: int, picture: Picture) -> dict[str, Any]:
    """What of an earlier scan is still seen: where detections and tracks were."""
    there = located(picture)
    xy = positions(picture)[there]
    return {
        "number": at,
        "x": numbers(xy[:, 0], 2),
        "y": numbers(xy[:, 1], 2),
        "range": numbers(picture.sightings.range_m[there], 2),
        "azimuth": numbers(picture.sightings.azimuth_rad[there], 5),
        "id": picture.tracks.track_id.tolist(),
        "tx": numbers(picture.tracks.mean[:, 0], 2),
        "ty": numbers(picture.tracks.mean[:, 1], 2),
    }


def _detections(picture: Picture) -> dict[str, Any]:
    seen, there = picture.sightings, located(picture)
    xy = positions(picture)[there]
    return {
        "row": seen.source_index[there].tolist(),
        "x": numbers(xy[:, 0], MILLIMETRES),
        "y": numbers(xy[:, 1], MILLIMETRES),
        "range": numbers(seen.range_m[there], MILLIMETRES),
        "azimuth": numbers(seen.azimuth_rad[there], MICRORADIANS),
        "rcs_dbsm": numbers(decibels(seen.rcs_m2[there]), 2),
        "range_rate": numbers(seen.range_rate_mps[there], 2),
        "curves": numbers(seen.curves, 2),
    }


def _formations(picture: Picture) -> dict[str, Any] | None:
    """Centres, labels, lines to parents; ellipses that hold the members, as covariances."""
    if picture.formations is None:
        return None
    shown = [one for one in picture.formations.formations if is_finite(one)]
    place = {one.formation_id: one.position for one in shown}
    # Of T points none is farther from the centroid than T - 1 in squared Mahalanobis distance.
    spread = [max(len(one.track_ids) - 1, 0) * one.extent for one in shown]
    ellipse = np.array(spread).reshape(-1, 4)
    centre = np.array([one.position for one in shown]).reshape(-1, 2)
    return {
        "id": [one.formation_id for one in shown],
        "text": [formation_text(one).split("\n") for one in shown],
        "x": numbers(centre[:, 0], MILLIMETRES),
        "y": numbers(centre[:, 1], MILLIMETRES),
        "xx": numbers(ellipse[:, 0], MILLIMETRES),
        "xy": numbers(ellipse[:, 1], MILLIMETRES),
        "yy": numbers(ellipse[:, 3], MILLIMETRES),
        "parents": [
            [numbers(place[parent], MILLIMETRES) for parent in one.parent_ids if parent in place]
            for one in shown
        ],
    }


def _tracks(picture: Picture) -> dict[str, Any]:
    tracks = picture.tracks
    velocity = tracks.mean.shape[1] // 2
    return {
        "id": tracks.track_id.tolist(),
        "confirmed": tracks.status.tolist(),
        "x": numbers(tracks.mean[:, 0], MILLIMETRES),
        "y": numbers(tracks.mean[:, 1], MILLIMETRES),
        "vx": numbers(tracks.mean[:, velocity], MILLIMETRES),
        "vy": numbers(tracks.mean[:, velocity + 1], MILLIMETRES),
        "xx": numbers(tracks.covariance[:, 0, 0], MILLIMETRES),
        "xy": numbers(tracks.covariance[:, 0, 1], MILLIMETRES),
        "yy": numbers(tracks.covariance[:, 1, 1], MILLIMETRES),
        "extent": numbers(tracks.extent.reshape(-1, 4)[:, [0, 1, 3]], MILLIMETRES),
        "hits": tracks.hits.tolist(),
        "coasted": tracks.coasted_scans.tolist(),
        "detection": tracks.detection_index.tolist(),
        "conflict": numbers(tracks.conflict, THOUSANDTHS),
        "age_s": numbers((picture.stamp_ns - tracks.first_detection_ns) * 1e-9, 2),
        "class_names": list(tracks.class_names),
        "class_probability": numbers(tracks.class_probability, 4),
        "focal": [focal_text(tracks.frame, mask) for mask in tracks.focal.tolist()],
        "masses": numbers(tracks.masses, 4),
        "ended": tracks.deleted_track_id.tolist(),
    }


def _gates(picture: Picture) -> dict[str, Any] | None:
    gates = picture.gates
    if gates is None:
        return None
    return {
        "id": gates.track_id.tolist(),
        "range": numbers(gates.range_m, MILLIMETRES),
        "azimuth": numbers(gates.azimuth_rad, MICRORADIANS),
        "rr": numbers(gates.covariance[:, 0, 0], MICRORADIANS),
        "ra": numbers(gates.covariance[:, 0, 1], 9),
        "aa": numbers(gates.covariance[:, 1, 1], 12),
        "threshold": number(gates.threshold),
    }
