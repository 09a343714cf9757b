"""Public names of version 0.2 that have changed. Their use gives a warning until version 0.4."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = ["NEW_NAMES", "renamed_keyword", "warn_of_new_member", "warn_of_new_name"]

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

#: Public functions and classes of version 0.2 that were renamed or moved. The keys are the old
#: names and the values are the new names, both without the prefix ``lb.``, the usual short name of
#: this package.
NEW_NAMES = {
    "BallForm": "terms.BallForm",
    "BarLength": "terms.BarLength",
    "BasisNoise": "terms.BasisNoise",
    "batch": "fleet.run_batch",
    "Batch": "fleet.Batch",
    "belonging": "find_outlying_tests",
    "budgets": "analysis.budget_uncertainty",
    "Circle": "machine.Circle",
    "circularity": "analysis.predict_circularity",
    "Columns": "terms.Columns",
    "Comparison": "analysis.Comparison",
    "conformity": "assess_conformity",
    "Conformity": "analysis.Conformity",
    "contributions": "analysis.decompose_deviation",
    "control_chart": "fleet.draw_control_chart",
    "describe": "describe_machine",
    "Design": "analysis.Design",
    "differences": "analysis.compare_posteriors",
    "Discrepancy": "terms.Discrepancy",
    "Drift": "terms.Drift",
    "Evidences": "inference.Evidences",
    "exact_reading_mm": "machine.exact_reading_mm",
    "fit_in_words": "report.describe_fit",
    "ForceError": "terms.ForceError",
    "ForceLaw": "campaign.ForceLaw",
    "hybrid_jacobian": "machine.hybrid_jacobian",
    "Hysteresis": "terms.Hysteresis",
    "Identifiability": "analysis.Identifiability",
    "Imported": "reading.Imported",
    "Layout": "reading.Layout",
    "least_squares": "fit_least_squares",
    "LeastSquares": "inference.LeastSquares",
    "log_bayes_factor": "inference.log_bayes_factor",
    "LogDensity": "inference.LogDensity",
    "marginals": "inference.marginalize",
    "mask_angles": "reading.mask_angles",
    "mask_reversals": "reading.mask_reversals",
    "measured_circularity": "analysis.measure_circularity",
    "Mount": "terms.Mount",
    "MountCompensation": "campaign.MountCompensation",
    "nuisances": "inference.summarize_nuisances",
    "ParameterIdentifiability": "analysis.ParameterIdentifiability",
    "patterns": "machine.patterns",
    "population": "fleet.fit_population",
    "Population": "fleet.Population",
    "PopulationPrior": "fleet.PopulationPrior",
    "preview": "check_campaign",
    "prior_from": "fleet.read_population_prior",
    "read_batch": "fleet.read_batch",
    "read_comparison": "analysis.read_comparison",
    "read_dcc": "campaign.read_dcc",
    "read_design": "analysis.read_design",
    "read_layout": "reading.read_layout",
    "save_figures": "figures.save_figures",
    "Scale": "terms.Scale",
    "SetupShift": "terms.SetupShift",
    "StoppingRule": "inference.StoppingRule",
    "Term": "terms.Term",
    "Tolerance": "analysis.Tolerance",
    "trend": "fleet.find_trend",
    "Trend": "fleet.Trend",
    "Uncertainties": "terms.Uncertainties",
    "uncertainties": "terms.uncertainties",
    "Unit": "terms.Unit",
    "validate": "calibrate",
    "Validation": "analysis.Validation",
    "verdicts": "analysis.judge_posterior",
    "with_predictive": "inference.with_predictive",
    "with_words": "report.with_words",
    "write_dcc": "report.write_dcc",
}


def warn_of_new_name(old: str) -> None:
    """Give a FutureWarning that states the new name of a renamed or moved function or class.

    ``old`` is the public name of the function or class in version 0.2, without the prefix ``lb.``.
    """
    warnings.warn(
        f"lb.{old} is now lb.{NEW_NAMES[old]}. Use the new name: version 0.4 will not have the old"
        " one.",
        FutureWarning,
        stacklevel=3,
    )


def warn_of_new_member(old: str, new: str) -> None:
    """Give a FutureWarning that states the new name of a renamed method or attribute of a class.

    ``old`` is the name in version 0.2 after that of the class, such as Evidences.of. ``new`` is the
    new name, without that of the class.
    """
    warnings.warn(
        f"{old} is now {new}. Use the new name: version 0.4 will not have the old one.",
        FutureWarning,
        stacklevel=3,
    )


def renamed_keyword(
    old: str, new: str
) -> Callable[[Callable[_Arguments, _Result]], Callable[_Arguments, _Result]]:
    """Return a decorator that lets a function still accept the old name of a renamed argument.

    ``old`` and ``new`` are the names of the argument. A call with the old name gives a
    FutureWarning that states the new name; a call with both names raises a TypeError.
    """

    def decorate(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
        """Return a function like ``function`` that also accepts the argument's old name."""

        @wraps(function)
        def call(*arguments: _Arguments.args, **keywords: _Arguments.kwargs) -> _Result:
            """Call ``function``; an argument with the old name is passed under the new name."""
            if old in keywords:
                name = function.__qualname__.removesuffix(".__init__")
                warnings.warn(
                    f"The argument {old} of {name} is now {new}. Use the new name:"
                    " version 0.4 will not have the old one.",
                    FutureWarning,
                    stacklevel=2,
                )
                if new in keywords:
                    raise TypeError(
                        f"argument {new} of {name} must be given once, got {new} and its old name"
                        f" {old}. Leave {old} out."
                    )
                keywords[new] = keywords.pop(old)
            return function(*arguments, **keywords)

        return call

    return decorate
