"""Fused tracks and how they came about, as messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.io.fields import (
    MessageError,
    floats_from_field,
    floats_to_field,
    int32_from_field,
    int32_to_field,
    int64_from_field,
    int64_to_field,
    make_header,
    masks_from_field,
    masks_to_field,
    require_size,
    reshape,
    stamp_from_time,
    stamp_to_time,
    unsigned,
)
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.fused_tracks import FusedTracks, TrackAssociations

STATE = 4


def fused_tracks_to_message(fused: FusedTracks) -> Any:
    """Return a ``FusedTrackArray`` message, stamped with the common time.

    Raises
    ------
    MessageError
        If a stamp or a count does not fit its field.
    """
    from gda_tracker_msgs.msg import FusedTrack, FusedTrackArray

    message = FusedTrackArray(header=make_header(fused.stamp_ns, fused.frame_id))
    message.system_uuid = _uuid(fused.system_uuid)
    message.sequence = unsigned(fused.sequence, 64, "sequence")
    message.fusion_rule = fused.fusion_rule
    message.class_names = list(fused.class_names)
    message.radars = list(fused.radars)
    message.radar_states = list(fused.radar_states)
    message.deleted_fused_track_ids = int64_to_field(fused.deleted_fused_track_id)
    for row in range(len(fused)):
        members = fused.member[row].nonzero()[0]
        message.tracks.append(
            FusedTrack(
                fused_track_id=int(fused.fused_track_id[row]),
                state=floats_to_field(fused.mean[row]),
                covariance=floats_to_field(fused.covariance[row]),
                class_probability=floats_to_field(fused.class_probability[row]),
                existence_probability=float(fused.existence_probability[row]),
                association_probability=float(fused.association_probability[row]),
                radars=[fused.radars[radar] for radar in members],
                track_ids=int64_to_field(fused.member_track_id[row, members]),
                fusions=unsigned(fused.fusions[row], 32, "fusions"),
                first_fusion=stamp_to_time(fused.first_fusion_ns[row], "first_fusion"),
            )
        )
    return message


def fused_tracks_from_message(message: Any) -> FusedTracks:
    """Return the fused tracks in a ``FusedTrackArray`` message.

    Raises
    ------
    MessageError
        If the size of a field does not fit, or a track names a radar that is none of the fusion's.
    """
    tracks = message.tracks
    count, radars = len(tracks), tuple(str(name) for name in message.radars)
    classes = tuple(str(name) for name in message.class_names)
    member = np.zeros((count, len(radars)), dtype=np.bool_)
    member_track_id = np.zeros((count, len(radars)), dtype=np.int64)
    for row, track in enumerate(tracks):
        names = [str(name) for name in track.radars]
        if not set(names) <= set(radars) or len(set(names)) < len(names):
            raise MessageError(f"radars = {names}: allowed are names of {list(radars)} that differ")
        at = [radars.index(name) for name in names]
        ids = require_size(int64_from_field(track.track_ids), len(at), "track_ids")
        member[row, at], member_track_id[row, at] = True, ids

    def stack(name: str, *shape: int) -> FloatArray:
        stacked = np.zeros((count, *shape))
        for row, track in enumerate(tracks):
            stacked[row] = reshape(floats_from_field(getattr(track, name)), shape, name)
        return stacked

    def scalars(name: str, kind: type) -> Any:
        return np.array([getattr(track, name) for track in tracks], dtype=kind)

    return FusedTracks(
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        frame_id=str(message.header.frame_id),
        system_uuid=bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        sequence=int(message.sequence),
        fusion_rule=str(message.fusion_rule),
        radars=radars,
        radar_states=tuple(str(state) for state in message.radar_states),
        class_names=classes,
        fused_track_id=scalars("fused_track_id", np.int64),
        mean=stack("state", STATE),
        covariance=stack("covariance", STATE, STATE),
        class_probability=stack("class_probability", len(classes)),
        existence_probability=scalars("existence_probability", np.float64),
        association_probability=scalars("association_probability", np.float64),
        member=member,
        member_track_id=member_track_id,
        fusions=scalars("fusions", np.int64),
        first_fusion_ns=np.array(
            [stamp_from_time(track.first_fusion, "first_fusion") for track in tracks],
            dtype=np.int64,
        ),
        deleted_fused_track_id=int64_from_field(message.deleted_fused_track_ids),
    )


def track_associations_to_message(found: TrackAssociations) -> Any:
    """Return a ``TrackAssociations`` message, stamped with the common time.

    Raises
    ------
    MessageError
        If a stamp or a count does not fit its field.
    """
    from gda_tracker_msgs.msg import TrackAssociations as Message

    message = Message(header=make_header(found.stamp_ns, found.frame_id))
    message.system_uuid = _uuid(found.system_uuid)
    message.sequence = unsigned(found.sequence, 64, "sequence")
    message.radars = list(found.radars)
    message.track_counts = masks_to_field(found.track_counts)
    message.track_ids = int64_to_field(found.track_id)
    message.fused_track_ids = int64_to_field(found.fused_track_id)
    message.labels = int32_to_field(found.labels)
    message.chosen = int(found.chosen)
    message.chosen_probability = float(found.chosen_probability)
    message.covered = float(found.covered)
    message.method = found.method
    message.bias_reference = found.bias_reference
    for name in FLOATS:
        setattr(message, name, floats_to_field(getattr(found, name)))
    return message


FLOATS = (
    "pair_probability",
    "probability",
    "bias",
    "bias_covariance",
    "association_bias",
    "association_bias_covariance",
)


def track_associations_from_message(message: Any) -> TrackAssociations:
    """Return the contents of a ``TrackAssociations`` message.

    Raises
    ------
    MessageError
        If the size of a field does not fit.
    """
    radars = tuple(str(name) for name in message.radars)
    counts = require_size(masks_from_field(message.track_counts), len(radars), "track_counts")
    n, r = int(counts.sum()), len(radars)
    k = len(message.probability)
    values = {name: floats_from_field(getattr(message, name)) for name in FLOATS}
    for name in ("bias", "association_bias"):
        values[name] = reshape(values[name], (r, 2), name)
        name += "_covariance"
        values[name] = reshape(values[name], (r, 2, 2), name)
    values["pair_probability"] = reshape(values["pair_probability"], (n, n), "pair_probability")
    return TrackAssociations(
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        frame_id=str(message.header.frame_id),
        system_uuid=bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        sequence=int(message.sequence),
        radars=radars,
        track_counts=counts.astype(np.int64),
        track_id=require_size(int64_from_field(message.track_ids), n, "track_ids"),
        fused_track_id=require_size(
            int64_from_field(message.fused_track_ids), n, "fused_track_ids"
        ),
        labels=reshape(int32_from_field(message.labels), (k, n), "labels").astype(np.int64),
        chosen=int(message.chosen),
        chosen_probability=float(message.chosen_probability),
        covered=float(message.covered),
        method=str(message.method),
        bias_reference=str(message.bias_reference),
        **values,
    )


def _uuid(value: bytes) -> Any:
    from unique_identifier_msgs.msg import UUID

    if len(value) != 16:
        raise MessageError(f"system_uuid has {len(value)} bytes, 16 expected")
    return UUID(uuid=np.frombuffer(value, dtype=np.uint8).copy())
