"""ln p(y_i | c_i, b) = −½ (c_i, b)ᵀ Λ_i (c_i, b) + η_iᵀ (c_i, b) + const: what campaigns say, a
small matrix each; its algebra.

c_i are chosen parameters of the machine in campaign i, compliances at one force for all; b are
errors of the instrument (mount, force gain) that all campaigns share. Everything else (slopes,
geometric errors not chosen, form, bar length, hyper-parameters) is integrated out, anew in each
campaign. Of one machine or one bar that is conservative for changes and differences, not for levels
or the population's mean: ball form and bar length that are the same in all campaigns do not average
out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, get_args

import numpy as np
import pandas as pd

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.fleet.compliance_meaning import Meaning, same_meaning
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, moment
from ldbb_bayes.machine.chain import ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.prior import Prior, geometric_unit
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import inside_name

__all__ = ["FleetStatistics", "fleet_statistics", "reference_sd"]


# ---- what one campaign says


def reference_sd(
    names: Sequence[str], units: Sequence[str], prior_mean: Array, prior_sd: Array
) -> Array:
    """Reference sd of every parameter, shape (c,), in inside units.

    The default prior's; where fits had a wider one about zero, its median over them: a compliance
    that stands for those of several joints is larger, and a user may know of machines that are. A
    prior about another mean says how well a parameter is known, not how large it is, and does not
    count. ``prior_mean`` and ``prior_sd`` (n, c) are those of the fits.
    """
    default = Prior.first()
    kinds = {geometric_unit(kind): kind for kind in get_args(GeometricKind)}
    found = np.empty(len(names))
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        if name.startswith("C_"):
            (usual,) = default.compliance_sd([ComplianceName(*name[2:])])
        else:
            (usual,) = default.geometric_sd([GeometricName("X", "X", kinds[unit])])
        own = prior_sd[prior_mean[:, j] == 0.0, j]
        found[j] = max(usual, np.median(own)) if own.size else usual
    return found


# ---- what a compliance stands for


# ---- what many campaigns say

_SLOPE = re.compile(r"(C_.+)_([12])")


@dataclass(frozen=True, eq=False)
class FleetStatistics:
    """Likelihoods of n campaigns, with the priors they were computed with divided out. A campaign
    that was fitted without an error of the instrument took it as zero: it says nothing of it, and
    its Λ and η have zeros there. ``prior_sd`` is what is assumed of one machine before any
    campaign, about zero: `reference_sd`, not what the fits assumed."""

    campaigns: tuple[str, ...]
    machines: tuple[str, ...]
    dates: tuple[datetime | None, ...]
    parameters: tuple[str, ...]  #: c of them
    units: tuple[str, ...]
    #: errors shared by all campaigns, s of them; none where each has an instrument of its own
    instrument: tuple[str, ...]
    prior_sd: Array  #: (c + s,): of the parameters, then of the instrument's errors
    likelihood: Gaussian  #: (n, c + s): Λ and η of (c, b), in units of prior_sd
    reference_force_N: float  #: at which compliances are meant
    forces_N: tuple[float, float]  #: lowest and highest that was tested in all campaigns
    topology: str
    #: what the chosen ones stand for, where rows say it
    compliances: Mapping[str, Meaning] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.campaigns)

    @property
    def caveats(self) -> list[Caveat]:
        """Whether compliances are meant at a force that was not tested in every campaign."""
        low, high = self.forces_N
        return (
            []
            if low <= (force := self.reference_force_N) <= high
            else [Caveat(CaveatKind.EXTRAPOLATED, values=(force,))]
        )


def fleet_statistics(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    reference_force_N: float | None = None,
    one_instrument: bool = True,
) -> FleetStatistics:
    """Return the statistics of a batch's rows, those to rely on (`choose`); by default of all
    constant compliances. Compliances are meant at ``reference_force_N``, by default the median of
    the campaigns' own. With ``one_instrument`` mount and force gain are those of one bar, so that
    their errors do not average out; else each campaign has its own."""
    topology, *others = sorted(set(rows["topology"]))
    got = f"got {' and '.join([topology, *others[:1]])}. Take one kind."
    require(not others, f"campaigns must be of machines with the same joints, {got}")
    names = [list(own) for own in rows["gaussian_names"]]
    free = [name for name in names[0] if Term.owner(name) is Term and not _SLOPE.fullmatch(name)]
    free = [name for name in free if all(name in own for own in names)]
    parameters = (parameters,) if isinstance(parameters, str) else parameters
    chosen = (
        tuple(name for name in free if name.startswith("C_"))
        if parameters is None
        else tuple(map(inside_name, parameters))
    )
    check_known("parameter", chosen, free)
    said = (
        f"parameters must be given once each, got {', '.join(chosen) or 'none'}. Name some of"
        f" {', '.join(free)}."
    )
    require(0 < len(chosen) == len(set(chosen)), said)
    errors = {
        name for own in names for name in own if Term.owner(name) is not Term and one_instrument
    }
    shared = tuple(
        sorted(errors, key=lambda name: list(Term.kinds.values()).index(Term.owner(name)))
    )
    force = (
        float(np.median(rows["reference_force_N"]))
        if reference_force_N is None
        else float(reference_force_N)
    )
    said = (
        f"reference_force_N must be a finite number, zero or more, got {force:g}. Give a force"
        " in N."
    )
    require(0.0 <= force < np.inf, said)
    parts = [_likelihood(row, (*chosen, *shared), force) for row in rows.to_dict("records")]
    information, weighted, prior_mean, prior_sd = (
        np.array(part) for part in zip(*parts, strict=True)
    )
    units = dict(zip(names[0], rows.iloc[0]["gaussian_units"], strict=True))
    c = len(chosen)
    own_units = tuple(units[name] for name in chosen)
    scale = np.concatenate(
        [
            reference_sd(chosen, own_units, prior_mean[:, :c], prior_sd[:, :c]),
            prior_sd[:, c:].max(axis=0),
        ]
    )
    ids = zip(rows["machine_id"], rows["campaign"], strict=True)
    return FleetStatistics(
        campaigns=tuple(map(str, rows["campaign"])),
        machines=tuple(str(own if isinstance(own, str) else name) for own, name in ids),
        dates=tuple(moment(own) if isinstance(own, str) else None for own in rows["date"]),
        parameters=chosen,
        units=own_units,
        instrument=shared,
        prior_sd=scale,
        likelihood=Gaussian(information * (scale[:, None] * scale), weighted * scale),
        reference_force_N=force,
        forces_N=(float(rows["force_min_N"].max()), float(rows["force_max_N"].min())),
        topology=topology,
        compliances=_meanings(rows, chosen),
    )


def _likelihood(
    row: Mapping[Any, Any], wanted: Sequence[str], force_N: float
) -> tuple[Array, Array, Array, Array]:
    """Λ and η of what is wanted, the prior divided out, and the prior: of what the row does not
    have zeros. Compliances are carried along their slopes to the common force; what the readings
    cannot add counts as nothing."""
    names = list(row["gaussian_names"])
    q = len(row["gaussian_names"])
    mean, prior_mean, prior_sd = (
        np.array(row[f"gaussian_{what}"], dtype=float)
        for what in ("mean", "prior_mean", "prior_sd")
    )
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = row["gaussian_covariance"]
    covariance += np.tril(covariance, -1).T
    moved = force_N - float(row["reference_force_N"])
    take = np.zeros((len(wanted), q))
    for i, name in enumerate(wanted):
        for power, own in enumerate((name, f"{name}_1", f"{name}_2")):
            if own in names:
                take[i, names.index(own)] = moved**power
    here = np.flatnonzero(take.any(axis=1))
    places = [names.index(wanted[int(i)]) for i in here]
    take = take[here]
    prior = (take * prior_sd**2) @ take.T
    scale = np.sqrt(np.diag(prior))
    inside = scale[:, None] * scale
    after, before = (np.linalg.inv(part / inside) for part in (take @ covariance @ take.T, prior))
    values, vectors = np.linalg.eigh(0.5 * (after + after.T) - before)
    pull = after @ ((take @ mean) / scale) - before @ ((take @ prior_mean) / scale)
    kept = vectors * (values > 0.0)
    information, weighted, means, sds = (np.zeros((len(wanted),) * axes) for axes in (2, 1, 1, 1))
    information[np.ix_(here, here)] = (kept * values) @ kept.T / inside
    weighted[here], means[here], sds[here] = (
        kept @ (kept.T @ pull) / scale,
        prior_mean[places],
        prior_sd[places],
    )
    return information, weighted, means, sds


def _meanings(rows: pd.DataFrame, chosen: Sequence[str]) -> dict[str, Meaning]:
    """What every chosen compliance stands for; rows that do not say it are taken to mean what the
    others do."""
    found: dict[str, tuple[Meaning, str]] = {}
    texts = {
        text: str(own) for own, text in zip(rows["campaign"], rows["compliances"], strict=True)
    }
    for text, campaign in texts.items():
        said = json.loads(text) if isinstance(text, str) else {}
        for name in (name for name in chosen if name in said):
            meaning, first = found.setdefault(name, (said[name], campaign))
            other = (
                "circles or joints' frames stand elsewhere, so that it is the sum of other"
                " compliances. Take those of one place."
            )
            refused = f"campaigns must mean the same by {name}, got {first} and {campaign}: {other}"
            require(same_meaning(name, meaning, said[name]), refused)
    return {name: meaning for name, (meaning, _) in found.items()}


# ---- algebra that machines and their campaigns share, in units of the prior sd
