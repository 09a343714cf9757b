"""Bayesian uncertainty quantification for the loaded double ball bar.

import ldbb_bayes as lb
campaign = lb.read_campaign("data/recovered_experiment")
posterior = lb.sample(lb.HybridModel.default(degree=1), campaign, seed=1)
print(lb.summarize(posterior))
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "Campaign": "ldbb_bayes.campaign.campaign",
    "CircularTest": "ldbb_bayes.campaign.circular_test",
    "ForceLaw": "ldbb_bayes.campaign.loading",
    "MountCompensation": "ldbb_bayes.campaign.loading",
    "Plan": "ldbb_bayes.campaign.campaign",
    "exact_reading_mm": "ldbb_bayes.machine.forward",
    "figures": "ldbb_bayes.report",
    "hybrid_jacobian": "ldbb_bayes.machine.hybrid",
    "patterns": "ldbb_bayes.machine.hybrid",
    "least_squares": "ldbb_bayes.inference.least_squares",
    "LeastSquares": "ldbb_bayes.inference.least_squares",
    "Imported": "ldbb_bayes.tables.importing",
    "Layout": "ldbb_bayes.tables.layout",
    "import_campaign": "ldbb_bayes.tables.importing",
    "read_layout": "ldbb_bayes.tables.layout",
    "read_campaign": "ldbb_bayes.campaign.folder",
    "write_campaign": "ldbb_bayes.campaign.folder",
    "compensate_mount": "ldbb_bayes.campaign.prepare",
    "mask_angles": "ldbb_bayes.campaign.prepare",
    "mask_reversals": "ldbb_bayes.campaign.prepare",
    "trim_overshoot": "ldbb_bayes.campaign.prepare",
    "InputError": "ldbb_bayes.errors",
    "preview": "ldbb_bayes.analysis.preview",
    "Validation": "ldbb_bayes.analysis.validation",
    "validate": "ldbb_bayes.analysis.validation",
    "log_evidence": "ldbb_bayes.inference.evidence",
    "marginals": "ldbb_bayes.inference.marginals",
    "Comparison": "ldbb_bayes.analysis.compared",
    "belonging": "ldbb_bayes.analysis.belonging",
    "compare": "ldbb_bayes.analysis.comparison",
    "Costs": "ldbb_bayes.analysis.costs",
    "Design": "ldbb_bayes.analysis.designed",
    "design": "ldbb_bayes.analysis.design",
    "local_fits": "ldbb_bayes.analysis.local_fits",
    "log_bayes_factor": "ldbb_bayes.inference.evidence",
    "Identifiability": "ldbb_bayes.analysis.identified",
    "ParameterIdentifiability": "ldbb_bayes.analysis.identified",
    "identify": "ldbb_bayes.analysis.identifiability",
    "verdicts": "ldbb_bayes.analysis.identifiability",
    "save_figures": "ldbb_bayes.report.figures",
    "embedded_campaign": "ldbb_bayes.campaign.embedded",
    "Circle": "ldbb_bayes.machine.chain",
    "Machine": "ldbb_bayes.machine.chain",
    "describe": "ldbb_bayes.analysis.machine",
    "Drift": "ldbb_bayes.model.terms",
    "Hysteresis": "ldbb_bayes.model.terms",
    "HybridModel": "ldbb_bayes.model.hybrid",
    "PopulationPrior": "ldbb_bayes.model.population_prior",
    "prior_from": "ldbb_bayes.model.population_prior",
    "Population": "ldbb_bayes.fleet.pooled",
    "population": "ldbb_bayes.fleet.population",
    "Prior": "ldbb_bayes.model.prior",
    "read_model": "ldbb_bayes.model.spec",
    "StoppingRule": "ldbb_bayes.inference.stopping",
    "load": "ldbb_bayes.inference.posterior",
    "sample": "ldbb_bayes.inference.sample",
    "save": "ldbb_bayes.inference.posterior",
    "budgets": "ldbb_bayes.analysis.budget",
    "circularity": "ldbb_bayes.analysis.circularity",
    "contributions": "ldbb_bayes.analysis.contributions",
    "differences": "ldbb_bayes.analysis.differences",
    "measured_circularity": "ldbb_bayes.analysis.circularity",
    "read_comparison": "ldbb_bayes.analysis.recorded",
    "read_design": "ldbb_bayes.analysis.recorded",
    "write_report": "ldbb_bayes.report.writing",
    "summarize": "ldbb_bayes.inference.summary",
    "nuisances": "ldbb_bayes.inference.nuisances",
    "Batch": "ldbb_bayes.fleet.batch",
    "batch": "ldbb_bayes.fleet.batch",
    "read_batch": "ldbb_bayes.fleet.reading",
    "control_chart": "ldbb_bayes.fleet.figures_trend",
    "machine_chart": "ldbb_bayes.fleet.figures_population",
    "Trend": "ldbb_bayes.fleet.trended",
    "trend": "ldbb_bayes.fleet.trend",
}
__all__ = [
    "Batch",
    "Campaign",
    "Circle",
    "CircularTest",
    "Comparison",
    "Costs",
    "Design",
    "Drift",
    "ForceLaw",
    "HybridModel",
    "Hysteresis",
    "Identifiability",
    "Imported",
    "InputError",
    "Layout",
    "LeastSquares",
    "Machine",
    "MountCompensation",
    "ParameterIdentifiability",
    "Plan",
    "Population",
    "PopulationPrior",
    "Prior",
    "StoppingRule",
    "Trend",
    "Validation",
    "__version__",
    "batch",
    "belonging",
    "budgets",
    "circularity",
    "compare",
    "compensate_mount",
    "contributions",
    "control_chart",
    "describe",
    "design",
    "differences",
    "embedded_campaign",
    "exact_reading_mm",
    "figures",
    "hybrid_jacobian",
    "identify",
    "import_campaign",
    "least_squares",
    "load",
    "local_fits",
    "log_bayes_factor",
    "log_evidence",
    "machine_chart",
    "marginals",
    "mask_angles",
    "mask_reversals",
    "measured_circularity",
    "nuisances",
    "patterns",
    "population",
    "preview",
    "prior_from",
    "read_batch",
    "read_campaign",
    "read_comparison",
    "read_design",
    "read_layout",
    "read_model",
    "sample",
    "save",
    "save_figures",
    "summarize",
    "trend",
    "trim_overshoot",
    "validate",
    "verdicts",
    "write_campaign",
    "write_report",
]

if TYPE_CHECKING:
    from ldbb_bayes.analysis.belonging import belonging
    from ldbb_bayes.analysis.budget import budgets
    from ldbb_bayes.analysis.circularity import circularity, measured_circularity
    from ldbb_bayes.analysis.compared import Comparison
    from ldbb_bayes.analysis.comparison import compare
    from ldbb_bayes.analysis.contributions import contributions
    from ldbb_bayes.analysis.costs import Costs
    from ldbb_bayes.analysis.design import design
    from ldbb_bayes.analysis.designed import Design
    from ldbb_bayes.analysis.differences import differences
    from ldbb_bayes.analysis.identifiability import identify, verdicts
    from ldbb_bayes.analysis.identified import Identifiability, ParameterIdentifiability
    from ldbb_bayes.analysis.local_fits import local_fits
    from ldbb_bayes.analysis.machine import describe
    from ldbb_bayes.analysis.preview import preview
    from ldbb_bayes.analysis.recorded import read_comparison, read_design
    from ldbb_bayes.analysis.validation import Validation, validate
    from ldbb_bayes.campaign.campaign import Campaign, Plan
    from ldbb_bayes.campaign.circular_test import CircularTest
    from ldbb_bayes.campaign.embedded import embedded_campaign
    from ldbb_bayes.campaign.folder import read_campaign, write_campaign
    from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
    from ldbb_bayes.campaign.prepare import compensate_mount, mask_angles, mask_reversals, trim_overshoot
    from ldbb_bayes.errors import InputError
    from ldbb_bayes.fleet.batch import Batch, batch
    from ldbb_bayes.fleet.figures_population import machine_chart
    from ldbb_bayes.fleet.figures_trend import control_chart
    from ldbb_bayes.fleet.pooled import Population
    from ldbb_bayes.fleet.population import population
    from ldbb_bayes.fleet.reading import read_batch
    from ldbb_bayes.fleet.trend import trend
    from ldbb_bayes.fleet.trended import Trend
    from ldbb_bayes.inference.evidence import log_bayes_factor, log_evidence
    from ldbb_bayes.inference.least_squares import LeastSquares, least_squares
    from ldbb_bayes.inference.marginals import marginals
    from ldbb_bayes.inference.nuisances import nuisances
    from ldbb_bayes.inference.posterior import load, save
    from ldbb_bayes.inference.sample import sample
    from ldbb_bayes.inference.stopping import StoppingRule
    from ldbb_bayes.inference.summary import summarize
    from ldbb_bayes.machine.chain import Circle, Machine
    from ldbb_bayes.machine.forward import exact_reading_mm
    from ldbb_bayes.machine.hybrid import hybrid_jacobian, patterns
    from ldbb_bayes.model.hybrid import HybridModel
    from ldbb_bayes.model.population_prior import PopulationPrior, prior_from
    from ldbb_bayes.model.prior import Prior
    from ldbb_bayes.model.spec import read_model
    from ldbb_bayes.model.terms import Drift, Hysteresis
    from ldbb_bayes.report import figures
    from ldbb_bayes.report.figures import save_figures
    from ldbb_bayes.report.writing import write_report
    from ldbb_bayes.tables.importing import Imported, import_campaign
    from ldbb_bayes.tables.layout import Layout, read_layout


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ldbb_bayes' has no attribute {name!r}")
    home = import_module(_HOMES[name])
    value = getattr(home, name) if hasattr(home, name) else import_module(f"{_HOMES[name]}.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
