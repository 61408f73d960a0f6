"""The scan table: complete keys come out once, the rest is bounded, dropped and counted by name."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.nodes.scan_table import CAPACITY, ScanTable
from gda_tracker.vocabulary import ScanKey


def key(stamp, epoch=1, sensor="radar"):
    return ScanKey(epoch, sensor, stamp)


def table_of(*inputs, **options):
    counters = Counter()
    return ScanTable(inputs or ("scan", "predictions"), counters, **options), counters


def test_a_key_is_complete_with_all_its_inputs_in_any_order():
    for order in (("scan", "predictions"), ("predictions", "scan")):
        table, counters = table_of()
        assert table.put(order[0], key(1), order[0] + "!") is None
        assert len(table) == 1
        assert table.put(order[1], key(1), order[1] + "!") == {
            "scan": "scan!",
            "predictions": "predictions!",
        }
        assert len(table) == 0
        assert not counters


def test_one_input_is_complete_at_once():
    table, counters = table_of("scan")
    for stamp in (3, 1, 2):
        assert table.put("scan", key(stamp), stamp) == {"scan": stamp}
    assert not counters


def test_a_repeated_key_is_answered_again():
    table, counters = table_of()
    for _ in range(3):
        assert table.put("scan", key(1), "a") is None
        assert table.put("predictions", key(1), "b") == {"scan": "a", "predictions": "b"}
    assert not counters


def test_the_later_copy_of_an_input_holds():
    table, _ = table_of()
    table.put("scan", key(1), "old")
    table.put("scan", key(1), "new")
    assert table.put("predictions", key(1), "b")["scan"] == "new"


def test_sensors_and_stamps_are_kept_apart():
    table, counters = table_of()
    table.put("scan", key(1, sensor="north"), "n")
    table.put("scan", key(1, sensor="south"), "s")
    table.put("scan", key(2, sensor="south"), "s2")
    assert table.put("predictions", key(1, sensor="north"), "p") == {
        "scan": "n",
        "predictions": "p",
    }
    assert len(table) == 2
    assert not counters


def test_what_came_before_a_complete_key_is_dropped_as_incomplete():
    table, counters = table_of()
    table.put("scan", key(1), 1)
    table.put("predictions", key(2), 2)
    table.put("scan", key(3), 3)
    table.put("scan", key(4), 4)
    assert table.put("predictions", key(3), 3) is not None
    assert counters == Counter({"incomplete": 2})
    # The later key still waits.
    assert table.put("predictions", key(4), 4) is not None
    assert len(table) == 0


def test_the_rest_of_a_repeated_answer_is_no_loss():
    """The manager asked again, only one input came twice: the scan was answered already."""
    table, counters = table_of()
    table.put("scan", key(1), 1)
    table.put("predictions", key(1), 1)
    table.put("scan", key(1), 1)
    table.put("scan", key(2), 2)
    assert table.put("predictions", key(2), 2) is not None
    assert not counters


def test_the_oldest_goes_when_too_many_wait():
    table, counters = table_of()
    for stamp in range(CAPACITY + 3):
        assert table.put("scan", key(stamp), stamp) is None
        assert len(table) <= CAPACITY
    assert counters == Counter({"overflow": 3})
    assert table.put("predictions", key(2), 0) is None  # was dropped
    assert table.put("predictions", key(CAPACITY + 2), 0) is not None


def test_an_older_epoch_is_dropped_and_a_newer_one_clears_the_table():
    table, counters = table_of()
    table.put("scan", key(1, epoch=5), "old")
    table.put("scan", key(2, epoch=5), "old")
    assert table.put("predictions", key(1, epoch=6), "new") is None
    assert counters == Counter({"older_epoch": 2})
    assert table.put("predictions", key(2, epoch=5), "old") is None
    assert counters == Counter({"older_epoch": 3})
    assert table.put("scan", key(1, epoch=6), "new") == {"scan": "new", "predictions": "new"}


def test_a_new_epoch_may_answer_the_same_stamp_again():
    table, counters = table_of("scan")
    assert table.put("scan", key(1, epoch=1), "a") is not None
    assert table.put("scan", key(1, epoch=2), "b") == {"scan": "b"}
    assert not counters


def test_another_rule_of_completeness():
    """As the association stage in degraded mode: scores may be missing when the scan says so."""
    table, counters = table_of(
        "scan",
        "predictions",
        "scores",
        complete=lambda entry: (
            {"scan", "predictions"} <= set(entry)
            and ("scores" in entry or entry["predictions"] == "degraded")
        ),
    )
    table.put("scan", key(1), "s")
    assert table.put("predictions", key(1), "full") is None
    assert table.put("predictions", key(1), "degraded") is not None
    # The scores come after all: they wait for nothing and are no loss.
    assert table.put("scores", key(1), "late") is None
    for name in ("scan", "predictions", "scores"):
        complete = table.put(name, key(2), "full")
    assert set(complete) == {"scan", "predictions", "scores"}
    assert not counters


def test_an_unknown_input_is_an_error():
    table, _ = table_of()
    with pytest.raises(KeyError, match="input tracks: unknown; allowed are scan, predictions"):
        table.put("tracks", key(1), None)
    assert len(table) == 0


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(1, 6), st.integers(1, 3)), max_size=40),
    st.integers(1, 4),
)
def test_any_order_keeps_the_bound_and_accounts_for_every_key(puts, capacity):
    """What goes in comes out complete, still waits, or was dropped; values never mix keys."""
    table, counters = table_of("a", "b", capacity=capacity)
    for name, stamp, epoch in puts:
        complete = table.put(name, key(stamp, epoch), (name, stamp, epoch))
        assert len(table) <= capacity
        if complete is not None:
            assert complete == {n: (n, stamp, epoch) for n in "ab"}
    assert set(counters) <= {"older_epoch", "incomplete", "overflow"}
    newest = max((epoch for _, _, epoch in puts), default=0)
    if newest:
        # A fresh pair of the newest epoch is always answered.
        table.put("a", key(99, newest), 1)
        assert table.put("b", key(99, newest), 2) == {"a": 1, "b": 2}
