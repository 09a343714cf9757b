"""Short versions of long results, which ``print`` shows on one screen.

A short version states the most important numbers first. This module registers a function with
`screen_of` for each class of results whose tables and sentences fill more than one screen. The last
sentence of a short version says how to see all tables and sentences.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.directional_stiffness import DirectionalStiffness
from ldbb_bayes.analysis.identification import Identifiability
from ldbb_bayes.report import wording
from ldbb_bayes.report.comparison_tables import assumptions_table, models_table
from ldbb_bayes.report.identifiability_text import certificates_table, verdicts_table
from ldbb_bayes.results import Passage, Table, screen_of, table_of
from ldbb_bayes.tables import terminal_width
from ldbb_bayes.units import (
    display_name,
    display_unit,
    three_digits,
    two_digits,
    without_slopes,
)

__all__ = ["screen_of"]

# A table of stiffnesses with more lines than this is printed for the largest force alone.
_MOST_LINES = 42
# A table compares the recommended design of the next tests with at most this many other designs.
_MOST_DESIGNS = 2


@screen_of.register
def _screen_of_identifiability(result: Identifiability) -> tuple[Passage, ...]:
    """Return a short version of the verdicts on how well the readings determine each parameter.

    The first table has one row for each parameter except slopes (coefficients of a compliance as a
    polynomial in force). Instead of the slopes, it has one row for the change of each compliance
    over the tested forces. Each row states the expanded uncertainty U (k = 2), the verdict, the
    cheapest remedy, and U with this remedy. The verdict names the largest source of variance, or
    the effects with which the quantity is confounded. A remedy is a certificate, or a change of the
    tests, that reduces U markedly. If some parameters need two remedies, a list of pairs of
    remedies follows.

    Unless the prior is flat, there is a second table, with one row for each certificate that the
    instrument lacks. If several certificates are missing, one more row shows the effect of all of
    them together. Each row names up to four parameters whose uncertainty would fall by more than a
    tenth.

    The method ``details`` of the result returns all tables and sentences, including those on the
    combinations of parameters that the readings cannot separate.
    """
    first, *others = wording.identifiability_screen(result)
    passages: list[Passage] = [first, verdicts_table(result)]
    pairs = wording.paired_remedy_items(result)
    if pairs:
        passages += [wording.IN_PAIRS, pairs]
    if result.certificates:
        passages.append(certificates_table(result, is_short=True))
    passages += [*others, *wording.not_modelled_sentences(result.not_modelled)]
    return (*passages, wording.MORE)


@screen_of.register
def _screen_of_stiffness(stiffness: DirectionalStiffness) -> tuple[Passage, ...]:
    """Return a table of the stiffnesses and directions, of the largest force alone if it is long.

    The values at all forces may not fit on a screen, for example if several planes were tested.
    """
    table = stiffness.table()
    of_all_forces = table_of(table)
    if len(of_all_forces.text(terminal_width()).splitlines()) <= _MOST_LINES:
        return (of_all_forces,)
    of_force = table[table["force_N"] == table["force_N"].max()]
    return (table_of(of_force), wording.MORE)


@screen_of.register
def _screen_of_comparison(comparison: Comparison) -> tuple[Passage, ...]:
    """Return a short version of a comparison of models.

    The short version has sentences on the evidence, a table of the models, and a table that shows
    how the log Bayes factor depends on assumptions.
    """
    tables = (
        models_table(comparison, least_squares=False),
        assumptions_table(comparison, slope_scales=False),
    )
    filled = [table for table in tables if table.rows]
    return (*wording.comparison_screen(comparison), "", *filled, wording.MORE)


@screen_of.register
def _screen_of_design(design: Design) -> tuple[Passage, ...]:
    """Return a short version of a design of the next tests.

    The short version first states the tests to run. A table of the expected standard uncertainties
    follows, and then further sentences. If the tests cannot separate some parameters, a list names
    ways to separate them.
    """
    first, heading, *others = wording.design_screen(design)
    items = wording.cure_items(design.limits.degeneracies, design.limits.cures)
    passages: list[Passage] = [first, heading, _expected_table(design), *others]
    if items:
        passages += [wording.TO_NARROW, items]
    return (*passages, wording.MORE)


def _expected_table(design: Design) -> Table:
    """Return a table of the standard uncertainties that are expected after the tests of a design.

    The design was made for certain parameters. Each of them has one row in the table. Slopes
    (coefficients of the change of compliance with force) have no row, unless the design was made
    for slopes alone. The columns state the uncertainty after the recommended design, the
    uncertainties after at most two other designs, the prior standard deviation, and the unit.
    """
    others = design.compared[:_MOST_DESIGNS]
    rows = []
    for name in without_slopes(design.parameters):
        expected = design.expected[name]
        factor, unit = display_unit(expected.unit)
        prior = "flat"
        if np.isfinite(expected.prior_sd):
            prior = three_digits(expected.prior_sd * factor)
        sds = [expected.sd, *(other.expected[name].sd for other in others)]
        rows.append((display_name(name), *(two_digits(sd, factor) for sd in sds), prior, unit))
    heads = ("expected u", "recommended", *(other.name for other in others), "prior", "unit")
    return Table.of("", heads, rows, text=("unit",))
