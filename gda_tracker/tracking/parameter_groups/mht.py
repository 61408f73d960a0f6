"""Parameters of the track manager: the hypothesis trees of mht."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import parameter
from gda_tracker.tracking.lifecycle import LONGEST_WINDOW


@dataclass(frozen=True)
class MhtParameters:
    """The hypothesis trees of mht."""

    mht_scans: int = parameter(
        8,
        "N of mht: the assignment of a scan is decided for good N scans later; tracks_delayed "
        "follows by so many",
        minimum=1,
        maximum=LONGEST_WINDOW,
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
        "new targets per false alarm: prior odds of existence_probability, and with mht the score "
        "with which a track starts",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
