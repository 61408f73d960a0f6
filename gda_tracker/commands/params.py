"""``gda-tracker params``: the parameters of a running tracker."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gda_tracker.commands.options import RADAR_INPUT
from gda_tracker.errors import UserError
from gda_tracker.io.parameter_files import (
    check_parameters,
    known_tables,
    parameter_yaml,
    read_yaml,
    yaml_value,
)
from gda_tracker.parameters import ParameterError, Specification, from_mapping, specifications
from gda_tracker.tracking.ring import STAGE_TABLES

if TYPE_CHECKING:
    from gda_tracker.nodes.inquirer import Inquirer
    from gda_tracker.nodes.parameter_access import RunningNode

REFUSED_EXIT_CODE = 1
# Begins a file that may be written anew.
SAVED = "# Parameters of a running tracker, saved by gda-tracker params save."

Values = dict[str, dict[str, Any]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("action", choices=("list", "get", "set", "save"), help="what to do")
    parser.add_argument(
        "what",
        nargs="*",
        metavar="NAME | NAME=VALUE | FILE",
        help="get: names; set: name=value, several at once; save: the file. A name that several "
        "nodes have is written node.name; else it is that of the tracker, not of a node beside it",
    )
    parser.add_argument("--node", metavar="NAME", help="this node only")
    parser.add_argument(
        "--changed", action="store_true", help="list, save: only what is not the default"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--namespace", metavar="NS", help="namespace of the tracker")
    parser.add_argument("--domain", type=int, metavar="N", help="ROS domain to look in")
    parser.add_argument(
        "--wait",
        type=float,
        default=5.0,
        metavar="S",
        help="how long to look for the tracker (default: 5)",
    )


def run(args: argparse.Namespace) -> int:
    """Do it; return 1 if a node refuses a change."""
    _check_words(args)
    changes = _changes(args.what, args.node) if args.action == "set" else {}
    from gda_tracker.nodes.inquirer import Inquirer
    from gda_tracker.nodes.parameter_access import find_nodes, read_parameters

    with Inquirer("gda_tracker_params", args.domain) as inquirer:
        nodes = find_nodes(inquirer, args.namespace, args.wait)
        if args.node is not None and args.node not in nodes:
            raise UserError(f"--node {args.node}: not running; running are {', '.join(nodes)}")
        chosen = {n: node for n, node in nodes.items() if args.node in (None, n)}
        if args.action == "set":
            return _set(inquirer, nodes, changes, args.json)
        values = read_parameters(inquirer, chosen.values())
    if args.action == "get":
        _get(values, args.what, args.json)
    elif args.action == "list":
        _list(_changed_only(values) if args.changed else values, args.json)
    else:
        _save(Path(args.what[0]), _changed_only(values) if args.changed else values, values)
    return 0


def _check_words(args: argparse.Namespace) -> None:
    allowed = {"list": (0, 0, "nothing"), "save": (1, 1, "one FILE")}
    least, most, words = allowed.get(args.action, (1, sys.maxsize, "at least one NAME"))
    if not least <= len(args.what) <= most:
        raise UserError(f"{args.action} {' '.join(args.what)}".strip() + f": allowed is {words}")
    if not 0.0 < args.wait < float("inf"):
        raise UserError(f"--wait {args.wait}: allowed is a number > 0")


# --- names and values -----------------------------------------------------------------------------


def _changes(words: list[str], node: str | None) -> Values:
    """Values to set by node, each of the declared type.

    Raises
    ------
    UserError
        For a name that does not exist or stands twice, or a value that is not allowed.
    """
    changes: Values = {}
    for word in words:
        name, sign, text = word.partition("=")
        if not sign:
            raise UserError(f"{word}: allowed is name=value, e.g. gate_probability=0.999")
        owner, item = _declared(name.strip(), node)
        if not item.live:
            raise ParameterError(
                f"parameter {item.name} of {owner} is fixed at start-up: stop the tracker, write "
                "the value into its parameter file, start it again"
            )
        values = changes.setdefault(owner, {})
        if item.name in values:
            raise UserError(f"{word}: {item.name} stands there twice")
        values[item.name] = item.check(_value(text.strip(), item))
    return changes


def _declared(name: str, node: str | None, known: Any = None) -> tuple[str, Specification]:
    """The node and declaration of ``name`` or ``node.name``."""
    tables = {
        n: specifications(t) for n, t in known_tables().items() if known is None or n in known
    }
    prefix, dot, rest = name.partition(".")
    if dot and prefix in tables:
        node, name = prefix, rest
    if node is not None and node not in tables:
        raise UserError(f"node {node}: unknown; known are {', '.join(tables)}")
    owners = [n for n, items in tables.items() if name in items and node in (None, n)]
    # The tracker itself before what may run beside it.
    owners = [n for n in owners if n in STAGE_TABLES or n == RADAR_INPUT] or owners
    if not owners:
        every = {n: None for m, items in tables.items() if node in (None, m) for n in items}
        import difflib

        close = difflib.get_close_matches(name, every, n=1)
        hint = f", did you mean {close[0]}?" if close else "; gda-tracker params list names all"
        raise ParameterError(f"parameter {name}: unknown{hint}")
    if len(owners) > 1:
        raise UserError(
            f"{name} is a parameter of {' and '.join(owners)}: write {owners[0]}.{name}"
        )
    return owners[0], tables[owners[0]][name]


def _value(text: str, item: Specification) -> Any:
    """The value that a word of the command line means."""
    if item.element_kind is str and not item.is_list:
        return text
    value = read_yaml(text, item.name)
    if item.is_list and not isinstance(value, list):
        value = [value] if text else []
    return value


def _changed_only(values: Values) -> Values:
    tables = known_tables()
    return {
        node: {
            name: value
            for name, value in of_node.items()
            if value != specifications(tables[node])[name].default
        }
        for node, of_node in values.items()
    }


# --- set ------------------------------------------------------------------------------------------


def _set(
    inquirer: Inquirer,
    nodes: Mapping[str, RunningNode],
    changes: Values,
    as_json: bool,
) -> int:
    """Change node after node; a change that any table refuses changes none of them."""
    from gda_tracker.nodes.parameter_access import change_parameters, read_parameters

    missing = [node for node in changes if node not in nodes]
    if missing:
        raise UserError(f"{', '.join(missing)}: not running; running are {', '.join(nodes)}")
    before = read_parameters(inquirer, [nodes[node] for node in changes])
    for node, values in changes.items():
        # What does not go together is known before the first node is asked.
        from_mapping(nodes[node].table, {**before[node], **values})
    told = []
    refused = False
    for node, values in changes.items():
        reason = "" if refused else change_parameters(inquirer, nodes[node], values)
        told.append((node, values, reason, refused))
        refused = refused or bool(reason)
    if as_json:
        print(json.dumps(_set_record(told, before), indent=2))
        return REFUSED_EXIT_CODE if refused else 0
    for node, values, reason, skipped in told:
        if reason or skipped:
            print(f"{node}: not changed, {reason or 'since the other node has refused'}")
            continue
        for name, value in values.items():
            print(f"{node}: {name} {_short(before[node][name])} -> {_short(value)}")
    if not refused:
        print("acts at the next scan")
    return REFUSED_EXIT_CODE if refused else 0


def _set_record(
    told: list[tuple[str, dict[str, Any], str, bool]], before: Values
) -> list[dict[str, Any]]:
    return [
        {
            "node": node,
            "parameter": name,
            "before": before[node][name],
            "value": before[node][name] if reason or skipped else value,
            "asked": value,
            "set": not (reason or skipped),
            "reason": reason or ("another node has refused" if skipped else ""),
        }
        for node, values, reason, skipped in told
        for name, value in values.items()
    ]


# --- get, list, save ------------------------------------------------------------------------------


def _get(values: Values, names: list[str], as_json: bool) -> None:
    found = {}
    for name in names:
        node, item = _declared(name, None, values)
        found[f"{node}.{item.name}"] = (values[node][item.name], item)
    if as_json:
        print(json.dumps({name: value for name, (value, _) in found.items()}, indent=2))
    elif len(found) == 1:
        ((value, item),) = found.values()
        print(_short(value) if item.element_kind is str else yaml_value(value, item.element_kind))
    else:
        for name, (value, item) in found.items():
            print(f"{name} = {yaml_value(value, item.element_kind)}")


def _list(values: Values, as_json: bool) -> None:
    tables = known_tables()
    if as_json:
        rows = [
            _record(node, specifications(tables[node])[name], value)
            for node, of_node in values.items()
            for name, value in of_node.items()
        ]
        print(json.dumps(rows, indent=2))
        return
    width = max(shutil.get_terminal_size((110, 24)).columns - 1, 60)
    for node, of_node in values.items():
        print(f"{node}" + ("" if of_node else ": all defaults"))
        for name, value in of_node.items():
            item = specifications(tables[node])[name]
            now = f"  {name} = {_short(value)}"
            now += "" if value == item.default else f"   (default {_short(item.default)})"
            print(now)
            live = "live" if item.live else "fixed at start-up"
            about = f"{item.description}. Allowed: {item.allowed}. {live}"
            for line in textwrap.wrap(about, width - 6, break_on_hyphens=False):
                print(f"      {line}")


def _record(node: str, item: Specification, value: Any) -> dict[str, Any]:
    return {
        "node": node,
        "parameter": item.name,
        "value": value,
        "default": item.default,
        "unit": item.unit,
        "minimum": item.minimum,
        "maximum": item.maximum,
        "minimum_excluded": item.minimum_excluded,
        "choices": list(item.choices),
        "allowed": item.allowed,
        "live": item.live,
        "advanced": item.advanced,
        "description": item.description,
    }


def _save(path: Path, values: Values, complete: Values) -> None:
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(SAVED):
        raise UserError(
            f"save {path}: there is a file that params save did not write; name another one"
        )
    tables = {node: table for node, table in known_tables().items() if node in values}
    text = f"{SAVED}\n\n"
    if values == complete:
        text += parameter_yaml(tables, None, values)
    else:
        for node, of_node in values.items():
            if of_node:
                text += f"/**/{node}:\n  ros__parameters:\n"
            for name, value in of_node.items():
                kind = specifications(tables[node])[name].element_kind
                text += f"    {name}: {yaml_value(value, kind)}\n"
    if any(values.values()):
        # What cannot be loaded must not be taken for saved.
        check_parameters(read_yaml(text, str(path)), tables, str(path))
        path.write_text(text, encoding="utf-8")
        count = sum(len(of_node) for of_node in values.values())
        print(f"{count} parameters of {', '.join(values)}: {path}")
        print(f"next: gda-tracker run --params {path}")
    else:
        raise UserError(f"save {path}: nothing to save, all parameters have their defaults")


def _short(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(str(each) for each in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return "(empty)" if value == "" else str(value)
