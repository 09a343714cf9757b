"""What circles cost the kernel, and what readings cost everything."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from race import sampler_draws
from setting import (
    COLUMNS,
    MODEL,
    UNTRUNCATED,
    Array,
    Size,
    clocked,
    recovered,
    say,
    simulated,
    spread,
)

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.reduction import reduce_readings

__all__ = ["cost_of_readings", "kernel", "least_squares"]

Works = dict[str, Callable[[], Any]]


def kernel(campaigns: Mapping[str, lb.Campaign], rounds: int) -> dict[str, dict[str, Any]]:
    """CPU µs for each φ in stacks as the package uses them, of every operation on each campaign,
    all in turn in each round."""
    rng = np.random.default_rng(1)
    works = {name: kernel_works(campaign, rng) for name, campaign in campaigns.items()}
    times_us: dict[str, dict[str, list[float]]] = {}
    for name, operations in works.items():
        times_us[name] = {operation: [] for operation in operations}
    for _ in range(rounds + 1):
        for name, operations in works.items():
            for operation, work in operations.items():
                _, took = clocked(work)
                times_us[name][operation].append(took.cpu / CHUNK * 1e6)
    return {name: without_first_round(times) for name, times in times_us.items()}


def kernel_works(campaign: lb.Campaign, rng: np.random.Generator) -> Works:
    """The operations of the kernel on draws of φ."""
    bound = MODEL.bind(campaign)
    posterior = HyperPosterior(bound, truncated=False)
    phi = bound.hyper_prior.phi(compute_nodes(posterior).integral.resample(CHUNK, rng))
    _, conditional = bound.given(phi)
    beta = conditional.draw(rng)
    return {
        "evidence": partial(bound.log_evidence, phi),
        "likelihood": partial(bound.log_likelihood, phi, beta),
        "conditional": partial(bound.given, phi),
        "draw": partial(conditional.draw, rng),
    }


def without_first_round(times_us: Mapping[str, list[float]]) -> dict[str, dict[str, float]]:
    """Median and quartiles of every operation; the first round warms up."""
    return {operation: spread(times[1:]) for operation, times in times_us.items()}


def cost_of_readings(size: Size) -> dict[str, dict[str, Any]]:
    """By readings a circle, all in turn: CPU µs of the kernel, CPU seconds of the sampler, of
    `lb.sample` (once), of reducing one circle and of least squares on it."""
    circles = len(recovered().tests)
    campaigns = {str(readings): simulated(circles, readings) for readings in size.readings}
    kernels = kernel(campaigns, size.rounds)
    seconds: dict[str, dict[str, list[float]]] = {
        readings: {"independent": [], "reduce": [], "lstsq": []} for readings in campaigns
    }
    for seed in range(min(size.repeats, 3)):
        for readings, campaign in campaigns.items():
            bound = UNTRUNCATED.bind(campaign)
            _, sampling = clocked(sampler_draws, bound, "independent", size.ess, seed)
            circle = campaign.tests[0]
            angle_rad = circle.angles_rad()
            reading_mm = circle.readings_mm()
            _, reduction = clocked(reduce_readings, angle_rad, reading_mm)
            _, fit = clocked(least_squares, angle_rad, reading_mm)
            seconds[readings]["independent"].append(sampling.cpu)
            seconds[readings]["reduce"].append(reduction.cpu)
            seconds[readings]["lstsq"].append(fit.cpu)
    results = {}
    for readings, campaign in campaigns.items():
        _, took = clocked(lb.sample, MODEL, campaign)
        results[readings] = {
            "kernel": kernels[readings]["evidence"],
            **{name: spread(times) for name, times in seconds[readings].items()},
            "sample": took.cpu,
        }
        say(f"{readings} readings a circle: lb.sample {took.cpu:.2f} s")
    return results


def least_squares(angle_rad: Array, reading_mm: Array) -> Array:
    """Of the readings of one circle on a few columns, which are computed anew."""
    return np.linalg.lstsq(basis(angle_rad)[:, :COLUMNS], reading_mm, rcond=None)[0]
