"""The command ``view`` as its user meets it: the address, the warning, the end by Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

from gda_tracker.cli import main

TIMEOUT_S = 60.0


@contextmanager
def view(*options):
    """Run the command; yields the address, ends it with Ctrl-C, and leaves its output."""
    command = [sys.executable, "-m", "gda_tracker.cli", "view", *options, "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if found := re.search(r"http://[^/]+:\d+/", line):
                yield found[0], process
                break
        else:
            raise AssertionError("".join(lines) + process.stderr.read())
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        process.stdout.close()


def get(address):
    with urllib.request.urlopen(address, timeout=TIMEOUT_S) as answer:
        return answer.read().decode()


def test_a_scenario_is_served_until_ctrl_c():
    with view("crossing_targets", "--paused", "--method", "map/bayes/cv") as (address, process):
        assert address.startswith("http://127.0.0.1:")
        assert 'id="plan"' in get(address)
        parameters = json.loads(get(address + "api/parameters"))
        assert parameters["allow_changes"] is True
        values = {p["name"]: p["value"] for p in parameters["parameters"]}
        assert (values["decision"], values["attribute_term"]) == ("map", "bayes")
        sets = json.loads(get(address + "api/fuzzy_sets"))
        assert sets["class_names"] == ["false_alarm", "fighter", "cargo"]
    assert process.returncode == 0
    assert process.stderr.read() == ""


def test_opened_to_others_it_warns_and_is_read_only():
    options = ("crossing_targets", "--paused", "--host", "0.0.0.0")
    with view(*options) as (address, process):
        address = address.replace("0.0.0.0", "127.0.0.1")
        assert json.loads(get(address + "api/parameters"))["allow_changes"] is False
        change = urllib.request.Request(
            address + "api/control",
            json.dumps({"command": "play"}).encode(),
            {"Content-Type": "application/json"},
        )
        with pytest.raises(urllib.error.HTTPError) as refused:
            get(change)
        assert refused.value.code == 403
    assert "everybody on the network may look; there is no password" in process.stderr.read()
    with view(*options, "--allow-changes") as (address, process):
        address = address.replace("0.0.0.0", "127.0.0.1")
        assert json.loads(get(address + "api/parameters"))["allow_changes"] is True
    assert "may look and change parameters" in process.stderr.read()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("crossing_targets", "--port", "99999"), "--port 99999: allowed is an integer"),
        (("crossing_targets", "--rate", "-1"), "--rate -1.0: allowed is a number >= 0"),
        (("crossing_targets", "--history", "0"), "--history 0: allowed is an integer >= 1"),
        (("crossing_targets", "--namespace", "a"), "--namespace: allowed without a RECORDING"),
        (("--method", "map/bayes/cv"), "allowed with a RECORDING"),
        (("no_such_thing",), "no_such_thing"),
    ],
)
def test_wrong_arguments_end_with_one_line(arguments, reason, capsys):
    assert main(["view", *arguments]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
