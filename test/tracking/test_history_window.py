"""The history policy window in the whole ring: what each hypothesis believes, by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from dictionary_rules import assert_same as same_masses
from dictionary_rules import combine, from_row, project, reduced, shafer_parts
from tracking_examples import (
    QUIET,
    answers,
    assert_same,
    initial_tracks,
    moving,
    ring_of,
    scan_at,
    simulated,
)

from gda_tracker.attributes.class_terms import class_prior
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, RULE_OF_TERM
from gda_tracker.evidence.frames import singletons, total_ignorance
from gda_tracker.kinematics.gating import gate
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.history_window import with_window
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.parameter_groups.history import LONGEST_HISTORY_WINDOW
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.vocabulary.hypotheses import BELIEF_ROW, EVIDENCE_ROW, NO_ROW

FRAME = ("VS", "S", "B")
ALIVE = shafer_parts(FRAME)
TERMS = tuple(term for term in ATTRIBUTE_TERMS if term != "none")
PRIOR = {"class_prior": [0.1, 0.3, 0.6]}
SCANS = simulated(16, n_targets=3, clutter=2, seed=8)


def labelled(stamp_s=10.0):
    """Initial tracks with masses on the three elements."""
    return initial_tracks(2, stamp_s, focal=np.array(singletons(3), dtype=np.uint32))


def windowed(window, **track_manager):
    """A ring whose classes are not equally likely, with a window of so many detections."""
    policy = {"history_policy": "window", "history_window": window} if window else {}
    return Ring({"track_manager": {**QUIET, **policy, **track_manager}, "rcs_fuzzifier": PRIOR})


class Memory:
    """Every row of evidence that each hypothesis has been given, and what follows from the last."""

    def __init__(self):
        self.rows = {}

    def take(self, result):
        """Remember the detections that the tracks of a scan have got, if they are known."""
        scan, evidence, tracks = result.scan, result.evidence, result.tracks
        self.prior = class_prior(evidence)
        rows = {}
        for identity, index in zip(tracks.hypothesis_id, tracks.detection_index, strict=True):
            rows[identity] = list(self.rows.get(identity, []))
            (found,) = np.nonzero(scan.source_index == index)
            if index >= 0 and evidence.informative[found[0]]:
                masses = from_row(FRAME, evidence.focal, evidence.masses[found[0]])
                rows[identity].append((masses, evidence.log_class_likelihood[found[0]]))
        self.rows = rows

    def masses(self, term, identity, window):
        """The last rows by the rule of a term, on dictionaries."""
        rows = [masses for masses, _ in self.rows[identity][-window:]]
        ignorance = from_row(FRAME, [total_ignorance(3)], [1.0])
        history = rows.pop(0) if rows else ignorance
        if term != "dsm_classic":
            history, rows = project(FRAME, history, ALIVE), [reduced(row, ALIVE) for row in rows]
        for row in rows:
            history, _ = combine(RULE_OF_TERM[term], FRAME, ALIVE, [history, row])
        return history

    def classes(self, identity, window):
        """The last rows by Bayes' rule."""
        log = np.sum([likelihood for _, likelihood in self.rows[identity][-window:]], axis=0)
        joint = self.prior * np.exp(log - np.max(log))
        return joint / joint.sum()


def check(memory, tracks, term, window):
    """Compare all beliefs with those by brute force."""
    for row, identity in enumerate(tracks.hypothesis_id):
        if term == "bayes":
            expected = memory.classes(identity, window)
            np.testing.assert_allclose(tracks.class_probability[row], expected, rtol=1e-9)
            continue
        found = from_row(FRAME, tracks.focal, tracks.masses[row])
        if term != "dsm_classic":
            found = project(FRAME, found, ALIVE)
        same_masses(found, memory.masses(term, identity, window))


# --- by brute force -----------------------------------------------------------------------------


@pytest.mark.parametrize("window", [1, 4])
@pytest.mark.parametrize("term", TERMS)
def test_a_belief_is_the_fusion_of_the_last_detections(term, window):
    """Births, deaths, clutter, missed detections and unknown radar cross sections."""
    ring, memory = windowed(window, attribute_term=term), Memory()
    unknown = longest = 0
    for scan in SCANS:
        result = ring.process(scan)
        memory.take(result)
        check(memory, result.tracks, term, window)
        taken = result.associations.assigned_detection
        unknown += int(np.count_nonzero(~result.evidence.informative[taken[taken >= 0]]))
        longest = max([longest, *map(len, memory.rows.values())])
    assert unknown > 0
    assert longest > 5


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("given", [False, True])
def test_a_window_for_all_detections_is_none(term, given):
    """Also from initial tracks, whose belief counts as one of them."""
    with_one, without = (
        windowed(len(SCANS) + 1, attribute_term=term),
        windowed(0, attribute_term=term),
    )
    if given:
        start = SCANS[0].stamp_ns / 1e9
        for ring in (with_one, without):
            assert ring.initialise(labelled(start - 1.0)).outcome == "initialised"
    for scan in SCANS:
        found, expected = with_one.process(scan).tracks, without.process(scan).tracks
        np.testing.assert_array_equal(found.hypothesis_id, expected.hypothesis_id)
        np.testing.assert_allclose(
            found.class_probability, expected.class_probability, rtol=1e-9, atol=1e-15
        )
        for row in range(len(found)):
            same_masses(
                from_row(FRAME, found.focal, found.masses[row]),
                from_row(FRAME, expected.focal, expected.masses[row]),
            )
    assert len(found) >= 2


# --- where a window begins ----------------------------------------------------------------------


def targets(stamp_s, n=2):
    """Where ``initial_tracks`` are at a time."""
    return [moving(stamp_s, (3000.0 + 500.0 * i, 1000.0)) for i in range(n)]


@pytest.mark.parametrize("term", ["dsm_classic", "dempster", "bayes"])
def test_the_belief_of_initial_tracks_is_one_row_that_falls_out(term):
    ring, memory = windowed(3, attribute_term=term, initiation="labelled"), Memory()
    ring.initialise(labelled())
    for k in range(1, 6):
        result = ring.process(scan_at(10.0 + k, targets(10.0 + k), rcs=0.5 + k))
        table = ring.manager.state.table
        kinds = {1: [BELIEF_ROW, EVIDENCE_ROW]}.get(k, [EVIDENCE_ROW] * 2)
        assert table.window_kind.tolist() == [kinds] * 2
        memory.take(result)
        if k >= 3:
            check(memory, result.tracks, term, 3)
            # Nothing is left of the columns of the belief that the evidence does not have.
            np.testing.assert_array_equal(table.window_focal, result.evidence.focal)
        elif term == "bayes":
            log = np.sum([likelihood for _, likelihood in memory.rows[1]], axis=0)
            joint = np.array([0.2, 0.3, 0.5]) * np.exp(log)
            np.testing.assert_allclose(result.tracks.class_probability[0], joint / joint.sum())


def test_labelled_initiation_looks_at_the_window_alone():
    scenario = load_scenario("crossing_targets")
    preset = with_method(tracker_preset(scenario), "gda/dsm_classic/cv")
    recording = simulate(scenario, 1, 0)
    beliefs = []
    for window in (1, 2, 9):
        manager = {"history_policy": "window", "history_window": window}
        ring = Ring({**preset, "track_manager": {**preset["track_manager"], **manager}})
        tracks = labelled_tracks(recording, 2, ring)
        beliefs.append({tuple(row) for row in tracks.masses.round(12).tolist()})
        if window == 1:
            evidence = ring.prepare(recording.detections[1]).evidence
            assert beliefs[0] <= {tuple(row) for row in evidence.masses.round(12).tolist()}
    (play,) = of_scenario(scenario, 1, 1, "gda/dsm_classic/cv")
    without = {tuple(row) for row in play.initial.masses.round(12).tolist()}
    assert beliefs[0] != without
    assert beliefs[1] == beliefs[2] == without


# --- changes while it runs ----------------------------------------------------------------------


@pytest.mark.parametrize("term", ["dsm_classic", "pcr5", "bayes"])
def test_the_length_changes_at_a_scan_boundary(term):
    """Rows that were given up are gone; what is left, and what comes, is fused."""
    ring, memory = windowed(4, attribute_term=term, initiation="labelled"), Memory()
    ring.initialise(labelled())
    # Set while a scan is open: it acts on the next one.
    asked = [4, 4, 4, 4, 2, 2, 6, 6, 6, 6, 6, 3]
    acting = [4, *asked[:-1]]
    held, kept = [], 1
    for k, window in enumerate(asked, 1):
        ring.manager.admit(scan_at(10.0 + k, targets(10.0 + k), rcs=0.4 + k % 4))
        opened = ring.manager.open()
        ring.manager.set_parameters(replace(ring.manager.parameters, history_window=window))
        evidence, scores, associations = answers(ring)
        tracks, report = ring.manager.close(evidence, scores, associations)
        memory.take(RingResult(report, tracks, scan=opened.scan, evidence=evidence))
        # The belief is made of one detection more than the table keeps.
        held.append(min(kept, acting[k - 1] - 1) + 1)
        kept = min(held[-1], acting[k - 1] - 1)
        if k >= 5:  # by then the initial belief has fallen out
            check(memory, tracks, term, held[-1])
    assert held == [2, 3, 4, 4, 4, 2, 2, 2, 3, 4, 5, 6]


def test_the_policy_changes_at_a_scan_boundary():
    """none, window, forgetting, window: what is believed then is the oldest row."""
    ring = windowed(0, attribute_term="dsm_classic", initiation="labelled")
    ring.initialise(labelled())
    policies = ["none", "none", "window", "window", "forgetting", "window"]
    kinds = []
    for k, policy in enumerate(policies, 1):
        before = ring.manager.state.table
        ring.manager.set_parameters(
            replace(
                ring.manager.parameters,
                history_policy=policy,
                history_window=4,
                forgetting_factor=0.8,
            )
        )
        result = ring.process(scan_at(10.0 + k, targets(10.0 + k), rcs=0.5 + k))
        assert result.predictions.settings.history_policy == policy
        assert result.predictions.settings.forgetting_factor == (
            0.8 if policy == "forgetting" else 1
        )
        kinds.append(ring.manager.state.table.window_kind[0].tolist())
        if policy == "window" and kinds[-2] == []:
            # The history of the pairs is the belief of the scan before.
            first = result.predictions.window_masses[:, -1]
            np.testing.assert_array_equal(first, before.masses)
            np.testing.assert_array_equal(result.predictions.window_focal, before.focal)
    row = [NO_ROW, BELIEF_ROW, EVIDENCE_ROW]
    assert kinds == [[], [], row, [BELIEF_ROW, EVIDENCE_ROW, EVIDENCE_ROW], [], row]


def test_the_term_changes_with_every_scan():
    """Windows hold what every term needs; scans without a term leave them as they are."""
    ring, memory = windowed(3), Memory()
    changes = np.random.default_rng(4).permutation(list(ATTRIBUTE_TERMS) * 2)
    checked = set()
    for term, scan in zip(changes.tolist(), SCANS, strict=False):
        ring.manager.set_parameters(replace(ring.manager.parameters, attribute_term=term))
        before = dict(memory.rows)
        result = ring.process(scan)
        if term == "none":
            continue
        memory.take(result)
        for row, identity in enumerate(result.tracks.hypothesis_id):
            if len(memory.rows[identity]) == len(before.get(identity, [])):
                continue
            one = replace(result.tracks, hypothesis_id=result.tracks.hypothesis_id[[row]])
            one.masses = result.tracks.masses[[row]]
            one.class_probability = result.tracks.class_probability[[row]]
            # Tracks that began without a term have a row less than the memory at most.
            check(memory, one, term, 3)
            checked.add(term)
    assert len(checked) >= 5


def test_other_classes_empty_the_windows():
    ring = windowed(4, attribute_term="dsm_classic")
    for scan in SCANS[:8]:
        ring.process(scan)
    assert (ring.manager.state.table.window_kind[:, -1] == EVIDENCE_ROW).any()
    four = {
        "class_names": ["false_alarm", "drone", "fighter", "cargo"],
        "class_rcs_mean_m2": [0.3, 0.05, 1.2, 4.0],
        "class_rcs_swerling": [2, 1, 3, 4],
        "class_labels": ["FA", "D", "F", "C"],
        "class_prior": [],
    }
    other = Ring({"track_manager": {**QUIET}, "rcs_fuzzifier": four})
    ring.fuzzifier = other.fuzzifier
    result = ring.process(SCANS[8])
    table = ring.manager.state.table
    assert table.frame == ("FA", "D", "F", "C")
    assert (table.window_kind != NO_ROW).sum(axis=1).max() == 1
    assert table.window_log_class_likelihood.shape[2] == 4
    assert len(result.tracks) >= 2
    for scan in SCANS[9:]:
        assert ring.process(scan).report.outcome == "tracked"


# --- scans without an answer --------------------------------------------------------------------


@pytest.mark.parametrize("how", ["degraded", "gave_up"])
@pytest.mark.parametrize("term", ["dsm_classic", "bayes"])
def test_a_scan_without_scores_does_not_enter_the_window(how, term):
    ring = windowed(4, attribute_term=term)
    for scan in SCANS[:8]:
        ring.process(scan)
    before = ring.manager.state.table
    ring.manager.admit(SCANS[8])
    opened = ring.manager.open()
    if how == "gave_up":
        tracks, _ = ring.manager.give_up()
    else:
        settings = replace(opened.predictions.settings, degraded=True)
        opened.predictions.settings = settings
        evidence, _, _ = answers(ring)
        pairs = gate(opened.scan, opened.predictions)
        associations = ring.associate(opened.scan, opened.predictions, None, pairs)
        tracks, _ = ring.manager.close(evidence, None, associations)
        assert (associations.assigned_detection >= 0).any()
    assert tracks.degraded
    table = ring.manager.state.table
    stayed = np.flatnonzero(np.isin(before.hypothesis_id, table.hypothesis_id))
    now = np.flatnonzero(np.isin(table.hypothesis_id, before.hypothesis_id))
    for name in ("window_kind", "window_masses", "window_log_class_likelihood"):
        np.testing.assert_array_equal(getattr(table, name)[now], getattr(before, name)[stayed])
    assert ring.process(SCANS[9]).report.outcome == "tracked"


def test_births_of_a_degraded_scan_have_an_empty_window():
    ring = windowed(3, attribute_term="dsm_classic")
    for k in range(2):
        ring.manager.admit(scan_at(10.0 + k, targets(10.0 + k)))
        opened = ring.manager.open()
        opened.predictions.settings = replace(opened.predictions.settings, degraded=True)
        pairs = gate(opened.scan, opened.predictions)
        ring.manager.close(None, None, ring.associate(opened.scan, opened.predictions, None, pairs))
    table = ring.manager.state.table
    assert len(table) >= 2
    np.testing.assert_array_equal(table.window_kind, NO_ROW)
    result = ring.process(scan_at(12.0, targets(12.0)))
    assert (ring.manager.state.table.window_kind[:, -1] == EVIDENCE_ROW).all()
    assert len(result.tracks) >= 2


# --- the table ----------------------------------------------------------------------------------


def test_without_the_policy_nothing_is_kept_and_nothing_travels():
    ring = ring_of(attribute_term="dsm_classic", history_window=9)
    for scan in SCANS:
        predictions = ring.process(scan).predictions
    table = ring.manager.state.table
    for owner in (table, predictions):
        assert owner.window_kind.size == owner.window_masses.size == len(owner.window_focal) == 0
        assert owner.window_log_class_likelihood.size == 0


def test_resizing_leaves_the_given_table_alone_and_keeps_the_newest():
    ring = windowed(5, attribute_term="dsm_classic")
    for scan in SCANS:
        ring.process(scan)
    table = ring.manager.state.table
    assert with_window(table, 4) is table
    before = table.copy()
    for rows in (0, 2, 7):
        resized = with_window(table, rows)
        kept = min(rows, 4)
        for name in ("window_kind", "window_masses", "window_log_class_likelihood"):
            found, whole = getattr(resized, name), getattr(table, name)
            assert found.shape[:2] == (len(table), rows)
            assert not found[:, : rows - kept].any()
            if kept:
                np.testing.assert_array_equal(found[:, rows - kept :], whole[:, 4 - kept :])
        assert len(resized.window_focal) == (len(table.window_focal) if rows else 0)
        assert_same(table, before)


# --- parameters ---------------------------------------------------------------------------------


def test_a_policy_without_its_number_is_refused():
    with pytest.raises(ParameterError, match="history_policy = 'window'.*at least 1, which is 0"):
        TrackManagerParameters(history_policy="window")
    with pytest.raises(ParameterError, match="'forgetting'.*forgetting_factor below 1, which is 1"):
        TrackManagerParameters(history_policy="forgetting")
    # The numbers may be set first.
    numbers = TrackManagerParameters(history_window=5, forgetting_factor=0.9)
    assert (numbers.window_rows, numbers.share_kept) == (0, 1.0)
    assert replace(numbers, history_policy="window").window_rows == 4
    assert replace(numbers, history_policy="forgetting").share_kept == 0.9


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("history_policy", "oblivion", "one of none, forgetting, window"),
        ("history_window", -1, "an integer >= 0"),
        ("history_window", LONGEST_HISTORY_WINDOW + 1, "an integer >= 0"),
        ("forgetting_factor", 1.5, "a number >= 0"),
    ],
)
def test_wrong_values_are_named(name, value, allowed):
    with pytest.raises(ParameterError, match=f"{name} = .*: allowed is {allowed}"):
        Ring({"track_manager": {name: value}})


def test_the_longest_window_is_a_window_all_the_same():
    ring, memory = windowed(LONGEST_HISTORY_WINDOW, attribute_term="dempster"), Memory()
    for scan in SCANS[:6]:
        result = ring.process(scan)
        memory.take(result)
    check(memory, result.tracks, "dempster", LONGEST_HISTORY_WINDOW)
