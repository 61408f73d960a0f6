"""Random models and sources for the tests of the rules of combination."""

import numpy as np

from gda_tracker.evidence.frames import (
    constrained_model,
    free_model,
    hyper_power_set,
    parse_element,
    shafer_model,
)

NAMES = ("A", "B", "C", "D")


def masks(names, source):
    return {parse_element(names, element): mass for element, mass in source.items()}


def random_model(size, random):
    """Free, Shafer's or a hybrid model of up to four constraints."""
    names, kind = NAMES[:size], random.integers(0, 4 if size > 1 else 2)
    if kind == 0:
        return free_model(names)
    if kind == 1:
        return shafer_model(names)
    while True:
        empty = random.choice(hyper_power_set(size), random.integers(1, 5))
        try:
            return constrained_model(names, empty.tolist())
        except ValueError:  # nothing left
            continue


def random_source(size, random, elements=None):
    if elements is None:
        elements = hyper_power_set(size)
    focal = random.permutation(elements)[: random.integers(1, 6)]
    masses = random.dirichlet(np.ones(len(focal)))
    return dict(zip(focal.tolist(), masses.tolist(), strict=True))


def survivors(model):
    elements = hyper_power_set(model.size)
    return elements[(elements & np.uint32(model.alive)) != 0]


def problem(seed, size, sources=None, alive=False):
    random = np.random.default_rng(seed)
    model = random_model(size, random)
    elements = survivors(model) if alive else None
    count = random.integers(1, 4) if sources is None else sources
    return model, [random_source(size, random, elements) for _ in range(count)]
