"""What the model cannot tell apart on a campaign, whatever the readings: nuisances that parameters of interest can imitate.

A nuisance column is aliased when the parameters of interest reproduce one prior sd of it with no reading changed by more than
a tenth of the readout's resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.gaussian import least_squares
from ldbb_bayes.model.terms import BarLength, Columns, Nuisance

__all__ = ["Alias", "exact_aliases"]

Array = NDArray[Any]
_NEGLIGIBLE = 0.02
_CURES = {
    "BallForm": "Clock both balls (not by 180° alone), or measure a second radius.",
    "BarLength": "Calibrate the bar's length.",
    "Mount": "Measure the mount's deflection.",
    "ForceError": "Calibrate the force.",
}


@dataclass(frozen=True)
class Alias:
    """One nuisance term and the parameters it cannot be told from.

    Attributes
    ----------
    term : str
        Class name of the nuisance.
    nuisances : tuple of str
        Its aliased coefficients.
    parameters : tuple of str
    """

    term: str
    nuisances: tuple[str, ...]
    parameters: tuple[str, ...]

    @property
    def statement(self) -> str:
        """One sentence for a user."""
        cure = _CURES.get(self.term, "")
        return f"{self.term} ({', '.join(self.nuisances)}) looks exactly like {', '.join(self.parameters)} here. {cure}".strip()


def exact_aliases(bound: BoundModel) -> tuple[Alias, ...]:
    """All nuisance columns that the parameters of interest imitate on this campaign or plan."""
    circle = [basis(test.angles_rad()) for test in bound.campaign.tests if test.name in bound.test_names]
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
    limit = 0.1 * bound.campaign.resolution_um * 1e-3
    found: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for term in bound.model.nuisances:
        for name, values in _shared_columns(term, bound):
            target = np.concatenate([test.factor @ values[r] for r, test in enumerate(bound.reduced)])
            beta = least_squares(rows, target, bound.scale)
            leftover = values - bound.interest @ beta
            if max(np.abs(circle[r] @ leftover[r]).max() for r in range(len(circle))) > limit:
                continue
            effect = np.abs(bound.interest * beta).max(axis=(0, 1))
            names = tuple(n for n, e in zip(bound.names, effect, strict=True) if e > _NEGLIGIBLE * effect.max())
            found.setdefault((type(term).__name__, names), []).append(name)
    return tuple(Alias(term, tuple(nuisances), parameters) for (term, parameters), nuisances in found.items())


def _shared_columns(term: Nuisance, bound: BoundModel) -> list[tuple[str, Array]]:
    """Shared columns of a term, each scaled to one prior sd (hyper-parameters at their prior scale) [mm]."""
    scale = dict(zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True))
    columns = [c for c in term.columns(bound.setting) if isinstance(c, Columns) and not c.private]
    if isinstance(term, BarLength) and len(columns[0].names) > 1:
        share = bound.setting.radius_mm / bound.setting.radius_mm.max()
        together = columns[0].values.sum(axis=2) * share[:, None] * columns[0].sd[0]
        return [("bar lengths in proportion to the radii", together)]
    return [
        (name, c.values[:, :, j] * c.sd[j] * (scale[c.hyper] if c.hyper else 1.0))
        for c in columns
        for j, name in enumerate(c.names)
    ]
