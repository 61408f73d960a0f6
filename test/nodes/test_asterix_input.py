"""ASTERIX by UDP in the node graph: turns become scans and tracks, what is broken is counted."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from asterix_examples import block, plot, traffic
from gda_tracker_msgs.msg import DetectionArray, TrackArray
from rclpy.node import Node
from test_radar_input import command
from test_run_and_record import start, stop

from gda_tracker.io.messages import detections_from_message, tracks_from_message
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes, stage_nodes

WAIT_S = 40.0
GROUP = "239.255.48.34"


class Listener(Node):
    """Keeps what comes of the radar."""

    def __init__(self, **options):
        super().__init__("listener", **options)
        self.detections, self.tracks = [], []
        self.create_subscription(
            DetectionArray,
            "detections",
            lambda m: self.detections.append(detections_from_message(m)),
            stream(),
        )
        self.create_subscription(
            TrackArray, "tracks", lambda m: self.tracks.append(tracks_from_message(m)), stream()
        )

    def autostart(self):
        pass


class Radar:
    """Sends datagrams."""

    def __init__(self, host, port):
        self._to = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        local = socket.inet_aton("127.0.0.1")
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, local)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)

    def send(self, payload):
        self._socket.sendto(payload, self._to)

    def close(self):
        self._socket.close()


@pytest.fixture
def port():
    """A port that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def aircraft(start_s):
    return lambda t: [
        (30e3 - 120.0 * (t - start_s), 20e3),
        (-25e3, -28e3 + 150.0 * (t - start_s)),
    ]


@pytest.mark.parametrize("group", [False, True], ids=["unicast", "multicast"])
def test_datagrams_become_scans_and_tracks(domain, port, group):
    host = GROUP if group else "127.0.0.1"
    url = f"udp://{host}:{port}" + ("?interface=127.0.0.1" if group else "")
    preset = read_preset("asterix_cat048")
    table = {**preset.pop("radar_input"), "input_topic": url}
    start_s = math.floor(time.time() % 86400)  # now, so that the day is today's
    sent = traffic(aircraft(start_s), 8, start_s=start_s)
    radar = Radar(host, port)
    with Nodes(
        lambda **o: [*stage_nodes(preset, **o), RadarInputNode(table, **o), Listener(**o)], domain
    ) as nodes:
        node, listener = nodes.nodes[-2:]
        assert nodes.spin_until(lambda: node.count_subscribers("detections") == 2, WAIT_S)
        assert node.health()[1] == f"no message on {url}"
        for count, (_, payload) in enumerate(sent, 1):
            radar.send(payload)
            assert nodes.spin_until(lambda n=count: node.counters["received"] == n, WAIT_S)
        assert nodes.spin_until(lambda: len(listener.tracks) == 7, WAIT_S)
        assert node.health() == (b"\x00", "active")
        assert node.figures()["type"] == "ASTERIX"
    radar.close()
    assert [len(scan.range_m) for scan in listener.detections] == [2] * 7
    assert {scan.sensor_id for scan in listener.detections} == {"sac25_sic201"}
    assert abs(listener.detections[0].stamp_ns * 1e-9 - time.time()) < 120.0
    first = listener.detections[0]
    place = first.attribute_names.index("flight_level")
    assert sorted(first.attribute_values[place]) == [100.0, 101.0]
    last = listener.tracks[-1]
    assert (last.status == 1).sum() == 2
    # Where the aircraft are at the stamp of the scan, East and North.
    turn_s = last.key.stamp_ns * 1e-9 % 86400
    for x, y in aircraft(start_s)(turn_s):
        gap = np.hypot(last.mean[:, 0] - x, last.mean[:, 1] - y)
        assert gap.min() < 100.0


def test_what_is_broken_is_counted_and_the_next_turn_goes_through(domain, port):
    url = f"udp://127.0.0.1:{port}"
    table = {**read_preset("asterix_cat048")["radar_input"], "input_topic": url}
    radar = Radar("127.0.0.1", port)
    start_s = math.floor(time.time() % 86400)
    sent = [payload for _, payload in traffic(aircraft(start_s), 3, start_s=start_s)]
    good = block(48, plot(start_s, 30.0, 1.0))
    bad = [
        b"\x30\x00\x02",
        b"\x30",
        good[:-1],
        block(48, b"\x01\x01\x01\x01\x01"),
        block(62, b"\x80\x01\x02"),
        block(48, plot(start_s)),
        block(48, plot(start_s, 5.0, 1.0, source=(7, 7))),
        bytes(range(256)) * 5,
        b"",
    ]
    with Nodes(lambda **o: [RadarInputNode(table, **o), Listener(**o)], domain) as nodes:
        node, listener = nodes.nodes
        assert nodes.spin_until(lambda: node.count_subscribers("detections") == 1, WAIT_S)
        # The first plot is of the radar that is listened to.
        for payload in (*sent[:10], *bad, *sent[10:]):
            radar.send(payload)
        total = len(sent) + len(bad)
        assert nodes.spin_until(lambda: node.counters["received"] == total, WAIT_S)
        assert nodes.spin_until(lambda: len(listener.detections) == 2, WAIT_S)
        counted = {name: node.counters[name] for name in node.counters if name != "received"}
        assert counted == {
            "malformed_datablock": 4,
            "malformed_records": 1,
            "other_category": 3,  # two in the noise, by chance
            "no_position": 1,
            "other_radar": 1,
        }
    radar.close()
    assert [len(scan.range_m) for scan in listener.detections] == [2, 2]


def test_an_address_that_is_taken_is_said_and_tried_again(domain, port):
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", port))
    table = {"input_topic": f"udp://127.0.0.1:{port}"}
    with Nodes(lambda **o: [RadarInputNode(table, **o)], domain) as nodes:
        (node,) = nodes.nodes
        level, text = node.health()
        assert level == b"\x02"
        assert "Address already in use" in text
        taken.close()
        assert nodes.spin_until(lambda: "no message on udp://" in node.health()[1], WAIT_S)


def test_run_on_an_address(environment, domain, port):
    url = f"udp://127.0.0.1:{port}"
    start_s = math.floor(time.time() % 86400)
    sent = traffic(aircraft(start_s), 8, start_s=start_s)
    radar = Radar("127.0.0.1", port)
    run = start(environment, "run", "--input", url)
    try:
        with Nodes(lambda **o: [Listener(**o)], domain) as nodes:
            (listener,) = nodes.nodes
            assert nodes.spin_until(lambda: listener.count_publishers("tracks") == 1, WAIT_S)
            for _, payload in sent:
                radar.send(payload)
            assert nodes.spin_until(lambda: len(listener.tracks) == 7, WAIT_S)
        assert (listener.tracks[-1].status == 1).sum() == 2
    finally:
        stop(run)
        radar.close()


def test_inspect_an_address(environment, port):
    url = f"udp://127.0.0.1:{port}"
    start_s = math.floor(time.time() % 86400)
    sent = traffic(aircraft(start_s), 5, start_s=start_s)
    radar = Radar("127.0.0.1", port)
    look = subprocess.Popen(
        [sys.executable, "-m", "gda_tracker.cli", "inspect", url, "--wait", "60"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        # Sent again and again: nobody says when it begins to listen.
        for _ in range(600):
            if look.poll() is not None:
                break
            for _, payload in sent:
                radar.send(payload)
            time.sleep(0.2)
        out, err = look.communicate(timeout=30)
    finally:
        look.kill()
        look.wait(30)
        radar.close()
    assert look.returncode == 0, err
    assert f"{url}: asterix cat 048" in out
    assert "preset: asterix_cat048 (by the kind of file)" in out
    assert f"next: gda-tracker run --input {url} --preset asterix_cat048" in out


def test_addresses_that_are_none(environment, port):
    url = f"udp://127.0.0.1:{port}"
    done = command(environment, "inspect", url, "--wait", "0.5")
    assert done.returncode == 2
    assert f"{url}: no datagram within 0.5 s" in done.stderr
    done = command(environment, "run", "--input", "udp://radar:8600")
    assert done.returncode == 2
    assert "allowed is udp://HOST:PORT with an IPv4 address" in done.stderr
