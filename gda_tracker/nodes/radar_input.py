"""Node ``radar_input``: what a radar's driver publishes -> ``detections``.

Subscribes to the type that it finds on its topic: ``sensor_msgs/PointCloud2``,
``radar_msgs/RadarScan`` or ``radar_msgs/RadarTracks``. What cannot be read is counted and dropped;
nothing that comes ends the node.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from rclpy.lifecycle import TransitionCallbackReturn

from gda_tracker.errors import UserError
from gda_tracker.io.messages import MessageError, detections_to_message
from gda_tracker.io.radar.conversion import RadarScan
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.messages import RadarMessageError, detections_of_message
from gda_tracker.io.radar.point_cloud import PointCloudError
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import sensor, stream
from gda_tracker.nodes.topic_listener import radar_message_class, type_of_topic
from gda_tracker.parameters import ParameterError

LOOK_PERIOD_S = 0.2
INPUT_DEPTH = 20
# Silence after which diagnostics say so.
STALE_AFTER_S = 3.0
# Reasons to drop a message, by what was raised; the first that fits.
REASONS: tuple[tuple[type[Exception], str], ...] = (
    (PointCloudError, "malformed_cloud"),
    (ParameterError, "fields_do_not_fit"),
    (RadarMessageError, "bad_stamp"),
    (MessageError, "bad_stamp"),
)


class RadarInputNode(RingNode):
    """The driver's topic in, ``detections`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("radar_input", RadarInputParameters, parameters, **options)
        self._kind = ""
        self._problem = ""
        self._sequence = 0
        self._last_stamp_ns: int | None = None
        self._heard_at: float | None = None
        self._last: RadarScan | None = None
        self._detections: Any = None
        self._looking: Any = None

    def open_topics(self) -> None:
        """Open the output, and the input as soon as somebody publishes it."""
        self._kind = ""
        self._detections = self.advertise(msg.DetectionArray, "detections", stream())
        if self._looking is None:
            self._looking = self.create_timer(LOOK_PERIOD_S, self._look, clock=self._steady)
        self._looking.reset()
        self._look()

    def _look(self) -> None:
        """Subscribe once the type is known."""
        p = self.parameters
        kind = p.input_type or type_of_topic(self, p.input_topic)
        if kind is None:
            return
        try:
            message = radar_message_class(kind, p.input_topic)
        except UserError as error:
            self._problem = str(error)
            self.get_logger().error(self._problem, throttle_duration_sec=5.0)
            return
        self._looking.cancel()
        self._kind, self._problem = kind, ""
        quality = sensor(INPUT_DEPTH, "best_effort")
        self.subscribe(message, p.input_topic, self._on_message, quality)
        self.get_logger().info(f"reads {p.input_topic} ({kind})")

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Remove the topics, and look for none."""
        self._looking.cancel()
        return super().on_cleanup(state)

    def _on_message(self, message: Any) -> None:
        self._heard_at = self.seconds()
        self.counters["received"] += 1
        try:
            scan = detections_of_message(
                message,
                self._kind,
                self.parameters,
                self._sequence + 1,
                self.get_clock().now().nanoseconds,
            )
            output = detections_to_message(scan.detections)
        except STAGE_ERRORS as error:
            reason = next((why for kind, why in REASONS if isinstance(error, kind)), "failed")
            self.drop(reason, f"{type(error).__name__}: {error}")
            self.get_logger().debug(traceback.format_exc())
            return
        if not self._new_stamp(scan.detections.stamp_ns):
            return
        self._sequence += 1
        self._last = scan
        self.counters.update(scan.counts)
        self._detections.publish(output)

    def _new_stamp(self, stamp_ns: int) -> bool:
        """Whether a scan of this time may go on; steps back are counted, the tracker decides."""
        if stamp_ns == 0:
            self.drop("stamp_unset", "the driver leaves it empty: set stamp_source to received")
            return False
        last, self._last_stamp_ns = self._last_stamp_ns, stamp_ns
        if last == stamp_ns:
            self.drop("stamp_repeated")
            return False
        if last is not None and stamp_ns < last:
            self.counters["stamp_stepped_back"] += 1
        return True

    def health(self) -> tuple[int, str]:
        """Say what is missing: a publisher, messages, radar cross sections."""
        p = self.parameters
        if self._problem:
            return DiagnosticStatus.ERROR, self._problem
        if not self._kind:
            return DiagnosticStatus.WARN, f"nobody publishes {p.input_topic}"
        if self._heard_at is None or self.seconds() - self._heard_at > STALE_AFTER_S:
            return DiagnosticStatus.WARN, f"no message on {p.input_topic}"
        if self._last is None:
            return DiagnosticStatus.ERROR, f"no message on {p.input_topic} could be used"
        rcs = self._rcs_problem(self._last)
        if rcs:
            return DiagnosticStatus.WARN, f"radar cross section: {rcs}; kinematics decide alone"
        if self._last.counts["sensor_motion_unknown"]:
            return DiagnosticStatus.WARN, "the radar's own motion could not be estimated"
        return super().health()

    def _rcs_problem(self, scan: RadarScan) -> str:
        """Say why the radar cross sections of a scan are of no use, or nothing."""
        detections = scan.detections
        if self.parameters.rcs_unit == "none":
            return ""
        if detections.rcs_m2 is None:
            return "there is no such field"
        if scan.counts["rcs_all_equal"]:
            return "the same for all points"
        known = detections.rcs_valid
        if known is not None and len(known) and not known.any():
            return "no value can be one"
        return ""

    def figures(self) -> dict[str, Any]:
        """What came and what went out."""
        found: dict[str, Any] = {"type": self._kind, "published": self._sequence}
        if self._last is not None:
            detections = self._last.detections
            found["detections"] = len(detections.range_m)
            if self._last.still is not None and len(self._last.still):
                found["standing_still"] = round(float(self._last.still.mean()), 3)
            if detections.rcs_valid is not None and len(detections.rcs_valid):
                found["rcs_known"] = round(float(detections.rcs_valid.mean()), 3)
        return found


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(RadarInputNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
