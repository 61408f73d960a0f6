"""``gda-tracker evaluate``: table, JSON, errors in one line."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from gda_tracker.evaluation.command import add_arguments, run
from gda_tracker.simulation.scenarios import shipped_scenarios

MAIN = (
    "import argparse, sys\n"
    "from gda_tracker.evaluation.command import add_arguments, run\n"
    "if __name__ == '__main__':\n"
    "    parser = argparse.ArgumentParser()\n"
    "    add_arguments(parser)\n"
    "    sys.exit(run(parser.parse_args()))\n"
)


def call(*arguments: str) -> int:
    parser = argparse.ArgumentParser("gda-tracker evaluate")
    add_arguments(parser)
    return run(parser.parse_args(arguments))


@pytest.fixture
def short(tmp_path):
    """Path of a crossing scenario cut to eight scans."""
    text = shipped_scenarios()["crossing_targets"].read_text()
    path = tmp_path / "short.yaml"
    path.write_text(text.replace("n_scans: 25", "n_scans: 8"))
    return str(path)


def test_table_and_json(short, tmp_path, capsys):
    out = tmp_path / "out.json"
    methods = ["--method", "gda/none/cv", "--method", "clairvoyant"]
    assert call(short, "--runs", "3", "--workers", "1", *methods, "--json", str(out)) == 0
    shown = capsys.readouterr()
    assert "3/3 runs" in shown.err
    found = json.loads(out.read_text())
    assert found["scenario"] == "crossing_targets"
    for method in found["methods"]:
        row = next(line for line in shown.out.splitlines() if line.startswith(method["method"]))
        assert f"{method['purity_mean']:.3f}" in row
        assert f"{method['cpu_ms_per_scan']:.2f}" in row
    assert "published: kinematics only" in shown.out
    assert "0.717" in shown.out
    assert "[ms/scan]" in shown.out


def test_several_scenarios_give_a_list(short, tmp_path):
    out = tmp_path / "out.json"
    options = ["--runs", "1", "--workers", "1", "--method", "gda/none/cv", "--json", str(out)]
    assert call(short, short, *options) == 0
    assert [entry["runs"] for entry in json.loads(out.read_text())] == [1, 1]


def test_confusion_is_printed_on_request(short, capsys):
    options = ["--runs", "1", "--workers", "1", "--method", "gda/none/cv"]
    assert call(short, *options) == 0
    assert "track 2" not in capsys.readouterr().out
    assert call(short, *options, "--confusion") == 0
    assert "track 2" in capsys.readouterr().out


def test_automatic_initiation_in_table_json_and_report(short, tmp_path, capsys):
    out, page = tmp_path / "out.json", tmp_path / "report.html"
    options = ["--runs", "2", "--workers", "1", "--initiation", "automatic"]
    assert call(short, *options, "--json", str(out), "--report", str(page)) == 0
    shown, report = capsys.readouterr().out, page.read_text()
    assert "automatic initiation" in shown
    words = ("completeness", "switches", "false tracks", "GOSPA", "localisation", "OSPA")
    for word in (*words, "extraction delay", "their life", "smoothed", "NEES", "NIS"):
        assert word in shown
        assert word in report
    for method in json.loads(out.read_text())["methods"]:
        rows = [line for line in shown.splitlines() if line.startswith(method["method"])]
        assert len(rows) == 5
        names = (
            "completeness",
            "gospa_m",
            "extraction_delay_s",
            "position_smoothed_rmse_m",
            "nees",
        )
        for row, name, digits in zip(rows, names, (3, 1, 1, 1, 2), strict=True):
            cell = f"{method[name]:.{digits}f}"
            assert cell in row
            assert f"<td>{cell}" in report
        bounds = f"{method['nees_lower']:.2f} to {method['nees_upper']:.2f}"
        assert bounds in rows[4]
        assert bounds in report
    assert report.count('<img alt="') == 2
    assert f"gda-tracker evaluate {short} --runs 2 --seed 0 --initiation automatic" in report


def test_report_of_labelled_initiation(short, tmp_path, capsys):
    page = tmp_path / "report.html"
    methods = ["--method", "gda/none/cv", "--method", "map/bayes/cv"]
    options = ["--runs", "2", "--workers", "1", *methods, "--report", str(page)]
    assert call(short, short, *options) == 0
    report, shown = page.read_text(), capsys.readouterr().out
    assert report.count("<h2>crossing_targets: track purity</h2>") == 2
    assert report.count("map/bayes/cv, run by run") == 4  # caption and text of each picture
    row = next(line for line in shown.splitlines() if line.startswith("map/bayes/cv"))
    assert f"<td>{row.split()[1]}" in report
    assert "published: kinematics only" in report


def test_report_without_pictures_says_why(short, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    page = tmp_path / "report.html"
    options = ["--runs", "1", "--workers", "1", "--method", "gda/none/cv", "--report", str(page)]
    assert call(short, *options, "--initiation", "automatic") == 0
    assert "Pictures need matplotlib" in page.read_text()
    assert "<img" not in page.read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.yaml"], "neither a file nor a shipped scenario"),
        (["crossing_targets", "--method", "gda/none"], "allowed is decision/attribute_term/filter"),
        (["crossing_targets", "--runs", "0"], "runs = 0: allowed is an integer >= 1"),
        (["crossing_targets", "--json", "/no/such/folder/x.json"], "does not exist"),
        (["crossing_targets", "--json", "/tmp"], "is a folder"),
        (["crossing_targets", "--report", "/no/such/folder/x.html"], "--report"),
    ],
)
def test_errors_are_one_line_and_exit_code_2(arguments, message, capsys):
    assert call(*arguments) == 2
    shown = capsys.readouterr()
    assert message in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as stop:
        call("--help")
    assert stop.value.code == 0
    shown = capsys.readouterr().out
    for word in ("gda/none/cv", "clairvoyant", "examples:", "closely_spaced_targets", "paired"):
        assert word in shown


def test_ctrl_c_ends_cleanly(tmp_path, short):
    script = tmp_path / "main.py"
    script.write_text(MAIN)
    process = subprocess.Popen(
        [sys.executable, str(script), short, "--runs", "1000000", "--workers", "2"],
        stderr=subprocess.PIPE,
        text=True,
        env={"PYTHONPATH": ":".join(p or "." for p in sys.path), "PATH": ""},
        start_new_session=True,
    )
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        assert line.endswith("/1000000 runs\n")
        started = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to parent and workers
        rest = process.stderr.read()
        assert process.wait(timeout=60) == 130
    finally:
        process.kill()
    assert rest.splitlines()[-1] == "gda-tracker evaluate: interrupted"
    assert "Traceback" not in rest
    assert time.monotonic() - started < 60
