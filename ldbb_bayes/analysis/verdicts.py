"""What circles show: which numbers come from the readings, which from the prior, and which are two
names for one thing.

Everything is of the linear Gaussian model at one value of the hyper-parameters φ, without
truncation: no readings are needed, and a plan can be asked before it is run. With readings φ is its
posterior mean (but what certificates are worth is averaged over p(φ | y)), without them its prior
median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import (
    Degeneracy,
    Standing,
    StandingKind,
    degeneracies,
    standing_degeneracies,
)
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.value_of_certificates import worth_of_certificates
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.checks import centre_shift
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Finite, Number, Result
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "Identifiability",
    "ParameterIdentifiability",
    "Verdict",
    "hyper_nodes",
    "identify",
    "parameters_of",
    "verdicts",
]

_TENTH = 0.1
_HALF = 0.5
_CONTRACTED = 0.75
_NAMED = 0.05
_QUARTER = 0.25
_ROUNDING = 1e-12
_UNMEASURED = {StandingKind.FRICTION: "Hysteresis", StandingKind.DRIFT: "Drift"}


class Verdict(StrEnum):
    """What is known of one parameter. The rule, in this order:

    1. *confounded*, when a nuisance that the model leaves out looks exactly like it: nothing bounds it then.
    2. *confounded*, when nuisances that look exactly like it, whose size neither these readings measure nor a certificate states,
       make up more than half of its standard uncertainty: knowing them would take a quarter of its
       variance. What is carried over from other orders of the circle is not measured.
    3. *confounded*, when more than half of its variance lies along directions in which the priors outweigh the readings, and more
       than half would vanish if something else were known: the nuisance terms, and with them the
       parameters that no reading separates from it; or, where the priors outweigh the readings
       tenfold, the parameter it is correlated with most. So are C_CXY and its like, with
       `Position`, where the circle's centre shifts in proportion to force.
    4. *prior-limited*, when the contraction is below 0.75: the posterior sd is more than half of the prior sd.
    5. *identified* otherwise; but *confounded* with what looks exactly like it and the tests do not show: C_XYX with lost motion
       in proportion to force, in one direction of travel; in tests that ran in the order of force,
       C_XXX and its like, where `Position` is modelled C_CXY too, with drift of the bar's length
       and of the centre.
    """

    IDENTIFIED = "identified"
    PRIOR_LIMITED = "prior-limited"
    CONFOUNDED = "confounded"


def lost_by_knowing(information: Information, known: Sequence[str]) -> Array:
    """Share of the variance of every parameter that vanishes when these terms or coefficients are
    known, shape (p,)."""
    return np.clip(1.0 - information.variances(known) / information.variances(), 0.0, 1.0)


def unseen_share(information: Information, least: float = 1.0) -> Array:
    """Share of the variance along directions in which the readings add less than ``least`` times
    the prior, shape (p,). Directions of all coefficients, parameters and nuisances, in units of the
    prior sd: right singular vectors of the whitened design, along which the readings add the
    squared singular value to a prior precision of one."""
    rows = information.rows()
    missing = max(rows.shape[1] - len(rows), 0)
    _, singular, right = np.linalg.svd(
        np.concatenate([rows, np.zeros((missing, rows.shape[1]))]), full_matrices=False
    )
    gain = singular[:, None] ** 2
    parts = right[:, information.interest] ** 2 / (1.0 + gain)
    return np.asarray(np.where(gain < least, parts, 0.0).sum(axis=0) / parts.sum(axis=0))


@dataclass(frozen=True, eq=False)
class ParameterIdentifiability(Result):
    """What readings and priors each say about one parameter, in inside units.

    ``partners`` are terms (then parameters) that it is confounded with, the heaviest first; of one
    that is not confounded the terms that hold at least 5 % of its variance all the same.
    """

    name: str  #: of the parameter
    verdict: Verdict  #: identified, prior-limited or confounded
    partners: Annotated[tuple[str, ...], Field(alias="with")]
    #: of its variance that vanish if the partner is known; what the model leaves out has none
    partner_shares: dict[str, float]
    unit: str  #: inside unit
    prior_mean: Number  #: not a number when flat
    prior_sd: Finite  #: infinite when flat
    mean: float  #: of the Gaussian posterior; a plan's is the prior's
    sd: float  #: likewise
    contraction: Number  #: 1 − Var(β | y) / Var(β); not a number when flat, like the next
    #: ½ ln(Var(β) / Var(β | y)), the mutual information of parameter and readings [nat]
    information_gain: Number
    confounding: dict[str, float]  #: by term: 1 − Var(β | y, term) / Var(β | y)
    #: of terms, reading noise and the parameters' own priors, as in `budgets`; they sum to one
    shares: dict[str, float]


@dataclass(frozen=True, eq=False)
class Identifiability(Result):
    """What a model can learn from a campaign or plan."""

    parameters: dict[str, ParameterIdentifiability]  #: by name
    degeneracies: tuple[Degeneracy, ...]  #: combinations that no reading sees
    #: of each degeneracy, found by adding the tests to the plan and looking again
    cures: tuple[tuple[Cure, ...], ...]
    standing: tuple[Standing, ...]  #: degeneracies with effects that are not terms of the model
    #: that the readings determine: the sum of the contractions, all of them when the prior is flat
    effective_parameters: float
    #: change of each least-squares estimate (rows) per prior sd of a nuisance left out (columns);
    #: inside units
    alias: ByRow
    correlation: ByRow  #: posterior correlations of parameters and shared nuisances
    #: Standard uncertainty by parameter and by what is certified of the instrument: none of these, and each there is none of yet.
    certificates: dict[str, dict[str, float]]
    hyper_um: dict[str, float]  #: φ it holds at [µm]
    measured: bool  #: whether φ and the means come from readings


@one_blas_thread
def identify(model: HybridModel, campaign: Campaign) -> Identifiability:
    """What the model can learn from a campaign, or could from a plan."""
    bound = model.bind(campaign)
    weight, nodes = hyper_nodes(bound)
    phi = weight @ nodes
    mean = bound.prior_mean if campaign.is_plan else bound.given(phi[None])[1].mean[0]
    information = information_of(bound, phi)
    found = degeneracies(bound)
    return Identifiability(
        parameters=parameters_of(bound, information, found, mean),
        degeneracies=found,
        cures=cures(bound, found),
        standing=standing_degeneracies(bound, found),
        effective_parameters=len(bound.names)
        - (0.0 if information.flat else float(information.variances().sum())),
        alias=_alias_matrix(bound, information),
        correlation=_correlation(information),
        certificates={} if information.flat else worth_of_certificates(bound, weight, nodes),
        hyper_um=bound.hyper_prior.named(phi),
        measured=not campaign.is_plan,
    )


@one_blas_thread
def verdicts(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """The same of every parameter of a posterior, at its mean hyper-parameters; mean, sd and
    contraction are the draws'."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    prior_sd = [
        float(posterior["prior"][name].std()) if np.isfinite(nominal) else np.inf
        for name, nominal in zip(bound.names, bound.prior_sd, strict=True)
    ]
    information = information_of(bound, phi.mean(axis=0))
    drawn = (np.array(prior_sd), beta.std(axis=0))
    return parameters_of(bound, information, degeneracies(bound), beta.mean(axis=0), drawn)


def hyper_nodes(bound: BoundModel) -> tuple[Array, Array]:
    """Weights (w,) and φ (w, h) [mm]: nodes of p(φ | y), without truncation; of a plan the prior
    median alone."""
    if bound.campaign.is_plan:
        return np.ones(1), bound.hyper_prior.quantile(
            np.full((1, len(bound.hyper_prior.names)), _HALF)
        )
    found = HyperPosterior(bound, truncated=False).coarse
    return found.weight, bound.hyper_prior.phi(found.free)


def parameters_of(
    bound: BoundModel,
    information: Information,
    found: tuple[Degeneracy, ...],
    mean: Array,
    drawn: tuple[Array, Array] | None = None,
) -> dict[str, ParameterIdentifiability]:
    """Every parameter of a model at φ and a mean of β (p,), given the information at φ and the null
    space there. ``drawn``: prior and posterior sd that replace the Gaussian's, truncation
    included."""
    own = information.interest
    proper = not information.flat
    unseen = [
        unseen_share(information, least) if proper else np.zeros(len(own))
        for least in (1.0, _TENTH)
    ]
    correlation = _correlation(information)
    shifted = () if bound.campaign.is_plan else tuple(centre_shift(bound, mean))
    turning = (
        [name.label for name in bound.compliances if name.kind == "rotation_for_force"]
        if shifted
        else []
    )
    alike = {standing.kind: standing.parameters for standing in standing_degeneracies(bound, found)}
    lost = {term: lost_by_knowing(information, [term]) for term in information.terms}
    shares = information.contributions()
    nominal = (
        np.array([p.prior_sd for p in bound.parameters]),
        np.sqrt(information.variances()) * information.scale[own],
    )
    entries = {}
    for i, (p, prior_sd, sd) in enumerate(zip(bound.parameters, *(drawn or nominal), strict=True)):
        ratio = float(sd / prior_sd) ** 2
        others = correlation[p.name]
        rivals = {name: float(others[name] ** 2) for name in bound.names if name != p.name}
        confounding = {term: float(values[i]) for term, values in lost.items()}
        every = confounding | rivals
        mine = tuple(d for d in found if p.name in d.parameters)
        verdict, partners = _verdict(
            information, i, every, (unseen[0][i], unseen[1][i]), 1.0 - ratio, mine
        )
        left_out = [term for kind, term in _UNMEASURED.items() if p.name in alike.get(kind, ())]
        if verdict == Verdict.IDENTIFIED and left_out:
            verdict = Verdict.CONFOUNDED
            partners = (*left_out, *partners)
        if p.name in turning:
            verdict = Verdict.CONFOUNDED
            partners = tuple(dict.fromkeys(["Position", *partners]))
        entries[p.name] = ParameterIdentifiability(
            name=p.name,
            verdict=verdict,
            partners=partners,
            partner_shares={partner: every[partner] for partner in partners if partner in every},
            unit=p.unit,
            prior_mean=p.prior_mean if proper else np.nan,
            prior_sd=float(prior_sd),
            mean=float(mean[i]),
            sd=float(sd),
            contraction=1.0 - ratio if proper else np.nan,
            information_gain=float(-0.5 * np.log(ratio)) if proper else np.nan,
            confounding=confounding,
            shares={source: float(values[i]) for source, values in shares.items()},
        )
    return entries


def _verdict(
    information: Information,
    i: int,
    share: Mapping[str, float],
    unseen: tuple[float, float],
    contraction: float,
    mine: tuple[Degeneracy, ...],
) -> tuple[Verdict, tuple[str, ...]]:
    """See `Verdict` for the rule; with the partners. ``i``: its number among the parameters;
    ``share``: what knowing each term would take from its variance, and its squared correlations
    with the other parameters; ``unseen``: shares of the variance where the priors outweigh the
    readings, once and tenfold; ``mine``: its degeneracies."""
    terms = information.shared_terms
    rivals = ranked((name for name in share if name not in information.terms), share.__getitem__)
    heavy = tuple(ranked((term for term in terms if share[term] > _NAMED), share.__getitem__))
    alike = {d.term for d in mine if d.modelled}
    exact = tuple(term for term in heavy if term in alike)
    left_out = tuple(dict.fromkeys(d.term for d in mine if not d.modelled))
    if left_out:
        return Verdict.CONFOUNDED, (*left_out, *exact)
    open_terms = [
        term for term in exact if any(d.term == term and d.modelled and not d.stated for d in mine)
    ]
    if open_terms and lost_by_knowing(information, open_terms)[i] > _QUARTER:
        return Verdict.CONFOUNDED, tuple(open_terms)
    same = {name for d in mine if not d.term for name in d.parameters}
    twins = [name for name in rivals if name in same]
    partners = tuple(name for name in (*(exact or heavy), *twins) if share[name] > _NAMED)
    if unseen[0] > _HALF and partners and lost_by_knowing(information, (*terms, *twins))[i] > _HALF:
        return Verdict.CONFOUNDED, partners
    if unseen[1] > _HALF and rivals and share[rivals[0]] > _HALF:
        return Verdict.CONFOUNDED, (rivals[0],)
    return (Verdict.PRIOR_LIMITED if contraction < _CONTRACTED else Verdict.IDENTIFIED), heavy


def _alias_matrix(bound: BoundModel, information: Information) -> pd.DataFrame:
    own = information.interest
    names = np.array(information.names)
    others = np.setdiff1d(np.arange(len(names)), own)
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
    every = np.concatenate(information.design) * information.scale
    table = (
        np.array([minimum_norm_solution(rows, every[:, j], information.scale[own]) for j in others])
        .reshape(len(others), len(own))
        .T
    )
    table[np.abs(table) < _ROUNDING * information.scale[own, None]] = 0.0
    return pd.DataFrame(table, names[own].tolist(), names[others].tolist())


def _correlation(information: Information) -> pd.DataFrame:
    covariance = information.covariance()
    names = list(information.names)
    sd = np.sqrt(np.diag(covariance))
    return pd.DataFrame(covariance / np.outer(sd, sd), names, names)


# ---- uncertainty budgets
