"""M-of-N confirmation and deletion, against truth tables written out."""

import itertools

import numpy as np
import pytest

from gda_tracker.tracking.lifecycle import LONGEST_WINDOW, confirmed, ended, hits_in_window
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE


def bits(text):
    """History of a text such as ``1011``, the newest scan last."""
    return int(text, 2)


def live(pattern, *, hits=3, scans=4, deletion=4, tentative_deletion=2):
    """Life of a track that starts with its first two letters: status per scan until it ends.

    ``C`` confirmed, ``T`` tentative, ``X`` ended; the rules are applied to one row, scan by scan.
    """
    history = np.array([bits(pattern[:2])])
    age = np.array([2])
    coasted = np.array([0])
    status = confirmed(np.array([TENTATIVE]), history, hits, scans)
    story = "C" if status[0] == CONFIRMED else "T"
    for letter in pattern[2:]:
        hit = letter == "1"
        history = (history << 1) | hit
        age, coasted = age + 1, np.where(hit, 0, coasted + 1)
        status = confirmed(status, history, hits, scans)
        if ended(
            status,
            history,
            age,
            coasted,
            confirmation_hits=hits,
            confirmation_scans=scans,
            deletion_misses=deletion,
            tentative_deletion_misses=tentative_deletion,
        )[0]:
            return story + "X"
        story += "C" if status[0] == CONFIRMED else "T"
    return story


@pytest.mark.parametrize("window", [1, 3, 4, LONGEST_WINDOW])
def test_hits_in_window_counts_bits(window):
    texts = ["".join(p) for p in itertools.product("01", repeat=6)] + ["1" * 60, "10" * 30]
    history = np.array([bits(text) for text in texts], dtype=np.int64)
    expected = [text[-window:].count("1") for text in texts]
    np.testing.assert_array_equal(hits_in_window(history, window), expected)


@pytest.mark.parametrize(("hits", "scans"), [(2, 2), (2, 3), (3, 3), (3, 4), (3, 5), (4, 6)])
def test_m_of_n_confirms_exactly_where_a_loop_does(hits, scans):
    for pattern in itertools.product("01", repeat=8):
        text = "".join(pattern)
        history = np.array([bits(text)])
        expected = CONFIRMED if text[-scans:].count("1") >= hits else TENTATIVE
        assert confirmed(np.array([TENTATIVE]), history, hits, scans)[0] == expected
        # Once confirmed is confirmed.
        assert confirmed(np.array([CONFIRMED]), history, hits, scans)[0] == CONFIRMED


@pytest.mark.parametrize(
    ("pattern", "story"),
    [
        ("111", "TC"),
        ("1101", "TTC"),
        ("101", "TT"),
        # Two hits in four scans can not become three: it ends with the fourth.
        ("1100", "TTX"),
        ("1010", "TTX"),
        ("1011", "TTC"),
        # Confirmed, it coasts three scans and ends at the fourth miss in a row.
        ("1110001", "TCCCCC"),
        ("1110000", "TCCCCX"),
        ("11100011110000", "TCCCCCCCCCCCX"),
    ],
)
def test_three_of_four_worked(pattern, story):
    assert live(pattern) == story


def test_two_of_two_confirms_at_the_start():
    assert live("110", hits=2, scans=2) == "CC"


def test_zero_never_deletes():
    assert live("111" + "0" * 50, deletion=0) == "T" + "C" * 51
    # Without a limit of its own a tentative track still ends when it has no chance left.
    assert live("110000", hits=4, scans=6, tentative_deletion=0) == "TTTX"
    assert live("110000", hits=3, scans=6, tentative_deletion=0) == "TTTTX"


def test_tentative_tracks_have_their_own_limit():
    assert live("11000", hits=3, scans=10, tentative_deletion=1) == "TX"
    assert live("11000", hits=3, scans=10, tentative_deletion=3) == "TTTX"


def test_rows_do_not_touch_each_other():
    rng = np.random.default_rng(0)
    n = 200
    history, age = rng.integers(0, 2**20, n), rng.integers(2, 20, n)
    status, coasted = rng.integers(0, 2, n), rng.integers(0, 6, n)
    rules = {
        "confirmation_hits": 3,
        "confirmation_scans": 5,
        "deletion_misses": 4,
        "tentative_deletion_misses": 2,
    }
    together = ended(status, history, age, coasted, **rules)
    alone = [
        ended(*(values[i : i + 1] for values in (status, history, age, coasted)), **rules)[0]
        for i in range(n)
    ]
    np.testing.assert_array_equal(together, alone)
    assert 0 < together.sum() < n


def test_no_tracks():
    none = np.zeros(0, dtype=np.int64)
    assert confirmed(none, none, 3, 4).shape == (0,)
    rules = dict.fromkeys(
        ("confirmation_hits", "confirmation_scans", "deletion_misses", "tentative_deletion_misses"),
        3,
    )
    assert ended(none, none, none, none, **rules).shape == (0,)
