"""A report's sections in order."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from matplotlib.figure import Figure

from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.model.wording import joined
from ldbb_bayes.report.document import Document, Picture
from ldbb_bayes.report.figures import (
    alias_map,
    corner,
    correlation_map,
    efficiency,
    expected_widths,
    geometry_with_local_fits,
    nuisance_costs,
    predictive_p_values,
    prior_and_posterior,
)
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.sections.beside import Beside, beside, doubts
from ldbb_bayes.report.sections.campaign import campaign
from ldbb_bayes.report.sections.degree import degree
from ldbb_bayes.report.sections.limits import limits
from ldbb_bayes.report.sections.method import assumptions, method, sign_off
from ldbb_bayes.report.sections.path import path
from ldbb_bayes.report.sections.plan import plan
from ldbb_bayes.report.sections.quality import diagnostics, fit
from ldbb_bayes.report.sections.results import results
from ldbb_bayes.report.sections.summary import alerts, summary
from ldbb_bayes.report.sections.uncertainty import uncertainty

__all__ = ["compose"]

_SECTIONS = (summary, campaign, results, limits, degree, uncertainty, path, plan, fit, assumptions, diagnostics, method, sign_off)


def compose(
    found: Findings,
    others: tuple[Beside, ...] = (),
    *,
    same_instrument: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """All sections in order.

    Parameters
    ----------
    others : tuple of Beside
        Campaigns to set beside this one.
    progress : callable, optional
        Called with the sections done and their number.
    """
    report = progress or (lambda done, total: None)
    report(0, len(_SECTIONS))
    made = {}
    # The comparison may still be at work elsewhere: what shows it comes last, and figures are drawn as they come.
    for k, section in enumerate(sorted(_SECTIONS, key=lambda section: section in (summary, degree))):
        made[section] = section(found)
        for part in made[section].parts:
            if isinstance(part, Picture):
                _ = part.svg
        report(k + 1, len(_SECTIONS))
    sections = [made[section] for section in _SECTIONS]
    name = found.result["campaign"]["name"]
    if others:
        sections.insert(1, beside(found.result, others, same_instrument=same_instrument, ci_prob=found.ci_prob))
        name = f"{name}, beside {joined([other.name for other in others])}"
    provenance = found.result["provenance"]
    lines = (
        f"Machine {found.seen.topology}, plane {found.seen.plane}. {len(found.seen.tests)} circular tests at "
        f"{min(test.force_N for test in found.seen.tests):g} to {max(test.force_N for test in found.seen.tests):g} N.",
        f"Fitted {provenance['started'][:10]} with ldbb_bayes {provenance['versions']['ldbb-bayes']}.",
    )
    doubtful = [said for other in others for said in doubts(other, found.result)]
    return Document(f"Loaded double ball bar: {name}", lines, (*alerts(found), *doubtful), tuple(sections), _further(found))


def _further(found: Findings) -> dict[str, Callable[[], Figure]]:
    """The analyses' other figures."""
    own, compared, chosen = found.identifiability, found.comparison, found.design
    figures: dict[str, Callable[[], Figure]] = {
        "corner": partial(corner, found.posterior),
        "prior_and_posterior": partial(prior_and_posterior, own),
        "nuisance_costs": partial(nuisance_costs, own),
        "alias": partial(alias_map, own),
        "correlation": partial(correlation_map, own),
    }
    if isinstance(compared, Comparison) and compared.tests:
        figures["predictive_p_values"] = partial(predictive_p_values, compared)
    if isinstance(compared, Comparison) and not compared.local_fits.empty:
        figures["geometry_with_local_fits"] = partial(geometry_with_local_fits, compared)
    if isinstance(chosen, Design):
        figures["expected_widths"] = partial(expected_widths, chosen)
        figures["efficiency"] = partial(efficiency, chosen)
    return figures
