"""Files of lanes and plans: the shipped example, and messages that name the place."""

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.events.detector import TrackEventDetector
from gda_tracker.events.parameters import EventParameters
from gda_tracker.io.context_files import ContextFileError, parse_context, read_context_file
from gda_tracker.resources import resource

EXAMPLE = resource("params", "context_example.yaml")


def test_the_example_is_read_as_it_stands():
    context = read_context_file(EXAMPLE)
    fairway, ferry = context.lanes
    (plan,) = context.plans
    assert (context.frame_id, fairway.name, fairway.direction) == ("map", "fairway", "forward")
    assert (ferry.direction, ferry.width_m, ferry.margin_m) == ("both", 150.0, 80.0)
    assert fairway.points.tolist() == [[0, 0], [2000, 0], [4000, 800]]
    assert (plan.track_id, plan.margin_m) == (7, 100.0)
    point, tolerance = plan.at(1_760_000_140_000_000_000)
    np.testing.assert_allclose(point, [1000.0, 0.0])
    assert tolerance == 100.0
    assert plan.at(1_759_999_999_999_999_999) is None
    assert plan.at(1_760_000_280_000_000_001) is None
    TrackEventDetector(EventParameters(), context)


def changed(*path_and_value):
    """The example with one value changed (``...`` removes the key)."""
    content = yaml.safe_load(EXAMPLE.read_text())
    *path, last, value = path_and_value
    place = content
    for step in path:
        place = place[step]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return yaml.safe_dump(content)


WAYPOINT = ("plans", 0, "waypoints", 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("lane", []), "f: unknown key 'lane', did you mean lanes?"),
        (("frame_id", 5), "f: frame_id = 5: allowed is a text"),
        (("lanes", {}), "f: lanes = {}: allowed is a list"),
        (("lanes", 1, 5), "f: lane 2: 5: allowed are keys name, width_m"),
        (("lanes", 0, "width_m", ...), "f: lane 1: the key width_m is missing"),
        (("lanes", 0, "width", 3), "f: lane 1: unknown key 'width', did you mean width_m?"),
        (("lanes", 0, "name", ""), "f: lane 1: name = '': allowed is a text"),
        (("lanes", 1, "name", "fairway"), "f: lanes: 'fairway' occurs twice"),
        (("lanes", 0, "width_m", 0), "f: lane 1 (fairway): width_m = 0.0: allowed is a number > 0"),
        (("lanes", 0, "margin_m", "wide"), "margin_m = 'wide': allowed is a number"),
        (("lanes", 0, "margin_m", True), "margin_m = True: allowed is a number"),
        (("lanes", 0, "margin_m", float("nan")), "margin_m = nan: allowed is a finite number"),
        (("lanes", 0, "margin_m", 10**400), "allowed is a finite number"),
        (("lanes", 0, "direction", "back"), "direction = 'back': allowed is one of forward, both"),
        (("lanes", 0, "direction", []), "direction = []: allowed is one of forward, both"),
        (
            ("lanes", 0, "points_m", [[0, 0]]),
            "points_m = [[0, 0]]: allowed is a list of at least 2",
        ),
        (("lanes", 0, "points_m", 1, [0, 0]), "points_m, point 2: the same place as the one"),
        (("lanes", 0, "points_m", 2, [0]), "points_m, point 3 = [0]: allowed is [x, y]"),
        (("lanes", 0, "points_m", 2, [0, 1e10]), "allowed are numbers up to 1e+09"),
        (("plans", 0, "track_id", -1), "f: plan 1 (ferry at noon): track_id = -1: allowed is"),
        (("plans", 0, "track_id", 1.0), "track_id = 1.0: allowed is an integer >= 0"),
        (("plans", 0, "margin_m", 3.0), "margin_m = 3.0: allowed is a number > 3.528, 3.53% of"),
        (
            (*WAYPOINT, "time_s", 5),
            "waypoint 2: time_s = 5.0: allowed is a time after the waypoint",
        ),
        ((*WAYPOINT, "time_s", -5), "waypoint 2: time_s = -5.0: allowed is a number >= 0"),
        ((*WAYPOINT, "position_m", ...), "waypoint 2: the key position_m is missing"),
        ((*WAYPOINT, "tolerance_m", -1), "waypoint 2: tolerance_m = -1.0: allowed is a number > 0"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(change, message):
    with pytest.raises(ContextFileError) as raised:
        parse_context(changed(*change), "f")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_two_plans_for_one_track_are_refused():
    content = yaml.safe_load(EXAMPLE.read_text())
    content["plans"].append({**content["plans"][0], "name": "other"})
    with pytest.raises(ContextFileError, match="plans: track_id: 7 occurs twice"):
        parse_context(yaml.safe_dump(content), "f")


def test_files_that_are_none(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    for path, message in (
        (tmp_path / "absent", "No such file"),
        (tmp_path, "Is a directory"),
        (tmp_path / "binary", "not a text file"),
    ):
        with pytest.raises(ContextFileError, match=message):
            read_context_file(path)
    for text in ("a: [", "lanes: []\nlanes: []", "", "- 1"):
        with pytest.raises(ContextFileError, match="^f: "):
            parse_context(text, "f")


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["lanes", "plans", "name", "width_m", "points_m", "waypoints"]), inner
        )
    ),
    max_leaves=12,
)


@settings(max_examples=60, deadline=None)
@given(content=JSON)
def test_any_content_is_read_or_refused_in_one_line(content):
    refusals = []
    try:
        parse_context(yaml.safe_dump(content), "f")
    except ContextFileError as error:
        refusals.append(str(error))
    assert all("\n" not in text for text in refusals)
