"""Fixtures of the graph tests: a domain per test, bounded waits, shared memory cleaned up."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")

from gda_tracker.nodes.runner import private_environment, use_environment


def _shared_memory() -> set[Path]:
    folder = Path("/dev/shm")
    if not folder.is_dir():
        return set()
    return {p for p in folder.iterdir() if p.name.startswith(("fastrtps_", "sem.fastrtps_"))}


@pytest.fixture
def environment(tmp_path):
    """Environment of a private ring; killed processes' shared memory is removed afterwards."""
    before = _shared_memory()
    made = private_environment()
    made["ROS_LOG_DIR"] = str(tmp_path / "log")
    use_environment(made)
    yield made
    for path in _shared_memory() - before:
        path.unlink(missing_ok=True)


@pytest.fixture
def domain(environment) -> int:
    """ROS domain of this test."""
    return int(environment["ROS_DOMAIN_ID"])
