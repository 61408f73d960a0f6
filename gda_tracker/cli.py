"""The command line ``gda-tracker``: its commands, each in a module of its own."""

from __future__ import annotations

import argparse
import importlib
import sys
import textwrap
from dataclasses import dataclass

from gda_tracker import __version__
from gda_tracker.errors import UserError
from gda_tracker.termination import INTERRUPTED, TERMINATED, terminated_as_interrupted
from gda_tracker.threads import one_thread_of_linear_algebra


@dataclass(frozen=True)
class Command:
    """A command: the module that does it, one line about it, and what ``--help`` teaches."""

    module: str
    summary: str
    description: str


COMMANDS = {
    "demo": Command(
        "gda_tracker.commands.demo",
        "track a real radar recording and two crossing targets, and write a report",
        """
        Runs the four nodes as four processes and sends through them
          1. a real marine-radar recording with two boats (Autoferry, scenario 16),
          2. two crossing aircraft, simulated, with the radar cross section off and on.
        Prints a table and writes results/demo/report.html and a bag of all topics.

        With --set-valued instead, within seconds and without nodes: three crossing tracks, each a
        set of estimates that shrinks, with several associations kept open where two of them meet
        (docs/set-valued-tracking.md). Writes results/demo/set_valued.html and .png.

        examples:
          gda-tracker demo
          gda-tracker demo --set-valued
        """,
    ),
    "inspect": Command(
        "gda_tracker.commands.inspect",
        "what a radar's topic, bag or file holds, and the parameters for it",
        """
        Prints the fields with types, ranges and guessed units and meanings, rates and stamps,
        whether the radar cross sections can be true, the radar's own motion, and the preset that
        fits, with the reason. Writes a parameter file ready to run.

        examples:
          gda-tracker inspect my_bag
          gda-tracker inspect my_bag --topic /radar/points --yaml my_radar.yaml
          gda-tracker inspect /radar/points --seconds 5
        """,
    ),
    "run": Command(
        "gda_tracker.commands.run",
        "run the tracker live: detections in, tracks out",
        """
        Runs the four nodes until Ctrl-C. They read the topic detections
        (gda_tracker_msgs/DetectionArray) and publish tracks, in the ROS domain of the environment.
        With --input a fifth node, radar_input, makes detections of what a radar's driver publishes
        (PointCloud2, RadarScan, RadarTracks), as a preset or a parameter file declares it.

        examples:
          gda-tracker run --input /radar/points --preset continental_ars548
          gda-tracker run --params my_radar.yaml
          gda-tracker run --processes --method map/bayes/cv --namespace radar_1
        """,
    ),
    "replay": Command(
        "gda_tracker.commands.replay",
        "track a recording: a bag, a file of a radar, or a scenario",
        """
        Sends every scan of a recording through the tracker, by default through the four nodes as
        fast as they complete scans, losing none, in a ROS domain of its own.

        examples:
          gda-tracker replay scenario16_detections.json --tracks tracks.csv
          gda-tracker replay my_bag --offline --method map/bayes/cv --association-log why.jsonl
          gda-tracker replay my_bag --params my_radar.yaml --bag out_bag --rate 1
          gda-tracker replay my_bag --topic /radar/points --preset ti_mmwave

        recordings: bags with detections, or with PointCloud2, RadarScan or RadarTracks of a radar;
        Autoferry JSON, scan_npz, mmWave text frames (.tar.xz or folder), Continental YAML scans,
        CSV tables (docs/radars.md). A parameter file goes on top of a radar's preset, otherwise it
        takes the place of the recording's own.
        """,
    ),
    "view": Command(
        "gda_tracker.commands.view",
        "see in a browser what the tracker does: displays, beliefs, decisions, parameters",
        """
        Serves a page: plan position and B-scope with gates and covariances, the list of tracks,
        class beliefs and radar cross section of a track over time, the association matrix of a
        scan, and the parameters, to be changed while it runs. Pause, step, and look back at any
        scan. Without RECORDING it shows a running ring in the ROS domain of the environment, which
        never waits for it; with one it replays it here, without ROS.

        It needs no internet. Only this machine can open it, unless --host says otherwise.

        examples:
          gda-tracker view
          gda-tracker view my_bag --preset ti_mmwave --rate 2
          gda-tracker view crossing_targets --method map/bayes/cv --paused
          gda-tracker view --host 0.0.0.0 --namespace radar_1
        """,
    ),
    "record": Command(
        "gda_tracker.commands.record",
        "record all topics of the tracker into an MCAP bag",
        """
        Records until Ctrl-C (or SIGTERM, as docker stop and systemd send it). The bag plays with
        `gda-tracker play`, `gda-tracker replay` and `ros2 bag play`.

        example:
          gda-tracker record my_bag
        """,
    ),
    "play": Command(
        "gda_tracker.commands.play",
        "play the messages of a bag on their topics, as a radar would send them",
        """
        Publishes the messages of any bag, as they are, at the pace at which they were recorded: a
        rehearsal of run --input without the radar. Qualities of service are those of the
        recording, static transforms are latched. Topics whose type is not installed here are named
        and left out. (replay is for tracking a recording without losing a scan.)

          --restamp    live tools, such as doctor, want the time of today; with --loop the tracker
                       needs stamps that go on, too
          --topic      of a bag that record made, play the inputs alone: a tracker that runs
                       publishes the others itself

        examples:
          gda-tracker play bags/walk --loop --restamp
          gda-tracker play my_bag --rate 2 --topic /radar/points /tf_static --clock
        """,
    ),
    "say": Command(
        "gda_tracker.commands.say",
        "tell a running tracker what somebody knows of a place or a track",
        """
        Reads statements written in YAML, checks them, publishes them to a ring that runs in the
        ROS domain of the environment, and prints whether each was admitted. It is used with the
        next scan: it changes evidence, class beliefs, associations and states.

          source       who says it
          kind         region (crisp), fuzzy (grades), fds (pieces with masses of the sum 1),
                       rule (rule: region_implies_classes or classes_imply_region)
          about        place (any detection there) or track (with track_id)
          reliability  chance that the source is right, 0 to 1; without it 1
          pieces       a list, each with a region, classes (names with grades 0 to 1) or both:
                       {shape: gaussian, centre_m: [x, y], covariance_m2: [xx, xy, yx, yy]}
                       {shape: box, low_m: [x, y], high_m: [x, y]}
                       {shape: polygon, vertices_m: [x, y, x, y, x, y, ...]}
                       {shape: sector, centre_m: [x, y], first_bearing_rad, opening_rad,
                        nearest_m, farthest_m} (the last two may be left out)
          stamp_s, sequence, frame_id may be left out: that of the newest scan, a new number,
                       the tracking frame

        Angles are counter-clockwise from the x axis. docs/statements.md says what each does.
        Exit status 1 if the ring refuses a statement, 2 if the file is wrong or no ring runs.

        examples:
          gda-tracker say --example fuzzy > buoy.yaml
          gda-tracker say buoy.yaml --check
          gda-tracker say buoy.yaml
        """,
    ),
    "doctor": Command(
        "gda_tracker.commands.doctor",
        "what is wrong with a live system, why it matters, and the command that mends it",
        """
        Looks at the environment, then for some seconds at the ROS graph, and prints what keeps
        tracks from coming:

          environment  rclpy or messages missing or of another version, ROS domain, discovery
                       range, Fast DDS profile, shared memory
          nodes        missing, twice, not active, silent
          topics       nobody publishes or reads them, two types, qualities of service that do not
                       go together, found but not heard
          time         stamps unset, standing, stepping back, in another epoch, simulated time
                       without /clock
          frames       unset, changing, not connected with the tracking frame
          counters     everything that the nodes reject or drop, explained

        Exit status 0 if nothing needs attention (notes do not count), 1 if something does.

        examples:
          gda-tracker doctor
          gda-tracker doctor --input /radar/points --seconds 10
          gda-tracker doctor --json
        """,
    ),
    "why": Command(
        "gda_tracker.commands.why",
        "why a detection went to a track: the terms of each pair of a scan, in words",
        """
        Prints each pair of the track with a detection in its gate: Mahalanobis distance and gate,
        kinematic and attribute term with what they are compared with, both together, probability,
        the strongest rival, and what became of it (docs/why.md).

          SCAN         number of the scan, from 0 as in the table of replay --tracks; a stamp in
                       seconds with a point, or in nanoseconds; or last
          TRACK        track id; without it all tracks of the scan, a line each
          SOURCE       an association log (replay --offline --association-log), or a bag of all
                       topics (replay --bag, run --bag, record); without it the tracker that runs,
                       with SCAN last

        examples:
          gda-tracker replay my_bag --offline --association-log why.jsonl
          gda-tracker why 12 3 why.jsonl
          gda-tracker why 1716.250 3 recorded_bag
          gda-tracker why last 3
        """,
    ),
    "params": Command(
        "gda_tracker.commands.params",
        "the parameters of a running tracker: list, get, set, save",
        """
        Reads and changes the parameters of the nodes that run in the ROS domain of the environment,
        through their services.

          list         all parameters: value, meaning, unit, range, live or fixed at start-up
          get          values of some
          set          change several at once: each node takes all of its own or none, and says why
                       not; a change acts at the next scan
          save         write a parameter file for gda-tracker run --params

        Exit status 1 if a node refuses, 2 for a wrong name or value or if no tracker runs.

        examples:
          gda-tracker params list --node track_manager
          gda-tracker params get gate_probability
          gda-tracker params set gate_probability=0.999 clutter_density_per_m_rad=1e-5
          gda-tracker params save my_radar.yaml
        """,
    ),
    "evaluate": Command(
        "gda_tracker.commands.evaluate",
        "Monte Carlo of scenarios: which method keeps the tracks pure?",
        """
        Simulates a scenario many times and tracks every run with every method on the same random
        numbers, offline, on all cores. Prints track purity and the table of who took whose
        detections, as in tables 14.4 to 14.9 of the 2004 chapter, with paired differences.

        example:
          gda-tracker evaluate crossing_targets --runs 200 \\
            --method gda/none/cv --method gda/dsm_classic/cv --method map/bayes/cv
        """,
    ),
    "tune": Command(
        "gda_tracker.commands.tune",
        "search parameters that suit a radar, on recordings with known truth",
        """
        Tracks recordings again and again with other parameters, looks for the best (Optuna), and
        compares it with the default on recordings that the search has not seen. Writes report.html
        with pictures and tuned.yaml for --params; both say so if the result does not beat the
        default there.

          --objective   gospa (distance of tracks and targets), completeness (share of the time
                        that targets are tracked), switches (of the track of a target), delay
                        (until a track is confirmed); with complete truth also false_tracks, with
                        simulations also purity. Given twice or more: a trade-off.
          --parameter   what to search, in place of the ten or so that most radars need
          --storage     kept there: Ctrl-C, and the same command goes on. Commands on several
                        machines with one storage share the trials; give each a --seed.

        The trials depend on the seed alone, not on the number of workers.
        docs/tuning.md: what was measured, and which parameter cures which symptom.

        examples:
          gda-tracker tune data/autoferry/scenario13 --held-back data/autoferry/scenario16
          gda-tracker tune my_bag --truth gnss.csv --params my_radar.yaml \\
            --parameter process_noise_std_mps2=0.1:5:log --parameter deletion_misses=2:10
          gda-tracker tune crossing_targets --objective completeness --objective false_tracks
          gda-tracker tune my_bag --storage sqlite:///study.db --study mine --workers 4
        """,
    ),
    "fuse": Command(
        "gda_tracker.commands.fuse",
        "a calculator of evidence: combine belief masses by any of the rules",
        """
        Reads a problem as JSON and prints the answer as JSON, all digits.

          frame        1 to 5 names
          model        "free", "shafer" (the elements exclude each other) or
                       {"empty": ["A&B", ...]}; without it free
          sources      belief masses, one object per source; & is the intersection and binds
                       before |, the union. Each sums to one within 1e-9.
          rule         dsmc, dsmh, dempster, disjunctive, yager, dubois_prade, pcr5, pcr6 take
                       2 or more sources; discount 1 or more, each for itself; pignistic 1
          reliability  what discount keeps, 0 to 1

        The answer: result (masses; for pignistic probabilities), conflict (mass of the products
        that are empty on the model), pignistic (generalised pignistic probabilities of the
        frame's elements) and entropy_nats (pignistic entropy over the model's disjoint parts,
        natural logarithm). discount of several sources answers with a list, one for each.
        Exit status 3 and {"undefined": "total conflict"} if Dempster's rule has no answer,
        exit status 2 and one line if the problem is not well formed.

        examples:
          gda-tracker fuse --example > problem.json
          gda-tracker fuse problem.json
          gda-tracker fuse --example pcr5 | gda-tracker fuse -
        """,
    ),
    "associate": Command(
        "gda_tracker.commands.associate",
        "which measurements of several sensors come from the same object, and how surely",
        """
        Reads measurements of two or more sensors as JSON and prints as JSON, all digits, the exact
        probability of each association (Ferry 2010): Gaussian positions, biases of the sensors
        integrated out, object types, features, false alarms, numbers of objects unknown.

          sensors   a list; of each: measurements (position, covariance; type_call, feature),
                    bias_covariance (null: diffuse; zeros: none), detection_probability (a number
                    or {type: p}); may be left out: bias_mean, expected_false_alarms
          prior     {"kind": "poisson", "mean": 3.5}, {"kind": "diffuse"} or
                    {"kind": "log_diffuse"}: on the number of objects
          prior_covariance   of the objects about their centre; left out: estimated
          types     {"prior": {type: p}, "confusion": a matrix {type: {called: p}} per sensor}
          feature_model      gaussian or von_mises, with noise, missing values, jumps by pi

        The answer: associations, most probable first (objects: the index of each sensor's
        measurement, from 0, or null), pairs (pair_probability), bias and relative_bias (what to
        add to a sensor's positions), covered (share of the probability that was looked at: 1 where
        all associations were enumerated), method. docs/cross-sensor-association.md has the whole
        schema. Exit status 2 and one line, with the JSON path, if the problem is not well formed.

        examples:
          gda-tracker associate --example ferry_6_1 > problem.json
          gda-tracker associate problem.json --top 5
          gda-tracker associate --example | gda-tracker associate - --method gibbs
        """,
    ),
    "calibrate": Command(
        "gda_tracker.commands.calibrate",
        "check that computed probabilities come true, over many simulated scenes",
        """
        ferry: simulates scenes like that of section 6.1 of Ferry 2010 (three sensors of unknown
        bias, types, a noisy angle), computes the probabilities of the 778 associations of each,
        and counts how often those with 1 %, 50 %, 99 % are right. Prints Tables V and VI of the
        paper with the published counts beside. --variant leaves something out of the computation,
        to see that the check would tell. Exit status 1 if a bin is off by more than 4 standard
        deviations. The result depends on runs, seed and variant alone, not on the cores.

        examples:
          gda-tracker calibrate ferry --runs 100000 --plot reliability.png
          gda-tracker calibrate ferry --runs 2000 --variant jump_ignored
        """,
    ),
}


def build_parser(command: str | None = None) -> argparse.ArgumentParser:
    """Build the parser; only the module of ``command`` is imported, so start-up stays quick."""
    parser = argparse.ArgumentParser(
        prog="gda-tracker",
        description="Multi-target radar tracking with kinematic and attribute association.",
        epilog="gda-tracker COMMAND --help explains a command.",
    )
    parser.add_argument("--version", action="version", version=f"gda-tracker {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, entry in COMMANDS.items():
        child = commands.add_parser(
            name,
            help=entry.summary,
            description=textwrap.dedent(entry.description).strip(),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name == command:
            importlib.import_module(entry.module).add_arguments(child)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code (2: wrong arguments or parameters).

    SIGTERM ends a command as Ctrl-C does; where that is status 130, it is 143.
    """
    one_thread_of_linear_algebra()
    arguments = sys.argv[1:] if arguments is None else arguments
    named = next((word for word in arguments if not word.startswith("-")), None)
    args = build_parser(named).parse_args(arguments)
    with terminated_as_interrupted() as terminated:
        code = _run(args)
    return TERMINATED if terminated and code == INTERRUPTED else code


def _run(args: argparse.Namespace) -> int:
    try:
        return int(importlib.import_module(COMMANDS[args.command].module).run(args) or 0)
    except (UserError, OSError, ImportError) as error:
        # What the user can mend: a value, a file, a missing library. One line each.
        print(f"gda-tracker {args.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"gda-tracker {args.command}: stopped", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    raise SystemExit(main())
