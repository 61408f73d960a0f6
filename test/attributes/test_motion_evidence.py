"""Evidence of motion: masses, likelihoods, reliability, classes that are not known, fusion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes.class_ranges import log_density, log_possibility
from gda_tracker.attributes.motion_evidence import ClassMotion, fuse_motion, motion_evidence
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.evidence.frames import total_ignorance
from gda_tracker.vocabulary.scans import ScanKey

FRAME, CLASSES = ("VS", "S", "B"), ("false_alarm", "helicopter", "transport")
SPEEDS = np.array([[0.0, 0.0, 80.0, 100.0], [60.0, 90.0, 250.0, 280.0]])
TURNS = np.array([[0.0, 0.0, 10.0, 15.0], [0.0, 0.0, 8.0, 12.0]])
KEY = ScanKey(0, "radar", 0)


def known(reading="ranges", reliability=1.0, **changes):
    fields = {"speed_mps": SPEEDS, "acceleration_mps2": TURNS, **changes}
    return ClassMotion(reading, CLASSES[1:], reliability=reliability, **fields)


def history(greatest, least, acceleration, std=0.5):
    """(1, 3, 2) extremes."""
    return np.array([[[greatest, std], [least, std], [acceleration, std]]])


def mass(said, *elements):
    """Mass of the union of elements of the frame, given by their places."""
    mask = np.uint32(0)
    for element in elements:
        for part in range(1, 8):
            if part >> element & 1:
                mask |= np.uint32(1 << (part - 1))
    return said.masses[0, said.focal == mask].sum()


def test_what_hovered_is_no_transport():
    """Greatest speed 50, least 0: a transport has neither; what is no transport is not told."""
    said = motion_evidence(history(50.0, 0.0, 1.0), known(), CLASSES)
    assert mass(said, 0, 1) == pytest.approx(1.0, abs=1e-6)
    assert said.log_class_likelihood[0, 0] == said.log_class_likelihood[0, 1] == 0.0
    # With a reliability of 0.9 a transport is left with 1 - 0.9 by its speed.
    said = motion_evidence(history(50.0, 0.0, 1.0), known(reliability=0.9), CLASSES)
    assert mass(said, 0, 1) == pytest.approx(0.9, abs=1e-6)
    assert mass(said, 0, 1, 2) == pytest.approx(0.1, abs=1e-6)


def test_likelihoods_are_those_of_the_extremes():
    """The lesser of the two speeds, times the acceleration; independent of the evidence code."""
    extremes = history(92.0, 65.0, 9.0, 2.0)
    said = motion_evidence(extremes, known(), CLASSES)
    at = [(np.array([v]), np.array([2.0])) for v in (92.0, 65.0, 9.0)]
    speeds = np.minimum(log_possibility(*at[0], SPEEDS), log_possibility(*at[1], SPEEDS))
    expected = speeds + log_possibility(*at[2], TURNS)
    np.testing.assert_allclose(said.log_class_likelihood[:, 1:], expected, rtol=1e-12)
    said = motion_evidence(extremes, known("densities"), CLASSES)
    speeds = np.minimum(log_density(*at[0], SPEEDS), log_density(*at[1], SPEEDS))
    expected = speeds + log_density(*at[2], TURNS)
    told = said.log_class_likelihood[:, 1:]
    np.testing.assert_allclose(np.diff(told), np.diff(expected), rtol=1e-9)
    # The class that is not known is as likely as the mean of the others, by each of the two.
    assert told.min() < said.log_class_likelihood[0, 0] < told.max()


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from(["ranges", "densities"]),
    st.floats(0.0, 1.0),
    st.lists(st.floats(0.0, 300.0), min_size=3, max_size=3),
    st.floats(0.1, 30.0),
)
def test_masses_sum_to_one_and_agree_with_the_likelihoods(reading, reliability, numbers, std):
    said = motion_evidence(history(*numbers, std), known(reading, reliability), CLASSES)
    assert (said.masses >= 0.0).all()
    assert said.masses.sum() == pytest.approx(1.0)
    assert np.isfinite(said.log_class_likelihood).all()
    if reliability == 0.0:
        assert not said.informative.any()
        assert said.masses[:, said.focal == total_ignorance(3)].sum() == pytest.approx(1.0)


def test_what_is_not_known_tells_nothing():
    nothing = np.full((1, 3, 2), np.nan)
    for reading in ("ranges", "densities"):
        said = motion_evidence(nothing, known(reading), CLASSES)
        assert not said.informative.any()
        assert (said.log_class_likelihood == 0.0).all()
        # Other classes than the tracker's.
        said = motion_evidence(history(50.0, 0.0, 1.0), known(reading), ("x", "y", "z"))
        assert not said.informative.any()
    # Without an acceleration speed alone speaks.
    young = history(50.0, 0.0, np.nan)
    alone = motion_evidence(young, known(), CLASSES)
    no_turns = known(acceleration_mps2=np.zeros((0, 4)))
    other = motion_evidence(history(50.0, 0.0, 9.0), no_turns, CLASSES)
    np.testing.assert_allclose(alone.log_class_likelihood, other.log_class_likelihood)


@pytest.mark.parametrize("term", [term for term in ATTRIBUTE_TERMS if term != "none"])
def test_every_term_takes_it(term):
    """The RCS cannot tell, motion can; who says nothing keeps the belief to the last bit."""
    focal = np.array([total_ignorance(3)], dtype=np.uint32)
    belief = np.tile([0.0, 0.5, 0.5], (2, 1))
    extremes = np.concatenate([history(50.0, 0.0, 1.0), np.full((1, 3, 2), np.nan)])
    said = motion_evidence(extremes, known(reliability=0.9), CLASSES)
    fused = fuse_motion(term, KEY, FRAME, CLASSES, focal, np.ones((2, 1)), belief, said)
    # Speed leaves 0.1 to a transport; under the terms with masses a false alarm fits as well.
    told = fused.class_probability[0]
    if term == "bayes":
        np.testing.assert_allclose(told, [0.0, 1.0 / 1.1, 0.1 / 1.1])
        np.testing.assert_array_equal(fused.class_probability[1], belief[1])
    else:
        np.testing.assert_allclose(told, [0.45 + 0.1 / 3, 0.45 + 0.1 / 3, 0.1 / 3], atol=1e-6)
        vacuous = fused.masses[1, fused.focal == total_ignorance(3)]
        assert vacuous.sum() == 1.0
