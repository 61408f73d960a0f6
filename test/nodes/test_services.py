"""Services of the nodes over DDS: reset, save_state, load_state, done or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from graph_helpers import TIMEOUT_S, differences, offline, scenario_plays
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.simulation.playback import Playback

METHOD = "map/bayes/cv"


class Operator(Node):
    """Asks the services by hand."""

    def __init__(self, **options):
        super().__init__("operator", **options)
        self._clients_of = {}

    def autostart(self):
        pass

    def ask(self, nodes, service):
        client = self._clients_of.setdefault(service, self.create_client(Trigger, service))
        assert nodes.spin_until(client.service_is_ready, TIMEOUT_S), service
        future = client.call_async(Trigger.Request())
        assert nodes.spin_until(future.done, TIMEOUT_S), service
        return future.result().success, future.result().message


@pytest.fixture
def graph(domain):
    """Four stages that no scan has come to, and an operator."""
    _, parameters = scenario_plays("crossing_targets", METHOD)
    parameters["track_manager"]["initiation"] = "automatic"
    with Nodes(lambda **o: [*stage_nodes(parameters, **o), Operator(**o)], domain) as nodes:
        yield nodes


def play_part(nodes, detections):
    """Play some scans into the running graph; return their tracks."""
    source = ScanSourceNode(
        {}, plays=[Playback("part", list(detections))], collect=True, context=nodes.context
    )
    nodes.executor.add_node(source)
    source.autostart()
    try:
        assert nodes.spin_until(lambda: source.finished, TIMEOUT_S)
        assert not source.error
        return source.progress.tracks
    finally:
        nodes.executor.remove_node(source)
        source.destroy_node()


def set_parameter(node, name, value):
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert result.successful, result.reason


def test_reset_save_and_load_over_dds(graph, tmp_path):
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    parameters["track_manager"]["initiation"] = "automatic"
    scans = plays[0].detections[:12]
    manager, operator = graph.nodes[0], graph.nodes[-1]
    plain = Playback("plain", list(scans))
    expected = offline([plain], parameters)
    assert differences(play_part(graph, scans), expected) == []

    path = tmp_path / "state"
    assert operator.ask(graph, "track_manager/save_state") == (
        False,
        "parameter state_path is empty: set it to the file first",
    )
    set_parameter(manager, "state_path", str(path))
    done, text = operator.ask(graph, "track_manager/load_state")
    assert (done, "there is no such file" in text) == (False, True)
    before = manager.manager.state
    done, text = operator.ask(graph, "track_manager/save_state")
    assert done
    assert f"tracks after 12 scans saved to {path}" in text
    assert manager.manager.state is before

    done, text = operator.ask(graph, "track_manager/reset")
    lived = int(before.table.chosen.sum())
    assert (done, text) == (True, f"{lived} tracks ended, 0 scans dropped")
    again = play_part(graph, scans)
    assert set(again) == set(expected)
    for key, tracks in again.items():
        assert not set(tracks.track_id) & set(expected[key].track_id)
        np.testing.assert_array_equal(tracks.mean, expected[key].mean)

    issued = manager.manager.state.next_track_id
    done, text = operator.ask(graph, "track_manager/load_state")
    assert done, text
    assert manager.manager.state.next_track_id == issued
    rest = plays[0].detections[12:16]
    full = Playback("full", plays[0].detections[:16])
    wanted = offline([full], parameters)
    for key, tracks in play_part(graph, rest).items():
        np.testing.assert_array_equal(tracks.mean, wanted[key].mean)
        np.testing.assert_array_equal(tracks.class_probability, wanted[key].class_probability)
    path.write_text("damaged")
    done, text = operator.ask(graph, "track_manager/load_state")
    assert (done, "it is not a checkpoint of this version" in text) == (False, True)
    assert manager.counters["refused_load_state"] == 2
    for stage in ("rcs_fuzzifier", "attribute_fusion", "association"):
        assert operator.ask(graph, f"{stage}/reset") == (True, "0 incomplete scans forgotten")


def test_an_inactive_node_refuses(graph):
    manager, operator = graph.nodes[0], graph.nodes[-1]
    manager.trigger_deactivate()
    assert operator.ask(graph, "track_manager/reset") == (
        False,
        "track_manager is not active: configure and activate it first",
    )
    manager.trigger_activate()
    assert operator.ask(graph, "track_manager/reset") == (True, "0 tracks ended, 0 scans dropped")


def test_a_bag_that_loops_makes_the_same_tracks_again(graph):
    """The stamps step back; nobody asks for a reset."""
    plays, _ = scenario_plays("crossing_targets", METHOD)
    scans = plays[0].detections[:15]
    first = play_part(graph, scans)
    living = set(first[(scans[-1].sensor_id, scans[-1].stamp_ns)].track_id.tolist())
    second = play_part(graph, scans)
    manager = graph.nodes[0].manager
    assert manager.counters["reset_time_jump"] == 1
    assert set(second[(scans[0].sensor_id, scans[0].stamp_ns)].deleted_track_id) == living
    for key, tracks in second.items():
        assert not set(tracks.track_id) & set(first[key].track_id)
        np.testing.assert_array_equal(tracks.mean, first[key].mean)
        np.testing.assert_array_equal(tracks.covariance, first[key].covariance)
