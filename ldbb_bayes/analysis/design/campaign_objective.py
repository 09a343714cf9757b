"""TODO: say what this module is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.analysis.design.criteria import Criterion
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.states import carried
from ldbb_bayes.model.bound_information import informations_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms import OWN
from ldbb_bayes.results import Array

_ROUNDING = 1e-12


_PREDICTED_FORCES = 33


def _prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """W with tr(W S⁻¹) the variance of C_j(F) / var prior of C_j, averaged over the pilot's forces
    and the compliances."""
    forces = (bound.pilot or bound.campaign).forces_N
    own = [bound.names.index(name) for name in chosen]
    prior = Prior.first() if bound.model.prior.flat else bound.model.prior
    unit = prior.compliance_sd(bound.compliances)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    used = [k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned]
    at = np.linspace(forces.min(), forces.max(), _PREDICTED_FORCES)
    rows = np.concatenate(
        [
            (bound.compliance_at(force)[:, own] * bound.scale[own] / unit[:, None])[used]
            for force in at
        ]
    )
    return np.asarray(rows.T @ rows / len(rows))


def objective_of(
    bound: BoundModel, run: int, phi: Array, chosen: Sequence[str], criterion: Criterion
) -> Objective:
    """The candidates' information on the chosen parameters at every φ (K, h); nuisances that touch
    none of them are left out. The model is bound to the tests already run, ``run`` of them,
    followed by the candidates."""
    rows = []
    prior = []
    order = kept = proper = np.zeros(0, dtype=int)
    for k, information in enumerate(informations_of(bound, carried(bound, phi, run))):
        blocks = _compact(information.blocks())
        if not k:
            own = [information.names.index(name) for name in chosen]
            order = _connected(blocks, own)
            kept = np.flatnonzero(np.abs(blocks[:, :, order]).max(axis=(0, 2)) > 0.0)
            proper = np.array(
                [not (information.flat and owner == OWN) for owner in information.owners]
            )[order]
        blocks = blocks[:, :, order][:, kept]
        before = blocks[:run].reshape(-1, len(order))
        prior.append(np.diag(proper.astype(float)) + before.T @ before)
        rows.append(blocks[run:])
    return Objective(np.array(rows), np.array(prior), len(chosen), criterion)


def _compact(blocks: Sequence[Array]) -> Array:
    """Blocks of at most 25 rows as one array, rounding errors set to zero."""
    stacked = np.zeros((len(blocks), max(map(len, blocks)), blocks[0].shape[1]))
    for own, block in zip(stacked, blocks, strict=True):
        own[: len(block)] = block
    stacked[np.abs(stacked) < _ROUNDING * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected(blocks: Array, own: Sequence[int]) -> NDArray[np.int_]:
    """Columns that share readings with those of interest, directly or through others; those of
    interest last."""
    size = np.abs(blocks)
    _, label = connected_components(np.einsum("rij,rik->jk", size, size) > 0.0, directed=False)
    joined = np.isin(label, label[list(own)])
    joined[list(own)] = False
    return np.array([*np.flatnonzero(joined), *own], dtype=int)
