"""Bad input over the topics: named, counted, answered; other scans are untouched."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from graph_bench import Bench, spoil
from graph_helpers import (
    differences,
    with_statements,
)
from rclpy.parameter import Parameter

from gda_tracker.nodes.qualities import latched


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
