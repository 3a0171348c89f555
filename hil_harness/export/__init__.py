"""Trajectories for other tools: MCAP for ROS 2 and Foxglove, TUM for evo."""

from hil_harness.export.mcap_file import write_mcap
from hil_harness.export.trajectories import Trajectory, logged_trajectories, with_truth
from hil_harness.export.tum import tum_text

__all__ = ["Trajectory", "logged_trajectories", "tum_text", "with_truth", "write_mcap"]
