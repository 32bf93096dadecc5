"""Scenes with known truth, seen through simulated water by a simulated rig."""

from typing import TYPE_CHECKING

from uw_recon_ros.lazy_import import on_demand

if TYPE_CHECKING:
    from uw_recon_ros.simulate.dive import Dive, SimulatedFrame
    from uw_recon_ros.simulate.params import CourseParams, SimulateParams
    from uw_recon_ros.simulate.survey_dive import SurveyDive
    from uw_recon_ros.simulate.write import simulate, simulate_survey

__all__ = ["CourseParams", "Dive", "SimulateParams", "SimulatedFrame", "SurveyDive", "simulate", "simulate_survey"]
__getattr__ = on_demand(
    __name__,
    {
        "dive": ["Dive", "SimulatedFrame"],
        "params": ["CourseParams", "SimulateParams"],
        "survey_dive": ["SurveyDive"],
        "write": ["simulate", "simulate_survey"],
    },
)
