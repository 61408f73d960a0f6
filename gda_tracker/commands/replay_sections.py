"""Sections of the report of a replay: tracks, truth, attributes, consistency, latency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.commands.options import Parameters
from gda_tracker.commands.replay_summary import match_distance, with_truth
from gda_tracker.evaluation.figures import (
    belief_courses,
    conflict_course,
    nis_course,
    plan_position,
    png,
    rcs_courses,
    stage_latencies,
    track_lives,
    track_map,
)
from gda_tracker.evaluation.figures.courses import heard_conflicts
from gda_tracker.evaluation.figures.lives import (
    MOST_LIVES,
    MOST_PANELS,
    longest_lives,
    rcs_dbsm,
    says_a_class,
    seconds_of,
)
from gda_tracker.evaluation.figures.series import TrackHistory
from gda_tracker.evaluation.innovations import GatedScan, innovations
from gda_tracker.evaluation.quality import combine_consistency
from gda_tracker.evaluation.report import Picture, Section
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.tuning.cases import Case
from gda_tracker.tuning.report import TITLES
from gda_tracker.tuning.scores import measures, score_tracks
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks


def truth_sections(
    play: Playback,
    detections: Sequence[Detections],
    tracks: Sequence[Tracks],
    match_distance_m: float | None,
) -> list[Section]:
    """Measures against the truth, and the tracks around the targets; nothing without pairs."""
    pairs = with_truth(play.truth or [], tracks)
    if not pairs:
        return []
    by_scan = {(d.sensor_id, d.stamp_ns): d for d in detections}
    known = [truth for _, truth in pairs]
    own = [by_scan[truth.sensor_id, truth.stamp_ns] for truth in known]
    distance_m, complete = match_distance(play, known, match_distance_m)
    case = Case(play.name, Recording(play.name, own, known), distance_m, not complete)
    found = measures([score_tracks(case, [live for live, _ in pairs])])
    rows = [["", "value"]]
    rows += [[TITLES[name], f"{value:.3f}"] for name, value in found.items() if value is not None]
    told = (
        "The truth knows every target and the source of every detection."
        if complete
        else "The truth knows some of what the radar sees: tracks far from the known targets may "
        "follow something real. They count neither as false nor in GOSPA, except in GOSPA of "
        "every track."
    )
    picture = Picture(
        "Tracks around the targets",
        "Wide bands are the truth, lines the tracks; the number stands where a track begins. Grey "
        "tracks follow no known target on most of their scans.",
        png(track_map(own, [live for live, _ in pairs], known, match_distance_m=distance_m)),
    )
    matched = (
        f"A target counts as tracked where a confirmed track is within {distance_m:g} m, which is "
        "the cut-off of GOSPA too. docs/measures.md explains each measure."
    )
    return [Section("Against the truth", (told, matched), rows, pictures=[picture])]


def track_section(
    truth: Sequence[ScanTruth] | None, detections: Sequence[Detections], tracks: Sequence[Tracks]
) -> Section:
    """Where the confirmed tracks went, when they lived, and their numbers in a table."""
    known = [one for _, one in with_truth(truth or [], tracks)] or None
    shown = longest_lives(tracks)
    if not shown:
        return Section(
            "Tracks",
            ("No track was confirmed. Detections and radar:",),
            pictures=[_plan(known, detections, tracks)],
        )
    return Section(
        "Tracks",
        table=_table(shown, detections, tracks),
        pictures=[
            _plan(known, detections, tracks),
            Picture(
                "Tracks over time",
                f"The tracks that were confirmed on most scans, at most {MOST_LIVES} of them. "
                "Strokes are scans with a detection: where the bar goes on without "
                "them the track coasts. A bar without a cross lives at the end.",
                png(track_lives(tracks)),
            ),
        ],
    )


def _plan(
    known: Sequence[ScanTruth] | None,
    detections: Sequence[Detections],
    tracks: Sequence[Tracks],
) -> Picture:
    return Picture(
        "Plan position",
        "Every confirmed track over all detections, in the tracking frame"
        + ("; wide grey bands are the truth." if known else "."),
        png(plan_position(detections, tracks, known)),
    )


def _table(
    shown: Sequence[TrackHistory], detections: Sequence[Detections], tracks: Sequence[Tracks]
) -> list[list[str]]:
    time_s = seconds_of(tracks)
    rows = [
        [
            "track",
            "first [s]",
            "confirmed [s]",
            "last [s]",
            "scans",
            "with a detection [%]",
            "longest coasting [scans]",
            "class at the end",
        ]
    ]
    for history in shown:
        heard = history.detection >= 0
        rows.append(
            [
                f"{history.track_id}",
                f"{time_s[history.scan[0]]:.2f}",
                f"{time_s[history.scan[history.confirmed.argmax()]]:.2f}",
                f"{time_s[history.scan[-1]]:.2f}",
                f"{len(history.scan)}",
                f"{100.0 * heard.mean():.0f}",
                f"{_longest_run(~heard)}",
                _class_at_the_end(history, tracks),
            ]
        )
    return rows


def _longest_run(marks: np.ndarray) -> int:
    """Length of the longest run of marks that are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marks.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _class_at_the_end(history: TrackHistory, tracks: Sequence[Tracks]) -> str:
    live = tracks[int(history.scan[-1])]
    if not says_a_class(tracks, history):
        return "-"
    belief = live.class_probability[np.searchsorted(live.track_id, history.track_id)]
    best = int(np.argmax(belief))
    return f"{live.class_names[best].replace('_', ' ')} ({belief[best]:.2f})"


def attribute_section(
    parameters: Parameters, detections: Sequence[Detections], tracks: Sequence[Tracks]
) -> Section:
    """Class beliefs, radar cross sections over the fuzzy sets, conflict; or why there are none."""
    tables = stage_parameters(parameters)
    term = tables["track_manager"].attribute_term
    lives = longest_lives(tracks, MOST_PANELS)
    believed = [h for h in lives if says_a_class(tracks, h)]
    measured = [h for h in lives if np.isfinite(rcs_dbsm(detections, h)).any()]
    paragraphs, pictures = [], []
    if believed:
        pictures.append(
            Picture(
                "Class beliefs over time",
                f"Attribute term {term}; pignistic probabilities where it works with masses. The "
                f"longest tracks, at most {MOST_PANELS}.",
                png(belief_courses(tracks, believed)),
            )
        )
    else:
        paragraphs.append(
            "No class is claimed: no attribute that the tracker knows was measured, or the "
            f"attribute term is none (it is {term})."
        )
    if measured:
        fuzzifier = RcsFuzzifier(tables["rcs_fuzzifier"])
        pictures.append(
            Picture(
                "Radar cross section over time",
                "Of the detections that each track took. The ground has the colours of the "
                "classes, as strongly as the mass that a detection of this value gets. Where "
                "nearly all points lie on the ground of one class, that is what the track is; "
                "where they lie outside all sets, class_rcs_mean_m2 or the unit is wrong.",
                png(rcs_courses(detections, tracks, measured, fuzzifier)),
            )
        )
    else:
        paragraphs.append("The detections of these tracks bring no radar cross section.")
    conflicts = heard_conflicts(tracks)[1]
    if conflicts.any():
        paragraphs.append(f"Mean conflict of a fusion: {conflicts.mean():.3f}.")
        pictures.append(
            Picture(
                "Conflict over time",
                "Of what a confirmed track was taken for with the detection it took: 0 they agree, "
                "1 they have nothing in common. Lasting values near 1: classes or unit do not fit.",
                png(conflict_course(tracks)),
            )
        )
    else:
        paragraphs.append("There was no conflict: no masses were combined, or none disagreed.")
    return Section("Attributes", paragraphs, pictures=pictures)


def consistency_section(
    gated: Mapping[tuple[str, int], GatedScan], tracks: Sequence[Tracks]
) -> Section:
    """Normalised innovations squared of the confirmed tracks, and what lay in no gate."""
    errors = innovations(tracks, gated)
    detections = sum(scan.detections for scan in gated.values())
    outside = sum(scan.outside for scan in gated.values())
    paragraphs = [f"Of {len(gated)} of {len(tracks)} scans the gated pairs are known."]
    if detections:
        paragraphs.append(
            f"{outside} of {detections} detections ({100.0 * outside / detections:.1f} %) lay in "
            "no gate: clutter, or targets without a track yet."
        )
    if not len(errors.squared):
        return Section("Consistency", [*paragraphs, "No confirmed track took a detection."])
    found = combine_consistency([errors], len(tracks))
    paragraphs.append(
        f"NIS of {len(errors.squared)} innovations: mean {found.mean:.2f}, expected "
        f"{found.expected:.2f} within the gate; {100.0 * found.inside:.0f} % of the scans are "
        "within the bounds, 95 % should be."
    )
    picture = Picture(
        "Normalised innovation squared (NIS)",
        "How far detections lie from where their tracks expect them, in units of the expected "
        "covariance. Lastingly above the dashed line: range_std_m, azimuth_std_rad or the process "
        "noise is too small, below it too large. Bounds hold for independent errors.",
        png(nis_course(errors, tracks)),
    )
    return Section("Consistency", paragraphs, pictures=[picture])


def latency_section(latency_ms: Mapping[str, tuple[float, float]], told: str) -> Section:
    """How long each stage took."""
    if not latency_ms:
        return Section("Latency", ("No stage has told how long a scan took.",))
    rows = [["", "median [ms]", "95 % below [ms]"]]
    rows += [[name, f"{p50:.3f}", f"{p95:.3f}"] for name, (p50, p95) in latency_ms.items()]
    picture = Picture("Latency per stage", told, png(stage_latencies(latency_ms)))
    return Section("Latency", table=rows, pictures=[picture])
