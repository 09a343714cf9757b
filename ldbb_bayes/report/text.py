"""The result of a fit as a table an engineer reads in a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from ldbb_bayes.report.rounding import display_name, display_unit, round_like, round_uncertainty

__all__ = ["parameter_table", "verdict_lines"]


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Posterior mean ± sd, credible interval and prior sd of every parameter, in display units.

    Parameters
    ----------
    result : mapping
        The JSON of a fit.
    """
    entries = {**result["parameters"], **result["hyper"]}
    key = next(key for key in next(iter(entries.values())) if key.startswith("ci"))
    table = Table(box=None, pad_edge=False)
    for name, justify in (("parameter", "left"), ("mean", "right"), ("u (1 sd)", "right"), (f"{key[2:]} % interval", "right")):
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    table.add_column("prior sd", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for name, entry in entries.items():
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = (round_like(bound * factor, decimals) for bound in entry[key])
        prior = "flat" if entry["prior_sd"] is None else f"{entry['prior_sd'] * factor:.3g}"
        shown = display_name(name.removesuffix("_um"))
        table.add_row(
            shown, round_like(entry["mean"] * factor, decimals), spread, f"[{low}, {high}]".replace("[", r"\["), prior, unit
        )
    return table


def verdict_lines(result: Mapping[str, Any]) -> list[str]:
    """What was fitted, how well it went, and every warning."""
    campaign, model, sampler, fit = result["campaign"], result["model"], result["sampler"], result["fit"]
    degree = ("constant", "linear in force", "quadratic in force")[model["degree"]]
    lines = [
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
        f"Compliance {degree}, preset {model['preset']}, reference force {model['reference_force_N']:g} N.",
        f"RMSE {fit['rmse_um']:.2f} µm (machine and shared nuisances); linear for exact geometry costs at most "
        f"{fit['linearisation_error_um']:.4f} µm. ln P(T | y) = {fit['log_prob_truncation']:.2f}.",
        f"{'Converged' if sampler['converged'] else 'NOT CONVERGED'}: ESS bulk {sampler['ess_bulk_min']:.0f}, "
        f"tail {sampler['ess_tail_min']:.0f}, R-hat {sampler['rhat_max']:.4f}, {sampler['seconds']:.1f} s.",
    ]
    return lines + [f"Note: {warning}" for warning in fit["warnings"]]
