"""The simulated radar: detection by signal to noise, noise, false alarms, truth."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest, ncx2

from gda_tracker.simulation.geodesy import earth_centred, east_north_up
from gda_tracker.simulation.surveillance_radar import SurveillanceRadar, observe
from gda_tracker.simulation.trajectories import Trajectory, spread_out, without_jumps

RADAR = SurveillanceRadar(
    sensor_id="radar",
    scan_period_s=2.0,
    max_range_m=10_000.0,
    reference_range_m=5_000.0,
    snr_at_reference=10.0,
    false_alarm_probability=1e-4,
    range_resolution_m=40.0,
    azimuth_resolution_deg=1.0,
    mean_false_alarms_per_scan=0.0,
    clutter_rcs_mean_m2=0.5,
    elevation=True,
)


def changed(**values):
    return replace(RADAR, **values)


def standing(position, rcs=1.0, swerling=1, number=1, until=1e5):
    return Trajectory(
        number, "target", np.array([0.0, until]), np.array([position, position], dtype=float),
        np.zeros((2, 3)), rcs, swerling, math.inf,
    )  # fmt: skip


@cache
def crowd(swerling, position=(3e3, 4e3, 0.0), rcs=1.0):
    """Targets at one place, to look at many in few scans."""
    return [standing(position, rcs, swerling, number) for number in range(400)]


@pytest.mark.parametrize("swerling", [1, 3])
@pytest.mark.parametrize("snr", [2.0, 10.0, 60.0])
def test_the_share_of_detections_is_that_of_the_threshold(swerling, snr):
    """Against the integral of the Marcum function over the RCS, and for Swerling 1 the closed form.

    2 z is noncentral chi-squared with two degrees of freedom and noncentrality 2 s.
    """
    radar = changed(snr_at_reference=snr)
    targets, scans = crowd(swerling), 30
    number = len(targets) * scans
    detections, _ = observe(radar, targets, 0.0, 2.0 * scans, 1)
    share = sum(len(scan.range_m) for scan in detections) / number
    shape = 1.0 if swerling == 1 else 2.0

    def density(rcs):
        return (shape**shape) * rcs ** (shape - 1.0) * math.exp(-shape * rcs)

    expected, _ = quad(
        lambda rcs: density(rcs) * ncx2.sf(2.0 * radar.threshold, 2, 2.0 * snr * rcs), 0.0, 40.0
    )
    if swerling == 1:
        closed = radar.detection_probability(np.array(5e3), np.array(1.0))
        assert closed == pytest.approx(expected, rel=1e-6)
        assert closed == pytest.approx(1e-4 ** (1.0 / (1.0 + snr)), rel=1e-12)
    assert share == pytest.approx(expected, abs=4.0 * math.sqrt(expected * (1 - expected) / number))


def test_power_falls_with_the_fourth_power_of_range_and_rcs_is_measured():
    assert RADAR.gain(np.array([5e3, 1e4])) == pytest.approx([10.0, 10.0 / 16.0])
    strong = changed(snr_at_reference=1e6)
    detections, _ = observe(strong, crowd(3, rcs=7.0), 0.0, 20.0, 2)
    rcs = np.concatenate([scan.rcs_m2 for scan in detections])
    assert rcs.mean() == pytest.approx(7.0, rel=0.05)
    assert kstest(rcs, "gamma", args=(2.0, 0.0, 3.5)).pvalue > 1e-3


def test_noise_is_what_the_detections_say():
    detections, _ = observe(
        changed(snr_at_reference=40.0), [standing((3e3, 4e3, 500.0))], 0, 1e4, 3
    )
    distance = math.sqrt(25e6 + 500.0**2)
    columns = {
        "range_m": ("range_std_m", distance),
        "azimuth_rad": ("azimuth_std_rad", math.atan2(4, 3)),
        "elevation_rad": ("elevation_std_rad", math.asin(500.0 / distance)),
    }
    for name, (deviation, true) in columns.items():
        values = np.concatenate([getattr(scan, name) for scan in detections])
        stds = np.concatenate([getattr(scan, deviation) for scan in detections])
        assert kstest((values - true) / stds, "norm").pvalue > 1e-3
        assert len(set(np.round(stds, 12))) > 100  # each by its own power
    stds = np.concatenate([scan.range_std_m for scan in detections])
    assert stds.min() >= 4.0
    assert stds.max() <= 40.0 / math.sqrt(2.0 * RADAR.threshold)


def test_false_alarms_and_whose_each_detection_is():
    radar = changed(mean_false_alarms_per_scan=6.0, snr_at_reference=1e5)
    targets = [standing((3e3, 4e3, 0.0), number=7), standing((-2e3, 0.0, 0.0), number=9)]
    detections, truth = observe(radar, targets, 0.0, 1600.0, 4)
    source = np.concatenate([one.source_id for one in truth])
    clutter = np.array([(one.source_id == -1).sum() for one in truth])
    assert clutter.mean() == pytest.approx(6.0, abs=0.35)
    assert clutter.var() == pytest.approx(6.0, abs=1.3)
    ranges = np.concatenate([scan.range_m for scan in detections])
    azimuths = np.concatenate([scan.azimuth_rad for scan in detections])
    assert kstest(ranges[source == -1] / 1e4, "uniform").pvalue > 1e-3
    assert kstest((azimuths[source == -1] / np.pi + 1.0) / 2.0, "uniform").pvalue > 1e-3
    assert np.abs(ranges[source == 7] - 5e3).max() < 200.0
    assert np.abs(ranges[source == 9] - 2e3).max() < 200.0
    assert np.abs(np.abs(azimuths[source == 9]) - np.pi).max() < 0.1
    # The order tells nothing.
    first = [one.source_id[0] for one in truth]
    assert {-1, 7, 9} <= set(first)
    for one in truth:
        assert one.target_id.tolist() == [7, 9]
        assert np.isfinite(one.target_state).all()


def test_only_what_is_there_and_in_range_is_truth():
    radar = changed(snr_at_reference=1e6)
    short = standing((1e3, 0.0, 0.0), number=1, until=20.0)
    far = standing((11e3, 0.0, 0.0), number=2)
    _, truth = observe(radar, [short, far, standing((5e3, 0.0, 0.0), number=3)], 0.0, 40.0, 1)
    assert [one.target_id.tolist() for one in truth] == [[1, 3]] * 11 + [[3]] * 9


def test_the_same_seed_gives_the_same_scans_and_runs_differ():
    targets = [standing((3e3, 4e3, 0.0))]
    one, other, third = (observe(RADAR, targets, 0.0, 200.0, 5, run)[0] for run in (0, 0, 1))
    assert all(np.array_equal(a.range_m, b.range_m) for a, b in zip(one, other, strict=True))
    assert any(len(a.range_m) != len(b.range_m) for a, b in zip(one, third, strict=True))


# --- trajectories


def test_a_path_goes_through_its_reports_and_knows_its_gaps():
    time = np.array([0.0, 10.0, 20.0, 300.0, 310.0])
    position = np.stack([5.0 * time, 0.1 * time**2, np.zeros(5)], axis=1)
    velocity = np.stack([np.full(5, 5.0), 0.2 * time, np.zeros(5)], axis=1)
    path = Trajectory(1, "a", time, position, velocity, 1.0, 1, 60.0)
    states = path.states(np.array([-1.0, 0.0, 7.0, 20.0, 100.0, 305.0, 311.0]))
    known = np.isfinite(states).all(axis=1)
    assert known.tolist() == [False, True, True, True, False, True, False]
    # A cubic follows a parabola exactly.
    np.testing.assert_allclose(states[2], [35.0, 4.9, 0.0, 5.0, 1.4, 0.0], atol=1e-9)
    with pytest.raises(ValueError, match="each later than the last"):
        Trajectory(1, "a", time[[0, 0]], position[:2], velocity[:2], 1.0, 1, 60.0)


def test_reports_are_spread_out_and_jumps_left_out():
    assert spread_out(np.array([0.0, 3.0, 9.0, 10.0, 25.0]), 10.0).tolist() == [0, 3, 4]
    time = np.arange(6.0) * 10.0
    line = np.stack([10.0 * time, np.zeros(6), np.zeros(6)], axis=1)
    one = line.copy()
    one[3] += 1e6
    assert without_jumps(time, one, 40.0).tolist() == [0, 1, 2, 4, 5]
    one = line.copy()
    one[0] += 1e6
    assert without_jumps(time, one, 40.0).tolist() == [1, 2, 3, 4, 5]


def test_positions_on_the_ellipsoid():
    assert earth_centred(0.0, 0.0, 0.0) == pytest.approx([6_378_137.0, 0.0, 0.0])
    assert earth_centred(90.0, 0.0, 10.0) == pytest.approx([0.0, 0.0, 6_356_762.3142], abs=1e-3)
    origin = (50.778, -1.0885, 30.0)
    assert east_north_up(*origin, origin) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert east_north_up(50.778, -1.0885, 130.0, origin) == pytest.approx([0, 0, 100], abs=1e-6)
    # Small steps are those of the radii of curvature.
    a, e2 = 6_378_137.0, 0.00669437999014
    w = 1.0 - e2 * math.sin(math.radians(50.778)) ** 2
    meridian, normal = a * (1.0 - e2) / w**1.5 + 30.0, a / math.sqrt(w) + 30.0
    step = math.radians(1e-4)
    east, north, _ = east_north_up(50.7781, -1.0885, 30.0, origin)
    assert (east, north) == pytest.approx((0.0, meridian * step), rel=1e-6, abs=1e-4)
    east, north, _ = east_north_up(50.778, -1.0884, 30.0, origin)
    across = normal * math.cos(math.radians(50.778)) * step
    assert (east, north) == pytest.approx((across, 0.0), rel=1e-6, abs=1e-4)
