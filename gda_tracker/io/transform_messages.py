"""``tf2_msgs/TFMessage`` into a buffer of transforms; messages of rclpy and of rosbags alike."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from gda_tracker.io.fields import MessageError, stamp_from_time
from gda_tracker.kinematics.rigid_transforms import RigidTransform
from gda_tracker.kinematics.transform_buffer import TransformBuffer

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
TF_TOPIC, TF_STATIC_TOPIC = "/tf", "/tf_static"


def take_transforms(
    buffer: TransformBuffer, message: Any, fixed: bool, counters: Counter[str]
) -> None:
    """Put the transforms of a message into the buffer; what is special is counted by name."""
    for item in message.transforms:
        counters["tf_received"] += 1
        try:
            stamp_ns = stamp_from_time(item.header.stamp, "header.stamp")
        except MessageError:
            counters["tf_refused"] += 1
            continue
        t, q = item.transform.translation, item.transform.rotation
        transform = RigidTransform(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))
        special = buffer.add(
            str(item.header.frame_id), str(item.child_frame_id), stamp_ns, transform, fixed
        )
        if special:
            counters[special] += 1
