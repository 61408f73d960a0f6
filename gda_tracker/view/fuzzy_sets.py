"""The fuzzy sets of the radar cross section, to be shaded behind the measured ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters
from gda_tracker.parameters import from_mapping
from gda_tracker.view.encoding import numbers

LEVELS = 121
# Shown: from this far below the smallest mean to this far above the largest.
BELOW_DB, ABOVE_DB = 18.0, 10.0


def fuzzy_sets_json(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Grades of membership of each class over radar cross sections in dBsm.

    ``grade`` (C, levels) is normalised per level, as the fuzzifier turns grades into masses: how
    much of a radar cross section's mass goes to each class.
    """
    table = from_mapping(RcsFuzzifierParameters, parameters)
    fuzzifier = RcsFuzzifier(table)
    means_db = 10.0 * np.log10(table.class_rcs_mean_m2)
    level_db = np.linspace(means_db.min() - BELOW_DB, means_db.max() + ABOVE_DB, LEVELS)
    grades = fuzzifier.membership(10.0 ** (level_db / 10.0))
    return {
        "class_names": list(fuzzifier.class_names),
        "labels": list(fuzzifier.frame),
        "level_dbsm": numbers(level_db, 3),
        "grade": numbers((grades / grades.sum(axis=1, keepdims=True)).T, 4),
    }
