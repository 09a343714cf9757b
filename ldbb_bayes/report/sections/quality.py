"""How well the model fits, and how the sampler ran."""

from __future__ import annotations

from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.report.document import Bullets, Paragraph, Part, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.chains import chains
from ldbb_bayes.report.figures.circles import predictive, residuals
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.units import display_name

__all__ = ["diagnostics", "fit"]

_SAID = ("looks exactly like", "are told apart by force alone")


def fit(found: Findings) -> Section:
    """RMSE, fitness and posterior predictive checks."""
    quality = found.result["fit"]
    notes = tuple(note for note in quality["warnings"] if not note.startswith("Look at") and not any(w in note for w in _SAID))
    return Section(
        "fit",
        "How well the model fits",
        (
            Paragraph(
                f"RMSE {quality['rmse_um']:.2f} µm over all readings (Eq. 34; machine and shared nuisances). The linear model "
                f"differs from the exact geometry by at most {quality['linearisation_error_um']:.4f} µm. ln P(T | y) = "
                f"{quality['log_prob_truncation']:.2f} (before: {quality['log_prob_truncation_prior']:.2f}), the log "
                "probability that the compliances held non-negative would be so unasked: far below −4 the readings contradict "
                "it."
            ),
            _checks(found),
            *([Bullets(notes)] if notes else []),
            Picture(
                "residuals",
                "Residuals of every test against angle, and their amplitude by Fourier order",
                "Reading minus prediction; each circle's own shift and discrepancy left in.",
                residuals(found.posterior),
            ),
            Picture(
                "predictive",
                "Prior and posterior predictive bands of the circle at the highest force",
                "What prior and posterior expect of a circle at the highest force.",
                predictive(found.posterior),
            ),
        ),
    )


def _checks(found: Findings) -> Sheet:
    quality = found.result["fit"]
    rows = []
    for test in found.seen.tests:
        checks = quality["predictive_checks"][test.name]
        order, least = min(checks["orders_p"].items(), key=lambda pair: pair[1])
        rows.append(
            [
                test.name,
                f"{test.force_N:.4g}",
                f"{quality['fitness_percent'][test.name]:.1f}",
                f"{least:.2g} (order {order})",
                _or_dash(checks["noise_p"]),
                _or_dash(checks["autocorrelation"]),
                _or_dash(checks["autocorrelation_p"]),
            ]
        )
    heads = [
        "test", "force (N)", "fitness (%)", "smallest p by order", "p, white noise", "autocorrelation (1)", "p, autocorrelation",
    ]  # fmt: skip
    return sheet(
        "Fitness (Eq. 35) and posterior predictive checks: small p where the model does not expect the reading", heads, rows
    )


def _or_dash(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}".replace("-", "−")


def diagnostics(found: Findings) -> Section:
    """Effective sample sizes and R-hat."""
    sampler = found.result["sampler"]
    state = "reached its target" if sampler["converged"] else "did NOT reach its target"
    parts: list[Part] = [
        Paragraph(
            f"Sampler {sampler['kind']} {state} (ESS ≥ {sampler['target_ess']:g}, R-hat ≤ {sampler['target_rhat']:g}): "
            f"{sampler['draws']} draws, {sampler['steps']} steps, smallest bulk ESS {sampler['ess_bulk_min']:.0f}, smallest "
            f"tail ESS {sampler['ess_tail_min']:.0f}, largest R-hat {sampler['rhat_max']:.4f}. ESS: independent draws the "
            "result is worth. R-hat: independent runs compared, 1 when they agree."
        ),
        _by_parameter(found),
    ]
    if sampler["kind"] != "quadrature":
        parts.append(
            Picture(
                "chains",
                "Traces and ranks of the slowest parameters",
                "Traces and ranks of the slowest parameters: level where ensembles agree.",
                chains(found.posterior),
            )
        )
    return Section("diagnostics", "Diagnostics", tuple(parts))


def _by_parameter(found: Findings) -> Sheet:
    sensitivity = record_of(found.posterior)["fit"]["sensitivity"]
    rows = [
        [
            display_name(str(name)),
            f"{row['ess_bulk']:.0f}",
            f"{row['ess_tail']:.0f}",
            f"{row['rhat']:.4f}",
            f"{sensitivity[name]['prior']:.3f}" if name in sensitivity else "",
        ]
        for name, row in found.summary.iterrows()
    ]
    heads = ["parameter", "ESS bulk", "ESS tail", "R-hat", "sensitivity to the prior (1)"]
    return sheet("By parameter; above 0.05 a number moves when its prior's scale does (power scaling)", heads, rows)
