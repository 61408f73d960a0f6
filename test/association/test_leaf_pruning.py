"""Pruning of leaves: against a loop over tracks, and its guarantees."""

import numpy as np
import pytest

from gda_tracker.association.errors import AssociationInputError
from gda_tracker.association.leaf_pruning import n_scan_decision


def random_case(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 40))
    track = random.integers(0, 8, n) * 7
    ancestors = random.integers(-1, 4, (n, 3)) + 10 * track[:, None]
    chosen = np.zeros(n, dtype=bool)
    for t in np.unique(track):
        if random.random() < 0.8:
            chosen[random.choice((track == t).nonzero()[0])] = True
    return chosen, track, ancestors, random.random(n).round(1)


def by_loop(chosen, track, ancestors, probability, least, most):
    kept = np.zeros(len(track), dtype=bool)
    for t in np.unique(track):
        rows = (track == t).nonzero()[0].tolist()
        head = [r for r in rows if chosen[r]]
        if head:
            rows = [r for r in rows if ancestors[r, -1] == ancestors[head[0], -1]]
        rows.sort(key=lambda r: (not chosen[r], -probability[r], r))
        rows = [r for i, r in enumerate(rows) if i == 0 or probability[r] >= least][:most]
        kept[rows] = True
    return kept


@pytest.mark.parametrize("seed", range(60))
def test_equals_a_loop_over_tracks(seed):
    chosen, track, ancestors, probability = random_case(seed)
    found = n_scan_decision(chosen, track, ancestors)
    expected = by_loop(chosen, track, ancestors, probability, 0.0, None)
    np.testing.assert_array_equal(found, expected)
    for least, most in ((0.0, 2), (0.5, None), (0.3, 3), (1.0, 1)):
        found = n_scan_decision(
            chosen,
            track,
            ancestors,
            probability=probability,
            min_probability=least,
            max_leaves=most,
        )
        expected = by_loop(chosen, track, ancestors, probability, least, most)
        np.testing.assert_array_equal(found, expected)
        assert found[chosen].all()
        assert set(track[found]) == set(track)


def test_a_track_younger_than_the_window_keeps_its_leaves():
    ancestors = [[4, 1, -1], [5, 1, -1], [6, 2, -1]]
    assert n_scan_decision([0, 1, 0], [9, 9, 9], ancestors).all()


def test_no_leaves():
    assert n_scan_decision([], [], np.zeros((0, 4), dtype=int)).shape == (0,)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"chosen": [True, True, False]}, "track 1 has 2 chosen leaves"),
        ({"chosen": [[True, False, False]]}, "chosen has shape"),
        ({"track": [1, 1]}, "track has shape"),
        ({"ancestors": [[1], [2]]}, "ancestors has shape"),
        ({"ancestors": np.zeros((3, 0), dtype=int)}, "ancestors has shape"),
        ({"min_probability": 0.1}, "probability is missing"),
        ({"max_leaves": 2}, "probability is missing"),
        ({"max_leaves": 0}, "max_leaves = 0"),
        ({"min_probability": 1.5}, "min_probability = 1.5"),
        ({"max_leaves": 2, "probability": [0.1, 0.2]}, "probability has shape"),
        ({"max_leaves": 2, "probability": [0.1, 0.2, np.nan]}, "1 NaN"),
    ],
)
def test_wrong_arguments_are_named(changes, message):
    arguments = {"chosen": [True, False, True], "track": [1, 1, 2], "ancestors": [[1], [2], [3]]}
    arguments |= changes
    with pytest.raises(AssociationInputError, match=message):
        n_scan_decision(**arguments)
