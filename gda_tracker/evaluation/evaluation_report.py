"""The results of an evaluation as one HTML page: the tables of the command, and pictures."""

from __future__ import annotations

from collections.abc import Sequence

from gda_tracker import __version__
from gda_tracker.evaluation.figures import (
    MissingPlotLibraryError,
    consistency_course,
    paired_purity,
    png,
    require_matplotlib,
    set_distance_course,
    stated_numbers,
)
from gda_tracker.evaluation.formation_results import BINS
from gda_tracker.evaluation.report import Facts, Picture, Section, render
from gda_tracker.evaluation.results import ScenarioResult
from gda_tracker.evaluation.table import (
    format_result,
    purity_table,
    quality_notes,
    quality_tables,
)

LEAD = (
    "Simulated scenarios, tracked many times by every method on the same scans, and scored against "
    "the truth. A number after +- is the standard error of the mean."
)


def evaluation_report(results: Sequence[ScenarioResult], command: str = "") -> str:
    """Return the page.

    Parameters
    ----------
    results
        What :func:`~gda_tracker.evaluation.monte_carlo.monte_carlo` has found.
    command
        The command that makes the same results again.
    """
    sections = [section for result in results for section in _sections(result)]
    sections.append(
        Section("How this was made", code=command, facts=[Facts("", {"gda_tracker": __version__})])
    )
    return render("gda_tracker evaluate", LEAD, sections)


def _sections(result: ScenarioResult) -> list[Section]:
    name = result.scenario.name
    lead = format_result(result).splitlines()[:2]
    pictures, trouble = _pictures(result)
    if result.match_distance_m is None:
        rows = _one_heading(purity_table(result))
        return [Section(f"{name}: track purity", (*lead, *trouble), rows, pictures=pictures)]
    sections: list[Section] = []
    for (title, rows), note in zip(quality_tables(result), quality_notes(result), strict=True):
        first = not sections
        paragraphs = (*(lead if first else ()), *(trouble if first else ()), _sentence(note))
        shown = [p for p in pictures if p.title.startswith(title)]
        sections.append(Section(f"{name}: {title}", paragraphs, _one_heading(rows), pictures=shown))
    return sections


def _pictures(result: ScenarioResult) -> tuple[list[Picture], list[str]]:
    """Pictures, or none and a sentence that says why."""
    try:
        require_matplotlib()
    except MissingPlotLibraryError as error:
        return [], [_sentence(str(error))]
    methods = {m.method: m.quality for m in result.methods if m.quality is not None}
    if methods:
        calibrated = {name: q.values[BINS] for name, q in methods.items() if BINS in q.values}
        numbers = Picture(
            "Formations: stated probability of the most probable number",
            "Each point is a bin of scans, as large as it has many: the mean probability that was "
            "stated, and the share of numbers that were right. On the line both are the same.",
            png(stated_numbers(calibrated)) if calibrated else b"",
        )
        return [
            *([numbers] if calibrated else []),
            Picture(
                "Distance of confirmed tracks and targets by scan",
                "Generalised optimal sub-pattern assignment distance (GOSPA) and its parts, root "
                "of the mean square over the runs; the squares of the parts add up to that of "
                "GOSPA.",
                png(set_distance_course(methods)),
            ),
            Picture(
                "Consistency by scan",
                "Grey: 95 % bounds of the mean, if errors are as large as the covariances say. "
                "Above, the tracker is too sure of itself; below, too cautious.",
                png(consistency_course(methods)),
            ),
        ], []
    first = result.methods[0]
    return [
        Picture(
            f"{first.method} and {other.method}, run by run",
            "Ring and diamond over each other belong to the same simulated scans.",
            png(
                paired_purity(
                    (first.method, first.score.tolist()), (other.method, other.score.tolist())
                )
            ),
        )
        for other in result.methods[1:]
    ], []


def _one_heading(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Rows with the units of the second one in the heading."""
    heading = [f"{name} {unit}".strip() for name, unit in zip(rows[0], rows[1], strict=True)]
    return [heading, *[list(row) for row in rows[2:]]]


def _sentence(note: str) -> str:
    return f"{note[0].upper()}{note[1:]}."
