"""Point clouds: any layout is read to the last bit, contradictions are named."""

import numpy as np
import pytest
from cloud_examples import cloud
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.io.radar.point_cloud import PointCloudError, field_types, read_fields

KINDS = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_layout_is_read_exactly(data):
    kinds = data.draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=6))
    offset, layout = 0, []
    for index, kind in enumerate(kinds):
        offset += data.draw(st.integers(0, 5))  # not packed, not aligned
        layout.append((f"field_{index}", kind, offset))
        offset += np.dtype(kind).itemsize
    height = data.draw(st.integers(1, 3))
    n = height * data.draw(st.integers(1, 5))
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    columns = {}
    for name, kind, _ in layout:
        if kind[0] == "f":
            columns[name] = rng.normal(0.0, 100.0, n).astype(kind)
        else:
            limits = np.iinfo(kind)
            columns[name] = rng.integers(limits.min, limits.max, n, endpoint=True, dtype=kind)
    message = cloud(
        columns,
        layout,
        step=offset + data.draw(st.integers(0, 7)),
        big=data.draw(st.booleans()),
        height=height,
        row_padding=data.draw(st.integers(0, 9)),
    )
    found = read_fields(message, columns)
    for name, expected in columns.items():
        assert found[name].dtype == np.float64
        np.testing.assert_array_equal(found[name], expected.astype(np.float64))


def test_a_float_that_the_driver_declares_as_a_byte_is_read_by_the_override():
    """The SRR520 driver's field ``rcs``."""
    rcs = np.array([-25.5, 3.25, 10.0])
    message = cloud({"rcs": rcs}, [("rcs", "f4", 3)], step=9, declared={"rcs": "u1"})
    assert field_types(message) == {"rcs": "uint8"}
    assert not np.array_equal(read_fields(message, ["rcs"])["rcs"], rcs)
    found = read_fields(message, ["rcs"], {"rcs": "float32"})["rcs"]
    np.testing.assert_array_equal(found, rcs)


def test_nan_stays_nan_and_an_empty_cloud_has_empty_fields():
    message = cloud({"x": np.array([1.0, np.nan])}, [("x", "f4", 0)])
    assert np.isnan(read_fields(message, ["x"])["x"]).tolist() == [False, True]
    message.width, message.data = 0, b""
    assert read_fields(message, ["x"])["x"].shape == (0,)


def test_a_cloud_of_one_row_may_leave_row_step_zero():
    message = cloud({"x": np.array([1.0, 2.0])}, [("x", "f8", 0)])
    message.row_step = 0
    assert read_fields(message, ["x"])["x"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"point_step": 6}, r"'y': float32 at byte 4 reaches beyond the point of 6 bytes"),
        ({"width": 3}, r"data has 16 bytes, 24 are needed for 3 points"),
        ({"height": 2, "width": 1, "row_step": 4}, r"row_step = 4: a row has 1 points of 8 bytes"),
        ({"width": 2**30}, r"point cloud of 1073741824 x 1"),
        ({"width": -1}, r"point cloud of -1 x 1"),
    ],
)
def test_contradictions_are_named(change, message):
    example = cloud(
        {"x": np.array([1.0, 2.0]), "y": np.array([3.0, 4.0])}, [("x", "f4", 0), ("y", "f4", 4)]
    )
    for name, value in change.items():
        setattr(example, name, value)
    with pytest.raises(PointCloudError, match=message):
        read_fields(example, ["x", "y"])


def test_unknown_fields_and_types_are_named():
    example = cloud({"x": np.array([1.0])}, [("x", "f4", 0)])
    with pytest.raises(PointCloudError, match=r"'rcs' is not in the point cloud.*are x"):
        read_fields(example, ["rcs"])
    with pytest.raises(PointCloudError, match=r"'x': type 'float16', allowed is one of int8"):
        read_fields(example, ["x"], {"x": "float16"})
    example.fields[0].datatype = 42
    with pytest.raises(PointCloudError, match=r"'x': type 42"):
        read_fields(example, ["x"])
    assert field_types(example) == {"x": "datatype 42"}
    example.fields[0].datatype, example.fields[0].count = 7, 3
    assert field_types(example) == {"x": "float32[3]"}
