"""Node ``track_fusion``: tracks of several radars in, fused tracks and biases out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg

from gda_tracker.fusion.fuser import Fusion, TrackFuser
from gda_tracker.fusion.parameters import POSES, TF, TrackFusionParameters
from gda_tracker.fusion.reports import Refused
from gda_tracker.io.fusion_messages import fused_tracks_to_message, track_associations_to_message
from gda_tracker.io.messages import MessageError, tracks_from_message
from gda_tracker.kinematics.rigid_transforms import RigidTransform, quaternion_of_angles
from gda_tracker.kinematics.transform_buffer import TransformError
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.transform_listener import TransformListener
from gda_tracker.vocabulary.fused_tracks import LATE, NEVER_HEARD, OK, SILENT
from gda_tracker.vocabulary.tracks import Tracks

RATE_SHARE = 0.2
"""Weight of the newest interval in the rate of a radar's messages."""


class TrackFusionNode(RingNode):
    """``tracks`` of several radars in; ``fused_tracks`` and ``track_associations`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("track_fusion", TrackFusionParameters, parameters, **options)
        self.fuser = TrackFuser(self.parameters)
        # Of each radar: time of the last message that was used [s] and mean interval.
        self._heard: dict[str, float] = {}
        self._interval_s: dict[str, float] = {}
        self._last: Fusion | None = None
        self._listener = (
            TransformListener(self, lambda: None) if self.parameters.alignment == TF else None
        )

    def open_topics(self) -> None:
        """Subscribe to every radar's tracks."""
        p = self.parameters
        for radar, topic in zip(p.radars, p.topics, strict=True):
            self.subscribe(msg.TrackArray, topic, partial(self._on_tracks, radar), stream())
        self._fused = self.advertise(msg.FusedTrackArray, "fused_tracks", stream())
        self._associations = self.advertise(msg.TrackAssociations, "track_associations", stream())

    def use_parameters(self, parameters: Any) -> None:
        """Take checked parameters; they act at the next fusion."""
        super().use_parameters(parameters)
        self.fuser.parameters = parameters

    def _on_tracks(self, radar: str, message: Any) -> None:
        try:
            tracks = tracks_from_message(message)
        except MessageError as error:
            self.drop("malformed_radar_tracks", f"{radar}: {error}")
            return
        try:
            fusions = self.fuser.take(radar, tracks, self._transform(radar, tracks))
        except TransformError as error:
            self.drop("refused_no_transform", f"{radar}: {error}")
            return
        except Refused as error:
            # The fuser has counted it.
            self.get_logger().warning(
                f"dropped: {error.reason} ({error})", throttle_duration_sec=5.0
            )
            return
        except STAGE_ERRORS as error:
            # Whatever broke it must not come again with the next message.
            self.drop("fusion_failed", f"{radar}: {type(error).__name__}: {error}")
            self.fuser.begin_anew()
            return
        self._note(radar)
        for fusion in fusions:
            self._publish(fusion)

    def _transform(self, radar: str, tracks: Tracks) -> RigidTransform | None:
        p = self.parameters
        if p.alignment == POSES:
            first = 3 * p.radars.index(radar)
            x, y, yaw = p.radar_poses[first : first + 3]
            return RigidTransform(np.array([x, y, 0.0]), quaternion_of_angles(0.0, 0.0, yaw))
        if self._listener is not None:
            return self._listener.buffer.lookup(
                p.fusion_frame, tracks.frame_id, tracks.key.stamp_ns
            )
        return None

    def _note(self, radar: str) -> None:
        now = self.seconds()
        if radar in self._heard:
            interval = now - self._heard[radar]
            mean = self._interval_s.get(radar, interval)
            self._interval_s[radar] = mean + RATE_SHARE * (interval - mean)
        self._heard[radar] = now

    def _publish(self, fusion: Fusion) -> None:
        fused, associations = fusion
        try:
            message = fused_tracks_to_message(fused)
            other = track_associations_to_message(associations)
        except MessageError as error:
            self.drop("fusion_without_message", str(error))
            return
        self._fused.publish(message)
        self._associations.publish(other)
        self._last = fusion

    # --- diagnostics ------------------------------------------------------------------------

    def radar_states(self) -> dict[str, str]:
        """State of each radar, by stamps and by what was heard."""
        p, now = self.parameters, self.seconds()
        found = {}
        for radar, state in zip(p.radars, self.fuser.radar_states(), strict=True):
            if state != NEVER_HEARD:
                age = now - self._heard[radar]
                if age > p.silent_after_s:
                    state = SILENT
                elif age > p.late_after_s and state == OK:
                    state = LATE
            found[radar] = state
        return found

    def health(self) -> tuple[int, str]:
        """Say which radars are late, silent or were never heard."""
        level, text = super().health()
        if not self.active:
            return level, text
        states = self.radar_states()
        wrong = [f"{radar} {state.replace('_', ' ')}" for radar, state in states.items()
                 if state != OK]  # fmt: skip
        if not wrong:
            return level, text
        live = [state for state in states.values() if state in (OK, LATE)]
        return (DiagnosticStatus.WARN if live else DiagnosticStatus.ERROR), ", ".join(wrong)

    def figures(self) -> dict[str, Any]:
        """Rate, age and state of each radar, the last fusion, and what the fuser counted."""
        now, found = self.seconds(), {}
        for (radar, state), age in zip(
            self.radar_states().items(), self.fuser.ages_s(), strict=True
        ):
            found[f"{radar} state"] = state
            if radar in self._heard:
                found[f"{radar} heard_before_s"] = f"{now - self._heard[radar]:.1f}"
                found[f"{radar} age_s"] = f"{age:.3f}"
            if self._interval_s.get(radar):
                found[f"{radar} rate_hz"] = f"{1.0 / self._interval_s[radar]:.2f}"
        if self._last is not None:
            fused, associations = self._last
            found["fusions"] = fused.sequence
            found["fused_tracks"] = len(fused)
            found["of_several_radars"] = int((fused.member.sum(axis=1) > 1).sum())
            found["association_probability"] = f"{associations.chosen_probability:.4f}"
            found["association_covered"] = f"{associations.covered:.4f}"
            found["bias_reference"] = associations.bias_reference or "none: biases are absolute"
            for radar, bias in zip(fused.radars, associations.bias, strict=True):
                found[f"{radar} bias_m"] = f"{bias[0]:.1f} {bias[1]:.1f}"
        return {**found, **self.fuser.counters}

    def close(self) -> None:
        """Listen to transforms no longer."""
        if self._listener is not None:
            self._listener.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(TrackFusionNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
