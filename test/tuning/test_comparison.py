"""Default and tuned on data held back: differences, their intervals, and plain verdicts."""

from __future__ import annotations

import numpy as np
import pytest
from tuning_examples import score_of

from gda_tracker.tuning.comparison import compare
from gda_tracker.tuning.objectives import OBJECTIVES

GOSPA, SWITCHES = OBJECTIVES["gospa"], OBJECTIVES["switches"]


def noisy(rng, mean, scans=80):
    return mean + rng.uniform(-1.0, 1.0, scans)


def test_no_difference_does_not_beat_the_default():
    score = score_of([5.0] * 40)
    found = compare([GOSPA], [score], [score], 0)
    assert not found.beats
    assert found.verdict == (
        "It does NOT beat the default on the held-back data. GOSPA: 5.000 m by default, 5.000 m "
        "tuned, no difference."
    )


def test_a_clear_gain_beats_it_with_its_interval():
    rng = np.random.default_rng(1)
    before = noisy(rng, 10.0)
    found = compare([GOSPA], [score_of(before)], [score_of(before - 2.0)], 0)
    (difference,) = found.differences
    assert found.beats
    assert difference.gain == pytest.approx(2.0, abs=0.02)
    low, high = difference.interval
    assert low <= difference.tuned - difference.default <= high < 0.0
    assert found.verdict.startswith("It beats the default on the held-back data. GOSPA: ")
    assert "95 % interval" in found.verdict
    assert compare([GOSPA], [score_of(before)], [score_of(before - 2.0)], 0).differences == [
        difference
    ]


def test_a_gain_within_chance_is_said_to_be_one():
    rng = np.random.default_rng(2)
    before, after = noisy(rng, 10.0), noisy(rng, 9.99)
    after *= (np.sqrt(np.mean(before**2)) - 0.01) / np.sqrt(np.mean(after**2))
    found = compare([GOSPA], [score_of(before)], [score_of(after)], 0)
    assert found.beats
    assert "by less than can be told from chance" in found.verdict


def test_a_gain_on_too_little_data_is_said_to_be_one():
    found = compare([GOSPA], [score_of([5.0] * 40)], [score_of([4.0] * 40)], 0)
    assert found.differences[0].interval is None
    assert "too few to tell whether by chance" in found.verdict


def test_a_loss_is_said_plainly():
    found = compare([GOSPA], [score_of([5.0] * 40)], [score_of([6.0] * 40)], 0)
    assert not found.beats
    assert "does NOT beat the default" in found.verdict
    assert "+1.000 m" in found.verdict


def test_worse_in_one_of_two_does_not_beat_it():
    before = score_of([5.0] * 40, switches=0)
    after = score_of([4.0] * 40, switches=1)
    assert not compare([GOSPA, SWITCHES], [before], [after], 0).beats
    assert compare([GOSPA, SWITCHES], [before], [score_of([4.0] * 40)], 0).beats


def test_counts_of_few_recordings_have_no_interval_of_many_they_have():
    before = [score_of([1.0] * 20, f"run {n}", switches=n % 3) for n in range(12)]
    after = [score_of([1.0] * 20, f"run {n}", switches=0) for n in range(12)]
    (few,) = compare([SWITCHES], before[:2], after[:2], 0).differences
    assert few.interval is None
    assert not few.certain
    (many,) = compare([SWITCHES], before, after, 0).differences
    assert many.tuned - many.default == pytest.approx(-1.0)
    assert many.interval[0] < -1.0 < many.interval[1] < 0.0


def test_the_interval_covers_what_a_new_recording_would_show():
    """Nine in ten or more of intervals from 100 scans hold the difference of a million."""
    rng = np.random.default_rng(3)
    truth = np.sqrt(np.mean(noisy(rng, 9.5, 10**6) ** 2)) - np.sqrt(
        np.mean(noisy(rng, 10.0, 10**6) ** 2)
    )
    held = 0
    for seed in range(60):
        before, after = noisy(rng, 10.0, 200), noisy(rng, 9.5, 200)
        (found,) = compare([GOSPA], [score_of(before)], [score_of(after)], seed).differences
        held += found.interval[0] <= truth <= found.interval[1]
    assert held >= 0.85 * 60


def test_other_cases_are_refused():
    with pytest.raises(ValueError, match="different cases"):
        compare([GOSPA], [score_of([1.0], "a")], [score_of([1.0], "b")], 0)
    with pytest.raises(ValueError, match="false tracks cannot be told"):
        compare([OBJECTIVES["false_tracks"]], [score_of([1.0])], [score_of([1.0])], 0)
