"""A population in sentences: what was pooled, which machines do not belong, what to mind."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldbb_bayes.units import display_name

if TYPE_CHECKING:
    from ldbb_bayes.fleet.pooled import PooledMachine, Population

__all__ = ["sentences_of"]

# Family-wise p-value below which the machine farthest out is named though it may belong.
_NAMED_BELOW = 0.5


def sentences_of(found: Population) -> tuple[str, ...]:
    """What was pooled, which machines do not belong or which is the farthest out, and every doubt."""
    low, high = found.forces_N
    tested = f", tested from {low:g} to {high:g} N" if low <= high else ""
    head = f"{len(found.machine)} machines, {found.campaigns} campaigns; compliances at {found.reference_force_N:g} N{tested}."
    odd = [f"{name} does not belong with the others: {_where(found.machine[name])}." for name in found.not_belonging]
    if not odd and found.judged:
        odd = ["No machine stands out from the others (Holm, 5 %).", *_farthest(found)]
    return (head, *odd, *found.doubts)


def _farthest(found: Population) -> list[str]:
    own = min(found.machine.values(), key=lambda one: 1.0 if one.p_value is None else one.p_value)
    if own.family_wise_p_value is None or own.family_wise_p_value > _NAMED_BELOW:
        return []
    return [f"The farthest out: {own.name}, {_where(own)}."]


def _where(own: PooledMachine) -> str:
    """How far out a machine is, and in what."""
    worst = max(own.z, key=lambda name: abs(own.z[name]))
    return f"p {_p_value(own.family_wise_p_value)} over all machines, most in {display_name(worst)} (z = {own.z[worst]:+.1f})"


def _p_value(value: float | None) -> str:
    """With its sign: never quite 0."""
    return "–" if value is None else "< 0.0001" if value < 1e-4 else f"= {value:.2g}"
