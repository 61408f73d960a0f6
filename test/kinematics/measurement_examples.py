"""Sites, states and measurements for tests of sensor models."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS, MeasurementModel
from gda_tracker.kinematics.measurement_models import Observed, Sites, measure
from gda_tracker.vocabulary.arrays import FloatArray

MODELS = tuple(MEASUREMENT_MODELS.values())
STANDARD_DEVIATION = {"range": 40.0, "azimuth": 0.01, "range_rate": 2.0}


def sites_of(model: MeasurementModel) -> Sites:
    """A moving sensor, and a moving reference where the model has one."""
    position = np.array([[1200.0, -700.0], [9000.0, 3000.0]])
    velocity = np.array([[60.0, 25.0], [-40.0, 80.0]])
    count = 1 + model.has_reference
    return Sites(position[:count], velocity[:count])


def noise_of(model: MeasurementModel) -> FloatArray:
    """Noise (m, m), with correlations where there are several quantities."""
    deviation = np.array([STANDARD_DEVIATION[quantity] for quantity in model.quantities])
    correlation = np.full((len(model), len(model)), 0.3) + 0.7 * np.eye(len(model))
    return correlation * deviation[:, None] * deviation


def observed_at(model: MeasurementModel, state: FloatArray) -> Observed:
    """What the sensor measures of states (N, 4), without error."""
    value = measure(model, sites_of(model), state)
    return Observed(model, sites_of(model), value, np.tile(noise_of(model), (len(state), 1, 1)))
