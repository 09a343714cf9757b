"""Figures of verdicts and uncertainty budgets.

A verdict states how well the readings determine a parameter. The figure of verdicts shows the prior
and the posterior density of each parameter. A budget states the sources of an uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.identification import Identifiability
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability
from ldbb_bayes.errors import require
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import GREY, PALETTE, band, panels, styled
from ldbb_bayes.report.wording import source_words
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = ["budget_bars", "prior_and_posterior"]

# A source of uncertainty is drawn only if its share of the variance of at least one parameter
# reaches this value [%].
_SMALLEST_SHARE = 0.5
# The name of a source of uncertainty is written on its bar only if the bar is long enough. This
# value is the length that one letter needs [% of the variance].
_SHARE_PER_LETTER = 1.75
# Weights of red, green and blue in the brightness (luminance) of a colour.
_LUMINANCE = (0.2126, 0.7152, 0.0722)
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "confounded": PALETTE[1]}


@styled
def prior_and_posterior(identifiability: Identifiability) -> Figure:
    """Draw the prior and the posterior density of every parameter, with one panel per parameter.

    Both densities are normal; they ignore the condition that no compliance is negative. The colour
    of the posterior density shows the verdict on how well the readings determine the parameter.

    Parameters
    ----------
    identifiability : Identifiability
        Verdicts on the parameters, as `identify` returns them.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each parameter.

    Raises
    ------
    InputError
        ``identifiability`` is not a result of `identify`.

    Examples
    --------
    >>> identifiability = lb.identify(lb.HybridModel.first(0), campaign)
    >>> figure = lb.figures.prior_and_posterior(identifiability)
    >>> len(figure.axes) == len(identifiability.parameters)
    True
    """
    require(
        isinstance(identifiability, Identifiability),
        "identifiability must be the verdicts on parameters, got"
        f" {type(identifiability).__name__}. Give"
        " lb.figures.prior_and_posterior(lb.identify(model, campaign)).",
    )
    entries = list(identifiability.parameters.values())
    figure, all_axes = panels(len(entries), 4, 1.15, 0.5)
    for axes, entry in zip(all_axes, entries, strict=True):
        _draw_densities(axes, entry)
        axes.locator_params(nbins=3)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_title(f"{display_name(entry.name)}:\n{entry.verdict}", fontsize=8)
        axes.set_xlabel(f"u = {_uncertainty_words(entry.sd, entry.unit)}", fontsize=7)
    figure.suptitle(
        "Before the readings (grey) and after (line), each scaled to its peak; without the limit"
        " C ≥ 0"
    )
    return figure


def _draw_densities(axes: Axes, entry: ParameterIdentifiability) -> None:
    """Draw the prior and the posterior density of a parameter, each scaled to a peak of 1.

    A flat prior is not drawn.
    """
    factor, _ = display_unit(entry.unit)
    mean = entry.mean * factor
    sd = entry.sd * factor
    prior_mean = mean
    prior_sd = sd
    if np.isfinite(entry.prior_sd):
        prior_mean = entry.prior_mean * factor
        prior_sd = entry.prior_sd * factor
    wide = np.linspace(prior_mean - 3.2 * prior_sd, prior_mean + 3.2 * prior_sd, 121)
    narrow = np.linspace(-4.0, 4.0, 81) * sd + mean
    value = np.sort(np.concatenate([wide, narrow]))
    if np.isfinite(entry.prior_sd):
        band(axes, value, (0.0, _bell(value, prior_mean, prior_sd)), GREY, 0.35)
    axes.plot(value, _bell(value, mean, sd), color=_VERDICT_COLOURS[entry.verdict])


def _bell(value: Array, mean: float, sd: float) -> Array:
    """Return the density of a normal distribution at several points, scaled to a peak of 1.

    ``value`` holds the points, shape (n,). ``mean`` and ``sd`` are the mean and the standard
    deviation of the normal distribution.
    """
    density = np.exp(-0.5 * ((value - mean) / sd) ** 2)
    return density / density.max()


def _uncertainty_words(u: float, unit: str) -> str:
    """Return a standard uncertainty with its unit as a string, such as "1.2 nm/N".

    ``u`` is the standard uncertainty in the unit ``unit``, such as mm/N.
    """
    factor, label = display_unit(unit)
    return f"{round_uncertainty(u * factor)[0]} {label}"


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Draw the share of every source of uncertainty in the variance of every parameter.

    The texts at the right state the standard uncertainty u of each parameter. Sources whose shares
    are all below 0.5 % are left out.

    Parameters
    ----------
    budgets : mapping of str to Budget
        Uncertainty budgets, as `budget_uncertainty` returns them. The keys are the names of the
        parameters.

    Returns
    -------
    Figure
        A Matplotlib figure with a bar for each parameter.

    Examples
    --------
    >>> budgets = lb.analysis.budget_uncertainty(posterior)
    >>> figure = lb.figures.budget_bars({"C_XXX": budgets["C_XXX"], "C_YYY": budgets["C_YYY"]})
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['C_XXX', 'C_YYY']
    """
    figure = style.new_figure(style.WIDTH, 1.3 + 0.2 * len(budgets))
    axes = figure.subplots()
    rows = style.name_rows(axes, list(budgets))
    terms: list[str] = []
    for budget in budgets.values():
        terms += [contribution.term for contribution in budget.contributions]
    start = np.zeros(len(rows))
    for term, colour in style.term_colours(terms).items():
        shares = np.array([100.0 * budget.share(term) for budget in budgets.values()])
        if shares.max() >= _SMALLEST_SHARE:
            _draw_source(axes, rows, start, shares, source_words(term), colour)
            start = start + shares
    axes.set(
        xlim=(0.0, 100.0),
        xlabel="share of the variance (%)",
        title="What each uncertainty is made of; right: u",
    )
    labels = [_uncertainty_words(budget.u, budget.unit) for budget in budgets.values()]
    style.right_labels(axes, rows, labels)
    figure.legend(loc="outside lower center", ncols=4, fontsize=7)
    return figure


def _draw_source(
    axes: Axes, rows: Array, start: Array, shares: Array, words: str, colour: str
) -> None:
    """Draw the bars of one source of uncertainty, one bar per parameter.

    ``rows`` holds the vertical positions of the bars, ``start`` their left ends, and ``shares``
    their lengths [% of the variance]; each has the shape (parameters,). ``words`` is the name of
    the source. The name is written on bars that are long enough, so that the figure can also be
    read without colours.
    """
    axes.barh(
        rows,
        shares,
        left=start,
        color=colour,
        edgecolor="white",
        linewidth=0.4,
        height=0.8,
        label=words,
    )
    ink = "white" if np.dot(to_rgb(colour), _LUMINANCE) < 0.45 else "black"
    for k in np.flatnonzero(shares > _SHARE_PER_LETTER * len(words)):
        middle = start[k] + 0.5 * shares[k]
        axes.text(middle, rows[k], words, color=ink, fontsize=6.5, ha="center", va="center")
