"""What the data cannot tell."""

from __future__ import annotations

from ldbb_bayes.report.document import Bullets, Paragraph, Picture, Section
from ldbb_bayes.report.figures.identifiability import nuisance_costs, prior_and_posterior
from ldbb_bayes.report.findings import Findings

__all__ = ["limits"]


def limits(found: Findings) -> Section:
    """Degeneracies with their cures, and what each nuisance costs."""
    own = found.identifiability
    pairs = tuple(f"{d.statement} What would: {cure}" for d, cure in zip(own.degeneracies, own.cures, strict=True))
    counted = (
        f"{own.effective_parameters:.1f} of {len(own.parameters)} parameters are narrowed by the readings against their priors"
    )
    return Section(
        "limits",
        "What the data cannot tell",
        (
            Paragraph(
                f"No number of readings of this campaign can tell apart what follows; it is told by priors alone. {counted}. "
                f"{own.basis}"
            ),
            *([Bullets(pairs)] if pairs else [Paragraph("No combination of parameters and nuisances is unseen.")]),
            *([Bullets(own.notes)] if own.notes else []),
            Picture(
                "prior_and_posterior",
                "Prior and posterior density of every parameter",
                "What was assumed (grey) and what is known after the readings, each scaled to its peak.",
                prior_and_posterior(own),
            ),
            Picture(
                "nuisance_costs",
                "Fair share of each nuisance term in the variance of every parameter",
                "What each nuisance costs: Shapley shares of the posterior variance.",
                nuisance_costs(own),
            ),
        ),
    )
