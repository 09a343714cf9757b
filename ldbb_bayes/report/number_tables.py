"""Tables with all numbers of a report. The tables are written to CSV files.

Circular-test quantities are in µm and µm/m, all other values in internal units (mm, N, rad).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.compliance_change import change_with_force
from ldbb_bayes.analysis.directional_stiffness import stiffness
from ldbb_bayes.analysis.measured_paths import measure_circularity
from ldbb_bayes.analysis.path_contributions import decompose_deviation
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.summary import summarize
from ldbb_bayes.report import wording
from ldbb_bayes.report.findings import Findings, FurtherCampaign
from ldbb_bayes.units import U_PROBABILITY, display_unit, needs_interval

__all__ = ["TABLE_FILES", "tables"]

TABLE_FILES = (
    "results.csv",
    "averaged.csv",
    "change_with_force.csv",
    "stiffness.csv",
    "covariance.csv",
    "correlation.csv",
    "budget.csv",
    "gum_validation.csv",
    "circularity.csv",
    "measured_circularity.csv",
    "contributions.csv",
    "measured_pairs.csv",
    "differences.csv",
    "conformity.csv",
)
_SUFFIX_OF_UNIT = {"µm": "_um", "µm/m": "_um_per_m"}


def tables(
    findings: Findings, others: Sequence[FurtherCampaign] = (), *, force_N: float | None = None
) -> dict[str, pd.DataFrame]:
    """Return tables with all numbers of a report, except the decisions on conformity.

    The key of each table is the name of its CSV file without the ending ``.csv``. If the report has
    no annex (no sections after the test certificate), tables of values that only the annex
    shows are left out: circular-test quantities, and contributions to the tool path.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    others
        Other campaigns that the report compares with the campaign of the fit.
    force_N
        Force at which the sheets state stiffness [N]. Default: the model's reference force.

    Returns
    -------
    dict of DataFrame
    """
    posterior = findings.posterior
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    draws = np.concatenate([beta, phi], axis=1).T
    names = [*bound.names, *map(str, bound.hyper_prior.names)]
    covariance = pd.DataFrame(np.cov(draws), names, names)
    correlation = pd.DataFrame(np.corrcoef(draws), names, names)
    frames = {
        "results": _results_table(findings),
        "covariance": covariance.rename_axis("parameter"),
        "correlation": correlation.rename_axis("parameter"),
        "budget": _budget_table(findings),
        "stiffness": _stiffness_table(findings, force_N),
        "gum_validation": _gum_validation_table(findings),
    }
    if not findings.sheets_only:
        frames |= _annex_tables(findings)
    if findings.averaged is not None:
        frames["averaged"] = _averaged_table(findings)
    changes = _changes_table(findings)
    if len(changes):
        frames["change_with_force"] = changes
    if others:
        by_name = {other.name: other.differences for other in others}
        differences = pd.concat(by_name, names=["campaign", "parameter"])
        frames["differences"] = differences.reset_index().set_index("campaign")
    return frames


def _annex_tables(findings: Findings) -> dict[str, pd.DataFrame]:
    """Return the tables whose numbers only the annex of a report shows.

    The annex consists of the sections that follow the sheets of the certificate. The keys of the
    returned dict are the names of the tables.
    """
    posterior = findings.posterior
    measured, pairs = measure_circularity(posterior)
    by_source = _with_unit_suffixes(decompose_deviation(posterior, prob=findings.prob))
    frames = {
        "circularity": findings.circularity.set_index("plane"),
        "measured_circularity": _with_unit_suffixes(measured).rename_axis("test"),
        "contributions": by_source.set_index("plane"),
    }
    if len(pairs):
        frames["measured_pairs"] = _with_unit_suffixes(pairs).rename_axis("tests")
    return frames


def _results_table(findings: Findings) -> pd.DataFrame:
    """Return a table of the fitted model's parameters, one row for each parameter.

    The columns include U (k = 2), and the verdict on how well the readings determine the parameter.
    """
    summary = findings.summary
    verdicts = []
    for name in summary.index:
        verdict = ""
        if name in findings.verdicts_of_fit:
            verdict = wording.verdict_words(findings.verdicts_of_fit[name])
        verdicts.append(verdict)
    return _with_reading_units(summary.assign(U_k2=2.0 * summary["sd"], verdict=verdicts))


def _changes_table(findings: Findings) -> pd.DataFrame:
    """Return a table of changes of compliances with force, as the test certificate states them.

    The table has one row for each compliance.
    """
    rows = {}
    changes = change_with_force(findings.posterior_of_certificate, prob=findings.prob)
    for name, change in changes.items():
        if_any = (np.nan, np.nan)
        if change.if_any is not None:
            if_any = change.if_any.interval
        # Of a change that no draw has, there is no verdict.
        verdict = ""
        if name in findings.change_verdicts:
            verdict = wording.verdict_words(findings.change_verdicts[name])
        rows[name] = {
            "unit": change.unit,
            "smallest_force_N": change.smallest_force_N,
            "largest_force_N": change.largest_force_N,
            "at_smallest_mean": change.at_smallest.mean,
            "at_smallest_sd": change.at_smallest.sd,
            "at_largest_mean": change.at_largest.mean,
            "at_largest_sd": change.at_largest.sd,
            **asdict(change.change),
            "U_k2": 2.0 * change.change.sd,
            "probability_of_increase": change.probability_of_increase,
            "probability_of_decrease": change.probability_of_decrease,
            "probability_of_no_change": change.probability_of_no_change,
            "ci_low_if_any": if_any[0],
            "ci_high_if_any": if_any[1],
            "verdict": verdict,
        }
    if not rows:
        return pd.DataFrame()
    return _with_reading_units(pd.DataFrame.from_dict(rows, orient="index"))


def _stiffness_table(findings: Findings, force_N: float | None) -> pd.DataFrame:
    """Return a table of the stiffness by direction, with a row for each plane, force and quantity.

    The forces are the smallest and the largest force tested, the reference force, and ``force_N``.
    The test certificate states the stiffness at ``force_N`` [N].
    """
    numbers = findings.posterior_of_certificate
    table = stiffness(numbers, prob=findings.prob).table()
    if force_N is not None and force_N not in table["force_N"].to_list():
        further = stiffness(numbers, [force_N], prob=findings.prob).table()
        table = pd.concat([table, further])
    return pd.DataFrame(table).set_index("plane")


def _budget_table(findings: Findings) -> pd.DataFrame:
    """Return one table with all uncertainty budgets.

    The table has one row for each contribution to the budget of each parameter.
    """
    columns = {"kind": "type", "unit": "u_unit"}
    rows = []
    for name, budget in findings.budgets.items():
        for contribution in budget.contributions:
            row = {"parameter": name, "unit": budget.unit}
            for field, value in asdict(contribution).items():
                row[columns.get(field, field)] = value
            rows.append(row)
    return pd.DataFrame(rows).set_index("parameter")


def _gum_validation_table(findings: Findings) -> pd.DataFrame:
    """Return a table that compares two intervals of each parameter.

    One interval is from the GUM's law of propagation, the other from the posterior distribution.
    """
    rows = {}
    for name, entry in findings.gum_validation.parameters.items():
        fields = asdict(entry)
        agreeing = fields.pop("digits")
        rows[name] = {
            **fields,
            "d_low": entry.d_low,
            "d_high": entry.d_high,
            "agreeing_digits": agreeing,
            "validated": entry.validated,
            "decided": entry.decided,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def _averaged_table(findings: Findings) -> pd.DataFrame:
    """Return a table of the parameters' estimates on the test certificate.

    These estimates are averages over several models. The table has no slopes (coefficients of the
    change of compliance with force). A slope is exactly zero in some of the models. Its mean and U
    would therefore not describe its distribution. The column ``skewed`` states whether U does not
    describe a parameter, judged by its 95 % interval, as on the certificate.
    """
    averaged = findings.posterior_of_certificate
    summary = summarize(averaged, prob=findings.prob)
    summary = summary.drop(columns=["ess_bulk", "ess_tail", "rhat"])
    parameters = bound_of(averaged).parameters
    summary = summary.loc[[parameter.name for parameter in parameters if parameter.degree == 0]]
    with_95 = summarize(averaged, prob=U_PROBABILITY).loc[summary.index]
    skewed = []
    for _, row in with_95.iterrows():
        interval = (row["ci_low"], row["ci_high"])
        skewed.append(needs_interval(row["mean"], row["sd"], interval))
    verdicts = [wording.verdict_words(findings.verdicts[name]) for name in summary.index]
    return _with_reading_units(
        summary.assign(U_k2=2.0 * summary["sd"], skewed=skewed, verdict=verdicts)
    )


def _with_reading_units(summary: pd.DataFrame) -> pd.DataFrame:
    """Return a table of parameters with two added columns.

    The column ``reading_unit`` is the unit in which a report shows the parameter. The column
    ``reading_factor`` is the factor that converts a value in internal units (mm, N, rad) to this
    unit.
    """
    factors, labels = zip(*map(display_unit, summary["unit"]), strict=True)
    summary = summary.assign(reading_unit=labels, reading_factor=factors)
    return summary.rename_axis("parameter")


def _with_unit_suffixes(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table in which the name of each column with a unit ends in the unit.

    For example, the column ``G``, which is in µm, gets the name ``G_um``.
    """
    names = {name: f"{name}{_SUFFIX_OF_UNIT[unit]}" for name, unit in frame.attrs["units"].items()}
    return frame.rename(columns=names)
