"""Bad input over the topics: named, counted, answered; other scans are untouched."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gda_tracker_msgs import msg
from graph_helpers import (
    TIMEOUT_S,
    differences,
    offline,
    scenario_plays,
    with_statements,
)
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from gda_tracker.io.messages import (
    detections_to_message,
    scan_report_from_message,
    statement_report_from_message,
    statement_to_message,
    tracks_from_message,
    tracks_to_message,
)
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.runner import STAGES, Nodes, stage_nodes
from gda_tracker.tracking.ring import Ring

METHOD = "gda/dsm_classic/cv"


class Client(Node):
    """Publishes what a test wants and keeps what comes back."""

    def __init__(self, **options):
        super().__init__("client", **options)
        self.detections = self.create_publisher(msg.DetectionArray, "detections", stream())
        self.initial = self.create_publisher(msg.TrackArray, "initial_tracks", latched())
        self.statements = self.create_publisher(msg.Statement, "statements", stream())
        self.reports, self.tracks, self.diagnostics = [], {}, {}
        self.heard = []
        self.create_subscription(
            msg.StatementReport, "statement_reports", self._statement_report, stream()
        )
        self.create_subscription(msg.ScanReport, "scan_reports", self._report, stream())
        self.create_subscription(msg.TrackArray, "tracks", self._tracks, stream())
        self.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, stream())

    def autostart(self):
        """Nothing to start."""

    def _report(self, message):
        self.reports.append(scan_report_from_message(message))

    def _statement_report(self, message):
        self.heard.append(statement_report_from_message(message))

    def _tracks(self, message):
        tracks = tracks_from_message(message)
        self.tracks[(tracks.key.sensor_id, tracks.key.stamp_ns)] = tracks

    def _diagnose(self, message):
        for status in message.status:
            self.diagnostics[status.name] = status

    def value(self, node, name):
        """A value of a node's diagnostics, as text."""
        status = self.diagnostics.get(f"/{node}")
        values = {} if status is None else {v.key: v.value for v in status.values}
        return values.get(name)


class Bench:
    """A ring in one process and a client."""

    def __init__(self, domain, parameters):
        self.nodes = Nodes(
            lambda **o: [Client(**o), *stage_nodes(parameters, **o)],
            domain,
        )
        self.client = self.nodes.nodes[0]
        self.manager = self.nodes.nodes[1]

    def __enter__(self):
        self.nodes.__enter__()
        self.until(
            lambda: (
                self.client.detections.get_subscription_count() > 0
                and self.client.count_publishers("scan_reports") > 0
                and self.client.count_publishers("tracks") > 0
                and self.client.statements.get_subscription_count() > 0
                and self.client.count_publishers("statement_reports") > 0
            )
        )
        return self

    def __exit__(self, *unused):
        self.nodes.__exit__(*unused)

    def until(self, done):
        assert self.nodes.spin_until(done, TIMEOUT_S), (self.client.reports, self.manager.counters)

    def send(self, message):
        """Publish, wait for the answer, return it."""
        count = len(self.client.reports)
        if not isinstance(message, msg.DetectionArray):
            message = detections_to_message(message)
        self.client.detections.publish(message)
        self.until(lambda: len(self.client.reports) > count)
        return self.client.reports[-1]

    def say(self, message):
        """Publish a statement, wait for the answer, return it."""
        count = len(self.client.heard)
        if not isinstance(message, msg.Statement):
            message = statement_to_message(message)
        self.client.statements.publish(message)
        self.until(lambda: len(self.client.heard) > count)
        return self.client.heard[-1]

    def initialise(self, tracks):
        """Send labelled tracks and wait until they are taken."""
        tracks = replace(tracks, system_uuid=os.urandom(16))
        self.client.initial.publish(tracks_to_message(tracks))
        self.until(lambda: any(r.outcome == "initialised" for r in self.client.reports))


@pytest.fixture
def crossing():
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    return plays[0], parameters, offline(plays, parameters)


def spoil(detections, **changes):
    """A copy with other arrays, and a stamp half a second later so that it is a scan of its own."""
    return replace(detections, stamp_ns=detections.stamp_ns + 500_000_000, **changes)


def not_a_number(d):
    values = d.range_m.copy()
    values[:] = np.nan
    return spoil(d, range_m=values)


def mismatched(d):
    return spoil(d, azimuth_rad=d.azimuth_rad[:-1])


def flood(d):
    n = 100_000
    return spoil(d, range_m=np.full(n, 1e4), azimuth_rad=np.zeros(n), rcs_m2=None, rcs_valid=None)


REJECTED = {
    "array_length_mismatch": mismatched,
    "too_many_detections": flood,
    "late": lambda d: replace(d, stamp_ns=d.stamp_ns - 6_000_000_000),
    "missing_sensor_id": lambda d: spoil(d, sensor_id=""),
    "bad_attribute_names": lambda d: spoil(
        d, attribute_names=("length_m", ""), attribute_values=np.zeros((2, len(d.range_m)))
    ),
    "bad_sensor_pose": lambda d: spoil(d, sensor_position_m=np.array([np.inf, 0.0, 0.0])),
}


def test_rejected_scans_change_nothing(domain, crossing):
    """Between the good scans every kind of broken scan is sent; the tracks are the same."""
    play, parameters, expected = crossing
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        reasons = list(REJECTED)
        for index, detections in enumerate(play.detections):
            assert bench.send(detections).outcome == "tracked"
            reason = reasons[index % len(reasons)]
            answer = bench.send(REJECTED[reason](detections))
            assert (answer.outcome, answer.reason) == ("rejected", reason)
        bench.until(lambda: len(bench.client.tracks) == len(play.detections))
        assert differences(bench.client.tracks, expected) == []
        for reason in reasons:
            assert bench.manager.counters[f"rejected_{reason}"] >= 3
        bench.until(lambda: bench.client.value("track_manager", "rejected_late") is not None)


def broken_time():
    message = msg.Statement(source="pilot", sequence=1)
    message.header.stamp.sec = -5
    return message


def test_refused_statements_change_nothing(domain, crossing):
    """Between the scans broken and unfit statements are sent; all are answered, none is used."""
    play, parameters, expected = crossing
    parameters["track_manager"]["max_statements"] = 2
    said = [statement for _, statement in with_statements(play).statements]
    good = next(s for s in said if (s.kind, s.about) == ("fuzzy", "place"))
    near, now = good.pieces[0], play.detections[15].stamp_ns
    refused = {
        "malformed": broken_time(),
        "missing_source": msg.Statement(),
        "missing_sequence": replace(good, sequence=0),
        "unknown_frame": replace(good, frame_id="odom"),
        "unknown_kind": replace(good, kind="rumour"),
        "unknown_track": replace(good, about="track", track_id=999, stamp_ns=now),
        "not_finite": replace(good, reliability=np.nan),
        "bad_grades": replace(good, pieces=(replace(near, class_grades=(2.0, 0.0)),)),
        "wrong_number_of_pieces": replace(good, pieces=(near,) * 40),
        "place_without_classes": replace(
            good, pieces=(replace(near, class_names=(), class_grades=()),)
        ),
        "too_old": replace(good, stamp_ns=now - 61 * 10**9),
        "too_far_ahead": replace(good, stamp_ns=now + 200 * 10**9),
    }
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        for position, detections in enumerate(play.detections):
            assert bench.send(detections).outcome == "tracked"
            if position == 15:
                for reason, message in refused.items():
                    report = bench.say(message)
                    assert (report.outcome, report.reason) == ("rejected", reason)
                # Those of a later time wait, up to the bound; here it never comes.
                for sequence, reason in enumerate(["", "", "queue_full", "queue_full"], 1):
                    later = replace(good, sequence=sequence, stamp_ns=now + 59 * 10**9)
                    assert bench.say(later).reason == reason
                assert bench.say(replace(good, sequence=1)).reason == "duplicate"
        bench.until(lambda: len(bench.client.tracks) == len(play.detections))
        assert differences(bench.client.tracks, expected) == []
        assert len(bench.manager.manager.state.desk.waiting) == 2
        counters = bench.manager.counters
        assert all(counters[f"statement_rejected_{reason}"] == 1 for reason in refused)
        bench.until(
            lambda: bench.client.value("track_manager", "statement_rejected_queue_full") == "2"
        )


def test_somebody_says_something(domain, crossing, environment, tmp_path):
    """The command speaks to the ring that runs, takes its time from it, and hears the answer."""
    play, parameters, _ = crossing
    path = tmp_path / "statements.yaml"
    path.write_text(
        "source: pilot\nkind: fuzzy\nabout: track\ntrack_id: 1\n"
        "pieces: [{classes: {fighter: 1.0}}]\n---\n"
        "source: pilot\nkind: fuzzy\nabout: track\ntrack_id: 77\n"
        "pieces: [{classes: {fighter: 1.0}}]\n"
    )
    command = [sys.executable, "-m", "gda_tracker.cli", "say", str(path)]
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        assert bench.send(play.detections[0]).outcome == "tracked"
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        bench.until(lambda: process.poll() is not None)
        out, err = process.communicate()
        assert process.returncode == 1, err
        first, second = out.splitlines()
        assert "admitted" in first
        assert "rejected, unknown_track: no track with this track_id lives" in second
        (waiting,) = bench.manager.manager.state.desk.waiting
        assert waiting.stamp_ns == play.detections[0].stamp_ns
        bench.send(play.detections[1])
        assert bench.manager.manager.state.desk.waiting == ()


def test_broken_detections_are_left_out_and_the_rest_is_tracked(domain, crossing):
    play, parameters, expected = crossing
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        for detections in play.detections:
            n = len(detections.range_m)
            bad = replace(
                detections,
                range_m=np.concatenate([detections.range_m, [np.nan, np.inf, -5.0, 0.0]]),
                azimuth_rad=np.concatenate([detections.azimuth_rad, [0.0, 0.0, 0.0, 0.0]]),
                rcs_m2=np.concatenate([detections.rcs_m2, [1.0, 1.0, 1.0, np.nan]]),
                rcs_valid=None,
                # Of an attribute that no parameter declares: checked and counted all the same.
                attribute_names=("length_m",),
                attribute_values=np.append(np.nan, np.ones(n + 3))[None],
            )
            answer = bench.send(bad)
            assert answer.rejected == {
                "not_finite": 2,
                "negative_range": 1,
                "zero_range": 1,
                "attribute_not_finite": 1,
            }
            assert (answer.detections_received, answer.detections_admitted) == (n + 4, n)
        bench.until(lambda: len(bench.client.tracks) == len(play.detections))
        assert differences(bench.client.tracks, expected) == []


def test_wrapped_azimuth_is_counted_and_tracked(domain, crossing):
    play, parameters, _ = crossing
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        first = play.detections[0]
        answer = bench.send(replace(first, azimuth_rad=first.azimuth_rad + 4.0 * np.pi))
        assert answer.rejected == {"azimuth_wrapped": len(first.range_m)}
        bench.until(lambda: bench.client.tracks)
        assert (next(iter(bench.client.tracks.values())).detection_index >= 0).all()


def test_duplicates_and_a_time_jump(domain, crossing):
    play, parameters, _ = crossing
    parameters["track_manager"]["initiation"] = "automatic"
    with Bench(domain, parameters) as bench:
        for detections in play.detections[:6]:
            assert not bench.send(detections).repeated
        again = bench.send(play.detections[5])
        assert again.repeated
        assert again.outcome == "tracked"
        highest = max(t.track_id.max() for t in bench.client.tracks.values() if len(t))
        bench.client.tracks.clear()
        # The recording starts again: the time axis jumps back by 25 s, tracks are new, ids go on.
        for detections in play.detections[:5]:
            assert bench.send(detections).outcome == "tracked"
        assert bench.manager.counters["reset_time_jump"] == 1
        keys = [(d.sensor_id, d.stamp_ns) for d in play.detections[:5]]
        bench.until(lambda: set(keys) <= set(bench.client.tracks))
        ids = np.concatenate([bench.client.tracks[key].track_id for key in keys])
        assert ids.size
        assert ids.min() > highest


def test_garbage_on_the_ring_topics_is_counted_and_the_scan_completed(domain, crossing):
    play, parameters, expected = crossing
    with Bench(domain, parameters) as bench:
        noise = bench.client.create_publisher(msg.Associations, "associations", latched())
        bench.until(lambda: noise.get_subscription_count() > 0)
        bench.initialise(play.initial)
        for detections in play.detections[:5]:
            foreign = msg.Associations()
            foreign.key.sensor_id = "someone else"
            noise.publish(foreign)
            assert bench.send(detections).outcome == "tracked"
        bench.until(lambda: len(bench.client.tracks) == 5)
        wanted = {key: expected[key] for key in bench.client.tracks}
        assert differences(bench.client.tracks, wanted) == []
        bench.until(lambda: bench.manager.counters["not_open"] > 0)
        # A second publisher of a stage's output is an error, said in diagnostics.
        bench.until(
            lambda: (
                getattr(bench.client.diagnostics.get("/association"), "level", None)
                == DiagnosticStatus.ERROR
            )
        )
        assert "second publisher" in bench.client.diagnostics["/association"].message


def test_a_dead_stage_degrades_or_gives_up_only_when_asked(domain, crossing):
    play, parameters, _ = crossing
    parameters["track_manager"] |= {"attribute_timeout_s": 0.5, "retry_period_s": 0.5}
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        assert bench.send(play.detections[0]).outcome == "tracked"
        fusion = next(n for n in bench.nodes.nodes if n.get_name() == "attribute_fusion")
        fusion.trigger_deactivate()
        answer = bench.send(play.detections[1])
        assert answer.outcome == "degraded"
        association = next(n for n in bench.nodes.nodes if n.get_name() == "association")
        association.trigger_deactivate()
        bench.manager.set_parameters([Parameter("scan_timeout_s", value=1.0)])
        answer = bench.send(play.detections[2])
        assert answer.outcome == "gave_up"
        bench.until(lambda: len(bench.client.tracks) == 3)
        stamps = [d.stamp_ns for d in play.detections[:3]]
        tracks = [bench.client.tracks[("radar", s)] for s in stamps]
        assert [t.degraded for t in tracks] == [False, True, True]
        # A dead node is not a missed detection.
        assert np.array_equal(tracks[2].misses, tracks[1].misses)
        fusion.trigger_activate()
        association.trigger_activate()
        bench.manager.set_parameters(
            [Parameter("scan_timeout_s", value=0.0), Parameter("attribute_timeout_s", value=0.0)]
        )
        assert bench.send(play.detections[3]).outcome == "tracked"


def test_live_parameters_act_or_are_refused_with_a_reason(domain, crossing):
    play, parameters, _ = crossing
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        client = bench.client.create_client(SetParameters, "track_manager/set_parameters")
        bench.until(client.service_is_ready)

        def change(**values):
            request = SetParameters.Request(
                parameters=[Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
            )
            future = client.call_async(request)
            bench.until(future.done)
            return [(r.successful, r.reason) for r in future.result().results]

        ((good, reason),) = change(gate_probability=1.5)
        assert not good
        assert "gate_probability = 1.5" in reason
        assert "<= 0.999999" in reason
        assert change(deletion_misses=1)[0][0]
        # An integer for a number is taken.
        assert change(process_noise_std_mps2=20)[0][0]
        assert change(decision="map", attribute_term="bayes") == [(True, ""), (True, "")]
        assert bench.send(play.detections[0]).outcome == "tracked"
        assert bench.manager.manager.parameters.decision == "map"
        empty = replace(
            play.detections[1],
            range_m=np.zeros(0),
            azimuth_rad=np.zeros(0),
            rcs_m2=None,
            rcs_valid=None,
        )
        assert bench.send(empty).outcome == "tracked"
        bench.until(lambda: len(bench.client.tracks) == 2)
        ended = bench.client.tracks[("radar", empty.stamp_ns)]
        assert len(ended) == 0
        assert ended.deleted_track_id.tolist() == [1, 2]


def test_the_history_policy_changes_while_the_nodes_run(domain, crossing):
    """The same tracks as of an offline ring whose policy changes before the same scans."""
    play, parameters, _ = crossing
    changes = {
        3: {"history_window": 6, "history_policy": "window"},
        9: {"history_window": 3},
        12: {"history_window": 8},
        16: {"forgetting_factor": 0.7, "history_policy": "forgetting"},
        19: {"history_policy": "none"},
    }
    ring = Ring(parameters)
    ring.initialise(play.initial)
    expected, found = {}, {}
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        (answer,) = bench.manager.set_parameters([Parameter("history_policy", value="window")])
        assert not answer.successful
        assert "allowed with a history_window of at least 1, which is 0" in answer.reason
        for number, scan in enumerate(play.detections):
            key = (scan.sensor_id, scan.stamp_ns)
            values = changes.get(number, {})
            ring.manager.set_parameters(replace(ring.manager.parameters, **values))
            expected[key] = ring.process(scan).tracks
            answers = bench.manager.set_parameters(
                [Parameter(name, value=value) for name, value in values.items()]
            )
            assert all(answer.successful for answer in answers), answers
            assert bench.send(scan).outcome == "tracked"
            bench.until(lambda key=key: key in bench.client.tracks)
            found[key] = bench.client.tracks[key]
    assert len(found) > 20
    assert differences(found, expected) == []


def test_attribute_values_out_of_range_are_counted_in_diagnostics(domain, crossing):
    play, parameters, _ = crossing
    parameters["rcs_fuzzifier"] |= {
        "attribute_names": ["length_m"],
        "attribute_models": ["lognormal"],
        "attribute_numbers": [3.0, 1.0, 15.0, 0.3, 40.0, 0.3],
    }
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        first = play.detections[0]
        lengths = np.append(-5.0, np.full(len(first.range_m) - 1, 20.0))
        sent = replace(first, attribute_names=("length_m",), attribute_values=lengths[None])
        assert bench.send(sent).outcome == "tracked"
        bench.until(lambda: bench.client.value("rcs_fuzzifier", "length_m_out_of_range") == "1")


def test_a_list_that_is_empty_by_default_is_filled_and_emptied_again(domain, crossing):
    play, parameters, _ = crossing
    parameters["track_manager"]["attribute_term"] = "bayes"
    with Bench(domain, parameters) as bench:
        bench.initialise(play.initial)
        fusion = next(n for n in bench.nodes.nodes if n.get_name() == "attribute_fusion")
        assert fusion.parameters.class_transition == []
        stays = [0.8, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8]
        for values in (stays, []):
            (answer,) = fusion.set_parameters([Parameter("class_transition", value=values)])
            assert answer.successful, answer.reason
            assert fusion.parameters.class_transition == values
            assert bench.send(play.detections[0 if values else 1]).outcome == "tracked"
        (answer,) = fusion.set_parameters([Parameter("class_transition", value=[0.5, 0.5])])
        assert not answer.successful
        assert "class_transition = [0.5, 0.5]: 2 numbers" in answer.reason
        assert fusion.parameters.class_transition == []


def test_a_class_transition_of_other_classes_is_an_error_until_it_is_mended(domain, crossing):
    """The node learns of the classes with the first evidence; the scan waits and is answered."""
    play, parameters, expected = crossing
    two = [0.9, 0.5, 0.1, 0.5]
    parameters["track_manager"] |= {"attribute_term": "bayes", "retry_period_s": 0.3}
    parameters["attribute_fusion"] = {"class_transition": two}
    allowed = "class_transition = 4 numbers: allowed are 9 for the 3 classes false_alarm, fighter"
    with Bench(domain, parameters) as bench:
        fusion = next(n for n in bench.nodes.nodes if n.get_name() == "attribute_fusion")
        bench.initialise(play.initial)
        count = len(bench.client.reports)
        bench.client.detections.publish(detections_to_message(play.detections[0]))

        def complains():
            status = bench.client.diagnostics.get("/attribute_fusion")
            return status is not None and status.level == DiagnosticStatus.ERROR

        bench.until(complains)
        assert allowed in bench.client.diagnostics["/attribute_fusion"].message
        assert len(bench.client.reports) == count
        (answer,) = fusion.set_parameters([Parameter("class_transition", value=[])])
        assert answer.successful, answer.reason
        bench.until(lambda: len(bench.client.reports) > count)
        assert bench.client.reports[-1].outcome == "tracked"
        bench.until(lambda: not complains())
        # Now that it knows the classes it refuses what does not go with them.
        (answer,) = fusion.set_parameters([Parameter("class_transition", value=two)])
        assert not answer.successful
        assert allowed in answer.reason
        assert fusion.parameters.class_transition == []


WRONG = {
    "gate_probability:=2.0": ("gate_probability = 2.0", "<= 0.999999"),
    "gate_probabilty:=0.9": ("gate_probabilty", "gate_probability"),
    "decision:=best": ("decision = 'best'", "gda, map"),
    "confirmation_hits:=9": ("confirmation_hits = 9", "confirmation_scans"),
}


@pytest.mark.parametrize("assignment", WRONG)
def test_a_wrong_parameter_stops_start_up_with_one_line(assignment, environment):
    done = subprocess.run(
        [sys.executable, "-m", "gda_tracker.nodes.track_manager", "--ros-args", "-p", assignment],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for word in WRONG[assignment]:
        assert word in lines[0]


def test_an_unknown_class_in_a_parameter_file(environment, tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(
        "/**/rcs_fuzzifier:\n  ros__parameters:\n"
        "    class_names: [false_alarm, fighter, zeppelin, ufo]\n"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "gda_tracker.nodes.rcs_fuzzifier",
            "--ros-args",
            "--params-file",
            path,
        ],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "class_" in done.stderr


@pytest.mark.parametrize("stage", STAGES)
def test_termination_is_quiet_and_ends_with_zero(stage, environment):
    process = subprocess.Popen(
        [sys.executable, "-m", f"gda_tracker.nodes.{stage}"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        with Nodes(lambda **o: [Client(**o)], int(environment["ROS_DOMAIN_ID"])) as nodes:
            client = nodes.nodes[0]
            assert nodes.spin_until(lambda: client.diagnostics, TIMEOUT_S)
        process.terminate()
        out, err = process.communicate(timeout=20)
    finally:
        process.kill()
        process.wait(20)
    assert process.returncode == 0, err
    assert "Traceback" not in out + err
