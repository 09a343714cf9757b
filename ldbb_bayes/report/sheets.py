"""The certificate: two sheets for signing, from findings. One structure, shown by the page and by
`report.pdf` alike; every word stands in a catalogue, templates/words_<language>.toml."""

from __future__ import annotations

import io
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import matplotlib as mpl
import numpy as np

from ldbb_bayes.analysis.circularity import circularity
from ldbb_bayes.analysis.conformity import Use, draws_at, is_determined, state_of
from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of
from ldbb_bayes.inference.summary import numbers_of
from ldbb_bayes.model.setting import geometric_errors_of
from ldbb_bayes.model.terms import BarLength, Term, uncertainties
from ldbb_bayes.report.sections import Findings, Picture, picture
from ldbb_bayes.report.text import two_digits
from ldbb_bayes.report.wording import joined
from ldbb_bayes.results import Table
from ldbb_bayes.units import display_name, display_unit, is_skewed, state, value_and_uncertainty

if TYPE_CHECKING:
    from fpdf import FPDF

    from ldbb_bayes.analysis.verdicts import ParameterIdentifiability
    from ldbb_bayes.campaign.campaign import Ball
    from ldbb_bayes.model.hybrid import BoundModel

__all__ = [
    "Banner",
    "Block",
    "Fields",
    "Pair",
    "ReportSheet",
    "Words",
    "languages",
    "pdf_of",
    "sheets",
    "words_of",
]

_TEMPLATES = files("ldbb_bayes.report") / "templates"
# A partner of this share of the variance is named alone.
_INSEPARABLE = 0.5
_MOST_REASONS = 2
_MOST_NAMES = 2
_LONGEST = 70
_HARDLY = 0.2
_DEGREES = ("constant", "linear", "quadratic")


# ---- words


@dataclass(frozen=True)
class Words:
    """The words of one language."""

    language: str
    table: Mapping[str, Any]

    def __call__(self, key: str, **values: str) -> str:
        """Return the words of a key such as ``heads.value``, filled in."""
        words: Any = self.table
        for part in key.split("."):
            words = words[part]
        return str(words).format(**values)

    def number(self, text: str) -> str:
        """Return a number, or a text of numbers, with the decimal sign of the language."""
        return re.sub(r"(?<=\d)\.(?=\d)", str(self.table["decimal"]), text)

    def joined(self, parts: Sequence[str]) -> str:
        """Return a, b and c."""
        return joined(parts, str(self.table["and"]).strip())

    def unit(self, label: str) -> str:
        """Return a unit's label."""
        return label.replace(" per ", str(self.table["per"]))

    def term(self, name: str) -> str:
        """Return what a term of the model is called; a user's own term keeps its words, a parameter
        its name."""
        return str(
            self.table["terms"].get(name)
            or (Term.kinds[name].words if name in Term.kinds else display_name(name))
        )


def languages() -> tuple[str, ...]:
    """Return the languages there are catalogues of."""
    found = (re.fullmatch(r"words_(\w+)\.toml", entry.name) for entry in _TEMPLATES.iterdir())
    return tuple(sorted(match[1] for match in found if match))


@cache
def words_of(language: str) -> Words:
    """Return the words of a language.

    InputError for a language without a catalogue.
    """
    check_known("language", [language], languages())
    return Words(
        language, tomllib.loads((_TEMPLATES / f"words_{language}.toml").read_text(encoding="utf-8"))
    )


# ---- what a sheet is made of


@dataclass(frozen=True)
class Fields:
    """Entries with their names; an empty one is a line to write on, ``tall`` with room for a
    signature."""

    entries: tuple[tuple[str, str], ...]
    tall: bool = False


@dataclass(frozen=True)
class Banner:
    """Whether the numbers can be used, in one sentence; ``kind`` is that of the catalogue."""

    kind: str
    sentence: str


@dataclass(frozen=True, eq=False)
class Pair:
    """A figure, and what stands beside it."""

    picture: Picture
    heading: str
    beside: tuple[str, ...]

    @property
    def wide(self) -> bool:
        """Whether the figure needs the whole width, so that what stands beside it comes below."""
        width, height = self.picture.figure.get_size_inches()
        return bool(width > _WIDE * height)


Block: TypeAlias = str | Fields | Banner | Table | Pair | Picture
"""A note, or what its name says."""


@dataclass(frozen=True)
class ReportSheet:
    """One page of A4, its letters ``scale`` times as large as they are where there is room."""

    key: str
    title: str
    line: str
    blocks: tuple[Block, ...]
    scale: float = 1.0


# ---- the numbers


@dataclass(frozen=True)
class Stated:
    """One quantity of the sheets: its name in words, its symbol, estimate, standard uncertainty and
    interval in an inside unit, and what the readings tell of it; with ``limit`` only that is
    known."""

    words: str
    symbol: str
    mean: float
    sd: float
    interval: tuple[float, float]
    unit: str
    entry: ParameterIdentifiability | None = None
    limit: str = ""
    hangs_on: tuple[str, ...] = ()  # what its parts are confounded with

    @property
    def with_U(self) -> tuple[str, ...]:
        """Value and U (k = 2) to the same place."""
        if self.limit:
            return self.limit, "–"
        if is_skewed(self.mean, self.interval):
            own = state(self.mean, self.sd, self.interval, self.unit)
            return own.value, own.expanded
        factor, _ = display_unit(self.unit)
        value, expanded = value_and_uncertainty(self.mean * factor, 2.0 * self.sd * factor)
        return value.replace("-", "−"), expanded

    @property
    def undetermined(self) -> bool:
        """Whether the readings do not determine it."""
        return self.entry is not None and not is_determined(self.entry)

    @property
    def left_out(self) -> list[str]:
        """What looks like it and no term of the model has, where nothing else does."""
        alone = (
            self.entry is not None
            and self.entry.verdict == "confounded"
            and not self.entry.partner_shares
        )
        return [*self.entry.partners] if alone and self.entry else []

    @property
    def inseparable(self) -> list[str]:
        """What it is confounded with, where the readings do not determine it: by half of its
        variance or else most."""
        own = self.entry
        shares = (
            {}
            if own is None or own.verdict != "confounded" or not self.undetermined
            else own.partner_shares
        )
        return [name for name, share in shares.items() if share >= _INSEPARABLE] or [*shares]


@dataclass(frozen=True, eq=False)
class Numbers:
    """The quantities of the sheets, at a force."""

    found: Findings
    words: Words
    force_N: float

    @cached_property
    def parameters(self) -> dict[str, Stated]:
        """Compliances at the force, their slopes where they are likelier than not, geometric errors
        but for tool offsets."""
        bound = bound_of(self.found.numbers)
        verdicts = self.found.verdicts
        stated = {}
        named = _names(bound)
        for own in bound.parameters:
            kind = named[own.compliance]
            if kind.kind != "offset" and (own.degree == 0 or self.found.varying > 0.5):
                row = self._of[own.name]
                words = self._quantity(kind, own.degree)
                interval = (row["ci_low"], row["ci_high"])
                entry = verdicts.get(own.name)
                stated[own.name] = Stated(
                    words, display_name(own.name), row["mean"], row["sd"], interval, own.unit, entry
                )
        return stated

    # Draws of every parameter, of compliances at the force [inside units]; their mean, sd, median
    # and interval.
    _draws = cached_property(lambda self: draws_at(self.found.numbers, self.force_N))
    _of = cached_property(
        lambda self: {
            name: numbers_of(own, self.found.ci_prob) for name, own in self._draws.items()
        }
    )

    def _quantity(self, name: Any, degree: int = 0) -> str:
        key = "slope" if degree == 1 else "curvature" if degree else str(name.kind)
        own = {part: str(getattr(name, part, "")) for part in ("axis", "component", "reference")}
        turned = str.maketrans("ABC", "XYZ")
        moved, load = (
            str(getattr(name, part, "")).translate(turned) for part in ("twist", "wrench")
        )
        own["axis"] = own["axis"] or str(getattr(name, "joint", ""))
        return self.words(
            f"quantities.{key}", **own, moved=moved, load=load, symbol=display_name(name.label)
        )

    @cached_property
    def stiffnesses(self) -> dict[str, Stated]:
        """1 / C of every axis, keyed by C: of the median, only a lower limit where C may be a fifth
        of it or less."""
        every = {}
        for own in bound_of(self.found.numbers).compliances:
            if own.kind == "direct":
                row = self._of[own.label]
                draws = self._draws[own.label]
                middle, low, high = (row[key] for key in ("median", "ci_low", "ci_high"))
                ends = (1.0 / high, 1.0 / low)
                limit = ""
                if not low > _HARDLY * middle > 0.0:
                    limit = (
                        self.words("quantities.at_least", value=f"{1e-3 / high:.3g}")
                        if high > 0.0
                        else "–"
                    )
                sd = (
                    float(np.std(1.0 / np.maximum(draws, 0.5 * _HARDLY * middle)))
                    if not limit
                    else np.nan
                )
                words = self.words("quantities.stiffness", axis=own.joint)
                entry = self.found.verdicts.get(own.label)
                every[own.label] = Stated(
                    words, f"1 / {own.label}", 1.0 / middle, sd, ends, "N/mm", entry, limit
                )
        return every

    @cached_property
    def further(self) -> dict[str, Stated]:
        """What stands on sheet 1 beside stiffnesses: other compliances, and squareness."""
        shown = (
            "cross",
            "rotation_for_force",
            "rotation_for_moment",
            "rotation_for_other_moment",
            "squareness",
        )
        kinds = {name: one.kind for name, one in _names(bound_of(self.found.numbers)).items()}
        return {
            name: stated for name, stated in self.parameters.items() if kinds.get(name) in shown
        }

    @cached_property
    def path(self) -> dict[str, Stated]:
        """G, F_max and F_min of every plane; they hang on what the geometric errors hang on."""
        table = circularity(self.found.numbers, [self.force_N], ci_prob=self.found.ci_prob)
        several = table["plane"].nunique() > 1
        every = {}
        geometric = [
            own
            for name, own in self.parameters.items()
            if name.startswith("E_") and own.undetermined
        ]
        # The bar's length makes the circle larger, not less round.
        partners = dict.fromkeys(partner for own in geometric for partner in own.inseparable)
        hangs_on = tuple(name for name in partners if name != BarLength.__name__)
        for row in table[table["quantity"].isin(["G", "F_max", "F_min"])].to_dict(orient="records"):
            where = self.words("quantities.plane", plane=row["plane"]) if several else ""
            interval = (row["ci_low"], row["ci_high"])
            of = self.words(f"quantities.{row['quantity']}", plane=where)
            symbol = f"{row['quantity']}{'_' + row['plane'] if several else ''}"
            every[symbol] = Stated(
                of, row["quantity"], row["median"], row["sd"], interval, "um", hangs_on=hangs_on
            )
        return every


def _names(bound: BoundModel) -> dict[str, Any]:
    """Names of compliances and geometric errors, with what they are, by their labels."""
    every: list[Any] = [*bound.compliances, *geometric_errors_of(bound.campaign)]
    return {own.label: own for own in every}


def remark(own: Stated, words: Words) -> str:
    """Return what the readings tell of a quantity, in a few words."""
    entry = own.entry
    if entry is None:
        hangs_on = words.joined([words.term(name) for name in own.hangs_on[:_MOST_NAMES]])
        return words("remarks.inseparable", partners=hangs_on) if hangs_on else ""
    if entry.verdict != "confounded":
        return words("remarks.identified" if entry.verdict == "identified" else "remarks.prior")
    last = ("assumes", own.left_out) if own.left_out else ("limited", [*entry.partner_shares])
    key, partners = ("inseparable", own.inseparable) if own.inseparable else last
    return words(
        f"remarks.{key}",
        partners=words.joined([words.term(name) for name in partners[:_MOST_NAMES]]),
    )


# ---- the sheets


def sheets(
    found: Findings, *, language: str = "en", force_N: float | None = None
) -> tuple[ReportSheet, ...]:
    """Return sheet 1, the certificate, and sheet 2, its results, in a language."""
    words = words_of(language)
    force = float(found.result["model"]["reference_force_N"] if force_N is None else force_N)
    numbers = Numbers(found, words, force)
    name = _short(str(found.result["campaign"]["name"]))
    lines = [words("sheet.of", number=str(k), name=name) for k in (1, 2)]
    first = ReportSheet("certificate", words("sheet.first"), lines[0], tuple(_first(numbers)))
    second = ReportSheet("results-sheet", words("sheet.second"), lines[1], tuple(_second(numbers)))
    return _fitted(first, second)


def _first(own: Numbers) -> Iterator[Block]:
    words = own.words
    found = own.found
    yield _banner(own)
    yield Fields(tuple(_entries(found, words)))
    stated = [*own.stiffnesses.values(), *own.further.values(), *own.path.values()]
    middle = (
        words("sheet.middle") if own.force_N == found.result["model"]["reference_force_N"] else ""
    )
    yield _table(
        own,
        words("sheet.results", force=words.number(f"{own.force_N:.4g}"), middle=middle),
        stated,
        "U",
    )
    yield from _conformity(own)
    yield words("notes.U", percent=words.number(f"{100 * found.ci_prob:g}"))
    unsure = [one for one in own.parameters.values() if one.undetermined or one.left_out]
    missing = [f"{one.words} ({one.symbol}): {remark(one, words)}" for one in unsure]
    if hanging := [one for one in own.path.values() if one.hangs_on]:
        missing.append(
            f"{words.joined([one.symbol for one in hanging])}: {remark(hanging[0], words)}"
        )
    if 0.05 < found.varying < 0.95:
        missing.insert(0, words("notes.varying", probability=percent(found.varying, words)))
    more = [words("sheet.continued", count=str(len(missing) - 12))] if len(missing) > 12 else []
    traces = picture("traces", found.posterior, words("sheet.traces"), words=words.table["figures"])
    yield Pair(
        traces,
        words("sheet.undetermined"),
        (*missing[:12], *more) if missing else (words("sheet.all_determined"),),
    )
    yield _basis(found, words)
    yield Fields(tuple((words(f"fields.{key}"), "") for key in ("signed", "checked")), tall=True)


def _second(own: Numbers) -> Iterator[Block]:
    words = own.words
    found = own.found
    yield _table(own, "", [*own.parameters.values(), *own.path.values()], "u")
    percent = words.number(f"{100 * found.ci_prob:g}")
    yield words("notes.u", percent=percent, force=words.number(f"{own.force_N:.4g}"))
    partners = dict.fromkeys(
        partner for one in own.parameters.values() if one.entry for partner in one.entry.partners
    )
    meant = [
        f"{words.term(name)}: {words.table['means'][name]}"
        for name in partners
        if name in words.table["means"]
    ]
    yield words("notes.words", names="; ".join(meant))
    yield picture(
        "compliance_against_force",
        found.numbers,
        words("sheet.curve"),
        words=words.table["figures"],
    )
    provenance = found.result["provenance"]
    yield words(
        "notes.provenance",
        sha=found.result["campaign"]["sha256"][:16],
        version=provenance["versions"]["ldbb-bayes"],
        started=provenance["started"][:10],
    )


def _table(own: Numbers, caption: str, stated: Sequence[Stated], spread: str) -> Table:
    words = own.words
    rows = []
    for one in stated:
        numbers = one.with_U
        if spread == "u":
            shown = state(one.mean, one.sd, one.interval, one.unit)
            numbers = shown.value, shown.u, words("interval", low=shown.ends[0], high=shown.ends[1])
        unit = words.unit(display_unit(one.unit)[1])
        rows.append((one.words, one.symbol, *map(words.number, numbers), unit, remark(one, words)))
    percent = words.number(f"{100 * own.found.ci_prob:g}")
    middle = ("U",) if spread == "U" else ("u", "interval")
    keys = ("quantity", "symbol", "value", *middle, "unit", "remark")
    heads = [words(f"heads.{key}", percent=percent) for key in keys]
    return Table.of(caption, heads, rows, text=[heads[1], *heads[-2:]])


def _banner(own: Numbers) -> Banner:
    """Whether the numbers can be used, with the gravest reasons."""
    words = own.words
    found = own.found
    stated = own.stiffnesses | own.further
    compared = None if isinstance(found.comparison, str) else found.comparison
    judged = state_of(fit_of(found.posterior), found.verdicts, stated, comparison=compared)
    by_kind: dict[str, list[str]] = {}
    for reason in judged.reasons:
        names = [stated[name].words if name in stated else name for name in reason.names]
        by_kind.setdefault(str(reason.kind).replace("-", "_"), []).extend(names)
    reasons = [words(f"state.{kind}", names=words.joined(names)) for kind, names in by_kind.items()]
    reasons += [words("state.least_squares")] if found.flat else []
    forces = campaign_of(found.numbers).forces_N
    if not forces.min() <= own.force_N <= forces.max():
        reasons.insert(
            int(judged.use == Use.DO_NOT_USE),
            words("state.outside", force=words.number(f"{own.force_N:.4g}")),
        )
    certified = [] if found.flat else [given for *_, given in _instrument(found)]
    kind = "unusable" if judged.use == Use.DO_NOT_USE else "reserved" if reasons else "usable"
    because = "; ".join(reasons[:_MOST_REASONS]) or words("state.fits")
    if kind != "unusable" and not all(certified):
        because += words(f"state.{'partly' if any(certified) else 'none'}_stated")
    return Banner(
        kind,
        words(
            "state.sentence", state=words(f"state.{kind}"), reason=because[:1].upper() + because[1:]
        ),
    )


def _conformity(own: Numbers) -> Iterator[Table | str]:
    """Tolerances, where there are any, and what is decided."""
    words = own.words
    rows = []
    known = (
        own.parameters
        | {f"stiffness_{name[2]}": one for name, one in own.stiffnesses.items()}
        | own.path
    )
    for name, one in own.found.conformity(own.force_N).items():
        factor, label = display_unit(one.unit)
        low, high = (f"{end * factor:.4g}".replace("-", "−") for end in one.limits)
        limits = (
            f"≤ {high}"
            if one.lower is None
            else f"≥ {low}"
            if one.upper is None
            else f"{low} … {high}"
        )
        quantity, value = (
            (known[name].words, known[name].with_U[0])
            if name in known
            else (display_name(name), "–")
        )
        numbers = (value, limits, two_digits(one.guard_band, factor))
        decided = words(f"decisions.{str(one.decision).replace(' ', '_')}")
        rows.append(
            (
                quantity,
                *map(words.number, numbers),
                words.unit(label),
                percent(one.probability, words),
                decided,
            )
        )
    if rows:
        keys = ("quantity", "value", "tolerance", "guard", "unit", "probability", "decision")
        heads = [words(f"heads.{key}") for key in keys]
        yield Table.of(words("sheet.conformity"), heads, rows, text=[heads[4], heads[6]])
        yield words("notes.conformity")


def _basis(found: Findings, words: Words) -> str:
    """Which models the numbers are of."""
    if not (share := found.probabilities):
        return words(
            "notes.single", degree=words(f"degrees.{_DEGREES[found.result['model']['degree']]}")
        )
    named = [
        f"{words(f'degrees.{name}')} {percent(p, words)}"
        for name, p in share.items()
        if name in _DEGREES
    ]
    rivals = [
        f"{words(f'rivals.{name}')} {percent(p, words)}"
        for name, p in share.items()
        if name not in _DEGREES
    ]
    beside = words("notes.rivals", rivals=", ".join(rivals)) if rivals else ""
    return words("notes.averaged", models=", ".join(named), beside=beside)


def percent(probability: float, words: Words) -> str:
    """Return a probability in per cent."""
    shown = min(max(100.0 * probability, 1.0), 99.0)
    sign = "< " if probability < 0.01 else "> " if probability > 0.99 else ""
    return words("percent", value=f"{sign}{shown:.0f}")


_LABELS = ("machine_type", "serial_number", "date", "operator", "place")


def _entries(found: Findings, words: Words) -> Iterator[tuple[str, str]]:
    """What a certificate names; what the campaign does not state is empty."""
    campaign = bound_of(found.posterior).campaign

    def entry(key: str) -> tuple[str, str]:
        return words(f"fields.{key}"), _short(str(getattr(campaign, key) or ""))

    yield from map(entry, _LABELS)
    planes = words.joined(list(dict.fromkeys(str(test.plane) for test in campaign.tests)))
    yield (
        words("fields.machine"),
        words("entries.machine", topology=campaign.topology, planes=planes),
    )
    yield from map(entry, ("ball_bar", "ball_bar_calibrated", "force_device"))
    degrees = [test.temperature_C for test in campaign.tests if test.temperature_C is not None]
    ends = [words.number(f"{end(degrees):.1f}") for end in (min, max)] if degrees else []
    yield (
        words("fields.temperature"),
        words("entries.temperature", range=" … ".join(dict.fromkeys(ends))) if ends else "",
    )
    forces = campaign.forces_N
    radii = sorted({test.circle.radius_mm for test in campaign.tests})
    low, high = (words.number(f"{force:.4g}") for force in (min(forces), max(forces)))
    radius = words.number(", ".join(f"{own:g}" for own in radii))
    yield (
        words("fields.tests"),
        words("entries.tests", count=str(len(campaign.tests)), low=low, high=high, radius=radius),
    )
    ways = "/".join(dict.fromkeys(str(test.direction) for test in campaign.tests if test.direction))
    feed = (
        words("entries.feed", feed=f"{campaign.feed_mm_per_min:g}")
        if campaign.feed_mm_per_min
        else ""
    )
    yield words("fields.path"), ", ".join(filter(None, (feed, ways)))
    stated = list[str]()
    assumed = list[str]()
    for key, size, given in _instrument(found):
        names = campaign.instrument.certificates.items()
        named = next(
            (f" ({own.split(': ')[0][:32]})" for what, own in names if what.startswith(key)), ""
        )
        (stated if given else assumed).append(
            f"{words(f'entries.{key}')} {words.number(size)}{named if given else ''}"
        )
    yield words("fields.certificates"), ", ".join(stated) or words("entries.none")
    yield words("fields.assumed"), ", ".join(assumed) or words("entries.none")


_INSTRUMENT = {
    "bar": "bar_length",
    "work": "work_form_2",
    "tool": "tool_form_2",
    "mount": "mount",
    "force": "force_gain",
    "angle": "angle_reference",
}


def _instrument(found: Findings) -> Iterator[tuple[str, str, bool]]:
    """Parts of the instrument that the model knows, what is stated of each or else the U (k = 2)
    assumed, and which it is."""
    bound = bound_of(found.posterior)
    instrument = bound.campaign.instrument
    known = {own.name: own for own in uncertainties(bound.campaign, bound.model.nuisances).assumed}
    for key, own in ((key, known[name]) for key, name in _INSTRUMENT.items() if name in known):
        ball: Ball | None = getattr(instrument, key, None)
        if own.unit == "1" or key == "mount":
            size = f"{two_digits(2.0 * own.sd / (own.value or 1.0), 100.0)} %"
        elif own.unit == "rad":
            size = f"{two_digits(np.degrees(2.0 * own.sd))}°"
        else:
            factor, label = display_unit(own.unit)
            size = f"{two_digits(2.0 * own.sd, factor)} {label}"
        size = f"U = {size}" if own.stated else f"± {size}"
        if key == "bar" and own.value:
            size = f"{own.value * 1e3:+.4g} µm, {size}".replace("-", "−")
        if ball is not None and ball.stated_sphericity_um is not None:
            size = ball.grade or f"{ball.sphericity_um:g} µm"
        yield key, size, own.stated


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


# ---- on paper: A4 by fpdf2, millimetres

# A browser, which takes the sheets' scale, sets the same lines a little higher: FULL leaves it
# room.
_WIDTH = 182.0
_LEFT = 14.0
_TOP = 14.0
_FULL = 272.0
_INK = 0
_SOFT = 85
_SHADES = {"usable": (255, 0), "reserved": (232, 0), "unusable": (0, 255)}
_PAIRED = 104.0
_LARGEST = 88.0
_WIDE = 1.6
_DPI = 300.0
_SIGNED = 256.0


def pdf_of(made: Sequence[ReportSheet], title: str, language: str, created: datetime) -> bytes:
    """Return the sheets as a PDF, a page each, fonts embedded."""
    with _document() as pdf:
        pdf.set_title(title)
        pdf.set_lang(language)
        pdf.set_creation_date(created)
        for sheet in made:
            _draw(pdf, sheet)
        return bytes(pdf.output())


def _fitted(*made: ReportSheet) -> tuple[ReportSheet, ...]:
    """The sheets with letters so small that each stays on its page."""
    fitting = list(made)
    with _document() as pdf:
        for k, sheet in enumerate(made):
            for _ in range(20):
                if (end := _draw(pdf, fitting[k], pictures=False)) <= _FULL:
                    break
                share = min(0.985, max(0.8, (_FULL - _TOP) / (end - _TOP)) ** 0.5)
                fitting[k] = replace(sheet, scale=fitting[k].scale * share)
    return tuple(fitting)


@contextmanager
def _document() -> Iterator[FPDF]:
    from fpdf import FPDF  # commands that write no report start without it

    pdf = FPDF()
    pdf.set_auto_page_break(False)
    pdf.set_margins(_LEFT, _TOP, _LEFT)
    for style, name in (("", "DejaVuSans.ttf"), ("B", "DejaVuSans-Bold.ttf")):
        pdf.add_font("DejaVu", style, Path(mpl.get_data_path()) / "fonts" / "ttf" / name)
    try:
        yield pdf
    finally:
        fonts: Any = pdf.fonts.values()
        for font in fonts:
            font.close()


def _draw(pdf: FPDF, sheet: ReportSheet, *, pictures: bool = True) -> float:
    """Add a page with a sheet; returns where it ends [mm]."""
    pdf.add_page()
    _write(pdf, sheet.title, 15.0 * max(sheet.scale, 0.8), bold=True)
    _write(pdf, sheet.line, 8.0 * max(sheet.scale, 0.8), grey=_SOFT)
    for block in sheet.blocks:
        pdf.set_xy(_LEFT, pdf.y + 2.2 * sheet.scale)
        if isinstance(block, str):
            _write(pdf, block, 7.2 * sheet.scale, grey=_SOFT)
        elif isinstance(block, Fields):
            pdf.set_y(max(pdf.y, _SIGNED if block.tall else 0.0))
            _draw_fields(pdf, block, sheet.scale)
        elif isinstance(block, Banner):
            fill, ink = _SHADES[block.kind]
            pdf.set_fill_color(fill)
            _write(
                pdf,
                block.sentence,
                10.0 * sheet.scale,
                bold=True,
                grey=ink,
                border=1,
                padding=1.6,
                fill=True,
            )
            pdf.set_fill_color(255)
        elif isinstance(block, Table):
            _draw_table(pdf, block, sheet.scale)
        elif isinstance(block, Pair):
            _draw_pair(pdf, block, sheet.scale, pictures)
        else:
            _draw_picture(pdf, block, _WIDTH, 100.0 * sheet.scale, pictures)
    return float(pdf.y)


def _write(
    pdf: FPDF,
    text: str,
    size: float,
    *,
    width: float = _WIDTH,
    bold: bool = False,
    grey: int = _INK,
    **more: Any,
) -> None:
    pdf.set_font("DejaVu", "B" if bold else "", size)
    pdf.set_text_color(grey)
    pdf.multi_cell(width, 0.46 * size, text, align="L", new_x="LEFT", new_y="NEXT", **more)


def _draw_fields(pdf: FPDF, block: Fields, scale: float) -> None:
    """Two columns: name, and entry above a line."""
    gap = 6.0
    label = 36.0
    size = 7.8 * scale
    entry = 0.5 * (_WIDTH - gap) - label
    for pair in zip(block.entries[::2], (*block.entries[1::2], None), strict=False):
        start = pdf.y + (9.0 if block.tall else 0.7) * scale
        ends = []
        for k, own in enumerate(filter(None, pair)):
            for x, width, text, grey in (
                (0.0, label, own[0], _SOFT),
                (label, entry, own[1] or " ", _INK),
            ):
                pdf.set_xy(_LEFT + k * (label + entry + gap) + x, start)
                _write(pdf, text, size, width=width, grey=grey)
                ends.append(pdf.y)
        pdf.set_draw_color(150)
        for k, _ in enumerate(filter(None, pair)):
            left = _LEFT + k * (label + entry + gap) + label
            pdf.line(left, max(ends) + 0.4 * scale, left + entry, max(ends) + 0.4 * scale)
        pdf.set_y(max(ends) + 0.4 * scale)


def _draw_table(pdf: FPDF, table: Table, scale: float) -> None:
    from fpdf.fonts import FontFace

    if table.caption:
        _write(pdf, table.caption, 9.0 * scale, bold=True)
        pdf.set_y(pdf.y + 0.8 * scale)
    size = 7.8 * scale
    rows = [table.heads, *table.shown()]
    pdf.set_font("DejaVu", "", size)
    pdf.set_text_color(_INK)
    natural = [
        max(pdf.get_string_width(row[k]) for row in rows) * 1.1 + 3.0
        for k in range(len(table.heads))
    ]
    ends = (0, len(natural) - 1)  # broken into lines where there is no room
    scarce = (_WIDTH - sum(w for k, w in enumerate(natural) if k not in ends)) / sum(
        natural[k] for k in ends
    )
    widths = [w * scarce if k in ends else w for k, w in enumerate(natural)]
    aligned = ["RIGHT" if numeric else "LEFT" for numeric in table.numeric]
    look = {
        "borders_layout": "HORIZONTAL_LINES",
        "line_height": 0.46 * size,
        "padding": (0.55 * scale, 1.0),
    }
    pdf.set_draw_color(150)
    with pdf.table(
        rows,
        col_widths=widths,
        width=_WIDTH,
        text_align=aligned,
        headings_style=FontFace(emphasis="BOLD"),
        **look,
    ):
        pass


def _draw_pair(pdf: FPDF, block: Pair, scale: float, pictures: bool) -> None:
    top = pdf.y
    indent = 0.0 if block.wide else _PAIRED + 4.0
    _draw_picture(pdf, block.picture, _WIDTH if block.wide else _PAIRED, _LARGEST * scale, pictures)
    foot = pdf.y
    pdf.set_xy(_LEFT + indent, foot + scale if block.wide else top)
    _write(pdf, block.heading, 9.0 * scale, width=_WIDTH - indent, bold=True)
    for item in ["; ".join(block.beside)] if block.wide else block.beside:
        pdf.set_xy(_LEFT + indent, pdf.y + 0.6 * scale)
        _write(pdf, item, 7.2 * scale, width=_WIDTH - indent)
    pdf.set_y(max(foot, pdf.y))


def _draw_picture(pdf: FPDF, picture: Picture, width: float, height: float, pictures: bool) -> None:
    """A figure as wide as it may be, its caption below."""
    inches = picture.figure.get_size_inches()
    width = min(width, height * inches[0] / inches[1])
    if pictures:
        drawn = io.BytesIO()
        picture.figure.savefig(drawn, format="png", dpi=_DPI * width / 25.4 / inches[0])
        pdf.image(drawn, _LEFT, pdf.y, width, alt_text=picture.caption)
    pdf.set_xy(_LEFT, pdf.y + width * inches[1] / inches[0])
    _write(pdf, picture.caption, 6.8, width=max(width, 60.0), grey=_SOFT)
