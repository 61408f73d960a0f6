import numpy as np
import pytest
from scipy import stats

from gda_tracker.attributes.class_models import (
    CLASS_MODELS,
    ClassModelError,
    numbers_per_class,
)

VALUES = np.array([-3.0, 0.0, 0.2, 1.0, 7.5, 40.0])


def test_gaussian_is_the_normal_density():
    numbers = np.array([[0.0, 1.0], [5.0, 0.1], [-20.0, 30.0]])
    np.testing.assert_allclose(
        CLASS_MODELS["gaussian"](numbers)(VALUES),
        stats.norm.logpdf(VALUES[:, None], numbers[:, 0], numbers[:, 1]),
        rtol=1e-13,
    )


def test_lognormal_is_the_lognormal_density():
    numbers = np.array([[1.0, 0.5], [15.0, 0.3], [40.0, 2.0]])
    found = CLASS_MODELS["lognormal"](numbers)(VALUES)
    np.testing.assert_allclose(
        found[2:],
        stats.lognorm.logpdf(VALUES[2:, None], numbers[:, 1], scale=numbers[:, 0]),
        rtol=1e-12,
    )
    # No length is zero or negative: out of range.
    assert np.isnan(found[:2]).all()


def test_trapezoid_by_hand():
    model = CLASS_MODELS["trapezoid"](
        np.array([[0.0, 10.0, 20.0, 40.0], [5.0, 5.0, 5.0, 5.0], [0.0, 0.0, 8.0, 8.0]])
    )
    values = np.array([-1.0, 0.0, 2.5, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0, 40.0, 41.0])
    np.testing.assert_allclose(
        np.exp(model(values)),
        np.transpose(
            [
                [0.0, 0.0, 0.25, 0.5, 0.8, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            ]
        ),
        atol=1e-15,
    )


def test_confusion_matrix_reads_the_column_of_the_call():
    chances = np.array([[0.7, 0.2, 0.1], [0.0, 1.0, 0.0], [0.25, 0.25, 0.5]])
    model = CLASS_MODELS["confusion_matrix"](chances)
    np.testing.assert_allclose(
        np.exp(model(np.array([2.0, 0.0, 1.0, 1.0]))), chances.T[[2, 0, 1, 1]]
    )
    assert np.isnan(model(np.array([-1.0, 3.0, 0.5, 1e300]))).all()


@pytest.mark.parametrize("kind", CLASS_MODELS)
def test_hard_values_give_no_warning_and_nan_stays_nan(kind):
    numbers = {
        "gaussian": [[0.0, 1e-3], [1.0, 1e6]],
        "lognormal": [[1.0, 1e-3], [1.0, 10.0]],
        "trapezoid": [[0.0, 1e-300, 1.0, 2.0], [-1e308, 0.0, 0.0, 1e308]],
        "confusion_matrix": [[1.0, 0.0], [0.0, 1.0]],
    }[kind]
    with np.errstate(all="raise", under="ignore"):
        found = CLASS_MODELS[kind](np.array(numbers))(
            np.array([np.nan, 1e308, -1e308, 5e-324, 0.0, -0.0])
        )
    assert found.shape == (6, 2)
    assert np.isnan(found[0]).all()
    assert not np.isposinf(found).any()


@pytest.mark.parametrize(
    ("kind", "numbers", "message"),
    [
        ("gaussian", [[1.0, 0.0]], "standard deviation > 0"),
        ("lognormal", [[0.0, 1.0]], "median > 0"),
        ("lognormal", [[1.0, 0.0]], "standard deviation > 0 of the logarithm"),
        ("trapezoid", [[0.0, 2.0, 1.0, 3.0]], "a <= b <= c <= d"),
        ("confusion_matrix", [[0.5, 0.4], [0.5, 0.5]], "with the sum 1"),
        ("confusion_matrix", [[1.5, -0.5], [0.5, 0.5]], r"chances in \[0, 1\]"),
    ],
)
def test_wrong_numbers_are_refused(kind, numbers, message):
    with pytest.raises(ClassModelError, match=message):
        CLASS_MODELS[kind](np.array(numbers))


@pytest.mark.parametrize("kind", CLASS_MODELS)
def test_numbers_per_class(kind):
    n = numbers_per_class(kind, 3)
    numbers = np.full((3, n), 1.0 / n if kind == "confusion_matrix" else 1.0)
    assert CLASS_MODELS[kind](numbers)(np.ones(5)).shape == (5, 3)
