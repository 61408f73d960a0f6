"""RViz, Foxglove and PlotJuggler: the files are what the programs read and name what there is.

None of the programs runs here: every topic is held against those that the suite publishes, with
their types, and every path of fields against the definitions of the messages.
"""

import inspect
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from gda_tracker.io.bag_types import type_store
from gda_tracker.io.launch_plan import TRACKER_ARGUMENTS, demo_plan, tracker_plan
from gda_tracker.io.markers.parameters import LAYERS, MARKER_ARRAY, marker_topic
from gda_tracker.nodes.figures import FusionFigures, Recent, TrackingFigures
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.recorder import TOPICS, TOPICS_BESIDE
from gda_tracker.nodes.track_manager import TrackManagerNode
from gda_tracker.parameters import specifications
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import STAGE_TABLES, Ring

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
NUMBERS = (
    "float32",
    "float64",
    "bool",
    *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)),
)


def published():
    """Type of each topic of the suite, by its name without a namespace."""
    found = {}
    for topic, (message, _) in {**TOPICS, **TOPICS_BESIDE}.items():
        kind = f"{message.__module__.split('.')[0]}/msg/{message.__name__}"
        found["/" + topic.lstrip("/")] = kind
    return {**found, **{f"/{marker_topic(layer)}": MARKER_ARRAY for layer in LAYERS}}


def field_kind(kind, steps):
    """Type at the end of a path: ``("tracks", "[]", "state", "[]")``.

    Raises ``KeyError`` or ``AssertionError`` where the definitions know no such path.
    """
    found = (1, kind)  # of rosbags: 1 base, 2 message, 3 array, 4 sequence
    name = kind
    for step in steps:
        if step == "[]":
            assert int(found[0]) in (3, 4), f"{name} is no array"
            found = found[1][0]
        else:
            fields = dict(type_store().fielddefs[name][1])
            found = fields[step]
        name = found[1] if int(found[0]) == 2 else found[1][0]
    assert int(found[0]) == 1, f"{kind}: {steps} is no single value"
    return name


def test_the_check_of_paths_finds_wrong_ones():
    array = "gda_tracker_msgs/msg/TrackArray"
    assert field_kind(array, ("tracks", "[]", "state", "[]")) == "float64"
    for wrong in (("track", "[]", "state", "[]"), ("tracks", "state"), ("tracks", "[]", "speed")):
        with pytest.raises((KeyError, AssertionError)):
            field_kind(array, wrong)
    with pytest.raises(AssertionError):
        field_kind(array, ("tracks", "[]", "state"))


# --- RViz -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load((LAUNCH / "tracker.rviz").read_text())


def test_rviz_shows_every_layer_once_with_the_quality_it_is_published_with(rviz):
    manager = rviz["Visualization Manager"]
    displays = [d for d in manager["Displays"] if d["Class"] == "rviz_default_plugins/MarkerArray"]
    topics = published()
    assert [d["Topic"]["Value"] for d in displays] == [f"/{marker_topic(n)}" for n in LAYERS]
    assert {topics[d["Topic"]["Value"]] for d in displays} == {MARKER_ARRAY}
    assert all(d["Enabled"] is True and d["Value"] is True for d in displays)
    assert len({d["Name"] for d in manager["Displays"]}) == len(LAYERS) + 1
    quality = stream()
    assert quality.reliability == ReliabilityPolicy.RELIABLE
    assert quality.durability == DurabilityPolicy.VOLATILE
    for display in displays:
        assert display["Topic"]["Reliability Policy"] == "Reliable"
        assert display["Topic"]["Durability Policy"] == "Volatile"
        assert display["Topic"]["History Policy"] == "Keep Last"
        assert display["Namespaces"] == {}


def test_rviz_knows_all_that_it_loads(rviz):
    manager = rviz["Visualization Manager"]
    frame = specifications(STAGE_TABLES["track_manager"])["tracking_frame"].default
    assert manager["Global Options"]["Fixed Frame"] == frame
    assert set(rviz) == {"Panels", "Visualization Manager", "Window Geometry"}
    classes = [p["Class"] for p in rviz["Panels"]]
    assert set(classes) <= {
        f"rviz_common/{name}"
        for name in ("Displays", "Selection", "Tool Properties", "Views", "Time")
    }
    names = {"Grid", "MarkerArray", "Interact", "MoveCamera", "Select", "FocusCamera", "Measure"}
    for item in (*manager["Displays"], *manager["Tools"]):
        package, name = item["Class"].split("/")
        assert package == "rviz_default_plugins"
        assert name in names
    assert manager["Views"]["Current"]["Class"] == "rviz_default_plugins/TopDownOrtho"
    assert manager["Transformation"]["Current"]["Class"] == "rviz_default_plugins/TF"


def test_launch_starts_rviz_with_this_file_and_the_markers_it_shows():
    values = {a.name: a.default for a in TRACKER_ARGUMENTS}
    plan = tracker_plan({**values, "rviz": "true", "namespace": "front", "bag": "drive"}, {})
    nodes = {node.executable: node for node in plan.nodes}
    assert nodes["markers"].parameters[-1]["use_sim_time"] is True
    command = plan.programs[0]
    assert command[:2] == ["rviz2", "-d"]
    assert Path(command[2]) == LAUNCH / "tracker.rviz"
    assert "use_sim_time:=true" in command
    rules = [rule for rule in command if rule.startswith("/markers/")]
    assert rules == [f"/{marker_topic(n)}:=/front/{marker_topic(n)}" for n in LAYERS]
    (one,) = tracker_plan({**values, "markers": "true", "processes": "one"}, {}).programs
    assert one[-1] == "--markers"
    record = tracker_plan({**values, "markers": "true", "record": "out"}, {}).nodes[-1]
    assert record.parameters[0]["also"] == [f"{marker_topic(n)}={MARKER_ARRAY}" for n in LAYERS]
    assert "markers" not in {n.executable for n in tracker_plan(values, {}).nodes}
    demo = {"input": "crossing_targets", "method": "default", "rate": "1", "namespace": ""}
    demo_nodes = demo_plan({**demo, "record": "", "rviz": "true"}, {}).nodes
    assert "markers" in {node.executable for node in demo_nodes}


# --- Foxglove -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def foxglove():
    return json.loads((LAUNCH / "foxglove.json").read_text())


def panels_of(layout):
    """Panels of a layout: a tree of splits, its leaves names of panels."""
    if isinstance(layout, str):
        return [layout]
    assert set(layout) == {"first", "second", "direction", "splitPercentage"}
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    return [*panels_of(layout["first"]), *panels_of(layout["second"])]


def test_foxglove_has_a_configuration_for_every_panel(foxglove):
    assert {"configById", "layout", "globalVariables", "userNodes", "playbackConfig"} == set(
        foxglove
    )
    panels = panels_of(foxglove["layout"])
    assert sorted(panels) == sorted(foxglove["configById"])
    kinds = {panel.split("!")[0] for panel in panels}
    assert kinds == {"3D", "Plot", "DiagnosticSummary", "DiagnosticStatusPanel"}
    assert all(re.fullmatch(r"\w+!\w+", panel) for panel in panels)


def foxglove_path(text, variables):
    """Topic and steps of a message path; filters are fields of what they stand behind."""
    topic, rest = re.fullmatch(r"((?:/\w+)+)(.*)", text).groups()
    steps, filters = [], []
    pattern = r"\.(\w+)|\[(-?\d+|:)\]|\{(\w+)==(\$?\w+)\}"
    end = 0
    for match in re.finditer(pattern, rest):
        assert match.start() == end, text
        end = match.end()
        name, index, field, value = match.groups()
        if field:
            filters.append((*steps, field))
            assert not value.startswith("$") or value[1:] in variables, value
        else:
            steps.append(name or "[]")
    assert end == len(rest), text
    return topic, tuple(steps), filters


def test_foxglove_names_topics_and_fields_that_there_are(foxglove):
    topics, variables = published(), foxglove["globalVariables"]
    count = 0
    for panel, content in foxglove["configById"].items():
        if panel.startswith("3D!"):
            assert set(content["topics"]) == {f"/{marker_topic(n)}" for n in LAYERS}
            assert {topics[name] for name in content["topics"]} == {MARKER_ARRAY}
            assert all(item["visible"] for item in content["topics"].values())
            frame = specifications(STAGE_TABLES["track_manager"])["tracking_frame"].default
            assert content["followTf"] == frame
        elif panel.startswith("Plot!"):
            for item in content["paths"]:
                topic, steps, filters = foxglove_path(item["value"], variables)
                assert field_kind(topics[topic], steps) in NUMBERS
                for path in filters:
                    assert field_kind(topics[topic], path) in NUMBERS
                # A stamp of the header is used: there has to be one.
                assert item["timestampMethod"] == "headerStamp"
                assert field_kind(topics[topic], ("header", "frame_id")) == "string"
                count += 1
        else:
            assert topics[content["topicToRender"]] == "diagnostic_msgs/msg/DiagnosticArray"
    assert count >= 12
    plots = {p for p in foxglove["configById"] if p.startswith("Plot!")}
    assert {"Plot!latency", "Plot!counts", "Plot!classes"} <= plots


def test_foxglove_selects_the_diagnostics_that_the_nodes_publish(foxglove):
    status = foxglove["configById"]["DiagnosticStatusPanel!manager"]
    summary = foxglove["configById"]["DiagnosticSummary!nodes"]
    source = inspect.getsource(inspect.getmodule(TrackManagerNode.__mro__[1]))
    assert f'hardware_id="{status["selectedHardwareId"]}"' in source
    assert summary["hardwareIdFilter"] == status["selectedHardwareId"]
    assert "name=self.get_fully_qualified_name()" in source
    assert status["selectedName"] == "/track_manager"


# --- PlotJuggler ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plotjuggler():
    return ElementTree.parse(LAUNCH / "plotjuggler.xml").getroot()


def test_plotjuggler_reads_the_structure(plotjuggler):
    assert plotjuggler.tag == "root"
    (tabs,) = plotjuggler.findall("tabbed_widget")
    assert tabs.get("parent") == "main_window"
    assert len(tabs.findall("Tab")) >= 3
    for tab in tabs.findall("Tab"):
        assert tab.get("tab_name")
        containers = tab.findall("Container")
        assert len(containers) == int(tab.get("containers")) == 1
        for splitter in tab.iter("DockSplitter"):
            children = list(splitter)
            assert {child.tag for child in children} <= {"DockArea", "DockSplitter"}
            assert int(splitter.get("count")) == len(children)
            assert splitter.get("orientation") in ("-", "|")
            sizes = [float(size) for size in splitter.get("sizes").split(";")]
            assert len(sizes) == len(children)
            assert sum(sizes) == pytest.approx(1.0, abs=1e-4)
        for area in tab.iter("DockArea"):
            (plot,) = area.findall("plot")
            assert plot.get("mode") == "TimeSeries"
            assert plot.findall("range")
            assert plot.findall("curve")
    assert plotjuggler.find("previouslyLoaded_Streamer").get("name") == "ROS2 Topic Subscriber"


def series_kind(name, topics):
    """Type of a series of PlotJuggler: ``/topic/field[3]/field``."""
    topic = next(t for t in sorted(topics, key=len, reverse=True) if name.startswith(t + "/"))
    steps = []
    for part in name.removeprefix(topic + "/").split("/"):
        field, index = re.fullmatch(r"(\w+)((?:\[\d+\])?)", part).groups()
        steps += [field, *(["[]"] if index else [])]
    return field_kind(topics[topic], tuple(steps))


def diagnostics_series():
    """Names that PlotJuggler gives to figures: /diagnostics/hardware_id/name of the node/key."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, 3, "map/bayes/cv")
    ring = Ring(with_method(tracker_preset(scenario), "map/bayes/cv"))
    ring.initialise(play.initial)
    tracking, fusion, latency = TrackingFigures(), FusionFigures(), Recent()
    latency.note(0.1)
    for detections in play.detections[:5]:
        result = ring.process(detections)
        leading = result.predictions.hypothesis_id > 0
        tracking.note(result.scan, result.predictions, leading, result.associations, result.tracks)
        fusion.note(result.scores)
    own = {**tracking.values(), **latency.milliseconds("latency")}
    assert '"rate_hz"' in inspect.getsource(TrackManagerNode.figures)
    return {
        *(f"/diagnostics/gda_tracker//track_manager/{key}" for key in (*own, "rate_hz")),
        *(f"/diagnostics/gda_tracker//attribute_fusion/{key}" for key in fusion.values()),
    }


def test_plotjuggler_names_series_that_there_are(plotjuggler):
    topics, of_diagnostics = published(), diagnostics_series()
    snippets = {item.get("name"): item for item in plotjuggler.iter("snippet")}
    curves = [curve.get("name") for curve in plotjuggler.iter("curve")]
    for name in curves:
        if name in snippets:
            continue
        if name.startswith("/diagnostics/"):
            assert name in of_diagnostics
        else:
            assert series_kind(name, topics) in NUMBERS
    assert set(snippets) <= set(curves)
    for snippet in snippets.values():
        sources = [snippet.findtext("linked_source")]
        sources += [item.text for item in snippet.find("additional_sources")]
        assert [item.tag for item in snippet.find("additional_sources")] == ["v1"]
        assert all(series_kind(name, topics) == "float64" for name in sources)
        # The speed of a state x, y, vx, vy.
        assert [name.rsplit("/", 1)[1] for name in sources] == ["state[2]", "state[3]"]
        assert snippet.findtext("function") == "return math.sqrt(value^2 + v1^2)"
    wanted = ("speed of", "class_probability", "latency", "conflict")
    assert all(any(word in name for name in curves) for word in wanted)
