"""What `compare` found, and how it is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.assumptions import WHITE_NOISE, Assumed
from ldbb_bayes.analysis.belonging import Belonging, Dropping
from ldbb_bayes.analysis.slopes import Curve, SlopeSubsets
from ldbb_bayes.inference.evidence import Evidence
from ldbb_bayes.notebook import table_html

__all__ = ["ComparedModel", "ComparedTest", "Comparison", "ScaledSlopes"]


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One of the models.

    Attributes
    ----------
    name : str
    degree : int
    terms : tuple of str
    evidence : Evidence
    probability : float
        Posterior probability among the models compared.
    elpd_lofo, elpd_lofo_se : float
        Sum of the leave-one-force-out log densities and its standard error over the tests [nat]; not a number for one test.
    rmse_um, fitness_percent : float, mapping of test to float
        Eq. 34-35 of the posterior mean prediction, machine and shared nuisances.
    least_squares_rmse_um, least_squares_fitness_percent : float, mapping of test to float
        The same of the paper's least squares (Eq. 31) at the same degree; not a number where the forces do not determine it.
    parameters : mapping of name to (unit, mean, sd)
    curves : mapping of compliance to Curve
    """

    name: str
    degree: int
    terms: tuple[str, ...]
    evidence: Evidence
    probability: float
    elpd_lofo: float
    elpd_lofo_se: float
    rmse_um: float
    fitness_percent: Mapping[str, float]
    least_squares_rmse_um: float
    least_squares_fitness_percent: Mapping[str, float]
    parameters: Mapping[str, tuple[str, float, float]]
    curves: Mapping[str, Curve]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "log_evidence": self.evidence.log_value,
            "log_evidence_error": self.evidence.error,
            "posterior_probability": self.probability,
            "elpd_lofo": self.elpd_lofo,
            "elpd_lofo_se": self.elpd_lofo_se,
            "rmse_um": self.rmse_um,
            "fitness_percent": dict(self.fitness_percent),
            "least_squares": {
                "rmse_um": self.least_squares_rmse_um,
                "fitness_percent": dict(self.least_squares_fitness_percent),
            },
            "degree": self.degree,
            "terms": list(self.terms),
            "parameters": {name: {"unit": u, "mean": m, "sd": s} for name, (u, m, s) in self.parameters.items()},
            "compliance_against_force": {name: curve.as_dict() for name, curve in self.curves.items()},
        }


@dataclass(frozen=True, eq=False)
class ComparedTest:
    """One test, left out.

    Attributes
    ----------
    force_N : float
    lofo_log_density, lofo_error : mapping of model to float
        ln p(y_r | y_−r), exact, and the quadrature's error [nat].
    psis_log_density, pareto_k : mapping of model to float
        The same by importance sampling, and how far it can be trusted.
    good_k : float
        Above this Pareto k it cannot.
    belonging : Belonging
    dropping : mapping of model to mapping of parameter to Dropping
    """

    force_N: float
    lofo_log_density: Mapping[str, float]
    lofo_error: Mapping[str, float]
    psis_log_density: Mapping[str, float]
    pareto_k: Mapping[str, float]
    good_k: float
    belonging: Belonging
    dropping: Mapping[str, Mapping[str, Dropping]]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "force_N": self.force_N,
            "lofo_log_density": dict(self.lofo_log_density),
            "lofo_log_density_error": dict(self.lofo_error),
            "lofo_p_value": self.belonging.p_value,
            "lofo_family_wise_p_value": self.belonging.family_wise_p_value,
            "lofo_worst_order": self.belonging.worst_order,
            "lofo_p_value_by_order": {str(n): p for n, p in enumerate(self.belonging.order_p_values)},
            "flag": self.belonging.flag,
            "psis_loo_good_k": self.good_k,
            "psis_loo": {
                name: {
                    "log_density": value,
                    "pareto_k": self.pareto_k[name],
                    "trustworthy": self.pareto_k[name] <= self.good_k,
                }
                for name, value in self.psis_log_density.items()
            },
            "without_it": {
                name: {parameter: vars(change) for parameter, change in changes.items()}
                for name, changes in self.dropping.items()
            },
        }


@dataclass(frozen=True)
class ScaledSlopes:
    """The comparison with the slopes' prior sd at this multiple of sd(C) over the range of force."""

    slope_scale: float
    log_bayes_factor: float
    error: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models of one campaign compared.

    Attributes
    ----------
    campaign, sha256 : str
    pair : tuple of two str
        Sensitivity is of the second of these models over the first.
    models : dict of name to ComparedModel
    log_bayes_factor, savage_dickey, elpd_difference : dict of "model/first model" to (value, error)
        [nat]; Savage-Dickey where the two are nested; the error of an elpd difference is its standard error over the tests.
    prior_sensitivity : tuple of ScaledSlopes
    crossings : tuple of float
        Slope scales at which the log Bayes factor changes sign.
    discrepancy_sensitivity, nuisances : tuple of Assumed
    slopes : SlopeSubsets, or None where no model has slopes
    tests : dict of name to ComparedTest
        Empty for one test.
    local_fits : DataFrame
        Of windows of two force levels; empty where there is one level.
    verdict : tuple of str
        Sentences.
    tolerance, largest_error : float
        Asked of every log evidence, and the largest seen [nat].
    """

    campaign: str
    sha256: str
    pair: tuple[str, str]
    models: dict[str, ComparedModel]
    log_bayes_factor: dict[str, tuple[float, float]]
    savage_dickey: dict[str, tuple[float, float]]
    elpd_difference: dict[str, tuple[float, float]]
    prior_sensitivity: tuple[ScaledSlopes, ...]
    crossings: tuple[float, ...]
    discrepancy_sensitivity: tuple[Assumed, ...]
    nuisances: tuple[Assumed, ...]
    slopes: SlopeSubsets | None
    tests: dict[str, ComparedTest]
    local_fits: pd.DataFrame
    verdict: tuple[str, ...]
    tolerance: float
    largest_error: float

    @property
    def within_tolerance(self) -> bool:
        """Whether every log evidence is as exact as was asked."""
        return self.largest_error <= self.tolerance

    @property
    def overstatement(self) -> float:
        """Nats by which white noise alone moves the log Bayes factor away from what the models say; not a number where it leaves
        no difference between them."""
        naive = next((assumed for assumed in self.nuisances if assumed.label == WHITE_NOISE), None)
        return np.nan if naive is None else naive.log_bayes_factor - self.log_bayes_factor[self.ratio][0]

    @property
    def ratio(self) -> str:
        """The key of the pair: second/first."""
        return f"{self.pair[1]}/{self.pair[0]}"

    def table(self) -> pd.DataFrame:
        """One row per model; logarithms in nats."""
        first, none = self.pair[0], (np.nan, np.nan)
        rows = {
            name: {
                "ln B over first": 0.0 if name == first else self.log_bayes_factor[f"{name}/{first}"][0],
                "probability": model.probability,
                "elpd over first": 0.0 if name == first else self.elpd_difference.get(f"{name}/{first}", none)[0],
                "± SE": 0.0 if name == first else self.elpd_difference.get(f"{name}/{first}", none)[1],
                "RMSE µm": model.rmse_um,
                "RMSE µm, least squares": model.least_squares_rmse_um,
            }
            for name, model in self.models.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def __str__(self) -> str:
        return f"{self.table().to_string(float_format=lambda value: f'{value:.3f}')}\n\n" + "\n".join(self.verdict)

    def _repr_html_(self) -> str:
        rows = [{"model": name, **dict(row)} for name, row in self.table().round(3).iterrows()]
        return table_html(f"Comparison, {self.campaign}: {' '.join(self.verdict)}", rows)

    def as_dict(self) -> dict[str, Any]:
        """For JSON; logarithms are natural, parameters in inside units."""
        return {
            "models": {name: model.as_dict() for name, model in self.models.items()},
            "log_bayes_factor": {ratio: value for ratio, (value, _) in self.log_bayes_factor.items()},
            "log_bayes_factor_error": {ratio: error for ratio, (_, error) in self.log_bayes_factor.items()},
            "savage_dickey": {r: {"log_bayes_factor": v, "error": e} for r, (v, e) in self.savage_dickey.items()},
            "elpd_difference": {r: {"value": v, "se": e} for r, (v, e) in self.elpd_difference.items()},
            "sensitivity_of": self.ratio,
            "prior_sensitivity": [vars(scaled) for scaled in self.prior_sensitivity],
            "prior_sensitivity_crossings": list(self.crossings),
            "discrepancy_sensitivity": [_assumed(assumed) for assumed in self.discrepancy_sensitivity],
            "nuisances": [_assumed(assumed) for assumed in self.nuisances],
            "white_noise_overstates_by_nats": self.overstatement,
            "slopes": _slopes(self.slopes),
            "slope_subsets": _subsets(self.slopes),
            "slope_subsets_possible": None if self.slopes is None else self.slopes.possible,
            "compliance_against_force": {} if self.slopes is None else {n: c.as_dict() for n, c in self.slopes.curves.items()},
            "tests": {name: test.as_dict() for name, test in self.tests.items()},
            "local_fits": self.local_fits.replace({np.nan: None}).to_dict("records"),
            "tolerance": self.tolerance,
            "largest_error": self.largest_error,
            "verdict": " ".join(self.verdict),
            "sentences": list(self.verdict),
        }


def _assumed(assumed: Assumed) -> dict[str, Any]:
    return {
        "assumption": assumed.label,
        "log_bayes_factor": assumed.log_bayes_factor,
        "log_bayes_factor_error": assumed.error,
        "log_evidence": dict(assumed.log_evidence),
    }


def _slopes(slopes: SlopeSubsets | None) -> dict[str, Any]:
    if slopes is None:
        return {}
    extra = {name: {"quadratic_probability": p} for name, p in slopes.quadratic.items()}
    return {name: {"inclusion_probability": p, **extra.get(name, {})} for name, p in slopes.inclusion.items()}


def _subsets(slopes: SlopeSubsets | None) -> list[dict[str, Any]]:
    if slopes is None:
        return []
    return [
        {"powers": dict(subset.powers), "log_evidence": subset.log_evidence, "probability": subset.probability}
        for subset in slopes.subsets
    ]
