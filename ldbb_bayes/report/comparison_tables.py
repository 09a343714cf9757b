"""Tables of a comparison of models.

ln B is the log Bayes factor, which states how much the readings favour one model over another. elpd
is the expected log predictive density, which states how well a model predicts readings that it has
not seen.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.comparison import ComparedModel, Comparison
from ldbb_bayes.report.wording import p_value_digits
from ldbb_bayes.results import Table
from ldbb_bayes.units import with_sign

__all__ = ["assumptions_table", "left_out_tests_table", "models_table"]


def models_table(comparison: Comparison, *, rmse: bool = True, least_squares: bool = True) -> Table:
    """Return a table of the compared models, one row for each model.

    The columns are ln B, the probability of the model, elpd and, if wanted, the RMSE. ln B is the
    log Bayes factor of the model over the first model. elpd is the expected log predictive density,
    which states how well a model predicts each test from the other tests. The table shows the elpd
    of the model minus the elpd of the first model.

    Parameters
    ----------
    comparison
        Comparison of models.
    rmse
        Whether the table shows the RMSE of each model. The RMSE is the root mean square of the
        residuals. A residual is a reading minus the posterior mean of the predicted reading.
    least_squares
        Whether the table also shows the RMSE of a fit by least squares, the method of the article
        on which the model is based.

    Returns
    -------
    Table
    """
    first = comparison.pair[0]
    rows = []
    for name, model in comparison.models.items():
        cells = [name, *_evidence_cells(comparison, name)]
        cells.append(f"{model.posterior_probability:.3g}")
        cells += _elpd_cells(comparison, name)
        if rmse:
            cells.append(f"{model.rmse_um:.2f}")
        if least_squares:
            cells.append(_least_squares_cell(model))
        rows.append(tuple(cells))
    heads = ["model", f"ln B over {first} (nat)", "error", "probability"]
    heads += [f"elpd over {first} (nat)", "u of elpd"]
    if rmse:
        heads.append("RMSE of the model (µm)")
    if least_squares:
        heads.append("least squares (µm)")
    return Table.of("Models at equal prior odds", tuple(heads), rows)


def _least_squares_cell(model: ComparedModel) -> str:
    """Return the RMSE of a fit by least squares [µm] as a string, or a dash if it is not known."""
    if np.isnan(model.least_squares_rmse_um):
        return "–"
    return f"{model.least_squares_rmse_um:.2f}"


def _evidence_cells(comparison: Comparison, name: str) -> tuple[str, str]:
    """Return the cells for the log Bayes factor of a model over the first model.

    The two cells are the log Bayes factor and its numerical error, both in nat. ``name`` is the
    name of the model.
    """
    first = comparison.pair[0]
    if name == first:
        return "0", "0"
    ratio = f"{name}/{first}"
    error = max(comparison.log_bayes_factor_error[ratio], 1e-3)
    return with_sign(comparison.log_bayes_factor[ratio], 3), f"{error:.1g}"


def _elpd_cells(comparison: Comparison, name: str) -> tuple[str, str]:
    """Return the cells that compare how well a model and the first model predict tests.

    The two cells are the difference in elpd (expected log predictive density), model minus first
    model, and the standard error of this difference, both in nat. ``name`` is the name of the
    model.
    """
    first = comparison.pair[0]
    if name == first:
        return "0", "0"
    difference = comparison.elpd_difference.get(f"{name}/{first}")
    if difference is None:
        return "–", "–"
    return with_sign(difference.value, 1), f"{difference.se:.1f}"


def assumptions_table(comparison: Comparison, *, slope_scales: bool = True) -> Table:
    """Return a table of the log Bayes factor ln B of two models under several assumptions.

    The table has one row for each assumption. ln B is positive if the readings favour the second
    model of the comparison over the first. Some assumptions are about the prior of the slopes
    (changes of compliance with force), others about the differences between circles. For an
    assumption about circles, the last column states how much the readings favour this assumption
    over the assumption that the compared models make [nat].

    Parameters
    ----------
    comparison
        Comparison of models.
    slope_scales
        Whether the table has rows for the assumptions about the prior of the slopes.

    Returns
    -------
    Table
    """
    rows = []
    scales = comparison.prior_sensitivity if slope_scales else ()
    for scaled in scales:
        assumption = f"slope scale {scaled.slope_scale:g}"
        rows.append((assumption, *_log_bayes_factor(scaled.log_bayes_factor, scaled.error), ""))
    for assumed in comparison.discrepancy_sensitivity:
        evidence = _log_bayes_factor(assumed.log_bayes_factor, assumed.log_bayes_factor_error)
        rows.append((assumed.assumption, *evidence, with_sign(comparison.gain(assumed), 1)))
    heads = ("assumption", "ln B (nat)", "error", "preferred by (nat)")
    return Table.of(f"ln B({comparison.sensitivity_of}) under other assumptions", heads, rows)


def _log_bayes_factor(value: float, error: float) -> tuple[str, str]:
    """Return a log Bayes factor and its numerical error as strings, both in nat."""
    return with_sign(value, 2), f"{max(error, 1e-3):.1g}"


def left_out_tests_table(comparison: Comparison) -> Table:
    """Return a table that compares every test with a prediction made from the other tests.

    The table has one row for each test. The columns include the force, the p-value of the test's
    readings, and this p-value adjusted for the number of tests. A flag marks a test that does not
    agree with the other tests. The last column is the log predictive density of the test under the
    second model minus the log predictive density under the first model [nat].

    Parameters
    ----------
    comparison
        Comparison of models.

    Returns
    -------
    Table
    """
    first, second = comparison.pair
    rows = []
    for name, test in comparison.tests.items():
        ratio = test.lofo_log_density[second] - test.lofo_log_density[first]
        rows.append(
            (
                name,
                f"{test.force_N:.4g}",
                _p_value(test.lofo_p_value),
                _p_value(test.lofo_family_wise_p_value),
                "FLAG" if test.flag else "",
                with_sign(ratio, 2),
            )
        )
    heads = (
        "test",
        "force (N)",
        "p",
        "p, all tests",
        "flag",
        f"ln p({comparison.sensitivity_of}) (nat)",
    )
    return Table.of("Every test as the others expect it", heads, rows, text=("flag",))


def _p_value(p: float) -> str:
    """Return a p-value as a string.

    The string has two decimals; below 0.01 it has one significant digit, or is "< 0.0001".
    """
    return f"{p:.2f}" if p >= 0.01 else p_value_digits(p, 1)
