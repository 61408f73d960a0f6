"""One thread of linear algebra per process, unless somebody wants more."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from gda_tracker.threads import THREAD_VARIABLES, one_thread_of_linear_algebra

PROGRAMS = {
    "a node": "import gda_tracker.nodes",
    "the command line": """
from gda_tracker import cli
try:
    cli.main(["fuse", "--help"])
except SystemExit:
    pass
""",
}
REPORT = f"""
import json, os, sys
print(json.dumps([early, {{name: os.environ.get(name) for name in {THREAD_VARIABLES!r}}}]))
"""


def environment_of(program, **given):
    """The variables after a program has begun, and whether numpy was there before they were."""
    watch = """
import sys
early = False
class Watch:
    def find_spec(self, name, path=None, target=None):
        global early
        import os
        if name == "numpy" and "OPENBLAS_NUM_THREADS" not in os.environ:
            early = True
sys.meta_path.insert(0, Watch())
"""
    base = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}
    answer = subprocess.run(
        [sys.executable, "-c", watch + program + REPORT],
        env={**base, **given},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return json.loads(answer.stdout.splitlines()[-1])


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
def test_there_is_one_thread_before_numpy_comes(program):
    early, found = environment_of(program)
    assert not early
    assert found == dict.fromkeys(THREAD_VARIABLES, "1")


def test_who_asks_for_more_gets_them():
    _, found = environment_of(PROGRAMS["a node"], OPENBLAS_NUM_THREADS="4")
    assert found == {**dict.fromkeys(THREAD_VARIABLES), "OPENBLAS_NUM_THREADS": "4"}


def test_asked_twice_nothing_changes(monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    one_thread_of_linear_algebra()
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    one_thread_of_linear_algebra()
    assert os.environ["OMP_NUM_THREADS"] == "3"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name)
