"""GOSPA and OSPA: reference values, brute force over all assignments, properties of a metric."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.evaluation.set_distances import score_set_distances, set_distance
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE, ScanKey, ScanTruth, Tracks

REFERENCE = json.loads(
    (Path(__file__).parent / "data" / "gospa_ospa_reference.json").read_text(encoding="utf-8")
)

coordinate = st.floats(-30.0, 30.0)
points = st.lists(st.tuples(coordinate, coordinate), max_size=5).map(
    lambda p: np.array(p, dtype=float).reshape(-1, 2)
)


@pytest.mark.parametrize("case", REFERENCE["cases"], ids=lambda case: case["name"])
def test_reference_values(case):
    found = set_distance(
        np.array(case["estimate"], dtype=float).reshape(-1, 2),
        np.array(case["truth"], dtype=float).reshape(-1, 2),
        REFERENCE["c"],
        REFERENCE["p"],
    )
    assert found.gospa_m == pytest.approx(case["gospa"], abs=1e-6)
    assert found.ospa_m == pytest.approx(case["ospa"], abs=1e-6)
    parts = (found.localisation, found.missed, found.false)
    wanted = [case[name] for name in ("localisation", "missed", "false")]
    np.testing.assert_allclose(parts, wanted, atol=1e-9)


def brute_force(x, y, c, p):
    """GOSPA by Proposition 1, over all partial assignments, and OSPA over all full ones."""
    n, m = len(x), len(y)
    gap = [[math.dist(a, b) for b in y] for a in x]
    best = math.inf
    for k in range(min(n, m) + 1):
        for rows in itertools.combinations(range(n), k):
            for columns in itertools.permutations(range(m), k):
                matched = sum(gap[i][j] ** p for i, j in zip(rows, columns, strict=True))
                best = min(best, matched + c**p / 2.0 * (n + m - 2 * k))
    if not max(n, m):
        return 0.0, 0.0
    if n > m:
        n, m, gap = m, n, [list(column) for column in zip(*gap, strict=True)] or [[]] * m
    cut = min(
        sum(min(c, gap[i][j]) ** p for i, j in enumerate(columns))
        for columns in itertools.permutations(range(m), n)
    )
    return best ** (1.0 / p), ((cut + c**p * (m - n)) / m) ** (1.0 / p)


@pytest.mark.parametrize("order", [1.0, 2.0, 3.0])
def test_equals_the_minimum_over_all_assignments(order):
    rng = np.random.default_rng(5)
    for _ in range(60):
        x = rng.uniform(0.0, 25.0, (rng.integers(0, 5), 2))
        y = rng.uniform(0.0, 25.0, (rng.integers(0, 5), 2))
        found = set_distance(x, y, 10.0, order)
        gospa, ospa = brute_force(x.tolist(), y.tolist(), 10.0, order)
        assert found.gospa_m == pytest.approx(gospa, abs=1e-9)
        assert found.ospa_m == pytest.approx(ospa, abs=1e-9)


@given(points, points)
def test_the_parts_add_up_and_swap_with_the_sets(x, y):
    found, swapped = set_distance(x, y, 10.0), set_distance(y, x, 10.0)
    assert found.localisation + found.missed + found.false == pytest.approx(found.gospa_m**2)
    assert swapped.gospa_m == pytest.approx(found.gospa_m)
    assert swapped.ospa_m == pytest.approx(found.ospa_m)
    assert (swapped.missed, swapped.false) == pytest.approx((found.false, found.missed))
    assert found.ospa_m <= 10.0 + 1e-12
    assert found.gospa_m**2 <= 50.0 * (len(x) + len(y)) + 1e-9


@given(points, points, points)
def test_triangle_inequality(x, y, z):
    direct = set_distance(x, z, 10.0)
    first, second = set_distance(x, y, 10.0), set_distance(y, z, 10.0)
    assert direct.gospa_m <= first.gospa_m + second.gospa_m + 1e-9
    assert direct.ospa_m <= first.ospa_m + second.ospa_m + 1e-9


@given(points)
def test_a_set_has_no_distance_from_itself_in_any_order(x):
    found = set_distance(x, x[::-1], 10.0)
    assert found.gospa_m == 0.0
    assert found.ospa_m == 0.0


def test_a_run_counts_confirmed_tracks_and_known_targets_only():
    truth = ScanTruth(
        "radar", 0, np.array([1, 2, 3]), np.array([[0, 0, 1, 1], [50, 0, 1, 1], [np.nan] * 4])
    )
    tracks = Tracks(
        ScanKey(0, "radar", 0),
        track_id=np.array([1, 2, 3]),
        status=np.array([CONFIRMED, TENTATIVE, CONFIRMED]),
        mean=np.array([[3.0, 4.0, 0, 0], [50.0, 0.0, 0, 0], [90.0, 0.0, 0, 0]]),
    )
    found = score_set_distances([tracks, tracks], [truth, truth], 10.0)
    np.testing.assert_allclose(found.localisation, [25.0, 25.0])
    np.testing.assert_allclose(found.missed, [50.0, 50.0])
    np.testing.assert_allclose(found.false, [50.0, 50.0])
    np.testing.assert_allclose(found.gospa_m, math.sqrt(125.0))
    np.testing.assert_allclose(found.ospa_m, math.sqrt(125.0 / 2.0))
    assert len(score_set_distances([], [], 10.0).gospa_m) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((1, 2)), np.zeros((1, 2)), 0.0), "cutoff_m = 0.0: allowed is a number > 0"),
        ((np.zeros((1, 2)), np.zeros((1, 2)), math.inf), "cutoff_m = inf"),
        ((np.zeros((1, 2)), np.zeros((1, 2)), 1.0, 0.5), "order = 0.5: allowed is a number >= 1"),
        ((np.array([[np.nan, 0.0]]), np.zeros((1, 2)), 1.0), "finite coordinates"),
    ],
)
def test_what_is_not_allowed_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        set_distance(*arguments)


def test_numbers_of_scans_must_agree():
    with pytest.raises(ValueError, match="1 scans with tracks, 0 with truth"):
        score_set_distances([Tracks(ScanKey(0, "radar", 0))], [], 10.0)
