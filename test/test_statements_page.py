"""The numbers of ``docs/statements.md`` against a fresh small run of the script that made them."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from gda_tracker.io.statement_files import read_statements
from gda_tracker.vocabulary.statements import KINDS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
RUNS = 20


@pytest.fixture(scope="module")
def script():
    name = "measure_statements"
    path = ROOT / "scripts" / f"{name}.py"
    specification = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # where its dataclass looks for its annotations
    specification.loader.exec_module(module)
    yield module
    del sys.modules[name]


@pytest.fixture(scope="module")
def page():
    return (ROOT / "docs" / "statements.md").read_text()


def shares(page, script):
    """The table of the page: mean and standard error by method and variant."""
    lines = page.split("<!-- measured -->\n")[1].split("\n\n")[0].splitlines()[2:]
    found = {}
    for line in lines:
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        for method, cell in zip(script.METHODS, cells, strict=True):
            mean, error = cell.split(" +- ")
            found[method, name] = float(mean), float(error)
    return found


def test_the_page_says_what_is_measured(page, script):
    published = shares(page, script)
    assert {name for _, name in published} == set(script.VARIANTS)
    method = "map/bayes/cv"
    fresh = script.measure(RUNS, seed=77, methods=(method,))
    for name in script.VARIANTS:
        mean, error = published[method, name]
        own = np.sqrt(max(mean * (1.0 - mean), 0.02) / RUNS)
        assert abs(fresh[method, name].mean() - mean) < 3.5 * np.hypot(own, error), name
    assert f"{method}, track 1 is a fighter: " in script.differences(fresh)
    # Paired on the same runs, what is said decides.
    silent = fresh[method, "nothing"].mean()
    assert fresh[method, "track 1 is in this sector"].mean() > silent
    assert fresh[method, "wrong: it is the cargo by the buoy, .95"].mean() < silent


def test_the_differences_in_the_text_are_those_of_the_table(page, script):
    shown = shares(page, script)
    bayes = {name: shown["map/bayes/cv", name][0] for name in script.VARIANTS}
    silent = bayes["nothing"]
    for name, text in (
        ("the fighter is by the buoy", r"\(-(\.\d+) of"),
        ("track 1 is a fighter", r"\+(\.\d+) \+- \.\d+ \(paired\)"),
        ("wrong: it is the cargo by the buoy, .5", r"(\.\d+) of the runs for the place"),
        ("wrong: track 1 is a cargo, .5", r"(\.\d+) for the class"),
        ("wrong: track 1 is in the cargo's sector, .5", r"(\.\d+) for the\s+sector"),
        ("wrong: it is the cargo by the buoy, .95", r"wrong place costs (\.\d+)"),
    ):
        (number,) = re.findall(text, page)
        difference = abs(bayes[name] - silent)
        assert float(number) == pytest.approx(difference, abs=0.0011), name


def test_the_statement_of_the_page_is_good(page):
    (text,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (draft,) = read_statements(text, "page")
    assert draft.complete(1, 0, "map").kind == yaml.safe_load(text)["kind"]
    for kind in KINDS:
        assert f"| `{kind}` |" in page


def test_the_picture_is_drawn(script):
    figure = script.picture(script.simulate(1, 0), "map/bayes/cv", script.SHOWN)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert len(titles) == len(script.SHOWN)
    assert all(title.endswith(("kept", "swapped")) for title in titles)
