"""The report of a search: what it found, what that is worth on data it has not seen, and why."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gda_tracker import __version__
from gda_tracker.evaluation.figures import png
from gda_tracker.evaluation.report import Facts, Picture, Section, render
from gda_tracker.tuning.comparison import Comparison
from gda_tracker.tuning.objectives import Objective, pareto_front
from gda_tracker.tuning.pictures import course, importance_bars, parameter_slices, trade_off
from gda_tracker.tuning.scores import CaseScore, measures
from gda_tracker.tuning.search import Found, Outcome, Problem

if TYPE_CHECKING:
    from optuna.study import Study

# Fewer trials tell nothing of what matters.
ENOUGH_TRIALS = 20
BEST_SHOWN = 10
MOST_NAMED = 4
TITLES = {
    "gospa_m": "GOSPA [m]",
    "localisation_m": "of it localisation [m]",
    "missed_m": "of it missed [m]",
    "false_m": "of it false [m]",
    "gospa_every_track_m": "GOSPA of every track [m]",
    "completeness": "completeness",
    "purity": "purity",
    "switches": "identity switches",
    "false_tracks": "false tracks",
    "confirmed_tracks": "confirmed tracks",
    "delay_s": "extraction delay [s]",
    "not_extracted": "targets never found",
    "position_error_m": "position error [m RMS]",
}


@dataclass(frozen=True)
class Result:
    """Everything a search has come to; ``chosen`` is ``None`` if nothing beat the default."""

    problem: Problem
    found: Found
    chosen: Outcome | None
    comparison: Comparison | None
    importances: Mapping[str, Mapping[str, float]]
    command: str

    @property
    def winner(self) -> Outcome:
        """What the parameter file holds: the chosen trial, or the default."""
        return self.chosen or self.found.baseline

    @property
    def statements(self) -> list[str]:
        """What the user must know of the result, for report and parameter file."""
        told = ", ".join(
            f"{o.title} {o.format(before)} -> {o.format(after)}"
            for o, before, after in zip(
                self.problem.objectives,
                self.found.baseline.values,
                self.winner.values,
                strict=True,
            )
        )
        names = _named([case.name for case in self.problem.cases])
        count = len(self.found.trials)
        if self.chosen is None:
            lines = [
                f"None of {count} trials is better than the default on {names} ({told}). These "
                "are the default parameters."
            ]
        else:
            lines = [
                f"Trial {self.chosen.number} of {count}, the best on {names}: {told}. A search "
                "always finds something on the data it looks at; what counts is other data."
            ]
        if self.comparison is None:
            lines.append(
                "No recording was held back (--held-back), so what it does on other data is not "
                "known."
            )
        else:
            lines.append(self.comparison.verdict)
        return lines


def importances(
    study: Study, problem: Problem, found: Found, trials: int = ENOUGH_TRIALS
) -> dict[str, dict[str, float]]:
    """Share of each parameter in what tells the best trials from the rest, by objective.

    PED-ANOVA (Watanabe, Bansal and Hutter 2023); empty with fewer than ``trials`` trials, and for
    an objective that all trials reach alike.
    """
    if len(found.trials) < trials:
        return {}
    import optuna

    told: dict[str, dict[str, float]] = {}
    for place, objective in enumerate(problem.objectives):
        if len({trial.values[place] for trial in found.trials}) < 2:
            continue
        with warnings.catch_warnings():
            # It reminds of the direction, which the target below respects.
            warnings.simplefilter("ignore", UserWarning)
            shares = optuna.importance.get_param_importances(
                study,
                evaluator=optuna.importance.PedAnovaImportanceEvaluator(),
                target=_target(place, objective),
            )
        told[objective.title] = {name: float(share) for name, share in shares.items()}
    return told


def _target(place: int, objective: Objective) -> Any:
    """Small is good, whatever the objective."""
    return lambda trial: objective.sign * trial.values[place]


def pictures(result: Result) -> dict[str, Picture]:
    """Pictures by the name of their file."""
    found, problem = result.found, result.problem
    first = problem.objectives[0]
    drawn: dict[str, Picture] = {}
    if not found.trials:
        return drawn
    if len(problem.objectives) > 1:
        drawn["trade_off"] = Picture(
            "Trade-off",
            "Each point is a trial. The line joins those that no other one matches in everything "
            "and beats in something (Pareto front). The worst few are left out.",
            png(trade_off(found, problem.objectives, result.chosen)),
        )
    else:
        drawn["course"] = Picture(
            "Course of the search",
            "Each point is a trial; the worst few are left out.",
            png(course(found, first, result.chosen)),
        )
    if result.importances:
        drawn["importances"] = Picture(
            "What mattered",
            "Share of each parameter in what tells the best tenth of the trials from the rest "
            "(PED-ANOVA). Where it is small, leave the default.",
            png(importance_bars(result.importances)),
        )
    drawn["parameters"] = Picture(
        "Each parameter by itself",
        f"{first.title} of every trial over the values it was searched in. A flat cloud: it does "
        "not matter here. A best value at the edge: search farther.",
        png(parameter_slices(found, problem.space, first, result.chosen)),
    )
    return drawn


def report(result: Result, drawn: Mapping[str, Picture], yaml: str) -> str:
    """Return the HTML page."""
    sections = [
        Section("Result", result.statements, _values_table(result), facts=[_changes(result)])
    ]
    comparison = result.comparison
    if comparison is not None:
        sections.append(
            Section(
                "On recordings held back",
                ["The search has not seen these. Both columns are of the same scans."],
                comparison_table(comparison.default, comparison.tuned),
            )
        )
        if len(comparison.default) > 1:
            sections.append(
                Section("One by one", [], _by_case(comparison, result.problem.objectives))
            )
    overview = [drawn[name] for name in ("trade_off", "course") if name in drawn]
    sections.append(
        Section(
            "The search",
            [_told(result)],
            _best_table(result),
            pictures=overview,
            facts=_failed(result.found),
        )
    )
    rest = [drawn[name] for name in ("importances", "parameters") if name in drawn]
    note = "" if result.importances else f"With {ENOUGH_TRIALS} trials it says what mattered. "
    sections.append(Section("Parameters", [note] if note else [], pictures=rest))
    sections.append(Section("The parameter file", code=yaml))
    sections.append(
        Section(
            "How this was made",
            ["The same command makes the same trials again, whatever the number of workers."],
            code=result.command,
            facts=[Facts("", {"gda_tracker": __version__})],
        )
    )
    lead = "Parameters searched on recordings with known truth, and checked on others."
    return render("gda_tracker tune", lead, sections)


def comparison_table(default: Sequence[CaseScore], tuned: Sequence[CaseScore]) -> list[list[str]]:
    """Rows of all measures: default, tuned, difference."""
    return measures_table(measures(default), measures(tuned))


def measures_table(
    before: Mapping[str, float | None], after: Mapping[str, float | None]
) -> list[list[str]]:
    """Rows of two tables of measures and their difference."""
    rows = [["", "default", "tuned", "difference"]]
    for name, title in TITLES.items():
        first, second = before[name], after[name]
        if first is not None and second is not None:
            rows.append([title, f"{first:.3f}", f"{second:.3f}", f"{second - first:+.3f}"])
    return rows


def _named(names: Sequence[str]) -> str:
    """The names, or the first of many and how many more."""
    if len(names) <= MOST_NAMED:
        return ", ".join(names)
    return f"{names[0]} and {len(names) - 1} more"


def _values_table(result: Result) -> list[list[str]]:
    return measures_table(result.found.baseline.measures, result.winner.measures)


def _changes(result: Result) -> Facts:
    winner, base = result.winner.point, result.found.baseline.point
    values = {
        item.name: f"{_number(base[item.name])} -> {_number(winner[item.name])}"
        for item in result.problem.space
    }
    return Facts("Default and tuned values:", values)


def _by_case(comparison: Comparison, objectives: Sequence[Objective]) -> list[list[str]]:
    rows = [["recording", *(f"{o.title}, default -> tuned" for o in objectives)]]
    for first, second in zip(comparison.default, comparison.tuned, strict=True):
        before, after = measures([first]), measures([second])
        cells = [first.name]
        for objective in objectives:
            pair = before[objective.measure], after[objective.measure]
            cells.append(" -> ".join("?" if v is None else objective.format(v) for v in pair))
        rows.append(cells)
    return rows


def _told(result: Result) -> str:
    objectives = ", ".join(objective.title for objective in result.problem.objectives)
    text = (
        f"{len(result.found.trials)} trials by {objectives}, seed {result.problem.seed}, on "
        f"{len(result.problem.cases)} recordings."
    )
    if len(result.problem.objectives) > 1:
        text += (
            " The table lists the trials that nothing beats. Chosen is the one best in the first "
            "objective among those not worse than the default in any; another one may suit you "
            "better: --pick TRIAL writes its parameters."
        )
    return text


def _best_table(result: Result) -> list[list[str]]:
    objectives, trials = result.problem.objectives, result.found.trials
    if not trials:
        return []
    if len(objectives) > 1:
        best = pareto_front(objectives, [trial.values for trial in trials])
    else:
        best = list(range(len(trials)))
    best.sort(
        key=lambda row: [o.sign * v for o, v in zip(objectives, trials[row].values, strict=True)]
    )
    names = [item.name for item in result.problem.space]
    rows = [["trial", *(o.title for o in objectives), *names]]
    shown = [trials[row] for row in best[:BEST_SHOWN]]
    for title, trial in [("default", result.found.baseline), *((str(t.number), t) for t in shown)]:
        values = [o.format(v) for o, v in zip(objectives, trial.values, strict=True)]
        rows.append([title, *values, *(_number(trial.point[name]) for name in names)])
    return rows


def _failed(found: Found) -> list[Facts]:
    if not found.failed:
        return []
    values = {
        f"trial {number}": f"{reason} ("
        + ", ".join(f"{name} {_number(value)}" for name, value in point.items())
        + ")"
        for number, point, reason in found.failed
    }
    return [Facts(f"{len(found.failed)} trials failed", values, folded=True)]


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
