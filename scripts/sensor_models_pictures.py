"""Pictures of docs/sensor-models.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.evaluation.figures.canvas import COLOURS, GREY, INK, canvas
from gda_tracker.kinematics.gaussian_sum_starts import Reach, start_sums
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.kinematics.measurement_models import Observed, measure
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network, sites_at
from gda_tracker.simulation.targets import target_states
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.tracks import CONFIRMED
from scripts.sensor_models_case import with_model

UNITS = {
    name: f"1/({model.unit})" if len(model) > 1 or "/" in model.unit else f"1/{model.unit}"
    for name, model in MEASUREMENT_MODELS.items()
}
SHOWN = ("bearing", "range", "range_doppler", "bistatic", "tdoa", "tdoa_fdoa")
TURN = np.linspace(0.0, 2.0 * np.pi, 60)


def all_pictures(results: dict[str, Any], seed: int) -> dict[str, Any]:
    """Figures by the names of their files."""
    return {
        "sensor_models_starts.png": starts(),
        "sensor_models_emitter.png": emitter(results, seed),
        "sensor_models_ghosts.png": ghosts(results, seed),
    }


def _ellipse(mean: FloatArray, covariance: FloatArray, size: float = 1.0) -> FloatArray:
    """Outline (2, points) of ``size`` standard deviations [km]."""
    root = np.linalg.cholesky(covariance[:2, :2])
    circle = np.stack([np.cos(TURN), np.sin(TURN)])
    return (mean[:2, None] + size * root @ circle) / 1e3


def starts() -> Any:
    """The Gaussian sum of one measurement, for each kind of curve."""
    with canvas(11.0, 7.6, "compressed") as figure:
        axes = figure.subplots(2, 3, sharex=True, sharey=True)
        for name, axis in zip(SHOWN, axes.flat, strict=True):
            scenario = with_model(name)
            sensor, target = scenario.sensors[0], scenario.targets[0]
            state = target_states(target, np.zeros(1), scenario.time.scan_period_s)
            model, sites = sensor.measured, sites_at(sensor, 0.0)
            # Drawn with more noise than it has, to be seen.
            noise = np.diag(np.square(sensor.deviations) * 15.0**2)[None]
            seen = Observed(model, sites, measure(model, sites, state), noise)
            assert scenario.reach is not None
            reach = Reach(1_000.0, 25_000.0, 24, scenario.reach.max_speed_mps)
            sums = start_sums(seen, reach)
            heaviest = sums.weight[0].max()
            for weight, mean, covariance in zip(
                sums.weight[0], sums.mean[0], sums.covariance[0], strict=True
            ):
                outline = _ellipse(mean, covariance)
                axis.fill(*outline, color=COLOURS[0], alpha=0.1 + 0.6 * weight / heaviest, lw=0)
                axis.plot(*outline, color=COLOURS[0], lw=0.6)
            axis.plot(*(sites.position_m.T / 1e3), "s", color=INK, ms=5, label="sensors")
            axis.plot(*(state[0, :2] / 1e3), "x", color=COLOURS[1], ms=9, mew=2, label="target")
            axis.set_title(name)
            axis.set_aspect("equal")
            axis.set_xlim(-20, 28)
            axis.set_ylim(-22, 26)
        for axis in axes[1]:
            axis.set_xlabel("East [km]")
        for axis in axes[:, 0]:
            axis.set_ylabel("North [km]")
        axes[0, 0].legend(loc="lower left")
        return figure


def emitter(results: dict[str, Any], seed: int) -> Any:
    """One run on the map, and the error of all against the bound."""
    scenario = load_scenario("moving_emitter")
    recording = simulate_network(scenario, seed, 0)
    ring = Ring(with_method(tracker_preset(scenario), "mht/none/cv"))
    with canvas(11.0, 5.0) as figure:
        place, error = figure.subplots(1, 2)
        sensor = scenario.sensors[0]
        times = np.array([d.stamp_ns / 1e9 for d in recording.detections])
        sites = np.stack([sites_at(sensor, t).position_m for t in times]) / 1e3
        for number in range(2):
            place.plot(*sites[:, number].T, color=INK, lw=1.2)
            place.plot(*sites[-1, number], ">", color=INK, ms=6)
        assert recording.truth is not None
        path = np.stack([truth.target_state[0] for truth in recording.truth]) / 1e3
        place.plot(*path[:, :2].T, color=COLOURS[1], lw=3, label="emitter")
        shown = {1: COLOURS[4], 8: COLOURS[0], 20: COLOURS[2]}
        for number, detections in enumerate(recording.detections):
            tracks = ring.process(detections).tracks
            if number not in shown or tracks is None or not len(tracks):
                continue
            table = ring.manager.state.table
            row = int(np.argmax(table.hits))
            many = table.model_weight.shape[1] > 0
            weight = table.model_weight[row] if many else np.ones(1)
            mean = table.model_mean[row] if many else table.mean[[row]]
            covariance = table.model_covariance[row] if many else table.covariance[[row]]
            label = f"components after {times[number]:.0f} s"
            for one in np.flatnonzero(weight > 0.01 * weight.max()):
                outline = _ellipse(mean[one], covariance[one], 2.0)
                place.fill(*outline, color=shown[number], alpha=0.6, lw=3.0, label=label)
                label = "_"
        place.set_title("One run: two aircraft, one emitter")
        place.set_xlabel("East [km]")
        place.set_ylabel("North [km]")
        place.set_xlim(-4, 38)
        place.set_ylim(-22, 28)
        place.set_aspect("equal", adjustable="box")
        place.legend(loc="lower right")
        found = results["moving_emitter"]
        error.semilogy(found["time_s"], found["bound_by_scan_m"], "--", color=INK, label="bound")
        told = [np.nan if e is None else e for e in found["error_by_scan_m"]]
        error.semilogy(
            found["time_s"], told, color=COLOURS[0], lw=2, label=f"tracker, {found['runs']} runs"
        )
        from_s = found["time_s"][results["converged_from_scan"]]
        error.axvline(from_s, color=GREY, lw=1, ls=":")
        error.set_title(f"Error against the Cramer-Rao bound: ratio {found['ratio']:.2f}")
        error.set_xlabel("time [s]")
        error.set_ylabel("position error [m RMS]")
        error.legend()
        return figure


def ghosts(results: dict[str, Any], seed: int) -> Any:
    """Crossing bearings with two ghosts, tracks of two decisions, and how often both are found."""
    scenario = load_scenario("crossing_bearings")
    recording = simulate_network(scenario, seed, 0)
    assert recording.truth is not None
    with canvas(11.0, 5.2) as figure:
        place, share = figure.subplots(1, 2)
        for number, (detections, truth) in enumerate(
            zip(recording.detections[:2], recording.truth[:2], strict=True)
        ):
            own = truth.source_id if truth.source_id is not None else np.zeros(0)
            for azimuth in detections.azimuth_rad[own >= 0]:
                end = 12_000.0 * np.array([np.cos(azimuth), np.sin(azimuth)])
                start = detections.sensor_position_m[:2]
                line = np.stack([start, start + end]) / 1e3
                place.plot(
                    *line.T, color=GREY, lw=0.8, label="first bearings" if not number else "_"
                )
            place.plot(*detections.sensor_position_m[:2] / 1e3, "s", color=INK, ms=6)
        paths = np.stack([truth.target_state for truth in recording.truth]) / 1e3
        for target in range(paths.shape[1]):
            label = "boats" if not target else "_"
            place.plot(*paths[:, target, :2].T, color=COLOURS[1], lw=5, alpha=0.5, label=label)
        for method, colour in (("map/none/cv", COLOURS[3]), ("mht/none/cv", COLOURS[0])):
            ring = Ring(with_method(tracker_preset(scenario), method))
            lines: dict[int, list[FloatArray]] = {}
            for detections in recording.detections[:50]:
                tracks = ring.process(detections).tracks
                assert tracks is not None
                for row in np.flatnonzero(tracks.status == CONFIRMED):
                    lines.setdefault(int(tracks.track_id[row]), []).append(tracks.mean[row, :2])
            label = f"tracks of {method.split('/')[0]}"
            for line in lines.values():
                # Where it stands when it has settled.
                place.plot(*(np.array(line)[4:].T / 1e3), color=colour, lw=1.6, label=label)
                label = "_"
        place.set_xlim(-1, 11)
        place.set_ylim(-3, 11)
        place.set_aspect("equal", adjustable="box")
        place.set_title("One run, 100 s: two boats, two ghosts")
        place.set_xlabel("East [km]")
        place.set_ylabel("North [km]")
        handles, labels = place.get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        place.legend(unique.values(), unique.keys(), loc="lower left")
        times = [detections.stamp_ns / 1e9 for detections in recording.detections]
        colours = (COLOURS[3], COLOURS[2], COLOURS[0])
        for (method, values), colour in zip(results["ghosts"].items(), colours, strict=True):
            share.plot(times, 100.0 * np.array(values), color=colour, lw=2, label=method)
        share.set_title(f"Both boats found within 150 m, {results['ghost_runs']} runs")
        share.set_xlabel("time [s]")
        share.set_ylabel("runs [%]")
        share.legend(loc="lower right")
        return figure
