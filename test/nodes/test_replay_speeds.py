"""The same bag at 1x, 10x and unthrottled, in one process and in four: the same tracks."""

from __future__ import annotations

import copy
import time

import pytest
from graph_helpers import TIMEOUT_S, differences, offline, play
from test_radar_input import Driver

from gda_tracker.io.adapters import InputOptions, load_recording, mmwave
from gda_tracker.io.bags import BagTopic, BagWriter, read_bag
from gda_tracker.io.launch_plan import DEMO_ARGUMENTS, demo_plan
from gda_tracker.io.parameter_files import RADAR_INPUT, read_preset
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import STAGES, Nodes, RingProcesses, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import of_recording

FIELDS = ("x", "y", "z", "range", "azimuth", "elevation", "doppler", "power")
FRAMES = 25
# Clouds of no points before the first frame, at most.
EMPTY = 100
PRESET = "mmwave_walk"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The first frames of the walk as a driver would publish them; some seconds."""
    path = tmp_path_factory.mktemp("walk") / "bag"
    frames = {}
    for frame in mmwave.frames(resource("data", "mmwave_walk", "SOT.tar.xz")):
        frames.setdefault(frame.stamp_ns, frame)
        if len(frames) == FRAMES:
            break
    with BagWriter(path, [BagTopic("points", "sensor_msgs/msg/PointCloud2")]) as writer:
        for stamp_ns, frame in frames.items():
            types = dict.fromkeys(FIELDS, "float32")
            cloud = point_cloud_of_columns(frame.read(FIELDS, {}), types, stamp_ns, "radar")
            writer.write("points", cloud, stamp_ns)
    return path


@pytest.fixture(scope="module")
def expected(bag):
    """What to play, the parameters of the ring, and the tracks without ROS."""
    recording = load_recording(bag, "auto", InputOptions(None, PRESET, None))
    parameters = {k: v for k, v in read_preset(PRESET).items() if k != RADAR_INPUT}
    plays = [of_recording(recording)]
    tracks = offline(plays, parameters)
    assert len(tracks) == FRAMES
    assert any((one.status == 1).any() for one in tracks.values())
    return plays, parameters, tracks


@pytest.mark.parametrize("processes", [1, 4])
@pytest.mark.parametrize("rate", [1.0, 10.0, 0.0])
def test_a_recording_at_any_speed(rate, processes, environment, expected):
    plays, parameters, wanted = expected
    domain = int(environment["ROS_DOMAIN_ID"])
    began = time.monotonic()

    def source(**options):
        return ScanSourceNode({"rate": rate}, plays=plays, collect=True, **options)

    if processes == 1:
        with Nodes(lambda **o: [source(**o), *stage_nodes(parameters, **o)], domain) as nodes:
            played = play(nodes, nodes.nodes[0])
    else:
        with (
            RingProcesses(parameters, environment) as ring,
            Nodes(lambda **o: [source(**o)], domain) as nodes,
        ):
            played = play(nodes, nodes.nodes[0], ring)
    assert differences(played.tracks, wanted) == []
    stamps = [scan.stamp_ns for scan in plays[0].detections]
    lasts = 1e-9 * (stamps[-1] - stamps[0])
    assert lasts > 1.0
    if rate:
        assert time.monotonic() - began >= lasts / rate


def without_points(cloud, stamp_ns):
    """The cloud at another time, empty."""
    empty = copy.deepcopy(cloud)
    empty.header.stamp.sec, empty.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    empty.width, empty.row_step = 0, 0
    empty.data = b""
    return empty


@pytest.mark.parametrize(("rate", "processes"), [(1.0, 1), (10.0, 1), (10.0, 5)])
def test_a_radars_topic_at_any_speed(rate, processes, environment, bag, expected):
    """Open loop: the clouds come at their time, whether the tracker is ready or not."""
    _, parameters, wanted = expected
    domain = int(environment["ROS_DOMAIN_ID"])
    radar = read_preset(PRESET)[RADAR_INPUT]
    clouds = [(record.stamp_ns, record.ros_message()) for record in read_bag(bag)]

    def spin(nodes, driver):
        assert nodes.spin_until(
            lambda: (
                driver.clouds.get_subscription_count() == 1
                and driver.count_publishers("detections") == 1
                and driver.count_subscribers("detections") == 2
                and driver.count_publishers("tracks") == 1
            ),
            TIMEOUT_S,
        )
        first = clouds[0][0]
        # Whether processes hear each other only they know: empty clouds before the first one, until
        # one has been answered.
        for number in range(EMPTY, 0, -1):
            driver.clouds.publish(without_points(clouds[0][1], first - number * 10**8))
            nodes.spin_until(lambda: bool(driver.tracks), 1.0)
            if driver.tracks:
                break
        assert nodes.spin_until(lambda: bool(driver.tracks), TIMEOUT_S)
        begun = time.monotonic()
        for stamp_ns, cloud in clouds:
            due = begun + 1e-9 * (stamp_ns - first) / rate
            nodes.spin_until(lambda due=due: time.monotonic() >= due)
            driver.clouds.publish(cloud)

        def answered():
            return [tracks for tracks in driver.tracks if tracks.key.stamp_ns >= first]

        assert nodes.spin_until(lambda: len(answered()) == FRAMES, TIMEOUT_S)
        return {(tracks.key.sensor_id, tracks.key.stamp_ns): tracks for tracks in answered()}

    if processes == 1:
        with Nodes(
            lambda **o: [*stage_nodes(parameters, **o), RadarInputNode(radar, **o), Driver(**o)],
            domain,
        ) as nodes:
            found = spin(nodes, nodes.nodes[-1])
    else:
        with (
            RingProcesses(
                {**parameters, RADAR_INPUT: radar}, environment, stages=(*STAGES, RADAR_INPUT)
            ),
            Nodes(lambda **o: [Driver(**o)], domain) as nodes,
        ):
            found = spin(nodes, nodes.nodes[0])
    assert differences(found, wanted) == []


def test_the_plan_of_the_demo_runs_to_its_end(environment):
    values = {argument.name: argument.default for argument in DEMO_ARGUMENTS}
    plan = demo_plan({**values, "rate": "0", "method": "map/bayes/cv"}, environment)
    parameters = {node.executable: node.parameters[0] for node in plan.nodes if node.parameters}
    stages = [node.executable for node in plan.nodes]
    with RingProcesses(parameters, environment, stages=stages) as ring:
        assert ring.processes["scan_source"].wait(TIMEOUT_S) == 0
        assert all(ring.processes[stage].poll() is None for stage in STAGES)
