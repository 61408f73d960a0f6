"""The motion history of every hypothesis, retrodicted, and what it says of the class of a track.

After each scan the states of the last scans are retrodicted from the present back along the path
of each hypothesis, and their extremes found. A state is final when ``class_motion_scans`` later
scans have spoken; then its extremes join those of all final ones, and it is let go. So what a
history says is found anew on every scan: the window's share is replaced, never multiplied on, and
the extremes of the final ones stay what they are however long they are held.

Nothing of this goes back into the ring: the filters, the association and the attribute history are
what they are without it, and the evidence is added to what is *told* of a track.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gda_tracker.attributes.motion_evidence import fuse_motion, motion_evidence
from gda_tracker.attributes.pair_beliefs import PairBeliefs
from gda_tracker.kinematics.motion_extremes import (
    accelerations,
    extremes_of,
    more_extreme,
    no_extremes,
    size_of,
)
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.mht.generations import rows_of
from gda_tracker.tracking.parameter_groups.class_motion import OFF
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.state_retrodiction import retrodict_states
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

_STATE_FIELDS = (
    "hypothesis_id",
    "parent_id",
    "mean",
    "covariance",
    "model_weight",
    "model_mean",
    "model_covariance",
)


@dataclass(slots=True, frozen=True)
class PastScan:
    """The states of one closed scan; ``table`` has ids and states alone."""

    stamp_ns: int
    table: HypothesisTable


@dataclass(slots=True, frozen=True)
class MotionHistories:
    """What is kept of the motion of H hypotheses, those of the last closed scan.

    ``past`` are the scans of the window, oldest first, the last closed one included. ``final``
    (H, 3, 2) are the extremes of the states that have left it, ``extremes`` (H, 3, 2) those of the
    whole histories (:mod:`gda_tracker.kinematics.motion_extremes`).
    """

    past: tuple[PastScan, ...] = ()
    final: FloatArray = field(default_factory=lambda: no_extremes(0))
    extremes: FloatArray = field(default_factory=lambda: no_extremes(0))


def histories_after(
    histories: MotionHistories | None,
    table: HypothesisTable,
    stamp_ns: int,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> MotionHistories | None:
    """Return the histories after a scan.

    Parameters
    ----------
    histories
        Those before.
    table
        Hypotheses after the scan; each goes on with the history of the row of its own id or, in a
        tree, of its parent.
    stamp_ns
        Of the scan.
    parameters
        Those of the scan; without ``class_motion`` there are no histories.
    counters
        Scans are counted whose classes are not all that ``class_motion_names`` speaks of, and those
        with a full window shorter than ``class_motion_span_s``: there are no accelerations.
    """
    if parameters.class_motion == OFF:
        return None
    h = len(table)
    if table.class_names and fault_of_class_motion(parameters, table.class_names):
        counters["class_motion_unknown_class"] += 1
    before = histories or MotionHistories()
    if before.past and before.past[-1].stamp_ns > stamp_ns:
        before = MotionHistories()  # the time axis has begun anew
    newest = PastScan(stamp_ns, _states(table, slice(None)))
    scans = parameters.class_motion_scans
    # A restart with a shorter window: what it has no room for is final as it is.
    known = before.final if len(before.past) <= scans + 1 else before.extremes
    past = (*before.past[-scans:], newest)
    final = no_extremes(h)
    if before.past:
        row = _rows_before(before.past[-1].table, table.hypothesis_id, table.parent_id)
        final[row >= 0] = known[row[row >= 0]]
    time_s = np.array([(scan.stamp_ns - stamp_ns) / 1e9 for scan in past])
    velocity, covariance = _retrodicted_velocities(past, parameters)
    speed = size_of(velocity, covariance)
    size, std, from_first = accelerations(
        time_s, velocity, covariance, parameters.class_motion_span_s
    )
    if len(past) > scans:
        if parameters.class_acceleration_mps2 and -time_s[0] < parameters.class_motion_span_s:
            counters["class_motion_window_too_short"] += 1
        oldest = extremes_of(
            (speed[0][:1], speed[1][:1]), (size[from_first][:1], std[from_first][:1])
        )
        final = more_extreme(final, oldest)
    whole = more_extreme(final, extremes_of(speed, (size, std)))
    return MotionHistories(past, final, whole)


def fault_of_class_motion(parameters: TrackManagerParameters, class_names: Sequence[str]) -> str:
    """Say which classes of ``class_motion_names`` there are not, or return an empty text."""
    strange = [name for name in parameters.class_motion_names if name not in class_names]
    if parameters.class_motion == OFF or not strange:
        return ""
    return (
        f"parameter class_motion_names = {parameters.class_motion_names}: there is no class "
        f"{strange[0]}; allowed are those of class_names: {', '.join(class_names)}"
    )


def _retrodicted_velocities(
    past: tuple[PastScan, ...], parameters: TrackManagerParameters
) -> tuple[FloatArray, FloatArray]:
    """Velocities (T, H, d) and covariances of the last scan's hypotheses, NaN before they were."""
    last = past[-1].table
    h, d = len(last), last.mean.shape[1] // 2
    velocity = np.full((len(past), h, d), np.nan)
    covariance = np.full((len(past), h, d, d), np.nan)
    velocity[-1], covariance[-1] = last.mean[:, d:], last.covariance[:, d:, d:]
    # Hypotheses of the last scan that lived at the time reached, and their rows there.
    live, row, later = np.arange(h), np.arange(h), last
    for place in range(len(past) - 2, -1, -1):
        earlier, after = past[place], past[place + 1]
        ids = after.table.hypothesis_id[row], after.table.parent_id[row]
        row = _rows_before(earlier.table, *ids)
        lived = row >= 0
        if not lived.any():
            break
        live, row = live[lived], row[lived]
        dt_s = (after.stamp_ns - earlier.stamp_ns) / 1e9
        later = retrodict_states(
            _states(earlier.table, row), _states(later, lived), dt_s, parameters
        )
        velocity[place, live] = later.mean[:, d:]
        covariance[place, live] = later.covariance[:, d:, d:]
    return velocity, covariance


def _states(table: HypothesisTable, rows: IntArray | BoolArray | slice) -> HypothesisTable:
    """Ids and states of some rows."""
    columns: dict[str, Any] = {name: getattr(table, name)[rows] for name in _STATE_FIELDS}
    return HypothesisTable(**columns, models=table.models, spread=table.spread)


def _rows_before(
    earlier: HypothesisTable, hypothesis_id: IntArray, parent_id: IntArray
) -> IntArray:
    """Row of the same hypothesis, or of the parent, in the table one scan earlier, -1 for none."""
    same = rows_of(earlier.hypothesis_id, hypothesis_id)
    return np.where(same >= 0, same, rows_of(earlier.hypothesis_id, parent_id))


def with_class_motion(
    tracks: Tracks,
    histories: MotionHistories | None,
    chosen: BoolArray,
    parameters: TrackManagerParameters,
) -> Tracks:
    """Add what their motion says to the beliefs of confirmed tracks.

    Parameters
    ----------
    tracks
        As the ring has them.
    histories
        Of all H hypotheses after the same scan; ``None``: nothing is added.
    chosen
        (H,) the hypotheses that the tracks are of.
    parameters
        Those of the scan. Without an attribute there is no frame to speak of: nothing is added.
    """
    term = parameters.attribute_term
    if histories is None or term == "none" or parameters.class_motion == OFF:
        return tracks
    if not len(tracks) or not tracks.class_names:
        return tracks
    motion = parameters.motion_of_classes
    extremes = np.where(
        (tracks.status == CONFIRMED)[:, None, None], histories.extremes[chosen], np.nan
    )
    said = motion_evidence(extremes, motion, tracks.class_names)
    if not said.informative.any():
        return tracks
    fused: PairBeliefs = fuse_motion(
        term,
        tracks.key,
        tracks.frame,
        tracks.class_names,
        tracks.focal,
        tracks.masses,
        tracks.class_probability,
        said,
    )
    if not len(fused.focal):
        return replace(tracks, class_probability=fused.class_probability)
    return replace(
        tracks,
        focal=fused.focal,
        masses=fused.masses,
        class_probability=fused.class_probability,
    )


def histories_to_arrays(histories: MotionHistories | None) -> dict[str, np.ndarray]:
    """Return histories as arrays by name, for a checkpoint; none for none."""
    if histories is None:
        return {}
    arrays = {"motion_final": histories.final, "motion_extremes": histories.extremes}
    for place, scan in enumerate(histories.past):
        arrays |= {f"motion{place}_{name}": getattr(scan.table, name) for name in _STATE_FIELDS}
    return arrays


def histories_to_plain(histories: MotionHistories | None) -> list[dict[str, Any]]:
    """Return what is not an array: an entry for each scan of the window."""
    past = () if histories is None else histories.past
    return [
        {"stamp_ns": s.stamp_ns, "models": s.table.models, "spread": s.table.spread} for s in past
    ]


def histories_from(
    plain: list[Mapping[str, Any]], arrays: Mapping[str, np.ndarray]
) -> MotionHistories | None:
    """Return the histories of a checkpoint; ``None`` where it has none."""
    if "motion_final" not in arrays:
        return None

    def read(place: int) -> dict[str, Any]:
        return {name: arrays[f"motion{place}_{name}"] for name in _STATE_FIELDS}

    past = tuple(
        PastScan(
            int(each["stamp_ns"]),
            HypothesisTable(
                **read(place), models=tuple(each["models"]), spread=int(each["spread"])
            ),
        )
        for place, each in enumerate(plain)
    )
    return MotionHistories(past, arrays["motion_final"], arrays["motion_extremes"])
