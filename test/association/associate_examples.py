"""Random input of the association stage."""

from __future__ import annotations

import numpy as np
from hypothesis import settings

from gda_tracker.association.associate import AssociationParameters, Associator

examples = settings(derandomize=True, deadline=None, max_examples=50)
associate = Associator(AssociationParameters())
TERMS = ("none", "dsm_classic", "bayes")
FAR = -np.inf


def random_stage(make_stage_input, seed, **settings):
    rng = np.random.default_rng(seed)
    h, n = rng.integers(1, 6, 2)
    log_g = np.where(rng.random((h, n)) < 0.6, rng.normal(-9.0, 1.5, (h, n)), FAR)
    settings.setdefault("distance", rng.uniform(0.05, 1.2, (h, n)))
    if settings.get("attribute_term", "none") != "none":
        settings.setdefault("attribute_log_likelihood", rng.normal(size=(h, n)))
        settings.setdefault("clutter_log_likelihood", rng.normal(size=n))
    return log_g, make_stage_input(log_g, **settings)


def assert_consistent(found, h, n):
    """What holds for every answer of the stage."""
    p = len(found.hypothesis)
    for name in ("p_kinematic", "p_attribute", "p_generalised", "joint_marginal"):
        values = getattr(found, name)
        assert values.shape == (p,)
        assert ((values >= 0.0) & (values <= 1.0 + 1e-12)).all()
    np.testing.assert_array_equal(found.p_generalised, found.p_kinematic * found.p_attribute)
    assert found.assigned_detection.shape == (h,)
    assigned = found.assigned_detection
    used = assigned[assigned >= 0]
    assert len(set(used.tolist())) == len(used)
    assert used.max(initial=-1) < n
    np.testing.assert_array_equal(found.chosen, assigned[found.hypothesis] == found.detection)
    assert found.chosen.sum() == len(used)
    assert len(found.cluster_engine) == found.cluster.max(initial=-1) + 1
    assert (found.cluster_engine < len(found.engine_names)).all()
