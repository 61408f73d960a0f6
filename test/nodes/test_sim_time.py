"""Nodes on ``/clock``: its time is the nodes' time, also when it is set back."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import TIMEOUT_S
from rosgraph_msgs.msg import Clock
from test_radar_input import Driver, matched
from test_transforms import cloud

from gda_tracker.io.messages import stamp_to_time
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes, stage_nodes

S = 1_000_000_000
RADAR = {"use_sim_time": True, "stamp_source": "received", "sensor_id": "front"}
MANAGER = {"use_sim_time": True, "attribute_term": "none", "time_jump_s": 2.0}


class Simulator(Driver):
    """Tells the time, and publishes clouds without a stamp."""

    def __init__(self, **options):
        super().__init__(**options)
        self.clock = self.create_publisher(Clock, "/clock", stream())


@pytest.fixture
def graph(domain):
    parameters = {"track_manager": MANAGER}
    with Nodes(
        lambda **o: [*stage_nodes(parameters, **o), RadarInputNode(RADAR, **o), Simulator(**o)],
        domain,
    ) as nodes:
        simulator = nodes.nodes[-1]
        matched(nodes, simulator)
        assert nodes.spin_until(lambda: simulator.clock.get_subscription_count() >= 2, TIMEOUT_S)
        yield nodes


def tell(nodes, stamp_ns):
    nodes.nodes[-1].clock.publish(Clock(clock=stamp_to_time(stamp_ns)))
    hears = (nodes.nodes[0], nodes.nodes[-2])
    assert nodes.spin_until(
        lambda: all(n.get_clock().now().nanoseconds == stamp_ns for n in hears), TIMEOUT_S
    )


def test_the_time_of_scans_is_that_of_the_clock_also_when_it_is_set_back(graph):
    *stages, radar, simulator = graph.nodes
    simulator.clouds.publish(cloud(0))
    assert graph.spin_until(lambda: radar.counters["no_clock"] == 1, TIMEOUT_S)

    def lap():
        before = len(simulator.tracks)
        for step in range(6):
            tell(graph, 100 * S + step * S)
            simulator.clouds.publish(cloud(0))
            assert graph.spin_until(lambda n=before + step: len(simulator.tracks) > n, TIMEOUT_S)
        return simulator.tracks[before:]

    first = lap()
    expected = [100 * S + step * S for step in range(6)]
    assert [tracks.key.stamp_ns for tracks in first] == expected
    assert set(first[-1].track_id) == {1, 2}
    second = lap()
    assert [tracks.key.stamp_ns for tracks in second] == expected
    assert stages[0].manager.counters["reset_time_jump"] == 1
    assert radar.counters["stamp_stepped_back"] == 1
    assert set(second[0].deleted_track_id) == {1, 2}
    assert set(second[-1].track_id) == {3, 4}
    np.testing.assert_array_equal(first[-1].mean, second[-1].mean)


def test_diagnostics_are_stamped_by_the_clock(graph):
    simulator, told = graph.nodes[-1], []
    simulator.create_subscription(DiagnosticArray, "/diagnostics", told.append, stream())
    tell(graph, 7 * S)
    assert graph.spin_until(
        lambda: any(m.header.stamp.sec == 7 and m.status[0].name == "/track_manager" for m in told),
        TIMEOUT_S,
    )
