"""Two rings and the node track_fusion over real topics, scan by scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gda_tracker_msgs import msg
from rclpy.node import Node

from gda_tracker.io.fusion_messages import (
    fused_tracks_from_message,
    track_associations_from_message,
)
from gda_tracker.io.messages import detections_to_message, tracks_from_message
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.track_fusion import TrackFusionNode
from gda_tracker.vocabulary.fused_tracks import FusedTracks, TrackAssociations
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import Tracks

TIMEOUT_S = 60.0


class FusionClient(Node):
    """Publishes the detections of radars and keeps their tracks and what is made of them."""

    def __init__(self, radars: Sequence[str], **options: Any) -> None:
        super().__init__("fusion_client", **options)
        self.detections = {
            name: self.create_publisher(msg.DetectionArray, f"{name}/detections", stream())
            for name in radars
        }
        self.tracks: dict[str, list[Tracks]] = {name: [] for name in radars}
        self.fused: list[FusedTracks] = []
        self.associations: list[TrackAssociations] = []
        for name in radars:
            self.create_subscription(
                msg.TrackArray,
                f"{name}/tracks",
                lambda m, name=name: self.tracks[name].append(tracks_from_message(m)),
                stream(),
            )
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

    def autostart(self) -> None:
        """Be ready at once: it has no life cycle."""

    @property
    def matched(self) -> bool:
        """Whether all publishers and subscriptions have found each other."""
        return (
            all(p.get_subscription_count() > 0 for p in self.detections.values())
            and all(self.count_publishers(f"{name}/tracks") == 1 for name in self.tracks)
            and all(self.count_subscribers(f"{name}/tracks") == 2 for name in self.tracks)
            and self.count_publishers("track_associations") == 1
        )


def play_over_topics(
    recordings: Mapping[str, Recording],
    rings: Mapping[str, Mapping[str, Any]],
    fusion: Mapping[str, Any],
    domain: int,
    scans: int | None = None,
) -> tuple[FusionClient, TrackFusionNode]:
    """Play a recording per radar through a ring each, in step; return what came of it.

    Parameters
    ----------
    recordings, rings
        Recording, and parameters ``{node: {name: value}}``, of each radar by name.
    fusion
        Parameters of ``track_fusion``.
    """
    names = list(recordings)

    def make(**options: Any) -> list[Any]:
        return [
            TrackFusionNode(fusion, **options),
            FusionClient(names, **options),
            *(
                node
                for name in names
                for node in stage_nodes(rings[name], namespace=name, **options)
            ),
        ]

    with Nodes(make, domain) as nodes:
        node, client = nodes.nodes[:2]

        def until(done: Any) -> None:
            if not nodes.spin_until(done, TIMEOUT_S):
                raise RuntimeError(f"nothing came within {TIMEOUT_S:g} s: {node.fuser.counters}")

        until(lambda: client.matched)
        for scan in range(len(recordings[names[0]].detections[:scans])):
            for name in names:
                detections = recordings[name].detections[scan]
                client.detections[name].publish(detections_to_message(detections))
                until(lambda name=name, n=scan + 1: len(client.tracks[name]) == n)
            # The first tracks that come are fused without waiting for the other radar.
            stamp_ns = recordings[names[0]].detections[scan].stamp_ns
            until(
                lambda stamp_ns=stamp_ns: (
                    bool(client.associations)
                    and client.associations[-1].stamp_ns == stamp_ns
                    and len(client.fused) == len(client.associations)
                )
            )
        return client, node
