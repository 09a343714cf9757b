"""What every study has in common: measure, compare with what is stated, write the page from the
numbers.

A study is a folder with

    run.py          `measure(quick)` gives the numbers, `draw(results)` the figures
    README.md.j2    the page with names in place of numbers
    results.json    the numbers as stated      }
    README.md       the page                   }  written by `run.py --write`
    *.png           the figures                }
    *.csv           simulated campaigns, one row each, where there are any

`run.py` measures again and fails when a stated number is not reproduced. Of simulated campaigns it
makes a part again (`--quick`: fewer) and compares them row by row with those kept; the page is
about all that are kept. The smallest study:

    def measure(effort: Effort) -> dict[str, Any]:
        return {"rmse_um": lb.fit_least_squares(lb.read_campaign(DATA /
        "recovered_experiment")).quality.rmse_um}

    run(Study(Path(__file__).resolve().parent, measure))

and in README.md.j2 `{{ r.rmse_um | to(".2f") }} µm`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from fnmatch import filter as fnmatch_filter
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.parallel import EXECUTORS, Lost, done, executor_named

__all__ = [
    "DATA",
    "Effort",
    "Study",
    "differences",
    "executor",
    "kept",
    "page",
    "pages",
    "replicated",
    "run",
]

DATA = Path(__file__).resolve().parents[1] / "data"
Effort = Literal["quick", "usual", "write"]
Row = Mapping[str, float]
# What the command line asks for, for all that a study runs.
_ASKED = argparse.Namespace(executor="process", scheduler=None, workers=0)
RESTORE = "Restore it with `git checkout`; if the change is meant, run with --write."


def _no_figures(results: dict[str, Any]) -> Mapping[str, Figure]:
    """For studies without figures."""
    return {}


@dataclass(frozen=True)
class Study:
    """One study.

    Attributes
    ----------
    folder : Path
    measure : callable
        Effort → numbers by name, nested.
    draw : callable
        Numbers → figures by file name; called by ``--write`` only.
    tolerance : float
        Relative, of every number; where a number is smaller than one, absolute for those named in
        ``absolute``.
    absolute : dict of pattern to float
        Numbers (paths as a/b/c) that may differ by as much.
    once : tuple of patterns
        What another machine cannot reproduce (seconds): shown on the page, not compared.
    long : tuple of paths
        Numbers that take minutes: ``measure`` may leave them out with ``--quick``.
    """

    folder: Path
    measure: Callable[[Effort], dict[str, Any]]
    draw: Callable[[dict[str, Any]], Mapping[str, Figure]] = _no_figures
    tolerance: float = 0.01
    absolute: Mapping[str, float] = field(default_factory=dict)
    once: tuple[str, ...] = ()
    long: tuple[str, ...] = ()


def run(study: Study) -> None:
    """The command line of every study: measure and compare with what is stated; ``--write`` and
    ``--restate`` state anew."""
    parser = argparse.ArgumentParser(
        description=sys.modules["__main__"].__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="fewer of the simulated campaigns are made again, and not all that takes minutes",
    )
    parser.add_argument(
        "--write",
        action="store_true",
        help="state anew: all campaigns, results.json, README.md, figures",
    )
    parser.add_argument(
        "--restate",
        action="store_true",
        help="the same, but of simulated campaigns those kept are taken",
    )
    _add_executor_options(parser)
    options = parser.parse_args()
    for name in ("executor", "scheduler", "workers"):
        setattr(_ASKED, name, getattr(options, name))
    effort: Effort = "usual"
    if options.write:
        effort = "write"
    elif options.quick:
        effort = "quick"
    states_anew = options.write or options.restate
    start = time.perf_counter()
    try:
        if states_anew:
            wrong = _state(study, effort)
        else:
            wrong = _compare_with_stated(study, effort)
    except (
        lb.InputError,
        OSError,
        UnicodeDecodeError,
        json.JSONDecodeError,
        pd.errors.ParserError,
        pd.errors.EmptyDataError,
        TemplateError,
    ) as error:
        sys.exit(f"{study.folder.name}: {_said(error)}")
    if wrong:
        sys.exit(f"{study.folder.name}: not reproduced\n  " + "\n  ".join(wrong))
    outcome = "stated" if states_anew else "reproduced"
    print(f"{study.folder.name}: {outcome} in {time.perf_counter() - start:.0f} s")


def _add_executor_options(parser: argparse.ArgumentParser) -> None:
    """``--executor``, ``--scheduler`` and ``--workers``, as the package's commands have them."""
    parser.add_argument(
        "--executor", default="process", choices=EXECUTORS, help="what simulated campaigns run on"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler to use; default: workers on this machine",
    )
    parser.add_argument(
        "--workers", type=int, default=0, metavar="N", help="processes; 0: one per core"
    )


def _said(error: Exception) -> str:
    """What went wrong with a file, and the cure."""
    if isinstance(error, FileNotFoundError):
        return f"{error.filename} must exist. {RESTORE}"
    if isinstance(
        error,
        json.JSONDecodeError
        | UnicodeDecodeError
        | pd.errors.ParserError
        | pd.errors.EmptyDataError,
    ):
        return f"a file of the study is damaged: {error}. {RESTORE}"
    if isinstance(error, TemplateError):
        return f"a template asks for what is not measured or is damaged: {error}. {RESTORE}"
    return str(error)


def _measured(study: Study, effort: Effort) -> dict[str, Any]:
    """The numbers as JSON holds them, and the digests of the campaigns kept."""
    text = json.dumps(study.measure(effort), default=_plain_number)
    results = dict(json.loads(text))
    digests = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(study.folder.glob("*.csv"))
    }
    if digests:
        results["kept"] = digests
    return results


def _plain_number(value: Any) -> Any:
    """A number of NumPy as one of Python."""
    return value.item()


def _state(study: Study, effort: Effort) -> list[str]:
    """Write results.json, the pages and the figures, all made before the first is written."""
    results = _measured(study, effort)
    written = {name: page(study.folder, name, results) for name in pages(study.folder)}
    figures = study.draw(results)
    (study.folder / "results.json").write_text(
        json.dumps(results, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    for name, text in written.items():
        (study.folder / name).write_text(text, encoding="utf-8")
    for name, figure in figures.items():
        figure.savefig(study.folder / f"{name}.png", dpi=150)
    return _pages_that_differ(study.folder)


def _compare_with_stated(study: Study, effort: Effort) -> list[str]:
    """What was not reproduced, and what of the pages does not follow from the numbers."""
    file = study.folder / "results.json"
    stated = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(stated, dict):
        return [f"{file.name} must hold numbers by name. {RESTORE}"]
    measured = _measured(study, effort)
    if effort == "quick":
        for path in study.long:
            _fill(measured, stated, path.split("/"))
    return [
        *differences(measured, stated, study),
        *_unused(stated, study),
        *_pages_that_differ(study.folder),
    ]


def _fill(measured: dict[str, Any], stated: dict[str, Any], path: list[str]) -> None:
    """What is stated under a path takes the place of what was not measured."""
    *above, name = path
    for key in above:
        measured = measured[key]
        stated = stated[key]
    measured.setdefault(name, stated[name])


def _unused(stated: Any, study: Study) -> list[str]:
    """Tolerances by name that no number has."""
    paths = _paths(stated)
    return [
        f"{pattern}: the study names it, but nothing it measures is called so"
        for pattern in (*study.absolute, *study.once)
        if not fnmatch_filter(paths, pattern)
    ]


def _paths(value: Any, path: str = "") -> list[str]:
    """Names of all numbers and of what holds them, as a/b/c."""
    paths = [path]
    for key, child in _children(value):
        paths += _paths(child, _joined(path, key))
    return paths


def _children(value: Any) -> list[tuple[Any, Any]]:
    """What a dictionary or a list holds, by key or index; nothing of a number."""
    if isinstance(value, dict):
        return list(value.items())
    if isinstance(value, list):
        return list(enumerate(value))
    return []


def _joined(path: str, key: Any) -> str:
    """Name of what stands under a key."""
    return f"{path}/{key}".lstrip("/")


def _pages_that_differ(folder: Path) -> list[str]:
    """Pages that are not what their templates give, and figures that they show and are not
    there."""
    wrong = [
        f"{path.name}.j2 must exist. {RESTORE}"
        for path in folder.glob("*.md")
        if path.name not in pages(folder)
    ]
    for name in pages(folder):
        text = (folder / name).read_text(encoding="utf-8")
        if text != page(folder, name):
            wrong.append(f"{name} is not what {name}.j2 and results.json give. {RESTORE}")
        wrong += [
            f"{name} shows {figure}, which is not there. {RESTORE}"
            for figure in re.findall(r"\]\(([^):]+\.png)\)", text)
            if not (folder / figure).is_file()
        ]
    return wrong


def differences(new: Any, old: Any, study: Study, path: str = "") -> list[str]:
    """What was not reproduced, by name; what is stated and no longer measured, or the reverse."""
    if any(fnmatch(path, pattern) for pattern in study.once):
        return []
    if isinstance(old, dict) and isinstance(new, dict):
        return _differences_by_key(new, old, study, path)
    texts: list[str] = []
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (new_value, old_value) in enumerate(zip(new, old, strict=True)):
            texts += differences(new_value, old_value, study, f"{path}/{index}")
    elif isinstance(old, float) and isinstance(new, float | int):
        if not _is_reproduced(new, old, study, path):
            texts.append(f"{path}: {new:.6g}, stated {old:.6g}")
    elif new != old:
        texts.append(f"{path}: {new!r}, stated {old!r}")
    return texts


def _differences_by_key(
    new: dict[str, Any], old: dict[str, Any], study: Study, path: str
) -> list[str]:
    """Differences of what stands under each key, and keys that are in one of them only."""
    texts: list[str] = []
    for key in dict.fromkeys([*old, *new]):
        name = _joined(path, key)
        if key not in new:
            texts.append(f"{name}: stated, not measured")
        elif key not in old:
            texts.append(f"{name}: measured, not stated")
        else:
            texts += differences(new[key], old[key], study, name)
    return texts


def _is_reproduced(new: float, old: float, study: Study, path: str) -> bool:
    """Whether a number is what is stated, within the study's tolerances."""
    if math.isnan(new) and math.isnan(old):
        return True
    allowed = 0.0
    for pattern, size in study.absolute.items():
        if fnmatch(path, pattern):
            allowed = max(allowed, size)
    return math.isclose(new, old, rel_tol=study.tolerance, abs_tol=allowed)


def pages(folder: Path) -> list[str]:
    """Pages of a study: README.md and what else has a template."""
    return sorted({"README.md", *(path.stem for path in folder.glob("*.md.j2"))})


def page(folder: Path, name: str = "README.md", results: Mapping[str, Any] | None = None) -> str:
    """A page of a study: its template filled with ``results`` as ``r`` (default: results.json),
    other JSON under its name."""
    environment = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "to": _to,
        "sig": _sig,
        "of": _of,
        "least": _least,
        "most": _most,
        "mean": _mean,
    }
    if not (folder / f"{name}.j2").is_file():
        raise FileNotFoundError(2, "no template", str(folder / f"{name}.j2"))
    numbers = {
        path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")
    }
    if results is None:
        results = numbers["results"]
    return environment.get_template(f"{name}.j2").render(numbers, r=results, pm=_plus_minus)


def _to(value: float, form: str = ".2f", factor: float = 1.0) -> str:
    """A number with a true minus sign: ``{{ x | to("+.2f", 1e6) }}``."""
    text = format(value * factor, form)
    mantissa, e, exponent = text.partition("e")
    if e:
        text = f"{mantissa}e{int(exponent)}"
    return text.replace("-", "−")


def _sig(value: float, digits: int = 2, factor: float = 1.0) -> str:
    """So many significant digits, written out: 0.10, 5.5, 200."""
    size = value * factor
    if not size:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(float(f"{size:.{digits - 1}e}"))))
    return _to(round(size, places), f".{max(places, 0)}f")


def _plus_minus(mean: float, sd: float, factor: float = 1.0, digits: int = 2) -> str:
    """−110.9 ± 5.8: the sd to two digits, the mean to the same place."""
    places = digits - 1 - math.floor(math.log10(abs(sd * factor)))
    rounded = round(sd * factor, places)
    places = digits - 1 - math.floor(math.log10(abs(rounded)))
    form = f".{max(places, 0)}f"
    return f"{_to(round(mean * factor, places) + 0.0, form)} ± {_to(rounded, form)}"


def _of(table: Mapping[str, Mapping[str, float]], column: str) -> list[float]:
    """One column of rows by name."""
    return [row[column] for row in table.values()]


def _values(numbers: Mapping[str, float] | Sequence[float]) -> list[float]:
    """Numbers by name, or one after the other, as a list."""
    return list(numbers.values()) if isinstance(numbers, Mapping) else list(numbers)


def _least(numbers: Mapping[str, float] | Sequence[float]) -> float:
    return min(_values(numbers))


def _most(numbers: Mapping[str, float] | Sequence[float]) -> float:
    return max(_values(numbers))


def _mean(numbers: Mapping[str, float] | Sequence[float]) -> float:
    return sum(_values(numbers)) / len(_values(numbers))


def replicated(
    path: Path,
    job: Callable[[str, int], Row],
    kinds: Mapping[str, int],
    effort: Effort,
    *,
    again: Mapping[Effort, int],
    tolerance: float = 0.01,
    astray: float = 0.0,
    of_draws: float = np.inf,
) -> pd.DataFrame:
    """Simulated campaigns, one row each with columns kind, seed and what ``job(kind, seed)`` gives.

    ``--write`` makes all of them and keeps them in ``path``. Otherwise ``again[effort]`` of each
    kind are made again, and each must be what is kept; all that are kept are returned.

    Parameters
    ----------
    job : callable
        Importable, because workers import it; the same seed gives the same row.
    kinds : dict of kind to int
        How many of each.
    tolerance : float
        Relative to each column's largest absolute value.
    astray, of_draws : float
        See `kept`.
    """
    jobs: list[tuple[str, int]] = []
    for kind, count in kinds.items():
        count_again = min(count, again.get(effort, count))
        jobs += [(kind, seed) for seed in range(count_again)]
    rows = pd.DataFrame(_on_all_cores(job, jobs))
    return kept(path, rows, kinds, effort, tolerance=tolerance, astray=astray, of_draws=of_draws)


def kept(
    path: Path,
    rows: pd.DataFrame,
    kinds: Mapping[str, int],
    effort: Effort,
    *,
    tolerance: float = 0.01,
    astray: float = 0.0,
    of_draws: float = np.inf,
) -> pd.DataFrame:
    """Keep the rows (``--write``), or compare them with those kept; returns all that are kept,
    see `replicated`.

    Parameters
    ----------
    astray : float
        Share of the rows made again that may differ by more: those of random draws part for good
        where a choice hangs on the last digit, which versions of the libraries, and kernels of
        OpenBLAS, round differently.
    of_draws : float
        What numbers (not decisions) of such rows may differ by, as ``tolerance``: a few Monte Carlo
        errors.
    """
    if effort == "write":
        rows.to_csv(path, index=False, float_format="%.6g", lineterminator="\n")
        return pd.read_csv(path)
    stored = pd.read_csv(path)
    if not {"kind", "seed"} <= set(stored.columns):
        sys.exit(
            f"{path.parent.name}/{path.name}: must have columns kind and seed, has"
            f" {', '.join(stored.columns)}. {RESTORE}"
        )
    counts = {str(kind): int(count) for kind, count in stored["kind"].value_counts().items()}
    if counts != dict(kinds):
        sys.exit(
            f"{path.parent.name}/{path.name}: holds {counts}, the study asks for {dict(kinds)}."
            f" {RESTORE}"
        )
    _compare(rows, stored, f"{path.parent.name}/{path.name}", tolerance, astray, of_draws)
    return stored


def _compare(
    rows: pd.DataFrame,
    stored: pd.DataFrame,
    file: str,
    tolerance: float,
    astray: float = 0.0,
    of_draws: float = np.inf,
) -> None:
    """Refuse rows that are not those kept."""
    both = rows.merge(
        stored, on=["kind", "seed"], suffixes=("", " kept"), how="left", validate="one_to_one"
    )
    columns = [name for name in rows.columns if name not in ("kind", "seed")]
    missing = [name for name in columns if name not in stored.columns]
    if missing:
        sys.exit(f"{file}: {', '.join(missing)} are not kept. {RESTORE}")
    measured = [name for name in columns if not stored[name].isin([0, 1]).all()]
    differs = _differs(both, columns, stored, tolerance)
    differs_far = _differs(both, measured, stored, of_draws)
    indices = np.flatnonzero(differs.any(axis=1))
    if differs_far.any(axis=None):
        _refuse(file, both, differs_far)
    if len(indices) > astray * len(both):
        _refuse(file, both, differs)
    if len(indices):
        print(f"{file}: {len(indices)} of {len(both)} rows of random draws came out differently")


def _refuse(file: str, both: pd.DataFrame, differs: pd.DataFrame) -> NoReturn:
    """End with the first number that differs, and how many rows do."""
    indices = np.flatnonzero(differs.any(axis=1))
    row = both.iloc[indices[0]]
    name = differs.columns[differs.iloc[indices[0]]][0]
    sys.exit(
        f"{file}: {row['kind']}, seed {row['seed']}: {name} is {row[name]:.6g}, kept"
        f" {row[f'{name} kept']:.6g}; {len(indices)} of {len(both)} rows differ"
    )


def _differs(
    both: pd.DataFrame, names: list[str], stored: pd.DataFrame, tolerance: float
) -> pd.DataFrame:
    """Where columns of rows made again are not those kept, within a tolerance relative to the
    largest value kept; with an infinite tolerance any number may stand for any other."""
    columns = {}
    for name in names:
        new = both[name]
        old = both[f"{name} kept"]
        is_far = pd.Series(False, index=both.index)
        if np.isfinite(tolerance):
            is_far = (new - old).abs() > tolerance * stored[name].abs().max()
        columns[name] = is_far | (new.isna() != old.isna())
    return pd.DataFrame(columns, index=both.index)


@contextmanager
def executor() -> Iterator[Executor | None]:
    """What the jobs run on, as ``--executor``, ``--scheduler`` and ``--workers`` ask; default: all
    cores; None: this process."""
    with executor_named(_ASKED.executor, _ASKED.workers, _ASKED.scheduler) as pool:
        if _ASKED.scheduler is not None:
            _send_along()
        yield pool


def _send_along() -> None:
    """Modules of the studies go to the workers with the jobs: other machines have the package
    alone."""
    import cloudpickle

    studies = Path(__file__).resolve().parent
    for module in list(sys.modules.values()):
        path = getattr(module, "__file__", None)
        if path is None or module.__name__ == "__main__":
            continue
        if Path(path).is_relative_to(studies):
            cloudpickle.register_pickle_by_value(module)


def _on_all_cores(
    job: Callable[[str, int], Row], jobs: Sequence[tuple[str, int]]
) -> list[dict[str, Any]]:
    """Rows in the order of the jobs; progress on standard error where that is a terminal."""
    rows: dict[int, dict[str, Any]] = {}
    with executor() as pool:
        for index, row in done(partial(_row, job), jobs, pool):
            if isinstance(row, Lost):
                kind, seed = jobs[index]
                raise lb.InputError(
                    f"every simulated campaign must give a row, {kind}, seed {seed} gave none:"
                    f" {row.reason}."
                )
            rows[index] = row
            if sys.stderr.isatty():
                end = "" if len(rows) < len(jobs) else "\n"
                print(f"\r{len(rows)} of {len(jobs)} simulated campaigns", end=end, file=sys.stderr)
    return [rows[index] for index in range(len(jobs))]


def _row(job: Callable[[str, int], Row], kind_and_seed: tuple[str, int]) -> dict[str, Any]:
    """The row of one simulated campaign."""
    kind, seed = kind_and_seed
    row: dict[str, Any] = {"kind": kind, "seed": seed}
    for name, value in job(kind, seed).items():
        row[name] = float(value)
    return row
