"""Live changes in the graph: twenty in quick succession, and those that act by the wall clock."""

from __future__ import annotations

import pytest
from gda_tracker_msgs import msg
from graph_bench import Client
from graph_helpers import differences, play
from live_parameter_cases import IN_THE_NODE, crossing
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from tracking_examples import QUIET

from gda_tracker.io.messages import detections_to_message, predictions_from_message
from gda_tracker.nodes.association import AssociationNode
from gda_tracker.nodes.qualities import latched
from gda_tracker.nodes.rcs_fuzzifier import RcsFuzzifierNode
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.nodes.stage import StageNode
from gda_tracker.nodes.track_manager import TrackManagerNode
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.ring import Ring

WAIT_S = 60.0
MANAGER, FUSION, FUZZIFIER, ASSOCIATION = (
    "track_manager",
    "attribute_fusion",
    "rcs_fuzzifier",
    "association",
)
STAYS = [0.8, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8]
# Node, values, and a word of the reason where it is refused.
CHANGES = [
    (MANAGER, {"gate_probability": 0.9}, ""),
    (MANAGER, {"gate_probability": 2.0}, "allowed is a number > 0"),
    (MANAGER, {"decision": "jpda", "detection_probability": 0.8}, ""),
    (ASSOCIATION, {"max_exact_size": 1}, ""),
    (MANAGER, {"range_std_m": 14.0, "confirmation_hits": 9}, "at most confirmation_scans"),
    (FUZZIFIER, {"rcs_min_m2": 0.8}, ""),
    (MANAGER, {"process_noise_std_mps2": 4.0}, ""),
    (FUSION, {"class_transition": STAYS}, ""),
    (FUSION, {"class_transition": [0.5] * 4}, "9 for the 3 classes"),
    (MANAGER, {"filter": "imm"}, ""),
    (MANAGER, {"tracking_frame": "odom"}, "read-only"),
    (ASSOCIATION, {"coalescence_remedy": "jpda_star", "max_exact_size": 9}, ""),
    (MANAGER, {"gate_probability": 0.999}, ""),
    (MANAGER, {"decision": "mht", "mht_scans": 4}, ""),
    (FUZZIFIER, {"rcs_max_m2": 0.1}, "allowed is a number > rcs_min_m2"),
    (FUZZIFIER, {"rcs_min_m2": 1e-3}, ""),
    (MANAGER, {"mht_leaves_per_track": 3, "clutter_density_per_m_rad": 1e-5}, ""),
    (MANAGER, {"attribute_term": "pcr5"}, ""),
    (MANAGER, {"decision": "map", "range_std_m": 12.0}, ""),
    (FUSION, {"class_transition": []}, ""),
]


class Changer(Node):
    """Asks for one change after the other, each as soon as the one before is answered."""

    def __init__(self, **options):
        super().__init__("changer", **options)
        self.reasons, self.gates = [], {}
        self.asked = False
        self.clients_of = {
            name: self.create_client(SetParametersAtomically, f"{name}/set_parameters_atomically")
            for name in (MANAGER, FUSION, FUZZIFIER, ASSOCIATION)
        }
        self.create_subscription(msg.Predictions, "predictions", self.on_predictions, latched())

    def autostart(self):
        """Nothing to start."""

    def on_predictions(self, message):
        found = predictions_from_message(message)
        self.gates[found.key.stamp_ns] = found.settings.gate_probability
        if not self.asked and len(self.gates) >= 3:
            self.asked = True
            self.ask()

    def ask(self):
        if len(self.reasons) == len(CHANGES):
            return
        node, values, _ = CHANGES[len(self.reasons)]
        parameters = []
        for name, value in values.items():
            kind = Parameter.Type.DOUBLE_ARRAY if isinstance(value, list) else None
            parameters.append(Parameter(name, kind, value).to_parameter_msg())
        request = SetParametersAtomically.Request(parameters=parameters)
        self.clients_of[node].call_async(request).add_done_callback(self.answered)

    def answered(self, future):
        result = future.result().result
        self.reasons.append("" if result.successful else result.reason or "refused")
        self.ask()


def spy(node, changes, stamps):
    """Note at which scan each change that a node takes will act."""

    def use(parameters, taken=node.use_parameters):
        if isinstance(node, StageNode):
            answered = node._table_of_scans._answered
            place = 0 if answered is None else stamps.index(answered.stamp_ns) + 1
        else:
            place = node.manager.state.scans_closed + (node.manager.opened is not None)
        old = node.parameters
        taken(parameters)
        changed = {
            name: value for name, value in vars(parameters).items() if value != getattr(old, name)
        }
        changes.append((place, node.get_name(), changed))

    node.use_parameters = use


def test_twenty_changes_act_at_the_next_scan_or_are_refused_with_a_reason(domain):
    """What comes out is bit for bit what the ring offline makes with the changes at these scans."""
    scans = crossing() * 3
    period = scans[-1].stamp_ns - scans[0].stamp_ns + 10**9
    for place, scan in enumerate(scans):
        lap = place // len(crossing())
        scans[place] = type(scan)(
            scan.sensor_id,
            scan.stamp_ns + lap * period,
            scan.range_m,
            scan.azimuth_rad,
            rcs_m2=scan.rcs_m2,
        )
    stamps = [scan.stamp_ns for scan in scans]
    parameters = {MANAGER: QUIET}
    changes = []

    def make(**o):
        source = ScanSourceNode({}, plays=[Playback("laps", scans)], collect=True, **o)
        return [source, Changer(**o), *stage_nodes(parameters, **o)]

    with Nodes(make, domain) as nodes:
        source, changer, *ring = nodes.nodes
        for node in ring:
            spy(node, changes, stamps)
        played = play(nodes, source)
        assert nodes.spin_until(lambda: len(changer.reasons) == len(CHANGES), WAIT_S)
        counters = dict(ring[0].manager.counters)

    for (_, _, word), reason in zip(CHANGES, changer.reasons, strict=True):
        assert word in reason if word else reason == ""
    wanted = [(node, values) for node, values, word in CHANGES if not word]
    assert [(node, values) for _, node, values in changes] == wanted
    # Nothing was dropped, and the changes fell among the scans.
    assert [report.outcome for report in played.reports] == ["tracked"] * len(scans)
    assert not [name for name in counters if name.startswith("rejected")], counters
    places = [place for place, _, _ in changes]
    assert 2 <= places[0] <= places[-1] < len(scans) - 1, places
    for place, node, values in changes:
        if "gate_probability" in values:
            assert node == MANAGER
            assert changer.gates[stamps[place]] == values["gate_probability"]
            assert changer.gates[stamps[place - 1]] != values["gate_probability"]

    offline, expected = Ring(parameters), {}
    for place, scan in enumerate(scans):
        for at, node, values in changes:
            if at == place:
                offline.set_parameters({node: values})
        expected[(scan.sensor_id, scan.stamp_ns)] = offline.process(scan).tracks
    assert differences(played.tracks, expected) == []


# --- by the wall clock

TOGETHER = {
    "scan_timeout_s": [TrackManagerNode],
    "attribute_timeout_s": [TrackManagerNode, RcsFuzzifierNode, AssociationNode],
    "reorder_timeout_s": [TrackManagerNode],
    "stale_after_s": [TrackManagerNode],
}
BASE = {
    "retry_period_s": 30.0,
    "stale_after_s": 1000.0,
    "reorder_timeout_s": 0.0,
}


@pytest.mark.parametrize("name", IN_THE_NODE[MANAGER])
def test_what_acts_by_the_wall_clock(name, domain):
    reorder = {"reorder_window_s": 5.0} if name == "reorder_timeout_s" else {}
    base = {**QUIET, **BASE, **reorder}

    def make(**o):
        first, *others = TOGETHER[name]
        return [Client(**o), first(base, **o), *(kind({}, **o) for kind in others)]

    with Nodes(make, domain) as nodes:
        client, manager, *_ = nodes.nodes

        def until(done):
            assert nodes.spin_until(done, WAIT_S)

        until(
            lambda: (
                client.detections.get_subscription_count() > 0
                and client.count_publishers("scan_reports") > 0
            )
        )
        client.detections.publish(detections_to_message(crossing()[0]))
        until(lambda: manager._last_input is not None)
        until(lambda: bool(manager.manager.opened) != bool(reorder))

        shows = {
            "scan_timeout_s": lambda: [r.outcome for r in client.reports] == ["gave_up"],
            "attribute_timeout_s": lambda: [r.outcome for r in client.reports] == ["degraded"],
            "reorder_timeout_s": lambda: manager.manager.opened is not None,
            "stale_after_s": lambda: manager.health()[1].startswith("stale"),
        }[name]
        nodes.spin_until(lambda: False, 0.6)
        assert not shows()
        (result,) = manager.set_parameters([Parameter(name, value=0.2)])
        assert result.successful, result.reason
        until(shows)
