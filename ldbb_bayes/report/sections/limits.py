"""What the data cannot tell."""

from __future__ import annotations

from ldbb_bayes.report.document import Bullets, Paragraph, Part, Section
from ldbb_bayes.report.findings import Findings

__all__ = ["limits"]


def limits(found: Findings) -> Section:
    """Degeneracies with their cures, and how much the readings added to the priors."""
    own = found.identifiability
    told = "The model leaves it out (least squares)." if found.flat else "Only what was assumed tells it apart."
    pairs = tuple(
        f"{d.statement} What would tell: {cure[0].lower()}{cure[1:]}" for d, cure in zip(own.degeneracies, own.cures, strict=True)
    )
    parts: list[Part] = []
    if pairs:
        parts += [
            Paragraph(f"However many readings of this kind are taken, what follows looks the same to them. {told}"),
            Bullets(pairs),
        ]
    else:
        parts.append(Paragraph("No combination of parameters and nuisances is unseen."))
    if own.notes:
        parts.append(Bullets(own.notes))
    if not found.flat:
        parts.append(
            Paragraph(
                f"Effective number of parameters {own.effective_parameters:.1f} of {len(own.parameters)}: how much the "
                "readings narrow against the priors, in parameters. An aliased one may be narrowed and still not known. "
                f"{own.basis}"
            )
        )
    return Section("limits", "What the data cannot tell", tuple(parts))
