"""Scores of a case: worked by hand, and against the measures of ``evaluate``."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from tuning_examples import TENTATIVE, case_of, short_base, short_cases, tracks_at

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.set_distances import score_set_distances
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.ring import Ring
from gda_tracker.tuning.cases import Case, fingerprint
from gda_tracker.tuning.scores import measures, score_case, score_tracks, track_recording
from gda_tracker.vocabulary.recordings import Recording

UNKNOWN = (np.nan, np.nan)


def test_gospa_with_partial_truth_counts_tracks_near_known_targets_only():
    # One target known on both scans, another on none.
    case = case_of([[(0.0, 0.0), UNKNOWN], [(10.0, 0.0), UNKNOWN]])
    tracks = [
        # 3 m off; a double at 20 m; a moored boat far away; a tentative track.
        tracks_at(
            0, [(3, 0), (0, 20), (200, 0), (1, 0)], (1, 2, 3, 4), status=(1, 1, 1, TENTATIVE)
        ),
        tracks_at(1, [(200, 0)], (3,)),
    ]
    found = measures([score_tracks(case, tracks)])
    c2 = 25.0**2 / 2
    assert found["gospa_m"] == pytest.approx(math.sqrt((9 + c2 + c2) / 2))
    assert found["localisation_m"] == pytest.approx(math.sqrt(9 / 2))
    assert found["false_m"] == pytest.approx(math.sqrt(c2 / 2))
    assert found["missed_m"] == pytest.approx(math.sqrt(c2 / 2))
    assert found["gospa_every_track_m"] == pytest.approx(math.sqrt((9 + 2 * c2 + 2 * c2) / 2))
    assert found["completeness"] == 0.5
    assert found["position_error_m"] == pytest.approx(3.0)
    assert found["false_tracks"] is None
    assert found["purity"] is None
    assert found["confirmed_tracks"] == 3


def test_scans_without_a_known_target_do_not_count_where_the_truth_is_partial():
    tracks = [tracks_at(0, [(0, 0)], (1,)), tracks_at(1, [(0, 0)], (1,))]
    partial = case_of([[(0.0, 0.0)], [UNKNOWN]])
    assert measures([score_tracks(partial, tracks)])["gospa_m"] == 0.0
    complete = case_of([[(0.0, 0.0)], [UNKNOWN]], partial=False)
    expected = math.sqrt(25.0**2 / 2 / 2)
    assert measures([score_tracks(complete, tracks)])["gospa_m"] == pytest.approx(expected)


def test_purity_is_the_share_of_detections_from_the_tracks_own_target():
    here = [(0.0, 0.0), (100.0, 0.0)]
    sources = [[1, 2, -1], [1, 2], [1, 2, -1], [2, 1]]
    case = case_of([here] * 4, sources, partial=False)
    # Track 7 takes target 1, 1, clutter, 2; track 9 takes 2, none, 2, 1; track 3 clutter alone.
    taken = [(0, 1, 2), (0, -1, -1), (2, 1, -1), (0, 1, -1)]
    tracks = [
        tracks_at(scan, [*here, (500, 0)], (7, 9, 3), detection)
        for scan, detection in enumerate(taken)
    ]
    found = score_tracks(case, tracks)
    assert found.scans[:, 9].tolist() == [3, 1, 2, 2]
    assert found.scans[:, 10].tolist() == [2, 1, 1, 0]
    assert measures([found])["purity"] == pytest.approx(4 / 8)


def test_purity_against_counting_one_by_one():
    rng = np.random.default_rng(5)
    scans, count = 40, 12
    sources = rng.integers(-1, 4, (scans, count))
    sources[sources == 0] = -1
    tracks, taken = [], []
    for scan in range(scans):
        ids = np.sort(rng.choice(8, rng.integers(0, 6), replace=False))
        detection = rng.choice(count, len(ids), replace=False) - (rng.random(len(ids)) < 0.2) * 99
        detection = np.maximum(detection, -1)
        tracks.append(tracks_at(scan, rng.normal(size=(len(ids), 2)), ids, detection))
        taken += [
            (track, sources[scan, d]) for track, d in zip(ids, detection, strict=True) if d >= 0
        ]
    case = case_of(np.zeros((scans, 3, 2)), sources.tolist(), partial=False)
    own = 0
    for track in {track for track, _ in taken}:
        counts = Counter(source for mine, source in taken if mine == track and source > 0)
        own += max(counts.values(), default=0)
    assert measures([score_tracks(case, tracks)])["purity"] == pytest.approx(own / len(taken))


def test_tracks_without_a_detection_of_a_target_are_not_pure():
    case = case_of([[(0.0, 0.0)]], [[-1]], partial=False)
    assert measures([score_tracks(case, [tracks_at(0, [(0, 0)], (1,), (0,))])])["purity"] == 0.0
    assert measures([score_tracks(case, [tracks_at(0, [], ())])])["purity"] == 0.0


def test_scores_are_those_of_evaluate():
    cases, base = short_cases(2), short_base()
    scores = [score_case(case, base) for case in cases]
    gospa, runs = [], []
    for case in cases:
        ring = Ring(base)
        tracks = [ring.process(scan).tracks for scan in case.recording.detections]
        gospa.append(score_set_distances(tracks, case.recording.truth, 200.0))
        runs.append(score_continuity(tracks, case.recording.truth, match_distance_m=200.0))
    found = measures(scores)
    squares = np.concatenate([one.gospa_m**2 for one in gospa])
    assert found["gospa_m"] == pytest.approx(math.sqrt(squares.mean()))
    assert found["gospa_every_track_m"] == found["gospa_m"]
    matched, samples = (sum(getattr(r, n).sum() for r in runs) for n in ("matched", "samples"))
    assert found["completeness"] == pytest.approx(matched / samples)
    assert found["switches"] == np.mean([run.identity_switches for run in runs])
    assert found["false_tracks"] == np.mean([run.false_tracks for run in runs])
    assert found["not_extracted"] == np.mean([run.targets_not_extracted for run in runs])
    assert scores[0].cpu_s > 0.0


def test_a_target_never_found_counts_with_the_whole_time():
    case = case_of([[(0.0, 0.0), (900.0, 0.0)]] * 5)
    tracks = [tracks_at(0, [], ()), *(tracks_at(scan, [(0, 0)], (1,)) for scan in range(1, 5))]
    found = measures([score_tracks(case, tracks)])
    assert found["delay_s"] == pytest.approx((1.0 + 4.0) / 2)
    assert found["not_extracted"] == 1


def test_a_rejected_scan_has_no_tracks():
    (case,) = short_cases()
    base = short_base()
    tracks, _ = track_recording(case.recording, base)
    assert len(tracks) == len(case.recording.detections)
    base["track_manager"]["max_detections_per_scan"] = 1
    tracks, _ = track_recording(case.recording, base)
    assert [len(live) for live in tracks] == [0] * len(case.recording.detections)
    assert score_case(case, base).total("matched") == 0


def test_scans_that_wait_for_others_are_scored_all_the_same():
    (case,) = short_cases()
    base = short_base()
    plain = score_case(case, base)
    base["track_manager"].update(reorder_window_s=12.0, time_jump_s=60.0)
    assert np.array_equal(score_case(case, base).scans, plain.scans)


def test_cases_without_truth_or_distance_are_refused():
    (case,) = short_cases()
    with pytest.raises(ParameterError, match="--truth"):
        Case("bare", Recording("bare", case.recording.detections), 25.0, True)
    with pytest.raises(ParameterError, match="match_distance_m = 0"):
        Case("near", case.recording, 0.0, True)


def test_the_fingerprint_tells_other_scans_truth_and_scoring_apart():
    one, two = short_cases(2)
    assert fingerprint([one]) == fingerprint(short_cases(1))
    others = [
        [two],
        [one, two],
        [Case(one.name, one.recording, 100.0, False)],
        [Case(one.name, one.recording, 200.0, True)],
    ]
    prints = {fingerprint([one]), *(fingerprint(other) for other in others)}
    one.recording.truth[3].target_state[0, 0] += 1e-9
    prints.add(fingerprint([one]))
    assert len(prints) == 6
