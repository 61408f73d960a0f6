"""Histories, pairs and the stage, for the tests of attribute fusion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from attribute_examples import predictions_of

from gda_tracker.attributes.fusion import AttributeFusion, AttributeFusionParameters
from gda_tracker.evidence.frames import parse_element
from gda_tracker.parameters import from_mapping

FRAME, CLASSES = ("VS", "S", "B"), ("false_alarm", "fighter", "cargo")
EIGHT = ["VS", "S", "B", "VS&S", "VS&B", "S&B", "VS&S&B", "VS|S|B"]


def stage(**changes):
    return AttributeFusion(from_mapping(AttributeFusionParameters, changes))


def forgetful(predictions, factor):
    """The predictions, with a forgetting factor."""
    settings = replace(predictions.settings, history_policy="forgetting", forgetting_factor=factor)
    return replace(predictions, settings=settings)


def columns(texts, frame=FRAME):
    return np.array([parse_element(frame, text) for text in texts], dtype=np.uint32)


def histories(term, h=4, texts=EIGHT, seed=1):
    """Predictions with histories that have seen several scans."""
    random = np.random.default_rng(seed)
    return predictions_of(
        term,
        h,
        frame=FRAME,
        focal=columns(texts),
        masses=random.dirichlet(np.ones(len(texts)), h),
        class_names=CLASSES,
        class_probability=np.hstack([np.zeros((h, 1)), random.dirichlet(np.ones(2), h)]),
    )


def all_pairs(h, n):
    return (
        np.repeat(np.arange(h, dtype=np.int32), n),
        np.tile(np.arange(n, dtype=np.int32), h),
    )
