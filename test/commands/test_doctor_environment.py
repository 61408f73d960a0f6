"""What the doctor says of the environment; it needs no ROS for that."""

from __future__ import annotations

import importlib
import json
import re
import types
from pathlib import Path

import pytest

import gda_tracker
from gda_tracker.cli import main
from gda_tracker.io.parameter_files import known_tables
from gda_tracker.nodes.diagnosis import environment
from gda_tracker.nodes.diagnosis.environment import (
    busy_domains,
    environment_findings,
    unusable,
)
from gda_tracker.nodes.diagnosis.explanations import EXPLANATIONS
from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING, Finding, by_level
from gda_tracker.parameters import specifications
from gda_tracker.resources import resource


class Message:
    """A message class with the fields of a definition."""

    def __init__(self, fields):
        self._fields = fields

    def get_fields_and_field_types(self):
        return dict.fromkeys(self._fields, "float64")


def built(**changed):
    """The package of messages as it was built from the definitions, but for some."""
    found = types.SimpleNamespace()
    for path in resource("msg_schemas", "msg").glob("*.msg"):
        lines = [line.split("#")[0].split() for line in path.read_text().splitlines()]
        fields = [words[1] for words in lines if words and "=" not in "".join(words)]
        setattr(found, path.stem, Message(changed.get(path.stem, fields)))
    return found


@pytest.fixture
def packages(monkeypatch):
    """Packages that can be imported here, by name."""
    here = {"rclpy": types.SimpleNamespace(), "gda_tracker_msgs.msg": built()}

    real = importlib.import_module

    def find(name, *others):
        if name in ("rclpy", "gda_tracker_msgs.msg") and name not in here:
            raise ImportError(f"No module named {name!r}\nmore")
        return here[name] if name in here else real(name, *others)

    monkeypatch.setattr(environment.importlib, "import_module", find)
    monkeypatch.setattr(environment, "SHARED_MEMORY", Path("/no/such/folder"))
    return here


def names(variables, **options):
    return [found.name for found in environment_findings(variables, **options)]


def test_nothing_is_wrong_with_an_empty_environment(packages):
    assert names({}) == []
    assert names({"ROS_DOMAIN_ID": "7", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}) == []


def test_packages_that_are_missing_or_of_another_version(packages, capsys):
    packages["gda_tracker_msgs.msg"] = built(Track=["header"])
    (found,) = environment_findings({})
    assert (found.name, found.what) == (
        "messages_outdated",
        "built from other definitions: Track",
    )
    del packages["gda_tracker_msgs.msg"]
    (found,) = environment_findings({})
    assert found.name == "messages_missing"
    assert "colcon build" in found.fix
    assert "\n" not in found.what
    del packages["rclpy"]
    (found,) = environment_findings({})
    assert found.name == "rclpy_missing"
    assert found.what == "cannot be imported: No module named 'rclpy'"
    assert unusable([found])
    # The command says so instead of failing.
    assert main(["doctor", "--json"]) == 1
    record = json.loads(capsys.readouterr().out)
    assert record["errors"] >= 1
    assert "rclpy_missing" in [finding["name"] for finding in record["findings"]]


VARIABLES = {
    "domain_invalid": {"ROS_DOMAIN_ID": "233"},
    "domain_high": {"ROS_DOMAIN_ID": "150"},
    "discovery_range_invalid": {"ROS_AUTOMATIC_DISCOVERY_RANGE": "NEAR"},
    "discovery_off": {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
    "discovery_localhost": {"ROS_LOCALHOST_ONLY": "1"},
    "discovery_server": {"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"},
    "field_checks": {"ROS_PYTHON_CHECK_FIELDS": "1"},
    "profile_unreadable": {"FASTRTPS_DEFAULT_PROFILES_FILE": "/no/such.xml"},
    "python_mixed": {"PYTHONPATH": "/opt/ros/jazzy/lib/python3.99/site-packages"},
}


@pytest.mark.parametrize("name", VARIABLES)
def test_variables(name, packages):
    (found,) = environment_findings(VARIABLES[name])
    assert found.name == name
    assert found.subject in VARIABLES[name]
    assert next(iter(VARIABLES[name])) in found.fix or name == "discovery_server"


def test_the_domain_of_the_command_line_goes_before_that_of_the_environment(packages):
    assert names({"ROS_DOMAIN_ID": "five"}, domain=5) == []
    assert names({}, domain=500) == ["domain_invalid"]


@pytest.mark.parametrize(
    ("text", "fault"),
    [("<profiles", "no XML"), ("<html/>", "no profiles, but html"), ("<profiles/>", "")],
)
def test_profiles_of_fast_dds(text, fault, packages, tmp_path):
    path = tmp_path / "profile.xml"
    path.write_text(text)
    found = environment_findings({"FASTDDS_DEFAULT_PROFILES_FILE": str(path)})
    assert [fault in each.what for each in found] == [True] * bool(fault)
    for shipped in ("fastdds.xml", "fastdds_udp.xml"):
        file = str(resource("params", shipped))
        assert names({"FASTDDS_DEFAULT_PROFILES_FILE": file}) == []


def test_shared_memory_that_is_full(packages, monkeypatch):
    status = types.SimpleNamespace(f_bavail=10, f_frsize=2**20)
    monkeypatch.setattr(environment.os, "statvfs", lambda _: status)
    (found,) = environment_findings({})
    assert (found.name, found.what) == ("shared_memory_full", "has 10 MB left")
    status.f_bavail = 1000
    assert names({}) == []


def test_domains_by_the_ports_that_are_open(tmp_path):
    table = tmp_path / "udp"
    ports = (7400, 7400 + 250 * 5 + 12, 7400 + 250 * 101 + 11, 7400 + 250 * 9 + 3, 53, 60000)
    rows = [f"  1: 00000000:{port:04X} 00000000:0000 07" for port in ports]
    table.write_text("\n".join(["  sl  local_address rem_address", *rows]))
    assert busy_domains((table, tmp_path / "none")) == [0, 5, 101]


def test_the_gravest_come_first_and_each_once():
    found = [Finding(level, "n", "s", "w", "y", "f") for level in (NOTE, WARNING, ERROR, NOTE)]
    assert [each.level for each in by_level(found)] == [ERROR, WARNING, NOTE]


def test_the_page_names_every_finding():
    root = Path(gda_tracker.__file__).parent
    page = (root.parent / "docs" / "live.md").read_text()
    found = set()
    for path in (*(root / "nodes" / "diagnosis").glob("*.py"), root / "commands" / "doctor.py"):
        found.update(re.findall(r'(?:ERROR|WARNING|NOTE|level),\s+"(\w+)",', path.read_text()))
    assert len(found) > 40
    assert {name for name in found if f"`{name}`" not in page} == set()


def test_the_commands_that_change_parameters_are_allowed():
    declared = {
        name: item for t in known_tables().values() for name, item in specifications(t).items()
    }
    told = 0
    for explained in EXPLANATIONS.values():
        _, found, words = explained.fix.partition("gda-tracker params set ")
        for name, value in re.findall(r"(\w+)=([^\s,;)]+)", words if found else ""):
            assert declared[name].live, name
            if value != "...":
                kind = declared[name].element_kind
                item = value == "true" if kind is bool else value if kind is str else float(value)
                assert declared[name].check(item) == item
            told += 1
    assert told > 15
    folder = Path(gda_tracker.__file__).parent / "nodes" / "diagnosis"
    for path in folder.glob("*.py"):
        for name in re.findall(r"params set (\w+)=", path.read_text()):
            assert declared[name].live
