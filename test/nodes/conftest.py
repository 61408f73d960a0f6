"""Fixtures of the graph tests: a domain per test, bounded waits, shared memory cleaned up."""

from __future__ import annotations

import fcntl
import gc
import os
from pathlib import Path

import pytest

os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")

from graph_bench import METHOD
from graph_helpers import offline, scenario_plays

from gda_tracker.nodes.runner import private_environment, release_domain, use_environment

SHARED_MEMORY = Path("/dev/shm")


def _remove_orphans() -> None:
    """Remove Fast DDS segments that nobody holds any more: those of killed processes.

    Each segment has a lock file beside it that its owner keeps locked as long as it lives, so the
    segments of other rings on this host stay.
    """
    for lock_file in sorted(SHARED_MEMORY.glob("fastrtps_*_[es]l")):
        try:
            with lock_file.open("r+") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                name = lock_file.name[:-3]
                for orphan in (name, f"sem.{name}_mutex", lock_file.name):
                    (SHARED_MEMORY / orphan).unlink(missing_ok=True)
        except OSError:
            continue  # held, or another user's


@pytest.fixture
def environment(tmp_path):
    """Environment of a private ring; killed processes' shared memory is removed afterwards."""
    made = private_environment()
    made["ROS_LOG_DIR"] = str(tmp_path / "log")
    use_environment(made)
    yield made
    # Nodes that wait for the garbage collector are still seen in their domain.
    gc.collect()
    _remove_orphans()
    release_domain(int(made["ROS_DOMAIN_ID"]))


@pytest.fixture
def domain(environment) -> int:
    """ROS domain of this test."""
    return int(environment["ROS_DOMAIN_ID"])


@pytest.fixture
def crossing():
    """First play of a scenario, parameters, and what the ring makes of it offline."""
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    return plays[0], parameters, offline(plays, parameters)
