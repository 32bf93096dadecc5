"""Scenes with known truth, seen through simulated water by a simulated rig."""

from uw_recon_ros.simulate.course import CourseParams
from uw_recon_ros.simulate.dive import Dive, SimulatedFrame
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.survey_dive import SurveyDive
from uw_recon_ros.simulate.write import simulate, simulate_survey

__all__ = ["CourseParams", "Dive", "SimulateParams", "SimulatedFrame", "SurveyDive", "simulate", "simulate_survey"]
