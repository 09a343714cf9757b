"""Short versions of long results for ``print``: one screen, the most important numbers first.

`screen_of` has a function here for each class of results whose tables and sentences fill more than
a screen. The last sentence of a screen says how to see all of them.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.verdicts import Identifiability, ParameterIdentifiability
from ldbb_bayes.report import wording
from ldbb_bayes.report.comparison_tables import assumptions_table, models_table
from ldbb_bayes.results import Passage, Table, screen_of
from ldbb_bayes.units import display_name, display_unit, three_digits, two_digits

__all__ = ["screen_of"]

# Longest verdict on a parameter that fits into one line of a table 80 characters wide [characters].
_LONGEST_VERDICT = 42
# Largest number of effects that the verdict on a confounded parameter names.
_MOST_PARTNERS = 2
# Largest number of other designs that a table shows beside the recommended one.
_MOST_DESIGNS = 2


@screen_of.register
def _(result: Identifiability) -> tuple[Passage, ...]:
    """Return the most important tables and sentences on which parameters are identifiable.

    They state how many parameters the readings determine, the standard uncertainty u and the
    verdict by parameter, and the measures that would separate confounded parameters.
    """
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        u = two_digits(entry.sd, factor)
        rows.append((display_name(name), u, unit, _short_verdict(entry)))
    heads = ("parameter", "u", "unit", "verdict")
    table = Table.of("", heads, rows, text=("unit", "verdict"))
    first, *others = wording.identifiability_screen(result)
    items = wording.cure_items(result.degeneracies, result.cures)
    items += tuple(map(wording.standing_words, result.standing))
    passages: list[Passage] = [first, table, *others]
    if items:
        passages += [wording.TO_SEPARATE, items]
    return (*passages, wording.MORE)


def _short_verdict(entry: ParameterIdentifiability) -> str:
    """Return the verdict on a parameter and the effects that it is confounded with, as text.

    The effects with the largest shares of the variance are named, as many as a line has room for.
    """
    partners = wording.partners_with_shares(entry)
    for number in range(_MOST_PARTNERS, 0, -1):
        verdict = wording.short_verdict_words(entry, partners[:number])
        if len(verdict) <= _LONGEST_VERDICT:
            break
    return verdict


@screen_of.register
def _(comparison: Comparison) -> tuple[Passage, ...]:
    """Return sentences on the evidence, and tables of the models and of other assumptions."""
    tables = (
        models_table(comparison, least_squares=False),
        assumptions_table(comparison, slope_scales=False),
    )
    filled = [table for table in tables if table.rows]
    return (*wording.comparison_screen(comparison), "", *filled, wording.MORE)


@screen_of.register
def _(design: Design) -> tuple[Passage, ...]:
    """Return the tests to run, a table of expected standard uncertainties, and sentences.

    If readings of these tests cannot separate some parameters, measures against this are listed.
    """
    first, heading, *others = wording.design_screen(design)
    items = wording.cure_items(design.limits.degeneracies, design.limits.cures)
    passages: list[Passage] = [first, heading, _expected_table(design), *others]
    if items:
        passages += [wording.TO_NARROW, items]
    return (*passages, wording.MORE)


def _expected_table(design: Design) -> Table:
    """Return a table of the expected standard uncertainty and the prior sd of each parameter.

    The table has the parameters of interest only.
    """
    others = design.compared[:_MOST_DESIGNS]
    rows = []
    for name in design.parameters:
        expected = design.expected[name]
        factor, unit = display_unit(expected.unit)
        prior = "flat"
        if np.isfinite(expected.prior_sd):
            prior = three_digits(expected.prior_sd * factor)
        sds = [expected.sd, *(other.expected[name].sd for other in others)]
        rows.append((display_name(name), *(two_digits(sd, factor) for sd in sds), prior, unit))
    heads = ("expected u", "recommended", *(other.name for other in others), "prior", "unit")
    return Table.of("", heads, rows, text=("unit",))
