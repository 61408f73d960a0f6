"""The node ``track_fusion`` over real topics: two rings, a restart, bad input, live parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from geometry_msgs.msg import TransformStamped
from graph_helpers import TIMEOUT_S
from rclpy.node import Node
from rclpy.parameter import Parameter

from gda_tracker.io.fusion_messages import (
    fused_tracks_from_message,
    track_associations_from_message,
)
from gda_tracker.io.messages import tracks_to_message
from gda_tracker.kinematics.rigid_transforms import (
    RigidTransform,
    quaternion_of_angles,
    rotation_matrix,
)
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.runner import Nodes
from gda_tracker.nodes.track_fusion import TrackFusionNode
from gda_tracker.nodes.transform_listener import transform_message
from gda_tracker.simulation.kalman_radars import KalmanRadars
from scripts.track_fusion_case import RELATIVE_BIAS_M, fused_once, ring_case

BIAS = [[0.0, 0.0], [-800.0, 600.0]]


def test_two_rings_with_biases_of_a_kilometre_fuse_each_target_once(domain):
    case = ring_case(seed=0, run=0)
    client, node = case.over_topics(domain, scans=14)
    fused, found = client.fused[-1], client.associations[-1]
    live = {name: tracks[-1] for name, tracks in client.tracks.items()}
    assert fused_once(case, fused, live, 13).all()
    assert len(fused) == 6
    gap = found.bias[1] - RELATIVE_BIAS_M
    assert gap @ np.linalg.solve(found.bias_covariance[1], gap) < 11.8  # 3 standard deviations
    assert found.bias_reference == "radar_1"
    assert set(node.fuser.counters) <= {"track_noise_larger_than_told"}
    # The same as without ROS.
    alone, _ = case.offline(scans=14)[-1]
    np.testing.assert_allclose(fused.mean, alone.mean, rtol=1e-9)
    assert fused.fused_track_id.tolist() == alone.fused_track_id.tolist()


class Trackers(Node):
    """Publishes the tracks of two radars and keeps what is fused."""

    def __init__(self, **options):
        super().__init__("trackers", **options)
        self.out = [
            self.create_publisher(msg.TrackArray, f"{name}/tracks", stream()) for name in "ab"
        ]
        self.fused, self.associations = [], []
        self.create_subscription(
            msg.FusedTrackArray,
            "fused_tracks",
            lambda m: self.fused.append(fused_tracks_from_message(m)),
            stream(),
        )
        self.create_subscription(
            msg.TrackAssociations,
            "track_associations",
            lambda m: self.associations.append(track_associations_from_message(m)),
            stream(),
        )

    def autostart(self):
        pass


class Bench:
    """The node and two trackers that are Kalman filters."""

    def __init__(self, domain, **parameters):
        self.radars = KalmanRadars(3, BIAS)
        table = {"radars": ["a", "b"], **parameters}
        self.nodes = Nodes(lambda **o: [TrackFusionNode(table, **o), Trackers(**o)], domain)

    def __enter__(self):
        self.nodes.__enter__()
        self.node, self.other = self.nodes.nodes
        self.until(lambda: all(p.get_subscription_count() == 1 for p in self.other.out))
        self.until(lambda: self.other.count_publishers("track_associations") == 1)
        return self

    def __exit__(self, *unused):
        self.nodes.__exit__(*unused)

    def until(self, done):
        assert self.nodes.spin_until(done, TIMEOUT_S), self.node.fuser.counters

    def send(self, radar, tracks=None):
        tracks = self.radars.message(radar) if tracks is None else tracks
        self.other.out[radar].publish(tracks_to_message(tracks))

    def counted(self, name):
        self.until(lambda: {**self.node.counters, **self.node.fuser.counters}.get(name, 0) > 0)

    def play(self, scans, radars=(0, 1)):
        """Play scans; the fusion of the last one."""
        for _ in range(scans):
            self.radars.step()
            before = len(self.other.fused)
            for radar in radars:
                self.send(radar)
            self.until(
                lambda before=before: (
                    len(self.other.fused) > before
                    and len(self.other.associations) == len(self.other.fused)
                )
            )
        self.until(lambda: self.other.fused[-1].stamp_ns == round(self.radars.time_s * 1e9))
        return self.other.fused[-1], self.other.associations[-1]


@pytest.mark.parametrize("alignment", ["poses", "tf"])
def test_frames_that_differ_are_brought_together(domain, alignment):
    """The second radar tracks in a frame of its own, turned and shifted."""
    yaw, x, y = 0.7, 4000.0, -1000.0
    pose = RigidTransform(np.array([x, y, 0.0]), quaternion_of_angles(0.0, 0.0, yaw))
    poses = [0.0, 0.0, 0.0, x, y, yaw] if alignment == "poses" else []
    with Bench(domain, alignment=alignment, radar_poses=poses, bias_std_m=[0.0, 0.0]) as bench:
        bench.radars = KalmanRadars(3, [[0.0, 0.0], [0.0, 0.0]])
        turn = np.kron(np.eye(2), rotation_matrix(pose.rotation)[:2, :2])

        def own_frame(tracks):
            mean = tracks.mean - [x, y, 0.0, 0.0]
            covariance = turn.T @ tracks.covariance @ turn
            return replace(tracks, mean=mean @ turn, covariance=covariance, frame_id="second")

        bench.radars.step()
        if alignment == "tf":
            bench.send(1, own_frame(bench.radars.message(1)))
            bench.counted("refused_no_transform")
            message = transform_message()()
            message.transforms.append(stamped("map", "second", pose))
            sender = bench.other.create_publisher(type(message), "/tf_static", latched())
            sender.publish(message)
            buffer = bench.node._listener.buffer
            bench.until(lambda: "second" in buffer.frames())
        for _ in range(3):
            bench.radars.step()
            bench.send(0)
            bench.send(1, own_frame(bench.radars.message(1)))
        stamp_ns = round(bench.radars.time_s * 1e9)
        bench.until(lambda: bench.other.fused and bench.other.fused[-1].stamp_ns == stamp_ns)
        fused = bench.other.fused[-1]
    assert fused.member.all()
    assert fused.frame_id == "map"
    target = fused.member_track_id[:, 0]
    assert (fused.member_track_id[:, 1] == target + 100).all()
    assert np.abs(fused.mean - bench.radars.states[target])[:, :2].max() < 100.0


def stamped(parent, child, pose):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    for name, value in zip("xyz", pose.translation.tolist(), strict=True):
        setattr(message.transform.translation, name, value)
    for name, value in zip("xyzw", pose.rotation.tolist(), strict=True):
        setattr(message.transform.rotation, name, value)
    return message


def test_a_radar_is_silent_restarts_and_bad_input_is_counted(domain, monkeypatch):
    with Bench(domain, late_after_s=2.0, silent_after_s=4.0) as bench:
        bench.play(1, (0,))
        fused, _ = bench.play(5)
        assert fused.member.all()
        ids = fused.fused_track_id.tolist()
        assert bench.node.health() == (DiagnosticStatus.OK, "active")
        # The second radar stops; the first goes on alone.
        for _ in range(5):
            bench.radars.step()
            bench.send(0)
        bench.until(lambda: bench.other.fused[-1].radar_states == ("ok", "silent"))
        level, text = bench.node.health()
        assert (level, text) == (DiagnosticStatus.WARN, "b silent")
        # It comes back with a new tracker: other ids, the same targets.
        bench.radars.system_uuid[1] = b"n" * 16
        fused, found = bench.play(4)
        assert fused.radar_states == ("ok", "ok")
        assert fused.member.all()
        assert fused.fused_track_id.tolist() == ids
        assert bench.node.fuser.counters["radar_restarted"] == 1
        assert np.abs(found.bias[1] - BIAS[1]).max() < 60.0

        good = bench.radars.message(0)
        bad = {
            "refused_repeated": tracks_to_message(good),
            "refused_frame": tracks_to_message(replace(good, frame_id="elsewhere")),
        }
        short = tracks_to_message(good)
        short.tracks[0].state = [1.0, 2.0]
        bad["malformed_radar_tracks"] = short
        for name, message in bad.items():
            bench.other.out[0].publish(message)
            bench.counted(name)
        # A live change acts at the next fusion; what is not allowed is refused with a reason.
        (result,) = bench.node.set_parameters([Parameter("fusion_rule", value="average")])
        assert not result.successful
        assert "covariance_intersection" in result.reason
        rule = Parameter("fusion_rule", value="covariance_intersection")
        assert bench.node.set_parameters([rule])[0].successful
        wide = fused.covariance[:, 0, 0]
        fused, _ = bench.play(1)
        assert fused.fusion_rule == "covariance_intersection"
        assert (fused.covariance[:, 0, 0] > 1.05 * wide).all()
        figures = bench.node.figures()
        assert figures["b state"] == "ok"
        assert figures["of_several_radars"] == 4
        assert figures["refused_repeated"] == 1
        # Whatever breaks a fusion does not break the node: it begins anew with other ids.
        with monkeypatch.context() as broken:
            broken.setattr(bench.node.fuser, "_fuse", lambda: np.linalg.inv(np.zeros((2, 2))))
            bench.radars.step()
            bench.send(0)
            bench.send(1)
            bench.counted("fusion_failed")
        bench.play(1, (0,))
        fused, _ = bench.play(2)
        assert fused.member.all()
        assert fused.fused_track_id.min() > max(ids)
