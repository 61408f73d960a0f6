"""A quick pass over everything: the first cases of each test alone, with few examples.

For another version of a library: what it may break is a call, and that shows in the first case.
"""

from __future__ import annotations

from collections import Counter

import pytest

EXAMPLES = 8


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--first-cases",
        type=int,
        metavar="N",
        help=f"run the first N cases of each parametrised test alone, with {EXAMPLES} examples "
        "where hypothesis draws them",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    most = config.getoption("--first-cases")
    if most is None:
        return
    # Takes a second: not for those who ask for all cases.
    from hypothesis import settings

    seen: Counter[tuple[str, str]] = Counter()
    kept, left_out = [], []
    for item in items:
        name = getattr(item, "originalname", None) or item.name
        test = (item.nodeid.split("[")[0], name)
        seen[test] += 1
        (kept if seen[test] <= most else left_out).append(item)
    for item in kept:
        drawn = getattr(item, "obj", None)
        given = getattr(drawn, "_hypothesis_internal_use_settings", None)
        if given is not None and given.max_examples > EXAMPLES:
            drawn._hypothesis_internal_use_settings = settings(given, max_examples=EXAMPLES)
    config.hook.pytest_deselected(items=left_out)
    items[:] = kept
