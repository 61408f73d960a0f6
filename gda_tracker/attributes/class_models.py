"""What the values of one attribute look like for each class: its likelihoods f(value | class).

Four families, by name in ``CLASS_MODELS``; the numbers of each are given class after class:

``gaussian``
    mean, standard deviation.
``lognormal``
    median, standard deviation of the natural logarithm; a value <= 0 is out of range.
``trapezoid``
    a <= b <= c <= d: the grade of membership rises from 0 at a to 1 at b, is 1 up to c and falls
    to 0 at d. The grade is the likelihood of a class that is known imprecisely, the probability
    that the value lies in the class's random interval (Mahler 2011, section 5: a fuzzy g gives
    g(eta(x))).
``confusion_matrix``
    chance of each call, one per class: the value is the index of the class that a classifier has
    called, from 0. A value that is no such index is out of range.

A model is called with values (n,) and gives log likelihoods (n, K) over its K classes, -inf where a
class cannot give the value, NaN in all columns where the value is out of range.

>>> model = CLASS_MODELS["confusion_matrix"](np.array([[0.9, 0.1], [0.2, 0.8]]))
>>> np.exp(model(np.array([1.0]))).round(12).tolist()
[[0.1, 0.8]]
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

ClassModel = Callable[[FloatArray], FloatArray]

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)
# How far the sum of a row of a confusion matrix may be from one.
_SUM_TOLERANCE = 1e-6


class ClassModelError(ValueError):
    """The numbers of a class model are not allowed; the message says what is."""


class GaussianModel:
    """Normal densities [1/unit of the value].

    Parameters
    ----------
    numbers
        (K, 2) mean and standard deviation > 0 of each class.
    """

    def __init__(self, numbers: FloatArray) -> None:
        self.mean, self.deviation = numbers.T
        if not (self.deviation > 0.0).all():
            raise ClassModelError("a mean and a standard deviation > 0 per class")

    def __call__(self, values: FloatArray) -> FloatArray:
        """Log densities (n, K)."""
        with np.errstate(over="ignore"):  # so far out that no class gives it
            scaled = (values[:, None] - self.mean) / self.deviation
            return np.asarray(-0.5 * scaled * scaled - np.log(self.deviation) - _LOG_ROOT_TWO_PI)


class LognormalModel:
    """Lognormal densities [1/unit of the value].

    Parameters
    ----------
    numbers
        (K, 2) median > 0 and standard deviation > 0 of the natural logarithm of each class.
    """

    def __init__(self, numbers: FloatArray) -> None:
        if not (numbers > 0.0).all():
            raise ClassModelError(
                "a median > 0 and a standard deviation > 0 of the logarithm per class"
            )
        self._normal = GaussianModel(
            np.stack([np.log(numbers[:, 0]), numbers[:, 1]], axis=1),
        )

    def __call__(self, values: FloatArray) -> FloatArray:
        """Log densities (n, K)."""
        logarithm = np.full(len(values), np.nan)
        np.log(values, out=logarithm, where=values > 0.0)
        return self._normal(logarithm) - logarithm[:, None]


class TrapezoidModel:
    """Trapezoidal grades of membership in [0, 1].

    Parameters
    ----------
    numbers
        (K, 4) corners a <= b <= c <= d of each class.
    """

    def __init__(self, numbers: FloatArray) -> None:
        self.a, self.b, self.c, self.d = numbers.T
        if not (np.diff(numbers, axis=1) >= 0.0).all():
            raise ClassModelError("four corners a <= b <= c <= d per class")
        # Steep sides have a width of 0 and are never divided by.
        self._rise = np.where(self.b > self.a, self.b - self.a, 1.0)
        self._fall = np.where(self.d > self.c, self.d - self.c, 1.0)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Log grades (n, K)."""
        value = values[:, None]
        with np.errstate(over="ignore"):
            rising = np.clip((value - self.a) / self._rise, 0.0, 1.0)
            falling = np.clip((self.d - value) / self._fall, 0.0, 1.0)
        grade = np.where(value < self.b, rising, np.where(value > self.c, falling, 1.0))
        with np.errstate(divide="ignore"):
            return np.log(np.where(np.isnan(value), np.nan, grade))


class ConfusionMatrixModel:
    """Chances of the calls of a classifier.

    Parameters
    ----------
    numbers
        (K, C) P(call | class), rows of the classes, each with the sum one; columns of the calls.
    """

    def __init__(self, numbers: FloatArray) -> None:
        inside = ((numbers >= 0.0) & (numbers <= 1.0)).all()
        if not (inside and (np.abs(numbers.sum(axis=1) - 1.0) <= _SUM_TOLERANCE).all()):
            raise ClassModelError("chances in [0, 1] of all calls per class, with the sum 1")
        with np.errstate(divide="ignore"):
            # A last row for values that are no call.
            self._log_chances = np.vstack([np.log(numbers.T), np.full(len(numbers), np.nan)])

    def __call__(self, values: FloatArray) -> FloatArray:
        """Log chances (n, K)."""
        n_calls = len(self._log_chances) - 1
        # NaN fails every comparison.
        is_call = (values >= 0.0) & (values < n_calls) & (np.floor(values) == values)
        call = np.where(is_call, values, n_calls).astype(np.intp)
        return np.asarray(self._log_chances[call])


CLASS_MODELS: dict[str, Callable[[FloatArray], ClassModel]] = {
    "gaussian": GaussianModel,
    "lognormal": LognormalModel,
    "trapezoid": TrapezoidModel,
    "confusion_matrix": ConfusionMatrixModel,
}


def numbers_per_class(kind: str, n_classes: int) -> int:
    """How many numbers a model takes for each class it knows; ``n_classes`` is that of the frame.

    >>> numbers_per_class("gaussian", 4), numbers_per_class("confusion_matrix", 4)
    (2, 4)
    """
    return {"gaussian": 2, "lognormal": 2, "trapezoid": 4, "confusion_matrix": n_classes}[kind]
