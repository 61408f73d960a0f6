"""Ranges of parameters: what is read, what is refused, a default space without a wrong point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.io.parameter_files import read_parameter_file
from gda_tracker.parameters import ParameterError, specifications
from gda_tracker.tracking.ring import STAGE_TABLES, stage_parameters
from gda_tracker.tuning.search_space import (
    Range,
    base_point,
    base_value,
    default_space,
    parse_range,
    with_point,
)
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections

PRESETS = sorted((Path(__file__).resolve().parents[2] / "params" / "presets").glob("*.yaml"))


def plain_recording(**fields):
    return Recording("plain", [Detections("radar", 0, np.ones(1), np.zeros(1), **fields)])


def base_of(path):
    return {
        node: values for node, values in read_parameter_file(path).items() if node in STAGE_TABLES
    }


def test_ranges_are_read_in_the_declared_type():
    assert parse_range("range_std_m=5:40", {}) == Range("track_manager", "range_std_m", 5.0, 40.0)
    log = parse_range("clutter_density_per_m_rad=1e-6:1e-3:log", {})
    assert (log.low, log.high, log.log) == (1e-6, 1e-3, True)
    whole = parse_range("deletion_misses=2:9", {})
    assert (whole.low, whole.high) == (2, 9)
    assert isinstance(whole.low, int)
    choices = parse_range("decision=map|mht", {})
    assert choices.choices == ("map", "mht")
    assert parse_range("use_range_rate=true|false", {}).choices == (True, False)
    other = parse_range("association.max_exact_size=4:14", {})
    assert other.node == "association"


ERRORS = {
    "range_std=1:2": "did you mean range_std_m",
    "range_std_m": "allowed is name=low:high",
    "range_std_m=1": "the default is 30.0",
    "range_std_m=1:2:lin": "allowed is name=low:high",
    "range_std_m=one:2": "allowed is name=low:high",
    "range_std_m=2:1": "a low that is less than high",
    "range_std_m=0:2": "allowed is a number > 0",
    "detection_probability=0:1:log": "a low above 0",
    "detection_probability=0.5:1.5": "allowed is a number >= 0 and <= 1",
    "deletion_misses=2:2.5": "allowed is an integer",
    "decision=map|guess": "allowed is one of gda",
    "decision=map": "two choices or more",
    "tracking_frame=a|b": "is a text",
    "imm_mean_sojourn_s=1:2": "is a list",
    "node.range_std_m=1:2": "node node: allowed is one of track_manager",
}


@pytest.mark.parametrize("text", ERRORS)
def test_errors_name_the_option_and_what_is_allowed(text):
    with pytest.raises(ParameterError) as error:
        parse_range(text, {})
    assert ERRORS[text] in str(error.value)
    assert str(error.value).startswith(f"--parameter {text}: ")


def test_names_are_unique_among_the_nodes():
    every = [name for table in STAGE_TABLES.values() for name in specifications(table)]
    assert len(every) == len(set(every))


@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_the_default_space_holds_the_default_of_every_preset(preset):
    base = base_of(preset)
    space = default_space(base, [plain_recording()])
    assert len(space) >= 7
    point = base_point(base, space)
    assert all(point[item.name] in item for item in space)
    changed = with_point(base, space, point)
    assert stage_parameters(changed) == stage_parameters(base)


BASES = [{}, *(base_of(path) for path in PRESETS if base_of(path))]


@given(st.sampled_from(BASES), st.integers(2, 8), st.integers(0, 8), st.data())
def test_no_point_of_the_default_space_is_refused(base, hits, more, data):
    manager = {**base.get("track_manager", {})}
    manager.update(confirmation_hits=hits, confirmation_scans=hits + more)
    base = {**base, "track_manager": manager}
    space = default_space(base, [plain_recording()])
    point = {}
    for item in space:
        kind = item.specification.element_kind
        draw = st.integers if kind is int else st.floats
        point[item.name] = data.draw(draw(item.low, item.high), label=item.name)
    stage_parameters(with_point(base, space, point))
    assert all(base_value(base, item.node, item.name) in item for item in space)


def test_what_cannot_act_is_left_out():
    names = {item.name for item in default_space({}, [plain_recording()])}
    assert {"range_std_m", "azimuth_std_rad", "confirmation_hits", "mht_new_target_ratio"} <= names
    assert not {"range_rate_std_mps", "false_track_probability", "clutter_memory_scans"} & names
    brought = plain_recording(
        range_std_m=np.ones(1), azimuth_std_rad=np.ones(1), range_rate_mps=np.ones(1)
    )
    base = {
        "track_manager": {
            "extraction": "sequential",
            "clutter_density": "estimated",
            "decision": "map",
        }
    }
    names = {item.name for item in default_space(base, [brought])}
    assert {"range_rate_std_mps", "false_track_probability", "clutter_memory_scans"} <= names
    left_out = {"range_std_m", "azimuth_std_rad", "confirmation_hits", "deletion_misses"}
    assert not left_out & names
    assert "mht_new_target_ratio" not in names
    immortal = {"track_manager": {"deletion_misses": 0, "clutter_density_per_m_rad": 0.0}}
    names = {item.name for item in default_space(immortal, [plain_recording()])}
    assert not {"deletion_misses", "clutter_density_per_m_rad"} & names
