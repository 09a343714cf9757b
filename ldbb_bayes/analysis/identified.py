"""What `identify` found: every parameter, degeneracies and their cures, and how it is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.verdict import Verdict
from ldbb_bayes.model.degeneracies import Degeneracy
from ldbb_bayes.notebook import table_html
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Direction", "Identifiability", "ParameterIdentifiability"]

_SHOWN = 3
_NEGLIGIBLE = 0.1


@dataclass(frozen=True, eq=False)
class ParameterIdentifiability:
    """What readings and priors each say about one parameter.

    Attributes
    ----------
    name, unit : str
        Inside unit.
    prior_sd : float
        Infinite when flat.
    mean, sd : float
        Of the Gaussian posterior; a plan's mean is the prior's.
    contraction : float
        1 − Var(β | y) / Var(β).
    information_gain : float
        Mutual information of parameter and readings, ½ ln(Var(β) / Var(β | y)) [nat]; infinite when flat.
    overlap : float
        Area common to prior and posterior density, 0 … 1.
    confounding : mapping of term to float
        1 − Var(β | y, term) / Var(β | y).
    shapley : mapping of source to float
        Fair shares of the variance; they sum to one.
    sensitivity : mapping of source to float
        d ln sd(β) / d ln(scale of the source), ``Parameters`` being the parameters' own priors. They sum to one.
    variance_inflation : float
        Var(β | y) over what it would be if every other coefficient were known.
    correlations : mapping of name to float
        The largest posterior correlations with parameters and nuisances.
    unseen_share : float
        Share of the variance along directions in which the priors outweigh the readings.
    verdict : Verdict
    prior_mean : float
        Zero when flat.
    """

    name: str
    unit: str
    prior_sd: float
    mean: float
    sd: float
    contraction: float
    information_gain: float
    overlap: float
    confounding: Mapping[str, float]
    shapley: Mapping[str, float]
    sensitivity: Mapping[str, float]
    variance_inflation: float
    correlations: Mapping[str, float]
    unseen_share: float
    verdict: Verdict
    prior_mean: float = 0.0

    def __repr__(self) -> str:
        factor, unit = display_unit(self.unit)
        return f"{self.name}: sd {self.sd * factor:.2g} {unit}, {self.text}"

    @property
    def text(self) -> str:
        """The verdict in words."""
        return self.verdict.text

    def as_dict(self) -> dict[str, Any]:
        """For JSON; null where a flat prior leaves nothing to say."""
        proper = np.isfinite(self.prior_sd)
        return {
            "verdict": self.verdict.word,
            "with": list(self.verdict.partners),
            "unit": self.unit,
            "prior_mean": self.prior_mean if proper else None,
            "prior_sd": self.prior_sd if proper else None,
            "mean": self.mean,
            "sd": self.sd,
            "contraction": self.contraction if proper else None,
            "information_gain": self.information_gain if proper else None,
            "overlap": self.overlap if proper else None,
            "confounding": dict(self.confounding),
            "shapley": dict(self.shapley),
            "sensitivity": dict(self.sensitivity),
            "variance_inflation": self.variance_inflation,
            "correlations": dict(self.correlations),
            "unseen_share": self.unseen_share,
        }


@dataclass(frozen=True)
class Direction:
    """A direction of the parameters of interest along which the readings add to the prior.

    Attributes
    ----------
    gain : float
        λ of F v = λ S⁻¹ v, F the Fisher information with nuisances integrated out and S the prior covariance: precision grows
        by the factor 1 + λ.
    loadings : mapping of parameter to float
        In units of the prior sd, of length one.
    """

    gain: float
    loadings: Mapping[str, float]

    @property
    def text(self) -> str:
        """Its main loadings."""
        heavy = sorted(self.loadings.items(), key=lambda pair: -abs(pair[1]))[:_SHOWN]
        return "  ".join(f"{value:+.2f} {display_name(name)}" for name, value in heavy if abs(value) > _NEGLIGIBLE)


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What a model can learn from a campaign or plan.

    Attributes
    ----------
    parameters : dict of name to ParameterIdentifiability
    degeneracies : tuple of Degeneracy
    cures : tuple of str
        Of each degeneracy, found by adding the tests to the plan and looking again.
    notes : tuple of str
        Degeneracies with effects that are not terms of the model.
    alias : DataFrame
        Change of the least-squares estimate of each parameter (rows) per prior sd of a nuisance (columns) left out; inside
        units.
    correlation : DataFrame
        Posterior correlations of parameters and shared nuisances.
    directions : tuple of Direction
        Likelihood-informed directions, the best known first; none when the prior is flat.
    effective_parameters : float
        Σ λ / (1 + λ): how many parameters the readings determine.
    condition_number, scaled_condition_number : float
        Of the design of the parameters of interest, in inside units (as the paper quotes it) and in units of the prior sd;
        infinite when columns depend on one another.
    hyper_um : dict of name to float
        φ it holds at [µm].
    measured : bool
        Whether φ and the means come from readings.
    """

    parameters: dict[str, ParameterIdentifiability]
    degeneracies: tuple[Degeneracy, ...]
    cures: tuple[str, ...]
    notes: tuple[str, ...]
    alias: pd.DataFrame
    correlation: pd.DataFrame
    directions: tuple[Direction, ...]
    effective_parameters: float
    condition_number: float
    scaled_condition_number: float
    hyper_um: dict[str, float]
    measured: bool

    def table(self) -> pd.DataFrame:
        """One row per parameter in units for reading."""
        rows = {}
        for name, entry in self.parameters.items():
            factor, unit = display_unit(entry.unit)
            rows[display_name(name)] = {
                "prior sd": entry.prior_sd * factor,
                "sd": entry.sd * factor,
                "unit": unit,
                "contraction": entry.contraction,
                "gain (nat)": entry.information_gain,
                "overlap": entry.overlap,
                "verdict": entry.text,
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    @property
    def basis(self) -> str:
        """What the numbers rest on."""
        values = ", ".join(f"{name} = {value:.2g} µm" for name, value in self.hyper_um.items())
        source = "posterior mean" if self.measured else "prior median; no readings"
        return f"At {values} ({source}), truncation set aside."

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "parameters": {name: entry.as_dict() for name, entry in self.parameters.items()},
            "degeneracies": [
                {"combination": dict(d.combination), "statement": d.statement, "cure": cure, "modelled": d.modelled}
                for d, cure in zip(self.degeneracies, self.cures, strict=True)
            ],
            "notes": list(self.notes),
            "effective_parameters": self.effective_parameters,
            "directions": [{"gain": d.gain, "loadings": dict(d.loadings)} for d in self.directions],
            "alias": self.alias.to_dict(orient="index"),
            "correlation": self.correlation.to_dict(orient="index"),
            "condition_number": _or_none(self.condition_number),
            "scaled_condition_number": _or_none(self.scaled_condition_number),
            "hyper_um": self.hyper_um,
            "measured": self.measured,
        }

    def __str__(self) -> str:
        with pd.option_context("display.width", 200, "display.max_colwidth", 80):
            table = self.table().to_string(float_format=lambda value: f"{value:.3g}")
        lines = [
            table,
            "",
            self.basis,
            f"Effective number of parameters, against the priors: {self.effective_parameters:.1f} of {len(self.parameters)}.",
        ]
        if self.degeneracies:
            lines += ["", "What no reading of this campaign can tell apart:"]
            lines += [f"- {d.statement} Cure: {cure}" for d, cure in zip(self.degeneracies, self.cures, strict=True)]
        return "\n".join([*lines, *(f"- {note}" for note in self.notes)])

    def _repr_html_(self) -> str:
        table = self.table()
        rows = [{"parameter": name, **{str(k): v for k, v in row.items()}} for name, row in table.T.to_dict().items()]
        said = [
            {"cannot be told apart": d.statement, "cure": cure} for d, cure in zip(self.degeneracies, self.cures, strict=True)
        ]
        caption = f"Identifiability. {self.basis} Effective parameters: {self.effective_parameters:.1f}"
        return table_html(caption, rows) + (table_html("Degeneracies", said) if said else "")


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
