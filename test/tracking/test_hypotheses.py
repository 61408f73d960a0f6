"""The hypothesis table: rows, and belief columns that never lose mass."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.tracking.hypotheses import ROW_FIELDS, HypothesisTable, move_columns

FRAME, CLASSES = ("VS", "S", "B"), ("false_alarm", "fighter", "cargo")
TOTAL = 0b1111111  # all Venn parts of three elements

columns = st.lists(st.integers(1, TOTAL), unique=True, min_size=1, max_size=8)


def table_of(h, focal=(1, 2, 4), seed=0):
    rng = np.random.default_rng(seed)
    plain = [name for name in ROW_FIELDS if not name.startswith("model_")]
    values = {name: rng.integers(0, 100, h) for name in plain}
    values |= {
        "hypothesis_id": np.arange(h) + 10,
        "mean": rng.normal(size=(h, 4)),
        "covariance": rng.normal(size=(h, 4, 4)),
        "conflict": rng.random(h),
        "masses": rng.dirichlet(np.ones(len(focal)), h).reshape(h, len(focal)),
        "class_probability": rng.dirichlet(np.ones(3), h).reshape(h, 3),
        "window_kind": rng.integers(0, 3, (h, 2), dtype=np.int32),
        "window_masses": rng.dirichlet(np.ones(4), (h, 2)).reshape(h, 2, 4),
        "window_log_class_likelihood": rng.normal(size=(h, 2, 3)),
        "chosen": np.ones(h, dtype=bool),
        "log_score": rng.normal(size=h),
        "detection_numbers": np.zeros((h, 0), dtype=np.int64),
        "strength": np.zeros((h, 0)),
        "extended": np.zeros((h, 0)),
    }
    return HypothesisTable(
        **values,
        frame=FRAME,
        focal=np.array(focal, dtype=np.uint32),
        class_names=CLASSES,
        window_focal=np.array([1, 2, 4, TOTAL], dtype=np.uint32),
    )


def masses_by_element(table):
    """One dictionary {element: mass} per row, without zeros."""
    return [{int(f): m for f, m in zip(table.focal, row, strict=True) if m} for row in table.masses]


@settings(derandomize=True, deadline=None)
@given(columns, columns, st.integers(0, 4), st.randoms(use_true_random=False))
def test_use_focal_keeps_every_mass_at_its_element(old, new, h, random):
    table = table_of(h, old)
    # Some columns carry nothing and may go.
    for column in range(len(old)):
        if random.random() < 0.4:
            table.masses[:, column] = 0.0
    before = masses_by_element(table)
    table.use_focal(np.array(new, dtype=np.uint32))
    assert masses_by_element(table) == before
    assert table.focal[: len(new)].tolist() == new
    assert len(set(table.focal.tolist())) == len(table.focal)
    assert table.masses.shape == (h, len(table.focal))
    # Beyond the new columns stand only those that carry mass.
    assert set(table.focal[len(new) :].tolist()) <= {e for row in before for e in row}


@settings(derandomize=True, deadline=None)
@given(columns, st.permutations(range(1, 9)), st.integers(1, 5))
def test_moving_columns_there_and_back_changes_nothing(focal, extra, rows):
    rng = np.random.default_rng(len(focal))
    masses = rng.random((rows, len(focal)))
    old = np.array(focal, dtype=np.uint32)
    wide = np.array(
        [int(e) << 8 for e in extra[:3]] + focal[::-1] + [int(e) << 8 for e in extra[3:]],
        dtype=np.uint32,
    )
    moved = move_columns(masses, old, wide)
    np.testing.assert_array_equal(moved.sum(axis=1).round(12), masses.sum(axis=1).round(12))
    np.testing.assert_array_equal(move_columns(moved, wide, old), masses)


def test_columns_of_nothing():
    none = np.zeros(0, dtype=np.uint32)
    assert move_columns(np.zeros((2, 0)), none, np.array([1, 2], dtype=np.uint32)).shape == (2, 2)
    assert move_columns(np.zeros((2, 2)), np.array([1, 2], dtype=np.uint32), none).shape == (2, 0)
    assert move_columns(np.zeros((0, 2)), np.array([1, 2], dtype=np.uint32), none).shape == (0, 0)


def test_the_same_frame_leaves_beliefs_alone():
    table = table_of(3)
    before = dataclasses.replace(table)
    table.use_frame(FRAME, CLASSES)
    assert table.masses is before.masses
    assert table.class_probability is before.class_probability


@pytest.mark.parametrize(
    ("frame", "classes"),
    [(("A", "B"), ("a", "b")), (FRAME, ("false_alarm", "bird", "cargo")), (("A",) * 4, ("a",) * 4)],
)
def test_another_frame_makes_beliefs_void(frame, classes):
    table = table_of(3)
    table.use_frame(frame, classes)
    assert table.frame == frame
    assert table.class_names == classes
    # Total ignorance: all Venn parts of the frame.
    assert table.focal.tolist() == [2 ** (2 ** len(frame) - 1) - 1]
    np.testing.assert_array_equal(table.masses, np.ones((3, 1)))
    np.testing.assert_allclose(table.class_probability, 1.0 / len(classes))
    np.testing.assert_array_equal(table.conflict, 0.0)
    # The windows are as long as before, with nothing in them.
    np.testing.assert_array_equal(table.window_kind, np.zeros((3, 2)))
    assert table.window_masses.shape == (3, 2, len(table.window_focal))
    assert table.window_log_class_likelihood.shape == (3, 2, len(classes))


def test_select_and_append_are_inverse():
    table = table_of(5)
    mask = np.array([True, False, True, False, True])
    joined = table.select(mask).append(table.select(~mask))
    order = np.argsort(joined.hypothesis_id)
    for name in ROW_FIELDS:
        np.testing.assert_array_equal(getattr(joined.select(order), name), getattr(table, name))
    assert joined.frame == FRAME
    assert joined.class_names == CLASSES
    assert joined.focal is table.focal


def test_an_empty_table_has_the_shapes_of_a_full_one():
    empty = HypothesisTable()
    assert len(empty) == 0
    assert empty.mean.shape == (0, 4)
    assert empty.covariance.shape == (0, 4, 4)
    empty.use_frame(FRAME, CLASSES)
    empty.use_focal(np.array([1, 2], dtype=np.uint32))
    assert empty.masses.shape == (0, 2)
    other = table_of(2, (1, 2))
    other.clear_windows(0)
    assert len(empty.append(other)) == 2
