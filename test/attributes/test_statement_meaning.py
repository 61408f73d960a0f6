"""Meaning of statements: covering functions against their definitions and against sampling."""

import numpy as np
import pytest
from statement_examples import (
    ABOUT_TRACK,
    BOX,
    CLASSES,
    GAUSSIAN,
    SECTOR,
    mu,
    piece,
    rule,
    said,
)

from gda_tracker.attributes.statement_meaning import place_meaning, track_meaning
from gda_tracker.attributes.statement_states import LEAST_VARIANCE, Rows, hear

FACTOR = np.array([[40.0, 0.0, 0.0, 0.0], [10.0, 30.0, 0.0, 0.0], [2.0, 1.0, 3.0, 0.0], [0.5] * 4])
MEAN, COVARIANCE = np.array([60.0, 20.0, 3.0, 4.0]), FACTOR @ FACTOR.T


def sharp(points):
    """Points as Gaussian places whose noise is too small to matter."""
    return np.asarray(points), np.repeat(1e-12 * np.eye(2)[None], len(points), axis=0)


@pytest.mark.parametrize("name", ABOUT_TRACK)
def test_at_a_point_the_meaning_is_the_definition(name):
    statement = ABOUT_TRACK[name]
    points = np.random.default_rng(3).uniform(-150.0, 250.0, (200, 2))
    found = track_meaning(statement, CLASSES).expectation(*sharp(points))
    for column, class_name in enumerate(CLASSES):
        np.testing.assert_allclose(
            found[:, column], mu(statement, points, class_name), rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("name", ABOUT_TRACK)
def test_likelihood_and_moments_of_a_heard_track(name):
    """Against weighted samples: the likelihood, the state's mean and covariance, the classes."""
    statement, weight = ABOUT_TRACK[name], np.array([[0.05, 0.55, 0.4]])
    rows = Rows(MEAN[None], COVARIANCE[None], weight)
    after, value = hear(track_meaning(statement, CLASSES), rows, np.array([True]))
    count = 100_000
    half = np.random.default_rng(5).standard_normal((count // 2, 4))
    states = MEAN + np.concatenate([half, -half]) @ FACTOR.T
    by_class = np.stack([mu(statement, states[:, :2], c) for c in CLASSES], axis=1)
    error = 5.0 * by_class.std(axis=0) / np.sqrt(count) + 1e-9
    assert (np.abs(value[0] - by_class.mean(axis=0)) <= error).all()
    share = by_class @ weight[0]
    share /= share.sum()
    mean = share @ states
    deviation = states - mean
    covariance = (deviation * share[:, None]).T @ deviation
    scale = np.sqrt(np.diag(COVARIANCE))
    effective = 1.0 / (share**2).sum()
    np.testing.assert_allclose((after.mean[0] - mean) / scale, 0.0, atol=6.0 / np.sqrt(effective))
    np.testing.assert_allclose(
        (after.covariance[0] - covariance) / np.outer(scale, scale),
        0.0,
        atol=8.0 / np.sqrt(effective),
    )
    classes = after.class_weight[0] / after.class_weight[0].sum()
    expected = weight[0] * by_class.mean(axis=0)
    np.testing.assert_allclose(classes, expected / expected.sum(), atol=6.0 / np.sqrt(count))


def test_a_gaussian_region_is_a_kalman_update():
    meaning = track_meaning(ABOUT_TRACK["gaussian"], ())
    rows = Rows(MEAN[None], COVARIANCE[None], np.ones((1, 1)))
    after, _ = hear(meaning, rows, np.array([True]))
    h, noise = np.eye(2, 4), np.reshape(GAUSSIAN.covariance_m2, (2, 2))
    s = h @ COVARIANCE @ h.T + noise
    gain = COVARIANCE @ h.T @ np.linalg.inv(s)
    # The doubt of one in a million remains: to a few of them it is the same.
    np.testing.assert_allclose(
        after.mean[0], MEAN + gain @ (np.array(GAUSSIAN.centre_m) - h @ MEAN), rtol=1e-3
    )
    np.testing.assert_allclose(
        after.covariance[0], COVARIANCE - gain @ s @ gain.T, rtol=1e-3, atol=0.01
    )


def test_a_tiny_region_far_away_leaves_a_sound_state():
    for reliability in (0.0, 0.5, 1.0):
        region = GAUSSIAN.__class__(
            "gaussian", centre_m=(9000.0, 50.0), covariance_m2=(1e-6, 0.0, 0.0, 1e-6)
        )
        meaning = track_meaning(
            said("fuzzy", "track", piece(region), reliability=reliability), CLASSES
        )
        rows = Rows(MEAN[None], COVARIANCE[None], np.array([[0.0, 1.0, 0.0]]))
        after, value = hear(meaning, rows, np.array([True]))
        assert np.isfinite(after.mean).all()
        assert (value > 0.0).all()
        assert np.linalg.eigvalsh(after.covariance[0]).min() > 0.0
        # So far off, the doubt wins: the statement is not true of this track.
        np.testing.assert_allclose(after.mean[0], MEAN, rtol=1e-9)
    near = GAUSSIAN.__class__(
        "gaussian", centre_m=(60.0, 20.0), covariance_m2=(1e-6, 0.0, 0.0, 1e-6)
    )
    meaning = track_meaning(said("fuzzy", "track", piece(near)), CLASSES)
    after, _ = hear(meaning, Rows(MEAN[None], COVARIANCE[None], np.ones((1, 3))), np.array([True]))
    factor = np.linalg.inv(np.linalg.cholesky(COVARIANCE[:2, :2]))
    whitened = factor @ after.covariance[0, :2, :2] @ factor.T
    assert np.linalg.eigvalsh(whitened).min() >= 0.99 * LEAST_VARIANCE


def test_rows_of_other_tracks_are_not_touched():
    rows = Rows(np.tile(MEAN, (3, 1)), np.tile(COVARIANCE, (3, 1, 1)), np.full((3, 3), 1 / 3))
    after, value = hear(
        track_meaning(ABOUT_TRACK["fds"], CLASSES), rows, np.array([False, True, False])
    )
    for name in ("mean", "covariance", "class_weight"):
        same = [np.array_equal(getattr(after, name)[i], getattr(rows, name)[i]) for i in range(3)]
        assert same == [True, False, True]
    assert (value[[0, 2]] == 1.0).all()


@pytest.mark.parametrize("name", ["class", "rule", "place and class"])
def test_without_classes_only_the_place_counts(name):
    statement = ABOUT_TRACK[name]
    for names in ((), ("false_alarm", "zeppelin")):  # no classes, or others than it names
        meaning = track_meaning(statement, names)
        assert not meaning.speaks_of_class
        assert bool(meaning.regions) is (name == "place and class")


def test_a_place_is_heard_as_far_as_a_detection_is_there():
    statement = said("fuzzy", "place", piece(BOX, fighter=0.9, cargo=0.2), reliability=0.5)
    points = [[40.0, 100.0], [500.0, 100.0], [80.0, 250.0]]
    position, covariance = np.array(points), np.tile(np.eye(2), (3, 1, 1))
    found = place_meaning(statement, CLASSES).expectation(position, covariance)
    for membership, row in zip((1.0, 0.0, 0.5), found, strict=True):
        expected = [1.0 + 0.5 * membership * (h - 1.0) for h in (0.0, 0.9, 0.2)]
        np.testing.assert_allclose(row, expected, atol=1e-9)


def test_rules_about_a_place():
    """If in the box, a fighter; and: fighters are in the sector, so none is elsewhere."""
    points, covariance = np.array([[40.0, 100.0], [500.0, 100.0]]), np.tile(np.eye(2), (2, 1, 1))
    inside, outside = place_meaning(rule("place", BOX, fighter=1.0), CLASSES).expectation(
        points, covariance
    )
    np.testing.assert_allclose(inside, [0.0, 2.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(outside, [1.0, 1.0, 1.0], atol=1e-12)
    reverse = rule("place", SECTOR, "classes_imply_region", fighter=1.0)
    seen = np.array([[30.0, -35.0], [500.0, 100.0]])
    inside, outside = place_meaning(reverse, CLASSES).expectation(seen, covariance * 1e-6)
    np.testing.assert_allclose(inside, [0.5, 1.0, 0.5], atol=1e-5)
    np.testing.assert_allclose(outside, [0.5, 0.0, 0.5], atol=1e-5)
