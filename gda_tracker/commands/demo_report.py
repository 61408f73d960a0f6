"""The report of the demo: its pictures, what they show, and how to make them again."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker import __version__
from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.commands.demo import AUTOFERRY, OFF, ON, SCENARIO, reading_of
from gda_tracker.commands.demo_play import Played
from gda_tracker.evaluation.figures import (
    association_maps,
    class_beliefs,
    latency_histograms,
    membership_functions,
    paired_purity,
    pignistic_entropies,
    png,
    track_map,
)
from gda_tracker.evaluation.figures.series import target_names
from gda_tracker.evaluation.report import Facts, Picture, Section, render
from gda_tracker.evaluation.summary import Summary
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.vocabulary.recordings import Recording

COMPASS = ("East", "North")


def write_report(
    path: Path,
    recording: Recording,
    played: Mapping[str, Played],
    columns: Mapping[str, Summary],
    table: Sequence[Sequence[str]],
    args: argparse.Namespace,
) -> None:
    """Draw all pictures and write the report.

    Parameters
    ----------
    path
        The HTML file.
    recording
        The real recording.
    played, columns
        What came out of each part, and its scores, by the name of the part.
    table
        The table of scores, its first row the heading.
    args
        Arguments of the command.
    """
    shown = shown_run(columns)
    sections = [
        Section(
            "Scores",
            (reading_of(columns), *_how_to_read(columns)),
            table=table,
        ),
        Section(
            "A real recording: two boats, one marine radar",
            (
                "Autoferry, scenario 16: a small ferry watches two instrumented leisure boats "
                "among moored boats, quays and other traffic. The tracker gets ranges and "
                "azimuths, nothing else, and starts its tracks by itself.",
            ),
            pictures=[_recording_picture(recording, played[AUTOFERRY])],
        ),
        Section(
            "Two crossing targets, radar cross section off and on",
            (
                "A fighter and a cargo aircraft meet, turn beside each other and part again "
                "(Tchamova, Semerdjiev, Konstantinova and Dezert 2004, chapter 14, scenario 1). "
                "Positions alone do not tell which is which after the turn; the radar cross "
                "section (RCS) may. Both methods see the same detections.",
            ),
            pictures=[
                _crossing_picture(played, columns, shown),
                _purity_picture(columns),
            ],
        ),
        Section(
            "What the radar cross section says",
            pictures=_attribute_pictures(played[ON], shown),
        ),
        Section(
            "Latency of the four processes",
            pictures=[_latency_picture(columns)],
        ),
        Section(
            "How this was made",
            ("The whole report again:",),
            code=f"gda-tracker demo --runs {args.runs} --seed {args.seed}",
            facts=_facts(recording, played),
        ),
    ]
    lead = (
        "Scans through four ROS 2 nodes in four processes (track_manager, rcs_fuzzifier, "
        "attribute_fusion, association), scored against the truth, with all topics recorded."
    )
    page = render("gda_tracker demo", lead, sections)
    path.write_text(page, encoding="utf-8")


def shown_run(columns: Mapping[str, Summary]) -> int:
    """Run in which the RCS changes purity most for the better; of equal ones the first."""
    on, off = columns[ON].purity, columns[OFF].purity
    if on is None or off is None:
        raise ValueError("the crossing targets have no purity")
    return int(np.argmax(on - off))


def crossing_figure(played: Mapping[str, Played], columns: Mapping[str, Summary], run: int) -> Any:
    """Draw one run of the crossing targets, RCS off beside RCS on."""
    panels, play = {}, played[ON].part.plays[run]
    for name, title in ((OFF, "RCS off"), (ON, "RCS on")):
        purity = columns[name].purity
        assert purity is not None
        panels[f"{title}: purity {purity[run]:.2f}"] = played[name].runs[run].tracks
    return association_maps(panels, play.detections, play.truth or [], axis_names=COMPASS)


def _how_to_read(columns: Mapping[str, Summary]) -> list[str]:
    boats, crossing = columns[AUTOFERRY], columns[ON]
    return [
        "Track purity: share of scans on which a track took the detection of the target it was "
        "started on, mean over tracks and runs, +- standard error; n/a where nobody knows whose a "
        "detection is. One run's purity scatters by about 0.27, so compare methods by the paired "
        "difference. Completeness: share of true positions with a confirmed track within "
        f"{boats.match_distance_m:.0f} m (boats) or {crossing.match_distance_m:.0f} m (aircraft, "
        "three standard deviations of a measured position). Identity switches: changes of the "
        "track that follows a target, counted when they last three scans. Latency: from the "
        "arrival of a scan at the track manager to its tracks, over the topics of four processes."
    ]


def _recording_picture(recording: Recording, result: Played) -> Picture:
    run = result.runs[0]
    seconds = (recording.detections[-1].stamp_ns - recording.detections[0].stamp_ns) / 1e9
    title = f"Autoferry scenario 16: {len(recording.detections)} scans in {seconds:.0f} s"
    figure = track_map(
        recording.detections,
        run.tracks,
        run.truth,
        match_distance_m=result.part.match_distance_m,
        axis_names=COMPASS,
        title=title,
    )
    return Picture(
        "Tracks over detections",
        "Wide bands are the boats' own satellite positions, lines the tracks; the number stands "
        "where a track begins, so that a new number on a band is a lost and newly started track. "
        "Radar returns come from hulls and the truth from antennas, which explains a constant "
        "offset of some metres. Grey tracks follow moored boats, quays or other traffic, which "
        "have no truth; a long straight one is likely a ghost, confirmed by two or three echoes "
        "that do not belong together, that ran on without detections until it was deleted. The "
        "picture shows the area around the two boats; x is East, y North of the local origin.",
        png(figure),
    )


def _crossing_picture(
    played: Mapping[str, Played], columns: Mapping[str, Summary], run: int
) -> Picture:
    return Picture(
        f"Run {run} of the crossing targets",
        "Wide bands are the true paths, flown from left to right. A track keeps the colour of the "
        "target it was started on: blue on the orange band, or orange on the blue one, is a swap, "
        "and every cross is a detection taken from the other target. Of all runs it is the one in "
        "which the RCS helps most; the next picture shows all of them.",
        png(crossing_figure(played, columns, run)),
    )


def _purity_picture(columns: Mapping[str, Summary]) -> Picture:
    off, on = columns[OFF], columns[ON]
    assert off.purity is not None
    assert on.purity is not None
    figure = paired_purity(
        (f"RCS off ({off.method})", off.purity.tolist()),
        (f"RCS on ({on.method})", on.purity.tolist()),
    )
    return Picture(
        "Purity of every run",
        "Ring and diamond over each other belong to the same simulated scans; the bar between them "
        "is what the RCS changes in that run, for better or worse. On the right the means; since "
        "the runs are paired, their difference is more certain than their error bars suggest: see "
        "the paired difference in the table.",
        png(figure),
    )


def _attribute_pictures(result: Played, shown: int) -> list[Picture]:
    tables = stage_parameters(result.part.parameters)
    tracks = [run.tracks for run in result.runs]
    names = list(target_names(result.runs[0].truth).values())
    # The labelled scans come before the first scan that is tracked.
    initial = result.part.plays[0].initial
    first_scan = 1 + int(initial.hits.max()) if initial is not None else 1
    beliefs = class_beliefs(tracks, names, shown=shown, first_scan=first_scan)
    entropies = pignistic_entropies(tracks, names, first_scan=first_scan)
    return [
        Picture(
            "From a radar cross section to a belief",
            "Left: the membership functions, histograms of simulated draws of each class. Right: "
            "what one detection of this RCS says, its three masses, which add up to one. The "
            "classes overlap widely: one detection says little, a history says more.",
            png(membership_functions(RcsFuzzifier(tables["rcs_fuzzifier"]))),
        ),
        Picture(
            "Class belief over time",
            f"Strong lines are run {shown}, pale ones the others. The classic DSm rule decides "
            "the class by projecting the history onto exclusive classes. Early the right class "
            "leads; then conflict piles up in the intersections, which the projection turns into "
            "ignorance, and the belief drifts to indifference. The attribute still helps "
            "association at the crossing, because there the histories themselves are compared, "
            "not the projected classes.",
            png(beliefs),
        ),
        Picture(
            "Pignistic entropy in both frames",
            "As in figure 14.8 of the 2004 chapter. Above, in the frame of sizes whose elements "
            "may overlap, histories become more and more specific: entropy falls. Below, after "
            "the hybrid projection onto exclusive classes, what has become contradictory turns "
            "into uncertainty: entropy rises towards its maximum.",
            png(entropies),
        ),
    ]


def _latency_picture(columns: Mapping[str, Summary]) -> Picture:
    titles = {
        AUTOFERRY: "Autoferry 16",
        OFF: "Crossing targets, RCS off",
        ON: "Crossing targets, RCS on",
    }
    series = {titles[name]: column.latency_ms.tolist() for name, column in columns.items()}
    return Picture(
        "Latency per scan",
        "Time from the arrival of a scan at the track manager to its tracks: four processes, six "
        "messages over DDS, the computation of all stages, and whatever else this machine does at "
        "the same time. One scan is on its way at a time.",
        png(latency_histograms(series)),
    )


def _facts(recording: Recording, played: Mapping[str, Played]) -> list[Facts]:
    facts = [
        Facts(
            "Data",
            {
                "Recording": recording.origin,
                "Preset": f"{recording.preset_name} (params/presets)",
                "Scenario": f"{SCENARIO} (params/scenarios)",
            },
        ),
        Facts("Versions", versions()),
    ]
    for result in played.values():
        used = {"method": result.part.method}
        for node, parameters in stage_parameters(result.part.parameters).items():
            for item in fields(parameters):
                used[f"{node}.{item.name}"] = getattr(parameters, item.name)
        facts.append(Facts(f"Parameters: {result.part.title}", used, folded=True))
        facts.append(
            Facts(f"Recorded messages: {result.part.title}", dict(result.recorded), folded=True)
        )
    return facts


def versions() -> dict[str, str]:
    """Versions of what the figures of the report depend on."""
    found = {"gda_tracker": __version__, "Python": platform.python_version()}
    for name, package in (
        ("numpy", "numpy"),
        ("scipy", "scipy"),
        ("matplotlib", "matplotlib"),
        ("rosbags", "rosbags"),
        ("rclpy", "ros-jazzy-rclpy"),
    ):
        try:
            found[name] = metadata.version(package)
        except metadata.PackageNotFoundError:
            # A ROS installation brings rclpy without a distribution of this name.
            found[name] = "from the system"
    return {**found, "System": f"{platform.system()} {platform.machine()}"}
