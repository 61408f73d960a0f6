"""The nodes that ``gda-tracker run`` can start beside the ring."""

from importlib import import_module

import pytest
from rclpy.node import Node

from gda_tracker.commands.run_nodes import BESIDE, NodeBeside
from gda_tracker.io.parameter_files import known_tables


@pytest.mark.parametrize("beside", BESIDE, ids=lambda beside: beside.name)
def test_a_node_beside_the_ring_has_its_class_and_its_parameters(beside: NodeBeside) -> None:
    maker = getattr(import_module(f"gda_tracker.nodes.{beside.name}"), beside.maker)
    assert issubclass(maker, Node)
    assert beside.name in known_tables()
