"""YAML as ROS reads it, without ROS: 1e-6 is a number, and a key that occurs twice is an error."""

from __future__ import annotations

import re
from typing import Any

import yaml

from gda_tracker.parameters import ParameterError


class YamlError(ParameterError):
    """A text is not YAML; the message is one line and names its source."""


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it (1e-6 is a number); a key that occurs twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: list[Any] = []
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key} occurs twice", key_node.start_mark
                )
            seen.append(key)
        return super().construct_mapping(node, deep)


def _exponent(loader: _Loader, node: yaml.ScalarNode) -> float:
    return float(loader.construct_scalar(node))


_Loader.add_constructor("!exponent", _exponent)
_Loader.add_implicit_resolver(
    "!exponent", re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def load_yaml(text: str, source: str) -> Any:
    """Return the content of YAML as ROS reads it; ``source`` names it in errors.

    Raises
    ------
    YamlError
        If it is not YAML, or a key occurs twice.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" in line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise YamlError(f"{source}: not YAML{line}: {problem}") from error
