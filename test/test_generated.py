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
