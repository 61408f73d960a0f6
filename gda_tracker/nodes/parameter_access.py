"""The parameters of a running system: found, read and changed through the services of its nodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python

from gda_tracker.errors import UserError
from gda_tracker.io.parameter_files import known_tables
from gda_tracker.nodes.inquirer import Inquirer, NodeName, Question
from gda_tracker.nodes.runner import STAGES
from gda_tracker.parameters import Specification, specifications

ANSWER_TIMEOUT_S = 10.0

_TYPES = {
    bool: (Parameter.Type.BOOL, Parameter.Type.BOOL_ARRAY),
    int: (Parameter.Type.INTEGER, Parameter.Type.INTEGER_ARRAY),
    float: (Parameter.Type.DOUBLE, Parameter.Type.DOUBLE_ARRAY),
    str: (Parameter.Type.STRING, Parameter.Type.STRING_ARRAY),
}


@dataclass(frozen=True)
class RunningNode:
    """A node whose parameters can be asked: its name in the graph and its table."""

    address: NodeName
    table: type

    @property
    def name(self) -> str:
        """Name without the namespace, by which parameter files know it."""
        return self.address.name


def find_nodes(inquirer: Inquirer, namespace: str | None, wait_s: float) -> dict[str, RunningNode]:
    """Return the nodes that have a parameter table, by name, in the order of the ring.

    Parameters
    ----------
    namespace
        Only those in this namespace; ``None`` for the only one in which there are any.
    wait_s
        How long to look for the four nodes of the ring; fewer are taken after that.

    Raises
    ------
    UserError
        If there is none, there are rings in several namespaces, or a node is there twice.
    """
    wanted = None if namespace is None else "/" + namespace.strip("/")
    tables = known_tables()

    def ours(names: Iterable[NodeName]) -> list[NodeName]:
        return [n for n in names if n.name in tables and wanted in (None, n.namespace)]

    inquirer.wait_for(lambda names: set(STAGES) <= {n.name for n in ours(names)}, wait_s)
    found = ours(inquirer.names())
    if not found:
        where = f" in namespace {wanted}" if wanted else ""
        raise UserError(
            f"no node of the tracker found{where} in ROS domain {inquirer.domain} within "
            f"{wait_s:g} s; gda-tracker doctor looks for the reason"
        )
    spaces = sorted({n.namespace for n in found})
    if len(spaces) > 1:
        raise UserError(
            f"trackers in several namespaces: {', '.join(spaces)}; name one with --namespace"
        )
    twice = sorted({str(n) for n in found if found.count(n) > 1})
    if twice:
        raise UserError(
            f"{', '.join(twice)} is there twice, and either might answer; stop one of them"
        )
    by_name = {n.name: n for n in found}
    return {
        name: RunningNode(by_name[name], table) for name, table in tables.items() if name in by_name
    }


def read_parameters(inquirer: Inquirer, nodes: Iterable[RunningNode]) -> dict[str, dict[str, Any]]:
    """Return the values of all parameters, ``{node: {name: value}}``.

    A parameter that a node does not know, of another version of the tracker, is left out.

    Raises
    ------
    UserError
        If a node does not answer.
    """
    nodes = list(nodes)
    questions = [
        Question(
            GetParameters,
            f"{node.address}/get_parameters",
            GetParameters.Request(names=list(specifications(node.table))),
        )
        for node in nodes
    ]
    values = {}
    for node, answer in zip(nodes, inquirer.ask(questions, ANSWER_TIMEOUT_S), strict=True):
        if answer is None:
            raise _silent(node)
        declared = specifications(node.table)
        if len(answer.values) != len(declared):
            raise UserError(f"{node.address} knows other parameters: it is of another version")
        values[node.name] = {
            name: _plain(item, parameter_value_to_python(value))
            for (name, item), value in zip(declared.items(), answer.values, strict=True)
        }
    return values


def change_parameters(inquirer: Inquirer, node: RunningNode, values: Mapping[str, Any]) -> str:
    """Set parameters of one node, all or none; return the reason if it refuses, else nothing.

    Raises
    ------
    UserError
        If the node does not answer.
    """
    declared = specifications(node.table)
    request = SetParametersAtomically.Request(
        parameters=[
            Parameter(name, _ros_type(declared[name]), value).to_parameter_msg()
            for name, value in values.items()
        ]
    )
    service = f"{node.address}/set_parameters_atomically"
    question = Question(SetParametersAtomically, service, request)
    (answer,) = inquirer.ask([question], ANSWER_TIMEOUT_S)
    if answer is None:
        raise _silent(node)
    return "" if answer.result.successful else str(answer.result.reason or "refused")


def _ros_type(item: Specification) -> Any:
    return _TYPES[item.element_kind][item.is_list]


def _plain(item: Specification, value: Any) -> Any:
    """Return the value of a service as the table has it: lists for arrays, also for empty ones."""
    return list(value or ()) if item.is_list else value


def _silent(node: RunningNode) -> UserError:
    return UserError(
        f"{node.address} does not answer within {ANSWER_TIMEOUT_S:g} s; gda-tracker doctor looks "
        "for the reason"
    )
