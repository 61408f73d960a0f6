"""The report of a replay: what was played, what came out, pictures, and how to make it again."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from gda_tracker.commands.demo_report import versions
from gda_tracker.commands.options import Parameters
from gda_tracker.commands.replay_formations import formation_section
from gda_tracker.commands.replay_sections import (
    attribute_section,
    consistency_section,
    latency_section,
    track_section,
    truth_sections,
)
from gda_tracker.commands.replay_summary import Answers, count_left_out, count_outcomes
from gda_tracker.evaluation.figures.lives import seconds_of
from gda_tracker.evaluation.report import Facts, Section, render
from gda_tracker.evaluation.rounds import Heard
from gda_tracker.formations.found import Formations
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


def write_report(
    path: Path,
    play: Playback,
    played_with: str,
    parameters: Parameters,
    answers: Answers,
    heard: Heard,
    match_distance_m: float | None,
    formations: Sequence[Formations] = (),
) -> None:
    """Draw all pictures and write the page.

    Parameters
    ----------
    path
        The HTML file.
    play
        What was played.
    played_with
        Where the parameters come from.
    parameters
        ``{node: {name: value}}`` of the four nodes.
    answers
        Report and tracks of each scan, in the order of the answers.
    heard
        What the stages tell.
    match_distance_m
        How far a track may be from its target; ``None``: what the recording says, or by where
        the truth comes from.
    formations
        After each scan, if somebody followed them.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    scans = {(d.sensor_id, d.stamp_ns): d for d in play.detections}
    tracks = [live for _, live in answers if live is not None]
    detections = [scans[live.key.sensor_id, live.key.stamp_ns] for live in tracks]
    sections = [
        Section("What was played", play.notes, facts=[_played(play, played_with, parameters)]),
        Section("What came out", table=_counts(answers, tracks)),
    ]
    if play.truth is not None:
        sections += truth_sections(play, detections, tracks, match_distance_m)
    if tracks:
        sections += [
            track_section(play.truth, detections, tracks),
            attribute_section(parameters, detections, tracks),
            consistency_section(heard.gated, tracks),
        ]
    if formations:
        sections.append(formation_section(formations))
    sections += [latency_section(heard.latency_ms, heard.told), _made(parameters)]
    page = render(
        f"gda_tracker replay: {play.name}",
        "What the tracker made of a recording. Times count from the first scan that was tracked.",
        sections,
    )
    path.write_text(page, encoding="utf-8")


def _played(play: Playback, played_with: str, parameters: Parameters) -> Facts:
    manager = stage_parameters(parameters)["track_manager"]
    stamps = [d.stamp_ns for d in play.detections]
    duration_s = (max(stamps) - min(stamps)) / 1e9
    period_s = float(np.median(np.diff(np.sort(stamps)))) / 1e9 if len(stamps) > 1 else 0.0
    return Facts(
        "",
        {
            "recording": play.name,
            "scans": f"{len(stamps)} in {duration_s:.2f} s, one every {period_s:.3f} s (median)",
            "sensors": sorted({d.sensor_id for d in play.detections}),
            "detections": sum(len(d.range_m) for d in play.detections),
            "parameters": played_with,
            "method": f"{manager.decision}/{manager.attribute_term}/{manager.filter}",
            "truth": "none" if play.truth is None else "known",
        },
    )


def _counts(answers: Answers, tracks: Sequence[Tracks]) -> list[list[str]]:
    """Rows of what became of scans, detections and tracks, everything left out by its reason."""
    reports = [report for report, _ in answers]
    rows = [["", "number"]]
    rows += [[f"scans {name}", f"{count}"] for name, count in count_outcomes(reports).items()]
    received = sum(report.detections_received for report in reports)
    admitted = sum(report.detections_admitted for report in reports)
    rows += [["detections received", f"{received}"], ["detections admitted", f"{admitted}"]]
    rows += [
        [f"detections rejected: {reason}", f"{count}"]
        for reason, count in count_left_out(reports).items()
    ]
    ever = {int(i) for live in tracks for i in live.track_id}
    confirmed = {int(i) for live in tracks for i in live.track_id[live.status == CONFIRMED]}
    taken = sum(int((live.detection_index >= 0).sum()) for live in tracks)
    rows += [
        ["detections taken by a track", f"{taken}"],
        ["tracks started", f"{len(ever)}"],
        ["tracks confirmed", f"{len(confirmed)}"],
    ]
    if tracks:
        at_the_end = int((tracks[-1].status == CONFIRMED).sum())
        rows.append(["confirmed tracks after the last scan", f"{at_the_end}"])
        # A track is at rest between two scans: the mean over the scans, not over the time.
        mean = float(np.mean([(live.status == CONFIRMED).sum() for live in tracks]))
        rows.append(["confirmed tracks, mean over the scans", f"{mean:.2f}"])
        rows.append(["time tracked [s]", f"{seconds_of(tracks).max():.2f}"])
    return rows


def _made(parameters: Parameters) -> Section:
    used = {
        f"{node}.{item.name}": getattr(table, item.name)
        for node, table in stage_parameters(parameters).items()
        for item in fields(table)
    }
    changed = {
        name: value
        for name, value in used.items()
        if name.partition(".")[2] in parameters.get(name.partition(".")[0], {})
    }
    return Section(
        "How this was made",
        ("The same command makes it again.",),
        code=shlex.join(["gda-tracker", *sys.argv[1:]]),
        facts=[
            Facts("Parameters given by preset, file or method:", changed or {"none": "defaults"}),
            Facts("All parameters of the four nodes", used, folded=True),
            Facts("Versions", versions(), folded=True),
        ],
    )
