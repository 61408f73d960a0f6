"""Signal strengths in a scenario: what is strong enough is detected (Koch 2014, (2.42)-(2.48)).

A target of mean strength x gives signals z, exponential with mean 1 + x (Swerling I, noise power
1), anew on every scan; it is detected where z exceeds -ln P_F. False alarms are noise above it. The
RCS that is measured is (z - 1) over the strength of 1 m2: noisy, and never small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gda_tracker.kinematics.signal_strength import threshold
from gda_tracker.simulation.schema import ScenarioError
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

ATTRIBUTE = "snr"
# Models whose RCS is exponential, anew on each scan.
EXPONENTIAL = (1, 2)


def check_strengths(sensor: Any, targets: Sequence[Any], where: str) -> None:
    """Refuse targets whose RCS is not exponential, if the sensor has strengths.

    Raises
    ------
    ScenarioError
        Naming the key, its value and what is allowed.
    """
    if not isinstance(sensor, Mapping) or not sensor.get("false_alarm_probability"):
        return
    for target in targets:
        if target.rcs_swerling not in EXPONENTIAL:
            raise ScenarioError(
                f"{where}: targets: rcs_swerling = {target.rcs_swerling}: allowed are "
                f"{' and '.join(map(str, EXPONENTIAL))} with sensor.false_alarm_probability > 0"
            )


def draw_signals(
    rng: np.random.Generator,
    mean_strength: FloatArray,
    n_scans: int,
    always: int,
    false_alarm_probability: float,
) -> tuple[FloatArray, BoolArray]:
    """Signals of T targets on each scan, and which are detected, (n_scans, T).

    On the first ``always`` scans all are: they are drawn among those above the threshold.
    """
    lambda_ = threshold(false_alarm_probability)
    signal = rng.exponential(1.0 + mean_strength, (n_scans, len(mean_strength)))
    # Exponential signals above a threshold exceed it by as much as they are without one.
    signal[:always] += lambda_
    return signal, signal > lambda_


def draw_false_signals(
    rng: np.random.Generator, count: int, false_alarm_probability: float
) -> FloatArray:
    """Strengths of false alarms (count,): noise above the threshold."""
    return threshold(false_alarm_probability) + rng.exponential(1.0, count)
