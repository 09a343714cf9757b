"""Constant or linear compliance."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.report.document import Bullets, Paragraph, Part, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.comparison import compliance_with_local_fits, evidence
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.units import display_name

__all__ = ["degree"]


def degree(found: Findings) -> Section:
    """Evidence, what it hangs on, and where they were asked for slopes one by one and tests left out."""
    compared = found.comparison
    title = "Constant or linear"
    if not isinstance(compared, Comparison):
        return Section("degree", title, (Paragraph(f"The models were not compared: {compared}"),))
    parts: list[Part] = [Bullets(compared.verdict), _models(compared)]
    if compared.slopes is not None:
        parts.append(_slopes(compared))
    if compared.tests:
        parts.append(_tests(compared))
    parts.append(
        Picture(
            "evidence",
            "Log Bayes factor under every assumption tried",
            f"Evidence of the models, and ln B({compared.ratio}) against the scale of slopes and under other assumptions.",
            evidence(compared),
        )
    )
    if not compared.local_fits.empty:
        parts.append(
            Picture(
                "compliance_with_local_fits",
                "Compliance against force by every model, and local fits",
                "Compliance by every model and by local fits of neighbouring forces.",
                compliance_with_local_fits(compared),
            )
        )
    if compared.slopes is None and not compared.tests:
        parts.append(
            Paragraph(
                "Slopes one by one, leave-one-force-out, local fits and tests that do not belong: ldbb-bayes compare CAMPAIGN "
                "--out DIR, then report with --comparison DIR."
            )
        )
    return Section("degree", title, tuple(parts))


def _models(compared: Comparison) -> Sheet:
    first = compared.pair[0]
    rows = []
    for name, model in compared.models.items():
        value, error = compared.log_bayes_factor.get(f"{name}/{first}", (0.0, 0.0))
        gain, spread = compared.elpd_difference.get(f"{name}/{first}", (np.nan, np.nan))
        rows.append(
            [
                name,
                "0" if name == first else _signed(f"{value:+.2f} ± {max(error, 1e-3):.1g}"),
                f"{model.probability:.3g}",
                "–" if np.isnan(gain) else _signed(f"{gain:+.1f} ± {spread:.1f}"),
                f"{model.rmse_um:.2f}",
                "–" if np.isnan(model.least_squares_rmse_um) else f"{model.least_squares_rmse_um:.2f}",
            ]
        )
    heads = [
        "model", f"ln B over {first} (nat)", "probability", "one force left out (nat)", "RMSE (µm)", "RMSE, least squares (µm)",
    ]  # fmt: skip
    return sheet("Models at equal prior odds. RMSE: machine and shared nuisances", heads, rows)


def _slopes(compared: Comparison) -> Sheet:
    if compared.slopes is None:
        raise TypeError("slopes must have been weighed")
    rows = [[display_name(name), f"{probability:.2f}"] for name, probability in compared.slopes.inclusion.items()]
    return sheet("Probability that a compliance varies with force", ["compliance", "probability"], rows)


def _tests(compared: Comparison) -> Sheet:
    first, second = compared.pair
    rows = [
        [
            name,
            f"{test.force_N:.4g}",
            f"{test.belonging.p_value:.2g}",
            f"{test.belonging.family_wise_p_value:.2g}",
            "does not belong" if test.belonging.flag else "",
            _signed(f"{test.lofo_log_density[second] - test.lofo_log_density[first]:+.2f}"),
        ]
        for name, test in compared.tests.items()
    ]
    heads = ["test", "force (N)", "p", "p, all tests", "flag", f"ln p({compared.ratio}) (nat)"]
    return sheet("Every test as the others expect it", heads, rows, text=(4,))


def _signed(text: str) -> str:
    return text.replace("-", "−")
