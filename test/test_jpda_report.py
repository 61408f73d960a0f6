"""The table of docs/jpda.md: what is measured, and how it is written."""

from __future__ import annotations

import numpy as np
import pytest

from scripts import measure_jpda

pytestmark = pytest.mark.slow


def test_every_ring_differs_in_what_its_row_says(monkeypatch):
    monkeypatch.setattr(measure_jpda, "TERMS_AND_FILTERS", ("none/imm",))
    purities = measure_jpda.measure("closely_spaced_targets", 1, 1)
    values = [purities["closely_spaced_targets", "none/imm", d] for d in measure_jpda.DECISIONS]
    assert all(value.shape == (1,) for value in values)
    assert all(0.0 <= value[0] <= 1.0 for value in values)
    # Without attributes the closely spaced tracks coalesce, unless the remedy is on.
    assert values[1][0] < values[2][0]


def test_differences_are_paired(tmp_path):
    rng = np.random.default_rng(1)
    purities = {}
    for scenario in measure_jpda.SCENARIOS:
        for other in measure_jpda.TERMS_AND_FILTERS:
            run = rng.uniform(0.2, 0.8, 50)
            for k, decision in enumerate(measure_jpda.DECISIONS):
                purities[scenario, other, decision] = run + 0.05 * k
    lines = measure_jpda.purity_table(purities).splitlines()
    assert len(lines) == 2 + 12
    for row, difference in ((3, "+0.050 +- 0.000"), (4, "+0.100 +- 0.000")):
        assert lines[row].count(difference) == 2
    assert "`jpda_star`" in lines[4]
