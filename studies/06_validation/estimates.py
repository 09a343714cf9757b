"""What it costs that the model is linearised at Ĉ of the same readings: the same simulated
campaigns, every term on, analysed with Ĉ found in four ways.

    every term   truth and analysis linearised at one point, whatever the readings: exactly Bayesian
    estimated    as a user runs it: Ĉ and u(Ĉ) by the model's own fixed point
    squares      Ĉ by least squares, taken as known: the second edition's way
    truth        Ĉ is the truth
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.sample import draw
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.linearisation import (
    MachineEstimate,
    estimate_machine,
    planned_compliances,
)
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.setting import Setting

__all__ = ["DRAWS", "EMCEE", "MODEL", "WIDTH", "WORDS", "errors_of_estimate", "everything", "row"]

MODEL = lb.HybridModel.default(1)
DRAWS = 99
# Names of columns: whether emcee had to draw, and the sd of the draws of a parameter.
EMCEE = "by emcee"
WIDTH = "u of "
WORDS = {
    "every term": "every term, linearised at one point",
    "estimated": "as a user runs it: Ĉ of the readings, by fixed point",
    "squares": "Ĉ of the readings, by least squares",
    "truth": "linearised at the truth",
}
# Campaigns whose Ĉ is compared with the truth, and how small a size of the compliance counts as too
# small, as a share of it.
COMPARED = 60
TOO_SMALL = 0.7
# Campaigns analysed in several ways are the same ones.
SEEDS = {"every term": 60, "estimated": 6, "squares": 6, "truth": 6}


class Planned(BoundModel):
    """The model linearised at a usual machine's compliances, whatever the readings and the
    truth."""

    def _estimate_of_campaign(
        self, setting: Setting, reduced: Sequence[Reduced]
    ) -> MachineEstimate:
        return MachineEstimate.known(
            planned_compliances(self.compliances, self.model.prior),
            np.zeros(len(self.geometric_errors)),
        )

    def draw_machine(self, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(self.parameter_prior.draw(1, rng)[0])

    def linearised_at(self, beta: np.ndarray) -> Any:
        return self.setting


@dataclass(frozen=True)
class PlannedModel(lb.HybridModel):
    """A model whose simulations and analyses are all linearised at one point."""

    def bind(self, campaign: lb.Campaign) -> BoundModel:
        return Planned(self, campaign)


class BySquares(BoundModel):
    """The model linearised at the least-squares estimate, as if that were known."""

    def _estimate_of_campaign(
        self, setting: Setting, reduced: Sequence[Reduced]
    ) -> MachineEstimate:
        return estimate_machine(self._of_interest, self.model.prior, setting, reduced)


class AtTruth(BoundModel):
    """The model linearised at the true machine."""

    def __init__(
        self, model: lb.HybridModel, campaign: lb.Campaign, truth: Mapping[str, float]
    ) -> None:
        self.truth = truth
        super().__init__(model, campaign)

    def _estimate_of_campaign(
        self, setting: Setting, reduced: Sequence[Reduced]
    ) -> MachineEstimate:
        return MachineEstimate.known(
            np.array([self.truth[name.label] for name in self.compliances]),
            np.array([self.truth[name.label] for name in self.geometric_errors]),
        )


def everything() -> lb.Plan:
    """Six circles at four forces in both directions, both balls turned: every term that can act
    beside them does."""
    angle = np.arange(0.0, 360.0, 10.0)
    runs: list[tuple[int, Literal["CW", "CCW"], int, int]] = [
        (36, "CW", 0, 0),
        (742, "CCW", 0, 0),
        (742, "CW", 40, 0),
        (36, "CCW", 40, 70),
        (280, "CW", 0, 70),
        (500, "CCW", 0, 0),
    ]
    tests = []
    for force_N, direction, work_ball_deg, tool_ball_deg in runs:
        test = lb.CircularTest(
            float(force_N),
            angle,
            direction=direction,
            work_ball_deg=work_ball_deg,
            tool_ball_deg=tool_ball_deg,
        )
        tests.append(test)
    return lb.Plan(tuple(tests), radius_mm=150.0)


def bound_to(kind: str, simulation: lb.Simulation) -> BoundModel:
    """The model that analyses a simulated campaign."""
    campaign = simulation.campaign
    if kind == "every term":
        return PlannedModel(degree=1).bind(campaign)
    if kind == "squares":
        return BySquares(MODEL, campaign)
    if kind == "truth":
        return AtTruth(MODEL, campaign, simulation.parameters)
    return MODEL.bind(campaign)


def simulated(kind: str, seed: int) -> lb.Simulation:
    """The ``seed``-th campaign that `lb.calibrate` simulates."""
    for_simulation = np.random.SeedSequence(SEEDS[kind], spawn_key=(seed,)).spawn(2)[0]
    generator = PlannedModel(degree=1) if kind == "every term" else MODEL
    return generator.simulate(everything(), seed=int(for_simulation.generate_state(1)[0]))


def errors_of_estimate() -> dict[str, Any]:
    """Root mean square error of Ĉ in u(Ĉ), by compliance, and how often the size that slopes are
    measured against is too small."""
    errors = []
    small = []
    for seed in range(COMPARED):
        simulation = simulated("estimated", seed)
        bound = MODEL.bind(simulation.campaign)
        names = [name.label for name in bound.compliances]
        true = np.array([simulation.parameters[name] for name in names])
        errors.append((bound.estimate.compliances - true) / bound.estimate.compliance_sd)
        small.append(bound.setting.compliance_size_estimate < TOO_SMALL * np.abs(true))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    return {
        "campaigns": COMPARED,
        "rms_in_u": dict(zip(names, rms.tolist(), strict=True)),
        "too_small": float(np.mean(small)),
        "too_small_percent": 100.0 * TOO_SMALL,
    }


def row(kind: str, seed: int) -> dict[str, float]:
    """Ranks of the truth among posterior draws, and the sd of these, of one campaign: what
    `lb.calibrate` gives its ``seed``-th replicate."""
    for_draws = np.random.SeedSequence(SEEDS[kind], spawn_key=(seed,)).spawn(2)[1]
    simulation = simulated(kind, seed)
    bound = bound_to(kind, simulation)
    start = HyperPosterior(bound, truncated=bound.truncation.active)
    beta, phi, by_emcee = draw("independent", start, DRAWS, seed=for_draws)
    hyper = bound.hyper_prior
    p = len(bound.names)
    parameters = [simulation.parameters[name] for name in bound.names]
    hyper_parameters = [
        simulation.hyper_um[name] / float(factor)
        for name, factor in zip(hyper.names, hyper.display_factors, strict=True)
    ]
    truth = np.array(parameters + hyper_parameters)
    ranks = (np.hstack([beta, phi]) < truth).sum(axis=0)
    names = (*bound.names, *hyper.names)
    numbers = dict(zip(names, ranks.astype(float).tolist(), strict=True))
    likelihood = bound.log_likelihood(truth[None, p:], truth[None, :p])[0]
    numbers[LOG_LIKELIHOOD] = float((bound.log_likelihood(phi, beta) < likelihood).sum())
    numbers[EMCEE] = float(by_emcee)
    for name, width in zip(bound.names, beta.std(axis=0), strict=True):
        numbers[WIDTH + name] = float(width)
    return numbers
