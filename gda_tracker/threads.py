"""One thread of linear algebra per process.

The tracker multiplies many small matrices. A BLAS that spreads a product of some thousand numbers
over all cores waits for threads that other processes keep from running: the scan that takes 10 ms
then takes 100 ms or more, while nothing is gained when the machine is idle. Processes take the
cores instead.
"""

from __future__ import annotations

import os

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread_of_linear_algebra() -> None:
    """Ask for one thread, unless the environment says otherwise; before numpy is imported."""
    if not any(name in os.environ for name in THREAD_VARIABLES):
        os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
