"""The documentation: links, navigation, generated parts, and the commands and code of its pages."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gda_tracker.cli import build_parser, main
from gda_tracker.commands import replay_sections
from gda_tracker.io.bags import Bag

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
sys.path.append(str(ROOT / "scripts"))
import docs_hooks  # noqa: E402

# The walk of radar-mmwave.md is replayed in test/io/test_radar_recordings.py.
RADAR_PAGES = sorted({path.name for path in DOCS.glob("radar-*.md")} - {"radar-mmwave.md"})
PATCHED_PAGES = ["add-rule.md", "add-motion-model.md"]
BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^\n]*) -->\n)?^```(?P<kind>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


def blocks(page):
    """Fenced blocks of a page as (kind, text, mark), the mark being the comment right before."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return [(m["kind"], m["text"], m["mark"] or "") for m in BLOCK.finditer(text)]


# --- links and navigation -------------------------------------------------------------------------


def test_every_link_of_every_page_leads_to_a_file():
    pages = [str(path.relative_to(ROOT)) for path in DOCS.rglob("*.md")]
    pages += [path for path in docs_hooks.outside() if path.endswith(".md")]
    assert len(pages) > 40
    broken = [
        f"{page}: {link}"
        for page in pages
        for link in docs_hooks.links((ROOT / page).read_text(encoding="utf-8"))
        if not docs_hooks.EXTERNAL.match(link) and docs_hooks.linked_file(page, link) is None
    ]
    assert broken == []


def test_every_page_is_in_the_navigation():
    class Loader(yaml.SafeLoader):
        pass

    Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)
    nav = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), Loader)["nav"]

    def named(entry):
        if isinstance(entry, str):
            return [entry]
        parts = entry if isinstance(entry, list) else entry.values()
        return [name for part in parts for name in named(part)]

    written = {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")}
    listed = named(nav)
    assert len(listed) == len(set(listed))
    assert set(listed) == written | {"index.md", "CHANGELOG.md"}


@pytest.mark.parametrize(
    ("page", "text", "expected"),
    [
        ("docs/mht.md", "[a](filters.md#b)", "[a](filters.md#b)"),
        ("docs/mht.md", "[a](../params/basic.yaml)", "[a](files/params/basic.yaml)"),
        ("docs/mht.md", "[a](../benchmarks/README.md#b)", "[a](benchmarks/README.md#b)"),
        ("docs/api/io.md", "[a](../../LICENSE)", "[a](../files/LICENSE)"),
        ("docs/mht.md", "[a](../data/autoferry)", "[a](data/autoferry/README.md)"),
        ("docs/mht.md", "[a](../README.md)", "[a](index.md)"),
        ("README.md", "![a](docs/images/view.png)", "![a](images/view.png)"),
        ("README.md", "[a](docs/mht.md), [b](LICENSE)", "[a](mht.md), [b](files/LICENSE)"),
        ("benchmarks/README.md", "[a](../docs/mht.md)", "[a](../mht.md)"),
        ("docs/mht.md", "[a](https://x.org/y.md) [b](#c)", "[a](https://x.org/y.md) [b](#c)"),
        # What does not exist stays, and the strict build finds it.
        ("docs/mht.md", "[a](../missing.md)", "[a](../missing.md)"),
        ("docs/mht.md", "[a](../../outside.md)", "[a](../../outside.md)"),
        ("docs/mht.md", "```\n[a](../LICENSE)\n```\n", "```\n[a](../LICENSE)\n```\n"),
        (
            "docs/mht.md",
            "~~~ sh\n```\n[a](../LICENSE)\n~~~\n",
            "~~~ sh\n```\n[a](../LICENSE)\n~~~\n",
        ),
    ],
)
def test_links_follow_into_the_site(page, text, expected):
    assert docs_hooks.rewrite(text, page) == expected


def test_places_of_pages_are_inverse():
    for path in ("README.md", "docs/mht.md", "docs/api/io.md", "CHANGELOG.md"):
        assert docs_hooks.place_in_repository(docs_hooks.place_in_site(path)) == path


@pytest.mark.parametrize(
    ("html", "loads"),
    [
        ('<script src="https://cdn.org/a.js"></script>', True),
        ("<img alt=x src=//cdn.org/a.png>", True),
        ('<link href="https://fonts.org/a.css" rel="stylesheet">', True),
        ('<link rel="stylesheet" href="assets/a.css"><script src="a.js"></script>', False),
        ('<a href="https://x.org">x</a>', False),
    ],
)
def test_what_a_page_loads_from_other_hosts_is_found(html, loads):
    assert bool(docs_hooks.LOADED.search(html)) == loads


def test_messages_on_the_page_are_those_of_the_files():
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "generate_topic_docs.py", "--check"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout + done.stderr


# --- a newcomer's commands ------------------------------------------------------------------------


def run_script(arguments, line):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as end:
            runpy.run_path(arguments[0], run_name="__main__")
    assert end.value.code == 0, line


def run_shell(text, folder):
    """Run the lines of a block; Python starts only once, so commands are called here."""
    lines = iter(text.splitlines())
    for line in lines:
        if heredoc := re.match(r"cat > (\S+) <<'END'$", line):
            content = []
            while (inner := next(lines)) != "END":
                content.append(inner)
            (folder / heredoc[1]).write_text("\n".join(content) + "\n")
        else:
            command, *arguments = shlex.split(line, comments=True)
            if command == "python":
                run_script(arguments, line)
            else:
                assert command == "gda-tracker", line
                assert main(arguments) == 0, line


@pytest.mark.parametrize("page", RADAR_PAGES)
def test_commands_of_a_page_run_and_print_what_it_says(page, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    # Pictures are looked at elsewhere.
    monkeypatch.setattr(replay_sections, "png", lambda figure: b"")
    for name in ("data", "scripts", "params"):
        (tmp_path / name).symlink_to(ROOT / name)
    told, ran, shown = "", 0, 0
    for kind, text, mark in blocks(page):
        if mark in ("live", "tested in test/io/test_radar_recordings.py"):
            continue
        if kind == "sh":
            run_shell(text, tmp_path)
            ran += 1
            told += "".join(capfd.readouterr())
        elif not kind:
            tables = "".join(path.read_text() for path in tmp_path.glob("files/*.csv"))
            missing = [line for line in text.splitlines() if line.strip() not in told + tables]
            assert missing == []
            shown += 1
    assert ran
    assert shown
    for report in tmp_path.glob("*.html"):
        assert "How this was made" in report.read_text(encoding="utf-8")
    # Bags that are played in place of a radar have the topics that the live commands read.
    live = "".join(text for _, text, mark in blocks(page) if mark == "live")
    for name in re.findall(r"^gda-tracker play (\S+)", live, re.MULTILINE):
        assert set(Bag(tmp_path / name).topics) & set(re.findall(r"--input (\S+)", live))


@pytest.mark.parametrize("page", sorted(path.name for path in DOCS.glob("radar-*.md")))
def test_live_commands_of_a_page_have_arguments_that_exist(page):
    lines = [
        shlex.split(line, comments=True)
        for kind, text, mark in blocks(page)
        if kind == "sh" and mark == "live"
        for line in text.splitlines()
    ]
    assert lines
    for program, *arguments in lines:
        if program == "gda-tracker":
            build_parser(arguments[0]).parse_args(arguments)


# --- how to add something -------------------------------------------------------------------------


def write_files(page, folder):
    for _, text, mark in blocks(page):
        if mark.startswith("file: "):
            (folder / mark.removeprefix("file: ")).write_text(text)


def code_of(page):
    return "\n".join(text for kind, text, _ in blocks(page) if kind == "python")


@pytest.mark.parametrize("page", ["add-attribute.md", "add-adapter.md"])
def test_code_of_a_page_that_needs_no_change(page, tmp_path, monkeypatch):
    from gda_tracker.io import adapters

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(adapters, "ADAPTERS", dict(adapters.ADAPTERS))
    write_files(page, tmp_path)
    exec(compile(code_of(page), page, "exec"), {"__name__": page})


def apply_patch(folder, name, text):
    """Apply one hunk without line numbers: what it shows must be there once."""
    lines = text.splitlines(keepends=True)
    assert all(line[0] in " +-" for line in lines), text
    before = "".join(line[1:] for line in lines if line[0] in " -")
    after = "".join(line[1:] for line in lines if line[0] in " +")
    path = folder / name
    source = path.read_text(encoding="utf-8")
    assert source.count(before) == 1, f"{name} has changed: {before}"
    path.write_text(source.replace(before, after), encoding="utf-8")


@pytest.mark.parametrize("page", PATCHED_PAGES)
def test_changes_of_a_page_do_what_it_says(page, tmp_path):
    shutil.copytree(
        ROOT / "gda_tracker",
        tmp_path / "gda_tracker",
        ignore=shutil.ignore_patterns("__pycache__", "static"),
    )
    for name in ("data", "params"):
        (tmp_path / name).symlink_to(ROOT / name)
    script = tmp_path / "example.py"
    script.write_text(code_of(page))
    for _, text, mark in blocks(page):
        if mark.startswith("patch: "):
            apply_patch(tmp_path, mark.removeprefix("patch: "), text)
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
