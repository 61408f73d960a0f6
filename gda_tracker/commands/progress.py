"""Progress on anything long: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINE_PERIOD_S = 10.0


@contextmanager
def progress_bar(total: int, unit: str, label: str = "") -> Iterator[Callable[[int], None]]:
    """Yield a function that takes the number done so far."""
    try:
        from tqdm import tqdm
    except ImportError:
        tqdm = None
    if tqdm is not None and sys.stderr.isatty():
        with tqdm(total=total, unit=f" {unit}", desc=label or None) as bar:

            def show(done: int) -> None:
                bar.update(done - bar.n)

            yield show
        return
    said = time.monotonic()

    def say(done: int) -> None:
        nonlocal said
        if time.monotonic() - said > LINE_PERIOD_S:
            said = time.monotonic()
            print(f"{label + ': ' if label else ''}{done} of {total} {unit}", file=sys.stderr)

    yield say
