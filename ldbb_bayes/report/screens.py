"""Short versions of long results for ``print``: one screen, the most important numbers first.

This module registers a function with `screen_of` for each class of results whose tables and
sentences fill more than a screen. The last sentence of a short version says how to see all tables
and sentences.
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

# Largest number of characters of a verdict that fits into one line of a table 80 characters wide.
_LONGEST_VERDICT = 42
# Largest number of effects that the verdict on a confounded parameter names in a short table.
_MOST_PARTNERS = 2
# Largest number of other designs of the next tests that a short table shows beside the recommended
# design.
_MOST_DESIGNS = 2


@screen_of.register
def _(result: Identifiability) -> tuple[Passage, ...]:
    """Return a short version of the verdicts on all parameters.

    Its table and sentences state how many parameters the readings determine, the standard
    uncertainty u of each parameter and the verdict on it, and measures that would separate
    confounded parameters.
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

    At most two effects are named, those with the largest shares of the parameter's variance. Only
    one is named if a line of the table has no room for two.
    """
    partners = wording.partners_with_shares(entry)
    for number in range(_MOST_PARTNERS, 0, -1):
        verdict = wording.short_verdict_words(entry, partners[:number])
        if len(verdict) <= _LONGEST_VERDICT:
            break
    return verdict


@screen_of.register
def _(comparison: Comparison) -> tuple[Passage, ...]:
    """Return a short version of a comparison of models.

    It has sentences on the evidence, a table of the models, and a table of the log Bayes factor
    under other assumptions.
    """
    tables = (
        models_table(comparison, least_squares=False),
        assumptions_table(comparison, slope_scales=False),
    )
    filled = [table for table in tables if table.rows]
    return (*wording.comparison_screen(comparison), "", *filled, wording.MORE)


@screen_of.register
def _(design: Design) -> tuple[Passage, ...]:
    """Return a short version of a design of the next tests.

    It states the tests to run. A table of expected standard uncertainties and further sentences
    follow. If these tests cannot separate some parameters, measures against this are listed.
    """
    first, heading, *others = wording.design_screen(design)
    items = wording.cure_items(design.limits.degeneracies, design.limits.cures)
    passages: list[Passage] = [first, heading, _expected_table(design), *others]
    if items:
        passages += [wording.TO_NARROW, items]
    return (*passages, wording.MORE)


def _expected_table(design: Design) -> Table:
    """Return a table of the standard uncertainties expected from a design, and of the prior sds.

    It has one row per parameter of interest, and columns for at most two other designs with which
    the recommended one is compared.
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
