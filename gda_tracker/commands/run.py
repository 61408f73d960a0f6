"""``gda-tracker run``: the ring, live."""

from __future__ import annotations

import argparse
import sys

from gda_tracker.commands.options import (
    MARKERS,
    RADAR_INPUT,
    SET_VALUED_TRACKER,
    TRACK_EVENTS,
    TRACK_FORMATIONS,
    TRACK_OUTPUT,
    Parameters,
    add_parameter_options,
    add_preset_option,
    gather_parameters,
    node_of_file,
    radar_input_of_file,
)
from gda_tracker.commands.run_nodes import run_in_one_process, run_in_processes
from gda_tracker.errors import UserError
from gda_tracker.io.asterix.udp import is_udp, parse_udp
from gda_tracker.io.radar.file_kinds import ASTERIX
from gda_tracker.io.radar.presets import OF_FILES
from gda_tracker.tracking.ring import STAGE_TABLES

OUTPUTS = ("radar_tracks", "detections_3d", "tracked_objects")
# To guess the preset: wait for a first message, then look for so long.
WAIT_S, LOOK_S = 30.0, 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "--input",
        metavar="TOPIC",
        help="topic of a radar's driver: PointCloud2, RadarScan or RadarTracks; or udp://HOST:PORT "
        "where ASTERIX comes, a multicast group too; default: input_topic of radar_input in "
        "--params; without that the topic detections is read",
    )
    parser.add_argument(
        "--output",
        action="append",
        default=[],
        choices=OUTPUTS,
        metavar="FORMAT",
        help="give tracks out on a topic of this name too, may be repeated: radar_tracks "
        "(radar_msgs/RadarTracks), detections_3d (vision_msgs/Detection3DArray), tracked_objects "
        "(autoware_perception_msgs/TrackedObjects); what the classes are called stands in "
        "parameters of node track_output",
    )
    parser.add_argument(
        "--markers",
        action="store_true",
        help="publish what the tracker does as visualization_msgs/MarkerArray, a topic per layer "
        "below markers/, for RViz and Foxglove; with --bag they are recorded too (docs/layers.md)",
    )
    parser.add_argument(
        "--set-valued",
        action="store_true",
        help="run the node set_valued_tracker on the same detections too: sets of estimates on "
        "track_sets, associations that cannot be rejected stay open (docs/set-valued-tracking.md)",
    )
    parser.add_argument(
        "--events",
        nargs="?",
        const="",
        metavar="FILE",
        help="say on track_events what tracks do: stop, accelerate, split off, and with FILE "
        "(lanes and plans, see params/context_example.yaml) leave their lane or plan "
        "(docs/track-events.md)",
    )
    parser.add_argument(
        "--formations",
        action="store_true",
        help="say on track_formations how many objects fly in each group of tracks, and which "
        "groups split and merge (docs/formations.md)",
    )
    add_preset_option(parser)
    add_parameter_options(parser)
    parser.add_argument(
        "--processes",
        action="store_true",
        help="one process per node, restarted if it ends; default: all nodes in one process",
    )
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="namespace of nodes and topics"
    )
    parser.add_argument(
        "--checkpoint",
        metavar="FILE",
        help="keep the tracker's state in FILE, so that a restart goes on where it stopped",
    )
    parser.add_argument(
        "--use-sim-time",
        action="store_true",
        help="time comes on /clock, e.g. of a bag or simulator",
    )
    parser.add_argument("--bag", metavar="FOLDER", help="record all topics into an MCAP bag")


def run(args: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    parameters = _parameters(args)
    if args.use_sim_time:
        for node in {*STAGE_TABLES, *parameters}:
            parameters[node] = {**parameters.get(node, {}), "use_sim_time": True}
    if args.checkpoint:
        parameters.setdefault("track_manager", {})["checkpoint_path"] = args.checkpoint
    from rclpy.executors import ExternalShutdownException

    from gda_tracker.nodes.runner import transport_environment, use_environment

    use_environment(transport_environment())
    remap = ["-r", f"__ns:=/{args.namespace.strip('/')}"] if args.namespace else []
    try:
        if args.processes:
            return run_in_processes(parameters, remap, args.bag)
        return run_in_one_process(parameters, remap, args.bag)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0  # the usual end


def _parameters(args: argparse.Namespace) -> Parameters:
    """Parameters of the nodes; with ``--input`` also those of the radar input.

    Raises
    ------
    UserError
        For parameters that are not allowed, or if no preset fits the topic.
    """
    from gda_tracker.formations.parameters import FormationParameters
    from gda_tracker.io.parameter_files import read_preset
    from gda_tracker.io.radar.input_parameters import RadarInputParameters
    from gda_tracker.io.track_output_parameters import TrackOutputParameters
    from gda_tracker.parameters import from_mapping

    of_file = radar_input_of_file(args.params)
    topic = args.input or (of_file or {}).get("input_topic")
    name = args.preset
    if topic and is_udp(topic):
        parse_udp(topic)
        if name is None and of_file is None:
            name = OF_FILES[ASTERIX]
    if topic and name is None and of_file is None:
        name = _guessed_preset(topic)
        print(f"gda-tracker run: preset {name}, guessed from the fields of {topic}")
    preset = read_preset(name) if name else {}
    parameters = gather_parameters(args.params, args.method, preset, preset_is_base=True)
    of_output = {**(node_of_file(args.params, TRACK_OUTPUT) or {}), **{n: n for n in args.output}}
    if any(of_output.get(name) for name in OUTPUTS):
        from_mapping(TrackOutputParameters, of_output)
        parameters[TRACK_OUTPUT] = of_output
    if args.markers:
        parameters[MARKERS] = node_of_file(args.params, MARKERS) or {}
    frame = parameters.get("track_manager", {}).get("tracking_frame")
    if args.set_valued:
        of_sets = dict(node_of_file(args.params, SET_VALUED_TRACKER) or {})
        if frame is not None:
            of_sets.setdefault("tracking_frame", frame)
        parameters[SET_VALUED_TRACKER] = of_sets
    if args.events is not None:
        parameters[TRACK_EVENTS] = _of_events(args)
    if args.formations:
        parameters[TRACK_FORMATIONS] = dict(node_of_file(args.params, TRACK_FORMATIONS) or {})
        from_mapping(FormationParameters, parameters[TRACK_FORMATIONS])
    if not topic:
        return parameters
    of_radar = {**preset.get(RADAR_INPUT, {}), **(of_file or {}), "input_topic": topic}
    if frame is not None:
        of_radar.setdefault("tracking_frame", frame)
    from_mapping(RadarInputParameters, of_radar)
    return {**parameters, RADAR_INPUT: of_radar}


def _of_events(args: argparse.Namespace) -> dict[str, object]:
    """Parameters of the events; the file of lanes and plans is read now, to say what is wrong."""
    from gda_tracker.events.parameters import EventParameters
    from gda_tracker.io.context_files import read_context_file
    from gda_tracker.parameters import from_mapping
    from gda_tracker.tracking.context_files import full_path

    given = dict(node_of_file(args.params, TRACK_EVENTS) or {})
    if args.events:
        given["context_file"] = str(full_path(args.events).resolve())
    table = from_mapping(EventParameters, given)
    if table.context_file:
        read_context_file(table.context_file)
    return given


def _guessed_preset(topic: str) -> str:
    from gda_tracker.io.radar.presets import best_preset, presets_of
    from gda_tracker.nodes.topic_listener import listen

    print(f"gda-tracker run: no preset given, looking at {topic} ...")
    sys.stdout.flush()
    frames = [frame for frame in listen(topic, WAIT_S, LOOK_S) if frame.types]
    found = best_preset(frames)
    if found is None:
        raise UserError(
            f"--input {topic}: no preset fits the fields {', '.join(frames[0].types)}; name one "
            f"with --preset ({', '.join(presets_of(frames[0].kind))}), or declare the fields: "
            f"gda-tracker inspect {topic} --yaml FILE"
        )
    return found
