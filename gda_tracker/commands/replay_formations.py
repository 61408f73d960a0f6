"""Formations in ``gda-tracker replay``: a table, a line, a section of the report."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

from gda_tracker.commands.options import TRACK_FORMATIONS, node_of_file
from gda_tracker.evaluation.report import Picture, Section
from gda_tracker.formations.found import KINDS, NUMBER_CHANGED, Formations
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import from_mapping


def formation_tracker(args: argparse.Namespace) -> FormationTracker | None:
    """Return what follows the formations, with the parameters of the file; ``None``: not asked for.

    Raises
    ------
    ParameterError
        For a parameter that is not allowed.
    """
    if not args.formations:
        return None
    given = node_of_file(args.params, TRACK_FORMATIONS) or {}
    return FormationTracker(from_mapping(FormationParameters, given))


def formation_line(found: Sequence[Formations]) -> str:
    """Say what happened and what is there in the end."""
    count = Counter(event.kind for one in found for event in one.events)
    happened = ", ".join(f"{count[kind]} {kind.replace('_', ' ')}" for kind in KINDS if count[kind])
    last = ", ".join(
        f"{one.formation_id}: {one.number or '?'} ({one.expected_number:.2f})"
        for one in (found[-1].formations if found else [])
    )
    return f"formations: {happened or 'none'}; in the end, with their objects (expected): {last}"


def formation_section(found: Sequence[Formations]) -> Section:
    """Return lanes, numbers and decisions, for the report."""
    if not any(len(one) for one in found):
        return Section("Formations", ("There was no formation: no track was confirmed.",))
    from gda_tracker.evaluation.figures import png
    from gda_tracker.evaluation.figures.formations import (
        MOST_LANES,
        MOST_NUMBERS,
        formation_lanes,
        formation_numbers,
    )

    first_ns = found[0].key.stamp_ns
    rows = [["time [s]", "formation", "event", "with", "tracks", "objects", "scans"]]
    rows += [
        [
            f"{(event.stamp_ns - first_ns) / 1e9:.1f}",
            f"{event.formation_id}",
            event.kind.replace("_", " "),
            " ".join(map(str, event.other_formation_ids)),
            " ".join(map(str, event.track_ids)),
            f"{event.previous_number} -> {event.number}" if event.kind == NUMBER_CHANGED else "",
            f"{event.samples}" if event.kind == NUMBER_CHANGED else "",
        ]
        for one in found
        for event in one.events
    ]
    pictures = [
        Picture(
            "Lineage",
            f"The formations that were there longest, at most {MOST_LANES}; a lane is as wide as "
            "it has objects, as decided.",
            png(formation_lanes(found)),
        ),
        Picture(
            "Number of objects",
            f"Probability of each number, at most {MOST_NUMBERS} formations; the orange line is "
            "the number decided, the dotted one the expected number.",
            png(formation_numbers(found)),
        ),
    ]
    return Section("Formations", table=rows, pictures=pictures)
