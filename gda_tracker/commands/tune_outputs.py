"""What ``gda-tracker tune`` writes: parameter file, report, pictures, numbers, a summary."""

from __future__ import annotations

import argparse
import json
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gda_tracker.commands.options import RADAR_INPUT, Parameters, radar_input_of_file
from gda_tracker.io.parameter_files import PARAMETERS, known_tables, read_preset, yaml_value
from gda_tracker.parameters import specifications
from gda_tracker.tuning.report import Result, comparison_table, pictures, report
from gda_tracker.tuning.search_space import Range, Values, base_value

WIDTH = 96


def with_radar(base: Parameters, args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The base with what says how the radar is read, so that the file is ready to run."""
    radar = dict(read_preset(args.preset).get(RADAR_INPUT, {})) if args.preset else {}
    radar.update(radar_input_of_file(args.params) or {})
    return {**base, RADAR_INPUT: radar} if radar else dict(base)


def write_result(result: Result, base: dict[str, dict[str, Any]], folder: Path) -> None:
    """Write report, parameters, numbers and pictures."""
    how = f"Made by: {result.command}"
    yaml = tuned_yaml(base, result.problem.space, result.winner.point, [*result.statements, how])
    drawn = pictures(result)
    for name, picture in drawn.items():
        (folder / f"{name}.png").write_bytes(picture.png)
    (folder / "tuned.yaml").write_text(yaml, encoding="utf-8")
    (folder / "report.html").write_text(report(result, drawn, yaml), encoding="utf-8")
    text = json.dumps(_numbers(result), indent=2, allow_nan=False)
    (folder / "result.json").write_text(text + "\n", encoding="utf-8")


def _numbers(result: Result) -> dict[str, Any]:
    """The result for programs."""
    comparison = result.comparison
    held_back = None
    if comparison is not None:
        held_back = {
            "beats_default": comparison.beats,
            "verdict": comparison.verdict,
            "objectives": {
                d.objective.name: {"default": d.default, "tuned": d.tuned, "interval": d.interval}
                for d in comparison.differences
            },
        }
    return {
        "statements": result.statements,
        "default": vars(result.found.baseline),
        "chosen": None if result.chosen is None else vars(result.chosen),
        "held_back": held_back,
        "importances": result.importances,
        "trials": [vars(trial) for trial in result.found.trials],
        "failed": [
            {"number": number, "point": point, "reason": reason}
            for number, point, reason in result.found.failed
        ],
        "command": result.command,
    }


def tell_result(result: Result, folder: Path) -> None:
    """Print the result."""
    for line in result.statements:
        print(line)
    if result.comparison is not None:
        rows = comparison_table(result.comparison.default, result.comparison.tuned)
        print("\nheld back                  " + "".join(f"{cell:>12}" for cell in rows[0][1:]))
        for title, *cells in rows[1:]:
            print(f"{title:<27}" + "".join(f"{cell:>12}" for cell in cells))
        print()
    for number, _, reason in result.found.failed:
        print(f"trial {number} failed: {reason}")
    print(f"report: {folder / 'report.html'}")
    print(f"parameters: {folder / 'tuned.yaml'}")


def command_line(args: argparse.Namespace) -> str:
    """The command that makes the same result again."""
    words = ["gda-tracker", "tune", *args.recordings]
    for option in ("held_back", "truth", "objective", "parameter"):
        for value in getattr(args, option) or []:
            words += [f"--{option.replace('_', '-')}", str(value)]
    if args.complete_truth:
        words.append("--complete-truth")
    defaults = {"adapter": "auto", "runs": 10, "time_limit": 0.0}
    for option in (
        "trials",
        "seed",
        "runs",
        "match_distance",
        "time_limit",
        "adapter",
        "topic",
        "preset",
        "params",
        "method",
        "pick",
    ):
        value = getattr(args, option)
        if value is not None and value != defaults.get(option):
            words += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join(words)


def tuned_yaml(
    base: Values, space: Sequence[Range], point: Mapping[str, Any], statements: Sequence[str]
) -> str:
    """Return a parameter file for ``--params``, of everything that differs from the defaults.

    Parameters
    ----------
    base
        Parameters under the tuned ones; a ``radar_input`` section is kept.
    space, point
        What was searched, and the values chosen; values of the base are marked as such.
    statements
        Paragraphs of the comment at the top.
    """
    lines = [line for text in statements for line in _comment(text, "# ")]
    tuned = {(item.node, item.name): item for item in space}
    for node, table in known_tables().items():
        given = dict(base.get(node, {}))
        given.update({name: point[name] for at, name in tuned if at == node and name in point})
        if not given:
            continue
        lines += [f"/**/{node}:", f"  {PARAMETERS}:"]
        for name, specification in specifications(table).items():
            if name not in given:
                continue
            kind = specification.element_kind
            if (node, name) in tuned:
                before = yaml_value(base_value(base, node, name), kind)
                unit = f" [{specification.unit}]" if specification.unit else ""
                searched = f"Tuned: {before} before; searched {tuned[node, name]}{unit}."
                lines += _comment(searched, "    # ")
            lines.append(f"    {name}: {yaml_value(given[name], kind)}")
    return "\n".join(lines) + "\n"


def _comment(text: str, prefix: str) -> list[str]:
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=prefix,
        subsequent_indent=prefix,
        break_on_hyphens=False,
        break_long_words=False,
    )
