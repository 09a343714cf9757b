"""How fast are the samplers, against each other and against general ones?

One command measures everything in one run: `python studies/90_speed/run.py`. Peers need the extra `bench` and are left out
where it is not installed; `--quick` leaves them out and makes everything small.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import arviz_stats.base
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.sample import run_sampler
from ldbb_bayes.model.hybrid import BoundModel

Array = NDArray[Any]
Run = Callable[[int], tuple[Array, float]]
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from study import page  # noqa: E402

REFERENCE = "NumPyro NUTS"
PACKAGES = ("numpy", "scipy", "emcee", "jax", "numpyro", "pymc", "nutpie")


@dataclass(frozen=True)
class Contender:
    """A way to the posterior: ``run(seed)`` gives a chain (chains, draws, p + h) in mm, N, rad and the seconds it took."""

    name: str
    run: Run
    repeats: int


def ours(bound: BoundModel, sampler: str, ess: float) -> Run:
    """One of the package's samplers, from the bound model to the draws, everything included."""

    def run(seed: int) -> tuple[Array, float]:
        clock = time.perf_counter()
        start = HyperPosterior(bound, truncated=False, seed=seed)
        _, beta, phi = run_sampler(sampler, start, rule=lb.StoppingRule(ess=ess), seed=np.random.SeedSequence(seed))
        return np.concatenate([beta, phi], axis=2), time.perf_counter() - clock

    return run


def contenders(bound: BoundModel, *, quick: bool, repeats: int) -> list[Contender]:
    """Whoever is installed."""
    ess = 1000.0 if quick else 10_000.0
    found = [Contender(name, ours(bound, name, ess), repeats) for name in ("joint", "independent")]
    if quick:
        return found
    if _installed("numpyro", "jax"):
        nuts = _peers().ReducedNuts
        variants = {
            REFERENCE: nuts(bound, whitened=False, dense_mass=False, target_accept=0.8),
            "NumPyro NUTS, dense mass matrix": nuts(bound, whitened=False),
            "NumPyro NUTS, whitened by hand": nuts(bound),
            "NumPyro NUTS, dense, density for any sampling": nuts(bound, whitened=False, general=True, draws=500),
        }
        for name, peer in variants.items():
            peer.prepare()
            found.append(Contender(name, peer.run, repeats))
    if _installed("pymc", "nutpie"):
        plain = {"parametrisation": "noncentred", "low_rank": False}
        for name, settings in (("PyMC/nutpie, plain", plain), ("PyMC/nutpie, rearranged by hand", {})):
            peer = _peers().PlainNutpie(bound, **settings)
            peer.prepare()
            found.append(Contender(name, peer.run, repeats))
    return found


def race(bound: BoundModel, model: lb.HybridModel, campaign: lb.Campaign, *, quick: bool, repeats: int) -> dict[str, Any]:
    """Minimum bulk ESS per second of everyone, each repeat one after the other, and how far all are from the exact marginals."""
    exact = lb.marginals(model, campaign)
    runners = contenders(bound, quick=quick, repeats=repeats)
    rows: dict[str, dict[str, Any]] = {
        runner.name: {"ess_per_second": [], "seconds": [], "min_bulk_ess": [], "worst_mean_z": [], "worst_sd_error": []}
        for runner in runners
    }
    for repeat in range(repeats):
        for runner in runners:
            if repeat >= runner.repeats:
                continue
            chain, seconds = runner.run(repeat + 1)
            ess = np.array([_bulk_ess(chain[..., j]) for j in range(chain.shape[2])])
            flat = chain.reshape(-1, chain.shape[2])
            error = exact["sd"].to_numpy() / np.sqrt(ess)
            row = rows[runner.name]
            row["seconds"].append(seconds)
            row["min_bulk_ess"].append(float(ess.min()))
            row["ess_per_second"].append(float(ess.min() / seconds))
            row["worst_mean_z"].append(float(np.abs((flat.mean(axis=0) - exact["mean"].to_numpy()) / error).max()))
            row["worst_sd_error"].append(float(np.abs(flat.std(axis=0) / exact["sd"].to_numpy() - 1.0).max()))
            _say(f"repeat {repeat + 1}, {runner.name}: {ess.min() / seconds:,.2f} ESS/s ({ess.min():,.0f} in {seconds:.2f} s)")
    for row in rows.values():
        row["median_ess_per_second"] = float(np.median(row["ess_per_second"]))
    for reference in [name for name in rows if name.startswith(("NumPyro", "PyMC"))]:
        base = np.array(rows[reference]["ess_per_second"])
        for row in rows.values():
            own = np.array(row["ess_per_second"])[: len(base)]
            row.setdefault("median_ratio_to", {})[reference] = float(np.median(own / base[: len(own)]))
    return rows


def cost_against_readings(sizes: list[int], *, rounds: int) -> dict[str, float]:
    """Seconds of one evaluation of the reduced likelihood (64 points), by readings per test; all sizes in turn, medians."""
    rng = np.random.default_rng(1)
    problems = []
    for n in sizes:
        plan = lb.Plan(tuple(lb.CircularTest(force, np.arange(n) * 360.0 / n) for force in (100.0, 400.0, 700.0)))
        bound = lb.HybridModel.default(1).bind(lb.HybridModel.default(1).simulate(plan, seed=2).campaign)
        phi = bound.hyper_prior.draw(64, rng)
        problems.append((bound, phi, np.tile(bound.centre, (64, 1))))
    seconds: dict[str, list[float]] = {str(n): [] for n in sizes}
    for _ in range(rounds):
        for n, (bound, phi, beta) in zip(sizes, problems, strict=True):
            clock = time.perf_counter()
            bound.log_likelihood(phi, beta)
            seconds[str(n)].append(time.perf_counter() - clock)
    return {n: float(np.median(values)) for n, values in seconds.items()}


def cost_against_tests(counts: list[int], *, size: int = 512, rounds: int = 15) -> dict[str, dict[str, float]]:
    """CPU microseconds for each φ, in stacks of ``size``, by number of tests: the least of several rounds."""
    rng, found = np.random.default_rng(1), {}
    for count in counts:
        forces = np.linspace(36.0, 742.0, count)
        plan = lb.Plan(tuple(lb.CircularTest(force, np.arange(360.0), pressure_bar=force / 126.0) for force in forces))
        bound = lb.HybridModel.default(1).bind(lb.HybridModel.default(1).simulate(plan, seed=2).campaign)
        phi, beta = bound.hyper_prior.draw(size, rng), np.tile(bound.centre, (size, 1))
        given = bound.given(phi)[1]
        calls: dict[str, Callable[[], Any]] = {
            "evidence at φ": lambda bound=bound, phi=phi: bound.log_evidence(phi),
            "likelihood": lambda bound=bound, phi=phi, beta=beta: bound.log_likelihood(phi, beta),
            "conditional of β": lambda bound=bound, phi=phi: bound.given(phi),
            "a draw of β": lambda given=given: given.draw(rng),
            "without each test": lambda bound=bound, phi=phi, beta=beta: bound.log_likelihood_per_test(phi, beta),
        }
        found[str(count)] = {name: min(_cpu_seconds(call) for _ in range(rounds)) / size * 1e6 for name, call in calls.items()}
    return found


def _cpu_seconds(call: Callable[[], Any]) -> float:
    clock = time.process_time()
    call()
    return time.process_time() - clock


def reduction(readings: int) -> dict[str, Any]:
    """Reducing one huge test against `numpy.linalg.lstsq` on its 13 columns: seconds and peak memory, each in its own process."""
    found: dict[str, Any] = {"readings": readings}
    for name in ("reduce", "lstsq"):
        done = subprocess.run(
            [sys.executable, str(HERE / "reduce.py"), name, str(readings)], capture_output=True, text=True, check=True
        )
        found[name] = json.loads(done.stdout)
    found["time_ratio"] = found["reduce"]["seconds"] / found["lstsq"]["seconds"]
    found["memory_ratio"] = found["reduce"]["peak_mb"] / found["lstsq"]["peak_mb"]
    return found


def table(results: dict[str, Any]) -> str:
    """The results in Markdown."""
    rows = []
    for name, row in results["race"].items():
        ratios = row.get("median_ratio_to", {})
        entry = {
            "sampler": name,
            "min bulk ESS/s (median)": f"{row['median_ess_per_second']:,.4g}",
            "ESS": f"{np.median(row['min_bulk_ess']):,.0f}",
            "seconds": f"{np.median(row['seconds']):.2f}",
            "worst mean (Monte Carlo errors)": f"{np.max(row['worst_mean_z']):.1f}",
            "worst sd (%)": f"{100 * np.max(row['worst_sd_error']):.1f}",
        }
        rows.append(entry | {f"× {reference}": f"{ratio:,.3g}" for reference, ratio in ratios.items()})
    frame = pd.DataFrame(rows).fillna("")
    lines = ["| " + " | ".join(frame.columns) + " |", "|" + "---|" * len(frame.columns)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in frame.itertuples(index=False)]
    cost, reduced = results["likelihood_seconds"], results["reduction"]
    first, last = next(iter(cost)), list(cost)[-1]
    lines += [
        "",
        f"One evaluation of the reduced likelihood (64 points): {cost[first] * 1e6:.0f} µs for {int(first):,} readings per test, "
        f"{cost[last] * 1e6:.0f} µs for {int(last):,} (ratio {cost[last] / cost[first]:.2f}).",
        "",
        "CPU µs for each φ, in stacks of 512, by number of tests:",
        "",
        "| tests | " + " | ".join(next(iter(results["likelihood_by_tests"].values()))) + " |",
        "|---" * 6 + "|",
        *(f"| {n} | " + " | ".join(f"{x:.1f}" for x in row.values()) + " |" for n, row in results["likelihood_by_tests"].items()),
        "",
        f"Reducing {reduced['readings']:,} readings: {reduced['reduce']['seconds']:.2f} s and "
        f"{reduced['reduce']['peak_mb']:.0f} MB; `numpy.linalg.lstsq` on their 13 columns: "
        f"{reduced['lstsq']['seconds']:.2f} s and {reduced['lstsq']['peak_mb']:.0f} MB "
        f"(ratios {reduced['time_ratio']:.2f} and {reduced['memory_ratio']:.3f}).",
        "",
        f"{results['machine']}. Versions: {', '.join(f'{name} {number}' for name, number in results['versions'].items())}.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, then write results.json, table.md and README.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="no peers, small sizes")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.json and table.md")
    options = parser.parse_args()
    if options.quick and options.out == HERE:
        parser.error("--quick must not replace the results kept here: give --out FOLDER")
    campaign = lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")
    model = lb.HybridModel.default(degree=1).without("truncation")
    repeats = 1 if options.quick else options.repeats
    sizes = [1000, 100_000] if options.quick else [1000, 10_000, 100_000, 1_000_000]
    results: dict[str, Any] = {
        "schema": 1,
        "machine": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "versions": {name: version(name) for name in PACKAGES if _has(name)},
        "reduction": reduction(200_000 if options.quick else 10_000_000),
    }
    with threadpool_limits(1):
        results["likelihood_by_tests"] = cost_against_tests([6, 12] if options.quick else [6, 12, 24, 40])
        results["likelihood_seconds"] = cost_against_readings(sizes, rounds=301)
        results["race"] = race(model.bind(campaign), model, campaign, quick=options.quick, repeats=repeats)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "results.json").write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    (options.out / "table.md").write_text(table(results), encoding="utf-8")
    print(table(results))
    if options.out == HERE:
        (HERE / "README.md").write_text(page(HERE), encoding="utf-8")


def _bulk_ess(chain: Array) -> float:
    stats = arviz_stats.base.array_stats
    return float(stats.ess(np.ascontiguousarray(chain), chain_axis=0, draw_axis=1, method="bulk"))


def _installed(*names: str) -> bool:
    return all(importlib.util.find_spec(name) is not None for name in names)


def _has(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def _peers() -> Any:
    sys.path.insert(0, str(HERE))
    import peers

    return peers


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
