"""Extended objects in every decision of the ring."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from extended_examples import QUIET, RATES, ring_of, scans, truth_at

from gda_tracker.kinematics.extended.ellipses import gaussian_wasserstein
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.extended.columns import turned, turns
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, Detections

DECISIONS = ("gda", "map", "jpda", "mht")


def plain(tracks):
    return [
        value.tobytes() if isinstance(value, np.ndarray) else value
        for item in dataclasses.fields(tracks)
        if (value := getattr(tracks, item.name)) is not None
    ]


@pytest.mark.parametrize("model", ["cv", "imm"])
@pytest.mark.parametrize("decision", DECISIONS)
def test_ellipses_are_found_by_every_decision(decision, model):
    ring = ring_of(decision=decision, filter=model)
    for detections in scans(25, seed=1):
        result = ring.process(detections)
    tracks = result.tracks
    sure = np.flatnonzero(tracks.status == CONFIRMED)
    assert len(sure) == 2
    centre, extent = truth_at(24.0)
    for place, matrix, rate in zip(centre, extent, RATES, strict=True):
        distance = gaussian_wasserstein(
            tracks.mean[sure, :2], tracks.extent[sure], place[None], matrix[None]
        )
        assert distance.min() < 2.5
        assert tracks.expected_detections[sure[distance.argmin()]] == pytest.approx(rate, rel=0.35)


def test_the_detections_of_a_track_are_those_of_its_cell():
    ring = ring_of(decision="map")
    for detections in scans(12, seed=2):
        result = ring.process(detections)
    tracks, cells = result.tracks, result.scan.cells
    assert len(tracks.detection_rows) == tracks.detection_count.sum()
    begin = np.cumsum(tracks.detection_count) - tracks.detection_count
    known = 0
    for row, index in enumerate(tracks.detection_index):
        own = tracks.detection_rows[begin[row] : begin[row] + tracks.detection_count[row]]
        if index < 0:
            assert not len(own)
            continue
        known += 1
        assert index in own
        cell = np.flatnonzero(result.scan.source_index == index)[0]
        r, a = detections.range_m[own], detections.azimuth_rad[own]
        centroid = np.array([(r * np.cos(a)).mean(), (r * np.sin(a)).mean()])
        told = result.scan.range_m[cell], result.scan.azimuth_rad[cell]
        np.testing.assert_allclose(
            centroid, [told[0] * np.cos(told[1]), told[0] * np.sin(told[1])], atol=1e-9
        )
        assert result.scan.rcs_m2[cell] == pytest.approx(detections.rcs_m2[own].sum())
    assert known
    # Every detection is in one cell.
    assert sorted(cells.member.tolist()) == list(range(len(detections.range_m)))
    assert result.report.cells == len(result.scan)
    assert result.report.detections_admitted == len(detections.range_m)
    assert 0.0 < result.report.partition_probability <= 1.0


@pytest.mark.parametrize("decision", ["map", "jpda"])
def test_centroid_and_extent_are_consistent(decision):
    """NEES of the state, and how often the true axes' scale exceeds what is expected."""
    nees, ratio, spread = [], [], []
    for seed in range(8):
        # The targets do not accelerate; of their size nothing is known before.
        ring = ring_of(
            decision=decision,
            process_noise_std_mps2=1e-4,
            extent_radius_m=4.0,
            extent_prior_weight=2.01,
        )
        for k, detections in enumerate(scans(14, seed=100 + seed, clutter=1.0)):
            tracks = ring.process(detections).tracks
            if k < 8:
                continue
            centre, extent = truth_at(float(k))
            velocity = truth_at(k + 1.0)[0] - centre
            for place, speed, matrix in zip(centre, velocity, extent, strict=True):
                gap = np.hypot(*(tracks.mean[:, :2] - place).T)
                if not len(gap) or gap.min() > 6.0:
                    continue
                row = gap.argmin()
                error = tracks.mean[row] - np.concatenate([place, speed])
                nees.append(error @ np.linalg.solve(tracks.covariance[row], error))
                whole = np.trace(np.linalg.solve(matrix, tracks.extent[row])) / 2.0
                ratio.append(whole)
                spread.append(1.0 / tracks.extent_weight[row])
    assert len(nees) > 80
    # Four components; scans of one run hang together, so that the bounds are those of 16
    # independent tracks, 95 % of a mean of so many.
    assert 2.73 < np.mean(nees) < 5.5
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.12)
    # The scatter of the mean square axis: variance about 1 / weight.
    assert np.var(ratio) == pytest.approx(np.mean(spread), rel=0.8)


def test_points_stay_what_they_were():
    """Whatever is said of extended objects, without them nothing changes."""
    told = {"cell_largest_distance_m": 50.0, "extent_radius_m": 1.0, "detections_per_object": 2.0}
    one, other = (Ring({"track_manager": {**QUIET, **each}}) for each in ({}, told))
    for detections in scans(6, seed=3):
        a, b = one.process(detections), other.process(detections)
        assert plain(a.tracks) == plain(b.tracks)
        assert a.scan.cells is None
        assert a.predictions.extents is None
        assert a.report.cells is None
        assert not len(a.tracks.extent_weight)
        assert len(a.scan) == len(detections.range_m)


@pytest.mark.parametrize("decision", ["jpda", "mht"])
def test_a_restart_goes_on_bit_for_bit(decision, tmp_path):
    made = scans(14, seed=4)
    ring = ring_of(decision=decision)
    for detections in made[:9]:
        ring.process(detections)
    checkpoint.save(ring.manager, tmp_path / "state")
    again = ring_of(decision=decision)
    assert checkpoint.load(again.manager, tmp_path / "state")
    assert plain(again.manager.tracks()) == plain(ring.manager.tracks())
    for detections in made[9:]:
        expected = ring.process(detections)
        found = again.process(detections)
        assert plain(found.tracks) == plain(expected.tracks)
        assert [plain(t) for t in found.delayed] == [plain(t) for t in expected.delayed]


@pytest.mark.parametrize("decision", ["map", "mht"])
def test_on_and_off_while_it_runs(decision):
    ring = ring_of(decision=decision, extended_objects="none")
    made = scans(12, seed=5, clutter=0.0)
    for detections in made[:4]:
        assert not len(ring.process(detections).tracks.extent_weight)
    ring.set_parameters({"track_manager": {"extended_objects": "random_matrix"}})
    for detections in made[4:8]:
        tracks = ring.process(detections).tracks
        assert tracks.extent.shape == (len(tracks), 2, 2)
    ring.set_parameters({"track_manager": {"extended_objects": "none"}})
    for detections in made[8:]:
        result = ring.process(detections)
        assert result.scan.cells is None
        assert not len(result.tracks.extent_weight)


def test_tilted_sensors_elevations_rates_and_attributes():
    """Cells of a scan in which all is measured; the sensor becomes level."""
    rng = np.random.default_rng(6)
    n = 9
    detections = Detections(
        "radar", 10**9, 100.0 + rng.normal(0.0, 1.0, n), rng.normal(0.3, 0.005, n),
        elevation_rad=rng.normal(0.1, 0.005, n), range_rate_mps=np.full(n, 3.0),
        time_offset_s=np.full(n, 0.01), sensor_position_m=np.array([5.0, 6.0, 7.0]),
        sensor_orientation_xyzw=np.array([0.05, -0.03, 0.2, 0.0]) + [0, 0, 0, np.sqrt(0.9566)],
        attribute_names=("length_m",), attribute_values=np.arange(n, dtype=float)[None],
    )  # fmt: skip
    detections.rcs_m2 = np.full(n, 2.0)
    result = ring_of(cell_least_distance_m=20.0, cell_largest_distance_m=20.0).process(detections)
    scan = result.scan
    assert len(scan) == 1
    assert scan.elevation_rad is None
    assert scan.noise_covariance.shape == (1, 3, 3)
    assert (np.linalg.eigvalsh(scan.noise_covariance) > 0.0).all()
    assert scan.rcs_m2[0] == pytest.approx(2.0 * n)
    assert scan.attribute_values[0, 0] == pytest.approx((n - 1) / 2.0)
    assert scan.time_offset_s[0] == pytest.approx(0.01)
    assert scan.range_rate_mps[0] == pytest.approx(3.0 / np.cos(0.1), rel=0.05)


@pytest.mark.parametrize("decision", DECISIONS)
def test_scans_without_detections(decision):
    ring = ring_of(decision=decision)
    made = scans(8, seed=7)
    for detections in made[:5]:
        ring.process(detections)
    none = np.empty(0)
    result = ring.process(Detections("radar", 6 * 10**9, none, none, rcs_m2=none))
    assert result.report.outcome == "tracked"
    assert result.report.cells == 0
    assert (result.tracks.detection_count == 0).all()
    assert ring.process(made[6]).report.outcome == "tracked"


def test_bad_input_is_left_out_and_counted():
    ring = ring_of()
    detections = scans(1, seed=8)[0]
    detections.range_m[:2] = [np.nan, np.inf]
    result = ring.process(detections)
    assert sum(result.report.rejected.values()) == 2
    assert result.report.detections_admitted == len(detections.range_m) - 2
    assert not set(result.scan.cells.member.tolist()) & {0, 1}


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"cell_least_distance_m": 13.0}, ("cell_least_distance_m", "cell_largest_distance_m")),
        ({"max_detections_per_scan": 6000}, ("max_detections_per_scan", "extended_objects")),
        ({"clutter_density_per_m_rad": 0.0}, ("clutter_density_per_m_rad", "extended_objects")),
        ({"extent_prior_weight": 2.0}, ("extent_prior_weight",)),
    ],
)
def test_what_does_not_go_together_is_refused(changes, names):
    with pytest.raises(ParameterError) as caught:
        ring_of(**changes)
    assert all(name in str(caught.value) for name in names)


def test_the_ellipse_turns_as_far_as_the_course_is_known():
    def table(velocity, variance):
        covariance = np.diag([1.0, 1.0, variance, variance])[None]
        mean = np.array([[0.0, 0.0, *velocity]])
        return HypothesisTable(hypothesis_id=np.ones(1), mean=mean, covariance=covariance)

    sure = turns(table((10.0, 0.0), 1e-9), table((0.0, 10.0), 1e-9))
    assert sure == pytest.approx(np.pi / 2, abs=1e-6)
    assert turns(table((10.0, 0.0), 1.0), table((0.0, 10.0), 1.0)) == pytest.approx(
        np.pi / 2 * np.exp(-2.0 * 0.01)
    )
    assert turns(table((0.0, 0.0), 1.0), table((0.0, 10.0), 1.0)) == 0.0
    extent = np.diag([9.0, 4.0])[None]
    np.testing.assert_allclose(turned(extent, sure)[0], np.diag([4.0, 9.0]), atol=1e-6)
