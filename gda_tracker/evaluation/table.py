"""The result of an evaluation as plain text, beside what the scenario's source has published."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

from gda_tracker.evaluation.continuity import SETTLE_SCANS
from gda_tracker.evaluation.formation_results import BINS, formation_tables
from gda_tracker.evaluation.formation_results import NOTES as FORMATION_NOTES
from gda_tracker.evaluation.results import MethodResult, ScenarioResult
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.simulation.scenarios import NOTES, Scenario

PUBLISHED_PREFIX = "published_purity_"


def format_result(result: ScenarioResult, confusion: bool = False) -> str:
    """Return the table of one scenario, lines of at most about 100 characters.

    Parameters
    ----------
    result
        What :func:`~gda_tracker.evaluation.monte_carlo.monte_carlo` has found.
    confusion
        Whether to add, per method, the table of the chapter: which target's detection each track
        got.
    """
    targets = ", ".join(f"{t.id} {t.class_name}" for t in result.scenario.targets)
    lines = [
        f"{result.scenario.name}: {result.runs} runs of {result.n_scored_scans} scored scans, seed "
        f"{result.seed}, {result.initiation} initiation",
        f"targets: {targets}",
        "",
    ]
    if result.match_distance_m is None:
        rows = purity_table(result)
        lines += _align(rows[:2], rows[2:])
    else:
        lines += _quality(result)
    if len(result.methods) > 1:
        lines.append(
            f"difference: to {result.methods[0].method} on the same simulated scans, mean +- its "
            f"standard error"
        )
    if confusion:
        for method in result.methods:
            lines += _confusion(method, result.scenario)
    return "\n".join(lines) + "\n"


def purity_table(result: ScenarioResult) -> list[list[str]]:
    """Table of the purity with labelled initiation: heading, units, rows, published values."""
    ids = sorted(target.id for target in result.scenario.targets)
    rows = [
        ["method", "purity", "difference", *[f"target {i}" for i in ids], "missed", "FA", "CPU"],
        ["", "[0..1]", "[0..1]", *["[0..1]" for _ in ids], "[%]", "[%]", "[ms/scan]"],
    ]
    for index, method in enumerate(result.methods):
        assert method.confusion is not None
        assert method.purity_per_track is not None
        rows.append(
            [
                method.method,
                _with_error(method.score_mean, method.score_stderr, 3),
                _difference(method, index, 3),
                *[_number(value, 3) for value in method.purity_per_track],
                _number(100.0 * float(method.confusion[:, -2].mean()), 2),
                _number(100.0 * float(method.confusion[:, -1].mean()), 2),
                _number(method.cpu_ms_per_scan, 2),
            ]
        )
    for name, values in published_purity(result.scenario).items():
        mean = _number(sum(values) / len(values), 3)
        own = [_number(v, 3) for v in values]
        rows.append([f"published: {name}", mean, "", *own, *[""] * (len(ids) + 3 - len(own))])
    revised = [method.delayed for method in result.methods]
    if any(values is not None for values in revised):
        # The purity with the revised past, beside that of the scan itself.
        column = ["-" if v is None else _with_error(*mean_and_stderr(v), 3) for v in revised]
        cells = ["delayed", "[0..1]", *column, *[""] * (len(rows) - 2 - len(column))]
        for row, cell in zip(rows, cells, strict=True):
            row.insert(2, cell)
    return rows


def quality_tables(result: ScenarioResult) -> list[tuple[str, list[list[str]]]]:
    """Tables of the measures with automatic initiation: a title and rows for each.

    The first two rows are the heading and the units.
    """
    continuity = [
        [
            *["method", "completeness", "difference", "switches", "flips", "false tracks", "error"],
            "CPU",
        ],
        ["", "[0..1]", "[0..1]", "[per run]", "[per run]", "[per run]", "[m RMS]", "[ms/scan]"],
    ]
    distances = [
        ["method", "GOSPA", "localisation", "missed", "false", "OSPA"],
        ["", *["[m RMS]" for _ in range(5)]],
    ]
    life = [
        ["method", "extraction delay", "not extracted", "false tracks", "their life"],
        ["", "[s]", "[per run]", "[1/h]", "[s]"],
    ]
    later = [
        ["method", "online", "delayed", "smoothed"],
        ["", *["[m RMS]" for _ in range(3)]],
    ]
    extents = [["method", "Gaussian Wasserstein distance"], ["", "[m]"]]
    consistency = [
        ["method", "NEES", "consistent", "in bounds", "NIS", "consistent", "in bounds"],
        ["", "[1]", "[1]", "[%]", "[1]", "[1]", "[%]"],
    ]
    for index, method in enumerate(result.methods):
        assert method.quality is not None
        found = method.quality.values

        def value(name: str, digits: int, found: dict[str, Any] = found) -> str:
            return _with_error(found[name], found[f"{name}_stderr"], digits)

        continuity.append(
            [
                method.method,
                _with_error(method.score_mean, method.score_stderr, 3),
                _difference(method, index, 3),
                *[value(n, 2) for n in ("identity_switches", "identity_flips", "false_tracks")],
                _number(found["position_rmse_m"], 1),
                _number(method.cpu_ms_per_scan, 2),
            ]
        )
        parts = ("gospa_m", "gospa_localisation_m", "gospa_missed_m", "gospa_false_m", "ospa_m")
        distances.append([method.method, *[value(name, 1) for name in parts]])
        life.append(
            [
                method.method,
                value("extraction_delay_s", 1),
                value("targets_not_extracted", 2),
                value("false_tracks_per_hour", 1),
                value("false_track_life_s", 1),
            ]
        )
        names = ("position_rmse_m", "position_delayed_rmse_m", "position_smoothed_rmse_m")
        later.append([method.method, *[value(name, 1) for name in names]])
        if "extent_error_m" in found:
            extents.append([method.method, value("extent_error_m", 1)])
        row = [method.method]
        for name in ("nees", "nis"):
            row += [
                value(name, 2),
                _interval(found[f"{name}_lower"], found[f"{name}_upper"]),
                _number(100.0 * found[f"{name}_inside"], 0),
            ]
        consistency.append(row)
    tables = [
        ("Continuity", continuity),
        ("Distance of confirmed tracks and targets", distances),
        ("Extraction and false tracks", life),
        ("Position error by what is known", later),
        ("Consistency", consistency),
    ]
    if len(extents) > 2:
        tables.append(("Ellipses of extended objects", extents))
    counted = {m.method: m.quality.values for m in result.methods if m.quality is not None}
    return tables + (formation_tables(counted) if BINS in next(iter(counted.values())) else [])


def quality_notes(result: ScenarioResult) -> list[str]:
    """What the numbers of :func:`quality_tables` mean, a sentence or two for each table."""
    distance = f"{result.match_distance_m:.0f} m"
    notes = [
        f"a target is tracked if a confirmed track is within {distance} of it; a switch is a "
        f"change of track that lasts {SETTLE_SCANS} scans",
        f"GOSPA and OSPA with cut-off {distance} and squares; GOSPA^2 = localisation^2 + missed^2 "
        f"+ false^2",
        "extraction delay: from a target's first detection to its confirmed track; false tracks "
        "were confirmed and never near a target",
        "error of the tracks as they are told online, N scans later (mht) and in the light of the "
        "whole run (fixed-interval smoothing)",
        "NEES, NIS: squared error of state and innovation over their covariance, mean of all "
        "scans; consistent: 95 % bounds of the mean at one scan; in bounds: share of scans, 95 if "
        "all is well",
        "Gaussian Wasserstein distance to the true ellipses: centre, size and direction in one",
    ]
    qualities = [method.quality for method in result.methods if method.quality is not None]
    ellipses = any("extent_error_m" in quality.values for quality in qualities)
    counted = any(BINS in quality.values for quality in qualities)
    return (notes if ellipses else notes[:-1]) + (FORMATION_NOTES if counted else [])


def _quality(result: ScenarioResult) -> list[str]:
    lines: list[str] = []
    for (_, rows), note in zip(quality_tables(result), quality_notes(result), strict=True):
        lines += [*_align(rows[:2], rows[2:]), *textwrap.wrap(note, 100), ""]
    return lines[:-1]


def _confusion(method: MethodResult, scenario: Scenario) -> list[str]:
    if method.confusion is None:
        return []
    ids = sorted(target.id for target in scenario.targets)
    header = [["", *[f"obs. {i}" for i in ids], "missed", "FA"]]
    rows = [
        [f"track {i}", *[_number(value, 4) for value in row]]
        for i, row in zip(ids, method.confusion, strict=True)
    ]
    return ["", f"{method.method}: share of scans by the detection that each track got"] + _align(
        header, rows
    )


def published_purity(scenario: Scenario) -> dict[str, list[float]]:
    """Purity per target that the scenario's notes quote, by name; empty if there are none."""
    notes = scenario.notes.get(NOTES)
    found = {}
    for name, values in notes.items() if isinstance(notes, dict) else ():
        numbers = isinstance(values, list) and all(isinstance(v, int | float) for v in values)
        if str(name).startswith(PUBLISHED_PREFIX) and numbers and values:
            found[str(name).removeprefix(PUBLISHED_PREFIX).replace("_", " ")] = values
    return found


def _difference(method: MethodResult, index: int, digits: int) -> str:
    if index == 0:
        return "-"
    return f"{method.difference_mean:+.{digits}f}" + _error(method.difference_stderr, digits)


def _with_error(mean: float, stderr: float, digits: int) -> str:
    return _number(mean, digits) + _error(stderr, digits)


def _error(stderr: float, digits: int) -> str:
    return f" +- {stderr:.{digits}f}" if math.isfinite(stderr) else ""


def _interval(low: float, high: float) -> str:
    return f"{low:.2f} to {high:.2f}" if math.isfinite(low) else "n/a"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "n/a"


def _align(header: Sequence[Sequence[str]], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with columns of equal width: the first to the left, the others to the right."""
    n_columns = len(header[0])
    table = [[*row, *[""] * (n_columns - len(row))] for row in [*header, *rows]]
    widths = [max(len(row[column]) for row in table) for column in range(n_columns)]
    lines = []
    for row in table:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    rule = "-" * (sum(widths) + 2 * (n_columns - 1))
    return [*lines[: len(header)], rule, *lines[len(header) :], rule]
