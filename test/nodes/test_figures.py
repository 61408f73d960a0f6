"""Figures of diagnostics: worked by hand, and telling what is wrong where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracking_examples import QUIET, scan_at, simulated

from gda_tracker.nodes.figures import (
    EngineFigures,
    EvidenceFigures,
    FusionFigures,
    Recent,
    Shares,
    TrackingFigures,
    taken_nis,
)
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.tracks import CONFIRMED


def test_quantiles_and_rate_of_the_last_numbers():
    recent = Recent(4)
    assert recent.milliseconds("latency") == {}
    assert recent.rate_hz(0.0) is None
    for value in (99.0, 0.001, 0.002, 0.003, 0.004):  # the first has been forgotten
        recent.note(value)
    expected = np.percentile([1.0, 2.0, 3.0, 4.0], (50, 95))
    assert recent.milliseconds("x") == {
        "x_ms_p50": pytest.approx(expected[0], abs=1e-3),
        "x_ms_p95": pytest.approx(expected[1], abs=1e-3),
    }
    arrivals = Recent(10)
    for k in range(30):
        arrivals.note(5.0 + 0.25 * k)
    assert arrivals.rate_hz(12.3) == pytest.approx(4.0)
    # A sensor that has been silent for 20 s does not send at 4 Hz.
    assert arrivals.rate_hz(32.25) == pytest.approx(9 / 22.25)


def test_shares_weigh_scans_by_what_is_in_them():
    shares = Shares(2)
    assert shares.figure("x") == {}
    shares.note(100.0, 1)
    shares.note(1.0, 1)
    shares.note(0.0, 3)
    assert shares.count == 4
    assert shares.figure("x") == {"x": 0.25}


def run(scans=None, **manager):
    """Figures after a run with noise of 10 m and 1 mrad, and the squared distances by hand."""
    parameters = {**QUIET, **manager}
    association = {"max_exact_size": 1, "belief_propagation_iterations": 1}
    nodes = {"track_manager": parameters}
    if manager.get("decision") == "jpda":
        nodes["association"] = association
    ring = Ring(nodes)
    figures = TrackingFigures(), EvidenceFigures(), FusionFigures(), EngineFigures()
    by_hand = []
    for scan in scans or simulated(60, 4, clutter=2):
        opened = []
        original = ring.manager.open
        ring.manager.open = lambda o=original, kept=opened: kept.append(o()) or kept[-1]
        result = ring.process(scan)
        ring.manager.open = original
        leading = opened[0].table.chosen
        parts = (result.scan, result.predictions, leading, result.associations, result.tracks)
        figures[0].note(*parts)
        figures[1].note(result.scan, result.evidence)
        figures[2].note(result.scores)
        figures[3].note(result.associations)
        if len(result.tracks):
            nis = taken_nis(*parts)
            confirmed = result.tracks.status == CONFIRMED
            assert len(nis) <= np.count_nonzero(confirmed)
            chosen = result.associations.chosen
            if chosen.any():
                rows = result.associations.hypothesis[chosen]
                of = result.predictions.track_id[rows]
                good = np.isin(of, result.tracks.track_id[confirmed])
                expected = result.associations.mahalanobis_squared[chosen][good]
                assert np.array_equal(nis, expected)
            by_hand.append(nis)
    return figures, np.concatenate(by_hand)


@pytest.mark.parametrize("decision", ["map", "mht"])
def test_the_innovations_of_a_model_that_fits(decision):
    (tracking, *_), nis = run(decision=decision)
    assert len(nis) > 100
    found = tracking.values()["nis_mean"]
    assert found == pytest.approx(nis.mean(), abs=1e-3)
    assert 1.0 < found < 3.0
    assert 0.0 < tracking.values()["detections_outside_gates_share"] < 0.6
    assert tracking.problem() == ""


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        (
            {"range_std_m": 4.0, "azimuth_std_rad": 0.0004, "gate_probability": 0.999999},
            "too small",
        ),
        ({"range_std_m": 100.0, "azimuth_std_rad": 0.01}, "too large"),
    ],
)
def test_noise_that_does_not_fit_is_named(changes, word):
    (tracking, *_), nis = run(**changes, process_noise_std_mps2=0.1)
    assert len(nis) > 50
    assert word in tracking.problem(), tracking.values()
    assert "range_std_m" in tracking.problem()


def test_attributes_of_no_use_are_named():
    scans = simulated(40, 4, clutter=2)
    (_, evidence, fusion, _), _ = run(scans)
    known = np.concatenate([np.isfinite(scan.rcs_m2) for scan in scans])
    assert evidence.values()["rcs_known_share"] == pytest.approx(known.mean(), abs=1e-3)
    assert evidence.values()["attribute_used_share"] == pytest.approx(known.mean(), abs=1e-3)
    assert 0.0 < fusion.values()["informative_pairs_share"] < 1.0
    assert 0.0 < fusion.values()["pair_conflict_mean"] < 1.0
    assert evidence.problem() == ""
    # dBsm of ships, taken for m2, is beyond all bounds here.
    (tracking, evidence, _, _), _ = run([replace(s, rcs_m2=s.rcs_m2 + 1e7) for s in scans])
    assert "below rcs_min_m2 or above rcs_max_m2" in evidence.problem()
    (_, evidence, _, _), _ = run([replace(s, rcs_m2=None) for s in scans])
    assert evidence.values() == {"rcs_known_share": 0.0, "attribute_used_share": 0.0}
    assert evidence.problem() == ""


def test_engines_are_counted_and_those_that_do_not_settle_named():
    (*_, engines), _ = run()
    assert "0" not in engines.values()["engines"].split(", ")
    assert engines.problem() == ""
    rng = np.random.default_rng(1)
    crowd = [scan_at(k, rng.normal([3000.0, 1000.0], 15.0, (8, 2)), rcs=2.0) for k in range(12)]
    (*_, engines), _ = run(crowd, decision="jpda", gate_probability=0.9999)
    assert "belief_propagation" in engines.values()["engines"]
    assert "raise max_exact_size or belief_propagation_iterations" in engines.problem()
