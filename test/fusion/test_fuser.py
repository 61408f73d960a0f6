"""Track fusion against one central filter, its symmetries, and its life over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from central_filter import CentralFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.fusion.fuser import TrackFuser
from gda_tracker.fusion.parameters import (
    COVARIANCE_INTERSECTION,
    INDEPENDENT,
    TrackFusionParameters,
)
from gda_tracker.fusion.reports import Refused
from gda_tracker.simulation.kalman_radars import START, KalmanRadars, tracks_of
from gda_tracker.vocabulary.fused_tracks import LATE, NEVER_HEARD, OK, SILENT

BIAS = [[0.0, 0.0], [-800.0, 600.0]]


def parameters(radars, **changes):
    n = len(radars.bias_m)
    told = {
        "radars": [f"radar_{k}" for k in range(n)],
        "track_process_noise_std_mps2": radars.noise_mps2,
        "process_noise_density_m2ps3": radars.noise_mps2**2 * radars.period_s,
        **changes,
    }
    return TrackFusionParameters(**told)


def play(radars, fuser, scans, order=None, central=None):
    """Play scans; return the last fusion."""
    last = None
    for scan in range(scans):
        learnt = radars.step()
        if central is not None:
            if scan:
                central.predict(radars.period_s)
            for radar, one in enumerate(learnt):
                central.update(radar, radars.seen[radar].nonzero()[0], *one)
        for radar in order or range(len(radars.bias_m)):
            for fusion in fuser.take(f"radar_{radar}", radars.message(radar)):
                last = fusion
    return last


@pytest.mark.parametrize("noise_mps2", [0.0, 2.0])
@pytest.mark.parametrize("n_radars", [2, 3])
def test_the_states_and_biases_are_those_of_one_central_filter(noise_mps2, n_radars):
    """Of all radars' own measurements, with process noise and biases, to rounding."""
    many = n_radars > 2
    bias = [[5.0, -10.0], [-12.0, 15.0], [10.0, 8.0]] if many else BIAS
    # One target is seen by the first radar alone, one by the second alone.
    seen = np.ones((n_radars, 5), dtype=bool)
    seen[1:, 3] = seen[0, 4] = seen[2:, 4] = False
    radars = KalmanRadars(4, bias, n_targets=5, process_noise_std_mps2=noise_mps2, seen=seen)
    std = [8.0, 10.0, 9.0] if many else [500.0, 2000.0]
    central = CentralFilter(5, std, radars.noise_mps2**2)
    fuser = TrackFuser(parameters(radars, bias_std_m=std, track_memory_s=3.0))
    fused, found = play(radars, fuser, 12, central=central)
    assert len(fused) == 5
    assert found.bias_reference == ""
    for row in range(5):
        k = int((fused.member_track_id[row] % 100)[fused.member[row]][0])
        assert fused.member[row].tolist() == seen[:, k].tolist()
        mean, covariance = central.target(k)
        np.testing.assert_allclose(fused.mean[row], mean, atol=0.02)
        np.testing.assert_allclose(fused.covariance[row], covariance, rtol=1e-4, atol=1e-2)
    for radar in range(n_radars):
        mean, covariance = central.bias(radar)
        np.testing.assert_allclose(found.bias[radar], mean, atol=0.02)
        np.testing.assert_allclose(found.bias_covariance[radar], covariance, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("noise_mps2", "tolerance"), [(0.0, 1e-4), (2.0, 0.02)])
def test_radars_that_scan_at_different_times_are_fused_in_the_order_of_their_stamps(
    noise_mps2, tolerance
):
    """The second radar scans half a period later; the central filter takes each at its time.

    With process noise a track that joins shares what happened since its stamp with the others, so
    the two differ a little, and ever less.
    """
    first = KalmanRadars(1, BIAS, n_targets=4, process_noise_std_mps2=noise_mps2)
    std = [0.0, 2000.0]
    central = CentralFilter(4, [1e-3, 2000.0], first.noise_mps2**2)
    fuser = TrackFuser(parameters(first, bias_std_m=std))
    rng = np.random.default_rng(3)
    compared, mean, covariance = 0, None, None
    for scan in range(12):
        learnt = first.step()
        if scan:
            central.predict(0.5)
        central.update(0, range(4), *learnt[0])
        for fused, found in fuser.take("radar_0", first.message(0)):
            if scan < 2:
                continue
            compared += 1
            assert fused.stamp_ns == round(first.time_s * 1e9)
            assert fused.member.all()
            for row, k in enumerate(fused.member_track_id[:, 0].tolist()):
                expected, spread = central.target(k)
                std = np.sqrt(np.diag(spread))
                assert (np.abs(fused.mean[row] - expected) < 5.0 * tolerance * std).all()
                gap = np.abs(fused.covariance[row] - spread)
                assert (gap < tolerance * np.outer(std, std)).all()
            std = np.sqrt(np.diag(central.bias(1)[1]))
            assert (np.abs(found.bias[1] - central.bias(1)[0]) < 5.0 * tolerance * std).all()
        central.predict(0.5)
        z = first.states - np.array([-800.0, 600.0, 0.0, 0.0])
        z[:, :2] += 0.5 * first.states[:, 2:]
        if mean is None:
            z = z + rng.standard_normal(z.shape) @ np.sqrt(START)
            mean, covariance = z, np.tile(START, (4, 1, 1))
            central.update(1, range(4), z, START, np.eye(4))
        else:
            z = z[:, :2] + 30.0 * rng.standard_normal((4, 2))
            mean = mean @ first.transition.T
            covariance = first.transition @ covariance @ first.transition.T + first.process_noise
            innovation = covariance[:, :2, :2] + first.measurement_noise
            gain = covariance[:, :, :2] @ np.linalg.inv(innovation)
            mean = mean + np.einsum("nij,nj->ni", gain, z - mean[:, :2])
            covariance = covariance - gain @ covariance[:, :2]
            central.update(1, range(4), z, first.measurement_noise, np.eye(2, 4))
        fuser.take("radar_1", tracks_of(1, first.time_s + 0.5, mean, covariance))
    assert compared == 10


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_order_of_the_radars_does_not_matter(seed):
    """Neither that in which they report nor that in which they are listed."""
    results = []
    for order, names in (((0, 1), (0, 1)), ((1, 0), (0, 1)), ((0, 1), (1, 0))):
        radars = KalmanRadars(seed, BIAS, process_noise_std_mps2=0.0)
        listed = [f"radar_{k}" for k in names]
        std = [[300.0, 2500.0][k] for k in names]
        fuser = TrackFuser(replace(parameters(radars), radars=listed, bias_std_m=std))
        fused, found = play(radars, fuser, 6, order=order)
        place = [listed.index(f"radar_{k}") for k in (0, 1)]
        sort = np.argsort(fused.member_track_id[:, place[0]])
        results.append((fused.mean[sort], fused.covariance[sort], found.bias[place]))
    for other in results[1:]:
        for one, same in zip(results[0], other, strict=True):
            np.testing.assert_allclose(one, same, rtol=1e-6, atol=1e-4)


@settings(max_examples=3, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    east=st.floats(-20_000.0, 20_000.0),
    north=st.floats(-20_000.0, 20_000.0),
)
def test_a_radar_with_an_unknown_bias_may_be_shifted(seed, east, north):
    """All comes out the same but its bias, which takes up the shift."""
    found = []
    for shift in ([0.0, 0.0], [east, north]):
        radars = KalmanRadars(seed, [[0.0, 0.0], np.array([-800.0, 600.0]) + shift])
        fused, told = play(radars, TrackFuser(parameters(radars)), 5)
        assert told.bias_reference == "radar_0"
        found.append((fused.mean, fused.covariance, told.bias[1] - shift, told.probability))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=0.05)


@pytest.mark.parametrize("rule", [INDEPENDENT, COVARIANCE_INTERSECTION])
def test_the_other_rules_agree_about_who_is_who(rule):
    radars = KalmanRadars(7, BIAS)
    fused, _ = play(radars, TrackFuser(parameters(radars, fusion_rule=rule)), 10)
    assert fused.fusion_rule == rule
    assert fused.member.all()
    assert len(fused) == 4
    k = fused.member_track_id[:, 0]
    assert (fused.member_track_id[:, 1] == k + 100).all()
    assert np.abs(fused.mean - radars.states[k])[:, :2].max() < 100.0


def test_one_radar_alone_is_given_out_as_it_is():
    radars = KalmanRadars(2, [[0.0, 0.0]])
    fuser = TrackFuser(TrackFusionParameters(process_noise_density_m2ps3=4.0))
    for _ in range(5):
        radars.step()
        ((fused, found),) = fuser.take("radar_1", radars.message(0))
    # The two motion models differ by T^4/12 of the variance of the position's process noise.
    np.testing.assert_allclose(fused.mean, radars.local[0][0], atol=1.0)
    assert fused.radar_states == (OK, NEVER_HEARD)
    assert np.isnan(found.bias[1]).all()
    assert found.method == "none"
    assert fused.association_probability.tolist() == [1.0] * 4


def test_beliefs_decide_where_positions_do_not():
    """Two targets beside each other, the bias as large as the gap between them."""
    covariance = np.tile(np.diag([100.0, 100.0, 1.0, 1.0]), (2, 1, 1))
    mean = np.array([[0.0, 0.0, 50.0, 0.0], [600.0, 0.0, 50.0, 0.0]])
    fighter, cargo = [0.0, 0.95, 0.05], [0.0, 0.05, 0.95]
    for one, other, expected in (
        ([fighter, cargo], [cargo], [1, 100]),
        ([fighter, cargo], [fighter], [0, 100]),
    ):
        told = TrackFusionParameters(bias_std_m=[0.0, 600.0])
        fuser = TrackFuser(told)
        fuser.take("radar_1", tracks_of(0, 1.0, mean, covariance, belief=one))
        middle = tracks_of(1, 2.0, [[300.0, 0.0, 50.0, 0.0]], covariance[:1], belief=other)
        fuser.take("radar_2", middle)
        ((fused, found),) = fuser.take("radar_1", tracks_of(0, 2.0, mean, covariance, belief=one))
        row = fused.member.all(axis=1).nonzero()[0]
        assert fused.member_track_id[row].tolist() == [expected]
        # The classes are fused as well: .95 x .95 against .05 x .05.
        assert fused.class_names == ("fighter", "cargo")
        assert fused.class_probability[row[0], 1 if expected[0] else 0] > 0.95
        assert found.probability.sum() == pytest.approx(1.0)


def test_ids_stay_while_tracks_come_go_and_radars_restart():
    radars = KalmanRadars(5, BIAS)
    fuser = TrackFuser(parameters(radars))
    fused, _ = play(radars, fuser, 6)
    before = dict(zip(fused.member_track_id[:, 0].tolist(), fused.fused_track_id, strict=True))
    # The second radar starts anew: other tracks of the same targets.
    radars.system_uuid[1] = b"n" * 16
    fused, _ = play(radars, fuser, 1)
    assert fuser.counters["radar_restarted"] == 1
    assert (fused.fusions == 7).sum() == 4
    after = dict(zip(fused.member_track_id[:, 0].tolist(), fused.fused_track_id, strict=True))
    assert after == before
    # A target leaves the second radar, then both.
    radars.seen[1, 2] = False
    fused, _ = play(radars, fuser, 2)
    assert fused.fused_track_id.tolist() == sorted(before.values())
    assert fused.member.sum() == 7
    radars.seen[0, 2] = False
    fused, _ = play(radars, fuser, 1)
    assert fused.deleted_fused_track_id.tolist() == [before[2]]
    assert len(fused) == 3
    radars.seen[:, 2] = True
    fused, _ = play(radars, fuser, 1)
    assert fused.fused_track_id.max() > max(before.values())


def test_a_silent_radar_no_longer_counts_and_comes_back():
    radars = KalmanRadars(6, BIAS)
    fuser = TrackFuser(parameters(radars, late_after_s=2.0, silent_after_s=4.0))
    fused, found = play(radars, fuser, 6)
    spread = np.trace(found.bias_covariance[1])
    states = []
    for _ in range(7):
        radars.step()
        for fused, _ in fuser.take("radar_0", radars.message(0)):
            states.append((fused.radar_states[1], fused.member[:, 1].all()))
    assert states[0] == (OK, True)
    assert (LATE, True) in states
    assert states[-1] == (SILENT, False)
    identity = fused.fused_track_id.tolist()
    assert len(identity) == 4
    fused, found = play(radars, fuser, 3)
    assert fused.radar_states == (OK, OK)
    assert fused.fused_track_id.tolist() == identity
    assert fused.member.all()
    assert np.trace(found.bias_covariance[1]) < spread


@pytest.mark.parametrize("restarted", [False, True])
def test_a_bias_that_changes_is_learnt_anew(restarted):
    radars = KalmanRadars(8, BIAS)
    fuser = TrackFuser(parameters(radars, track_memory_s=4.0))
    fused, found = play(radars, fuser, 8)
    assert np.abs(found.bias[1] - radars.bias_m[1]).max() < 60.0
    # The radar is set up at another place, and its tracker started anew.
    radars.move(1, [1000.0, -1500.0])
    if restarted:
        radars.system_uuid[1] = b"n" * 16
    fused, found = play(radars, fuser, 12)
    # Tracks that were joined and part take back what they told; others have to be outvoted.
    assert fuser.counters["biases_begun_anew"] == restarted
    assert fused.member.all()
    assert len(fused) == 4
    assert np.abs(found.bias[1] - radars.bias_m[1]).max() < 60.0


def test_what_cannot_be_used_is_refused_by_name_and_changes_nothing():
    radars = KalmanRadars(9, BIAS)
    fuser = TrackFuser(parameters(radars, max_tracks_per_radar=10))
    play(radars, fuser, 2)
    radars.step()
    good = radars.message(0)
    key = good.key
    bad = {
        "refused_repeated": replace(good, key=key._replace(stamp_ns=key.stamp_ns - 10**9)),
        "refused_backwards": replace(good, key=key._replace(stamp_ns=key.stamp_ns - 2 * 10**9)),
        "refused_frame": replace(good, frame_id="elsewhere"),
        "refused_too_many_tracks": tracks_of(0, 9.0, np.zeros((11, 4)), np.zeros((11, 4, 4))),
        "refused_state_size": replace(
            good, mean=np.zeros((4, 6)), covariance=np.tile(np.eye(6), (4, 1, 1))
        ),
    }
    for reason, message in bad.items():
        with pytest.raises(Refused) as caught:
            fuser.take("radar_0", message)
        assert caught.value.reason == reason
        assert fuser.counters[reason] == 1
    mean, covariance = good.mean.copy(), good.covariance.copy()
    mean[0, 1], covariance[1, 0, 0] = np.nan, -1.0
    track_id = good.track_id.copy()
    track_id[3] = track_id[2]
    spoilt = replace(good, mean=mean, covariance=covariance, track_id=track_id)
    fuser.take("radar_0", spoilt)
    ((fused, _),) = fuser.take("radar_1", radars.message(1))
    assert fused.member[:, 0].sum() == 1
    for reason in ("track_not_finite", "track_covariance_not_valid", "track_id_twice"):
        assert fuser.counters[reason] == 1


def test_stamps_far_back_begin_anew_with_other_ids():
    radars = KalmanRadars(10, BIAS)
    fuser = TrackFuser(parameters(radars))
    fused, _ = play(radars, fuser, 20)
    radars.time_s = 0.0
    again, found = play(radars, fuser, 2)
    assert fuser.counters["fusion_began_anew"] == 1
    assert not set(again.fused_track_id) & set(fused.fused_track_id)
    assert len(again) == 4
    assert found.track_counts.tolist() == [4, 4]


def test_too_many_tracks_near_each_other_stay_as_they_were():
    radars = KalmanRadars(11, BIAS)
    fuser = TrackFuser(parameters(radars))
    before, _ = play(radars, fuser, 3)
    fuser.parameters = parameters(radars, max_associated_tracks=5)
    fused, found = play(radars, fuser, 1)
    assert found.method == "failed"
    assert fuser.counters["tracks_left_as_they_were"] == 1
    assert (fused.member_track_id == before.member_track_id).all()
    assert (fused.fused_track_id == before.fused_track_id).all()
