"""What the page of ``ldbb-bayes app`` asks to be worked out, in processes of their own: what files
hold and rest on, the report, what more circles would show. Answers are plain values, ready for a
template."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Direction
from ldbb_bayes.cli.arguments import (
    LAYOUT_OPTIONS,
    campaign_fields,
    instrument_fields,
    model_from,
)
from ldbb_bayes.cli.file_reports import STEPS, report_files
from ldbb_bayes.cli.fits import with_tolerances
from ldbb_bayes.cli.options import NUMBERS, Kind, Option, group, option, options_of
from ldbb_bayes.cli.output import Output
from ldbb_bayes.cli.progress import steps_of
from ldbb_bayes.cli.questions import MACHINES
from ldbb_bayes.cli.reporting import REPORT_OPTIONS
from ldbb_bayes.cli.sources import ReportSource
from ldbb_bayes.errors import InputError, plain_reason, require
from ldbb_bayes.files import write_whole
from ldbb_bayes.units import display_name, display_unit

if TYPE_CHECKING:
    from ldbb_bayes.analysis.candidates import Space
    from ldbb_bayes.reading.importing import Imported

__all__ = [
    "FIELDS",
    "FILES",
    "RESULT",
    "TOML",
    "Field",
    "answer",
    "forecast",
    "main",
    "plan",
    "understand",
    "warm",
    "worth",
]

FILES = "campaign"
RESULT = "result"
PLAN = "plan"
TOML = "campaign.toml"
_DCC = ".xml"
_WAYS: Mapping[str, tuple[Direction, ...]] = {"both": ("CW", "CCW"), "CW": ("CW",), "CCW": ("CCW",)}
_ALL_DRAWN = 360
_MOST_CIRCLES = 60
_CANDIDATES = 720
_SEARCHED = 12
_FEW_KINDS = 4
_FEW = 32
# Of the largest reductions of a certificate those shown, and the least that is one.
_MOST_EFFECTS = 4
_LEAST_EFFECT = 0.05


# ---- what the page offers to be said: the options of the report


class Field(NamedTuple):
    """One entry of the page: an option of ``ldbb-bayes report``, what is typed, and what may be
    chosen."""

    name: str
    group: str
    flag: str
    help: str
    kind: str  #: text, number, lines, choice, or file: the name of one that was dropped
    choices: tuple[tuple[str, str], ...] = ()


_GROUPS: Mapping[str, Mapping[str, Option]] = {
    "name": {"name": option(str, "Name of the campaign. Default: of the file or its folder.")},
    "table": options_of("table"),
    "certificates": options_of("certificates"),
    "labels": options_of("labels"),
    "layout": {name: own for name, own in LAYOUT_OPTIONS.options.items() if name != "layout"},
    "report": REPORT_OPTIONS.options,
}
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "plane": ("XY", "YZ", "ZX"),
    "direction": ("CW", "CCW"),
    "zero": ("deviation", "distance"),
    "laps": ("keep", "average"),
    "sign": ("1", "-1"),
    "angle_sign": ("1", "-1"),
    "decimal": (".", ","),
    "raw": ("yes",),
}


def _typed(own: Option) -> Any:
    return own.kind.typed if isinstance(own.kind, Kind) else own.kind


def _kind(name: str, own: Option) -> str:
    if name in _CHOICES or name == "topology":
        return "choice"
    return {int: "number", float: "number", Path: "file", list[str]: "lines"}.get(
        _typed(own), "text"
    )


def _field(name: str, of: str, own: Option) -> Field:
    choices = tuple((one, one) for one in _CHOICES.get(name, ()))
    if name == "topology":
        choices = tuple(
            (one.topology, f"{one.name} ({one.topology}): {one.looks}") for one in MACHINES
        )
    return Field(name, of, own.flag(name), own.help, _kind(name, own), choices)


FIELDS: Mapping[str, Field] = {
    name: _field(name, of, own)
    for of, every in _GROUPS.items()
    for name, own in every.items()
    if of != "report" or name in ("force_N", "tolerance", "language")
}


def _value(own: Option, name: str, text: str, folder: Path) -> Any:
    """What was typed, as the command line would have it."""
    typed = _typed(own)
    flag = own.flag(name)
    if typed is bool:
        return text == "yes"
    if typed is Path:
        held = [path.name for path in (folder / FILES).iterdir()]
        require(
            text in held,
            f"{flag} must be a file that was added, got {text!r}. Add it, or choose none.",
        )
        return folder / FILES / text
    if typed == list[str]:
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return (
            [re.sub(r"(?<=\d),(?=\d)", ".", line) for line in lines]
            if name == "tolerance"
            else lines
        )
    if typed not in (int, float):
        lists = own.kind is NUMBERS and ";" in text
        return text.replace(",", ".").replace(";", ",") if lists else text
    grouped = re.fullmatch(r"[-−]?[1-9]\d{0,2}([.,]\d{3})+", text)
    require(
        not grouped and "_" not in text,
        f"{flag} must be a number without marks between thousands, got {text!r}. Write it like 1000"
        " or 1.5.",
    )
    try:
        number = typed(text.replace(",", ".").replace("−", "-"))
    except ValueError:
        raise InputError(
            f"{flag} must be a {'whole ' * (typed is int)}number, got {text!r}. Correct it."
        ) from None
    low = own.settings.get("min", -math.inf)
    high = own.settings.get("max", math.inf)
    bounds = [f"at least {low:g}"] * (low > -math.inf) + [f"at most {high:g}"] * (high < math.inf)
    fits = math.isfinite(number) and low <= number <= high
    require(fits, f"{flag} must be {' and '.join(bounds) or 'finite'}, got {number:g}. Correct it.")
    return number


def _made(of: str, make: Callable[..., Any], choices: Mapping[str, str], folder: Path) -> Any:
    """What a command would make of the options of a group."""
    every = _GROUPS[of]
    said = {name: choices.get(name, "").strip() if name in FIELDS else "" for name in every}
    typed = {
        name: _value(own, name, said[name], folder) if said[name] else own.default
        for name, own in every.items()
    }
    return group(make, **every).take_from(typed)


def _given(folder: Path, choices: Mapping[str, str]) -> ReportSource:
    """The files, and what is said of them, as the command line has them."""
    from ldbb_bayes.reading.importing import matching

    held = sorted(own for own in (folder / FILES).iterdir() if own.suffix.lower() != _DCC)
    require(
        held,
        "files with readings must be given, got none. Drop a workbook, CSV or text files, or take"
        " the example.",
    )
    # One file is named; of several, as where * is typed, some may hold no readings. A folder is a
    # campaign.
    ends = sorted({own.suffix for own in held} - {""})
    bare = [own for own in held if not own.suffix]
    named = held if len(held) == 1 else [*(folder / FILES / f"*{end}" for end in ends), *bare]
    if any(own.name == TOML for own in held):
        named = [folder / FILES]
    said = {
        key: own
        for of in ("name", "table", "labels")
        for key, own in _made(of, dict, choices, folder).items()
    }
    layout = LAYOUT_OPTIONS.make(**_made("layout", dict, choices, folder))
    return ReportSource(
        named,
        matching(named),
        layout,
        campaign_fields(**said),
        _made("certificates", instrument_fields, choices, folder),
    )


def _read(folder: Path, choices: Mapping[str, str]) -> tuple[lb.Campaign, Imported | None]:
    from ldbb_bayes.analysis.conformity import check_force

    campaign, imported = _given(folder, choices).read(ask=False)
    asked = _made("report", dict, choices, folder)
    check_force(campaign, asked.get("force_N"))
    return with_tolerances(campaign, model_from(), asked.get("tolerances", {})), imported


def answer(work: Callable[..., dict[str, Any]], folder: str, *more: Any) -> dict[str, Any]:
    """Return what a function of this module makes of a session's folder, or why not: ``{"refused":
    message}``."""
    try:
        return work(Path(folder), *more)
    except (OSError, ArithmeticError, ValueError) as error:
        return {"refused": _reason(error, Path(folder))}


def _reason(error: Exception, folder: Path) -> str:
    """One message, files by the names they were dropped with."""
    said = plain_reason(error)
    if said is None:
        raise error
    return _plain(said, folder)


def _plain(text: str, folder: Path) -> str:
    """Files by the names they were dropped with."""
    inside = re.sub(re.escape(str(folder / FILES)) + r"[/\\]", "", text)
    return inside.replace(str(folder / FILES), "the folder")


def _wrong(folder: Path, choices: Mapping[str, str], error: InputError) -> list[str]:
    """The entries without which nothing is refused; where no single one is, those without which the
    refusal is another."""
    left: dict[str, InputError | None] = {}
    for name in choices.keys() & FIELDS.keys() - {"language"}:
        try:
            _read(folder, {key: own for key, own in choices.items() if key != name})
            left[name] = None
        except InputError as other:
            left[name] = other
    alone = [name for name, other in left.items() if other is None]
    return sorted(alone or (name for name, other in left.items() if str(other) != str(error)))


# ---- what was understood


def understand(folder: Path, choices: Mapping[str, str]) -> dict[str, Any]:
    """Return tests, traces, what was assumed and what looks odd, of the files of a session; or the
    refusal, and the entries that are wrong."""
    from ldbb_bayes.report import wording

    try:
        campaign, imported = _read(folder, choices)
    except InputError as error:
        return {"refused": _reason(error, folder), "wrong": _wrong(folder, choices, error)}
    seen = lb.preview(campaign)
    tests = [
        {
            "name": own.name,
            "force": f"{own.force_N:.4g}",
            "pressure": f"{own.pressure_bar:.3g}",
            "readings": own.readings,
            "arc": f"{own.arc_deg:.0f}",
            "direction": own.direction or own.travel or "–",
            "plane": own.plane,
            "radius": f"{own.radius_mm:g}",
            "balls": f"{own.work_ball_deg:g} / {own.tool_ball_deg:g}",
            "noise": "–" if own.noise_um is None else f"{own.noise_um:.2g}",
            "peak": f"{own.peak_to_peak_um or 0.0:.3g}",
            "remarks": [wording.remark_words(remark) for remark in own.remarks],
        }
        for own in seen.tests
    ]
    traces = [*_traces(campaign)]
    hues = {path["name"]: path["hue"] for trace in traces for path in trace["paths"]}
    tests = [own | {"hue": hues[own["name"]]} for own in tests]
    assumed = [_assumed(own, folder) for own in (imported.assumptions if imported else ())]
    return {
        "name": campaign.name,
        "topology": campaign.topology,
        "planes": campaign.machine().plane,
        "tests": tests,
        "readings": campaign.readings,
        "assumptions": assumed,
        "remarks": [wording.remark_words(own) for own in seen.remarks],
        "fit": [wording.remark_words(own) for own in seen.assumptions],
        "traces": traces,
        "instrument": _instrument(campaign),
    }


def _assumed(own: Any, folder: Path) -> dict[str, Any]:
    fields = [field.name for field in FIELDS.values() if field.flag in own.option.split(", ")]
    shown = {
        key: _plain(str(getattr(own, key)), folder) for key in ("place", "what", "value", "because")
    }
    return shown | {"fields": fields, "option": own.option}


def _instrument(campaign: lb.Campaign) -> dict[str, list[dict[str, Any]]]:
    """By part of the instrument what is assumed of it, U (k = 2), and whether a certificate says
    so."""
    from ldbb_bayes.report.text import two_digits
    from ldbb_bayes.report.wording import assumed_words

    found: dict[str, list[dict[str, Any]]] = {}
    for own in lb.uncertainties(campaign).assumed:
        stem = own.certificate.partition("_")[0] or own.name.partition("_")[0]
        part = "balls" if stem in ("work", "tool") else stem
        if part == "balls":
            ball = getattr(campaign.instrument, stem)
            # Two and three lobes share the deviation from sphericity: S² / 24 each.
            size = ball.grade or f"{math.sqrt(24.0) * own.sd * 1e3:.3g} µm"
            words = {"words": stem, "size": size, "is_sphericity": not ball.grade}
        else:
            factor, label = {"1": (100.0, "%"), "rad": (180.0 / math.pi, "°"), "N": (1.0, "N")}.get(
                own.unit, (1e3, "µm")
            )
            label = "µm/bar" if own.unit.endswith("/bar") else label
            error = campaign.instrument.bar_length_error_um if part == "bar" else 0.0
            size = (
                f"{f'{error:g} '.replace('-', '−') if error else ''}±"
                f" {two_digits(2.0 * own.sd, factor)} {label}"
            )
            words = {"words": assumed_words(own)[0], "size": size, "is_sphericity": False}
        entry = words | {"stated": own.stated}
        if entry not in found.setdefault(part, []):
            found[part].append(entry)
    return found


def _traces(campaign: lb.Campaign) -> Iterator[dict[str, Any]]:
    """Polar traces of every plane as paths of an SVG, radius 100 at the outermost reading; rings in
    µm."""
    import numpy as np

    forces = campaign.forces_N
    share = (forces - forces.min()) / max(float(np.ptp(forces)), 1e-9)
    for plane in campaign.machine().planes:
        here = [k for k, test in enumerate(campaign.tests) if test.plane == plane]
        readings = [np.asarray(campaign.tests[k].reading_um) for k in here]
        low = min(own.min() for own in readings)
        high = max(own.max() for own in readings)
        scale = 78.0 / max(high - low, 1e-3)
        power = 10.0 ** np.floor(np.log10(max(high - low, 1e-3) / 4.0))
        step = power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - (high - low) / 4.0))
        rings = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step + 0.0
        paths = []
        for k, reading in zip(here, readings, strict=True):
            every = slice(None, None, max(1, len(reading) // _ALL_DRAWN))
            angle = campaign.tests[k].angles_rad()[every]
            radius = 22.0 + scale * (reading[every] - low)
            if campaign.tests[k].arc_deg == 360.0:
                angle = np.append(angle, angle[0])
                radius = np.append(radius, radius[0])
            points = " ".join(
                f"{x:.1f},{y:.1f}"
                for x, y in zip(radius * np.cos(angle), -radius * np.sin(angle), strict=True)
            )
            paths.append(
                {
                    "points": points,
                    "hue": round(215 - 205 * float(share[k])),
                    "name": campaign.tests[k].name,
                }
            )
        yield {
            "plane": plane,
            "paths": paths,
            "rings": [
                {"r": f"{22.0 + scale * (ring - low):.1f}", "um": f"{ring:g}".replace("-", "−")}
                for ring in rings
            ],
        }


# ---- what each assumption costs


def worth(folder: Path, choices: Mapping[str, str]) -> dict[str, Any]:
    """Return U (k = 2) of every parameter that these tests are to leave as things are stated, and
    what each certificate would make of it: the linear model, before the fit."""
    from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES, worth_of_certificates
    from ldbb_bayes.analysis.verdicts import hyper_nodes

    bound = model_from().bind(_read(folder, choices)[0])
    found = worth_of_certificates(bound, *hyper_nodes(bound))
    today = found.pop("none of these")
    units = {own.name: own.unit for own in bound.parameters if own.group != "slope"}
    parts = {
        "work": "balls",
        "bar_U_um": "bar",
        "mount_U_percent": "mount",
        "force_U_percent": "force",
        "angle_U_deg": "angle",
    }
    effects = {}
    for name, left in found.items():
        part = parts[next(iter(CERTIFICATES[name]))] if name in CERTIFICATES else "all"
        gains = sorted(((1.0 - left[own] / today[own], own) for own in units), reverse=True)
        rows = [
            _change(own, today[own], left[own], units[own])
            for gain, own in gains[:_MOST_EFFECTS]
            if gain > _LEAST_EFFECT
        ]
        effects[part] = {"name": name, "rows": rows}
    shown = [_change(own, today[own], today[own], unit) for own, unit in units.items()]
    return {"effects": effects, "today": shown}


def _change(name: str, before: float, after: float, unit: str) -> dict[str, Any]:
    """U (k = 2) of a parameter before and after, in the unit for reading."""
    from ldbb_bayes.report.text import two_digits

    factor, label = display_unit(unit)
    u = {key: two_digits(2.0 * own, factor) for key, own in (("before", before), ("after", after))}
    share = after / before if 0.0 < before < math.inf else 1.0
    return u | {"name": display_name(name), "unit": label, "share": round(min(share, 2.0), 3)}


# ---- the report


def main() -> None:
    """Report what a session's job holds: its folder and the process that asks are the arguments.
    How far it is stands there in progress.json and outcome.json."""
    job = Path(sys.argv[1])
    parent = int(sys.argv[2])

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        if hasattr(os, "killpg"):  # whoever asked has ended
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    choices = json.loads((job / "said.json").read_text(encoding="utf-8"))
    try:
        outcome = answer(_report, str(job), choices)
    except Exception as error:  # whatever it is, the page says so
        outcome = {"refused": f"unexpected {type(error).__name__}: {error}"[:300]}
    write_whole(job / "outcome.json", json.dumps(outcome).encode())


def _report(folder: Path, choices: Mapping[str, str]) -> dict[str, Any]:
    asked = _made("report", dict, choices, folder)
    output = Output(folder / RESULT, force=True)
    written = report_files(_given(folder, choices), output, asked, model_from(), _told(folder))
    document = written.document
    return {
        "converged": written.converged,
        "alerts": list(document.alerts),
        "state": document.state,
    }


@contextmanager
def _told(folder: Path) -> Iterator[Callable[[str], Callable[..., None] | None]]:
    """Progress, in a file."""

    def update(share: float, step: str, done: int, of: int) -> None:
        write_whole(
            folder / "progress.json",
            json.dumps({"share": share, "step": step, "done": done, "of": of}).encode(),
        )

    yield steps_of(update, **STEPS)


# ---- which tests next


@lru_cache(maxsize=12)
def _pilot(folder: Path, stamp: int) -> tuple[lb.Campaign, dict[str, float]]:
    """The campaign of a report, and the standard uncertainty of every parameter of its linear fit;
    ``stamp``: which report."""
    summary = json.loads((folder / RESULT / "summary.json").read_text(encoding="utf-8"))
    today = {name: own["sd"] for name, own in summary["parameters"].items()}
    return lb.read_campaign(folder / RESULT / "campaign"), today


@lru_cache(maxsize=6)
def _space(
    folder: Path,
    stamp: int,
    clockings: tuple[Any, ...],
    radii: tuple[float, ...],
    ways: tuple[Direction, ...],
    augment: bool,
) -> Space:
    """Everything that the tests have in common, whatever their forces and their number."""
    from ldbb_bayes.analysis.candidates import Space

    pilot, _ = _pilot(folder, stamp)
    forces = sorted({float(force) for force in pilot.forces_N})
    return Space(model_from(), pilot, forces, clockings, radii, ways, augment=augment)


_COSTS = {
    "minutes": (6, 0, 600),
    "turn_minutes": (5, 0, 600),
    "radius_minutes": (20, 0, 600),
    "hourly": (0, 0, 1e5),
}


def _numbers(
    asked: Mapping[str, Any], usual: Mapping[str, tuple[float, float, float]]
) -> dict[str, float]:
    """What sliders say, by name: each its usual value, or one between its least and its most."""
    found = {}
    for name, (default, least, most) in usual.items():
        value = asked.get(name, default)
        fits = isinstance(value, int | float) and math.isfinite(value) and least <= value <= most
        require(
            fits, f"{name} must be between {least:g} and {most:g}, got {value!r}. Move its slider."
        )
        found[name] = float(value)
    return found


def _sliders(asked: Mapping[str, Any], pilot: lb.Campaign) -> dict[str, float]:
    low = float(pilot.forces_N.min())
    high = float(pilot.forces_N.max())
    count = min(len(pilot.tests), _MOST_CIRCLES)
    least = min(1.0, low)
    found = _numbers(
        asked,
        {
            "circles": (count, 1, _MOST_CIRCLES),
            "levels": (min(count, 6), 1, _MOST_CIRCLES),
            "low": (low, least, 5 * high),
            "high": (high, least, 5 * high),
            "work": (1, 1, 6),
            "tool": (1, 1, 6),
            "turn": (45, 1, 180),
            "radius": (0, 0, 2000),
        },
    )
    require(
        found["low"] <= found["high"],
        f"the lowest force must not exceed the highest, got {found['low']:g} N. Lower it.",
    )
    return found


def _in_turn(first: Sequence[Any], second: Sequence[Any], count: int) -> list[tuple[Any, Any]]:
    """So many pairs, as in a Latin square: each time one of the first comes round it meets the next
    of the second."""
    rounds = (divmod(k, len(first)) for k in range(count))
    return [(first[r], second[(q + r) % len(second)]) for q, r in rounds]


class _Planned(NamedTuple):
    space: Space
    tests: tuple[lb.CircularTest, ...]  #: in the order in which to run them
    sliders: dict[str, float]


@lru_cache(maxsize=32)
def _planned(folder: Path, stamp: int, text: str) -> _Planned:
    """The tests that the sliders describe: levels of force in equal steps, over clockings, radii
    and directions in turn; where the best are asked for, those of the most expected information."""
    import numpy as np

    from ldbb_bayes.analysis.candidates import Space, grid_of_tests, running_order
    from ldbb_bayes.analysis.optimal import efficient_rounding

    asked, (pilot, _) = json.loads(text), _pilot(folder, stamp)
    own = _sliders(asked, pilot)
    ways = _WAYS.get(str(asked.get("directions")), ())
    work, tool = ([own["turn"] * k for k in range(int(own[ball]))] for ball in ("work", "tool"))
    clockings = _in_turn(work, tool, len(work) * len(tool))
    radii = tuple(sorted({test.circle.radius_mm for test in pilot.tests} | {own["radius"]} - {0.0}))
    space = _space(folder, stamp, tuple(clockings), radii, ways, bool(asked.get("augment")))
    count = int(own["circles"])
    low = own["low"]
    high = own["high"]
    places = grid_of_tests(space.templates, [low], [(0.0, 0.0)], radii)
    every = _in_turn(places, space.clockings_deg, len(places) * len(space.clockings_deg))
    kinds = [
        replace(place, work_ball_deg=work, tool_ball_deg=tool) for place, (work, tool) in every
    ]
    if asked.get("best"):
        # Of one kind in whole newtons, as a report has them.
        most = _CANDIDATES if len(kinds) == 1 else _CANDIDATES // 3 // len(kinds)
        grid = _levels(low, high, max(2, min(round(high - low) + 1, most)))
        among = Space(
            space.model, pilot, grid, space.clockings_deg, radii, ways, augment=space.augment
        )
        if count <= _SEARCHED and len(kinds) <= _FEW_KINDS:
            tests = among.tests_of(among.search.of_number(count))
        else:
            counts = efficient_rounding(among.search.shares(float(count)).share, count)
            tests = tuple(among.tests[k] for k in np.repeat(np.arange(len(counts)), counts))
    else:
        levels = _levels(low, high, int(min(own["levels"], count)))
        tests = tuple(
            replace(kind, force_N=force) for force, kind in _in_turn(levels, kinds, count)
        )
    return _Planned(space, running_order(tests, np.random.default_rng(1)), own)


def _levels(low: float, high: float, count: int) -> list[float]:
    """Forces in equal steps, in whole newtons where these differ; of one level the highest, which
    shows most."""
    steps = [low + (high - low) * k / (count - 1) for k in range(count)] if count > 1 else [high]
    whole = sorted({float(round(force)) for force in steps})
    return (
        whole
        if len(whole) == count and whole[0] > 0.0
        else sorted({round(force, 1) for force in steps})
    )


def _asked(folder: Path, asked: Mapping[str, Any]) -> tuple[Path, int, str]:
    """What the sliders say of the tests, after which report: as a key, so that nothing is worked
    out twice."""
    path = folder / RESULT / "summary.json"
    require(path.is_file(), "a plan must follow a fit, got none yet. Fit first.")
    text = json.dumps(
        {key: own for key, own in sorted(asked.items()) if key not in ("fine", *_COSTS)}
    )
    return folder, path.stat().st_mtime_ns, text


def forecast(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return what to expect of the tests that the sliders describe: U of every parameter beside
    today's, the chances that the evidence settles constant or linear, time and cost; and the tests
    in their order."""
    costs = _numbers(asked, _COSTS)
    key = _asked(folder, asked)
    planned = _planned(*key)
    found = _forecast(*key, fine=bool(asked.get("fine", True)))
    pairs = [*pairwise(planned.tests)]
    turns = sum(
        (a.work_ball_deg != b.work_ball_deg) + (a.tool_ball_deg != b.tool_ball_deg)
        for a, b in pairs
    )
    changes = sum(a.radius_mm != b.radius_mm for a, b in pairs)
    minutes = (
        costs["minutes"] * len(planned.tests)
        + costs["turn_minutes"] * turns
        + costs["radius_minutes"] * changes
    )
    ways = {"directions": str(asked.get("directions") or ""), "augment": planned.space.augment}
    pilot = planned.space.pilot
    return found | {
        "asked": planned.sliders | costs | ways,
        "best": bool(asked.get("best")),
        "turns": turns,
        "changes": changes,
        "minutes": round(minutes),
        "cost": round(minutes / 60.0 * costs["hourly"]),
        "pilot": _about(pilot),
        "tests": [_row(test, pilot) for test in planned.tests],
    }


@lru_cache(maxsize=128)
def _forecast(folder: Path, stamp: int, text: str, *, fine: bool) -> dict[str, Any]:
    from ldbb_bayes.analysis.candidates import states_before

    (space, tests, _), (_, today) = _planned(folder, stamp, text), _pilot(folder, stamp)
    # While a slider moves, fewer states of the machine will do.
    few = (
        None
        if fine
        else states_before(space.model, space.pilot, _FEW, space.seed, augment=space.augment)
    )
    found = space.forecast(tests, states=few)
    shown = {
        own.name: found.expected[own.name] for own in space.bound.parameters if own.group != "slope"
    }
    settle = found.discrimination
    return {
        "rows": [
            _change(name, today.get(name, math.inf), own.sd, own.unit)
            for name, own in shown.items()
        ],
        "settle": (
            None
            if settle is None
            else {"linear": settle.decisive_with, "constant": settle.decisive_without}
        ),
    }


def _row(test: lb.CircularTest, pilot: lb.Campaign) -> dict[str, Any]:
    force = float(test.force_N or 0.0)
    return {
        "force": f"{force:.4g}",
        "pressure": f"{pilot.force_law.pressure_bar(force):.3g}",
        "plane": test.plane,
        "direction": test.direction or "",
        "radius": f"{test.radius_mm:g}",
        "work": f"{test.work_ball_deg or 0:g}",
        "tool": f"{test.tool_ball_deg or 0:g}",
    }


def _about(pilot: lb.Campaign) -> dict[str, Any]:
    shown = (
        "name",
        "machine_type",
        "serial_number",
        "place",
        "ball_bar",
        "force_device",
        "topology",
    )
    low = float(pilot.forces_N.min())
    high = float(pilot.forces_N.max())
    feed = "" if pilot.feed_mm_per_min is None else f"{pilot.feed_mm_per_min:g}"
    return {key: getattr(pilot, key) or "" for key in shown} | {
        "feed": feed,
        "low": low,
        "high": high,
        "tests": len(pilot.tests),
    }


def plan(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Write the tests as a plan, a campaign folder without readings, and return what `forecast`
    does."""
    found, (space, tests, _) = forecast(folder, asked), _planned(*_asked(folder, asked))
    name = f"{space.pilot.name}, next campaign"
    coming = replace(
        space.pilot, tests=tests, foreseen=(), name=name, tolerances={}, date=None, operator=None
    )
    lb.write_campaign(coming, folder / PLAN, force=True)
    return found


def warm() -> None:
    """Load what answers need, before they are asked for."""
