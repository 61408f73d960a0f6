"""Domains are reserved one for one ring at a time, and given back."""

from __future__ import annotations

import subprocess
import sys

from gda_tracker.nodes.runner import DOMAINS, release_domain, reserve_domain

RESERVE = "from gda_tracker.nodes.runner import reserve_domain; print(reserve_domain())"


def test_a_domain_is_reserved_for_one_process():
    domain = reserve_domain()
    try:
        # The other process begins its search at this domain and must pass it by.
        code = f"import gda_tracker.nodes.runner as r; r._last_domain = {domain - 1}\n" + RESERVE
        other = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
        )
        assert int(other.stdout) != domain
    finally:
        release_domain(domain)


def test_released_domains_come_again_but_last():
    seen = []
    for _ in range(DOMAINS + 5):
        seen.append(reserve_domain())
        release_domain(seen[-1])
    assert all(a != b for a, b in zip(seen, seen[1:], strict=False))
    assert len(set(seen)) > DOMAINS // 2
    release_domain(seen[-1])  # released already: nothing happens
