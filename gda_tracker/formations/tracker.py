"""Tracks in, formations out: who flies together, how many they are, where they come from."""

from __future__ import annotations

from collections import Counter

import numpy as np

from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.samples import States
from gda_tracker.events.split_test import SplitTest
from gda_tracker.formations.found import (
    ENDED,
    FORMED,
    MERGED,
    NO_TRACK,
    NUMBER_CHANGED,
    SPLIT,
    Formation,
    FormationEvent,
    Formations,
)
from gda_tracker.formations.likelihood import cluster_log_ratio
from gda_tracker.formations.lineage import Regrouping, regroup
from gda_tracker.formations.links import PairLinks
from gda_tracker.formations.number_test import (
    NumberDecisions,
    NumberTests,
    advance_numbers,
    log_thresholds,
    merged_probability,
)
from gda_tracker.formations.observations import number_evidence, places_of
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.track_states import (
    TracksRejected,
    check_tracks,
    usable_states,
)
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan, ScanKey
from gda_tracker.vocabulary.tracks import Tracks


class FormationTracker:
    """Follows the formations of one tracker, scan after scan.

    Parameters
    ----------
    parameters
        The table of the node.

    Attributes
    ----------
    counters
        What was left out, by reason, and events by kind.
    """

    def __init__(self, parameters: FormationParameters | None = None) -> None:
        self.parameters = parameters or FormationParameters()
        self.counters: Counter[str] = Counter()
        p = self.parameters
        self._thresholds = log_thresholds(
            p.largest_number, p.overcount_probability, p.undercount_probability
        )
        self._next_id = 1
        self.reset()

    def reset(self) -> None:
        """Forget all formations; counters stay, and numbers are not used again."""
        p = self.parameters
        self._epoch: int | None = None
        self._system_uuid = b""
        self._last_ns = 0
        self._last_key: ScanKey | None = None
        self._ids: list[int] = []
        self._since_ns: list[int] = []
        self._members: list[IntArray] = []
        self._parents: list[tuple[int, ...]] = []
        self._children: list[tuple[int, ...]] = []
        self._tests = NumberTests.begin(0, p.largest_number, 0)
        self._links = PairLinks(p)
        # What appears beside a track began there; whether it departs is the pairs' own test.
        self._births = SplitTest(
            EventParameters(
                split_radius_m=p.together_distance_m, split_departure_m=p.apart_distance_m
            )
        )
        self._beside: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self._ids)

    def take(
        self, tracks: Tracks, scan: Scan | None = None, predictions: Predictions | None = None
    ) -> Formations:
        """Take a scan and the tracks after it; a new epoch or another tracker begins anew.

        Parameters
        ----------
        tracks
            After the scan.
        scan, predictions
            Of the same scan; without them the numbers of objects stay what they were.

        Raises
        ------
        TracksRejected
            ``older_epoch``, ``tracks_time_backwards``, ``tracks_state_too_small``,
            ``tracks_duplicate_track_id`` or ``formation_scan_repeated``; nothing is changed.
        """
        key = tracks.key
        check_tracks(tracks, self._epoch, self._system_uuid, self._last_ns)
        if (key, tracks.system_uuid) == (self._last_key, self._system_uuid):
            raise TracksRejected("formation_scan_repeated")
        if (key.epoch, tracks.system_uuid) != (self._epoch, self._system_uuid):
            if self._epoch is not None:
                self.counters["formations_began_anew"] += 1
            self.reset()
        self._epoch, self._system_uuid = key.epoch, tracks.system_uuid
        self._last_ns, self._last_key = key.stamp_ns, key
        everyone, confirmed = usable_states(tracks, self.counters)
        states = everyone.select(confirmed)
        events: list[FormationEvent] = []
        if scan is not None and predictions is not None:
            events += self._count(tracks, scan, predictions)
        else:
            self.counters["formation_scans_without_count"] += 1
        self._births.step(everyone, confirmed, tracks.track_id)
        self._beside.update(zip(*(ids.tolist() for ids in self._births.watched()), strict=True))
        self._links.step(states)
        events += self._regroup(states)
        alive = set(tracks.track_id.tolist())
        self._beside = {child: it for child, it in self._beside.items() if child in alive}
        self.counters.update(f"formation event {event.kind}" for event in events)
        return Formations(
            key, tracks.frame_id, tracks.system_uuid, self._formations(states), events
        )

    def _count(self, tracks: Tracks, scan: Scan, predictions: Predictions) -> list[FormationEvent]:
        """Hold the detections of a scan against the formations before it."""
        if not self._ids:
            return []
        ids = np.concatenate(self._members)
        row = np.repeat(np.arange(len(self)), [len(own) for own in self._members])
        order = np.argsort(ids)
        ids, row = ids[order], row[order]
        places, seen, there = places_of(predictions, ids, row, len(self))
        evidence = number_evidence(
            scan,
            places,
            seen,
            there,
            self._foreign(tracks, scan, ids, row),
            predictions.settings.clutter_density,
            self.parameters,
        )
        before = self._tests.number.copy()
        decisions = advance_numbers(
            self._tests,
            evidence.observed,
            evidence.log_ratio,
            scan.key.stamp_ns,
            self._thresholds,
            self.parameters.number_change_s,
        )
        return self._number_events(before, decisions)

    def _foreign(self, tracks: Tracks, scan: Scan, ids: IntArray, row: IntArray) -> np.ndarray:
        """Which detections (B, n) a track of another formation took."""
        owner = np.full(len(scan), -1, dtype=np.int64)
        took = np.flatnonzero((tracks.detection_index >= 0) & np.isin(tracks.track_id, ids))
        taken = row[np.searchsorted(ids, tracks.track_id[took])]
        source = scan.source_index
        order = np.argsort(source)
        place = np.searchsorted(source[order], tracks.detection_index[took])
        found = place < len(source)
        found[found] = source[order][place[found]] == tracks.detection_index[took][found]
        owner[order[place[found]]] = taken[found]
        return (owner >= 0)[None, :] & (owner[None, :] != np.arange(len(self))[:, None])

    def _number_events(self, before: IntArray, decisions: NumberDecisions) -> list[FormationEvent]:
        p = self.parameters
        events = []
        for index, row in enumerate(decisions.rows.tolist()):
            if decisions.number[index] == before[row]:
                continue
            events.append(
                FormationEvent(
                    NUMBER_CHANGED,
                    self._ids[row],
                    self._last_ns,
                    int(decisions.began_ns[index]),
                    tuple(self._members[row].tolist()),
                    number=int(decisions.number[index]),
                    previous_number=int(before[row]),
                    samples=int(decisions.samples[index]),
                    log_likelihood_ratio=float(decisions.margin[index]),
                    false_alarm_probability=p.overcount_probability,
                    miss_probability=p.undercount_probability,
                )
            )
        return events

    def _regroup(self, states: States) -> list[FormationEvent]:
        """Let the pairs say who flies together now, and keep who was who."""
        ids, label = states.track_id, self._links.groups(states.track_id)
        order = np.argsort(label, kind="stable")
        groups = np.split(ids[order], np.flatnonzero(np.diff(label[order])) + 1) if len(ids) else []
        known = np.isin(ids, np.concatenate(self._members)) if self._members else ids < 0
        waits = self._links.undecided(ids, states.stamp_ns) & ~known
        settled = np.ones(len(groups), dtype=bool)
        if len(ids):
            fresh = np.bincount(label, known, len(groups)) == 0
            settled = ~(fresh & (np.bincount(label, waits, len(groups)) > 0))
        groups = [group for group, is_settled in zip(groups, settled, strict=True) if is_settled]
        return self._rename(regroup(self._members, groups), groups)

    def _rename(self, found: Regrouping, groups: list[IntArray]) -> list[FormationEvent]:
        most, now = self.parameters.largest_number, self._last_ns
        ids, since, parents, children = [], [], [], []
        tests = NumberTests.begin(len(groups), most, now)
        born: dict[int, list[int]] = {}
        for group, (row, parent) in enumerate(
            zip(found.continues.tolist(), found.parent.tolist(), strict=True)
        ):
            if row >= 0:
                ids.append(self._ids[row])
                since.append(self._since_ns[row])
                parents.append(self._parents[row])
                children.append(self._children[row])
                continue
            ids.append(self._next_id)
            self._next_id += 1
            since.append(now)
            parents.append((self._ids[parent],) if parent >= 0 else ())
            children.append(())
            born.setdefault(parent, []).append(group)
        joined: dict[int, list[int]] = {}
        for row in np.flatnonzero(found.joins >= 0).tolist():
            joined.setdefault(int(found.joins[row]), []).append(row)
        events = [self._event(FORMED, ids[group], groups[group]) for group in born.pop(-1, [])]
        split_rows = set(born)
        for group, row in enumerate(found.continues.tolist()):
            if row >= 0 and row not in split_rows and group not in joined:
                _copy_row(self._tests, row, tests, group)
        group_of = {row: group for group, row in enumerate(found.continues.tolist()) if row >= 0}
        for row, parts in born.items():
            new = tuple(ids[group] for group in parts)
            # A formation that fell apart and went into another one at once is no more.
            group = group_of.get(row, int(found.joins[row]))
            if row in group_of:
                children[group] += new
            event = self._event(SPLIT, self._ids[row], groups[group], new)
            events.append(event)
        for group, rows in joined.items():
            row = int(found.continues[group])
            taken = tuple(self._ids[other] for other in rows)
            parents[group] += taken
            if row not in split_rows:
                share = self._tests.probability[row]
                for other in rows:
                    share = merged_probability(share, self._tests.probability[other])
                tests.probability[group] = share
            events.append(self._event(MERGED, ids[group], groups[group], taken))
        for row in found.ended.tolist():
            number = int(self._tests.number[row])
            events.append(self._event(ENDED, self._ids[row], self._members[row], number=number))
        order = np.argsort(ids)
        self._ids = [ids[group] for group in order]
        self._since_ns = [since[group] for group in order]
        self._parents = [parents[group] for group in order]
        self._children = [children[group] for group in order]
        self._members = [np.sort(groups[group]) for group in order]
        self._tests = tests.select(order)
        return events

    def _event(
        self,
        kind: str,
        formation_id: int,
        members: IntArray,
        others: tuple[int, ...] = (),
        number: int = 0,
    ) -> FormationEvent:
        p = self.parameters
        tested = kind in (SPLIT, MERGED)
        return FormationEvent(
            kind,
            formation_id,
            self._last_ns,
            self._last_ns,
            tuple(np.sort(members).tolist()),
            others,
            number=number,
            false_alarm_probability=p.false_split_probability if tested else 0.0,
            miss_probability=p.false_merge_probability if tested else 0.0,
        )

    def _formations(self, states: States) -> list[Formation]:
        tests, found = self._tests, []
        ratios = cluster_log_ratio(tests.log_ratio)
        for row, members in enumerate(self._members):
            at = np.searchsorted(states.track_id, members)
            position, velocity = states.position[at], states.velocity[at]
            covariance = states.covariance[at].sum(axis=0) / len(at) ** 2
            out = position - position.mean(axis=0)
            found.append(
                Formation(
                    self._ids[row],
                    self._since_ns[row],
                    members,
                    np.array([self._beside.get(t, NO_TRACK) for t in members.tolist()]),
                    position.mean(axis=0),
                    covariance[:2, :2],
                    velocity.mean(axis=0),
                    covariance[2:, 2:],
                    out.T @ out / len(at),
                    tests.probability[row].copy(),
                    int(tests.number[row]),
                    int(tests.since_ns[row]),
                    int(tests.samples[row]),
                    float(ratios[row]),
                    self._parents[row],
                    self._children[row],
                )
            )
        return found


def _copy_row(source: NumberTests, row: int, target: NumberTests, place: int) -> None:
    for name in NumberTests.__slots__:
        getattr(target, name)[place] = getattr(source, name)[row]
