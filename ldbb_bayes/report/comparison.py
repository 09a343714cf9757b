"""A comparison as tables and sentences for a terminal, and as tables for files."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
from rich.table import Table

from ldbb_bayes.analysis.assumptions import Assumed
from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.report.rounding import round_like, round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = [
    "assumption_table",
    "left_out_frame",
    "left_out_table",
    "local_fits_table",
    "models_table",
    "sensitivity_frame",
    "slopes_table",
    "subsets_frame",
]


def models_table(comparison: Comparison) -> Table:
    """One row per model: ln B over the first, probability, leave-one-force-out, RMSE."""
    first = comparison.pair[0]
    table = _table(
        "model",
        f"ln B over {first} (nat)",
        "probability",
        f"elpd over {first} (nat)",
        "RMSE with nuisances (µm)",
        "least squares (µm)",
    )
    for name, model in comparison.models.items():
        ratio = f"{name}/{first}"
        factor, error = comparison.log_bayes_factor.get(ratio, (0.0, 0.0))
        gain, spread = comparison.elpd_difference.get(ratio, (np.nan, np.nan))
        table.add_row(
            name,
            "0" if name == first else f"{factor:+.3f} ± {max(error, 1e-3):.1g}",
            f"{model.probability:.3g}",
            "0" if name == first else "–" if np.isnan(gain) else f"{gain:+.1f} ± {spread:.1f}",
            f"{model.rmse_um:.2f}",
            "–" if np.isnan(model.least_squares_rmse_um) else f"{model.least_squares_rmse_um:.2f}",
        )
    return table


def assumption_table(comparison: Comparison) -> Table:
    """ln B under every assumption, and the evidence of the assumption itself against the models' own."""
    own = max(comparison.nuisances[0].log_evidence.values())
    table = _table("assumption", f"ln B({comparison.ratio}) (nat)", "its evidence (nat)")
    for scaled in comparison.prior_sensitivity:
        table.add_row(f"slope scale {scaled.slope_scale:g}", f"{scaled.log_bayes_factor:+.2f}", "")
    for assumed in _distinct(comparison):
        table.add_row(assumed.label, f"{assumed.log_bayes_factor:+.2f}", f"{max(assumed.log_evidence.values()) - own:+.1f}")
    return table


def slopes_table(comparison: Comparison) -> Table:
    """Probability that each compliance varies with force, and the likeliest sets."""
    table = _table("compliance", "varies with probability", "likeliest sets", "probability")
    if comparison.slopes is None:
        return table
    sets = comparison.slopes.subsets
    for k, (name, probability) in enumerate(comparison.slopes.inclusion.items()):
        subset = sets[k] if k < len(sets) else None
        quadratic = comparison.slopes.quadratic.get(name)
        shown = f"{probability:.2f}" if quadratic is None else f"{probability:.2f} (quadratic {quadratic:.2f})"
        table.add_row(
            display_name(name),
            shown,
            "" if subset is None else ", ".join(subset.words) or "none",
            "" if subset is None else f"{subset.probability:.3f}",
        )
    return table


def left_out_table(comparison: Comparison) -> Table:
    """Every test left out: predictive p-values, what tells the models apart, and the parameter that leaving it out moves most."""
    table = _table(
        "test",
        "force (N)",
        "p",
        "p, all tests",
        "",
        f"ln p({comparison.ratio}) (nat)",
        "Pareto k",
        "moves most when left out (u: of all tests)",
    )
    first, second = comparison.pair
    for name, test in comparison.tests.items():
        gain = test.lofo_log_density[second] - test.lofo_log_density[first]
        k = max(test.pareto_k[first], test.pareto_k[second])
        parameter, change = max(test.dropping[second].items(), key=lambda pair: abs(pair[1].shift))
        table.add_row(
            name,
            f"{test.force_N:.4g}",
            _p(test.belonging.p_value),
            _p(test.belonging.family_wise_p_value),
            "FLAG" if test.belonging.flag else "",
            f"{gain:+.2f}",
            f"{k:.2f}{'' if k <= test.good_k else ' (too large)'}",
            f"{display_name(parameter)} by {change.shift:+.1f} u",
        )
    return table


def left_out_frame(comparison: Comparison) -> pd.DataFrame:
    """Every test, model and parameter without the test; inside units."""
    rows = [
        {
            "test": name,
            "force_N": test.force_N,
            "flag": test.belonging.flag,
            "p_value": test.belonging.p_value,
            "family_wise_p_value": test.belonging.family_wise_p_value,
            "model": model,
            "lofo_log_density": test.lofo_log_density[model],
            "parameter": parameter,
            "unit": comparison.models[model].parameters[parameter][0],
            "mean": comparison.models[model].parameters[parameter][1],
            "sd": comparison.models[model].parameters[parameter][2],
            "mean_without": change.mean,
            "sd_without": change.sd,
            "shift": change.shift,
        }
        for name, test in comparison.tests.items()
        for model, changes in test.dropping.items()
        for parameter, change in changes.items()
    ]
    return pd.DataFrame(rows)


def sensitivity_frame(comparison: Comparison) -> pd.DataFrame:
    """ln B under every slope scale and every assumption [nat]."""
    scaled = [
        {"assumption": "slope scale", "slope_scale": s.slope_scale, "log_bayes_factor": s.log_bayes_factor, "error": s.error}
        for s in comparison.prior_sensitivity
    ]
    assumed = [
        {
            "assumption": a.label,
            "log_bayes_factor": a.log_bayes_factor,
            "error": a.error,
            **{f"log_evidence_{name}": value for name, value in a.log_evidence.items()},
        }
        for a in _distinct(comparison)
    ]
    return pd.DataFrame([*scaled, *assumed])


def subsets_frame(comparison: Comparison) -> pd.DataFrame:
    """Every slope subset: power of force of each compliance, log evidence, probability."""
    if comparison.slopes is None:
        return pd.DataFrame(columns=["log_evidence", "probability"])
    rows = [{**s.powers, "log_evidence": s.log_evidence, "probability": s.probability} for s in comparison.slopes.subsets]
    return pd.DataFrame(rows)


def local_fits_table(local: pd.DataFrame) -> Table:
    """Local fits in units for reading: posterior mean ± u, least squares beside."""
    table = _table("forces (N)", "parameter", "mean", "± u", "unit", "least squares")
    for _, row in local.iterrows():
        factor, unit = display_unit(row["unit"])
        spread, decimals = round_uncertainty(row["sd"] * factor)
        table.add_row(
            f"{row['force_low_N']:.4g}–{row['force_high_N']:.4g}",
            display_name(row["parameter"]),
            round_like(row["mean"] * factor, decimals),
            spread,
            unit,
            round_like(row["least_squares"] * factor, decimals),
        )
    return table


def _distinct(comparison: Comparison) -> Iterable[Assumed]:
    """Nuisances on and off and ideas of discrepancy, each once."""
    return {a.label: a for a in (*comparison.nuisances, *comparison.discrepancy_sensitivity)}.values()


def _table(first: str, *others: str) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for name in others:
        text = name in ("", "likeliest sets", "unit", "parameter") or name.startswith("moves most")
        table.add_column(name, justify="left" if text else "right")
    return table


def _p(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1g}"
