"""Quality of tracking over many runs: the numbers of table and JSON, and their course over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.evaluation.formation_results import formation_values
from gda_tracker.evaluation.quality import Consistency, Quality, combine_consistency
from gda_tracker.evaluation.statistics import mean_and_stderr, root_mean_square
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True)
class QualityResult:
    """What one method reached with automatic initiation.

    ``values`` has every number under its name in the JSON, means over runs with ``_stderr`` beside
    them. ``completeness`` (runs,) is what methods are compared by. Per scan (K,), over all runs:
    ``gospa_m`` and ``ospa_m`` as roots of mean squares, and the parts of the former,
    ``localisation_m``, ``missed_m``, ``false_m``, whose squares add up to its square.
    """

    values: dict[str, Any]
    completeness: FloatArray
    gospa_m: FloatArray
    localisation_m: FloatArray
    missed_m: FloatArray
    false_m: FloatArray
    ospa_m: FloatArray
    nees: Consistency
    nis: Consistency


def combine_quality(runs: Sequence[Quality]) -> QualityResult:
    """Combine the measures of several runs of one scenario with one method, at least one."""
    continuity = [run.continuity for run in runs]
    values = {
        "completeness": np.array([run.completeness for run in continuity]),
        "identity_switches": np.array([run.identity_switches for run in continuity]),
        "identity_flips": np.array([run.identity_flips for run in continuity]),
        "false_tracks": np.array([run.false_tracks or 0 for run in continuity]),
        "confirmed_tracks": np.array([run.confirmed_tracks for run in continuity]),
        "position_rmse_m": np.array([run.position_rmse_m for run in continuity]),
        "position_delayed_rmse_m": np.array([run.delayed_rmse_m for run in runs]),
        "position_smoothed_rmse_m": np.array([run.smoothed_rmse_m for run in runs]),
        "targets_not_extracted": np.array([run.targets_not_extracted for run in continuity]),
        "false_tracks_per_hour": np.array([run.false_tracks_per_hour for run in continuity]),
    }
    extents = np.array([run.extent_error_m for run in runs])
    if np.isfinite(extents).any():
        values["extent_error_m"] = extents[np.isfinite(extents)]
    # Not every run has them: means are over all targets, and over all false tracks.
    values["extraction_delay_s"] = np.concatenate([run.extraction_delay_s for run in continuity])
    values["extraction_delay_scans"] = np.concatenate(
        [run.extraction_delay_scans for run in continuity]
    )
    values["false_track_life_s"] = np.concatenate([run.false_track_life_s for run in continuity])
    found: dict[str, Any] = {}
    for name, value in values.items():
        found[name], found[f"{name}_stderr"] = mean_and_stderr(value.astype(np.float64))

    formations = [run.formations for run in runs if run.formations is not None]
    if formations:
        found.update(formation_values(formations))
    distances = [run.distances for run in runs]
    squares = {
        "gospa_m": np.stack([run.gospa_m**2 for run in distances]),
        "gospa_localisation_m": np.stack([run.localisation for run in distances]),
        "gospa_missed_m": np.stack([run.missed for run in distances]),
        "gospa_false_m": np.stack([run.false for run in distances]),
        "ospa_m": np.stack([run.ospa_m**2 for run in distances]),
    }
    for name, value in squares.items():
        found[name], found[f"{name}_stderr"] = root_mean_square(value.mean(axis=1))
    per_scan = {name: np.sqrt(value.mean(axis=0)) for name, value in squares.items()}
    n_scans = len(distances[0].gospa_m)
    nees = combine_consistency([run.nees for run in runs], n_scans)
    nis = combine_consistency([run.nis for run in runs], n_scans)
    for name, result in (("nees", nees), ("nis", nis)):
        found[name], found[f"{name}_stderr"] = result.mean, result.stderr
        found[f"{name}_expected"] = result.expected
        found[f"{name}_lower"] = result.typical_lower
        found[f"{name}_upper"] = result.typical_upper
        found[f"{name}_inside"] = result.inside
        found[f"{name}_dimension"] = result.dimension
    return QualityResult(
        found,
        values["completeness"],
        per_scan["gospa_m"],
        per_scan["gospa_localisation_m"],
        per_scan["gospa_missed_m"],
        per_scan["gospa_false_m"],
        per_scan["ospa_m"],
        nees,
        nis,
    )
