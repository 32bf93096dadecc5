"""Scenes with known truth, seen through simulated water by a simulated rig."""

from uw_recon_ros.simulate.dive import Dive, SimulatedFrame
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.write import simulate

__all__ = ["Dive", "SimulateParams", "SimulatedFrame", "simulate"]
