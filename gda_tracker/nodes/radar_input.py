"""Node ``radar_input``: what a radar's driver publishes -> ``detections``.

Subscribes to the type that it finds on its topic: ``sensor_msgs/PointCloud2``,
``radar_msgs/RadarScan`` or ``radar_msgs/RadarTracks``; or listens to ASTERIX at
``udp://HOST:PORT``. What cannot be read is counted and dropped; nothing that comes ends the node.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from rclpy.lifecycle import TransitionCallbackReturn

from gda_tracker.errors import UserError
from gda_tracker.io.asterix.udp import is_udp
from gda_tracker.io.messages import MessageError, detections_to_message
from gda_tracker.io.radar.conversion import RadarScan
from gda_tracker.io.radar.frames import RadarFrame, detections_of_frame
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.messages import RadarMessageError, frame_of_message
from gda_tracker.io.radar.point_cloud import PointCloudError
from gda_tracker.io.radar.sensor_pose import SensorPose, TiltError, counted_reason, sensor_pose
from gda_tracker.kinematics.odometry_buffer import OdometryError
from gda_tracker.kinematics.transform_buffer import TransformError
from gda_tracker.nodes.asterix_listener import LOOK_PERIOD_S as UDP_PERIOD_S
from gda_tracker.nodes.asterix_listener import AsterixListener
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.odometry_listener import OdometryListener
from gda_tracker.nodes.qualities import sensor, stream
from gda_tracker.nodes.services import offer
from gda_tracker.nodes.topic_listener import radar_message_class, type_of_topic
from gda_tracker.nodes.transform_listener import TransformListener, transform_message
from gda_tracker.parameters import ParameterError

LOOK_PERIOD_S = 0.2
INPUT_DEPTH = 20
# Silence after which diagnostics say so.
STALE_AFTER_S = 3.0
ASTERIX_KIND = "ASTERIX"
# How often a frame that waits for its transforms is looked at, and how many may wait.
PATIENCE_S = 0.1
MOST_WAITING = 100


class ClockError(UserError):
    """There is no time to stamp a message with."""


# Reasons to drop a message, by what was raised; the first that fits.
REASONS: tuple[tuple[type[Exception], str], ...] = (
    (PointCloudError, "malformed_cloud"),
    (ParameterError, "fields_do_not_fit"),
    (TiltError, "tilted_too_far"),
    (ClockError, "no_clock"),
    (RadarMessageError, "bad_stamp"),
    (MessageError, "bad_stamp"),
)


class RadarInputNode(RingNode):
    """The driver's topic in, ``detections`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("radar_input", RadarInputParameters, parameters, **options)
        self.check_parameters(self.parameters)
        self._kind = ""
        self._problem = ""
        self._sequence = 0
        self._last_stamp_ns: int | None = None
        self._heard_at: float | None = None
        self._last: RadarScan | None = None
        self._detections: Any = None
        self._looking: Any = None
        self._listener: TransformListener | None = None
        self._odometry: OdometryListener | None = None
        self._asterix: AsterixListener | None = None
        self._polling: Any = None
        self._tf_problem = ""
        # Frames whose transforms or odometry have not come yet, and when they came.
        self._waiting: deque[tuple[RadarFrame, float]] = deque()
        self._patience = self.create_timer(PATIENCE_S, self._work_off, clock=self._steady)
        self._patience.cancel()
        offer(self, "reset", self._reset)

    def open_topics(self) -> None:
        """Open the output, and the input as soon as somebody publishes it."""
        self._kind = ""
        self._detections = self.advertise(msg.DetectionArray, "detections", stream())
        self._listen_to_motion()
        if self._looking is None:
            self._looking = self.create_timer(LOOK_PERIOD_S, self._look, clock=self._steady)
        self._looking.reset()
        self._look()

    def _listen_to_motion(self) -> None:
        if self._listener is None and self.parameters.uses_transforms:
            self._listener = TransformListener(self, self._work_off)
        if self._odometry is None and self.parameters.uses_odometry:
            self._odometry = OdometryListener(self, self._work_off)

    def check_parameters(self, parameters: RadarInputParameters) -> None:
        """Refuse to take poses or speeds from transforms that cannot be had."""
        if parameters.uses_transforms:
            transform_message()

    def use_parameters(self, parameters: RadarInputParameters) -> None:
        """Take checked parameters; acts at the next scan."""
        super().use_parameters(parameters)
        if self._detections is not None:
            self._listen_to_motion()

    def _look(self) -> None:
        """Subscribe once the type is known."""
        p = self.parameters
        if is_udp(p.input_topic):
            self._listen(p.input_topic)
            return
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

    def _listen(self, url: str) -> None:
        """Open the socket; if that fails, it is tried again, for the network may not be up yet."""
        try:
            self._asterix = AsterixListener(url, self.parameters.asterix_source)
        except UserError as error:
            self._problem = str(error)
            self.get_logger().error(self._problem, throttle_duration_sec=5.0)
            return
        self._looking.cancel()
        self._kind, self._problem = ASTERIX_KIND, ""
        if self._polling is None:
            self._polling = self.create_timer(UDP_PERIOD_S, self._poll, clock=self._steady)
        self._polling.reset()
        self.get_logger().info(f"listens to {url} (ASTERIX)")

    def _poll(self) -> None:
        """Take the datagrams that have come."""
        listener = self._asterix
        now_ns = int(self.get_clock().now().nanoseconds)  # 0: nothing on /clock yet
        if listener is None or not self.active or now_ns == 0:
            return
        before = listener.datagrams
        for frame in listener.frames(now_ns, self.seconds()):
            self._take(frame)
        if listener.datagrams > before:
            self._heard_at = self.seconds()
            self.counters["received"] += listener.datagrams - before
        self.counters.update(listener.left_out())
        if listener.broken:
            self.get_logger().warning(f"dropped: {listener.broken}", throttle_duration_sec=5.0)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Remove the topics and the socket, and look for none."""
        self._looking.cancel()
        self.close()
        self._patience.cancel()
        self._waiting.clear()
        for listener in (self._listener, self._odometry):
            if listener is not None:
                listener.close()
        self._listener = self._odometry = None
        return super().on_cleanup(state)

    def _on_message(self, message: Any) -> None:
        self._heard_at = self.seconds()
        self.counters["received"] += 1
        own = self.parameters.stamp_source == "header"
        try:
            received_ns = None if own else self._now_ns()
            frame = frame_of_message(message, self._kind, received_ns)
        except (*STAGE_ERRORS, UserError) as error:
            self._refuse(error)
            return
        self._take(frame)

    def _take(self, frame: RadarFrame) -> None:
        """Line a frame up and publish what can be."""
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.popleft()
            self.drop("tf_queue_full")
        self._waiting.append((frame, self.seconds()))
        self._work_off()

    def _now_ns(self) -> int:
        """Time by the node's clock."""
        now_ns = int(self.get_clock().now().nanoseconds)
        if now_ns == 0:
            raise ClockError("use_sim_time is true, and nothing has come on /clock yet")
        return now_ns

    def _refuse(self, error: Exception) -> None:
        reason = next((why for kind, why in REASONS if isinstance(error, kind)), "failed")
        self.drop(reason, f"{type(error).__name__}: {error}")
        self.get_logger().debug(traceback.format_exc())

    def _work_off(self) -> None:
        """Publish what waits, in order; a frame waits for its transforms at most so long."""
        if not self.active:
            return
        while self._waiting:
            frame, since = self._waiting[0]
            try:
                pose = self._pose(frame)
            except (TransformError, OdometryError) as error:
                waited = self.seconds() - since
                reason, may_still_come = counted_reason(error)
                if may_still_come and waited < self.parameters.tf_timeout_s:
                    if self._patience.is_canceled():
                        self._patience.reset()
                    return
                self._waiting.popleft()
                self._tf_problem = str(error)
                self.drop(reason, self._tf_problem)
                continue
            self._waiting.popleft()
            self._tf_problem = ""
            self._convert(frame, pose)
        self._patience.cancel()

    def _convert(self, frame: RadarFrame, pose: SensorPose) -> None:
        try:
            scan = detections_of_frame(frame, self.parameters, self._sequence + 1, pose=pose)
            output = detections_to_message(scan.detections)
        except (*STAGE_ERRORS, UserError) as error:
            self._refuse(error)
            return
        # Of a frame that could not be used the stamp is free for another one.
        if not self._new_stamp(frame.stamp_ns):
            return
        self._sequence += 1
        self._last = scan
        self.counters.update(scan.counts)
        self._detections.publish(output)

    def _pose(self, frame: RadarFrame) -> SensorPose:
        """Where the radar was when it saw a frame, and how it moved."""
        transforms = None if self._listener is None else self._listener.buffer
        odometry = None if self._odometry is None else self._odometry.buffer
        return sensor_pose(self.parameters, transforms, frame.frame_id, frame.stamp_ns, odometry)

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

    def _reset(self) -> str:
        """Forget frames that wait, the last stamp, and histories of transforms and odometry."""
        waiting = len(self._waiting)
        self._waiting.clear()
        self._patience.cancel()
        self._last_stamp_ns, self._tf_problem = None, ""
        if self._listener is not None:
            self._listener.buffer.clear()
        if self._odometry is not None:
            self._odometry.buffer.clear()
        if waiting:
            self.counters["rejected_reset"] += waiting
        return f"{waiting} waiting frames dropped"

    def close(self) -> None:
        """Close the socket, if there is one."""
        if self._polling is not None:
            self._polling.cancel()
        if self._asterix is not None:
            self._asterix.close()
            self._asterix = None

    def health(self) -> tuple[int, str]:
        """Say what is missing: a publisher, messages, radar cross sections."""
        p = self.parameters
        if self._problem:
            return DiagnosticStatus.ERROR, self._problem
        if not self._kind:
            return DiagnosticStatus.WARN, f"nobody publishes {p.input_topic}"
        if self._heard_at is None or self.seconds() - self._heard_at > STALE_AFTER_S:
            return DiagnosticStatus.WARN, f"no message on {p.input_topic}"
        if self._tf_problem:
            why = "" if self._odometry is None else self._odometry.problem
            return DiagnosticStatus.ERROR, "; ".join(filter(None, (self._tf_problem, why)))
        if self._last is None and self._asterix is not None:
            return DiagnosticStatus.WARN, f"no full turn of a radar on {p.input_topic} yet"
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
