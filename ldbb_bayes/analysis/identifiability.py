"""Which numbers come from the readings, which from the prior, and which are two names for one thing.

Everything is of the linear Gaussian model at one value of the hyper-parameters φ, truncation set aside: no readings are needed,
and a plan can be asked before it is run. With readings φ is its posterior mean, without them its prior median.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.analysis.confounding import Confounding
from ldbb_bayes.analysis.verdict import Verdict, verdict_of
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.cures import cures
from ldbb_bayes.model.degeneracies import Degeneracy, degeneracies, standing_degeneracies
from ldbb_bayes.model.gaussian import least_squares
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.information import Information, information_of
from ldbb_bayes.notebook import table_html
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Direction", "Identifiability", "ParameterIdentifiability", "identify", "verdicts"]

Array = NDArray[Any]

_HALF = 0.5
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
        Share of the variance along directions in which the priors outweigh the readings tenfold.
    verdict : Verdict
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
            f"Effective number of parameters: {self.effective_parameters:.1f} of {len(self.parameters)}.",
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


def identify(model: HybridModel, campaign: Campaign) -> Identifiability:
    """What the model can learn from a campaign, or could from a plan.

    Parameters
    ----------
    model : HybridModel
    campaign : Campaign
        A plan needs no readings.

    Raises
    ------
    InputError
        Where the model does not go with the campaign.
    """
    bound = model.bind(campaign)
    phi, mean = _hyper_and_mean(bound)
    information = information_of(bound, phi)
    found = degeneracies(bound)
    covariance = information.covariance()
    own = information.own
    entries = _parameters(bound, information, found, mean)
    directions, effective = _directions(information, covariance[np.ix_(own, own)])
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
    return Identifiability(
        entries,
        found,
        cures(bound, found),
        standing_degeneracies(bound, found),
        _alias_matrix(information, rows),
        _correlation(information, covariance),
        directions,
        effective,
        _condition(rows),
        _condition(rows * bound.scale),
        {name: float(value * 1e3) for name, value in zip(bound.hyper_prior.names, phi, strict=True)},
        not campaign.is_plan,
    )


def verdicts(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """The same of every parameter of a posterior, at its mean hyper-parameters; mean, sd and contraction are the draws'."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    prior_sd = [
        float(posterior["prior"][name].std()) if np.isfinite(nominal) else np.inf
        for name, nominal in zip(bound.names, bound.prior_sd, strict=True)
    ]
    information = information_of(bound, phi.mean(axis=0))
    drawn = (np.array(prior_sd), beta.std(axis=0))
    return _parameters(bound, information, degeneracies(bound), beta.mean(axis=0), drawn)


def _hyper_and_mean(bound: BoundModel) -> tuple[Array, Array]:
    """φ [mm] and the mean of β there."""
    if bound.campaign.is_plan:
        return bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), _HALF)), np.zeros(len(bound.names))
    lattice = HyperPosterior(bound, truncated=False).coarse
    phi = lattice.weight @ bound.hyper_prior.phi(lattice.free)
    _, given = bound.given(phi[None])
    return phi, given.mean[0]


def _parameters(
    bound: BoundModel,
    information: Information,
    found: tuple[Degeneracy, ...],
    mean: Array,
    drawn: tuple[Array, Array] | None = None,
) -> dict[str, ParameterIdentifiability]:
    """``drawn``: prior and posterior sd that replace the Gaussian's, truncation included."""
    confounding = Confounding(information)
    covariance = information.covariance()
    own, proper = information.own, not information.flat
    unseen = confounding.unseen_share if proper else np.zeros(len(own))
    root, _ = information.root()
    precision = (root**2).sum(axis=0)
    correlation = _correlation(information, covariance)
    entries = {}
    for i, (k, parameter) in enumerate(zip(own, bound.parameters, strict=True)):
        sd, prior_sd = float(np.sqrt(covariance[k, k]) * information.scale[k]), parameter.prior_sd
        if drawn is not None:
            prior_sd, sd = float(drawn[0][i]), float(drawn[1][i])
        ratio = (sd / prior_sd) ** 2
        fraction = {term: float(values[i]) for term, values in confounding.fraction.items()}
        others = correlation[parameter.name].drop(parameter.name)
        largest = others.reindex(others.abs().sort_values(ascending=False).index)[:_SHOWN]
        rivals = {name: float(others[name] ** 2) for name in bound.names if name != parameter.name}
        mine = tuple(d for d in found if parameter.name in d.parameters)
        verdict = verdict_of(confounding, i, rivals, float(unseen[i]), 1.0 - ratio, mine)
        entries[parameter.name] = ParameterIdentifiability(
            parameter.name,
            parameter.unit,
            prior_sd,
            float(mean[i]),
            sd,
            1.0 - ratio,
            float(-0.5 * np.log(ratio)) if proper else np.inf,
            overlap(float(mean[i]) / prior_sd, np.sqrt(ratio)) if proper else 0.0,
            fraction,
            {source: float(values[i]) for source, values in confounding.shares.items()},
            {source: float(values[i]) for source, values in confounding.sensitivity.items()},
            float(covariance[k, k] * precision[k]),
            {str(name): float(value) for name, value in largest.items()},
            float(unseen[i]),
            verdict,
        )
    return entries


def overlap(mean: float, sd: float) -> float:
    """Area common to N(0, 1) and N(mean, sd²)."""
    if abs(sd - 1.0) < 1e-9:
        return float(2.0 * ndtr(-abs(mean) / 2.0))
    # The densities cross where x² (1 − sd²) − … = 0: (x − mean)² / sd² + 2 ln sd = x².
    a, b, c = 1.0 / sd**2 - 1.0, -2.0 * mean / sd**2, mean**2 / sd**2 + 2.0 * np.log(sd)
    low, high = sorted(((-b - np.sqrt(b * b - 4 * a * c)) / (2 * a), (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)))
    wide = ndtr(high) - ndtr(low)
    narrow = ndtr((high - mean) / sd) - ndtr((low - mean) / sd)
    return float(min(1.0, 1.0 - abs(narrow - wide)))


def _directions(information: Information, covariance: Array) -> tuple[tuple[Direction, ...], float]:
    """Eigenvectors of the prior-whitened posterior covariance of the parameters of interest, and Σ λ / (1 + λ)."""
    names = [information.names[i] for i in information.own]
    if information.flat:
        return (), float(len(names))
    kept, vectors = np.linalg.eigh(covariance)
    kept = np.clip(kept, np.finfo(float).tiny, 1.0)
    found = []
    for value, vector in zip(kept, vectors.T, strict=True):
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        found.append(Direction(float(1.0 / value - 1.0), dict(zip(names, (sign * vector).tolist(), strict=True))))
    return tuple(found), float((1.0 - kept).sum())


def _condition(rows: Array) -> float:
    singular = np.linalg.svd(rows, compute_uv=False)
    dependent = len(rows) < rows.shape[1] or singular[-1] <= np.finfo(float).eps * max(rows.shape) * singular[0]
    return np.inf if dependent else float(singular[0] / singular[-1])


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _alias_matrix(information: Information, rows: Array) -> pd.DataFrame:
    own = information.own
    others = np.setdiff1d(np.arange(len(information.names)), own)
    every = np.concatenate(information.design)
    moved = [least_squares(rows, every[:, j] * information.scale[j], information.scale[own]) for j in others]
    names = [information.names[i] for i in own]
    return pd.DataFrame(np.array(moved).reshape(len(others), len(own)).T, names, [information.names[j] for j in others])


def _correlation(information: Information, covariance: Array) -> pd.DataFrame:
    sd = np.sqrt(np.diag(covariance))
    names = list(information.names)
    return pd.DataFrame(covariance / np.outer(sd, sd), names, names)
