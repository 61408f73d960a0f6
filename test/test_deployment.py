"""Launch files, Dockerfile and manifests: they name what there is, and describe the right nodes."""

import argparse
import ast
import fnmatch
import importlib.util
import os
import re
import sys
import types
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from gda_tracker.commands import run
from gda_tracker.commands.run_nodes import what_runs
from gda_tracker.errors import UserError
from gda_tracker.io.launch_plan import (
    DEMO_ARGUMENTS,
    FUSION_ARGUMENTS,
    OUTPUTS,
    TRACKER_ARGUMENTS,
    demo_plan,
    fusion_plan,
    tracker_plan,
)
from gda_tracker.io.parameter_files import check_parameters, known_tables

ROOT = Path(__file__).resolve().parent.parent
STAGES = ["track_manager", "rcs_fuzzifier", "attribute_fusion", "association"]


def tracker(environment=None, **values):
    defaults = {a.name: a.default for a in TRACKER_ARGUMENTS}
    assert set(values) <= set(defaults)
    return tracker_plan({**defaults, **values}, environment or {})


def demo(**values):
    return demo_plan({**{a.name: a.default for a in DEMO_ARGUMENTS}, **values}, {})


def fusion(**values):
    return fusion_plan({**{a.name: a.default for a in FUSION_ARGUMENTS}, **values}, {})


# --- plans ----------------------------------------------------------------------------------------


def test_without_arguments_the_four_nodes_start_and_read_detections():
    plan = tracker()
    assert [node.executable for node in plan.nodes] == STAGES
    assert all(
        n.parameters == [{"use_sim_time": False, "autostart": True}] and n.respawn
        for n in plan.nodes
    )
    assert plan.programs == []
    assert Path(plan.environment["FASTDDS_DEFAULT_PROFILES_FILE"]).is_file()
    own = {"FASTRTPS_DEFAULT_PROFILES_FILE": "mine.xml"}
    assert tracker(own).environment == {}


def test_a_radars_topic_with_preset_parameters_outputs_and_a_record(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**/track_manager:\n  ros__parameters:\n    decision: map\n")
    plan = tracker(
        topic="/radar/points",
        preset="continental_ars548",
        params=str(file),
        namespace="/front/",
        outputs="tracked_objects, radar_tracks",
        record="out",
        use_sim_time="true",
        autostart="false",
    )
    assert plan.namespace == "front"
    *nodes, radar, output, recorder = plan.nodes
    assert [node.executable for node in nodes] == STAGES
    preset, params, values = radar.parameters
    assert Path(preset) == ROOT / "params" / "presets" / "continental_ars548.yaml"
    assert params == str(file)
    assert values == {"input_topic": "/radar/points", "use_sim_time": True, "autostart": False}
    assert output.parameters[-1]["tracked_objects"] == "tracked_objects"
    assert "detections_3d" not in output.parameters[-1]
    assert (recorder.executable, recorder.respawn) == ("recorder", False)
    assert recorder.parameters[0]["also"] == [
        "tracked_objects=autoware_perception_msgs/msg/TrackedObjects",
        "radar_tracks=radar_msgs/msg/RadarTracks",
    ]


def test_a_bag_brings_its_clock_unless_told_otherwise():
    plan = tracker(bag="drive", rviz="true")
    assert plan.nodes[0].parameters == [{"use_sim_time": True, "autostart": True}]
    assert plan.programs[-1] == ["ros2", "bag", "play", "drive", "--clock"]
    assert plan.programs[0][0] == "rviz2"
    assert tracker(bag="drive", use_sim_time="false").programs[-1][-1] == "drive"


def test_one_process_is_the_command_run_with_options_that_it_knows():
    plan = tracker(
        processes="one",
        topic="points",
        preset="altos",
        namespace="a",
        record="out",
        outputs="radar_tracks",
        use_sim_time="true",
    )
    assert plan.nodes == []
    (command,) = plan.programs
    assert command[:2] == ["gda-tracker", "run"]
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    args = parser.parse_args(command[2:])
    assert (args.input, args.preset, args.namespace, args.bag) == ("points", "altos", "a", "out")
    assert (args.output, args.use_sim_time) == (["radar_tracks"], True)
    assert run.OUTPUTS == OUTPUTS


def test_run_gives_input_and_output_the_parameters_of_the_file(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "/**/track_manager:\n  ros__parameters:\n    tracking_frame: odom\n"
        "/**/radar_input:\n  ros__parameters:\n    pose_source: tf\n"
        "/**/track_output:\n  ros__parameters:\n    autoware_classes: [cargo=TRUCK]\n"
    )
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    words = ["--input", "points", "--params", str(file)]
    plain = run._parameters(parser.parse_args(words))
    assert plain["radar_input"] == {
        "pose_source": "tf",
        "input_topic": "points",
        "tracking_frame": "odom",
    }
    assert "track_output" not in plain
    found = run._parameters(parser.parse_args([*words, "--output", "tracked_objects"]))
    assert found["track_output"] == {
        "autoware_classes": ["cargo=TRUCK"],
        "tracked_objects": "tracked_objects",
    }
    assert what_runs(found) == "four nodes and the radar input and the track output"


def test_run_gives_the_markers_their_parameters(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**/markers:\n  ros__parameters:\n    scale: 20.0\n")
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    assert "markers" not in run._parameters(parser.parse_args(["--params", str(file)]))
    found = run._parameters(parser.parse_args(["--params", str(file), "--markers"]))
    assert found["markers"] == {"scale": 20.0}
    assert what_runs(found) == "four nodes and the markers"


def test_events_are_started_with_their_file_which_is_read_first(tmp_path):
    file = tmp_path / "lanes.yaml"
    file.write_text("lanes: []\n")
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    assert "track_events" not in run._parameters(parser.parse_args([]))
    assert run._parameters(parser.parse_args(["--events"]))["track_events"] == {}
    found = run._parameters(parser.parse_args(["--events", str(file)]))
    assert found["track_events"] == {"context_file": str(file)}
    assert what_runs(found) == "four nodes and the events"
    values = {a.name: a.default for a in TRACKER_ARGUMENTS}
    for given, own, words in (
        ("true", {}, ["--events"]),
        (str(file), {"context_file": str(file)}, ["--events", str(file)]),
    ):
        node = tracker_plan({**values, "events": given}, {}).nodes[-1]
        assert node.executable == "track_events"
        assert {k: v for k, v in node.parameters[-1].items() if k in ("context_file",)} == own
        (one,) = tracker_plan({**values, "events": given, "processes": "one"}, {}).programs
        assert one[-len(words) :] == words
    assert "track_events" not in {n.executable for n in tracker_plan(values, {}).nodes}
    file.write_text("lanes: 5\n")
    with pytest.raises(UserError, match="lanes = 5: allowed is a list"):
        run._parameters(parser.parse_args(["--events", str(file)]))
    with pytest.raises(UserError, match="lanes = 5: allowed is a list"):
        tracker_plan({**values, "events": str(file)}, {})


def test_formations_are_started_with_the_parameters_of_the_file(tmp_path):
    file = tmp_path / "params.yaml"
    file.write_text("/**/track_formations:\n  ros__parameters:\n    largest_number: 4\n")
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    assert "track_formations" not in run._parameters(parser.parse_args([]))
    found = run._parameters(parser.parse_args(["--formations", "--params", str(file)]))
    assert found["track_formations"] == {"largest_number": 4}
    assert what_runs(found) == "four nodes and the formations"
    values = {a.name: a.default for a in TRACKER_ARGUMENTS}
    plan = tracker_plan({**values, "formations": "true"}, {})
    assert plan.nodes[-1].executable == "track_formations"
    (one,) = tracker_plan({**values, "formations": "true", "processes": "one"}, {}).programs
    assert "--formations" in one
    assert "track_formations" not in {n.executable for n in tracker_plan(values, {}).nodes}


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"preset": "nothing"}, "preset 'nothing': allowed is one of altos"),
        ({"outputs": "lidar"}, "outputs:=lidar: allowed is one of radar_tracks"),
        ({"processes": "two"}, "processes:=two: allowed is one of four, one"),
        ({"rviz": "maybe"}, "rviz:=maybe: allowed is true or false"),
        ({"processes": "one", "autostart": "false"}, "allowed with processes:=four only"),
        ({"params": "/nowhere.yaml"}, "/nowhere.yaml"),
    ],
)
def test_what_is_not_allowed_is_one_line(values, text):
    with pytest.raises(UserError) as caught:
        tracker(**values)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_demo_plays_a_scenario_with_the_parameters_for_it():
    plan = demo(method="gda/dsm_classic/cv", rate="0")
    assert [node.executable for node in plan.nodes] == [*STAGES, "scan_source"]
    content = {n.executable: {"ros__parameters": p} for n in plan.nodes[:4] for p in n.parameters}
    checked = check_parameters(content, known_tables(), "demo")
    assert checked["track_manager"]["decision"] == "gda"
    assert plan.nodes[-1].parameters == [
        {"input": "crossing_targets", "method": "gda/dsm_classic/cv", "rate": 0.0}
    ]
    assert not any(v == [] for n in plan.nodes for p in n.parameters for v in p.values())
    for values in ({"rate": "fast"}, {"method": "x/y/z"}, {"input": "no_such_scenario"}):
        with pytest.raises(UserError):
            demo(**values)


def test_fusion_starts_a_ring_for_each_radar_and_the_node_that_fuses(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "/**/track_manager:\n  ros__parameters:\n    decision: map\n"
        "/**/track_fusion:\n  ros__parameters:\n    bias_std_m: [0.0, -1.0]\n"
    )
    plan = fusion(
        radars="north, /south/", topics="/n/points,/s/points", presets="altos", params=str(file)
    )
    names = [(node.namespace, node.executable) for node in plan.nodes]
    rings = [*STAGES, "radar_input"]
    assert names == [
        *(("north", name) for name in rings),
        *(("south", name) for name in rings),
        (None, "track_fusion"),
    ]
    preset, params, values = plan.nodes[-2].parameters
    assert Path(preset).name == "altos.yaml"
    assert params == str(file)
    assert values == {"input_topic": "/s/points", "use_sim_time": False}
    assert plan.nodes[-1].parameters == [
        str(file), {"radars": ["north", "south"], "use_sim_time": False}
    ]  # fmt: skip
    # One file for all: a ring alone leaves out what is of the fusion.
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    assert "track_fusion" not in run._parameters(parser.parse_args(["--params", str(file)]))
    plain = fusion()
    assert [n.executable for n in plain.nodes] == [*STAGES, *STAGES, "track_fusion"]
    assert [n.executable for n in fusion(rings="false").nodes] == ["track_fusion"]
    for wrong, text in (
        ({"radars": "one"}, "radars:=one: allowed are 2 or more names that differ"),
        ({"topics": "a"}, "topics:=a: allowed are 0 or 2 entries"),
        ({"presets": "a,b,c"}, "presets:=a,b,c: allowed are 0 or 1 or 2 entries"),
        ({"presets": "nothing"}, "preset 'nothing'"),
    ):
        with pytest.raises(UserError) as caught:
            fusion(**wrong)
        assert text in str(caught.value)


# --- launch files, with stand-ins for the packages of launch --------------------------------------


@dataclass
class Argument:
    name: str
    default_value: str = ""
    description: str = ""


@dataclass
class Function:
    function: object


@dataclass
class Variable:
    name: str
    value: str


@dataclass
class Process:
    cmd: list
    output: str = "log"


@dataclass
class Lifecycle:
    package: str
    executable: str
    name: str
    namespace: str
    parameters: list = field(default_factory=list)
    output: str = "log"
    respawn: bool = False


class Configuration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context[self.name]


@pytest.fixture
def launch_packages(monkeypatch):
    """As much of launch, launch_ros and ament_index_python as the files use."""
    content = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": Argument,
            "ExecuteProcess": Process,
            "OpaqueFunction": Function,
            "SetEnvironmentVariable": Variable,
        },
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"LifecycleNode": Lifecycle},
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_prefix": lambda name: f"/ws/{name}"},
    }
    for name, values in content.items():
        module = types.ModuleType(name)
        module.__dict__.update(values)
        monkeypatch.setitem(sys.modules, name, module)


def describe(name, **values):
    """Load a launch file, give it arguments, return what it starts."""
    specification = importlib.util.spec_from_file_location("launched", ROOT / "launch" / name)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    *arguments, function = module.generate_launch_description()
    defaults = {argument.name: argument.default_value for argument in arguments}
    assert all(argument.description for argument in arguments)
    assert set(values) <= set(defaults)
    return function.function({**defaults, **values})


def test_the_launch_files_are_these():
    assert sorted(p.name for p in (ROOT / "launch").glob("*.py")) == [
        "demo.launch.py",
        "fusion.launch.py",
        "tracker.launch.py",
    ]


def test_tracker_launch_starts_what_is_planned(launch_packages, monkeypatch):
    for name in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(name, raising=False)
    actions = describe("tracker.launch.py", topic="points", namespace="front", bag="drive")
    kinds = [type(action).__name__ for action in actions]
    assert kinds == ["Variable"] * 2 + ["Lifecycle"] * 5 + ["Process"]
    nodes = actions[2:7]
    assert [node.name for node in nodes] == [*STAGES, "radar_input"]
    assert {(node.package, node.namespace) for node in nodes} == {("gda_tracker", "front")}
    assert actions[-1].cmd[0] == "ros2"
    (program,) = describe("tracker.launch.py", processes="one")[2:]
    assert program.cmd == ["/ws/gda_tracker/lib/gda_tracker/gda-tracker", "run"]


def test_demo_launch_starts_what_is_planned(launch_packages):
    names = [a.name for a in describe("demo.launch.py", record="out") if type(a) is Lifecycle]
    assert names == [*STAGES, "scan_source", "recorder"]


def test_fusion_launch_puts_each_ring_into_its_namespace(launch_packages):
    nodes = [a for a in describe("fusion.launch.py", topics="a,b") if type(a) is Lifecycle]
    assert [(node.namespace, node.name) for node in nodes[4:6]] == [
        ("radar_1", "radar_input"),
        ("radar_2", "track_manager"),
    ]
    assert (nodes[-1].namespace, nodes[-1].name) == ("", "track_fusion")


def test_every_executable_of_the_plans_is_installed():
    scripts = re.findall(r'^    "(\w+)",$', (ROOT / "setup.py").read_text(), re.MULTILINE)
    plan = tracker(topic="points", outputs="radar_tracks", record="out")
    nodes = (*plan.nodes, *demo().nodes, *fusion().nodes)
    assert {node.executable for node in nodes} <= set(scripts)


# --- manifests and container ----------------------------------------------------------------------


def imported_packages():
    """Top-level packages that the nodes and launch files import."""
    found = set()
    for path in [*(ROOT / "gda_tracker").rglob("*.py"), *(ROOT / "launch").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found |= {name.split(".")[0] for name in names if name}
    return found


def test_package_xml_names_every_ros_package_that_is_imported():
    manifest = ElementTree.parse(ROOT / "package.xml")
    declared = {item.text for item in manifest.iter("exec_depend")}
    ros = {
        name
        for name in imported_packages()
        if name.endswith(("_msgs", "_srvs", "_interfaces", "_ros"))
        or name in ("rclpy", "launch", "ament_index_python")
    }
    assert {"rclpy", "std_srvs", "launch_ros", "rcl_interfaces"} <= ros
    assert ros <= declared
    assert "tf2_msgs" in declared  # imported by name
    assert {"python3-numpy", "python3-scipy", "python3-yaml"} <= declared


def dockerfile():
    """Instructions of the Dockerfile, continued lines joined."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)
    lines = re.sub(r"\\\n", " ", text).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line.strip()]


def test_the_dockerfile_copies_what_exists_and_is_not_ignored():
    ignored = (ROOT / ".dockerignore").read_text().split()
    copied = set()
    for instruction, rest in dockerfile():
        if instruction != "COPY":
            continue
        *sources, _ = rest.split()
        for source in sources:
            assert (ROOT / source).exists(), source
            top = source.split("/")[0]
            assert not any(fnmatch.fnmatch(top, pattern) for pattern in ignored), source
            copied.add(source)
    # What setup.py reads and installs.
    assert {
        "setup.py",
        "setup.cfg",
        "resource",
        "params",
        "launch",
        "data",
        "msg_schemas",
    } <= copied
    assert {"gda_tracker", "package.xml", "docker/entrypoint.sh"} <= copied


def test_the_container_starts_the_tracker_on_jazzy():
    instructions = dockerfile()
    assert instructions[0] == ("FROM", "ros:jazzy-ros-base")
    values = dict(instructions)
    assert yaml.safe_load(values["ENTRYPOINT"]) == ["/entrypoint.sh"]
    *_, package, launch = yaml.safe_load(values["CMD"])
    assert (package, (ROOT / "launch" / launch).is_file()) == ("gda_tracker", True)
    assert os.access(ROOT / "docker" / "entrypoint.sh", os.X_OK)
    for instruction, rest in instructions:
        if instruction == "RUN" and "apt-get install" in rest:
            assert "--no-install-recommends" in rest
        if instruction == "RUN" and "apt-get update" in rest:
            assert rest.rstrip().endswith("rm -rf /var/lib/apt/lists/*")
    build = next(rest for name, rest in instructions if name == "RUN" and "colcon build" in rest)
    assert "--base-paths src/gda_tracker src/gda_tracker/msg_schemas" in build
    readme = (ROOT / "README.md").read_text()
    assert "colcon build --base-paths src/gda_tracker src/gda_tracker/msg_schemas" in readme
