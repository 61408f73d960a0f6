"""What the page is told: columns, series, fuzzy sets, the matrix; each against its source."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import from_mapping
from gda_tracker.view.encoding import decibels, numbers, past_json, scan_json
from gda_tracker.view.fuzzy_sets import fuzzy_sets_json
from gda_tracker.view.matrix import MOST_COLUMNS, MOST_ROWS, matrix_json
from gda_tracker.view.series import track_json


def test_numbers_are_strict_json():
    values = np.array([[1.23456, np.nan], [np.inf, -0.5]])
    assert numbers(values, 2) == [[1.23, None], [None, -0.5]]
    json.dumps(numbers(values, 2), allow_nan=False)
    level = decibels(np.array([10.0, 1.0, 0.0, -1.0, np.nan]))
    assert level[:2].tolist() == [10.0, 0.0]
    assert np.isnan(level[2:]).all()


def test_a_scan_says_what_the_ring_said(gda):
    at = 7
    result, (_, picture) = gda.results[at - 1], gda.history.between(at, at)[0]
    told = json.loads(json.dumps(scan_json(gda.history, at, picture), allow_nan=False))
    tracks, seen = told["tracks"], told["detections"]
    assert told["stamp_ns"] == str(result.report.key.stamp_ns)
    np.testing.assert_allclose(tracks["x"], result.tracks.mean[:, 0], atol=1e-3)
    np.testing.assert_allclose(tracks["vy"], result.tracks.mean[:, 3], atol=1e-3)
    np.testing.assert_allclose(tracks["xy"], result.tracks.covariance[:, 0, 1], atol=1e-3)
    np.testing.assert_allclose(
        tracks["class_probability"], result.tracks.class_probability, atol=1e-4
    )
    assert tracks["detection"] == result.tracks.detection_index.tolist()
    assert "VS&S&B" in tracks["focal"]
    np.testing.assert_allclose(
        10.0 ** (np.array(seen["rcs_dbsm"]) / 10.0), result.scan.rcs_m2, rtol=2e-3
    )
    np.testing.assert_allclose(np.hypot(seen["x"], seen["y"]), seen["range"], rtol=1e-6)
    past = past_json(at, picture)
    np.testing.assert_allclose(past["x"], seen["x"], atol=6e-3)
    assert past["id"] == tracks["id"]


@pytest.mark.parametrize("fixture", ["gda", "mht"])
def test_the_matrix_agrees_with_the_association_log(fixture, request):
    """Every cell: both terms apart are value less threshold, their sum the ratio of the log."""
    run = request.getfixturevalue(fixture)
    compared = 0
    for result, (_, picture) in zip(run.results, run.history.between(1, 999), strict=True):
        logged = {
            (pair["hypothesis_id"], pair["detection"]): pair for pair in log_entry(result)["pairs"]
        }
        for track in result.predictions.track_id.tolist():
            matrix = matrix_json(picture, track)
            if matrix is None:
                continue
            cells = matrix["cells"]
            assert matrix["rows"]["track"][0] == track
            for i, (row, column) in enumerate(zip(cells["row"], cells["column"], strict=True)):
                pair = logged[(matrix["rows"]["hypothesis"][row], matrix["columns"][column])]
                terms = {term["term"]: term for term in pair["terms"]}
                for name, cell in (
                    ("kinematic_log_likelihood", "kinematic"),
                    ("attribute_log_likelihood", "attribute"),
                ):
                    expected = terms[name]["value"] - terms[name]["threshold"]
                    assert cells[cell][i] == pytest.approx(expected, abs=2e-3)
                assert cells["ratio"][i] == pytest.approx(
                    cells["kinematic"][i] + cells["attribute"][i], abs=3e-3
                )
                assert cells["p_kinematic"][i] == pytest.approx(
                    terms["p_kinematic"]["value"], abs=1e-3
                )
                assert cells["chosen"][i] == pair["chosen"]
                compared += 1
    assert compared > 30


def test_a_matrix_holds_the_whole_cluster_and_says_what_it_leaves_out(mht):
    for result, (_, picture) in zip(mht.results, mht.history.between(1, 999), strict=True):
        matrix = matrix_json(picture, None)
        if matrix is None:
            assert not len(result.associations.hypothesis)
            continue
        assert len(matrix["rows"]["track"]) <= MOST_ROWS
        assert len(matrix["columns"]) <= MOST_COLUMNS
        tracks = set(matrix["rows"]["track"])
        decided, predictions = result.associations, result.predictions
        of_cluster = np.isin(predictions.track_id[decided.hypothesis], list(tracks))
        shown = len(matrix["cells"]["row"])
        assert shown + matrix["left_out"] >= np.count_nonzero(of_cluster)


def test_a_track_without_a_pair_has_no_matrix(gda):
    picture = gda.history.between(5, 5)[0][1]
    assert matrix_json(picture, 424242) is None
    assert matrix_json(replace(picture, decision=None), None) is None


def test_series_of_a_track_is_the_rcs_of_its_detections(gda):
    track = int(gda.results[0].tracks.track_id[0])
    told = track_json(gda.history, track, 999)
    assert told["scan"] == list(range(1, len(gda.results) + 1))
    known = 0
    for value, result in zip(told["rcs_dbsm"], gda.results, strict=True):
        row = result.tracks.track_id.tolist().index(track)
        detection = int(result.tracks.detection_index[row])
        if detection < 0:
            assert value is None
            continue
        at = result.scan.source_index.tolist().index(detection)
        assert value == pytest.approx(10.0 * math.log10(result.scan.rcs_m2[at]), abs=6e-3)
        known += 1
    assert known > 5
    assert track_json(gda.history, track, 4)["scan"] == [1, 2, 3, 4]
    assert track_json(gda.history, 424242, 999) is None


def test_fuzzy_sets_are_those_the_fuzzifier_makes_masses_with(gda):
    values = gda.parameters["rcs_fuzzifier"]
    told = fuzzy_sets_json(values)
    scan = gda.results[3].scan
    fuzzifier = RcsFuzzifier(from_mapping(RcsFuzzifierParameters, values))
    level = np.array(told["level_dbsm"])
    rcs = 10.0 ** (level / 10.0)
    probe = replace(
        scan,
        source_index=np.arange(len(rcs), dtype=np.int32),
        range_m=np.full(len(rcs), 1e3),
        azimuth_rad=np.zeros(len(rcs)),
        noise_covariance=np.tile(np.eye(2), (len(rcs), 1, 1)),
        rcs_m2=rcs,
        rcs_valid=np.ones(len(rcs), dtype=bool),
    )
    masses = fuzzifier(probe).masses[:, : len(fuzzifier.frame)]
    np.testing.assert_allclose(np.array(told["grade"]).T, masses, atol=2e-3)
    assert told["labels"] == list(fuzzifier.frame)


def test_formations_come_with_their_numbers_and_parents(gda):
    at = len(gda.results)
    _, picture = gda.history.between(at, at)[0]
    assert scan_json(gda.history, at, picture)["formations"] is None
    tracker = FormationTracker()
    for result in gda.results[:at]:
        found = tracker.take(result.tracks, result.scan, result.predictions)
    parent = replace(found.formations[0], formation_id=99, parent_ids=())
    child = replace(found.formations[0], parent_ids=(99, 1000))
    shown = replace(picture, formations=replace(found, formations=[parent, child]))
    told = json.loads(json.dumps(scan_json(gda.history, at, shown), allow_nan=False))["formations"]
    assert told["id"] == [99, child.formation_id]
    assert told["text"][0][0].startswith("F99: ")
    np.testing.assert_allclose([told["x"][0], told["y"][0]], parent.position, atol=1e-3)
    assert told["parents"][0] == []
    np.testing.assert_allclose(told["parents"][1], [parent.position], atol=1e-3)
    ellipse = np.array([told[name][0] for name in ("xx", "xy", "yy")])
    expected = (len(parent.track_ids) - 1) * parent.extent[[0, 0, 1], [0, 1, 1]]
    np.testing.assert_allclose(ellipse, expected, atol=1e-3)
    nothing = replace(picture, formations=replace(found, formations=[]))
    assert scan_json(gda.history, at, nothing)["formations"]["id"] == []
