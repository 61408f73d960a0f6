"""The posterior of the biases against a Gaussian regression per association."""

from __future__ import annotations

import numpy as np
import pytest
from xmap_references import random_covariance, random_scene

from gda_tracker.association.xmap.solution import solve


def regression(model, data, labels):
    """Mean and covariance of all biases given an association, by stacking all observations.

    Unknowns: objects, centre, biases. Diffuse ones have precision zero.
    """
    sensor, (total, d) = model.sensor_of, data.positions.shape
    r, objects = len(model.sizes), int(labels.max()) + 1
    size = (objects + 1 + r) * d
    precision, right = np.zeros((size, size)), np.zeros(size)

    def add(parts, inverse, value):
        row = np.zeros((d, size))
        for place, sign in parts:
            row[:, place * d : (place + 1) * d] = sign * np.eye(d)
        nonlocal precision, right
        precision = precision + row.T @ inverse @ row
        right = right + row.T @ inverse @ value

    for i in range(total):  # y = x - beta
        parts = [(labels[i], 1.0), (objects + 1 + sensor[i], -1.0)]
        add(parts, np.linalg.inv(data.covariances[i]), data.positions[i])
    for j in range(objects):
        add([(j, 1.0), (objects, -1.0)], np.linalg.inv(model.prior_covariance), np.zeros(d))
    for s, bias in enumerate(model.bias_covariances):
        if bias is not None:
            add([(objects + 1 + s, 1.0)], np.linalg.inv(bias), np.zeros(d))
    # A common shift is unknown where all are diffuse; differences are not.
    covariance = np.linalg.pinv(precision, hermitian=True)
    mean = covariance @ right
    return mean[(objects + 1) * d :].reshape(r, d), covariance[(objects + 1) * d :][
        :, (objects + 1) * d :
    ].reshape(r, d, r, d)


def mixture(model, data, solution, differences):
    """Moments of the biases, or of their differences to the reference."""
    first = second = 0.0
    for labels, p in zip(solution.labels, solution.probability, strict=True):
        mean, covariance = regression(model, data, labels)
        blocks = np.stack([covariance[s, :, s] for s in range(len(mean))])
        if differences:
            ref = solution.bias.reference
            blocks = blocks + covariance[ref, :, ref]
            for s in range(len(mean)):
                blocks[s] -= covariance[s, :, ref] + covariance[ref, :, s]
            mean = mean - mean[ref]
        first = first + p * mean
        second = second + p * (blocks + np.einsum("si,sj->sij", mean, mean))
    return first, second - np.einsum("si,sj->sij", first, first)


@pytest.mark.parametrize("kind", ["finite", "one diffuse", "diffuse"])
def test_biases_as_by_regression(kind):
    rng = np.random.default_rng(len(kind))
    finite = [random_covariance(rng, 2, 2.0) for _ in range(3)]
    biases = {"finite": finite, "one diffuse": [finite[0], None, finite[2]], "diffuse": [None] * 3}
    model, data = random_scene(rng, (2, 2, 1), biases[kind])
    solution = solve(model, data)
    mean, covariance = mixture(model, data, solution, differences=True)
    np.testing.assert_allclose(solution.bias.relative_mean, mean, atol=1e-8)
    np.testing.assert_allclose(solution.bias.relative_covariance, covariance, atol=1e-7)
    if kind == "diffuse":
        assert solution.bias.mean is None
        return
    mean, covariance = mixture(model, data, solution, differences=False)
    np.testing.assert_allclose(solution.bias.mean, mean, atol=1e-8)
    np.testing.assert_allclose(solution.bias.covariance, covariance, atol=1e-7)


def test_a_known_bias_is_zero_and_the_others_are_to_it():
    rng = np.random.default_rng(9)
    model, data = random_scene(rng, (3, 3), [np.zeros((2, 2)), None])
    bias = solve(model, data).bias
    assert bias.reference == 0
    assert not bias.mean[0].any()
    assert not bias.covariance[0].any()
    np.testing.assert_array_equal(bias.mean, bias.relative_mean)


def test_order_of_the_sensors_does_not_matter():
    rng = np.random.default_rng(10)
    model, data = random_scene(rng, (2, 3), [np.eye(2), np.eye(2) * 9.0])
    turned = type(model)(
        **{
            **vars(model),
            "sizes": (3, 2),
            "bias_covariances": model.bias_covariances[::-1],
            "types": type(model.types)(
                model.types.prior, model.types.detection[::-1], model.types.confusion
            ),
        }
    )
    order = [2, 3, 4, 0, 1]
    moved = type(data)(data.positions[order], data.covariances[order], data.calls[order])
    first, second = solve(model, data), solve(turned, moved)
    np.testing.assert_allclose(first.probability, second.probability, atol=1e-12)
    np.testing.assert_allclose(first.pairs[np.ix_(order, order)], second.pairs, atol=1e-12)
    np.testing.assert_allclose(first.bias.mean, second.bias.mean[::-1], atol=1e-10)
