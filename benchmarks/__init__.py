"""Benchmarks: run one with ``python -m benchmarks.NAME``, see benchmarks/README.md.

One thread for linear algebra, for every tracker alike and for the processes of the ring, which
inherit it. It must be said before numpy is imported; where something else (a test run) has imported
it already, nothing is changed.
"""

import os
import sys

if "numpy" not in sys.modules:
    for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[_name] = "1"
