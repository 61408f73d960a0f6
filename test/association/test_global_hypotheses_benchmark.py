"""The benchmark of the global hypotheses: its scenes are what they say, and it runs."""

import json

import numpy as np
import pytest

from benchmarks.global_hypotheses import CASES, WINDOW, main
from gda_tracker.association.global_hypotheses import best_global_hypothesis


@pytest.mark.parametrize("name", CASES)
def test_scenes(name):
    case = CASES[name]
    log_score, track, used = case.scene(1)
    assert used.shape == (len(track), WINDOW)
    np.testing.assert_array_equal(np.unique(track), np.arange(case.tracks))
    np.testing.assert_array_equal(np.bincount(track), case.leaves)
    again = case.scene(1)
    np.testing.assert_array_equal(again[0], log_score)
    assert len(np.unique(np.column_stack([track, used]), axis=0)) == len(track)
    found = best_global_hypothesis(log_score, track, used)
    sizes = np.bincount(found.cluster)
    assert (len(found.dropped) == 0) == case.own
    assert sizes.max() <= 4 if case.grouped else sizes.tolist() == [case.tracks]


def test_dry_run(tmp_path, capsys):
    out = tmp_path / "results.json"
    main(["--seeds", "1", "--repeats", "1", "-k", "3", "--out", str(out)])
    written = json.loads(out.read_text())
    assert list(written["cases"]) == list(CASES)
    for found in written["cases"].values():
        assert min(found["median_s"].values()) > 0.0
    printed = capsys.readouterr().out
    assert all(name in printed for name in CASES)


def test_wrong_options_are_named(capsys):
    with pytest.raises(SystemExit):
        main(["--seeds", "0"])
    assert "seeds = 0" in capsys.readouterr().err
