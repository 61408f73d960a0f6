"""The node ``radar_input`` in the graph: clouds in, detections out, bad clouds counted."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest
from gda_tracker_msgs.msg import DetectionArray, TrackArray
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from test_run_and_record import start, stop

from gda_tracker.io.adapters import mmwave
from gda_tracker.io.bag_types import serialize
from gda_tracker.io.messages import detections_from_message, tracks_from_message
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.io.radar.frames import detections_of_frame
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.nodes.qualities import sensor, stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.parameters import from_mapping
from gda_tracker.resources import resource

FIELDS = ("x", "y", "z", "range", "azimuth", "elevation", "doppler", "power")
WAIT_S = 30.0


class Driver(Node):
    """Publishes clouds and keeps what comes of them."""

    def __init__(self, **options):
        super().__init__("driver", **options)
        self.clouds = self.create_publisher(PointCloud2, "points", sensor(10, "best_effort"))
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


@pytest.fixture(scope="module")
def walk():
    """The first 50 frames of the walk."""
    found = {}
    for frame in mmwave.frames(resource("data", "mmwave_walk", "SOT.tar.xz")):
        found.setdefault(frame.stamp_ns, frame)
        if len(found) == 50:
            break
    return list(found.values())


def cloud(frame, stamp_ns=None):
    """The message in which a driver would publish the frame."""
    columns = frame.read(FIELDS, {})
    types = dict.fromkeys(FIELDS, "float32")
    message = point_cloud_of_columns(
        columns, types, frame.stamp_ns if stamp_ns is None else stamp_ns, "radar"
    )
    return deserialize_message(serialize(message), PointCloud2)


def matched(nodes, driver):
    assert nodes.spin_until(
        lambda: (
            driver.clouds.get_subscription_count() > 0 and driver.count_publishers("detections") > 0
        ),
        WAIT_S,
    )


def send(nodes, driver, radar, message):
    """Publish a cloud and wait until the node has had it."""
    before = radar.counters["received"]
    driver.clouds.publish(message)
    assert nodes.spin_until(lambda: radar.counters["received"] > before, WAIT_S)


def test_clouds_become_detections_and_tracks(domain, walk):
    preset = read_preset("mmwave_walk")
    table = preset.pop("radar_input")
    with Nodes(
        lambda **o: [*stage_nodes(preset, **o), RadarInputNode(table, **o), Driver(**o)], domain
    ) as nodes:
        radar, driver = nodes.nodes[-2:]
        matched(nodes, driver)
        for number, frame in enumerate(walk, 1):
            send(nodes, driver, radar, cloud(frame))
            assert nodes.spin_until(lambda n=number: len(driver.tracks) >= n, WAIT_S)
        assert radar.health() == (b"\x00", "active")
        figures = radar.figures()
    parameters = from_mapping(RadarInputParameters, table)
    assert [scan.sequence for scan in driver.detections] == list(range(1, len(walk) + 1))
    for frame, found in zip(walk, driver.detections, strict=True):
        expected = detections_of_frame(frame, parameters).detections
        assert (found.stamp_ns, found.frame_id) == (frame.stamp_ns, "radar")
        # The driver sends float32.
        np.testing.assert_allclose(found.range_m, expected.range_m, rtol=1e-5)
        np.testing.assert_allclose(found.azimuth_rad, expected.azimuth_rad, atol=1e-5)
    assert {int(i) for t in driver.tracks for i in t.track_id[t.status == 1]} == {1}
    assert figures["type"] == "sensor_msgs/msg/PointCloud2"
    assert figures["published"] == len(walk)
    assert figures["standing_still"] > 0.8


def test_bad_clouds_are_counted_and_the_next_good_one_goes_through(domain, walk):
    with Nodes(lambda **o: [RadarInputNode({}, **o), Driver(**o)], domain) as nodes:
        radar, driver = nodes.nodes
        assert radar.health()[1] == "no message on points"
        matched(nodes, driver)
        first, *others = walk
        cut = cloud(first)
        cut.data = cut.data[:-1]
        beyond = cloud(first)
        beyond.fields[0].offset = 1000
        strange = cloud(first)
        for field in strange.fields:
            field.name = f"u_{field.name}"
        no_fields = cloud(first)
        no_fields.fields = []
        odd_type = cloud(first)
        odd_type.fields[0].datatype = 99
        early = cloud(first)
        early.header.stamp.sec = -5
        huge = cloud(first)
        huge.width, huge.height = 2**31, 2**31
        zero = cloud(first, stamp_ns=0)
        for bad in (cut, beyond, strange, no_fields, odd_type, early, huge, zero):
            send(nodes, driver, radar, bad)
        assert radar.health()[1] == "no message on points could be used"
        send(nodes, driver, radar, cloud(first))
        send(nodes, driver, radar, cloud(first))
        send(nodes, driver, radar, cloud(others[1]))
        send(nodes, driver, radar, cloud(others[0]))
        assert nodes.spin_until(lambda: len(driver.detections) == 3, WAIT_S)
        expected = {
            "received": 12,
            "malformed_cloud": 4,
            "fields_do_not_fit": 2,
            "bad_stamp": 1,
            "stamp_unset": 1,
            "stamp_repeated": 1,
            "stamp_stepped_back": 1,
        }
        assert {name: radar.counters[name] for name in expected} == expected
        assert [scan.sequence for scan in driver.detections] == [1, 2, 3]
        assert radar.health()[1] == "active"


def test_parameters_act_at_the_next_scan_or_are_refused(domain, walk):
    with Nodes(
        lambda **o: [RadarInputNode({"azimuth_sign": -1}, **o), Driver(**o)], domain
    ) as nodes:
        radar, driver = nodes.nodes
        matched(nodes, driver)
        changes = [
            ("moving_above_mps", 0.1, lambda a, b: len(b.range_m) < 0.5 * len(a.range_m)),
            ("cluster_distance_m", 0.8, lambda a, b: len(b.range_m) < 0.2 * len(a.range_m)),
            ("azimuth_zero_deg", 90.0, lambda a, b: b.azimuth_rad.min() > 0.5),
            ("moving_above_mps", 50.0, lambda a, b: len(b.range_m) == 0),
        ]
        send(nodes, driver, radar, cloud(walk[0]))
        for number, (name, value, acts) in enumerate(changes, 1):
            (result,) = radar.set_parameters([Parameter(name, value=value)])
            assert result.successful
            send(nodes, driver, radar, cloud(walk[0], walk[0].stamp_ns + number))
            assert nodes.spin_until(lambda n=number: len(driver.detections) == n + 1, WAIT_S)
            assert acts(driver.detections[-2], driver.detections[-1]), name
        for name, value, reason in (
            ("azimuth_sign", 0, "azimuth_sign = 0: allowed is 1 or -1"),
            ("rcs_unit", "dBm", "allowed is one of none, dbsm, m2"),
            ("maximum_range_m", -1.0, "allowed is a number > 0"),
        ):
            (result,) = radar.set_parameters([Parameter(name, value=value)])
            assert not result.successful
            assert reason in result.reason
        assert radar.parameters.moving_above_mps == 50.0


def test_radar_cross_sections_of_no_use_are_in_the_diagnostics(domain, walk):
    settings = {"rcs_unit": "dbsm", "rcs_maximum": 70.0}
    with Nodes(lambda **o: [RadarInputNode(settings, **o), Driver(**o)], domain) as nodes:
        radar, driver = nodes.nodes
        matched(nodes, driver)
        changes = [  # power is 92 to 170 dB, doppler is 0 for most points
            ([], "there is no such field"),
            (["rcs=power"], "no value can be one"),
            (["rcs=doppler"], ""),
        ]
        for number, (names, problem) in enumerate(changes):
            kind = Parameter.Type.STRING_ARRAY
            (result,) = radar.set_parameters([Parameter("field_names", kind, names)])
            assert result.successful, result.reason
            send(nodes, driver, radar, cloud(walk[0], walk[0].stamp_ns + number))
            text = (
                f"radar cross section: {problem}; kinematics decide alone" if problem else "active"
            )
            assert radar.health()[1] == text
        same = point_cloud_of_columns(
            {"x": np.arange(1.0, 21.0), "y": np.ones(20), "rcs": np.full(20, 3.0)},
            dict.fromkeys(("x", "y", "rcs"), "float32"),
            walk[1].stamp_ns,
            "radar",
        )
        (result,) = radar.set_parameters(
            [Parameter("field_names", Parameter.Type.STRING_ARRAY, [])]
        )
        send(nodes, driver, radar, deserialize_message(serialize(same), PointCloud2))
        assert "the same for all points" in radar.health()[1]


def test_without_a_driver_diagnostics_say_so(domain):
    with Nodes(lambda **o: [RadarInputNode({}, **o)], domain) as nodes:
        assert nodes.nodes[0].health() == (b"\x01", "nobody publishes points")


def test_a_topic_that_is_no_radars_is_named(domain):
    class Lidar(Node):
        def __init__(self, **options):
            super().__init__("lidar", **options)
            self.create_publisher(TrackArray, "points", stream())

        def autostart(self):
            pass

    with Nodes(lambda **o: [Lidar(**o), RadarInputNode({}, **o)], domain) as nodes:
        radar = nodes.nodes[1]
        assert nodes.spin_until(
            lambda: "TrackArray: allowed is one of" in radar.health()[1], WAIT_S
        )


@pytest.fixture
def playing(domain, walk):
    """A driver that repeats the walk at 20 Hz, with stamps that go on, in a thread."""
    with Nodes(lambda **o: [Driver(**o)], domain) as nodes:
        (driver,) = nodes.nodes
        sent = [0]

        def publish():
            lap, place = divmod(sent[0], len(walk))
            stamp_ns = walk[place].stamp_ns + lap * 3_000_000_000
            driver.clouds.publish(cloud(walk[place], stamp_ns))
            sent[0] += 1

        driver.create_timer(0.05, publish)
        done = threading.Event()
        thread = threading.Thread(target=nodes.spin_until, args=(done.is_set,))
        thread.start()
        yield driver
        done.set()
        thread.join()


def command(environment, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "gda_tracker.cli", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_inspect_and_run_on_a_live_topic(environment, playing, tmp_path):
    yaml = tmp_path / "radar.yaml"
    done = command(environment, "inspect", "points", "--seconds", "1.5", "--yaml", str(yaml))
    assert done.returncode == 0, done.stderr
    assert "preset: mmwave_walk (8 of 8 fields by name and type)" in done.stdout
    assert f"gda-tracker run --input points --params {yaml}" in done.stdout
    run = start(environment, "run", "--input", "points", "--params", str(yaml))
    try:
        wait_for_a_confirmed_track(playing)
    finally:
        stop(run)


def wait_for_a_confirmed_track(driver):
    moment = threading.Event()
    for _ in range(300):
        if any((tracks.status == 1).any() for tracks in driver.tracks):
            return
        moment.wait(0.1)
    raise AssertionError(f"no confirmed track in {len(driver.tracks)} scans")


def test_run_guesses_the_preset_and_starts_five_processes(environment, playing):
    process = subprocess.Popen(
        [sys.executable, "-m", "gda_tracker.cli", "run", "--processes", "--input", "/points"],
        env={**environment, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        said = [process.stdout.readline() for _ in range(3)]
        assert "preset mmwave_walk, guessed from the fields of /points" in said[1], said
        assert "5 processes, waiting for /points" in said[2]
        wait_for_a_confirmed_track(playing)
    finally:
        stop(process)


def test_a_topic_that_nobody_publishes(environment):
    done = command(environment, "inspect", "/nothing", "--wait", "1")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "no file and no topic /nothing: nobody publishes it in ROS domain" in done.stderr
