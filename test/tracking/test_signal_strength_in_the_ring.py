"""Signal strength in the ring: against (2.49), in every decision, and off without a trace."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import invgamma
from tracking_examples import assert_same, moving, ring_of, scan_at, simulated

from gda_tracker.association.log_ratios import log_ratios
from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.evaluation.explanation import explain, explanation_lines
from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.pair_strengths import log_detected_ratio, pair_log_ratio
from gda_tracker.kinematics.signal_strength import (
    Strengths,
    detection_probability,
    log_clutter_density,
    log_scan_ratio,
    log_signal_density,
    update_detected,
    update_missed,
    update_strength,
)
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.checkpoint import load, save
from gda_tracker.tracking.extraction import scan_increments
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.signal_strength import (
    STRONGEST_SIGNAL,
    prior,
    starts,
    update_strengths_by_marginals,
    with_signals,
)
from gda_tracker.vocabulary import Detections

ON = {"signal_strength": "swerling_1", "attribute_term": "none", "filter": "cv"}
DECISIONS = ("gda", "map", "jpda", "mht")
P = TrackManagerParameters(**ON)
LAMBDA = P.signal_threshold


def strong(scan: Detections, signal, name="snr") -> Detections:
    """The scan with strengths (n,)."""
    return replace(scan, attribute_names=(name,), attribute_values=np.array([signal], dtype=float))


def with_strengths(n_scans=25, seed=1, **fields) -> list[Detections]:
    """Crossing targets among false detections, all with strengths of their own."""
    rng = np.random.default_rng(seed)
    return [
        strong(scan, LAMBDA + rng.exponential(8.0, len(scan.range_m)))
        for scan in simulated(n_scans, seed=seed, **fields)
    ]


def one_target(signals) -> list[Detections]:
    """A target that flies straight on, detected with these strengths, NaN for a miss."""
    return [
        strong(scan_at(k, moving(k) if s == s else np.zeros((0, 2))), [s] if s == s else [])
        for k, s in enumerate(signals)
    ]


# --- the algebra ---------------------------------------------------------------------------------


@given(st.floats(0.5, 200.0), st.floats(1.0, 500.0), st.floats(0.1, 20.0), st.floats(0.0, 10.0))
@settings(max_examples=8, deadline=None)
def test_the_ratio_makes_of_p_d_and_clutter_what_2_49_has(a, theta, lambda_, c):
    """P_D ratio = s / c with s of (2.49), and the ratio is one on average over clutter."""
    b = a * theta
    known, z = Strengths(np.array([a]), np.array([b])), np.array([lambda_ * 1.7])
    ratio = log_detected_ratio(known, z, lambda_, c)
    seen = np.log(detection_probability(known, lambda_))
    direct = log_signal_density(known, z) - log_clutter_density(z, lambda_, c)
    np.testing.assert_allclose(seen + ratio, direct, rtol=1e-9, atol=1e-9)

    def density(excess):
        signal = np.array([lambda_ + excess])
        value = log_detected_ratio(known, signal, lambda_, c)
        return float(np.exp(value + log_clutter_density(signal, lambda_, c))[0])

    # Half of the detections exceed the median; the tail by the substitution u = 1 / excess.
    middle = (b + lambda_) * (2.0 ** (1.0 / a) - 1.0)
    low = quad(density, 0.0, middle)[0]
    high = quad(lambda u: density(middle / u) * middle / u**2, 0.0, 1.0)[0]
    assert low == pytest.approx(0.5, abs=1e-6)
    assert low + high == pytest.approx(1.0, abs=1e-5)


def test_the_ratio_is_that_of_sampled_targets():
    """Monte Carlo: draw theta, then signals above the threshold; compare with the density."""
    rng = np.random.default_rng(3)
    a, b = 3.0, 20.0
    signal = rng.exponential(invgamma.rvs(a, scale=b, size=200_000, random_state=rng))
    signal = signal[signal > LAMBDA]
    edges = LAMBDA + np.array([0.0, 1.0, 3.0, 8.0, 20.0, 60.0])
    share = np.histogram(signal, edges)[0] / len(signal)
    known = Strengths(np.array([a]), np.array([b]))

    def density(z):
        z = np.array([z])
        ratio = log_detected_ratio(known, z, LAMBDA)
        return float(np.exp(ratio + log_clutter_density(z, LAMBDA))[0])

    for low, high, found in zip(edges, edges[1:], share, strict=False):
        expected = quad(density, low, high)[0]
        error = np.sqrt(expected * (1.0 - expected) / len(signal))
        assert abs(found - expected) < 4.0 * error


def opened_ring(decision, **parameters):
    """A ring with one track and two detections in its gate on the scan that is open."""
    ring = ring_of(**{**ON, "decision": decision, **parameters})
    for scan in one_target([9.0, 30.0, 12.0, np.nan, 25.0]):
        ring.process(scan)
    near = moving(5.0) + np.array([[4.0, 2.0], [-9.0, 6.0]])
    ring.manager.admit(strong(scan_at(5.0, near), [7.0, 22.0]))
    return ring, ring.manager.open()


@pytest.mark.parametrize("decision", DECISIONS)
def test_all_decisions_weigh_pairs_as_2_49_does(decision):
    ring, opened = opened_ring(
        decision, clutter_density_per_m_rad=1e-3, clutter_signal_strength=0.5
    )
    scan, told = opened.scan, opened.predictions
    known = Strengths(told.strength_shape, told.strength_scale)
    pairs = gate(scan, told)
    assert len(pairs) == 2
    ratio = pair_log_ratio(scan, told, pairs.hypothesis, pairs.detection)
    kinematic = pairs.log_likelihood - ratio
    assert_same(kinematic, kinematic + 0.0)
    total, weight = log_scan_ratio(
        known, kinematic[None, :], scan.signal_strength[None, :], 1e-3, LAMBDA, 0.5
    )
    scores = ring.fusion(told, ring.fuzzifier(scan), pairs.hypothesis, pairs.detection)
    found = ring.associate(scan, told, scores, pairs)
    np.testing.assert_allclose(found.joint_marginal, weight[0, 1:], rtol=1e-10)
    if decision == "mht":
        pair, miss = log_ratios(
            pairs.hypothesis,
            pairs.detection,
            pairs.log_likelihood,
            None,
            None,
            told.detection_probability,
            told.settings.clutter_density,
        )
        np.testing.assert_allclose(np.logaddexp.reduce([*pair, *miss]), total[0], rtol=1e-12)
    # The sequential test has the same sum, but that a miss includes what lies outside the gate.
    told.settings = replace(told.settings, gate_probability=1.0)
    alone = replace(found, assigned_detection=np.full(1, -1, dtype=np.int32))
    gained = scan_increments(told, None, alone, np.full(1, 1e-3))
    np.testing.assert_allclose(gained, total, rtol=1e-12)


def test_the_mixture_of_jpda_is_that_of_the_filter():
    _, opened = opened_ring("jpda")
    table, scan = opened.table.copy(), opened.scan
    known = Strengths(table.strength[:, 0], table.strength[:, 1])
    told = type("Marginals", (), {})()
    told.hypothesis, told.detection = np.array([0, 0]), np.array([0, 1])
    told.joint_marginal = np.array([0.3, 0.5])
    update_strengths_by_marginals(table, scan, told, LAMBDA)
    expected = update_strength(
        known, np.array([[0.2, 0.3, 0.5]]), scan.signal_strength[None, :], LAMBDA
    )
    np.testing.assert_allclose(table.strength[0], [expected.shape[0], expected.scale[0]])


# --- what a track knows --------------------------------------------------------------------------


@pytest.mark.parametrize("decision", DECISIONS)
def test_a_track_knows_what_bayes_makes_of_its_signals(decision):
    """Detections and misses of one target, without clutter: the exact filter, step by step."""
    signals = [9.0, 30.0, 12.0, np.nan, 25.0, np.nan, 8.0]
    ring = ring_of(
        **{**ON, "decision": decision, "signal_strength_memory_s": 1e9},
        clutter_density_per_m_rad=1e-12,
    )
    known = prior(1, P)
    for k, scan in enumerate(one_target(signals)):
        result = ring.process(scan)
        if k > 1:
            told = result.predictions
            np.testing.assert_allclose(told.strength_shape, known.shape, rtol=1e-6)
            np.testing.assert_allclose(told.strength_scale, known.scale, rtol=1e-6)
            seen = detection_probability(known, LAMBDA)
            np.testing.assert_allclose(told.detection_probability, seen, rtol=1e-6)
        z = signals[k]
        known = update_detected(known, np.array([z])) if z == z else update_missed(known, LAMBDA)
    tracks = result.tracks
    mean, variance = known.log_moments()
    np.testing.assert_allclose(tracks.signal_strength, np.expm1(mean), rtol=1e-5)
    np.testing.assert_allclose(
        tracks.signal_strength_std_db, 10.0 / np.log(10.0) * np.sqrt(variance), rtol=1e-5
    )
    np.testing.assert_allclose(
        tracks.detection_probability, detection_probability(known, LAMBDA), rtol=1e-5
    )


def test_starting_detections_count_once():
    """Their ratio has misses and P_D of (2.49), against noise and detections of other targets."""
    scan = one_target([9.0])[0]
    scan = with_signals(ring_of(**ON).manager.validate(scan)[0], P, {})
    new = NewTracks(detection=np.array([0]), gap_scans=np.array([3]), first_signal=np.array([20.0]))
    strength, ratio, seen = starts(new, scan, P)
    known = prior(1, P)
    other = known
    share = P.mht_new_target_ratio / (1.0 + P.mht_new_target_ratio)

    def log_rest(z):
        """Of what the detections may be but this target's."""
        z = np.array([z])
        noise = np.exp(log_clutter_density(z, LAMBDA))
        target = np.exp(log_signal_density(other, z)) / detection_probability(other, LAMBDA)
        return np.log((1.0 - share) * noise + share * target)

    total = log_signal_density(known, np.array([20.0])) - log_rest(20.0)
    total = total - np.log(detection_probability(known, LAMBDA))
    known = update_detected(known, np.array([20.0]))
    for _ in range(2):
        total = total + np.log1p(-detection_probability(known, LAMBDA))
        known = update_missed(known, LAMBDA)
    total = total + log_signal_density(known, np.array([9.0])) - log_rest(9.0)
    known = update_detected(known, np.array([9.0]))
    given = 2.0 * np.log1p(-P.detection_probability) + np.log(P.detection_probability)
    np.testing.assert_allclose(ratio + seen + given, total, rtol=1e-12)
    np.testing.assert_allclose(strength[0], [known.shape[0], known.scale[0]])
    # However strong the first signal, it counts as one new target at most.
    new.first_signal = np.array([1e6])
    weak = replace(scan, signal_strength=np.array([LAMBDA]))
    assert starts(new, weak, P)[1][0] < np.log(1.0 / share)


def test_strong_signals_speak_for_a_target_and_faint_ones_against():
    existence = []
    for signal in (LAMBDA + 0.1, 40.0):
        ring = ring_of(**ON, clutter_density_per_m_rad=3e-2)
        for scan in one_target([signal] * 3):
            tracks = ring.process(scan).tracks
        existence.append(tracks.existence_probability[0])
    assert existence[0] < existence[1] - 0.1


def test_decibels_are_the_same_powers():
    linear, decibel = ring_of(**ON), ring_of(**ON, signal_strength_unit="decibel")
    for scan in with_strengths(8):
        one = linear.process(scan).tracks
        powers = 10.0 * np.log10(scan.attribute_values)
        other = decibel.process(replace(scan, attribute_values=powers)).tracks
        np.testing.assert_allclose(one.signal_strength, other.signal_strength, rtol=1e-9)
    assert len(one)


# --- what is no strength -------------------------------------------------------------------------


def test_an_unknown_strength_only_says_that_it_was_seen():
    ring = ring_of(**ON, signal_strength_memory_s=1e9)
    scans = one_target([9.0, 30.0, np.inf])
    for scan in scans:
        ring.process(scan)
    assert ring.manager.counters["attribute_not_finite"] == 1
    shape, scale = ring.manager.state.table.strength[0]
    before = update_detected(update_detected(prior(1, P), np.array([9.0])), np.array([30.0]))
    assert (shape, scale) == pytest.approx((before.shape[0], before.scale[0] + LAMBDA))


def test_impossible_strengths_are_counted_and_kept_within_bounds():
    ring = ring_of(**ON)
    for scan in one_target([9.0, -30.0, 1e300, 0.0]):
        result = ring.process(scan)
    assert ring.manager.counters["signal_strength_out_of_range"] == 3
    assert result.report.outcome == "tracked"
    assert np.isfinite(ring.manager.state.table.strength).all()
    assert result.tracks.signal_strength[0] < STRONGEST_SIGNAL
    in_decibel = ring_of(**ON, signal_strength_unit="decibel")
    in_decibel.process(one_target([1e300])[0])
    assert in_decibel.manager.counters["signal_strength_out_of_range"] == 1


def test_a_scan_without_strengths_leaves_them_alone():
    ring = ring_of(**ON, detection_probability=0.8)
    for scan in one_target([9.0, 30.0]):
        ring.process(scan)
    before = ring.manager.state.table.strength.copy()
    result = ring.process(scan_at(1.0, moving(1.0), sensor_id="other"))
    assert result.predictions.strength_shape.size == 0
    np.testing.assert_array_equal(result.predictions.detection_probability, 0.8)
    np.testing.assert_array_equal(ring.manager.state.table.strength, before)


@pytest.mark.parametrize("decision", DECISIONS)
def test_without_strengths_the_ring_does_what_it_did(decision):
    """Asked for but never brought, or brought but not asked for: the same, bit for bit."""
    never, on = ring_of(**{**ON, "decision": decision, "signal_strength": "none"}), None
    on, plain = ring_of(**{**ON, "decision": decision}), ring_of(decision=decision, **{
        k: v for k, v in ON.items() if k != "signal_strength"
    })  # fmt: skip
    for scan in with_strengths(15):
        bare = replace(scan, attribute_names=(), attribute_values=None)
        expected = plain.process(bare)
        for result in (never.process(scan), on.process(bare)):
            for name in ("mean", "covariance", "existence_probability", "track_id", "status"):
                assert_same(getattr(expected.tracks, name), getattr(result.tracks, name), name)
    assert np.isnan(expected.tracks.signal_strength).all()


# --- through everything that happens to a table --------------------------------------------------


@pytest.mark.parametrize("decision", ["jpda", "mht"])
def test_a_checkpoint_goes_on_bit_for_bit(decision, tmp_path):
    scans, ring = with_strengths(16), ring_of(**{**ON, "decision": decision})
    for scan in scans[:9]:
        ring.process(scan)
    save(ring.manager, tmp_path / "state")
    other = ring_of(**{**ON, "decision": decision})
    assert load(other.manager, tmp_path / "state")
    for scan in scans[9:]:
        assert_same(ring.process(scan).tracks, other.process(scan).tracks)
    assert np.isfinite(ring.manager.tracks().signal_strength).all()


@pytest.mark.parametrize("decision", DECISIONS)
def test_it_can_be_switched_on_and_off_while_tracking(decision):
    ring = ring_of(**{**ON, "decision": decision, "signal_strength": "none"})
    told = []
    for k, scan in enumerate(with_strengths(18)):
        if k in (6, 12):
            value = "swerling_1" if k == 6 else "none"
            ring.set_parameters({"track_manager": {"signal_strength": value}})
        told.append(ring.process(scan).tracks)
    known = [np.isfinite(tracks.signal_strength).all() and len(tracks) > 0 for tracks in told]
    assert not any(known[:6])
    assert all(known[6:12])
    assert not any(known[12:])
    assert ring.manager.state.table.strength.shape[1] == 0


def test_revised_tracks_tell_the_strength_of_their_time():
    ring = ring_of(**{**ON, "decision": "mht", "mht_scans": 3})
    now, delayed = {}, []
    for scan in one_target([9.0, 30.0, 12.0, 20.0, 25.0, 9.0, 8.0]):
        result = ring.process(scan)
        now[result.tracks.key.stamp_ns] = result.tracks.signal_strength
        delayed += result.delayed
    assert len(delayed) >= 2
    for tracks in delayed:
        np.testing.assert_array_equal(tracks.signal_strength, now[tracks.key.stamp_ns])


def test_why_tells_strength_and_position_apart():
    ring = ring_of(**ON)
    for scan in one_target([9.0, 30.0, 12.0]):
        result = ring.process(scan)
    entry = json.loads(json.dumps(log_entry(result)))
    terms = {term["term"]: term["value"] for term in entry["pairs"][0]["terms"]}
    told = result.predictions
    known = Strengths(told.strength_shape, told.strength_scale)
    ratio = log_detected_ratio(known, np.array([12.0]), LAMBDA)[0]
    assert terms["signal_strength"] == pytest.approx(ratio)
    total = result.associations.kinematic_log_likelihood[0]
    assert terms["kinematic_log_likelihood"] == pytest.approx(total - ratio)
    text = "\n".join(explanation_lines(explain([entry], 0, entry["pairs"][0]["track_id"])))
    mean, variance = known.log_moments()
    decibel = 10.0 / np.log(10.0) * np.array([mean[0], np.sqrt(variance[0])])
    assert f"is {decibel[0]:.1f} dB +- {decibel[1]:.1f} dB over the noise" in text
    assert f"strength    log ratio {ratio:+.2f} of a target's signal" in text


def test_a_name_is_asked_for():
    with pytest.raises(ParameterError, match=r"signal_strength_attribute = ''.*signal_strength"):
        TrackManagerParameters(signal_strength="swerling_1", signal_strength_attribute="")
