"""Nodes do the work they are named for: outputs follow from recorded inputs, and matter."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from graph_helpers import TIMEOUT_S, differences, offline, play_in_one_process, scenario_plays

from gda_tracker.association.associate import AssociationParameters, Associator
from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.io import messages
from gda_tracker.io.bags import read_bag
from gda_tracker.kinematics.gating import gate
from gda_tracker.nodes.association import AssociationNode
from gda_tracker.nodes.attribute_fusion import AttributeFusionNode
from gda_tracker.nodes.rcs_fuzzifier import RcsFuzzifierNode
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes, RingProcesses, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.parameters import from_mapping
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.parameters import TrackManagerParameters

METHOD = "gda/dsm_classic/cv"
READERS = {
    "scans": messages.scan_from_message,
    "predictions": messages.predictions_from_message,
    "evidence": messages.evidence_from_message,
    "attribute_scores": messages.attribute_scores_from_message,
    "associations": messages.associations_from_message,
    "tracks": messages.tracks_from_message,
}


@pytest.fixture
def recorded(environment, tmp_path):
    """A run through four processes, recorded: the bag's messages by topic and stamp."""
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    bag = tmp_path / "bag"
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(
            lambda **o: [
                ScanSourceNode({"autostart": False}, plays=plays, collect=True, **o),
                RecorderNode({"bag": str(bag)}, **o),
            ],
            int(environment["ROS_DOMAIN_ID"]),
        ) as nodes,
    ):
        source, recorder = nodes.nodes
        total = len(plays[0].detections)

        def listening() -> bool:
            heard = {s.topic_name: s.get_publisher_count() for s in recorder.subscriptions}
            return all(heard[f"/{topic}"] for topic in READERS)

        source.trigger_configure()
        assert nodes.spin_until(listening, TIMEOUT_S), "the recorder does not hear all stages"
        source.trigger_activate()

        def everything() -> bool:
            return source.finished and all(
                recorder.counters[f"recorded /{topic}"] >= total for topic in READERS
            )

        assert nodes.spin_until(everything, TIMEOUT_S, lambda: None), recorder.counters
        assert not ring.failed()
    found: dict[str, dict[int, object]] = {topic: {} for topic in READERS}
    for record in read_bag(bag):
        topic = record.topic.lstrip("/")
        if topic in READERS:
            value = READERS[topic](record.ros_message())
            found[topic].setdefault(value.key.stamp_ns, value)
    return plays, parameters, found


def bits(message):
    """Every field of a message, arrays as bytes (the wire itself has padding of no value)."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: bits(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if hasattr(message, "tobytes"):
        return message.tobytes()
    if isinstance(message, list | tuple):
        return [bits(item) for item in message]
    return repr(message)


def test_every_output_follows_from_its_recorded_inputs(recorded):
    plays, parameters, found = recorded
    fuzzifier = RcsFuzzifier(
        from_mapping(RcsFuzzifierParameters, parameters.get("rcs_fuzzifier", {}))
    )
    fusion = AttributeFusion(
        from_mapping(AttributeFusionParameters, parameters.get("attribute_fusion", {}))
    )
    associator = Associator(from_mapping(AssociationParameters, parameters.get("association", {})))
    some = next(iter(found["scans"].values()))
    manager = TrackManager(
        from_mapping(TrackManagerParameters, parameters["track_manager"]), epoch=some.key.epoch
    )
    assert manager.initialise(plays[0].initial).outcome == "initialised"
    assert len(found["scans"]) == len(plays[0].detections)
    for detections in plays[0].detections:
        stamp = detections.stamp_ns
        scan, predictions = found["scans"][stamp], found["predictions"][stamp]
        evidence, scores = found["evidence"][stamp], found["attribute_scores"][stamp]
        associations, tracks = found["associations"][stamp], found["tracks"][stamp]
        pairs = gate(scan, predictions)
        assert manager.admit(detections) is None
        opened = manager.open()
        manager.system_uuid = tracks.system_uuid
        for write, made, sent in (
            (messages.scan_to_message, opened.scan, scan),
            (messages.predictions_to_message, opened.predictions, predictions),
            (messages.evidence_to_message, fuzzifier(scan), evidence),
            (
                messages.attribute_scores_to_message,
                fusion(predictions, evidence, pairs.hypothesis, pairs.detection),
                scores,
            ),
            (
                messages.associations_to_message,
                associator(scan, predictions, scores, pairs),
                associations,
            ),
            (
                messages.tracks_to_message,
                manager.close(evidence, scores, associations)[0],
                tracks,
            ),
        ):
            assert bits(write(made)) == bits(write(sent)), (stamp, type(made).__name__)


class LyingFuzzifier(RcsFuzzifierNode):
    """Says big for small and small for big."""

    def compute(self, entry):
        evidence = super().compute(entry)
        columns = [0, 2, 1, *range(3, evidence.masses.shape[1])]
        return replace(evidence, masses=np.ascontiguousarray(evidence.masses[:, columns]))


class LyingFusion(AttributeFusionNode):
    """Gives close pairs the distance of far ones."""

    def compute(self, entry):
        scores = super().compute(entry)
        return replace(scores, distance=1.0 / (scores.distance + 1e-3))


class LyingAssociation(AssociationNode):
    """Assigns nothing."""

    def compute(self, entry):
        found = super().compute(entry)
        return replace(
            found,
            chosen=np.zeros_like(found.chosen),
            assigned_detection=np.full_like(found.assigned_detection, -1),
        )


@pytest.mark.parametrize("liar", [LyingFuzzifier, LyingFusion, LyingAssociation])
def test_a_corrupted_stage_changes_the_tracks(liar, domain):
    plays, parameters = scenario_plays("crossing_targets", METHOD)

    def stages(values, **options):
        honest = stage_nodes(values, **options)
        name = {
            LyingFuzzifier: "rcs_fuzzifier",
            LyingFusion: "attribute_fusion",
            LyingAssociation: "association",
        }[liar]
        kept = []
        for node in honest:
            if node.get_name() == name:
                node.destroy_node()
                kept.append(liar(values.get(name, {}), **options))
            else:
                kept.append(node)
        return kept

    played = play_in_one_process(plays, parameters, domain, stages)
    assert differences(played.tracks, offline(plays, parameters)) != []


def test_time_is_measured_by_the_scans_alone(domain):
    """The same scans played at another pace give the same tracks: no wall clock in the state."""
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    plays[0].detections = plays[0].detections[:6]
    plays[0].truth = plays[0].truth[:6]
    expected = offline(plays, parameters)
    with Nodes(
        lambda **o: [
            ScanSourceNode({"rate": 20.0}, plays=plays, collect=True, **o),
            *stage_nodes(parameters, **o),
        ],
        domain,
    ) as nodes:
        begun = time.monotonic()
        assert nodes.spin_until(lambda: nodes.nodes[0].finished, TIMEOUT_S)
        assert time.monotonic() - begun >= 5 * 5.0 / 20.0
        assert differences(nodes.nodes[0].progress.tracks, expected) == []
