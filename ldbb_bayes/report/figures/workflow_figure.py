"""Figure of a Bayesian workflow: the checks that compare a campaign with its model."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import beta

from ldbb_bayes.analysis.workflow import Workflow
from ldbb_bayes.report.figures.style import (
    ACCENT,
    FAINT,
    PALETTE,
    name_rows,
    new_figure,
    right_labels,
    styled,
)
from ldbb_bayes.report.wording.number_words import p_value_words

__all__ = ["workflow_checks"]

# Probability that a sorted p-value lies in the interval drawn for it, if all p-values are uniformly
# distributed.
_PROB = 0.95


@styled
def workflow_checks(workflow: Workflow) -> Figure:
    """Draw the results of the checks of a Bayesian workflow.

    The first panel shows the range of the readings of every circle, and the interval that the prior
    predicts for this range. For the second panel, each circle was left out of a fit, and its
    readings were then predicted. The panel shows the sorted p-values of these predictions. It also
    shows intervals: each p-value lies in its interval with a probability of 95 % if all p-values
    are uniformly distributed. The third panel shows the parameters that depend on their prior. The
    fourth panel shows the stacking weights of the models: the weights with which an average of all
    models predicts left-out circles best. The ranks of the simulation-based calibration are not in
    this figure; the function `rank_ecdf` draws them.

    Parameters
    ----------
    workflow : Workflow
        Results of the checks, as `check_workflow` returns them.

    Returns
    -------
    Figure
        A Matplotlib figure with four panels.

    Examples
    --------
    >>> fast = lb.HybridModel.first(0)
    >>> workflow = lb.analysis.check_workflow(fast, campaign, replicates=10, draws=19)
    >>> figure = lb.figures.workflow_checks(workflow)
    >>> len(figure.axes)
    4
    """
    circles = len(workflow.prior_ranges)
    rows = max(circles, len(workflow.prior_sensitivity), 4)
    figure = new_figure(7.2, 2.0 + 0.44 * rows)
    panels = figure.subplots(2, 2, height_ratios=[rows, max(rows * 0.8, 4)])
    _draw_prior_ranges(panels[0, 0], workflow)
    _draw_left_out(panels[0, 1], workflow)
    _draw_sensitivity(panels[1, 0], workflow)
    _draw_weights(panels[1, 1], workflow)
    return figure


def _draw_prior_ranges(axes: Axes, workflow: Workflow) -> None:
    """Draw the range of each circle's readings, and the interval that the prior predicts for it."""
    rows = name_rows(axes, list(workflow.prior_ranges))
    surprising = workflow.surprising_circles
    for row, (name, expected) in zip(rows, workflow.prior_ranges.items(), strict=True):
        axes.plot(
            [expected.low_um, expected.high_um],
            [row, row],
            color=FAINT,
            linewidth=6,
            solid_capstyle="butt",
        )
        colour = PALETTE[1] if name in surprising else ACCENT
        axes.plot(expected.measured_um, row, "o", color=colour, markersize=5)
    axes.set_xlim(0.0, None)
    axes.set_xlabel("range of the circle (µm)")
    axes.set_title(
        f"Prior prediction: measured (dots),\nexpected, {100 * workflow.prior_prob:g} % (bars)",
        fontsize=9,
    )


def _draw_left_out(axes: Axes, workflow: Workflow) -> None:
    """Draw the sorted p-values of circles that were left out of a fit, each with an interval.

    Each circle is left out of one fit, and its readings are predicted from this fit. Each p-value
    of these predictions lies in its interval with a probability of 95 % if all p-values are
    uniformly distributed.
    """
    by_size = sorted(workflow.left_out.items(), key=lambda entry: entry[1].p_value)
    names = [name for name, _ in by_size]
    rows = name_rows(axes, names)
    ranks = np.arange(1, len(names) + 1)
    low, high = beta(ranks, len(names) + 1 - ranks).interval(_PROB)
    axes.hlines(rows, low, high, color=FAINT, linewidth=6)
    outlying = workflow.outlying_circles
    for row, (name, circle) in zip(rows, by_size, strict=True):
        colour = PALETTE[1] if name in outlying else ACCENT
        axes.plot(circle.p_value, row, "o", color=colour, markersize=5)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xlabel("p-value, sorted (1)")
    axes.set_title(
        f"Circles left out: p-values (dots),\n{100 * _PROB:g} % of each if uniform (bars)",
        fontsize=9,
    )
    axes.text(
        0.03,
        0.04,
        f"together p {p_value_words(workflow.uniformity_p_value)}",
        transform=axes.transAxes,
        ha="left",
        va="bottom",
        fontsize=8,
    )


def _draw_sensitivity(axes: Axes, workflow: Workflow) -> None:
    """Draw how strongly the posterior of each parameter depends on the prior.

    Parameters that hardly depend on the prior are left out.
    """
    sensitivity = workflow.prior_sensitivity
    axes.set_xlabel("power-scaling sensitivity (1)")
    axes.set_title("Parameters that depend on the prior", fontsize=9)
    if not sensitivity:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", va="center")
        return
    rows = name_rows(axes, list(sensitivity))
    axes.barh(rows, list(sensitivity.values()), color=ACCENT, height=0.6)
    axes.set_xlim(0.0, None)


def _draw_weights(axes: Axes, workflow: Workflow) -> None:
    """Draw the stacking weights of the models, and state how well each model predicts.

    Each model predicts circles that were left out of its fit. The texts at the right state the log
    predictive density of each model minus the log predictive density of the best model.
    """
    rows = name_rows(axes, list(workflow.stacking_weights))
    axes.barh(rows, list(workflow.stacking_weights.values()), color=ACCENT, height=0.6)
    best = max(workflow.elpd.values())
    behind = []
    for name in workflow.stacking_weights:
        behind.append(f"{workflow.elpd[name] - best:.1f} nat".replace("-", "−"))
    right_labels(axes, rows, behind)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("stacking weight (1)")
    axes.set_title(
        "Models that predict circles left out;\nright: log density less the best", fontsize=9
    )
