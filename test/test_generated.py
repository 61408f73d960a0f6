"""Generated files are up to date with the parameter tables."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_parameter_files_and_tables():
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "generate_parameter_docs.py", "--check"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_page_about_radars_has_a_section_for_each_preset():
    page = (ROOT / "docs" / "radars.md").read_text()
    sections = {line[4:] for line in page.splitlines() if line.startswith("### ")}
    presets = {
        path.stem
        for path in (ROOT / "params" / "presets").glob("*.yaml")
        if "radar_input:" in path.read_text()
    }
    assert len(presets) == 12
    assert presets <= sections
