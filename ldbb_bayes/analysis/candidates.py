"""The tests one could run, and what each of them would tell: candidates of a campaign's design.

Model properties, F0, force range and Ĉ, are the pilot's. Ball forms count as two terms as soon as any clocking differs; where
none does, two terms and one are the same model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.analysis.optimal.criteria import Criterion, Determinant, Evidence, SmallestEigenvalue, Variance
from ldbb_bayes.analysis.optimal.objective import Case
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.information import informations_of
from ldbb_bayes.model.prior import Prior

__all__ = [
    "CRITERIA",
    "CriterionName",
    "bind_tests",
    "case_of",
    "chosen_parameters",
    "criterion_of",
    "grid_of_tests",
]

Array = NDArray[Any]
CriterionName = Literal["eig", "d", "a", "c", "i", "e", "discriminate"]
CRITERIA: tuple[CriterionName, ...] = ("eig", "d", "a", "c", "i", "e", "discriminate")
_PREDICTED_FORCES = 33
_NEGLIGIBLE = 1e-12


def grid_of_tests(
    templates: Sequence[CircularTest],
    forces_N: Sequence[float],
    clockings_deg: Sequence[tuple[float, float]],
    radii_mm: Sequence[float],
    readings: int | None,
) -> tuple[CircularTest, ...]:
    """Every combination as a planned test: all forces of the first template, radius and clocking, then of the next.

    Parameters
    ----------
    templates : sequence of CircularTest
        Give plane, set-up, centre, direction of travel and, where ``readings`` is None, the angles.
    clockings_deg : sequence of (work ball, tool ball)
    readings : int, optional
        Readings of a full uniform circle.
    """
    plain = [t if readings is None else replace(t, angle_deg=np.arange(readings) * 360.0 / readings) for t in templates]
    return tuple(
        replace(like, force_N=float(force), work_ball_deg=float(work), tool_ball_deg=float(tool), radius_mm=float(radius))
        for like in plain
        for radius in radii_mm
        for work, tool in clockings_deg
        for force in forces_N
    )


def bind_tests(model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep: bool) -> BoundModel:
    """The model bound to a plan of these tests, after the pilot's own where these are kept; F0, force range and Ĉ the pilot's."""
    run = pilot.plan().tests if keep else ()
    planned = tuple(replace(test, name="") for test in tests)
    known = (*pilot.foreseen, *(replace(test, direction=None) for test in pilot.plan().tests))
    return BoundModel(model, replace(pilot, tests=(*run, *planned), foreseen=known), pilot=pilot)


def chosen_parameters(bound: BoundModel, criterion: CriterionName, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters of interest: those named, else all that the criterion is about."""
    check_known("criterion", [criterion], CRITERIA)
    check_known("parameter", names, bound.names)
    if names:
        chosen = tuple(name for name in bound.names if name in names)
    elif criterion == "discriminate":
        chosen = tuple(p.name for p in bound.parameters if p.group == "slope")
    elif criterion == "i":
        chosen = tuple(p.name for p in bound.parameters if p.group != "geometric")
    else:
        chosen = bound.names
    if criterion == "c" and len(chosen) != 1:
        raise InputError(f"criterion c must be given one parameter, got {len(chosen)}. Name it, for example E_C0YX.")
    groups = {p.name: p.group for p in bound.parameters}
    if criterion == "discriminate" and (not chosen or any(groups[name] != "slope" for name in chosen)):
        raise InputError(
            "criterion discriminate must be about slopes, got others or none. Name slopes such as C_XYX_1, or use a model of "
            "degree 1 or 2."
        )
    if criterion == "discriminate" and bound.model.prior.flat:
        raise InputError("criterion discriminate must have proper priors, got flat ones. Use the default preset.")
    if criterion == "i" and any(groups[name] == "geometric" for name in chosen):
        raise InputError("criterion i must be about compliances and their slopes, got a geometric error. Leave it out.")
    return chosen


def criterion_of(
    bound: BoundModel,
    criterion: CriterionName,
    chosen: Sequence[str],
    *,
    size: float = 1.0,
    targets: Mapping[str, float] = MappingProxyType({}),
) -> Criterion:
    """The criterion, its parameters in units of their prior sd (their default prior sd when flat).

    Parameters
    ----------
    size : float
        Of slopes, for ``discriminate`` [prior sd].
    targets : mapping of parameter to sd
        Units for ``a`` and ``c`` instead of the prior sd.
    """
    if criterion in ("eig", "d"):
        return Determinant(len(chosen))
    if criterion in ("a", "c"):
        scale = dict(zip(bound.names, bound.scale, strict=True))
        unit = np.array([scale[name] / targets.get(name, scale[name]) for name in chosen])
        return Variance(np.diag(unit**2) / len(chosen))
    if criterion == "e":
        return SmallestEigenvalue()
    if criterion == "discriminate":
        return Evidence(size)
    return Variance(_prediction_weight(bound, chosen))


def _prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """W with tr(W S⁻¹) the variance of C_j(F) / var prior of C_j, averaged over the pilot's forces and the compliances."""
    forces = (bound.pilot or bound.campaign).forces_N
    own = [bound.names.index(name) for name in chosen]
    prior = Prior.default() if bound.model.prior.flat else bound.model.prior
    unit = prior.compliance_sd(bound.compliances, 0, bound.setting.force_range_N)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    used = [k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned]
    rows = [
        (bound.compliance_at(force)[:, own] * bound.scale[own] / unit[:, None])[used]
        for force in np.linspace(forces.min(), forces.max(), _PREDICTED_FORCES)
    ]
    stacked = np.concatenate(rows)
    return np.asarray(stacked.T @ stacked / len(stacked))


def case_of(bound: BoundModel, run: int, phi: Array, chosen: Sequence[str], criterion: Criterion) -> Case:
    """What every candidate tells about the chosen parameters at every φ; nuisances that touch none of them are left out.

    Parameters
    ----------
    bound : BoundModel
        Bound to the tests already run, if any, followed by the candidates.
    run : int
        Number of tests already run.
    phi : ndarray, shape (K, h) [mm]
    """
    rows, order, kept = [], np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    prior = []
    for k, information in enumerate(informations_of(bound, phi)):
        blocks = _compact(information.blocks())
        if not k:
            own = [information.names.index(name) for name in chosen]
            order = _connected(blocks, own)
            kept = np.flatnonzero(np.abs(blocks[:, :, order]).max(axis=(0, 2)) > 0.0)
            flat = np.array([information.flat and owner == "Parameters" for owner in information.owners])[order]
        blocks = blocks[:, :, order][:, kept]
        known = blocks[:run].reshape(-1, len(order))
        prior.append(np.diag(np.where(flat, 0.0, 1.0)) + known.T @ known)
        rows.append(blocks[run:])
    weight = np.full(len(phi), 1.0 / len(phi))
    return Case(np.array(rows), np.array(prior), weight, len(chosen), criterion)


def _compact(blocks: Sequence[Array]) -> Array:
    """Blocks of at most 25 rows as one array, rounding errors set to zero."""
    size = max(len(block) for block in blocks)
    stacked = np.zeros((len(blocks), size, blocks[0].shape[1]))
    for out, block in zip(stacked, blocks, strict=True):
        out[: len(block)] = block
    stacked[np.abs(stacked) < _NEGLIGIBLE * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected(blocks: Array, own: Sequence[int]) -> NDArray[np.int_]:
    """Columns that share readings with those of interest, directly or through others; those of interest last."""
    size = np.abs(blocks)
    together = np.einsum("rij,rik->jk", size, size) > 0.0
    label = connected_components(together, directed=False)[1]
    rest = [j for j in range(len(label)) if label[j] in set(label[list(own)]) and j not in own]
    return np.array([*rest, *own], dtype=int)
