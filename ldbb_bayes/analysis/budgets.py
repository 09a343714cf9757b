"""Uncertainty budgets of the parameters, in the form of the GUM.

A budget lists the contributors to the uncertainty of one parameter: the standard uncertainty,
sensitivity and share of each. Given the hyper-parameters φ, the estimation error of the parameters
is a sum of independent parts, one for every source: the deviation of a nuisance coefficient from
its prior mean, a noise of the readings, the parameters' deviations from their own priors. Their
shares (`Information.shares`) in the variance of the draws sum to one, truncation and unknown
hyper-parameters included; without these they are the GUM's u_s²(y) / u²(y).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.hybrid import BoundModel, information_of
from ldbb_bayes.model.terms import NOISE, BasisNoise, Columns, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import ByName, Result
from ldbb_bayes.units import ranked

__all__ = ["Budget", "Contribution", "budgets"]

if TYPE_CHECKING:
    import xarray as xr


Kind = Literal["A", "B"]


_LISTED = 1e-3
_HALF = 0.5


@dataclass(frozen=True)
class Contribution:
    """One line of a budget."""

    #: a nuisance coefficient, the rest of a term, a noise, or ``Parameters``: the parameters' own
    #: priors
    source: str
    term: str
    kind: Kind  #: evaluated from the readings' scatter (A), or by other means (B): GUM 2.3.2, 2.3.3
    #: its own standard uncertainty [``unit``]; None for several coefficients together
    u: float | None
    unit: str
    sensitivity: (
        float | None
        #: of the parameter's estimate, per unit of the source; for noise the effective one, without
        #: sign
    )
    contribution: float  #: its part of the parameter's standard uncertainty [unit of the parameter]
    share: float  #: of the parameter's variance


@dataclass(frozen=True)
class Budget(Result):
    """The budget of one parameter; shares of its ``contributions``, the largest first, sum to
    one."""

    parameter: str
    unit: str
    u: float  #: posterior standard deviation
    contributions: tuple[Contribution, ...]
    #: the term with the largest share, of those of type B where these hold more than half
    heaviest: str
    #: Standard uncertainty left if the heaviest term were known exactly; None for noise of the readings and for the parameters'
    #: own priors, which nothing makes known.
    u_if_known: float | None

    def share(self, term: str) -> float:
        """Share of a whole term."""
        return sum(line.share for line in self.contributions if line.term == term)


@one_blas_thread
def budgets(posterior: xr.DataTree) -> dict[str, Budget]:
    """The budget of every parameter of a posterior, at its mean hyper-parameters; the variance is
    the draws' own."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    information = information_of(bound, phi.mean(axis=0))
    own = information.interest
    joint = information.covariance()
    scale = information.scale[own]
    covariance = np.atleast_2d(np.cov(beta.T)) / np.outer(scale, scale)
    shares = information.shares(covariance)
    known = {term: information.variances([term]) for term in information.terms}
    value = dict(zip(bound.hyper_prior.names, phi.mean(axis=0).tolist(), strict=True))
    found = ByName[Budget]()
    for i, parameter in enumerate(bound.parameters):
        u = float(np.sqrt(covariance[i, i]) * scale[i])
        lines = []
        rest = dict[str, float]()
        for (source, term), values in shares.items():
            share = float(values[i])
            if source == term:
                lines.append(_noise_line(bound, term, value, share, u))
            elif abs(share) < _LISTED:
                rest[term] = rest.get(term, 0.0) + share
            else:
                j = information.names.index(source)
                # More of the nuisance than its prior mean moves the estimate the other way than
                # their covariance.
                sign = -float(np.sign(joint[own[i], j]))
                size = float(information.scale[j])
                lines.append(
                    _line(
                        source,
                        term,
                        "B",
                        size,
                        Term.owner(source).unit_of(source).inside,
                        share,
                        u,
                        sign,
                    )
                )
        lines += [
            _line(f"other {term}", term, "B", None, "", share, u) for term, share in rest.items()
        ]
        ordered = tuple(ranked(lines, lambda line: line.share))
        by_term: dict[str, float] = {}
        for line in ordered:
            by_term[line.term] = by_term.get(line.term, 0.0) + line.share
        # More circles are no help where what all circles share holds the variance.
        of_circles = {line.term for line in ordered if line.kind == "A"}
        shared = {term: by_term[term] for term in by_term if term not in of_circles}
        heaviest = ranked(shared if sum(shared.values()) > _HALF else by_term, by_term.__getitem__)[
            0
        ]
        left = (
            u * float(np.sqrt(known[heaviest][i] / joint[own[i], own[i]]))
            if heaviest in known
            else None
        )
        found[parameter.name] = Budget(parameter.name, parameter.unit, u, ordered, heaviest, left)
    return found


def _line(
    source: str,
    term: str,
    kind: Kind,
    own_u: float | None,
    unit: str,
    share: float,
    u: float,
    sign: float = 1.0,
) -> Contribution:
    part = float(np.sqrt(max(share, 0.0))) * u
    return Contribution(
        source, term, kind, own_u, unit, None if own_u is None else sign * part / own_u, part, share
    )


def _noise_line(
    bound: BoundModel, term: str, value: Mapping[Any, float], share: float, u: float
) -> Contribution:
    """A noise of the readings, or the parameters' own priors."""
    columns = bound.columns_of.get(Term.kinds[term], ()) if term in Term.kinds else ()
    parts = [part for part in columns if isinstance(part, BasisNoise) or part.private]
    kind: Kind = (
        "A"
        if term == NOISE or (parts and all(isinstance(part, BasisNoise) for part in parts))
        else "B"
    )
    hyper = "sigma" if term == NOISE else parts[0].hyper if len(parts) == 1 else None
    if hyper is not None:
        return _line(term, term, kind, value[hyper], "mm", share, u)
    if len(parts) == 1 and isinstance(parts[0], Columns) and len(parts[0].names) == 1:
        unit = Term.kinds[term].unit_of(parts[0].names[0]).inside
        return _line(term, term, kind, float(parts[0].sd[0]), unit, share, u)
    return _line(term, term, kind, None, "", share, u)
