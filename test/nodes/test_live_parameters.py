"""Parameters that change while the nodes run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from graph_bench import Bench
from graph_helpers import (
    differences,
)
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from gda_tracker.io.messages import (
    detections_to_message,
)
from gda_tracker.tracking.ring import Ring


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
