from __future__ import annotations

import dataclasses

import message_examples as examples
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from gda_tracker_msgs.msg import DetectionArray, Scan
from message_examples import assert_identical
from rclpy.serialization import deserialize_message, serialize_message

from gda_tracker.io import messages
from gda_tracker.io.fields import LARGEST_STAMP_NS
from gda_tracker.io.messages import MessageError


def over_the_wire(message):
    """Serialise and deserialise, as a topic does."""
    return deserialize_message(serialize_message(message), type(message))


def test_fields_are_checked_in_these_tests():
    with pytest.raises(AssertionError):
        DetectionArray().sequence = -1


ROUND_TRIPS = {
    "detections": ("detections", [examples.detections(), examples.detections(3, full=False)]),
    "detections, none": ("detections", [examples.detections(0, full=False)]),
    "scan": ("scan", [examples.scan(), examples.scan(3, full=False), examples.scan(0, full=False)]),
    "evidence": ("evidence", [examples.evidence(), examples.evidence(0), examples.evidence(3, 0)]),
    "predictions": (
        "predictions",
        [
            examples.predictions(),
            examples.predictions(300, 1),
            examples.predictions(0),
            examples.predictions(3, 1, 0),
            examples.predictions(policy="forgetting"),
            examples.predictions(policy="window", rows=6),
            examples.predictions(policy="window"),
            examples.shared_predictions(),
        ],
    ),
    "attribute_scores": (
        "attribute_scores",
        [
            examples.attribute_scores(),
            examples.attribute_scores(0, 0),
            examples.attribute_scores(2, 1, 0),
            examples.attribute_scores(updated=3),
        ],
    ),
    "associations": (
        "associations",
        [
            examples.associations(),
            examples.associations(0, 0, 0),
            examples.shared_associations(),
            examples.shared_associations(0),
        ],
    ),
    "statement": ("statement", [examples.statement(), examples.statement(0)]),
    "statement_report": ("statement_report", [examples.statement_report()]),
    "tracks": ("tracks", [examples.tracks(), examples.tracks(0)]),
    "track_sets": ("track_sets", [examples.track_sets(), examples.track_sets(0)]),
    "scan_report": ("scan_report", [examples.scan_report()]),
    "scan_truth": (
        "scan_truth",
        [
            examples.scan_truth(),
            examples.scan_truth(0),
            examples.scan_truth(2, labelled=False),
        ],
    ),
}


@pytest.mark.parametrize("name", ROUND_TRIPS)
def test_round_trip_keeps_every_bit(name):
    stem, objects = ROUND_TRIPS[name]
    to_message = getattr(messages, f"{stem}_to_message")
    from_message = getattr(messages, f"{stem}_from_message")
    for original in objects:
        assert_identical(from_message(over_the_wire(to_message(original))), original)


def test_every_class_of_the_vocabulary_has_a_pair():
    import gda_tracker.vocabulary as vocabulary

    inside = {
        "Recording",
        "AssociationSettings",
        "ScanKey",
        "StatementPiece",
        "StatementRegion",
    }
    classes = [
        name
        for name in vocabulary.__all__
        if dataclasses.is_dataclass(getattr(vocabulary, name)) and name not in inside
    ]
    tested = {type(objects[0]).__name__ for _, objects in ROUND_TRIPS.values()}
    assert sorted(classes) == sorted(tested)


def test_arrays_are_read_only_views():
    message = messages.scan_to_message(examples.scan())
    scan = messages.scan_from_message(message)
    with pytest.raises(ValueError, match="read-only"):
        scan.range_m[0] = 1.0
    message.range_m[1] = 12.5
    assert scan.range_m[1] == 12.5


def test_transposed_arrays_are_written_row_major():
    original = examples.evidence()
    original.masses = np.asfortranarray(original.masses)
    message = messages.evidence_to_message(original)
    assert np.array(message.masses).tobytes() == original.masses.tobytes("C")


def test_a_scan_without_detections_has_no_measured_quantities():
    original = examples.detections(0)
    read = messages.detections_from_message(messages.detections_to_message(original))
    assert [read.elevation_rad, read.rcs_m2, read.rcs_valid] == [None, None, None]
    assert len(read.range_m) == 0


# --- foreign publishers ---------------------------------------------------------------------------


def test_detections_of_mismatched_lengths_are_handed_on():
    message = DetectionArray()
    message.range_m = [1.0, 2.0, 3.0]
    message.azimuth_rad = [0.5]
    message.rcs_m2 = [0.1, 0.2]
    message.rcs_valid = [1, 0, 7, 1]
    message.range_std_m = [1.0, 2.0]
    read = messages.detections_from_message(over_the_wire(message))
    lengths = [
        len(values)
        for values in (
            read.range_m,
            read.azimuth_rad,
            read.rcs_m2,
            read.rcs_valid,
            read.range_std_m,
        )
    ]
    assert lengths == [3, 1, 2, 4, 2]
    assert read.rcs_valid.tolist() == [True, False, True, True]


def test_attributes_of_mismatched_lengths_are_handed_on():
    message = DetectionArray()
    message.range_m = message.azimuth_rad = [1.0, 2.0]
    message.attribute_names = ["length_m", "esm_class"]
    message.attribute_values = [1.0, 2.0, 3.0]
    message.attribute_valid = [1, 0, 0, 1]
    read = messages.detections_from_message(over_the_wire(message))
    assert read.attribute_names == ("length_m", "esm_class")
    assert read.attribute_values.tolist() == [1.0, 2.0, 3.0]
    assert read.attribute_valid.tolist() == [[True, False], [False, True]]
    message.attribute_names = []
    assert len(messages.detections_from_message(message).attribute_values) == 3


def test_attributes_of_a_scan_without_detections():
    original = examples.detections(0)
    read = messages.detections_from_message(messages.detections_to_message(original))
    assert read.attribute_names == original.attribute_names
    assert read.attribute_values.shape == (2, 0)


def test_orientation_of_zeros_is_the_identity():
    read = messages.detections_from_message(DetectionArray())
    assert read.sensor_orientation_xyzw.tolist() == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("size", [1, 7, 9])
def test_covariance_that_does_not_fit_is_named(size):
    message = DetectionArray()
    message.range_m = message.azimuth_rad = [1.0, 2.0]
    message.covariance = [1.0] * size
    with pytest.raises(
        MessageError, match=f"^covariance has {size} elements, 2 x 2 x 2 expected$"
    ) as caught:
        messages.detections_from_message(message)
    assert caught.value.reason == str(caught.value)


# --- sizes on the ring ----------------------------------------------------------------------------

CUT = [
    (stem, field)
    for stem, fields in {
        "scan": "source_index azimuth_rad elevation_rad range_rate_mps noise_covariance rcs_m2 "
        "rcs_valid time_offset_s attribute_names attribute_values attribute_valid",
        "evidence": "masses log_class_likelihood class_probability",
        "predictions": "parent_id track_id detection_probability component_start "
        "component_weight component_model component_mean component_covariance masses "
        "class_probability",
        "attribute_scores": "detection distance log_likelihood conflict informative masses "
        "class_probability updated_hypothesis updated_masses updated_class_probability",
        "associations": "detection mahalanobis_squared kinematic_log_likelihood "
        "attribute_log_likelihood p_kinematic p_attribute p_generalised joint_marginal chosen "
        "cluster cluster_converged",
        "scan_report": "rejected_counts",
        "scan_truth": "target_class target_state",
    }.items()
    for field in fields.split()
]


@pytest.mark.parametrize(("stem", "field"), CUT)
def test_a_field_that_lacks_an_element_is_refused(stem, field):
    filled = {"updated": 2} if field.startswith("updated") else {}
    message = getattr(messages, f"{stem}_to_message")(getattr(examples, stem)(**filled))
    setattr(message, field, getattr(message, field)[:-1])
    with pytest.raises(MessageError, match=r"elements|component_start"):
        getattr(messages, f"{stem}_from_message")(message)


@pytest.mark.parametrize(
    "field", ["window_focal", "window_kind", "window_masses", "window_log_class_likelihood"]
)
def test_a_window_that_lacks_an_element_is_refused(field):
    message = messages.predictions_to_message(examples.predictions(policy="window", rows=3))
    setattr(message, field, getattr(message, field)[:-1])
    with pytest.raises(MessageError, match="window_.* elements"):
        messages.predictions_from_message(message)
    # Nor is one without rows that has anything else.
    if field != "window_kind":
        message.window_kind = []
        with pytest.raises(MessageError, match="has elements, window_kind has none"):
            messages.predictions_from_message(message)


def test_settings_of_histories_that_do_not_fit_are_refused():
    message = messages.predictions_to_message(examples.predictions(policy="window", rows=3))
    message.window_kind[4] = 3
    with pytest.raises(MessageError, match="window_kind holds 3: allowed is 0 to 2"):
        messages.predictions_from_message(message)
    message = messages.predictions_to_message(examples.predictions(policy="forgetting"))
    message.forgetting_factor = [0.5, 0.5]
    with pytest.raises(MessageError, match="forgetting_factor has 2 elements, 1 expected"):
        messages.predictions_from_message(message)


def test_predictions_of_before_there_were_policies_have_none():
    message = messages.predictions_to_message(examples.predictions())
    message.history_policy = ""
    assert messages.predictions_from_message(message).settings.history_policy == "none"


@pytest.mark.parametrize("start", [[1, 2, 4, 6, 8, 10], [0, 4, 2, 6, 8, 10], [0, 2, 4, 6, 8, 9]])
def test_component_rows_must_rise(start):
    message = messages.predictions_to_message(examples.predictions(5, 2))
    message.component_start = start
    with pytest.raises(MessageError, match="component_start does not rise from 0 to 10"):
        messages.predictions_from_message(message)


def test_small_indices_that_do_not_fit_are_refused():
    predictions = examples.predictions()
    predictions.component_model[3] = 256
    with pytest.raises(MessageError, match="component_model holds 256: allowed is 0 to 255"):
        messages.predictions_to_message(predictions)
    associations = examples.associations()
    associations.cluster_engine[0] = -1
    with pytest.raises(MessageError, match="cluster_engine holds -1"):
        messages.associations_to_message(associations)


def test_a_statement_published_by_hand_has_defaults():
    from gda_tracker_msgs.msg import Statement, StatementPiece

    message = Statement(pieces=[StatementPiece()])
    read = messages.statement_from_message(over_the_wire(message))
    assert (read.reliability, read.pieces[0].mass) == (1.0, 1.0)


def test_numbers_that_do_not_fit_are_refused():
    report = examples.scan_report()
    report.retries = -1
    with pytest.raises(MessageError, match="retries = -1: allowed is 0 to 4294967295"):
        messages.scan_report_to_message(report)
    scan = examples.scan()
    scan.key = scan.key._replace(epoch=2**64)
    with pytest.raises(MessageError, match="key.epoch"):
        messages.scan_to_message(scan)
    truth = examples.scan_truth()
    truth.run = 2**31
    with pytest.raises(MessageError, match="run = 2147483648"):
        messages.scan_truth_to_message(truth)


def test_scalars_of_numpy_are_cast():
    original = examples.scan_report()
    original.latency_s = np.float32(0.5)
    original.retries = np.int64(5)
    original.repeated = np.bool_(True)
    message = over_the_wire(messages.scan_report_to_message(original))
    assert (message.latency_s, message.retries, message.repeated) == (0.5, 5, True)


# --- stamps ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 10**9, 1_620_205_606_919_338_123, 2**60])
def test_stamps_are_exact(stamp):
    time = messages.stamp_to_time(stamp)
    assert time.sec * 10**9 + time.nanosec == stamp
    assert messages.stamp_from_time(time) == stamp


def test_largest_stamp():
    assert messages.stamp_from_time(messages.stamp_to_time(LARGEST_STAMP_NS)) == LARGEST_STAMP_NS


@pytest.mark.parametrize("stamp", [-1, LARGEST_STAMP_NS + 1, 2**63])
def test_stamps_out_of_range_are_refused(stamp):
    with pytest.raises(MessageError, match=f"^stamp = {stamp} ns: allowed is 0 to"):
        messages.stamp_to_time(stamp)
    with pytest.raises(MessageError, match="header.stamp"):
        messages.detections_to_message(dataclasses.replace(examples.detections(), stamp_ns=stamp))


@pytest.mark.parametrize("time", [Time(sec=-1, nanosec=5), Time(sec=3, nanosec=10**9)])
def test_times_that_are_none_are_refused(time):
    message = DetectionArray()
    message.header.stamp = time
    with pytest.raises(MessageError, match="^header.stamp = "):
        messages.detections_from_message(message)


# --- size budget ----------------------------------------------------------------------------------


def test_a_scan_of_the_largest_budget_stays_under_4_mb(capsys):
    """2000 hypotheses, 6000 gated pairs, 19 focal columns, 500 detections, in bytes on the wire."""
    hypotheses, pairs, detections = 2000, 6000, 500
    wire = [
        messages.scan_to_message(examples.scan(detections)),
        messages.evidence_to_message(examples.evidence(detections)),
        messages.predictions_to_message(examples.predictions(hypotheses, 1)),
        messages.attribute_scores_to_message(examples.attribute_scores(pairs, detections)),
        messages.associations_to_message(examples.associations(pairs, hypotheses, 200)),
    ]
    sizes = {type(message).__name__: len(serialize_message(message)) for message in wire}
    total = sum(sizes.values())
    with capsys.disabled():
        parts = ", ".join(f"{name} {size / 1e6:.2f}" for name, size in sizes.items())
        print(f"\nsize of the largest scan: {total / 1e6:.2f} MB ({parts})")
    assert total < 4_000_000
    assert isinstance(wire[0], Scan)
