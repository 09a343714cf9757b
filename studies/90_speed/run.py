"""How fast are the samplers and the evidence, against NUTS, nested sampling and a bridge? What do
circles and readings cost?

python studies/90_speed/run.py                        # by hand; peers: pip install '.[bench]'
python studies/90_speed/run.py --quick --out speed    # small: shows that it runs
python studies/90_speed/run.py --restate              # the page from the results that are kept
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

# One thread and one core for everybody: XLA's threads wait by spinning, which can double the CPU
# seconds of NUTS.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)

import arviz_stats.base
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.sample import run_sampler
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.reduction import reduce_readings

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import peers
from study import DATA, page
from timed_campaigns import TOLERANCE, cost_of_campaigns

Array = NDArray[Any]
PACKAGES = ("numpy", "scipy", "emcee", "jax", "numpyro", "dynesty")
MODEL = lb.HybridModel.first(degree=1)
TRUTH = {"C_XXX": 6e-5, "C_YYY": 5e-5, "C_CCY": 5e-10}
HYPER_UM = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 3.0}
NUTS = {"NUTS, dense mass matrix": False, "NUTS, whitened by hand": True}
COLUMNS = 13
SAMPLERS = ("joint", "independent")


@dataclass(frozen=True)
class Size:
    """How much: effective draws asked for, runs of each row, circles beyond the experiment's,
    readings of a circle."""

    ess: float
    repeats: int
    circles: tuple[int, ...]
    readings: tuple[int, ...]
    rounds: int
    degrees: tuple[int, ...]
    largest_campaign: int


FULL = Size(10_000.0, 7, (12, 24, 40), (1_000, 10_000, 100_000, 1_000_000), 101, (0, 1), 40)
QUICK = Size(1000.0, 1, (12,), (1_000, 10_000), 5, (1,), 6)


@dataclass(frozen=True)
class Runner:
    """A way to the posterior: ``run(seed)`` gives a chain (chains, draws, p + h) in mm, N, rad; CPU
    seconds compiling took."""

    truncated: bool
    what: str
    target: float | None
    run: Callable[[int], Array]
    compilation: float = 0.0


@dataclass(frozen=True)
class Clocked:
    """Seconds of the processor, of all threads, and of the clock on the wall."""

    cpu: float
    wall: float


def clocked(work: Callable[[], Any]) -> tuple[Any, Clocked]:
    """What the work gives and what it took."""
    cpu = time.process_time()
    wall = time.perf_counter()
    found = work()
    return found, Clocked(time.process_time() - cpu, time.perf_counter() - wall)


def spread(values: Any) -> dict[str, float]:
    """Median and quartiles."""
    low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
    return {"median": float(median), "low": float(low), "high": float(high)}


@cache
def recovered() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(DATA / "recovered_experiment")


def simulated(circles: int, readings: int) -> lb.Campaign:
    """Circles from 36 to 742 N of so many readings each."""
    angle = np.arange(readings) * 360.0 / readings
    forces = np.linspace(36.0, 742.0, circles)
    plan = lb.Plan(
        tuple(lb.CircularTest(force, angle, pressure_bar=force / 126.0) for force in forces)
    )
    return MODEL.simulate(plan, seed=2, parameters=TRUTH, hyper_um=HYPER_UM).campaign


def has(name: str) -> bool:
    """Whether a package is installed."""
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def sampler_alone(bound: BoundModel, sampler: str, ess: float, seed: int) -> Array:
    """From the bound model to the draws: search for the modes, nodes, proposals, burn-in and
    diagnostics included."""
    start = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    drawn = run_sampler(
        sampler, start, rule=lb.inference.StoppingRule(ess=ess), seed=np.random.SeedSequence(seed)
    )
    return np.concatenate([drawn.beta, drawn.phi], axis=2)


def whole_sample(model: lb.HybridModel, campaign: lb.Campaign, sampler: str, seed: int) -> Array:
    """`lb.sample` at its defaults, all that it computes included."""
    posterior = lb.sample(model, campaign, sampler=sampler, seed=seed)["posterior"]
    bound = model.bind(campaign)
    return np.stack(
        [posterior[str(name)].to_numpy() for name in (*bound.names, *bound.hyper_prior.names)],
        axis=-1,
    )


def runners(campaign: lb.Campaign, size: Size, *, whole: bool) -> dict[str, Runner]:
    """The package's samplers with truncation and without, those of NUTS that are installed;
    ``whole``: `lb.sample` too."""
    found: dict[str, Runner] = {}
    default = lb.inference.StoppingRule().ess
    for ending, model in (("", MODEL.without("truncation")), (", truncated", MODEL)):
        bound = model.bind(campaign)
        for sampler in SAMPLERS:
            for target in dict.fromkeys([size.ess, default] if whole else [size.ess]):
                name = f"{sampler}{ending}" + ("" if target == size.ess else ", default target")
                found[name] = Runner(
                    bool(ending), sampler, target, partial(sampler_alone, bound, sampler, target)
                )
            if whole:
                run = partial(whole_sample, model, campaign, sampler)
                found[f"lb.sample, {sampler}{ending}"] = Runner(
                    bool(ending), f'lb.sample(…, sampler="{sampler}")', default, run
                )
    if has("numpyro"):
        bound = MODEL.without("truncation").bind(campaign)
        for name, whitened in NUTS.items():
            peer = peers.ReducedNuts(bound, whitened=whitened)
            _, took = clocked(peer.prepare)
            found[name] = Runner(False, name, None, peer.run, took.cpu)
    return found


def race(campaign: lb.Campaign, size: Size, *, whole: bool) -> dict[str, Any]:
    """Minimum bulk ESS per second of everyone, all in turn in each repeat, and how far they are
    from the exact marginals."""
    models = {True: MODEL, False: MODEL.without("truncation")}
    exact = {
        truncated: lb.inference.marginalize(model, campaign) for truncated, model in models.items()
    }
    everyone = runners(campaign, size, whole=whole)
    columns = (
        "cpu",
        "wall",
        "min_bulk_ess",
        "per_cpu",
        "per_wall",
        "worst_mean_z",
        "worst_sd_error",
    )
    rows: dict[str, dict[str, list[float]]] = {
        name: {column: [] for column in columns} for name in everyone
    }
    names = list(everyone)
    for repeat in range(size.repeats):
        first = repeat % len(names)
        for name in names[first:] + names[:first]:
            runner = everyone[name]
            chain, took = clocked(partial(runner.run, repeat + 1))
            mean, sd = (exact[runner.truncated][column].to_numpy() for column in ("mean", "sd"))
            ess = bulk_ess(chain, shuffled="independent" in runner.what)
            flat = chain.reshape(-1, chain.shape[2])
            z = np.abs(flat.mean(axis=0) - mean) / (sd / np.sqrt(ess))
            error = np.abs(flat.std(axis=0) / sd - 1.0)
            values = (
                took.cpu,
                took.wall,
                ess.min(),
                ess.min() / took.cpu,
                ess.min() / took.wall,
                z.max(),
                error.max(),
            )
            for column, value in zip(columns, values, strict=True):
                rows[name][column].append(float(value))
            say(
                f"{len(campaign.tests)} circles, repeat {repeat + 1}, {name}:"
                f" {ess.min() / took.cpu:,.0f} per CPU second"
            )
    return summed_up(everyone, rows)


def summed_up(
    everyone: Mapping[str, Runner], rows: Mapping[str, Mapping[str, list[float]]]
) -> dict[str, Any]:
    """Medians and quartiles of each row, and of its ratio to the best NUTS in the same repeat."""
    known = [name for name in NUTS if name in rows]
    best = max(known, key=lambda name: float(np.median(rows[name]["per_cpu"])), default=None)
    found = {}
    for name, row in rows.items():
        ratios = {}
        if best is not None and not everyone[name].truncated:
            pairs = {"cpu_ratio": "per_cpu", "wall_ratio": "per_wall"}
            ratios = {
                key: spread(np.divide(row[own], rows[best][own])) for key, own in pairs.items()
            }
        about = {
            key: getattr(everyone[name], key)
            for key in ("what", "truncated", "target", "compilation")
        }
        worst = {key: max(row[key]) for key in ("worst_mean_z", "worst_sd_error")}
        summed = {key: spread(values) for key, values in row.items() if key not in worst}
        found[name] = about | summed | worst | ratios | {"reference": name == best}
    return found


def bulk_ess(chain: Array, *, shuffled: bool) -> Array:
    """Of every parameter of a chain (chains, draws, d), by ArviZ; of ``shuffled`` draws, each of
    which comes n times, times N / Σ n², for ArviZ sees only neighbours that are the same."""
    ess = partial(arviz_stats.base.array_stats.ess, chain_axis=0, draw_axis=1, method="bulk")
    columns = [np.ascontiguousarray(chain[..., j]) for j in range(chain.shape[2])]
    times = [
        np.unique(own, return_counts=True)[1].astype(float) if shuffled else np.ones(own.size)
        for own in columns
    ]
    return np.array(
        [float(ess(own)) * own.size / (n @ n) for own, n in zip(columns, times, strict=True)]
    )


def kernel(campaigns: Mapping[str, lb.Campaign], rounds: int) -> dict[str, dict[str, Any]]:
    """CPU µs for each φ in stacks as the package uses them, of every operation on each campaign,
    all in turn in each round."""
    rng = np.random.default_rng(1)
    calls = {}
    for name, campaign in campaigns.items():
        bound = MODEL.bind(campaign)
        posterior = HyperPosterior(bound, truncated=False)
        phi = bound.hyper_prior.phi(posterior.nodes().integral.resample(CHUNK, rng))
        given = bound.given(phi)[1]
        beta = given.draw(rng)
        calls[name] = {
            "evidence": partial(bound.log_evidence, phi),
            "likelihood": partial(bound.log_likelihood, phi, beta),
            "conditional": partial(bound.given, phi),
            "draw": partial(given.draw, rng),
        }
    taken: dict[str, dict[str, list[float]]] = {
        name: {what: [] for what in own} for name, own in calls.items()
    }
    for _ in range(rounds + 1):
        for name, own in calls.items():
            for what, call in own.items():
                taken[name][what].append(clocked(call)[1].cpu / CHUNK * 1e6)
    return {
        name: {what: spread(values[1:]) for what, values in own.items()}
        for name, own in taken.items()
    }


def cost_of_readings(size: Size) -> dict[str, dict[str, Any]]:
    """By readings a circle, all in turn: CPU µs of the kernel, CPU seconds of the sampler, of
    `lb.sample` (once), of reducing one circle and of least squares on it."""
    campaigns = {str(n): simulated(len(recovered().tests), n) for n in size.readings}
    found: dict[str, dict[str, Any]] = {
        n: {"kernel": row["evidence"]} for n, row in kernel(campaigns, size.rounds).items()
    }
    taken: dict[str, dict[str, list[float]]] = {
        n: {"independent": [], "reduce": [], "lstsq": []} for n in campaigns
    }
    for seed in range(min(size.repeats, 3)):
        for n, campaign in campaigns.items():
            bound = MODEL.without("truncation").bind(campaign)
            angle = campaign.tests[0].angles_rad()
            reading = campaign.tests[0].readings_mm()
            works = (
                partial(sampler_alone, bound, "independent", size.ess, seed),
                partial(reduce_readings, angle, reading),
                partial(least_squares, angle, reading),
            )
            for what, work in zip(taken[n], works, strict=True):
                taken[n][what].append(clocked(work)[1].cpu)
    for n, campaign in campaigns.items():
        found[n] |= {what: spread(values) for what, values in taken[n].items()}
        found[n]["sample"] = clocked(partial(lb.sample, MODEL, campaign))[1].cpu
        say(f"{n} readings a circle: lb.sample {found[n]['sample']:.2f} s")
    return found


def least_squares(angle: Array, reading: Array) -> Array:
    """Of the readings of one circle on a few columns, made anew."""
    return np.linalg.lstsq(basis(angle)[:, :COLUMNS], reading, rcond=None)[0]


def evidence(size: Size) -> list[dict[str, Any]]:
    """ln p(y) of the recovered experiment from nodes, from nested sampling and by a bridge from
    draws of NUTS."""
    rows = []
    for degree in size.degrees:
        for truncated in (False, True):
            model = (
                lb.HybridModel.first(degree)
                if truncated
                else lb.HybridModel.first(degree).without("truncation")
            )
            bound = model.bind(recovered())
            ways: dict[str, tuple[int, Callable[[int], tuple[float, float]]]] = {
                "nodes": (5, partial(by_nodes, model))
            }
            if has("dynesty") and has("jax"):
                density = peers.ReducedDensity(bound)
                density.prepare()
                ways["dynesty"] = (
                    1,
                    lambda seed, density=density: peers.nested_log_evidence(density, seed=seed),
                )
            if has("numpyro") and not truncated:
                nuts = peers.ReducedNuts(bound, whitened=True)
                nuts.prepare()
                ways["bridge on NUTS"] = (
                    3,
                    lambda seed, bound=bound, nuts=nuts: peers.bridged_log_evidence(
                        bound, nuts.run(seed), seed=seed
                    ),
                )
            exact: tuple[float, float] = (np.nan, np.nan)
            for way, (repeats, work) in ways.items():
                runs = [clocked(partial(work, seed + 1)) for seed in range(repeats)]
                value, error = runs[0][0]
                exact = (value, error) if way == "nodes" else exact
                apart = abs(value - exact[0]) / float(np.hypot(error, exact[1]))
                seconds = {
                    key: spread([asdict(took)[key] for _, took in runs]) for key in ("cpu", "wall")
                }
                found = {"value": value, "error": error, "apart": apart, "runs": repeats}
                rows.append(
                    {"degree": degree, "truncated": truncated, "way": way, **found, **seconds}
                )
                say(f"evidence, degree {degree}, {way}: {value:.4f} ± {error:.4f}")
    return rows


def by_nodes(model: lb.HybridModel, seed: int) -> tuple[float, float]:
    """ln p(y) and its error; nothing is random that a seed could change."""
    found = lb.log_evidence(model, recovered())
    return found.log_value, found.error


def memory(ess: float, readings: int) -> dict[str, dict[str, float]]:
    """Peak MB of resident memory, each in a process of its own, and how much there was before the
    work began."""
    whats = ["independent", "joint", "lb.sample", "lb.log_evidence", "reduce", "lstsq"]
    whats += list(NUTS) if has("numpyro") else []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        return dict(zip(whats, pool.map(partial(peak_of, ess, readings), whats), strict=True))


def peak_of(ess: float, readings: int, what: str) -> dict[str, float]:
    """One of them, here: package and campaign are there before, a peer's own libraries and
    compilation are not."""
    bound = MODEL.without("truncation").bind(recovered())
    angle = np.arange(readings) * (2.0 * np.pi / readings)
    reading = 1e-4 * np.random.default_rng(0).standard_normal(readings)
    works: dict[str, Callable[[], Any]] = {
        "lb.sample": lambda: lb.sample(MODEL, recovered()),
        "lb.log_evidence": lambda: lb.log_evidence(MODEL, recovered()),
        "reduce": lambda: reduce_readings(angle, reading),
        "lstsq": lambda: least_squares(angle, reading),
    }
    works |= {sampler: partial(sampler_alone, bound, sampler, ess, 1) for sampler in SAMPLERS}
    works |= {
        name: lambda name=name: peers.ReducedNuts(bound, whitened=NUTS[name]).run(1)
        for name in NUTS
    }
    before = peak_mb()
    with threadpool_limits(1):
        works[what]()
    return {"before": before, "peak": peak_mb()}


def peak_mb() -> float:
    """Of this process so far, by Linux."""
    (kilobytes,) = re.findall(
        r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii")
    )
    return float(kilobytes) / 1024.0


def aims(results: dict[str, Any]) -> list[dict[str, Any]]:
    """What was aimed at, what was found, and whether it is reached."""
    rows = results["race"]
    kernels = results["kernel"]
    per_phi = {int(n): row["evidence"]["median"] for n, row in kernels.items() if n != "recovered"}
    least = min(per_phi)
    growth = max(value / per_phi[least] / (n / least) for n, value in per_phi.items() if n != least)
    table = [
        (
            "independent draws against the best NUTS, per CPU second",
            4.0,
            rows["independent"]["cpu_ratio"]["median"],
            "times",
        ),
        (
            "`joint` against the best NUTS, per CPU second",
            1.0,
            rows["joint"]["cpu_ratio"]["median"],
            "times",
        ),
    ]
    for sampler in reversed(SAMPLERS):
        found = rows[f"{sampler}, truncated"]["per_cpu"]["median"]
        table.append(
            (f"`{sampler}` with truncation, effective draws per CPU second", 20_000.0, found, "")
        )
    stated = [
        {"what": what, "aim": f"≥ {aim:,g} {unit}".strip(), "found": found, "reached": found >= aim}
        for what, aim, found, unit in table
    ]
    own = kernels["recovered"]["evidence"]["median"]
    stated.append(
        {
            "what": "kernel on the recovered experiment, µs for each φ",
            "aim": "≤ 6",
            "found": own,
            "reached": own <= 6.0,
        }
    )
    what = f"kernel's growth up to {max(per_phi)} circles over that of their number"
    stated.append({"what": what, "aim": "≤ 1", "found": growth, "reached": growth <= 1.0})
    return [*stated, *aims_of_campaigns(results["campaigns"])]


def aims_of_campaigns(rows: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What was aimed at for campaigns of the default model, and what was found."""
    ratio = max(row["conditional_us"] / row["density_us"] for row in rows.values())
    late = [name for name, row in rows.items() if row["evidence_s"] > row["asked_s"]]
    wide = [name for name, row in rows.items() if row["error"] > TOLERANCE]
    what = "p(β given y, φ) over ln p(y given φ), largest of all kinds of campaigns"
    return [
        {"what": what, "aim": "≤ 4 times", "found": ratio, "reached": ratio <= 4.0},
        {
            "what": "kinds of campaigns whose evidence takes longer than asked",
            "aim": "0",
            "found": len(late),
            "reached": not late,
        },
        {
            "what": f"kinds of campaigns whose evidence has an error above {TOLERANCE:g} nat",
            "aim": "0",
            "found": len(wide),
            "reached": not wide,
        },
    ]


def measure(size: Size) -> dict[str, Any]:
    """Everything, one after the other; memory first, for nothing else is to be there."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    results: dict[str, Any] = {
        "machine": (
            f"Python {platform.python_version()}, {platform.system()} {platform.machine()},"
            f" {os.cpu_count()} cores"
        ),
        "versions": {name: version(name) for name in PACKAGES if has(name)},
        "ess": size.ess,
        "default_ess": lb.inference.StoppingRule().ess,
        "repeats": size.repeats,
        "stack": CHUNK,
        "largest": size.readings[-1],
        "columns": COLUMNS,
        "memory": memory(size.ess, size.readings[-1]),
    }
    campaigns = {str(n): simulated(n, 360) for n in (len(recovered().tests), *size.circles)}
    with threadpool_limits(1):
        if has("jax"):
            results["density_apart"] = peers.check(MODEL.without("truncation").bind(recovered()))
        results["kernel"] = kernel({"recovered": recovered()} | campaigns, size.rounds)
        results["race"] = race(recovered(), size, whole=True)
        fewer = replace(size, repeats=min(size.repeats, 3))
        results["circles"] = {
            str(n): race(campaigns[str(n)], fewer, whole=False) for n in size.circles
        }
        results["readings"] = cost_of_readings(size)
        results["evidence"] = evidence(size)
        results["campaigns"] = cost_of_campaigns(size.largest_campaign, min(size.rounds, 21))
    results["cpu_seconds"] = sum(os.times()[:4])
    return results


def main() -> None:
    """Measure, and write results.json and the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument(
        "--restate", action="store_true", help="write the page from the results that are kept"
    )
    parser.add_argument(
        "--out", type=Path, default=HERE, help="folder for results.json and README.md"
    )
    options = parser.parse_args()
    missing = [name for name in ("numpyro", "dynesty") if not has(name)]
    if options.out == HERE and not options.restate and (options.quick or missing):
        lacks = (
            f"; {' and '.join(missing)} must be installed: pip install '.[bench]'"
            if missing
            else ""
        )
        parser.error(
            f"small or partial results must not replace those kept here: give --out FOLDER{lacks}"
        )
    for name in missing * (not options.restate):
        say(f"{name} is not installed, its rows are left out: pip install '.[bench]'")
    target = options.out / "results.json"
    results = (
        json.loads(target.read_text("utf-8"))
        if options.restate
        else measure(QUICK if options.quick else FULL)
    )
    options.out.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    if not missing or options.restate:
        results["aims"] = aims(results)
        results["commands"] = json.loads((HERE / "whole_commands.json").read_text("utf-8"))
        target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        (options.out / "README.md").write_text(page(HERE, "README.md", results), encoding="utf-8")
    for name, row in results["race"].items():
        print(f"{name:40s} {row['per_cpu']['median']:10,.0f} effective draws per CPU second")
    if any(row["apart"] > 3.0 for row in results["evidence"]):
        sys.exit("Evidences differ by more than three of their errors.")


def say(text: str) -> None:
    """Progress."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
