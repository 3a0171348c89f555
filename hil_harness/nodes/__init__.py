"""What sits on the bus in a run: the plant, the firmware, and the protocol that all nodes share."""

from hil_harness.nodes.firmware import FirmwareNode, Inputs, firmware_config
from hil_harness.nodes.plant import PlantNode
from hil_harness.nodes.protocol import Node, TriggeredNode

__all__ = ["FirmwareNode", "Inputs", "Node", "PlantNode", "TriggeredNode", "firmware_config"]
