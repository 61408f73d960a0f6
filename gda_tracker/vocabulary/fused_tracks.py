"""Fused tracks: what several radars together see, and how that came about."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

OK, LATE, SILENT, NEVER_HEARD = "ok", "late", "silent", "never_heard"
RADAR_STATES = (OK, LATE, SILENT, NEVER_HEARD)


@dataclass(slots=True)
class FusedTracks:
    """N fused tracks of r radars at one time, by rising id; message ``FusedTrackArray``.

    ``mean`` (N, 4) x, y, vx, vy [m, m/s] and ``covariance`` (N, 4, 4), biases removed;
    ``class_probability`` (N, C); ``existence_probability`` (N,), NaN where no radar knows;
    ``association_probability`` (N,) that exactly these tracks belong to one target;
    ``member_track_id`` (N, r) of each radar where ``member`` (N, r); ``fusions`` (N,) since
    ``first_fusion_ns`` (N,).
    """

    stamp_ns: int
    frame_id: str
    system_uuid: bytes
    sequence: int
    fusion_rule: str
    radars: tuple[str, ...]
    radar_states: tuple[str, ...]
    class_names: tuple[str, ...]
    fused_track_id: IntArray
    mean: FloatArray
    covariance: FloatArray
    class_probability: FloatArray
    existence_probability: FloatArray
    association_probability: FloatArray
    member: BoolArray
    member_track_id: IntArray
    fusions: IntArray
    first_fusion_ns: IntArray
    deleted_fused_track_id: IntArray

    def __len__(self) -> int:
        return len(self.fused_track_id)


@dataclass(slots=True)
class TrackAssociations:
    """How M tracks of r radars belong together; message ``TrackAssociations``.

    The first radar's tracks first: ``track_counts`` (r,), ``track_id`` (M,), ``fused_track_id``
    (M,). ``pair_probability`` (M, M); ``labels`` (K, M) and ``probability`` (K,) of associations,
    most probable first; ``chosen`` is the row that was used, -1 for one beyond them. ``bias``
    (r, 2) [m] and ``bias_covariance`` (r, 2, 2) [m2] with all that was learnt over time,
    ``association_bias`` and ``association_bias_covariance`` from these tracks alone; NaN: not
    known. ``bias_reference`` is the radar whose bias is taken as zero, empty: none.
    """

    stamp_ns: int
    frame_id: str
    system_uuid: bytes
    sequence: int
    radars: tuple[str, ...]
    track_counts: IntArray
    track_id: IntArray
    fused_track_id: IntArray
    pair_probability: FloatArray
    labels: IntArray
    probability: FloatArray
    chosen: int
    chosen_probability: float
    covered: float
    method: str
    bias_reference: str
    bias: FloatArray
    bias_covariance: FloatArray
    association_bias: FloatArray
    association_bias_covariance: FloatArray
