"""The ratio between bounds: worked values, scipy's densities, and error rates on Kalman tracks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.stats import ncx2, norm

from gda_tracker.events.monte_carlo import count_decisions, expected_rate, matched_tracks
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.samples import memory_s
from gda_tracker.events.sequential import (
    DIRECTION_LOSS,
    DIRECTIONS,
    H0,
    H1,
    OPEN,
    advance,
    aligned,
    bound_increments,
    departure_increments,
    stopped_increments,
    test_columns,
)
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.tracking.extraction import sequential_test

columns_of_tests = test_columns
del test_columns  # no test
numbers = st.floats(-50.0, 50.0)


@given(value=numbers, std=st.floats(0.1, 20.0), low=numbers, gap=st.floats(0.01, 50.0))
def test_the_increment_is_the_ratio_of_two_gaussians(value, std, low, gap):
    expected = norm.logpdf(value, low + gap, std) - norm.logpdf(value, low, std)
    found = bound_increments(np.array(value), np.array(std**2), low, low + gap)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-6)


@given(speed=st.floats(0.0, 20.0), std=st.floats(0.2, 5.0), angle=st.floats(0.0, 6.3))
def test_the_increment_of_a_stop_is_the_ratio_of_two_non_central_chi_squares(speed, std, angle):
    velocity = speed * np.array([[math.cos(angle), math.sin(angle)]])
    statistic = (speed / std) ** 2
    found = stopped_increments(velocity, std**2 * np.eye(2)[None], 1.0, 4.0)
    expected = ncx2.logpdf(statistic, 2, (1.0 / std) ** 2) - ncx2.logpdf(
        statistic, 2, (4.0 / std) ** 2
    )
    if statistic < 300.0 and np.isfinite(expected):
        assert_allclose(found, [[expected]], rtol=1e-6, atol=1e-6)


def test_a_long_covariance_tells_nothing_of_a_stop():
    long = np.diag([100.0, 1.0])[None]
    assert stopped_increments(np.array([[0.1, 0.0]]), long, 1.0, 4.0) == 0.0
    assert stopped_increments(np.array([[0.1, 0.0]]), np.eye(2)[None], 1.0, 4.0) > 0.0


def test_a_departure_counts_in_all_directions_and_the_shortest_view_of_it_is_the_loss():
    for angle in np.linspace(0.0, 6.28, 50):
        departure = 10.0 * np.array([math.cos(angle), math.sin(angle)])
        assert 10.0 * DIRECTION_LOSS - 1e-9 <= (DIRECTIONS @ departure).max() <= 10.0
    increments = departure_increments(
        np.array([[0.0, 10.0]]), np.eye(2)[None], 4.0, np.array([8.0])
    )
    high = 8.0 * DIRECTION_LOSS
    assert_allclose(increments.max(), (high - 4.0) * (10.0 - (high + 4.0) / 2.0))


def test_the_mean_ratio_accepts_and_the_largest_rejects():
    test = sequential_test(0.01, 0.05)
    rows = np.zeros(3, dtype=columns_of_tests(2))
    rows["track_id"] = [4, 7, 9]
    b, a = test.log_accept, test.log_reject
    increments = np.array([[b + math.log(2.0) + 1e-9, -100.0], [b, -100.0], [a, a - 1.0]])
    decisions = advance(rows, np.arange(3), increments, 5, test)
    assert decisions.verdict.tolist() == [H1, OPEN, H0]
    assert decisions.side.tolist() == [0, 0, 0]
    assert_allclose(decisions.log_ratio[[0, 2]], [b, a], atol=1e-8)
    # What decided begins anew, what did not goes on.
    assert rows["samples"].tolist() == [0, 1, 0]
    again = advance(rows, np.arange(3), np.full((3, 2), 1.0), 6, test)
    assert again.verdict.tolist() == [OPEN, H1, OPEN]
    assert again.samples.tolist() == [1, 2, 1]
    assert again.began_ns.tolist() == [6, 5, 6]


def test_rows_follow_their_tracks():
    default = np.zeros((), dtype=columns_of_tests(1))
    rows = aligned(np.zeros(0, dtype=default.dtype), np.array([2, 5]), default)
    rows["samples"] = [20, 50]
    found = aligned(rows, np.array([1, 5, 8]), default)
    assert found["track_id"].tolist() == [1, 5, 8]
    assert found["samples"].tolist() == [0, 50, 0]


# --- on Kalman tracks -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matched():
    return matched_tracks(150, 300, np.random.default_rng(7))


def test_the_simulated_tracks_are_consistent(matched):
    for scan in (0, 10, -1):
        error, inverse = matched.error[scan], np.linalg.inv(matched.covariance[scan])
        nees = np.einsum("ni,ij,nj->n", error, inverse, error).mean()
        # chi-square of 4 x 150 degrees of freedom, three standard deviations
        assert abs(nees - 4.0) < 3.0 * math.sqrt(8.0 / 150)


@pytest.mark.parametrize(
    ("position_std", "noise", "dt"), [(20.0, 1.0, 1.0), (1.0, 2.0, 1.0), (5.0, 1.0, 0.1)]
)
def test_states_three_memories_apart_are_nearly_independent(position_std, noise, dt):
    tracks = matched_tracks(
        1,
        400,
        np.random.default_rng(1),
        dt_s=dt,
        position_std_m=position_std,
        process_noise_std_mps2=noise,
    )
    transition, noise_covariance = constant_velocity(dt, noise)
    late = 250
    covariance = tracks.covariance[late]
    steps = math.ceil(3.0 * float(memory_s(covariance[None])[0]) / dt)
    # The error of the filter goes on by (I - K H) F, here of its own covariances.
    carried = covariance
    for scan in range(late, late + steps):
        before = transition @ tracks.covariance[scan] @ transition.T + noise_covariance
        carried = tracks.covariance[scan + 1] @ np.linalg.solve(before, transition @ carried)
    std = np.sqrt(np.diag(tracks.covariance[late + steps]))
    own = np.diag(carried) / std / np.sqrt(np.diag(covariance))
    assert (own < 0.05).all()
    # The lowest is that of a velocity where the memory is shorter than a scan.
    assert (own > -0.16).all()


DESIGN = EventParameters(
    false_alarm_probability=0.05,
    miss_probability=0.05,
    moving_speed_mps=10.0,
    stopped_speed_mps=1.0,
    steady_acceleration_mps2=0.3,
    event_acceleration_mps2=1.0,
)


@pytest.mark.parametrize("quantity", ["lane", "plan", "stop", "acceleration"])
@pytest.mark.parametrize("truth", [H0, H1])
def test_no_test_errs_more_often_than_designed_at_its_bound(quantity, truth, matched):
    counted = count_decisions(quantity, truth, matched, DESIGN)
    wrong = counted.h1 if truth == H0 else counted.h0
    assert counted.total > 500
    # Wald's bound; with these wide margins the rates lie far below, but the tests do err.
    assert 0 < wrong / counted.total < 0.05


@pytest.mark.parametrize("truth", [H0, H1])
def test_the_rates_are_those_of_the_theory(truth):
    margin = 8.0
    tracks = matched_tracks(200, 700, np.random.default_rng(11))
    counted = count_decisions(
        "lane", truth, tracks, DESIGN, lane_margin_m=margin, independence_factor=2.0
    )
    wrong = (counted.h1 if truth == H0 else counted.h0) / counted.total
    step = margin / math.sqrt(tracks.covariance[-1][1, 1])
    expected = expected_rate(truth, step, 3, DESIGN)
    # Three binomial errors. States two memories apart are the nearest to independent ones: the
    # default of three is on the safe side (docs/track-events.md).
    assert abs(wrong - expected) < 3.0 * math.sqrt(expected / counted.total)
    assert wrong > 0.0


def test_states_taken_one_after_the_other_would_err_more_than_designed(matched):
    careless = count_decisions(
        "lane", H1, matched, DESIGN, independence_factor=0.0, lane_margin_m=10.0
    )
    assert careless.total > 1000
    assert careless.h0 / careless.total > 2.0 * DESIGN.miss_probability
