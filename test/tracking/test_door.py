"""The door: every bad input of one scan is named and counted, and touches nothing else."""

import math
import warnings
from collections import Counter

import numpy as np
import pytest
from door_examples import NOISE, detections_of
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gda_tracker.tracking.door import LARGEST_RANGE_M, Rejected, received, validate
from gda_tracker.vocabulary import Detections, ScanKey

NAN, INF = math.nan, math.inf
REASONS = {
    "missing_sensor_id",
    "stamp_out_of_range",
    "too_many_detections",
    "malformed_array",
    "array_length_mismatch",
    "bad_sensor_pose",
}


def admit(detections, limit=5000):
    return validate(detections, NOISE, "map", limit, epoch=9)


def reason_of(detections, limit=5000):
    with pytest.raises(Rejected) as rejection:
        admit(detections, limit)
    return str(rejection.value)


def test_a_good_scan_goes_through_unchanged():
    detections = detections_of(stamp_s=2.0, n=4, frame_id="ignored", sequence=8)
    scan, counts = admit(detections)
    assert scan.key == ScanKey(9, "radar", 2_000_000_000)
    assert scan.frame_id == "map"
    assert counts == Counter()
    np.testing.assert_array_equal(scan.range_m, detections.range_m)
    np.testing.assert_array_equal(scan.azimuth_rad, detections.azimuth_rad)
    np.testing.assert_array_equal(scan.rcs_m2, detections.rcs_m2)
    np.testing.assert_array_equal(scan.source_index, [0, 1, 2, 3])
    assert scan.rcs_valid.all()
    np.testing.assert_array_equal(
        scan.noise_covariance, np.tile(np.diag([30.0**2, 0.005**2]), (4, 1, 1))
    )


def test_the_scan_shares_no_memory_with_what_the_source_sent():
    detections = detections_of(covariance=np.tile(np.diag([900.0, 1e-4]), (3, 1, 1)))
    scan, _ = admit(detections)
    before = scan.range_m.copy(), scan.noise_covariance.copy(), scan.sensor_position_m.copy()
    for values in (
        detections.range_m,
        detections.azimuth_rad,
        detections.covariance,
        detections.sensor_position_m,
        detections.rcs_m2,
    ):
        values[...] = -7.0
    np.testing.assert_array_equal(scan.range_m, before[0])
    np.testing.assert_array_equal(scan.noise_covariance, before[1])
    np.testing.assert_array_equal(scan.sensor_position_m, before[2])
    assert (scan.azimuth_rad >= 0.0).all()
    assert (scan.rcs_m2 > 0.0).all()


# --- single detections


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("range_m", NAN, "not_finite"),
        ("range_m", INF, "not_finite"),
        ("range_m", -INF, "not_finite"),
        ("range_m", -1.0, "negative_range"),
        ("range_m", 0.0, "zero_range"),
        ("range_m", -0.0, "zero_range"),
        ("range_m", 1.1 * LARGEST_RANGE_M, "range_too_large"),
        ("azimuth_rad", NAN, "not_finite"),
        ("azimuth_rad", INF, "not_finite"),
        ("elevation_rad", NAN, "not_finite"),
        ("range_rate_mps", -INF, "not_finite"),
        ("time_offset_s", NAN, "not_finite"),
        ("time_offset_s", -61.0, "time_offset_too_large"),
        ("range_std_m", NAN, "bad_noise"),
        ("range_std_m", INF, "bad_noise"),
        ("range_std_m", -30.0, "bad_noise"),
        ("range_std_m", 0.0, "bad_noise"),
        ("range_std_m", 1e200, "bad_noise"),
        ("azimuth_std_rad", 1e-200, "bad_noise"),
    ],
)
def test_a_bad_detection_is_left_out_and_counted(field, value, reason):
    good = {
        "elevation_rad": np.array([0.01, 0.02, 0.03]),
        "range_rate_mps": np.array([1.0, 2.0, 3.0]),
        "time_offset_s": np.array([0.1, 0.2, 0.3]),
        "range_std_m": np.array([10.0, 20.0, 30.0]),
        "azimuth_std_rad": np.array([0.01, 0.02, 0.03]),
    }
    whole, counts = admit(detections_of(**{k: v.copy() for k, v in good.items()}))
    assert not counts
    bad = detections_of(**good)
    getattr(bad, field)[1] = value
    scan, counts = admit(bad)
    assert counts == Counter({reason: 1})
    np.testing.assert_array_equal(scan.source_index, [0, 2])
    for name in ("range_m", "azimuth_rad", "elevation_rad", "range_rate_mps", "time_offset_s"):
        np.testing.assert_array_equal(getattr(scan, name), getattr(whole, name)[[0, 2]])
    for name in ("noise_covariance", "rcs_m2", "rcs_valid"):
        np.testing.assert_array_equal(getattr(scan, name), getattr(whole, name)[[0, 2]])


def test_a_detection_with_many_faults_is_counted_once():
    scan, counts = admit(
        detections_of(
            n=2,
            range_m=np.array([-INF, -5.0]),
            azimuth_rad=np.array([NAN, 9.0]),
            range_std_m=np.array([-1.0, -1.0]),
            rcs_m2=np.array([NAN, NAN]),
        )
    )
    assert len(scan) == 0
    assert counts == Counter({"not_finite": 1, "negative_range": 1})


@pytest.mark.parametrize(
    ("azimuth", "expected", "wrapped"),
    [
        (math.pi, math.pi, 0),
        (-math.pi, -math.pi, 0),
        (math.pi + 0.25, -math.pi + 0.25, 1),
        (-math.pi - 0.25, math.pi - 0.25, 1),
        (7 * math.pi / 2, -math.pi / 2, 1),
        (1000.5, 1000.5 - 2 * math.pi * 159, 1),
        (3.0, 3.0, 0),
    ],
)
def test_azimuth_beyond_pi_is_wrapped_and_counted(azimuth, expected, wrapped):
    scan, counts = admit(detections_of(n=1, azimuth_rad=np.array([azimuth])))
    assert scan.azimuth_rad[0] == pytest.approx(expected, abs=1e-12)
    assert counts["azimuth_wrapped"] == wrapped


def test_a_huge_azimuth_is_some_angle():
    scan, counts = admit(detections_of(n=1, azimuth_rad=np.array([1e300])))
    assert abs(scan.azimuth_rad[0]) <= math.pi
    assert counts == Counter({"azimuth_wrapped": 1})


@pytest.mark.parametrize(
    ("rcs", "valid", "known", "counted"),
    [
        ([1.0, 2.0, 3.0], None, [True, True, True], {}),
        ([1.0, 2.0, 3.0], [True, False, True], [True, False, True], {}),
        ([1.0, NAN, 3.0], None, [True, False, True], {"rcs_not_finite": 1}),
        ([1.0, INF, -2.0], None, [True, False, False], {"rcs_not_finite": 1, "rcs_negative": 1}),
        # What was marked as not valid is unknown, not a fault.
        ([1.0, NAN, 3.0], [True, False, True], [True, False, True], {}),
        ([0.0, 2.0, 3.0], None, [True, True, True], {}),
        (None, None, [False] * 3, {}),
        (None, [True, True, True], [False] * 3, {}),
    ],
)
def test_a_bad_rcs_makes_the_rcs_unknown_and_keeps_the_detection(rcs, valid, known, counted):
    scan, counts = admit(
        detections_of(
            rcs_m2=None if rcs is None else np.array(rcs),
            rcs_valid=None if valid is None else np.array(valid),
        )
    )
    assert len(scan) == 3
    np.testing.assert_array_equal(scan.rcs_valid, known)
    np.testing.assert_array_equal(scan.rcs_m2, np.where(known, rcs if rcs else 0.0, 0.0))
    assert counts == Counter(counted)


# --- noise


def test_own_deviations_for_each_for_all_or_none():
    scan, _ = admit(
        detections_of(
            range_std_m=np.array([1.0, 2.0, 3.0]),
            azimuth_std_rad=np.array([0.1]),
            elevation_rad=np.zeros(3),
            range_rate_mps=np.zeros(3),
        )
    )
    deviations = np.sqrt(np.diagonal(scan.noise_covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(deviations, [[r, 0.1, 0.01, 1.0] for r in (1.0, 2.0, 3.0)])


def test_a_covariance_is_taken_over_the_measured_quantities_and_made_symmetric():
    given_covariance = np.array([[900.0, 0.03], [0.03 * (1 + 1e-9), 1e-4]])
    scan, counts = admit(detections_of(n=1, covariance=given_covariance[None]))
    assert not counts
    np.testing.assert_array_equal(scan.noise_covariance, scan.noise_covariance.transpose(0, 2, 1))
    np.testing.assert_allclose(scan.noise_covariance[0], given_covariance, rtol=1e-8)
    with_rate = detections_of(range_rate_mps=np.zeros(3), covariance=np.tile(np.eye(3), (3, 1, 1)))
    assert admit(with_rate)[0].noise_covariance.shape == (3, 3, 3)
    without_rate = detections_of(covariance=np.tile(np.eye(3), (3, 1, 1)))
    assert reason_of(without_rate) == "array_length_mismatch"


@pytest.mark.parametrize(
    "bad",
    [
        [[1.0, 2.0], [2.0, 1.0]],  # indefinite
        [[1.0, 1.0], [1.0, 1.0]],  # singular
        [[-1.0, 0.0], [0.0, -1.0]],  # both minors of -R are good
        [[900.0, 0.02], [0.0, 1e-4]],  # not symmetric
        [[NAN, 0.0], [0.0, 1.0]],
        [[1.0, INF], [INF, 1.0]],
        [[0.0, 0.0], [0.0, 0.0]],
        [[1e30, 0.0], [0.0, 1.0]],
    ],
)
def test_a_bad_covariance_costs_its_detection_alone(bad):
    covariance = np.array([np.diag([900.0, 1e-4]), bad, np.diag([400.0, 1e-6])])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scan, counts = admit(detections_of(covariance=covariance))
    assert counts == Counter({"bad_noise": 1})
    np.testing.assert_array_equal(scan.noise_covariance, covariance[[0, 2]])


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3, 4]))
def test_definite_and_indefinite_covariances_are_told_apart(seed, d):
    """Against eigenvalues, whatever the units."""
    rng = np.random.default_rng(seed)
    n = 8
    vectors = np.linalg.qr(rng.normal(size=(n, d, d)))[0]
    values = rng.uniform(0.1, 1.0, (n, d))
    definite = rng.random(n) < 0.5
    values[~definite, 0] *= -1.0
    scale = 10.0 ** rng.uniform(-5, 5, d)
    covariance = (vectors * values[:, None, :]) @ vectors.transpose(0, 2, 1)
    covariance = covariance * scale[:, None] * scale
    extra = {"elevation_rad": np.zeros(n)} if d > 2 else {}
    extra |= {"range_rate_mps": np.zeros(n)} if d > 3 else {}
    scan, counts = admit(detections_of(n=n, covariance=covariance, **extra))
    np.testing.assert_array_equal(scan.source_index, np.flatnonzero(definite))
    assert counts["bad_noise"] == np.count_nonzero(~definite)


# --- whole scans


@pytest.mark.parametrize(
    "name",
    [
        "azimuth_rad",
        "elevation_rad",
        "range_rate_mps",
        "rcs_m2",
        "rcs_valid",
        "time_offset_s",
        "range_std_m",
        "azimuth_std_rad",
        "elevation_std_rad",
        "range_rate_std_mps",
    ],
)
@pytest.mark.parametrize("length", [0, 2, 4])
def test_arrays_of_different_lengths_reject_the_scan(name, length):
    bad = detections_of(**{name: np.ones(length, dtype=bool if name == "rcs_valid" else float)})
    assert reason_of(bad) == "array_length_mismatch"


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"sensor_id": ""}, "missing_sensor_id"),
        ({"sensor_id": None}, "missing_sensor_id"),
        ({"range_m": np.ones((3, 1))}, "malformed_array"),
        ({"range_m": np.array(3.0)}, "malformed_array"),
        ({"range_m": None}, "malformed_array"),
        ({"range_m": ["far", "near", "here"]}, "malformed_array"),
        ({"azimuth_rad": [[1.0], [1.0, 2.0], [0.0]]}, "malformed_array"),
        ({"azimuth_rad": None}, "malformed_array"),
        ({"rcs_valid": np.ones((3, 3), dtype=bool)}, "malformed_array"),
        ({"covariance": "R"}, "malformed_array"),
        ({"covariance": np.ones((3, 2))}, "array_length_mismatch"),
        ({"sensor_position_m": np.array([0.0, NAN, 0.0])}, "bad_sensor_pose"),
        ({"sensor_position_m": np.array([0.0, INF, 0.0])}, "bad_sensor_pose"),
        ({"sensor_position_m": np.array([1e200, 0.0, 0.0])}, "bad_sensor_pose"),
        ({"sensor_position_m": np.zeros(2)}, "bad_sensor_pose"),
        ({"sensor_position_m": None}, "bad_sensor_pose"),
        ({"sensor_orientation_xyzw": np.array([0.0, 0.0, 0.0, 0.9])}, "bad_sensor_pose"),
        ({"sensor_orientation_xyzw": np.full(4, NAN)}, "bad_sensor_pose"),
        ({"sensor_orientation_xyzw": np.array([0.0, 0.0, 1e200, 0.0])}, "bad_sensor_pose"),
        ({"sensor_orientation_xyzw": np.zeros(3)}, "bad_sensor_pose"),
    ],
)
def test_a_fault_of_the_whole_scan_rejects_it(fields, reason):
    bad = detections_of(**{k: v for k, v in fields.items() if k != "sensor_id"})
    if "sensor_id" in fields:
        bad.sensor_id = fields["sensor_id"]
    assert reason_of(bad) == reason


@pytest.mark.parametrize("stamp", [-1, 2**63, 10**30, NAN, 1.5, None, "now"])
def test_a_stamp_that_is_none_rejects_the_scan(stamp):
    bad = detections_of()
    bad.stamp_ns = stamp
    assert reason_of(bad) == "stamp_out_of_range"


@pytest.mark.parametrize("stamp", [0, 2**63 - 1, np.int64(5)])
def test_the_key_holds_a_plain_integer(stamp):
    good = detections_of()
    good.stamp_ns = stamp
    assert type(admit(good)[0].key.stamp_ns) is int


def test_a_hundred_thousand_detections_are_refused_by_their_number():
    flood = detections_of(n=100_000, azimuth_rad=np.zeros(5))
    assert received(flood) == 100_000
    assert reason_of(flood) == "too_many_detections"
    assert len(admit(detections_of(n=5000))[0]) == 5000
    assert reason_of(detections_of(n=5001)) == "too_many_detections"


def test_a_hundred_thousand_detections_pass_where_they_are_allowed():
    scan, _ = admit(detections_of(n=100_000), limit=100_000)
    assert len(scan) == 100_000


def test_an_empty_scan_is_a_scan():
    scan, counts = admit(detections_of(n=0, elevation_rad=np.zeros(0), time_offset_s=np.zeros(0)))
    assert len(scan) == 0
    assert scan.noise_covariance.shape == (0, 3, 3)
    assert not counts
    scan, _ = admit(detections_of(n=0, covariance=np.zeros((0, 2, 2)), range_std_m=np.array([3.0])))
    assert scan.noise_covariance.shape == (0, 2, 2)


def test_an_orientation_is_made_a_unit_quaternion_and_zeros_mean_none():
    rough = np.array([0.1, 0.2, 0.3, 0.927], dtype=np.float32)
    scan, _ = admit(detections_of(sensor_orientation_xyzw=rough))
    assert np.linalg.norm(scan.sensor_orientation_xyzw) == pytest.approx(1.0, abs=1e-15)
    scan, _ = admit(detections_of(sensor_orientation_xyzw=np.zeros(4)))
    np.testing.assert_array_equal(scan.sensor_orientation_xyzw, [0, 0, 0, 1])


def test_plain_lists_and_single_precision_are_taken():
    bad = detections_of(range_m=[100, 200, 300], azimuth_rad=np.zeros(3, dtype=np.float32))
    scan, _ = admit(bad)
    assert scan.range_m.dtype == scan.azimuth_rad.dtype == np.float64
    np.testing.assert_array_equal(scan.range_m, [100.0, 200.0, 300.0])


# --- anything at all

SIZES = st.integers(0, 6)
HARD = st.one_of(
    st.floats(),
    st.sampled_from([0.0, -0.0, 1e-320, 1e308, -1e308, NAN, INF, -INF, math.pi, 4.0, 1e9, 2e9]),
    st.floats(1.0, 5e4),
)


@st.composite
def columns(draw, n):
    kind = draw(st.sampled_from(["good", "good", "good", "none", "length", "shape", "text"]))
    if kind == "none":
        return None
    if kind == "text":
        return draw(st.sampled_from(["abc", ["a"] * n, 5, [None] * n, {}, object()]))
    shape = {"good": (n,), "length": draw(SIZES), "shape": (n, 2)}[kind]
    return draw(arrays(np.float64, shape, elements=HARD))


@st.composite
def garbage(draw):
    n = draw(SIZES)
    names = ["range_m", "azimuth_rad"]
    optional = [
        "elevation_rad",
        "range_rate_mps",
        "rcs_m2",
        "rcs_valid",
        "range_std_m",
        "azimuth_std_rad",
        "elevation_std_rad",
        "range_rate_std_mps",
        "time_offset_s",
    ]
    names += draw(st.lists(st.sampled_from(optional), unique=True, max_size=4))
    fields = {name: draw(columns(n)) for name in names}
    if draw(st.booleans()):
        d = draw(st.sampled_from([2, 3, 4]))
        fields["covariance"] = draw(arrays(np.float64, (n, d, d), elements=HARD))
    pose = st.one_of(st.just(np.zeros(3)), arrays(np.float64, st.integers(2, 4), elements=HARD))
    fields["sensor_position_m"] = draw(pose)
    if draw(st.booleans()):
        fields["sensor_orientation_xyzw"] = draw(arrays(np.float64, 4, elements=HARD))
    sensor_id = draw(st.sampled_from(["radar", "radar", "radar", "", None, 3]))
    stamp = draw(st.one_of(st.integers(0, 2**63 - 1), st.integers(), st.floats(), st.none()))
    return Detections(sensor_id, stamp, **fields)


@settings(derandomize=True, deadline=None, max_examples=150)
@given(garbage())
def test_garbage_is_rejected_by_name_or_admitted_clean(detections):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            scan, counts = admit(detections)
        except Rejected as rejection:
            reason = str(rejection)
        else:
            reason = ""
    if reason:
        assert reason in REASONS
        return
    n = len(scan)
    left_out = sum(
        count
        for reason, count in counts.items()
        if reason not in ("azimuth_wrapped", "rcs_not_finite", "rcs_negative")
    )
    assert n + left_out == received(detections)
    assert (scan.range_m > 0.0).all()
    assert (np.abs(scan.azimuth_rad) <= math.pi).all()
    assert np.isfinite(scan.rcs_m2).all()
    for values in (scan.range_m, scan.elevation_rad, scan.range_rate_mps, scan.time_offset_s):
        assert values is None or (len(values) == n and np.isfinite(values).all())
    np.testing.assert_array_equal(scan.noise_covariance, scan.noise_covariance.transpose(0, 2, 1))
    for covariance in scan.noise_covariance:
        scale = np.sqrt(np.diag(covariance))
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > 0.0


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.data())
def test_garbage_in_one_row_never_changes_another(data):
    """The same scan with one row overwritten: the other rows come out bit for bit the same."""
    names = ["range_m", "azimuth_rad", "elevation_rad", "rcs_m2", "time_offset_s", "range_std_m"]
    clean = detections_of(
        n=5,
        elevation_rad=np.full(5, 0.1),
        time_offset_s=np.linspace(-1, 1, 5),
        range_std_m=np.full(5, 20.0),
    )
    dirty = detections_of(n=5, **{name: getattr(clean, name).copy() for name in names})
    row = data.draw(st.integers(0, 4))
    for name in names:
        getattr(dirty, name)[row] = data.draw(HARD)
    before, _ = admit(clean)
    after, _ = admit(dirty)
    others = np.flatnonzero(before.source_index != row)
    same = np.flatnonzero(after.source_index != row)
    for name in (
        "source_index",
        "range_m",
        "azimuth_rad",
        "elevation_rad",
        "time_offset_s",
        "noise_covariance",
        "rcs_m2",
        "rcs_valid",
    ):
        np.testing.assert_array_equal(getattr(after, name)[same], getattr(before, name)[others])
