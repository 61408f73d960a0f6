"""Answers that do not fit: each is named, nothing has changed, and the right answer still acts."""

import copy
import dataclasses
import re

import numpy as np
import pytest
from tracking_examples import answers, assert_same, ring_of, simulated

from gda_tracker.tracking.answers import Inconsistent
from gda_tracker.vocabulary import ScanKey

SCANS = simulated(12, seed=2)


def other_key(answer):
    answer.key = ScanKey(answer.key.epoch + 1, *answer.key[1:])


def assign_twice(associations):
    taken = associations.assigned_detection
    hit = np.flatnonzero(taken >= 0)
    taken[hit[1]] = taken[hit[0]]


def set_first(name, value):
    def corrupt(answer):
        getattr(answer, name).flat[0] = value

    return corrupt


def cut(name):
    def corrupt(answer):
        setattr(answer, name, getattr(answer, name)[:-1])

    return corrupt


def choose_another(associations):
    chosen = np.flatnonzero(associations.chosen)
    associations.chosen[chosen[0]] = False


def forget_assignment(associations):
    hit = np.flatnonzero(associations.assigned_detection >= 0)
    associations.assigned_detection[hit[0]] = -1


def widen(name):
    def corrupt(answer):
        values = getattr(answer, name)
        setattr(answer, name, np.hstack([values, np.zeros((len(values), 1))]))

    return corrupt


def rename(name, value):
    return lambda answer: setattr(answer, name, value)


CASES = [
    ("evidence", other_key, "is not the open scan's"),
    ("scores", other_key, "is not the open scan's"),
    ("associations", other_key, "is not the open scan's"),
    ("associations", cut("assigned_detection"), "one assigned detection per hypothesis"),
    ("associations", set_first("assigned_detection", 10_000), "assigned detection out of range"),
    ("associations", set_first("assigned_detection", -2), "assigned detection out of range"),
    ("associations", assign_twice, "assigned twice"),
    ("associations", choose_another, "the chosen pairs are not the assigned"),
    ("associations", forget_assignment, "the chosen pairs are not the assigned"),
    ("associations", cut("chosen"), "differ in length"),
    ("associations", cut("hypothesis"), "differ in length"),
    ("associations", set_first("hypothesis", -1), "hypothesis out of range"),
    ("associations", set_first("hypothesis", 10_000), "hypothesis out of range"),
    ("associations", set_first("detection", 10_000), "detection out of range"),
    ("evidence", cut("masses"), "evidence: masses has shape"),
    ("evidence", widen("masses"), "evidence: masses has shape"),
    ("evidence", cut("class_probability"), "evidence: class_probability has shape"),
    ("evidence", set_first("masses", np.nan), "evidence: masses is not finite"),
    ("evidence", set_first("class_probability", np.inf), "class_probability is not finite"),
    ("evidence", cut("log_class_likelihood"), "evidence: log_class_likelihood and informative"),
    ("evidence", widen("log_class_likelihood"), "evidence: log_class_likelihood and informative"),
    ("evidence", cut("informative"), "evidence: log_class_likelihood and informative"),
    ("evidence", set_first("log_class_likelihood", np.nan), "is not a number below infinity"),
    ("evidence", set_first("log_class_likelihood", np.inf), "is not a number below infinity"),
    ("scores", cut("hypothesis"), "pair list differs"),
    ("scores", set_first("detection", 10_000), "pair list differs"),
    ("scores", cut("masses"), "attribute scores: masses has shape"),
    ("scores", cut("class_probability"), "attribute scores: class_probability has shape"),
    ("scores", cut("conflict"), "attribute scores: conflict has shape"),
    ("scores", set_first("masses", -np.inf), "attribute scores: masses is not finite"),
    ("scores", rename("frame", ("A", "B", "C")), "frame or classes differ"),
    ("scores", rename("class_names", ("a", "b", "c")), "frame or classes differ"),
]


@pytest.mark.parametrize(
    ("which", "corrupt", "message"), CASES, ids=[f"{c[0]}-{i}" for i, c in enumerate(CASES)]
)
def test_a_wrong_answer_is_named_and_changes_nothing(which, corrupt, message):
    ring, undisturbed = (ring_of(attribute_term="dsm_classic") for _ in range(2))
    for scan in SCANS[:-1]:
        ring.process(scan)
        undisturbed.process(scan)
    manager = ring.manager
    assert manager.admit(SCANS[-1]) is None
    opened = manager.open()
    assert len(opened.table) >= 3
    good = dict(zip(("evidence", "scores", "associations"), answers(ring), strict=True))
    # One by one: scores and associations may hold the very same list of pairs.
    bad = {name: copy.deepcopy(answer) for name, answer in good.items()}
    corrupt(bad[which])
    state, counters = copy.deepcopy(manager.state), dict(manager.counters)
    table = copy.deepcopy(opened.table)
    with pytest.raises(Inconsistent, match=re.escape(message)):
        manager.close(**bad)
    assert_same(manager.state, state)
    assert_same(opened.table, table)
    assert dict(manager.counters) == counters
    assert manager.opened is opened
    tracks, report = manager.close(**good)
    expected = undisturbed.process(SCANS[-1])
    assert_same(tracks, expected.tracks)
    assert_same(report, dataclasses.replace(expected.report))


def test_answers_in_parts():
    """Without scores, or without evidence, states are updated all the same."""
    results = []
    for keep in (("associations",), ("evidence", "associations"), ("scores", "associations")):
        ring = ring_of(attribute_term="dsm_classic")
        for scan in SCANS[:-1]:
            ring.process(scan)
        ring.manager.admit(SCANS[-1])
        ring.manager.open()
        given = dict(zip(("evidence", "scores", "associations"), answers(ring), strict=True))
        parts = {name: given[name] if name in keep else None for name in given}
        tracks, report = ring.manager.close(**parts)
        assert report.outcome == "tracked"
        results.append(tracks)
    for tracks in results[1:]:
        np.testing.assert_array_equal(tracks.mean, results[0].mean)
        np.testing.assert_array_equal(tracks.track_id, results[0].track_id)
        np.testing.assert_allclose(tracks.masses.sum(axis=1), 1.0)
