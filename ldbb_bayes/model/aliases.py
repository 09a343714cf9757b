"""What the model cannot tell apart on a campaign, whatever the readings: nuisances that parameters of interest can imitate.

A nuisance column is aliased when the parameters of interest reproduce one prior sd of it with no reading changed by more than
a tenth of the readout's resolution.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.gaussian import least_squares
from ldbb_bayes.model.hybrid import NUISANCES
from ldbb_bayes.model.terms import HYPERS, BarLength, Columns, Nuisance

__all__ = ["Alias", "degeneracies", "exact_aliases"]

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
    modelled : bool
        False when the model leaves the term out: then nothing bounds it, and the intervals ignore it.
    """

    term: str
    nuisances: tuple[str, ...]
    parameters: tuple[str, ...]
    modelled: bool = True


def degeneracies(bound: BoundModel) -> tuple[str, ...]:
    """Everything this campaign cannot tell apart, in sentences: one per aliased term, then what no term stands for."""
    by_term: dict[str, list[Alias]] = {}
    for alias in exact_aliases(bound):
        by_term.setdefault(alias.term, []).append(alias)
    return (*(_statement(term, members) for term, members in by_term.items()), *_standing(bound, by_term.get("BallForm", [])))


def _statement(term: str, members: Sequence[Alias]) -> str:
    said = []
    for alias in members:
        together = " and ".join(alias.parameters) if len(alias.parameters) < 3 else ", ".join(alias.parameters)
        part = ", ".join(_pattern(name) for name in alias.nuisances)
        said.append(f"like {together}{part}")
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", term).capitalize()
    left_out = "" if members[0].modelled else " The model leaves it out: the intervals do not cover it."
    return f"{words} looks exactly {'; '.join(said)}: these readings cannot tell them apart.{left_out} {_CURES[term]}"


def _standing(bound: BoundModel, form: Sequence[Alias]) -> list[str]:
    """Degeneracies with effects that are not terms of the model."""
    found = []
    cross = [name.label for name in bound.compliances if name.kind == "cross"]
    directions = {test.direction for test in bound.campaign.tests}
    if cross and not {"CW", "CCW"} <= directions:
        found.append(
            f"Friction in the bar or lost motion in proportion to force looks exactly like {' and '.join(cross)} "
            "in circles of one direction. Run both directions."
        )
    direct = [name.label for name in bound.compliances if name.kind == "direct"]
    if bound.model.degree and len(direct) == 2:
        found.append(
            f"A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of "
            f"{' and '.join(direct)}."
        )
    rotary = [name.label for name in bound.compliances if name.kind == "rotation_for_moment"]
    if rotary and form and bound.campaign.force_levels > 1:
        found.append(f"{rotary[0]} and the 4-lobe form of the balls are told apart by force alone.")
    return found


def _pattern(name: str) -> str:
    """form_cos2 →  in cos 2θ; empty where the term has a single column."""
    found = re.fullmatch(r"(work_|tool_)?form_(cos|sin)(\d+)", name)
    if not found:
        return ""
    ball = {"work_": " of the work ball", "tool_": " of the tool ball"}.get(found[1] or "", "")
    return f" in {found[2]} {found[3]}θ{ball}"


def exact_aliases(bound: BoundModel) -> tuple[Alias, ...]:
    """All nuisance columns that the parameters of interest imitate on this campaign or plan, modelled or not."""
    own = {type(term): term for term in bound.model.nuisances}
    terms = [own.get(kind, kind()) for kind in NUISANCES.values()]
    circle = [basis(test.angles_rad()) for test in bound.campaign.tests if test.name in bound.test_names]
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
    limit = 0.1 * bound.campaign.resolution_um * 1e-3
    found: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for term in terms:
        for name, values in _shared_columns(term, bound):
            target = np.concatenate([test.factor @ values[r] for r, test in enumerate(bound.reduced)])
            beta = least_squares(rows, target, bound.scale)
            leftover = values - bound.interest @ beta
            if max(np.abs(circle[r] @ leftover[r]).max() for r in range(len(circle))) > limit:
                continue
            effect = np.abs(bound.interest * beta).max(axis=(0, 1))
            names = tuple(n for n, e in zip(bound.names, effect, strict=True) if e > _NEGLIGIBLE * effect.max())
            found.setdefault((type(term).__name__, names), []).append(name)
    modelled = {kind.__name__ for kind in own}
    return tuple(Alias(term, tuple(nuisances), parameters, term in modelled) for (term, parameters), nuisances in found.items())


def _shared_columns(term: Nuisance, bound: BoundModel) -> list[tuple[str, Array]]:
    """Shared columns of a term, each scaled to one prior sd (hyper-parameters at their prior scale) [mm]."""
    everything = bound.model.prior.hyper(HYPERS, bound.campaign.resolution_um)
    scale = dict(zip(everything.names, everything.scale_mm, strict=True))
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
