"""Design of the next campaign: find the best tests to run, and forecast their results."""

from ldbb_bayes.analysis.design.campaign_design import design
from ldbb_bayes.analysis.design.costs import Costs, minutes_of
from ldbb_bayes.analysis.design.criteria import Criterion, Determinant, LogBayesFactor, Variance
from ldbb_bayes.analysis.design.design_result import (
    Certificate,
    Design,
    Judged,
    Limits,
    read_design,
)
from ldbb_bayes.analysis.design.discrimination import Discrimination
from ldbb_bayes.analysis.design.forecast import Expected, Forecast, forecast_plan
from ldbb_bayes.analysis.design.goal_design_result import GoalDesign, GoalPlan
from ldbb_bayes.analysis.design.goals import Goal, goals_in
from ldbb_bayes.analysis.design.model_odds import ModelSoFar
from ldbb_bayes.analysis.design.next_circle import NextCircle, next_circle
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.search import efficient_rounding, exchange
from ldbb_bayes.analysis.design.shares import Optimum, certificate, optimal_shares

__all__ = [
    "Certificate",
    "Costs",
    "Criterion",
    "Design",
    "Determinant",
    "Discrimination",
    "Expected",
    "Forecast",
    "Goal",
    "GoalDesign",
    "GoalPlan",
    "Judged",
    "Limits",
    "LogBayesFactor",
    "ModelSoFar",
    "NextCircle",
    "Objective",
    "Optimum",
    "Variance",
    "certificate",
    "design",
    "efficient_rounding",
    "exchange",
    "forecast_plan",
    "goals_in",
    "minutes_of",
    "next_circle",
    "optimal_shares",
    "read_design",
]
