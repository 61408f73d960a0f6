from __future__ import annotations

import math
import re
from dataclasses import dataclass

import pytest
import yaml

from gda_tracker.io.parameter_files import (
    ParameterFileError,
    known_tables,
    parameter_yaml,
    read_parameter_file,
    read_preset,
    stage_tables,
    yaml_value,
)
from gda_tracker.parameters import ParameterError, from_mapping, parameter, to_mapping
from gda_tracker.resources import resource


@dataclass(frozen=True)
class Radar:
    range_std_m: float = parameter(30.0, "range noise", unit="m", minimum=0.0)
    clutter_density: float = parameter(1e-6, "clutter", minimum=0.0)
    hits: int = parameter(3, "hits", minimum=1)
    names: list[str] = parameter(["a", 'b "c"'], "names")
    fast: bool = parameter(True, "go fast", live=False, advanced=True)
    limits: list[float] = parameter([1.0, 2.5e-7], "limits", advanced=True)


@dataclass(frozen=True)
class Display:
    hits: int = parameter(1, "hits on the screen", minimum=1)

    def __post_init__(self) -> None:
        if self.hits == 7:
            raise ParameterError("parameter hits = 7: allowed is anything else")


TABLES = {"radar": Radar, "display": Display}


def read(tmp_path, text):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    return read_parameter_file(path, TABLES)


@pytest.mark.parametrize(
    "key", ["radar", "/radar", "/**/radar", "/ns/radar", "/ns/**/radar", "/*/radar", "a/b/radar"]
)
def test_keys_of_a_node(tmp_path, key):
    values = read(tmp_path, f"{key}:\n  ros__parameters:\n    hits: 4\n")
    assert values == {"radar": {"hits": 4}}


def test_nested_namespaces(tmp_path):
    text = "harbour:\n  north:\n    radar:\n      ros__parameters: {hits: 4}\n"
    assert read(tmp_path, text) == {"radar": {"hits": 4}}


def test_a_wildcard_reaches_the_nodes_that_know_the_name(tmp_path):
    text = "/**:\n  ros__parameters:\n    hits: 4\n    range_std_m: 5\n"
    assert read(tmp_path, text) == {
        "radar": {"hits": 4, "range_std_m": 5.0},
        "display": {"hits": 4},
    }


def test_the_later_entry_holds(tmp_path):
    text = "/**:\n  ros__parameters: {hits: 4}\nradar:\n  ros__parameters: {hits: 5}\n"
    assert read(tmp_path, text) == {"radar": {"hits": 5}, "display": {"hits": 4}}


def test_numbers_take_the_declared_type(tmp_path):
    text = "radar:\n  ros__parameters: {range_std_m: 5, clutter_density: 1e-7, hits: 4.0}\n"
    values = read(tmp_path, text)["radar"]
    assert values == {"range_std_m": 5.0, "clutter_density": 1e-7, "hits": 4}
    assert [type(value) for value in values.values()] == [float, float, int]


def test_parameters_of_every_node_are_left_to_it(tmp_path):
    text = (
        "radar:\n  ros__parameters:\n    use_sim_time: true\n    autostart: false\n    hits: 2\n"
        "    qos_overrides: {/tracks: {publisher: {depth: 3}}}\n"
    )
    assert read(tmp_path, text) == {"radar": {"hits": 2}}


BAD = {
    "radr:\n  ros__parameters: {hits: 4}": "node radr: unknown, did you mean radar?; known",
    "radar:\n  ros__parameters: {hitz: 4}": "parameter hitz: unknown, did you mean hits?",
    "radar:\n  ros__parameters: {a: {b: 4}}": "parameter a.b: unknown",
    "radar:\n  ros__parameters: {hits: 0}": "node radar: parameter hits = 0: allowed is",
    "radar:\n  ros__parameters: {hits: x}": "parameter hits = 'x'",
    "radar:\n  ros__parameters: {range_std_m: .nan}": "parameter range_std_m = nan",
    "radar:\n  ros__parameters: {hits: }": "parameter hits = None",
    "display:\n  ros__parameters: {hits: 7}": "node display: parameter hits = 7: allowed",
    "/**:\n  ros__parameters: {hitz: 4}": "hitz: unknown to every node, did you mean hits?",
    "radar:\n  hits: 4": "radar/hits: ros__parameters is missing",
    "radar: 4": "radar: ros__parameters is missing",
    "radar:\n  ros__parameters: 4": "ros__parameters is not 'name: value' lines",
    "radar:\n  ros__parameters: {hits: 4}\n  hits: 4": "hits stands beside ros__parameters",
    "radar: {}": "no node below",
    "": "no node: expected",
    "- 1": "no node: expected",
    "7: {ros__parameters: {}}": "7 is not the name of a node",
    "radar:\n  ros__parameters: {hits: 4, hits: 5}": "not YAML in line 2: hits occurs twice",
    "radar: [": "not YAML in line 1",
    "radar: !!python/object:os.system {}": "not YAML in line 1",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files_give_one_line(tmp_path, text):
    with pytest.raises(ParameterFileError, match=re.escape(BAD[text])) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'file.yaml'}: ")
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ParameterFileError, match=r"none.yaml: No such file or directory$"):
        read_parameter_file(tmp_path / "none.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterFileError, match=r"bytes.yaml: not a text file$"):
        read_parameter_file(tmp_path / "bytes.yaml")


# --- writing --------------------------------------------------------------------------------------


def test_what_is_written_is_read_back(tmp_path):
    values = {"radar": {"names": ["x: y", "\\"], "limits": [1e-12, 1e22], "range_std_m": 7.0}}
    both = {}
    for advanced in (False, True):
        path = tmp_path / f"{advanced}.yaml"
        path.write_text(parameter_yaml(TABLES, advanced, values))
        for node, entries in read_parameter_file(path, TABLES).items():
            both.setdefault(node, {}).update(entries)
    assert both["radar"] == to_mapping(from_mapping(Radar, values["radar"]))
    assert both["display"] == to_mapping(Display())


def test_every_parameter_is_in_one_half_with_its_meaning():
    basic, advanced = (parameter_yaml(TABLES, half) for half in (False, True))
    assert "    # Range noise. Allowed: a number >= 0 [m].\n    range_std_m: 30.0\n" in basic
    assert "    # Go fast. Allowed: true or false. Fixed at start-up.\n    fast: true\n" in advanced
    assert "fast" not in basic
    assert "display" not in advanced


def test_shipped_tables_are_written_and_read_back(tmp_path):
    tables = stage_tables()
    for advanced in (False, True):
        path = tmp_path / "file.yaml"
        text = parameter_yaml(tables, advanced)
        path.write_text(text)
        assert max(map(len, text.splitlines())) <= 100
        for node, values in read_parameter_file(path).items():
            defaults = to_mapping(tables[node]())
            assert values == {name: defaults[name] for name in values}


@pytest.mark.parametrize("value", [0.0, 1.0, -3.0, 1e-6, 1e22, 1.5e-300, 1 / 3, 123456789.0])
def test_floats_are_floats_for_every_reader(value):
    text = yaml_value(value, float)
    assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", text)
    assert yaml.safe_load(text) == value
    assert isinstance(yaml.safe_load(text), float)


def test_a_value_that_yaml_of_ros_cannot_hold():
    with pytest.raises(ParameterError, match="inf"):
        yaml_value(math.inf, float)


# --- presets --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", sorted(path.stem for path in resource("params/presets").glob("*.yaml"))
)
def test_presets_are_accepted_by_the_tables(name):
    preset = read_preset(name)
    assert "track_manager" in preset
    for node, values in preset.items():
        from_mapping(known_tables()[node], values)


def test_a_preset_that_does_not_exist():
    with pytest.raises(ParameterFileError, match="preset 'x': allowed is one of altos, asterix"):
        read_preset("x")
