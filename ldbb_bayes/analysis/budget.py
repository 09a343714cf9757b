"""The uncertainty budget of every parameter in the form of the GUM: contributors, their own uncertainty, sensitivity and share.

Given the hyper-parameters the estimation error of the parameters is a sum of independent parts, one for every source: a nuisance
coefficient's deviation from its prior mean, a noise of the readings, the parameters' own deviation from their priors. With Cov_s
the covariance of a part and C their sum, E[part_s | error] = Γ_s error with Γ_s = Cov_s C⁻¹, Σ Γ_s = 1. The share of source s in
the posterior variance of parameter i is [Γ_s Cov(β | y)]_ii / Var(β_i | y): shares sum to one and give back the posterior
variance, truncation and unknown hyper-parameters included; without these they are the GUM's u_s²(y) / u²(y).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.linalg
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import BoundModel, information_of
from ldbb_bayes.model.likelihood import NOISE, OWN, Information
from ldbb_bayes.model.terms import BasisNoise, Columns, Term
from ldbb_bayes.result import Result
from ldbb_bayes.units import ranked

__all__ = ["Budget", "Contribution", "budgets"]

Array = NDArray[Any]
Kind = Literal["A", "B"]
_LISTED = 1e-3


@dataclass(frozen=True)
class Contribution:
    """One line of a budget.

    Attributes
    ----------
    source : str
        A nuisance coefficient, the rest of a term, a noise, or ``Parameters``: the parameters' own priors.
    term : str
    kind : {"A", "B"}
        Evaluated from the readings' scatter, or by other means (GUM 2.3.2, 2.3.3).
    u : float or None
        Its own standard uncertainty [``unit``]; None for several coefficients together.
    unit : str
    sensitivity : float or None
        Change of the parameter's estimate per unit of the source; for noise the effective one, without sign.
    contribution : float
        Its part of the parameter's standard uncertainty [unit of the parameter].
    share : float
        Of the parameter's variance.
    """

    source: str
    term: str
    kind: Kind
    u: float | None
    unit: str
    sensitivity: float | None
    contribution: float
    share: float


@dataclass(frozen=True)
class Budget(Result):
    """The budget of one parameter.

    Attributes
    ----------
    parameter, unit : str
    u : float
        Posterior standard deviation.
    contributions : tuple of Contribution
        The largest first; shares sum to one.
    heaviest : str
        The term with the largest share.
    u_if_known : float or None
        Standard uncertainty that would be left if the heaviest term were known exactly; None where that is the noise of the
        readings or the parameters' own priors, which nothing makes known.
    """

    parameter: str
    unit: str
    u: float
    contributions: tuple[Contribution, ...]
    heaviest: str
    u_if_known: float | None

    def share(self, term: str) -> float:
        """Share of a whole term."""
        return sum(line.share for line in self.contributions if line.term == term)


@one_blas_thread
def budgets(posterior: xr.DataTree) -> dict[str, Budget]:
    """The budget of every parameter of a posterior, at its mean hyper-parameters; the variance is the draws' own."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    information = information_of(bound, phi.mean(axis=0))
    own = information.own
    scale = information.scale[own]
    covariance = np.atleast_2d(np.cov(beta.T)) / np.outer(scale, scale)
    shares = _shares(information, covariance)
    known = {term: information.variances([term]) for term in information.terms}
    plain = information.variances()
    found = {}
    for i, parameter in enumerate(bound.parameters):
        u = float(np.sqrt(covariance[i, i]) * scale[i])
        lines = _lines(bound, information, phi.mean(axis=0), shares, i, u)
        by_term = {term: sum(line.share for line in lines if line.term == term) for term in dict.fromkeys(x.term for x in lines)}
        heaviest = ranked(by_term, by_term.__getitem__)[0]
        left = u * float(np.sqrt(known[heaviest][i] / plain[i])) if heaviest in known else None
        found[parameter.name] = Budget(parameter.name, parameter.unit, u, lines, heaviest, left)
    return found


def _shares(information: Information, covariance: Array) -> dict[tuple[str, str], Array]:
    """Share of every source, by (source, term), each shape (p,)."""
    joint = information.covariance()
    own = information.own
    total = joint[np.ix_(own, own)]
    weight = np.linalg.solve(total, covariance)
    parts: dict[tuple[str, str], Array] = {}
    if not information.flat:
        parts[OWN, OWN] = joint[np.ix_(own, own)] @ joint[np.ix_(own, own)].T
    for k, (name, owner) in enumerate(zip(information.names, information.owners, strict=True)):
        if owner != OWN:
            parts[name, owner] = np.outer(joint[own, k], joint[own, k])
    for design, noise in zip(information.design, information.noise, strict=True):
        root = np.linalg.cholesky(sum(noise.values(), np.zeros((len(design), len(design)))))
        gain = scipy.linalg.cho_solve((root, True), design * information.scale) @ joint[:, own]
        for source, part in noise.items():
            parts[source, source] = parts.get((source, source), 0.0) + gain.T @ part @ gain
    raw = {key: np.einsum("ij,ji->i", part, weight) for key, part in parts.items()}
    return {key: values / np.diag(covariance) for key, values in raw.items()}


def _lines(
    bound: BoundModel, information: Information, phi: Array, shares: Mapping[tuple[str, str], Array], i: int, u: float
) -> tuple[Contribution, ...]:
    value = dict(zip(bound.hyper_prior.names, phi.tolist(), strict=True))
    joint = information.covariance()
    k = int(information.own[i])
    lines, rest = [], dict[str, float]()
    for (source, term), values in shares.items():
        share = float(values[i])
        if source == term:
            lines.append(_noise_line(bound, term, value, share, u))
        elif abs(share) < _LISTED:
            rest[term] = rest.get(term, 0.0) + share
        else:
            j = information.names.index(source)
            own_u = float(information.scale[j])
            part = float(np.sqrt(max(share, 0.0))) * u
            unit = Term.owner(source).unit_of(source).inside
            # More of the nuisance than its prior mean moves the estimate the other way than their covariance.
            sign = -float(np.sign(joint[k, j]))
            lines.append(Contribution(source, term, "B", own_u, unit, sign * part / own_u, part, share))
    lines += [Contribution(f"other {term}", term, "B", None, "", None, max(s, 0.0) ** 0.5 * u, s) for term, s in rest.items()]
    return tuple(ranked(lines, lambda line: line.share))


def _noise_line(bound: BoundModel, term: str, value: Mapping[Any, float], share: float, u: float) -> Contribution:
    part = float(np.sqrt(max(share, 0.0))) * u
    columns = bound.columns_of.get(Term.kinds[term], ()) if term in Term.kinds else ()
    parts = [part for part in columns if isinstance(part, BasisNoise) or part.private]
    kind: Kind = "A" if term == NOISE or (parts and all(isinstance(part, BasisNoise) for part in parts)) else "B"
    own: float | None = value["sigma"] if term == NOISE else None
    unit = "mm" if own is not None else ""
    if len(parts) == 1 and parts[0].hyper is not None:
        own, unit = value[parts[0].hyper], "mm"
    elif len(parts) == 1 and isinstance(parts[0], Columns) and len(parts[0].names) == 1:
        own, unit = float(parts[0].sd[0]), Term.kinds[term].unit_of(parts[0].names[0]).inside
    sensitivity = None if own is None else part / own
    return Contribution(term, term, kind, own, unit, sensitivity, part, share)
