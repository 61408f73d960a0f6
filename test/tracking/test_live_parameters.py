"""Every live parameter acts: a change on the way changes what the ring does, and nothing before.

The ring with the change does what one without it does up to the scan before which it is made.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from live_parameter_cases import (
    ANSWERS,
    ASSOCIATIONS,
    AT,
    BY_SERVICE,
    CASES,
    DELAYED,
    IN_THE_NODE,
    TRACKS,
    crossing,
)
from tracking_examples import QUIET

from gda_tracker.association.associate import Associator
from gda_tracker.parameters import ParameterError, specifications
from gda_tracker.tracking.ring import STAGE_TABLES, Ring
from gda_tracker.vocabulary.statements import Statement

LIVE = [
    (node, name)
    for node, table in STAGE_TABLES.items()
    for name, item in specifications(table).items()
    if item.live
]
HERE = [(node, name) for node, cases in CASES.items() for name in cases]


def plain(value):
    """A value as tuples and bytes, to compare bit for bit."""
    if dataclasses.is_dataclass(value):
        return tuple(plain(getattr(value, item.name)) for item in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, list | tuple):
        return tuple(plain(each) for each in value)
    return repr(value)


def told(results):
    """What the answers to one scan tell, by where it shows."""
    answers = [
        (r.report.key, r.report.outcome, r.report.reason, r.report.rejected) for r in results
    ]
    return {
        TRACKS: plain([r.tracks for r in results]),
        DELAYED: plain([r.delayed for r in results]),
        ASSOCIATIONS: plain([r.associations for r in results]),
        ANSWERS: repr(answers),
    }


def play(case, change=None):
    """What is told on each scan or statement that is fed; the change comes before number AT."""
    ring = Ring(case.parameters())
    seen, scans = [], 0
    for item in case.fed():
        if isinstance(item, Statement):
            report = ring.say(item)
            seen.append((scans, {ANSWERS: repr((report.outcome, report.reason))}))
            continue
        scans += 1
        seen.append((scans - 1, told(ring.feed(item))))
        if scans == AT and change:
            ring.set_parameters(change)
    return seen


def test_every_live_parameter_has_a_case():
    elsewhere = [
        (node, name)
        for cases in (IN_THE_NODE, BY_SERVICE)
        for node, names in cases.items()
        for name in names
    ]
    assert sorted(HERE + elsewhere) == sorted(LIVE)


@pytest.mark.parametrize(("node", "name"), HERE, ids=[f"{n}.{p}" for n, p in HERE])
def test_a_change_acts_from_the_next_scan_on(node, name):
    case = CASES[node][name]
    without, changed = play(case), play(case, {node: {name: case.value}})
    assert len(without) == len(changed)
    different = [
        place
        for (place, one), (_, other) in zip(without, changed, strict=True)
        if one.get(case.shows) != other.get(case.shows)
    ]
    assert different, f"{name} = {case.value} changes nothing in the {case.shows}"
    before = [place for (place, one), (_, o) in zip(without, changed, strict=True) if one != o]
    assert min(before) >= AT
    if not case.later:
        assert different[0] == AT


def test_a_change_that_is_refused_changes_nothing():
    ring = Ring({"track_manager": QUIET})
    associator, parameters = ring.associate, ring.manager.parameters
    refused = {
        "fixed at start-up": {"track_manager": {"tracking_frame": "odom"}},
        "at most confirmation_scans": {"track_manager": {"range_std_m": 3, "confirmation_hits": 9}},
        "allowed is an integer": {
            "association": {"max_exact_size": 99},
            "track_manager": {"range_std_m": 3.0},
        },
        "9 for the 3 classes": {"attribute_fusion": {"class_transition": [0.5] * 4}},
        "node viewer: unknown": {"viewer": {"x": 1}},
    }
    for reason, change in refused.items():
        with pytest.raises(ParameterError) as error:
            ring.set_parameters(change)
        assert reason in str(error.value)
    assert ring.manager.parameters is parameters
    assert ring.associate is associator
    ring.set_parameters({"association": {"max_exact_size": 2}})
    assert isinstance(ring.associate, Associator)
    assert ring.associate is not associator


def test_an_association_of_ones_own_stays():
    given = Associator(STAGE_TABLES["association"]())

    def associate(*arguments):
        return given(*arguments)

    ring = Ring({"track_manager": QUIET}, associate)
    ring.set_parameters({"association": {"max_exact_size": 2}})
    assert ring.associate is associate
    assert ring.feed(crossing()[0])[0].report.outcome == "tracked"


def test_what_comes_in_while_a_scan_is_open_is_judged_by_the_new_parameters():
    """The noise of the next scan is given at the door, before the change is taken over."""
    first, second, third = crossing()[:3]
    noise = []
    for change_while_open in (True, False):
        ring = Ring({"track_manager": QUIET})
        ring.feed(first)
        if change_while_open:
            ring.manager.admit(second)
            ring.manager.open()
        else:
            ring.feed(second)
        ring.set_parameters({"track_manager": {"range_std_m": 25.0}})
        assert ring.manager.admit(third) is None
        if change_while_open:
            assert ring.manager.parameters.range_std_m == QUIET["range_std_m"]
            ring.manager.give_up()
        noise.append(ring.manager.open().scan.noise_covariance)
        assert ring.manager.parameters.range_std_m == 25.0
    assert np.array_equal(*noise)
    assert np.array_equal(noise[0][:, 0, 0], np.full(len(noise[0]), 625.0))
