"""The results as a metrologist writes them."""

from __future__ import annotations

import pandas as pd

from ldbb_bayes.analysis.machine import describe, sum_in_words
from ldbb_bayes.inference.origin import campaign_of
from ldbb_bayes.model.wording import nuisance_words, unit_words
from ldbb_bayes.report.document import Details, Paragraph, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.parameters import compliance_against_force, forest
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_like, round_uncertainty, state, stiffness
from ldbb_bayes.units import display_name, display_unit, is_direct

__all__ = ["results", "results_frame"]


def results(found: Findings) -> Section:
    """Parameters, hyper-parameters and shared nuisances."""
    model = found.result["model"]
    percent = f"{100 * found.ci_prob:g} %"
    degree = ("constant", "linear in force", "quadratic in force")[model["degree"]]
    negative = " Compliances that cannot be negative are held so: read a low one as an upper limit." if model["truncated"] else ""
    at = f" C_… are values at F0 = {model['reference_force_N']:g} N, C_…_1 slopes there." if model["degree"] else ""
    return Section(
        "results",
        "Results",
        (
            Paragraph(
                f"Compliance {degree}, as it was fitted (whether the readings prefer it: Constant or linear).{at} u is the "
                "standard uncertainty (posterior standard deviation), U = 2u the expanded one (k = 2, about 95 %); where the "
                f"distribution is lopsided, the distances to the ends of the {percent} credible interval stand in its place. "
                f"Brackets, of the stiffness too, are {percent} intervals. A compliance stands for the sum of its "
                f"set.{negative} The last column is what the readings tell of the parameter: identified, prior-limited (mostly "
                "what was assumed), or aliased with what they cannot tell it from; in brackets what knowing a term would take "
                "from its variance. Such shares overlap; those of the budgets below sum to one."
            ),
            _parameters(found, percent),
            Picture(
                "forest",
                "Intervals of every parameter beside its prior",
                "Every parameter in units of its prior standard deviation.",
                forest(found.posterior),
            ),
            Picture(
                "compliance_against_force",
                "Compliance against force with credible bands",
                "Compliance over the tested forces, 50 % and 95 % bands.",
                compliance_against_force(found.posterior),
            ),
            _scales(found, percent),
            *_nuisances(found),
            _meanings(found),
        ),
    )


def _parameters(found: Findings, percent: str) -> Sheet:
    rows = []
    for name, entry in found.result["parameters"].items():
        interval = tuple(entry[found.interval_key])
        own = state(entry["mean"], entry["sd"], interval, entry["unit"])
        stiff = stiffness(entry["median"], interval) if is_direct(name) else ""
        rows.append(
            [
                display_name(name), own.value, own.u, own.expanded, own.interval, own.unit, stiff,
                found.verdicts[name].text,
            ]
        )  # fmt: skip
    heads = ["parameter", "value", "u", "U (k = 2)", f"{percent} interval", "unit", "stiffness (N/µm)", "identified?"]
    return sheet("Compliances, their slopes, geometric errors", heads, rows, text=(5, 7))


def _meanings(found: Findings) -> Details:
    """What every parameter is, and the set it stands for."""
    campaign = campaign_of(found.posterior)
    machine = describe(campaign.machine(), [test.circle for test in campaign.tests])
    seen = {entry.name: entry for entry in (*machine.compliances, *machine.geometric_errors)}
    rows = []
    for name in found.result["parameters"]:
        slope = name[-2:] in ("_1", "_2") and name.startswith("C_")
        entry = seen.get(name[:-2] if slope else name) or seen.get(name.rsplit("_", 1)[0])
        if entry is not None:
            power = {"_1": "slope in force of: ", "_2": "curvature in force of: "}[name[-2:]] if slope else ""
            rows.append([display_name(name), f"{power}{entry.meaning}", "" if slope else sum_in_words(entry)])
    table = sheet("Parameters", ["parameter", "what it is", "stands for"], rows, text=(1, 2))
    return Details("What the parameters are", (table,))


def _scales(found: Findings, percent: str) -> Sheet:
    words = {
        "sigma": "σ, white noise of a reading",
        "delta": "δ, shift of zero and centre between circles",
        "delta_0": "δ of the zero",
        "delta_1": "δ of the centre",
        "kappa": "κ, discrepancy of a circle at order n is κ/n",
        "tau": "τ, form of the balls at order n is τ/n",
    }
    rows = []
    for name, entry in found.result["hyper"].items():
        spread, decimals = round_uncertainty(entry["sd"])
        low, high = (round_like(bound, decimals) for bound in entry[found.interval_key])
        short = name.removesuffix("_um")
        rows.append([words.get(short, short), round_like(entry["mean"], decimals), spread, f"[{low}, {high}]"])
    return sheet("Scales learnt from the readings (µm)", ["scale", "value", "u", f"{percent} interval"], rows)


def _nuisances(found: Findings) -> list[Details]:
    """Bar, mount and force, and of the other coefficients those told from zero."""
    rows = []
    for name, entry in found.result["nuisances"].items():
        one, unit = unit_words(name)
        spread, decimals = round_uncertainty(entry["sd"] / one)
        prior, _ = round_uncertainty(entry["prior_sd"] / one)
        value = round_like(entry["mean"] / one, decimals).replace("-", "−")
        if abs(entry["mean"]) > 2.0 * entry["sd"] or entry["term"] in ("BarLength", "Mount", "ForceError"):
            rows.append([nuisance_words(name), value, spread, prior, unit])
    hidden = len(found.result["nuisances"]) - len(rows)
    if not rows:
        return []
    more = f"; {hidden} others are not told from zero (k = 2)" if hidden else ""
    caption = f"Bar, mount and force, form and hysteresis told from zero{more}. Mount: deviation from the nominal deflection"
    table = sheet(caption, ["nuisance", "value", "u", "u before", "unit"], rows, text=(4,))
    return [Details("What the fit says of the instrument", (table,))]


def results_frame(found: Findings) -> pd.DataFrame:
    """The same for files: inside units, one row per parameter, with its verdict."""
    table = found.summary.copy()
    table["U_k2"] = 2.0 * table["sd"]
    table["verdict"] = [found.verdicts[name].text if name in found.verdicts else "" for name in table.index]
    factor = [display_unit(unit) for unit in table["unit"]]
    table["reading_unit"] = [label for _, label in factor]
    table["reading_factor"] = [value for value, _ in factor]
    return table
