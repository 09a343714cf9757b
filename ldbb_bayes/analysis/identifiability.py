"""What circles show: which numbers come from the readings, which from the prior, and which are two
names for one thing.

Everything is of the linear Gaussian model at one value of the hyper-parameters φ, without
truncation: no readings are needed, and a plan can be asked before it is run. With readings φ is its
posterior mean (but what certificates are worth is averaged over p(φ | y)), without them its prior
median.

The uncertainty budget of a parameter, in the form of the GUM, lists contributors, their own
uncertainty, sensitivity and share. Given φ the estimation error of the parameters is a sum of
independent parts, one for every source: a nuisance coefficient's deviation from its prior mean, a
noise of the readings, the parameters' own deviation from their priors. Their shares
(`Information.shares`) in the variance of the draws sum to one and give it back, truncation and
unknown hyper-parameters included; without these they are the GUM's u_s²(y) / u²(y).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import (
    Cure,
    Degeneracy,
    Standing,
    StandingKind,
    cures,
    degeneracies,
    standing_degeneracies,
)
from ldbb_bayes.campaign.campaign import Ball, Campaign, Instrument
from ldbb_bayes.errors import require
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.checks import centre_shift
from ldbb_bayes.machine import chain
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.model.prior import compliance_unit, geometric_unit
from ldbb_bayes.model.terms import NOISE, BasisNoise, Columns, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, ByRow, Finite, Number, Result
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CERTIFICATES",
    "Budget",
    "Contribution",
    "DescribedMachine",
    "Identifiability",
    "ParameterIdentifiability",
    "Seen",
    "Verdict",
    "budgets",
    "describe",
    "hyper_nodes",
    "identify",
    "parameters_of",
    "uncertainty_with",
    "verdicts",
    "worth_of_certificates",
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


# Certificates one could have, and what they would state.
CERTIFICATES: Mapping[str, Mapping[str, Any]] = {
    "balls of grade G10": {"work": Ball(grade="G10"), "tool": Ball(grade="G10")},
    "bar ± 1 µm": {"bar_U_um": 1.0},
    "mount ± 2 %": {"mount_U_percent": 2.0},
    "force ± 0.5 %, linearity 0.2 %, random 1 N": {
        "force_U_percent": 0.5,
        "force_linearity_percent": 0.2,
        "force_random_N": 1.0,
    },
    "angle ± 0.05°": {"angle_U_deg": 0.05},
}


def uncertainty_with(bound: BoundModel, instrument: Instrument, weight: Array, phi: Array) -> Array:
    """Standard uncertainty of every parameter that these certificates would leave, shape (p,) in
    inside units: the variance given φ (w, h) [mm], averaged by the weights (w,), as of
    `hyper_nodes`, that it has without them."""
    stated = BoundModel(
        bound.model, replace(bound.campaign, instrument=instrument), pilot=bound.pilot
    )
    return np.asarray(np.sqrt(weight @ stated.given(phi)[1].sd ** 2))


def worth_of_certificates(
    bound: BoundModel, weight: Array, phi: Array
) -> dict[str, dict[str, float]]:
    """Return standard uncertainties by what is certified and by parameter, inside units: with none
    of `CERTIFICATES`, with each there is none of yet, and with all of them; ``weight`` and ``phi``
    as of `hyper_nodes`."""
    own = bound.campaign.instrument
    none = Instrument()
    open_ = {
        name: stated
        for name, stated in CERTIFICATES.items()
        if all(getattr(own, k) == getattr(none, k) for k in stated)
    }
    if len(open_) > 1:
        open_ = {
            **open_,
            "all of these": {
                key: value for stated in open_.values() for key, value in stated.items()
            },
        }
    each = {"none of these": {}, **open_}
    left = {
        name: uncertainty_with(bound, replace(own, **stated), weight, phi)
        for name, stated in each.items()
    }
    return {name: dict(zip(bound.names, sd.tolist(), strict=True)) for name, sd in left.items()}


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


@dataclass(frozen=True)
class Seen:
    """A parameter that circles show."""

    name: str
    unit: str
    meaning: str
    #: by plane, of the reading per unit (and N of a compliance); c = cos θ, s = sin θ, lengths
    #: in mm
    pattern: Mapping[str, str]
    not_negative: bool  #: whatever the joints are; the prior's truncation is about these
    #: what it is the sum of, with their weights; empty where it stands for itself
    members: Mapping[str, float]


@dataclass(frozen=True)
class DescribedMachine(Result):
    """A machine as its circular tests see it."""

    topology: str
    planes: tuple[str, ...]
    joints: tuple[str, ...]  #: with branch, from the workpiece to the tool
    centres_mm: tuple[tuple[float, float, float], ...]
    compliances: tuple[Seen, ...]
    geometric_errors: tuple[Seen, ...]
    null: tuple[str, ...]  #: compliances that no reading shows
    dependent: tuple[str, ...]  #: those whose pattern is a combination of several kept ones
    rank: int
    #: of the kept compliances' columns, unscaled (mm, N), uniform full circles
    condition_number: float


def describe(machine: Machine, circles: Sequence[Circle] = ()) -> DescribedMachine:
    """Names, units, patterns and sets of all that circular tests in these planes show.

    Parameters
    ----------
    circles : default: R = 150 mm about the frames' origin in every plane. Patterns are those of the
        first circle of each plane.
    """
    circles = tuple(circles) or tuple(Circle(plane=plane) for plane in machine.planes)
    largest = max(abs(x) for circle in circles for x in circle.centre_mm)
    require(
        largest <= chain.LARGEST_MM,
        f"centres must lie within {chain.LARGEST_MM:g} mm, got {largest:g} mm. Check the unit.",
    )
    stranger = next(iter(sorted({circle.plane for circle in circles} - set(machine.planes))), None)
    require(
        not stranger,
        f"circles must lie in the machine's planes {machine.plane}, got {stranger}. Add the plane.",
    )
    kept = chain.kept_compliances(machine, *circles)
    first = {circle.plane: circle for circle in reversed(circles)}

    at = {
        plane: [replace(first[plane], radius_mm=float(r)) for r in _RADII]
        for plane in machine.planes
        if plane in first
    }
    seen = chain.compliance_jacobian
    elastic = {
        p: np.stack([seen(machine, own, _ANGLE, kept.names) for own in each])
        for p, each in at.items()
    }
    rigid = {
        p: np.stack([chain.geometric_jacobian(machine, own, _ANGLE) for own in each])
        for p, each in at.items()
    }
    compliances = []
    for k, name in enumerate(kept.names):
        members = dict(zip(kept.sets[k], kept.weights[k], strict=True)) | {
            n.label: w for n, w in kept.absorbed[k].items()
        }
        pattern = _patterns(elastic, k, 2)
        stands_for = members if len(members) > 1 else {}
        compliances.append(
            Seen(
                name.label,
                compliance_unit(name),
                name.meaning,
                pattern,
                kept.not_negative[k],
                stands_for,
            )
        )
    errors = [
        Seen(name.label, geometric_unit(name.kind), name.meaning, _patterns(rigid, k, 1), False, {})
        for k, name in enumerate(chain.geometric_names(machine))
    ]
    joints = [
        (joint.axis, joint.branch, ", ".join(f"{x:g}" for x in joint.frame_mm))
        for joint in machine.joints
    ]
    return DescribedMachine(
        machine.topology,
        tuple(machine.planes),
        tuple(f"{axis} in the {branch} branch, frame at ({at}) mm" for axis, branch, at in joints),
        tuple(dict.fromkeys(circle.centre_mm for circle in circles)),
        tuple(compliances),
        tuple(errors),
        kept.null,
        kept.dependent,
        kept.rank,
        kept.condition_number,
    )


_RADII = np.array([1.0, 2.0, 3.0, 4.0])
_ANGLE = np.arange(24) * (2 * np.pi / 24)
_POWERS = ("", "", "²", "³", "⁴")
_NEGLIGIBLE = 1e-9


def _patterns(values: Mapping[str, Array], k: int, base: int) -> dict[str, str]:
    """Formulas of column k by plane, planes that do not show it left out; values (radii, angles,
    columns)."""
    return {plane: text for plane, own in values.items() if (text := _formula(own[:, :, k], base))}


def _formula(values: Array, base: int) -> str:
    """The formula of a column (radii, angles); ``base``: degree in (c, s) of the part without R."""
    by_power = np.linalg.solve(np.vander(_RADII, increasing=True), values)
    least = _NEGLIGIBLE * max(np.abs(values).max(), 1.0)
    text = ""
    for power in range(len(_RADII) - 1, -1, -1):
        degree = base + power
        monomials = np.stack(
            [np.cos(_ANGLE) ** (degree - k) * np.sin(_ANGLE) ** k for k in range(degree + 1)],
            axis=1,
        )
        for k, factor in enumerate(
            np.linalg.lstsq(monomials, by_power[power], rcond=None)[0].tolist()
        ):
            if abs(factor) > least:
                size = abs(round(factor, 9))
                sign = (" − " if factor < 0 else " + ") if text else "−" * (factor < 0)
                monomial = _power("R", power, " ") + _power("c", degree - k) + _power("s", k)
                text += sign + ("" if size == 1.0 else f"{size:g} ") + monomial
    return text


def _power(letter: str, power: int, after: str = "") -> str:
    return letter + _POWERS[power] + after if power else ""


# ---- uncertainty budgets

Kind = Literal["A", "B"]
_LISTED = 1e-3


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
