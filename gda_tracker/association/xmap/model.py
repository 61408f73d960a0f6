"""What is known of sensors, objects and features before the data speak.

Axes: r sensors, T object types, M measurements of all sensors together (the first sensor's first),
d dimensions of a position.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

GAUSSIAN = "gaussian"
VON_MISES = "von_mises"

POISSON = "poisson"
DIFFUSE = "diffuse"
LOG_DIFFUSE = "log_diffuse"
COUNT_PRIORS = (POISSON, DIFFUSE, LOG_DIFFUSE)


@dataclass(frozen=True)
class CountPrior:
    """Prior on the number of objects (Ferry 2010, B.1).

    Attributes
    ----------
    kind
        ``poisson`` (B.1); ``diffuse``, every number alike; ``log_diffuse``, proportional to 1/n.
    mean
        Expected number of objects, > 0; of ``poisson`` alone.
    """

    kind: str
    mean: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in COUNT_PRIORS:
            raise ValueError(f"kind = {self.kind!r}: allowed are {', '.join(COUNT_PRIORS)}")
        if (self.mean is not None) != (self.kind == POISSON):
            raise ValueError(
                f"mean = {self.mean}: allowed is a number > 0 for {POISSON}, none otherwise"
            )
        if self.mean is not None and not 0.0 < self.mean < np.inf:
            raise ValueError(f"mean = {self.mean}: allowed is a number > 0")


@dataclass(frozen=True)
class ObjectTypes:
    """Object types: how frequent, how well seen, what they are called (Ferry 2010, 5.1).

    Attributes
    ----------
    prior : (T,)
        p0(t), sums to one.
    detection : (r, T)
        P_D^s(t).
    confusion : r arrays (T, calls of the sensor)
        L^s(c | t), each row sums to one; one column of ones for a sensor that calls no types.
    """

    prior: FloatArray
    detection: FloatArray
    confusion: tuple[FloatArray, ...]


@dataclass(frozen=True)
class FeatureModel:
    """A feature that may be noise, missing or, as an angle, off by pi (Ferry 2010, 5.2, 5.3, 6.1).

    Attributes
    ----------
    kind
        ``gaussian``: a number with prior N(``prior_mean``, ``prior_std``^2) per type;
        ``von_mises``: an angle [rad], uniform a priori.
    exists : (T,)
        P_E, the chance that an object of the type has the feature.
    obeys_model : (r, T)
        a_mu; otherwise the value is noise that is distributed like all values.
    declared_if_present, declared_if_absent : (r, T)
        P_d and P_fa: the chance of a value for an object that has the feature, or has not.
    missing_if_present, missing_if_absent : (r, T)
        Their complements Q_d and Q_fa; ones for a sensor whose missing values say nothing.
    std : (r, T)
        Of the error of a value; for ``von_mises`` the concentration is its inverse square.
    jump_probability : (r, T)
        ``von_mises``: the chance that the value is off by pi.
    prior_mean, prior_std : (T,)
        ``gaussian``.
    """

    kind: str
    exists: FloatArray
    obeys_model: FloatArray
    declared_if_present: FloatArray
    declared_if_absent: FloatArray
    missing_if_present: FloatArray
    missing_if_absent: FloatArray
    std: FloatArray
    jump_probability: FloatArray
    prior_mean: FloatArray
    prior_std: FloatArray


@dataclass(frozen=True)
class SensorModel:
    """All that is known before the data.

    Attributes
    ----------
    sizes
        Number of measurements of each sensor, n^s.
    prior_covariance : (d, d)
        V_0, of the objects about their unknown centre.
    bias_covariances : r entries
        B^s (d, d); zeros: no bias; ``None``: diffuse.
    types
        One type if there are none.
    count_prior
        On the number of objects.
    expected_false_alarms : (r,)
        nu_FA^s, Poisson.
    feature
        ``None``: none.
    """

    sizes: tuple[int, ...]
    prior_covariance: FloatArray
    bias_covariances: tuple[FloatArray | None, ...]
    types: ObjectTypes
    count_prior: CountPrior
    expected_false_alarms: FloatArray
    feature: FeatureModel | None = None

    @property
    def sensor_of(self) -> IntArray:
        """(M,) sensor of each measurement."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @property
    def first(self) -> IntArray:
        """(r,) place of each sensor's first measurement among all M."""
        return np.cumsum([0, *self.sizes[:-1]])

    @property
    def undetected(self) -> float:
        """Chance q that an object is seen by no sensor (Ferry 2010, 5.10)."""
        return float(self.types.prior @ (1.0 - self.types.detection).prod(axis=0))

    @property
    def seen_by_one(self) -> FloatArray:
        """(r,) chance p^s that an object is seen by the sensor and no other (Ferry 2010, A.3)."""
        hidden = 1.0 - self.types.detection
        alone = [
            self.types.detection[s] * np.delete(hidden, s, axis=0).prod(axis=0)
            for s in range(len(self.sizes))
        ]
        return np.stack(alone) @ self.types.prior


@dataclass(frozen=True)
class SensorData:
    """The measurements, of one scene or of B scenes with the same sizes.

    Attributes
    ----------
    positions : (M, d) or (M, B, d)
        y.
    covariances : (M, d, d) or (M, B, d, d)
        V, positive definite.
    calls : (M,) or (M, B)
        Column of the sensor's confusion matrix.
    features : (M,) or (M, B)
        NaN: missing.
    """

    positions: FloatArray
    covariances: FloatArray
    calls: IntArray
    features: FloatArray = field(default_factory=lambda: np.zeros(0))

    def batched(self) -> SensorData:
        """The same with an axis for scenes."""
        if self.positions.ndim == 3:
            return self
        features = self.features if self.features.size else np.full(len(self.positions), np.nan)
        return SensorData(
            self.positions[:, None],
            self.covariances[:, None],
            self.calls[:, None],
            features[:, None],
        )
