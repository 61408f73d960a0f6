"""Numbers of objects and false alarms: closed forms against the sums they stand for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from xmap_references import literal_a8, literal_gamma0, random_scene

from gda_tracker.association.xmap.model import CountPrior
from gda_tracker.association.xmap.object_count import (
    cluster_counts,
    log_count_factor,
    log_gamma0,
)
from gda_tracker.association.xmap.partitions import enumerate_associations

PRIORS = [CountPrior("poisson", 3.5), CountPrior("diffuse"), CountPrior("log_diffuse")]


def differences(values):
    return np.asarray(values) - values[0]


@pytest.mark.parametrize("prior", PRIORS, ids=lambda p: p.kind)
def test_gamma0_is_the_sum_over_the_number_of_objects(prior):
    found = log_gamma0(prior, 0.3, 6)
    literal = [math.log(literal_gamma0(prior, 0.3, n)) for n in range(7)]
    np.testing.assert_allclose(differences(found), differences(literal), atol=1e-11)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda p: p.kind)
def test_false_alarms_are_the_literal_sum_a_8(prior):
    rng = np.random.default_rng(2)
    sizes = (3, 2, 2)
    model, _ = random_scene(rng, sizes, [None] * 3, prior=prior, false_alarms=[0.7, 0.0, 2.5])
    shared, single = cluster_counts(enumerate_associations(sizes), sizes)
    states = np.unique(np.column_stack([shared, single]), axis=0)
    found = log_count_factor(model, states[:, 0], states[:, 1:])
    literal = [math.log(literal_a8(model, row[0], row[1:])) for row in states.tolist()]
    np.testing.assert_allclose(differences(found), differences(literal), atol=1e-10)


def test_poisson_factors_as_b_17():
    rng = np.random.default_rng(3)
    rates = np.array([0.4, 1.3])
    prior = CountPrior("poisson", 2.2)
    model, _ = random_scene(rng, (3, 3), [None] * 2, prior=prior, false_alarms=rates)
    shared, single = cluster_counts(enumerate_associations((3, 3)), (3, 3))
    closed = shared * math.log(2.2) + single @ np.log(2.2 + rates / model.seen_by_one)
    found = log_count_factor(model, shared, single)
    np.testing.assert_allclose(differences(found), differences(closed), atol=1e-12)


def test_log_diffuse_of_the_paper():
    """g([a]) = (2!/7!) .998055^5 of section 6.1."""
    gamma0 = log_gamma0(CountPrior("log_diffuse"), 0.001945, 8)
    assert math.exp(gamma0[3] - gamma0[8]) == pytest.approx(0.000392981, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "mean"), [("poisson", None), ("poisson", 0.0), ("diffuse", 1.0), ("flat", None)]
)
def test_priors_that_are_not_allowed(kind, mean):
    with pytest.raises(ValueError, match="allowed"):
        CountPrior(kind, mean)
