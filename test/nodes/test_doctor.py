"""``gda-tracker doctor`` on graphs in which each fault is staged."""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gda_tracker_msgs import msg
from live_helpers import call, spinning
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

import gda_tracker
from gda_tracker.io.messages import detections_to_message
from gda_tracker.nodes.association import AssociationNode
from gda_tracker.nodes.attribute_fusion import AttributeFusionNode
from gda_tracker.nodes.diagnosis.explanations import EXPLANATIONS, explanation
from gda_tracker.nodes.diagnosis.look import header_of
from gda_tracker.nodes.diagnosis.observation import Message, Observation
from gda_tracker.nodes.diagnosis.traffic_checks import connected, traffic_findings
from gda_tracker.nodes.qualities import latched, sensor, stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.rcs_fuzzifier import RcsFuzzifierNode
from gda_tracker.nodes.runner import private_environment, reserve_domain, stage_nodes
from gda_tracker.nodes.track_manager import TrackManagerNode
from gda_tracker.vocabulary.scans import Detections

LOOK = ("--seconds", "2", "--wait", "8")
PERIOD_S = 0.2


def scan(number, sensor_id="radar", frame_id="radar_link", stamp_ns=None):
    """Two targets, now, with the noise that the tracker expects."""
    range_noise, azimuth_noise = np.random.default_rng(number).normal(size=(2, 2))
    return Detections(
        sensor_id,
        time.time_ns() if stamp_ns is None else stamp_ns,
        np.array([3000.0 + number, 5000.0]) + 30.0 * range_noise,
        np.array([0.1, 0.6]) + 0.005 * azimuth_noise,
        rcs_m2=np.array([1.0, 4.0]),
        frame_id=frame_id,
        sequence=number + 1,
    )


class Driver(Node):
    """Publishes what a test makes of each number, five times a second."""

    def __init__(self, make=scan, name="driver", quality=None, **options):
        super().__init__(name, **options)
        self.numbers = itertools.count()
        self.make = make
        self.detections = self.create_publisher(
            msg.DetectionArray, "detections", quality or stream()
        )
        self.create_timer(PERIOD_S, self.publish)

    def autostart(self):
        """Nothing to start."""

    def publish(self):
        for detections in np.atleast_1d(self.make(next(self.numbers))):
            if not isinstance(detections, msg.DetectionArray):
                detections = detections_to_message(detections)
            self.detections.publish(detections)


class Silent(Node):
    """Has publishers on which nothing comes."""

    def __init__(self, *topics, name="silent", **options):
        super().__init__(name, **options)
        for kind, topic, quality in topics:
            self.create_publisher(kind, topic, quality)

    def autostart(self):
        """Nothing to start."""


@pytest.fixture
def doctor(capsys):
    """Calls the doctor; gives the exit code, the findings by name and the whole record."""

    def see(*arguments):
        code = call("doctor", "--json", *LOOK, *arguments)
        record = json.loads(capsys.readouterr().out)
        found = {}
        for finding in record["findings"]:
            assert all(finding[key] for key in ("level", "name", "subject", "what", "why", "fix"))
            found.setdefault(finding["name"], []).append(finding)
        return code, found, record

    return see


def grave(found):
    """Names of what needs attention; how full the host is does not depend on the graph."""
    return {
        name
        for name, findings in found.items()
        if name != "shared_memory_full" and any(f["level"] != "note" for f in findings)
    }


def test_a_ring_that_tracks_has_nothing_wrong(domain, doctor):
    light = {"track_manager": {"decision": "map", "filter": "cv"}}
    with spinning(lambda **o: [*stage_nodes(light, **o), Driver(**o)], domain):
        _, found, record = doctor()
    assert grave(found) == set(), found
    assert record["domain"] == domain
    assert record["nodes"] == dict.fromkeys(
        ("/track_manager", "/rcs_fuzzifier", "/attribute_fusion", "/association"), "active"
    )
    assert record["inputs"]["/detections"]["publishers"] == ["/driver"]
    assert record["inputs"]["/detections"]["rate_hz"] == pytest.approx(1 / PERIOD_S, rel=0.5)
    assert record["scans_answered"] > 3
    told = record["diagnostics"]
    assert {"rate_hz", "input_age_s", "nis_mean", "conflict_mean"} <= set(told["/track_manager"])
    assert float(told["/rcs_fuzzifier"]["attribute_used_share"]) == 1.0
    assert "pair_conflict_mean" in told["/attribute_fusion"]
    assert told["/association"]["engines"] != "none"
    for values in told.values():
        assert 0.0 < float(values["latency_ms_p50"]) <= float(values["latency_ms_p95"])
    assert [f["subject"] for f in found["discovery_localhost"]] == ["ROS_AUTOMATIC_DISCOVERY_RANGE"]


def test_nothing_is_discovered_and_the_other_domain_is_named(domain, doctor):
    other = reserve_domain()
    with spinning(lambda **o: [Driver(**o)], other):
        code, found, record = doctor("--wait", "0.5", "--seconds", "0.2")
    assert code == 1
    assert grave(found) == {"nothing_discovered"}
    (finding,) = found["nothing_discovered"]
    assert finding["subject"] == f"domain {domain}"
    assert re.search(rf"use domain [\d, ]*\b{other}\b", finding["why"]), finding
    assert "export ROS_DOMAIN_ID=" in finding["fix"]
    assert record["nodes"] == {}


def test_a_driver_without_a_tracker(domain, doctor):
    topics = ((PointCloud2, "points", stream()),)
    with spinning(lambda **o: [Silent(*topics, **o)], domain):
        code, found, _ = doctor("--wait", "5", "--seconds", "0.2")
    assert code == 1
    assert "other nodes: /silent" in found["ring_missing"][0]["what"]
    assert found["radar_found"][0]["fix"] == "gda-tracker run --input /points"


def test_nodes_missing_twice_inactive_and_without_input(domain, doctor):
    def make(**o):
        return [
            TrackManagerNode({}, **o),
            RcsFuzzifierNode({}, **o),
            RcsFuzzifierNode({}, **o),
            AttributeFusionNode({"autostart": False}, **o),
        ]

    def other(**o):
        # In one participant a topic cannot have two types at all.
        return [Silent((PointCloud2, "detections", stream()), **o)]

    with spinning(make, domain), spinning(other, domain):
        code, found, _ = doctor("--wait", "5", "--seconds", "1")
    assert code == 1
    assert [f["subject"] for f in found["node_missing"]] == ["/association"]
    assert [f["subject"] for f in found["node_duplicate"]] == ["/rcs_fuzzifier"]
    assert found["node_inactive"][0]["subject"] == "/attribute_fusion"
    assert found["node_inactive"][0]["what"] == "is unconfigured"
    assert "ros2 lifecycle set /attribute_fusion configure" in found["node_inactive"][0]["fix"]
    (mismatch,) = found["type_mismatch"]
    assert mismatch["subject"] == "/detections"
    assert "/silent publishes sensor_msgs/msg/PointCloud2" in mismatch["what"]
    assert "/track_manager reads gda_tracker_msgs/msg/DetectionArray" in mismatch["what"]
    assert {"node_missing", "node_duplicate", "node_inactive", "type_mismatch"} <= grave(found)
    assert "qos_mismatch" not in found


def test_an_input_that_nobody_publishes_and_one_elsewhere(domain, doctor):
    def make(**o):
        topics = ((msg.DetectionArray, "/front/detections", stream()),)
        return [*stage_nodes({}, **o), Silent(*topics, **o)]

    with spinning(make, domain):
        _, nowhere, _ = doctor("--input", "/nowhere", "--seconds", "0.2")
        _, found, _ = doctor()
    assert [f["subject"] for f in nowhere["input_missing"]] == ["/nowhere"]
    (finding,) = found["input_missing"]
    assert finding["subject"] == "/detections"
    assert "-r /front/detections:=/detections" in finding["fix"]
    assert "no detections yet" in found["diagnostics"][0]["what"]


def test_quality_of_service_silence_and_foreign_publishers(domain, doctor):
    manager = {"detections_reliability": "reliable"}

    def make(**o):
        return [
            *stage_nodes({"track_manager": manager}, **o),
            RadarInputNode({"input_topic": "points"}, **o),
            Driver(quality=sensor(10, "best_effort"), **o),
            Silent((PointCloud2, "points", stream()), (msg.Scan, "scans", latched()), **o),
        ]

    with spinning(make, domain):
        code, found, _ = doctor()
    assert code == 1
    (mismatch,) = found["qos_mismatch"]
    assert mismatch["subject"] == "/detections"
    assert "/driver offers best effort, volatile" in mismatch["what"]
    assert "/track_manager asks for reliable, volatile" in mismatch["what"]
    assert "detections_reliability: best_effort" in mismatch["fix"]
    assert [f["subject"] for f in found["no_messages"]] == ["/points"]
    assert "/silent publishes it, and nothing came" in found["no_messages"][0]["what"]
    assert found["foreign_publisher"][0]["subject"] == "/scans"
    assert "/silent" in found["foreign_publisher"][0]["what"]


def test_durability_that_does_not_go_together(domain, doctor):
    def make(**o):
        return [
            RcsFuzzifierNode({}, **o),
            Silent((msg.Scan, "scans", stream()), name="track_manager", **o),
        ]

    with spinning(make, domain):
        _, found, _ = doctor("--wait", "5", "--seconds", "1")
    (mismatch,) = found["qos_mismatch"]
    assert "/track_manager offers reliable, volatile" in mismatch["what"]
    assert "asks for reliable, transient local" in mismatch["what"]
    assert found["node_silent"][0]["subject"] == "/track_manager"


def all_but_association(**options):
    """Made one by one: a node that was made and dropped is seen until the collector comes."""
    stages = (TrackManagerNode, RcsFuzzifierNode, AttributeFusionNode)
    return [*(stage({}, **options) for stage in stages), Driver(**options)]


def test_a_ring_that_is_open_where_a_topic_was_renamed(domain, doctor):
    with (
        spinning(all_but_association, domain),
        spinning(
            lambda **o: [AssociationNode({}, **o)],
            domain,
            ["--ros-args", "-r", "associations:=elsewhere"],
        ),
    ):
        # A stage counts as silent only after seconds, which a busy machine may begin late.
        for _ in range(4):
            code, found, _ = doctor()
            if {"topic_missing", "not_answered", "diagnostics"} <= set(found):
                break
    assert code == 1
    (finding,) = found["topic_missing"]
    assert finding["subject"] == "/associations"
    assert "/association does not publish it" in finding["what"]
    assert "not_answered" in found
    assert "a stage does not answer" in found["diagnostics"][0]["what"]


def drifting(number):
    """A scan of each of five sensors, each with another fault of time or frame."""
    now = time.time_ns()
    return [
        scan(number, "unset", stamp_ns=0),
        scan(number, "backwards", stamp_ns=now - (2_000_000_000 if number % 3 == 2 else 0)),
        scan(number, "power_on", stamp_ns=number * 100_000_000 + 1),
        scan(number, "slow", frame_id="", stamp_ns=now - 3_000_000_000),
        scan(number, "two_frames", frame_id=("a", "b")[number % 2]),
    ]


def test_time_and_frames(domain, doctor):
    manager = {"use_sim_time": True, "time_jump_s": 1e12}

    def make(**o):
        return [
            TrackManagerNode({k: v for k, v in manager.items() if k != "use_sim_time"}, **o),
            *(s({}, **o) for s in (RcsFuzzifierNode, AttributeFusionNode, AssociationNode)),
            Driver(drifting, **o),
        ]

    with spinning(make, domain, ["--ros-args", "-p", "track_manager:use_sim_time:=true"]):
        code, found, _ = doctor()
    assert code == 1
    by_name = {name: [f["subject"] for f in findings] for name, findings in found.items()}
    assert by_name["stamp_unset"] == ["/detections (unset)"]
    assert by_name["stamp_backwards"] == ["/detections (backwards)"]
    assert re.search(r"by up to 1\.\d+ s", found["stamp_backwards"][0]["what"])
    assert by_name["stamp_epoch"] == ["/detections (power_on)"]
    assert by_name["stamp_offset"] == ["/detections (slow)"]
    assert re.search(r"are 3\.\d s behind the clock", found["stamp_offset"][0]["what"])
    assert by_name["frame_unset"] == ["/detections (slow)"]
    assert by_name["frame_changes"] == ["/detections (two_frames)"]
    assert by_name["sensor_clocks_differ"] == ["/detections"]
    assert by_name["clock_missing"] == ["/clock"]
    assert by_name["clock_mixed"] == ["use_sim_time"]
    # What the door makes of it is explained.
    assert "older than the newest one" in found["rejected_late"][0]["why"]
    assert "reorder_window_s" in found["rejected_late"][0]["fix"]


def test_rejections_that_rise_and_those_of_the_past(domain, doctor):
    def broken(number):
        good = scan(number)
        if number < 4:
            return good, replace(good, sensor_id="")
        return good, replace(
            good, stamp_ns=good.stamp_ns + 1_000_000, azimuth_rad=good.azimuth_rad[:1]
        )

    with spinning(lambda **o: [*stage_nodes({}, **o), Driver(broken, **o)], domain) as nodes:
        manager = nodes.nodes[0]
        limit = time.monotonic() + 30.0
        while manager.counters["rejected_array_length_mismatch"] < 3:
            assert time.monotonic() < limit
            time.sleep(0.05)
        _, found, _ = doctor()
    (rises,) = found["rejected_array_length_mismatch"]
    assert rises["level"] == "error"
    assert "just now" in rises["what"]
    assert "none of them" not in rises["what"]
    assert "DetectionArray.msg" in rises["fix"]
    (past,) = found["rejected_missing_sensor_id"]
    assert past["level"] == "note"
    assert past["what"] == "rejected_missing_sensor_id 4, none of them just now"


def test_the_command_prints_for_people(environment):
    done = subprocess.run(
        [sys.executable, "-m", "gda_tracker.cli", "doctor", "--wait", "0.5", "--seconds", "0.2"],
        env={**environment, "COLUMNS": "100", "FASTDDS_DEFAULT_PROFILES_FILE": "/no/such.xml"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1, done.stderr
    assert f"ROS domain {environment['ROS_DOMAIN_ID']}, namespace /" in done.stdout
    assert "error FASTDDS_DEFAULT_PROFILES_FILE: is /no/such.xml: No such file" in done.stdout
    assert "  why: " in done.stdout
    assert "  fix: export ROS_DOMAIN_ID=" in done.stdout or "gda-tracker run" in done.stdout
    assert re.search(r"\n\d+ errors", done.stdout)
    assert max(map(len, done.stdout.splitlines())) <= 100


@pytest.mark.parametrize(
    ("variables", "name"),
    [
        ({"RMW_IMPLEMENTATION": "rmw_no_such_cpp"}, "middleware_missing"),
        ({"ROS_DOMAIN_ID": "five"}, "domain_invalid"),
    ],
)
def test_variables_with_which_no_node_starts(variables, name):
    done = subprocess.run(
        [sys.executable, "-m", "gda_tracker.cli", "doctor", "--json", *LOOK],
        env={**private_environment(), **variables},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1, done.stderr
    assert name in [finding["name"] for finding in json.loads(done.stdout)["findings"]]


# --- parts


def test_the_header_is_read_without_decoding():
    from rclpy.serialization import serialize_message

    for frame, name in (("", "a"), ("radar_link", "radär"), ("abc", ""), ("abcd", "front")):
        message = detections_to_message(scan(3, name, frame, 12_345_678_901))
        found = header_of(bytes(serialize_message(message)), of_sensor=True)
        assert found == (12_345_678_901, frame, name)


def test_frames_that_hang_together():
    transforms = [("map", "odom"), ("odom", "base"), ("base", "radar"), ("other", "lidar")]
    assert connected(transforms, "map") == {"map", "odom", "base", "radar"}
    seen = Observation(0, "/", 1.0, inputs=["/detections"], transforms=transforms)
    seen.parameters = {"track_manager": {"tracking_frame": "map"}}
    for frame, expected in (("radar", []), ("/radar", []), ("lidar", ["frame_unknown"])):
        now = time.time_ns()
        seen.heard = {"/detections": [Message(0.0, now, now, frame, "s")]}
        assert [f.name for f in traffic_findings(seen)] == expected


def counted_names():
    """Names of counters in the source of the nodes and of what they call."""
    root = Path(gda_tracker.__file__).parent
    patterns = (
        r'(?:counters|counts)\[f?"([^"{]+)"\]',
        r'\.drop\(f?"([^"{]+)"',
        r'leave_out\(.*"(\w+)"(?:, counts)?\)\n',
        r'\(\w+Error, "(\w+)"\)',
        r'Refused\(\s*"(\w+)"',
        r'_count\(counters, "(\w+)"',
        r'TracksRejected\(\s*"(\w+)"',
        r'\(.*, "(formation_track_\w+)"\),\n',
    )
    found = set()
    folders = ("nodes", "tracking", "attributes", "events", "formations", "fusion", "io/radar")
    for folder in folders:
        for path in (root / folder).rglob("*.py"):
            text = path.read_text()
            for pattern in patterns:
                found.update(re.findall(pattern, text))
            if "tracking/statement" not in path.as_posix():
                found.update(f"rejected_{r}" for r in re.findall(r' Rejected\("(\w+)"\)', text))
    text = (root / "tracking" / "initial_tracks.py").read_text()
    return found | {f"rejected_{r}" for r in re.findall(r'return "(initial_tracks_\w+)"', text)}


def test_every_counter_is_explained():
    names = counted_names()
    assert len(names) > 50
    assert {name for name in names if explanation(name) is None and name != "recorded "} == set()
    inputs = ("scans", "predictions", "evidence", "attribute_scores", "associations")
    made = {f"malformed_{topic}" for topic in inputs} | {"reset_gap", "reset_time_jump"}
    made |= {"tracked", "degraded", "gave_up", "statement_admitted", "dropped_statement_too_old"}
    made |= {"dropped_statement_gone_track", "dropped_statement_too_far_ahead"}
    made |= {"incomplete", "overflow", "refused_repeated", "refused_backwards"}
    assert set(EXPLANATIONS) - names - made == set()
    assert "required is that" in explanation("statement_rejected_bad_masses").meaning
    assert explanation("length_m_out_of_range").meaning.startswith("values of length_m")
    assert explanation("statement_rejected_nonsense") is None
