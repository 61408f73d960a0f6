"""Continuity on cases made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.matching import match_scan
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE, ScanKey, ScanTruth, Tracks

FAR = 1e4


def truth(*positions: tuple[float, float]) -> ScanTruth:
    states = np.array([[x, y, 0.0, 0.0] for x, y in positions]).reshape(-1, 4)
    ids = np.arange(1, len(positions) + 1, dtype=np.int32)
    return ScanTruth("radar", 0, target_id=ids, target_state=states)


def tracks(positions: dict[int, tuple[float, float]], tentative: tuple[int, ...] = ()) -> Tracks:
    ids = sorted(positions)
    return Tracks(
        key=ScanKey(0, "radar", 0),
        track_id=np.array(ids, dtype=np.int64),
        status=np.array([TENTATIVE if i in tentative else CONFIRMED for i in ids], dtype=np.int64),
        mean=np.array([[*positions[i], 0.0, 0.0] for i in ids]).reshape(-1, 4),
    )


TWO = truth((0.0, 0.0), (100.0, 0.0))


def test_a_perfect_run():
    score = score_continuity([tracks({5: (3.0, 4.0), 6: (100.0, 0.0)})] * 4, [TWO] * 4)
    assert score.completeness == 1.0
    assert (score.identity_flips, score.identity_switches) == (0, 0)
    assert (score.confirmed_tracks, score.false_tracks) == (2, 0)
    assert score.position_rmse_m == pytest.approx(math.sqrt(25.0 / 2.0))


def test_completeness_counts_known_samples_only():
    unknown = truth((math.nan, math.nan), (100.0, 0.0))
    score = score_continuity([tracks({5: (0.0, 0.0)})] * 2, [TWO, unknown])
    np.testing.assert_array_equal(score.target_id, [1, 2])
    np.testing.assert_array_equal(score.samples, [1, 2])
    np.testing.assert_allclose(score.completeness_per_target, [1.0, 0.0])
    assert score.completeness == pytest.approx(1.0 / 3.0)


def test_tentative_tracks_do_not_count():
    score = score_continuity([tracks({5: (0.0, 0.0)}, tentative=(5,))], [TWO])
    assert score.completeness == 0.0
    assert (score.confirmed_tracks, score.false_tracks) == (0, 0)
    assert math.isnan(score.position_rmse_m)


def test_one_track_covers_one_target_only():
    close = truth((0.0, 0.0), (10.0, 0.0))
    score = score_continuity([tracks({5: (5.0, 0.0)})], [close])
    assert score.completeness == 0.5


def test_match_distance_is_a_limit():
    for distance, expected in [(25.0, 1.0), (25.001, 0.0)]:
        score = score_continuity([tracks({5: (distance, 0.0)})], [truth((0.0, 0.0))])
        assert score.completeness == expected


def test_the_matching_prefers_two_pairs_within_reach_to_one_closer_pair():
    # Greedy matching would take target 1 with track 5 (distance 10) and leave target 2 alone.
    row, column, distance = match_scan(
        tracks({5: (10.0, 0.0), 6: (-20.0, 0.0)}), truth((0.0, 0.0), (30.0, 0.0)), 25.0
    )
    np.testing.assert_array_equal(row, [0, 1])
    np.testing.assert_array_equal(column, [1, 0])
    np.testing.assert_allclose(distance, [20.0, 20.0])


@pytest.mark.parametrize(
    ("sequence", "flips", "switches"),
    [
        ([7, 7, 7, 7, 7], 0, 0),
        ([7, 7, 8, 7, 7], 2, 0),
        ([7, 7, 8, 8, 7], 2, 0),
        ([7, 7, 8, 8, 8], 1, 1),
        ([7, 8, 8, 8, 7, 7, 7], 2, 2),
        ([7, 8, 9, 8, 9, 9, 9], 5 - 1, 1),
        ([7, 8, 8, None, None, 8], 1, 1),
        ([None, None, 7, 7], 0, 0),
    ],
)
def test_flips_and_lasting_switches(sequence, flips, switches):
    live = [tracks({} if i is None else {i: (0.0, 0.0)}) for i in sequence]
    score = score_continuity(live, [truth((0.0, 0.0))] * len(sequence))
    assert (score.identity_flips, score.identity_switches) == (flips, switches)


def test_false_tracks_are_confirmed_and_never_matched():
    live = [
        tracks({5: (0.0, 0.0), 8: (FAR, 0.0), 9: (FAR, FAR)}, tentative=(9,)),
        tracks({5: (0.0, 0.0), 8: (FAR, 0.0)}),
    ]
    score = score_continuity(live, [truth((0.0, 0.0))] * 2)
    assert (score.confirmed_tracks, score.false_tracks) == (2, 1)
    partial = score_continuity(live, [truth((0.0, 0.0))] * 2, truth_is_partial=True)
    assert partial.false_tracks is None


def test_latency_is_averaged():
    score = score_continuity([tracks({})] * 2, [TWO] * 2, latency_s=[0.004, 0.008])
    assert score.mean_latency_s == pytest.approx(0.006)
    assert math.isnan(score_continuity([tracks({})], [TWO]).mean_latency_s)


def test_no_scans_at_all():
    score = score_continuity([], [])
    assert math.isnan(score.completeness)
    assert score.confirmed_tracks == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [({"match_distance_m": 0.0}, "match_distance_m = 0.0"), ({"settle_scans": 0}, "settle_scans")],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        score_continuity([], [], **options)


def at(scan, value, sources=None):
    """The tracks or truth of a scan, 2 s apart."""
    if isinstance(value, Tracks):
        value.key = ScanKey(0, "radar", scan * 2_000_000_000)
        return value
    source_id = None if sources is None else np.array(sources, dtype=np.int32)
    return ScanTruth(
        "radar", scan * 2_000_000_000, value.target_id, value.target_state, source_id=source_id
    )


def test_extraction_delay_from_the_first_known_position():
    unknown = truth((math.nan, math.nan), (100.0, 0.0))
    known = [at(0, unknown), *[at(k, TWO) for k in range(1, 6)]]
    near = {5: (0.0, 0.0)}
    live = [at(k, tracks(near if k >= 3 else {})) for k in range(6)]
    score = score_continuity(live, known)
    np.testing.assert_array_equal(score.extraction_delay_scans, [2.0, math.nan])
    np.testing.assert_array_equal(score.extraction_delay_s, [4.0, math.nan])
    assert score.targets_not_extracted == 1
    assert score.duration_s == 10.0


def test_extraction_delay_from_the_first_detection_where_sources_are_known():
    sources = [[-1], [1], [1, 2], [1, -1], [2], [1]]
    known = [at(k, TWO, s) for k, s in enumerate(sources)]
    # Track 6 is near target 2 before the target was ever detected: by chance, not by extraction.
    live = [
        at(k, tracks({5: (0.0, 0.0), 6: (100.0, 0.0)} if k in (0, 3, 4) else {})) for k in range(6)
    ]
    score = score_continuity(live, known)
    np.testing.assert_array_equal(score.extraction_delay_scans, [2.0, 1.0])
    np.testing.assert_array_equal(score.extraction_delay_s, [4.0, 2.0])
    never = score_continuity(live, [at(k, TWO, [1]) for k in range(6)])
    assert math.isnan(never.extraction_delay_s[1])


def test_false_tracks_per_hour_and_their_life():
    one = truth((0.0, 0.0))
    # 8 is confirmed on scans 1 to 3 of 0 to 5 and gone on 4; 9 lives from scan 4 to the end.
    live = [
        tracks({5: (0.0, 0.0)}),
        tracks({5: (0.0, 0.0), 8: (FAR, 0.0)}),
        tracks({5: (0.0, 0.0), 8: (FAR, 0.0)}),
        tracks({5: (0.0, 0.0), 8: (FAR, 0.0), 9: (FAR, FAR)}, tentative=(9,)),
        tracks({5: (0.0, 0.0), 9: (FAR, FAR)}),
        tracks({5: (0.0, 0.0), 9: (FAR, FAR)}),
    ]
    live = [at(k, t) for k, t in enumerate(live)]
    known = [at(k, one) for k in range(6)]
    score = score_continuity(live, known)
    assert score.false_tracks == 2
    np.testing.assert_array_equal(score.false_track_life_s, [6.0, 2.0])
    assert score.false_tracks_per_hour == pytest.approx(2 * 3600.0 / 10.0)
    partial = score_continuity(live, known, truth_is_partial=True)
    assert math.isnan(partial.false_tracks_per_hour)
    assert len(partial.false_track_life_s) == 0
    assert math.isnan(score_continuity(live[:1], known[:1]).false_tracks_per_hour)
