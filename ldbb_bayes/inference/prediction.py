"""Readings of new circles under the posterior, and bands around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    draw_of_circle,
    draw_shared,
    machine_coefficients,
    shared_columns,
    shared_terms,
)
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.posterior import model_draws_of
from ldbb_bayes.inference.residuals import (
    harmonics_of,
)
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "band_um",
    "new_circles",
    "readings_drawn",
    "replicate_left_out",
]


def new_circles(part: ModelDraws, plan: Campaign, rng: np.random.Generator) -> Iterator[Array]:
    """Readings (draws, n) [mm] of each planned test in turn, one circle for every draw."""
    bound = part.bound
    beta = part.beta
    measured, planned = _beside(bound, plan)
    names = planned.hyper_prior.names
    phi = planned.hyper_prior.draw(len(beta), rng)
    for j, name in enumerate(bound.hyper_prior.names):
        phi[:, names.index(name)] = part.phi[:, j]
    value = dict(zip(names, phi.T, strict=True))
    learnt = [name for term in shared_terms(measured.nuisance_columns) for name in term.names]
    drawn = draw_shared(measured, phi, beta, rng)
    total = machine_coefficients(planned, beta)
    for term in shared_terms(planned.nuisance_columns):
        own = term.sd_at(value) * rng.standard_normal((len(beta), len(term.names))) + (
            0.0 if term.mean is None else term.mean
        )
        for j, name in enumerate(term.names):
            if name in learnt:
                own[:, j] = drawn[:, learnt.index(name)]
        total = total + np.einsum("tkq,wq->wtk", term.values, own)
    for r, test in enumerate(plan.tests):
        own = total[:, r] + draw_of_circle(planned, phi, r, rng)
        yield readings_drawn(own, value["sigma"], test.angles_rad(), rng)


def readings_drawn(
    coefficients: Array, sigma_mm: Array, angle_rad: Array, rng: np.random.Generator
) -> Array:
    """Readings (draws, n) [mm] of circles (draws, 25) with white noise (draws,)."""
    smooth = coefficients @ basis(angle_rad).T
    return np.asarray(smooth + sigma_mm[:, None] * rng.standard_normal(smooth.shape))


def _beside(bound: BoundModel, plan: Campaign) -> tuple[BoundModel, BoundModel]:
    """The tests measured and those planned as one campaign's: with both balls' forms, all radii and
    directions of either."""
    campaign = bound.campaign
    model = bound.model
    machines = [(one.topology, dict(one.frames_mm)) for one in (campaign, plan)]
    got = f"got {machines[1][0]}. Make the plan with the campaign's topology and frames."
    require(
        machines[0] == machines[1],
        f"the plan must be of the posterior's machine {machines[0][0]}, its frames too, {got}",
    )
    new = tuple(replace(test.with_reading_um(None), name="") for test in plan.tests)
    union = replace(campaign, tests=(*campaign.plan().tests, *new))
    model = model if bound.setting.circle[0] else model.without("circle-scale")
    whole = BoundModel(model, union, pilot=campaign)
    other = sorted(set(whole.names) ^ set(bound.names))
    cure = "Fit with replace(campaign, foreseen=plan.tests), so that the model knows of them."
    require(
        not other,
        f"the plan must show only what the fit has, got planes or set-ups with {', '.join(other)}"
        f" too. {cure}",
    )
    names = [test.name for test in union.tests]
    run = len(campaign.tests)
    measured = whole.keeping(names[:run])
    measured.reduced = bound.reduced
    return measured, whole.keeping(names[run:])


def replicate_left_out(
    bound: BoundModel,
    others: Nodes,
    name: str,
    size: int,
    rng: np.random.Generator,
    *,
    each: int = 1,
) -> Array:
    """Least-squares harmonics of circles that the others expect in the place of a test of
    ``bound``, shape (size, 25) [mm]; so many of each posterior draw."""
    r = bound.test_names.index(name)
    beta, phi = others.draw(-(-size // each), rng)
    machine = beta @ bound.interest[r].T + bound.known_offset[r]
    machine = machine + draw_shared(others.bound, phi, beta, rng) @ shared_columns(bound)[r].T
    machine = np.repeat(machine, each, axis=0)[:size]
    phi = np.repeat(phi, each, axis=0)[:size]
    factor = bound.reduced[r].factor
    noise = phi[:, [bound.hyper_prior.names.index("sigma")]] * rng.standard_normal(
        (size, len(factor))
    )
    circle = (machine + draw_of_circle(bound, phi, r, rng)) @ factor.T + noise
    return np.asarray(circle @ harmonics_of(bound, r).T)


def band_um(
    coefficients: Array,
    sigma_mm: Array,
    angle_rad: Array,
    rng: np.random.Generator,
    *,
    prob: float = 0.95,
) -> Array:
    """Equal-tailed pointwise band of readings, white noise included: (2, angles) [µm] from (draws,
    25) and (draws,)."""
    readings = readings_drawn(coefficients, sigma_mm, angle_rad, rng)
    return np.quantile(readings, [(1.0 - prob) / 2.0, (1.0 + prob) / 2.0], axis=0) * 1e3


_PREDICTED = 4000


@one_blas_thread
def predict(
    posterior: xr.DataTree, plan: Campaign, *, ci_prob: float = 0.95, seed: int = 1
) -> pd.DataFrame:
    """Predict the readings of new circles on the machine of a posterior, with its bar, balls, mount
    and force device.

    Machine and what circles share come from the posterior; set-up shift, discrepancy, scatter,
    random force error and white noise are drawn anew. What the campaign says nothing of, such as
    the bar's length at another radius, has its prior. Nuisances are integrated out: draws of them,
    given each draw of the posterior, are not kept; `nuisances` gives their mean and sd.

    InputError for another machine, or circles that show parameters which the fit does not have.

    Parameters
    ----------
    posterior : from `sample`, `load` or `average`.
    plan : the circles; any readings are ignored.
    ci_prob : probability of the equal-tailed interval of a reading.

    Returns
    -------
    One row per test and angle: test, force_N, angle_deg, mean_um, median_um, ci_low_um, ci_high_um.

    Examples
    --------
    >>> table = lb.predict(posterior, lb.Plan((lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0)),)))
    """
    check_probability(ci_prob)
    check_campaign(plan)
    rng = np.random.default_rng(seed)
    levels = [0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob]
    parts = [new_circles(part, plan, rng) for part in model_draws_of(posterior, _PREDICTED)]
    tables = []
    for test, *drawn in zip(plan.tests, *parts, strict=True):
        readings = np.concatenate(drawn) * 1e3
        columns = np.vstack([readings.mean(axis=0), np.quantile(readings, levels, axis=0)])
        numbers = dict(
            zip(("mean_um", "median_um", "ci_low_um", "ci_high_um"), columns, strict=True)
        )
        tables.append(
            pd.DataFrame(
                {"test": test.name, "force_N": test.force_N, "angle_deg": test.angle_deg, **numbers}
            )
        )
    return pd.concat(tables, ignore_index=True)
