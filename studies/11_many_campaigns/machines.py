"""Fleets of machines and a machine over the months, all measured with one bar, and what their
campaigns say.

The bar's errors, the mount's deflection and the gain of the force, are drawn once a fleet;
everything else of the model, ball form and bar length too, is drawn anew for each campaign, as the
analysis believes. A machine keeps its changes of compliance with force from month to month: slopes,
and what its axes yield under their own load; and how compliance changes along the travel. Both are
written out here from the formulas of the model.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import ldbb_bayes as lb
from ldbb_bayes.campaign.placed_circles import placed_circles
from ldbb_bayes.fleet.campaign_statistics import sufficient_statistics
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.terms import ForceError, Mount

__all__ = [
    "FORCES_N",
    "MACHINES",
    "MONTHLY_FORCES_N",
    "MONTHLY_READINGS",
    "READINGS",
    "REPEATABILITY",
    "fleet",
    "months",
]

FORCES_N = (36.0, 150.0, 270.0, 389.0, 505.0, 625.0, 742.0)
READINGS = 90
MACHINES = 12
# Campaigns on every machine of a fleet.
CAMPAIGNS = 1
SPREAD_SCALE = 0.3
REPEATABILITY = 0.01
HYPER_UM = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 3.0}
MODEL = lb.HybridModel.first(degree=1)
# A machine is followed as `batch` does it by default, with circles as the documentation advises:
# both ways and in random order.
MODEL_OF_MONTHS = lb.HybridModel.default(degree=1)
MONTHLY_FORCES_N = (389.0, 742.0, 36.0, 625.0, 150.0, 505.0, 270.0, 389.0)
DIRECTIONS = ("CW", "CCW")
MONTHLY_READINGS = 60
PLAN = lb.Plan(
    tuple(
        lb.CircularTest(force_N=force, angle_deg=np.arange(READINGS) * 360.0 / READINGS)
        for force in FORCES_N
    ),
    name="seven forces",
)
# What differs from campaign to campaign; the mount and the force's gain are the bar's and added
# below.
MODEL_OF_CAMPAIGN = MODEL.with_term(ForceError(gain_sd=1e-12, curvature_sd=0.0)).without(
    "mount", "truncation"
)
BOUND = MODEL.without("truncation").bind(PLAN)
COMPLIANCES = tuple(p.name for p in BOUND.parameters if p.group == "compliance")
PRIOR_SD = dict(zip(BOUND.names, BOUND.prior_sd, strict=True))
MONTHLY_PLAN = lb.Plan(
    tuple(
        lb.CircularTest(
            force_N=force,
            angle_deg=np.arange(MONTHLY_READINGS) * 360.0 / MONTHLY_READINGS,
            direction=DIRECTIONS[place % 2],
        )
        for place, force in enumerate(MONTHLY_FORCES_N)
    ),
    name="eight circles",
    order="random",
)
MODEL_OF_MONTH = MODEL_OF_MONTHS.without(
    "mount", "force-error", "truncation", "joint-load", "position"
)
USUAL = {"C_XXX": 6e-5, "C_YYY": 5e-5, "C_CCY": 5e-10}


class Bar:
    """One instrument: its mount deflects and its force is off by as much as the priors say, the
    same in all campaigns."""

    def __init__(self, rng: np.random.Generator) -> None:
        nominal = PLAN.mount.deflection_um_per_bar
        self.mount_um_per_bar = Mount().relative_sd * nominal * rng.standard_normal()
        self.gain = ForceError().gain_sd * rng.standard_normal()

    def measured(self, compliances: Mapping[str, float], rng: np.random.Generator) -> lb.Campaign:
        """A campaign on a machine of these compliances; slopes and geometric errors are drawn from
        their priors."""
        parameters = dict(compliances)
        for name, sd in PRIOR_SD.items():
            if name not in COMPLIANCES:
                parameters[name] = sd * rng.standard_normal()
        # A force that is off by the gain looks like compliances that are.
        for name in parameters:
            if name.startswith("C_"):
                parameters[name] *= 1.0 + self.gain
        campaign = MODEL_OF_CAMPAIGN.simulate(
            PLAN, seed=int(rng.integers(2**31)), parameters=parameters, hyper_um=HYPER_UM
        ).campaign
        tests = []
        for test in campaign.tests:
            reading_um = np.asarray(test.reading_um) + self.mount_um(test)
            tests.append(test.with_reading_um(reading_um))
        return replace(campaign, tests=tuple(tests))

    def mount_um(self, test: lb.CircularTest) -> float:
        """How far the mount deflects [µm]."""
        return self.mount_um_per_bar * float(test.pressure_bar or 0.0)


class Machine:
    """A machine over the months: slopes, joint loads and the change of compliance along the travel
    are its own, drawn from the priors that the model sizes by its compliances."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.level = usual(rng)
        span_N = max(FORCES_N) - min(FORCES_N)
        self.slope = {}
        for name, value in self.level.items():
            size = max(abs(value), 0.05 * PRIOR_SD[name])
            self.slope[f"{name}_1"] = 0.3 * size / span_N * rng.standard_normal()
        self.loads = {name: 0.4 * rng.standard_normal(3) for name in ("C_XXX", "C_YYY")}
        self.travel = {
            name: np.array([0.07, 0.04]) * rng.standard_normal(2) for name in ("C_XXX", "C_YYY")
        }

    def yields_um(self, force_N: float, angle_rad: np.ndarray) -> np.ndarray:
        """What the two axes yield besides C F u², radially: C F u² times
        a (F|u| − F0)/F_max + b ((F0/(F|u|))^(1/3) − 1) + d ((F0/F)^(1/3) − 1) of the joint load,
        and L u + Q (u² − ½) along the travel, u = cos θ or sin θ."""
        reference_N = 0.5 * (min(FORCES_N) + max(FORCES_N))
        total = np.zeros(len(angle_rad))
        for name, u in {"C_XXX": np.cos(angle_rad), "C_YYY": np.sin(angle_rad)}.items():
            rolling, contact, seat = self.loads[name]
            load_N = np.maximum(force_N * np.abs(u), 1e-9)
            change = rolling * (load_N - reference_N) / max(FORCES_N)
            change += contact * (np.cbrt(reference_N / load_N) - 1.0)
            change += seat * (np.cbrt(reference_N / force_N) - 1.0)
            linear, quadratic = self.travel[name]
            change += linear * u + quadratic * (u**2 - 0.5)
            total += 1e3 * self.level[name] * force_N * u**2 * change
        return total

    def measured(
        self, bar: Bar, compliances: Mapping[str, float], rng: np.random.Generator
    ) -> lb.Campaign:
        """The circles of a month; geometric errors are drawn from their priors."""
        elastic = {**compliances, **self.slope}
        # A force that is off by the gain looks like compliances that are.
        parameters = {name: value * (1.0 + bar.gain) for name, value in elastic.items()}
        for name, sd in PRIOR_SD.items():
            if name.startswith("E_"):
                parameters[name] = sd * rng.standard_normal()
        campaign = MODEL_OF_MONTH.simulate(
            MONTHLY_PLAN,
            seed=int(rng.integers(2**31)),
            parameters=parameters,
            hyper_um=HYPER_UM | {"tau": 0.6},
        ).campaign
        tests = []
        for test in campaign.tests:
            yields_um = self.yields_um(float(test.force_N or 0.0), np.deg2rad(test.angle_deg))
            reading_um = np.asarray(test.reading_um) + bar.mount_um(test) + yields_um
            tests.append(test.with_reading_um(reading_um))
        return replace(campaign, tests=tuple(tests))


def row_of(campaign: lb.Campaign, model: lb.HybridModel = MODEL) -> dict[str, Any]:
    """What a batch would keep of a campaign, without the fit that `fit_population` and `find_trend`
    do not use."""
    bound = model.bind(campaign)
    return {
        "campaign": campaign.name,
        "name": campaign.name,
        "status": "done",
        "machine_id": campaign.machine_id,
        "date": campaign.date,
        "topology": campaign.topology,
        "planes": ",".join(campaign.machine().planes),
        "circles": json.dumps(sorted(placed_circles(campaign), key=str)),
        "sha256": campaign.sha256,
        "circles_sha256": campaign.circles_sha256,
        "compliances": None,
        "kinds": [],
        "terms": list(bound.terms),
        "tolerances": None,
        "reference_force_N": bound.setting.reference_force_N,
        "force_min_N": campaign.forces_N.min(),
        "force_max_N": campaign.forces_N.max(),
        "converged": True,
        **sufficient_statistics(HyperPosterior(bound, truncated=False)).columns(),
    }


def usual(rng: np.random.Generator) -> dict[str, float]:
    """A kind of machine: direct compliances as machines have them, the others from their priors."""
    compliances = {}
    for name in COMPLIANCES:
        if name in USUAL:
            compliances[name] = USUAL[name] * rng.uniform(0.7, 1.3)
        else:
            compliances[name] = PRIOR_SD[name] * rng.standard_normal()
    return compliances


def fleet(seed: int) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Rows of a fleet of machines, and its truth: means, spreads, machines."""
    rng = np.random.default_rng([11, seed])
    bar = Bar(rng)
    mean = usual(rng)
    spread = {
        name: SPREAD_SCALE * PRIOR_SD[name] * abs(rng.standard_normal()) for name in COMPLIANCES
    }
    machines = {}
    for m in range(MACHINES):
        machines[f"M{m:02d}"] = {
            name: mean[name] + spread[name] * rng.standard_normal() for name in COMPLIANCES
        }
    rows = []
    for machine, compliances in machines.items():
        for k in range(CAMPAIGNS):
            campaign = bar.measured(compliances, rng)
            campaign = replace(campaign, name=f"{machine}-{k}", machine_id=machine)
            rows.append(row_of(campaign))
    return pd.DataFrame(rows), {"mean": mean, "spread": spread, "machines": machines}


class Months(NamedTuple):
    """Rows of one machine, a campaign a month, and its compliances in the last month."""

    rows: pd.DataFrame
    level: Mapping[str, float]


def months(
    seed: int, *, months_before: int, months_after: int, change: float, parameter: str = "C_XXX"
) -> Months:
    """A campaign a month; after ``months_before`` of them one compliance changes by the share
    ``change``."""
    rng = np.random.default_rng([12, seed])
    bar = Bar(rng)
    machine = Machine(rng)
    level = dict(machine.level)
    rows = []
    for month in range(months_before + months_after):
        if month == months_before:
            level[parameter] += change * machine.level[parameter]
        compliances = {
            name: value + REPEATABILITY * PRIOR_SD[name] * rng.standard_normal()
            for name, value in level.items()
        }
        date = f"{2024 + month // 12}-{month % 12 + 1:02d}-05"
        campaign = replace(
            machine.measured(bar, compliances, rng),
            name=f"month {month + 1:02d}",
            machine_id="VMC 07",
            date=date,
        )
        rows.append(row_of(campaign, MODEL_OF_MONTHS))
    return Months(pd.DataFrame(rows), level)
