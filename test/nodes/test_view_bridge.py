"""The page's ear at a running ring: it hears every scan, and changes parameters of the nodes."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from graph_helpers import offline, scenario_plays

from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.nodes.view_bridge import FORMATIONS, MOST_OPEN, PARTS, Joiner, ViewBridge
from gda_tracker.view.history import History
from gda_tracker.vocabulary.scans import ScanKey, ScanReport
from gda_tracker.vocabulary.tracks import Tracks

TIMEOUT_S = 60.0
pytestmark = pytest.mark.nodes


def matched(bridge, nodes):
    """Whether everything that the bridge listens to, and all services it asks, have found it."""
    publishers = [p for node in nodes.nodes[1:] for p in node._outputs]
    wanted = {f"/{topic}" for _, topic, _, _ in PARTS} | {"/scan_reports"}
    heard = {p.topic_name for p in publishers if bridge._node.count_publishers(p.topic_name)}
    # The other stages subscribe to all but tracks and reports too.
    readers = {
        p.topic_name: p.get_subscription_count()
        for p in publishers
        if p.topic_name in ("/tracks", "/scan_reports")
    }
    clients = [client for pair in bridge._node.clients_of.values() for client in pair]
    return (
        wanted <= heard
        and all(count >= 2 for count in readers.values())
        and all(client.service_is_ready() for client in clients)
    )


def test_it_hears_every_scan_and_a_change_acts_at_the_next_one(domain):
    plays, parameters = scenario_plays("crossing_targets", "gda/dsm_classic/cv")
    expected = offline(plays, parameters)
    history = History()
    bridge = ViewBridge(history, domain=domain)
    # A client must not wait in the thread that serves the nodes.
    with (
        ThreadPoolExecutor(1) as desk,
        Nodes(
            lambda **o: [
                ScanSourceNode({"autostart": False}, plays=plays, collect=True, **o),
                *stage_nodes(parameters, **o),
            ],
            domain,
        ) as nodes,
    ):
        try:
            source = nodes.nodes[0]
            source.trigger_configure()
            assert nodes.spin_until(lambda: matched(bridge, nodes), TIMEOUT_S)

            def wait(call, *arguments):
                future = desk.submit(call, *arguments)
                assert nodes.spin_until(future.done, TIMEOUT_S)
                return future.result()

            values = wait(bridge.values)
            assert set(values) == {*parameters, "association", "attribute_fusion"}
            assert values["track_manager"]["gate_probability"] == 0.99
            assert values["rcs_fuzzifier"]["class_names"] == ["false_alarm", "fighter", "cargo"]
            assert values["rcs_fuzzifier"]["attribute_names"] == []

            refused = wait(bridge.change, "track_manager", {"gate_probability": 1.5})
            assert not refused.accepted
            assert "gate_probability = 1.5: allowed is a number > 0" in refused.reason
            fixed = wait(bridge.change, "rcs_fuzzifier", {"membership": "density"})
            assert not fixed.accepted
            assert "membership" in fixed.reason
            assert wait(bridge.values) == values

            source.trigger_activate()
            total = len(plays[0].detections)
            assert nodes.spin_until(
                lambda: source.finished and history.newest == total, TIMEOUT_S
            ), f"{history.newest} of {total} scans were heard"
            for _, picture in history.between(1, total):
                key = picture.report.key
                tracks = expected[(key.sensor_id, key.stamp_ns)]
                assert np.array_equal(picture.tracks.mean, tracks.mean)
                assert picture.gates is not None
                assert picture.decision.scores is not None
                assert picture.report.latency_s > 0.0
                assert picture.settings.gate_probability == 0.99
            assert bridge.status()["error"] == ""

            accepted = wait(bridge.change, "track_manager", {"gate_probability": 0.7})
            assert accepted.accepted
            assert wait(bridge.values)["track_manager"]["gate_probability"] == 0.7
        finally:
            bridge.close()


def test_without_a_ring_it_says_so(domain):
    bridge = ViewBridge(History(), namespace="radar_1", domain=domain)
    try:
        assert bridge.values() == {}
        assert "is a ring running" in bridge.status()["error"]
        assert "/radar_1" in bridge.status()["source"]
        answer = bridge.change("track_manager", {"gate_probability": 0.7})
        assert (answer.accepted, answer.reason) == (False, "node track_manager is not there")
    finally:
        bridge.close()


NAMES = [name for name, *_ in PARTS]


def part(name, key):
    return (
        ScanReport(key, "tracked")
        if name == "report"
        else Tracks(key)
        if name == "tracks"
        else name
    )


@pytest.mark.parametrize("shift", range(len(NAMES) + 1))
def test_parts_are_joined_in_whatever_order_they_come(shift):
    joiner, key = Joiner(), ScanKey(1, "radar", 10)
    order = [*NAMES, "report"]
    order = order[shift:] + order[:shift]
    given = [joiner.take(name, key, part(name, key), 0.0) for name in order]
    assert [len(results) for results in given] == [0] * len(NAMES) + [1]
    (result,) = given[-1]
    assert (result.scan, result.report.key) == ("scan", key)
    # Sent again, it is no second scan.
    assert list(itertools.chain(*(joiner.take(n, key, part(n, key), 9.0) for n in order))) == []
    assert joiner.due(99.0) == []


def test_a_lost_part_is_waited_for_and_then_done_without():
    joiner, key = Joiner(wait_s=0.25), ScanKey(1, "radar", 10)
    for name in ("scan", "tracks", "report"):
        assert joiner.take(name, key, part(name, key), 1.0) == []
    assert joiner.due(1.2) == []
    (result,) = joiner.due(1.25)
    assert (result.scan, result.evidence, result.associations) == ("scan", None, None)


def test_formations_are_waited_for_where_somebody_follows_them():
    joiner, key = Joiner(wait_s=0.25), ScanKey(1, "radar", 10)
    joiner.with_formations = True
    for name in (*NAMES, "report"):
        assert joiner.take(name, key, part(name, key), 1.0) == []
    (result,) = joiner.take(FORMATIONS, key, "formations", 1.1)
    assert result.scan == "scan"
    later = ScanKey(1, "radar", 20)
    for name in (*NAMES, "report"):
        joiner.take(name, later, part(name, later), 2.0)
    assert len(joiner.due(2.25)) == 1


def test_formations_that_come_unexpected_stand_for_no_other_part():
    joiner, key = Joiner(), ScanKey(1, "radar", 10)
    for name in (*NAMES, FORMATIONS):
        assert joiner.take(name, key, part(name, key), 1.0) == []
    (result,) = joiner.take("report", key, ScanReport(key, "degraded"), 1.0)
    assert result.report.outcome == "degraded"


def test_a_joiner_keeps_little():
    joiner = Joiner()
    for stamp in range(10 * MOST_OPEN):
        key = ScanKey(1, "radar", stamp)
        assert joiner.take("scan", key, "scan", 0.0) == []  # no tracks ever
        assert len(joiner._open) <= MOST_OPEN
        assert len(joiner._given) <= 5 * MOST_OPEN
