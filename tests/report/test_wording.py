"""Findings in words: each function makes its sentence, and nothing is decided by reading one.

Every function of report/wording reworded, all decisions and numbers stay.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from fleets import drawn_rows
from reports import undrawn
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import Degeneracy
from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.analysis.comparison import Sign
from ldbb_bayes.analysis.cures import Cure
from ldbb_bayes.analysis.machine_description import VisibleParameter
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.analysis.parameter_changes import changed_parameters
from ldbb_bayes.analysis.remedies import Remedy
from ldbb_bayes.analysis.tried_remedies import RemedyKind
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.campaign.remarks import Remark, RemarkKind
from ldbb_bayes.cli import app
from ldbb_bayes.fleet.campaign_row import Job, Settings, fit_row
from ldbb_bayes.fleet.selection import CaveatKind, choose
from ldbb_bayes.inference.checks import Check, CheckKind
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.report import wording
from ldbb_bayes.report.change_tables import change_cells, change_parts
from ldbb_bayes.report.findings import findings_of_fit
from ldbb_bayes.report.page import compose
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import Details
from ldbb_bayes.report.text_translation import TextTranslation, catalogue_of
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.report.wording import number_words
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.results import Table, json_text

MODEL = lb.HybridModel.first(1)
QUICK = lb.inference.StoppingRule(ess=100.0)
FORCES_N = (36.0, 400.0, 742.0)
TEMPLATES = Path(wording.__file__).parents[1] / "templates"


def hashed(value: Any) -> Any:
    """Every text of what a function returns, unreadable."""
    if isinstance(value, str):
        return f"#{hashlib.sha256(value.encode()).hexdigest()[:12]}" if value else value
    if value is None or isinstance(value, dict | int | float):
        return value
    hashed_items = [hashed(item) for item in value]
    if isinstance(value, tuple | list):
        return type(value)(hashed_items)
    return iter(hashed_items)


def reworded(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def answer(*arguments: Any, **options: Any) -> Any:
        return hashed(function(*arguments, **options))

    return answer


def reword(monkeypatch: pytest.MonkeyPatch) -> int:
    """Put it in the place of every public function of the module, wherever it was imported to."""
    changed = 0
    originals = {
        getattr(wording, name)
        for name in wording.__all__
        if callable(getattr(wording, name)) and name != "with_words"
    }
    for name, module in list(sys.modules.items()):
        if name.startswith("ldbb_bayes"):
            for key, value in list(vars(module).items()):
                if callable(value) and type(value).__name__ == "function" and value in originals:
                    monkeypatch.setattr(module, key, reworded(value))
                    changed += 1
    return changed


def same(plain: Any, other: Any, where: str = "") -> int:
    """Whether two records differ in sentences alone; how many do."""
    if isinstance(plain, str) and isinstance(other, str):
        assert plain == other or "#" in other, (where, plain, other)
        return int(plain != other)
    assert type(plain) is type(other), (where, plain, other)
    if isinstance(plain, dict):
        assert list(plain) == list(other), where
        return sum(same(plain[key], other[key], f"{where}.{key}") for key in plain)
    if isinstance(plain, list | tuple):
        assert len(plain) == len(other), (where, plain, other)
        pairs = enumerate(zip(plain, other, strict=True))
        return sum(same(one, two, f"{where}[{index}]") for index, (one, two) in pairs)
    assert plain == other, (where, plain, other)
    return 0


@pytest.fixture(scope="module")
def campaigns() -> dict[str, lb.Campaign]:
    """Readings that the model expects, and readings that no compliance explains."""
    good = simulated(plan((40,) * 3, forces_N=FORCES_N))
    tests = []
    for test in good.tests:
        tests.append(test.with_reading_um(-0.14 * np.asarray(test.reading_um)))
    return {"good": good, "turned": lb.Campaign(tuple(tests), name="turned")}


@pytest.fixture(scope="module")
def turned(campaigns: dict[str, lb.Campaign]) -> xr.DataTree:
    return lb.sample(
        lb.HybridModel.first(0), campaigns["turned"], seed=1, sampler="independent", rule=QUICK
    )


@pytest.fixture(scope="module")
def folders(
    campaigns: dict[str, lb.Campaign], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    return {
        name: lb.write_campaign(campaign, tmp_path_factory.mktemp("campaigns") / name)
        for name, campaign in campaigns.items()
    }


def plain_json(record: Any) -> Any:
    return json.loads(json_text({"record": record}))


def part_of(block: Any) -> Any:
    if isinstance(block, Table):
        return [block.caption, list(block.heads), [list(row) for row in block.shown()]]
    if isinstance(block, Picture):
        return [block.key, block.caption]
    if isinstance(block, Details):
        return [block.summary, [part_of(item) for item in block.content]]
    return block


def page_of(posterior: xr.DataTree) -> Any:
    """Alerts, sections and what stands in them."""
    document = compose(
        findings_of_fit(
            posterior, comparison="left out in this test", recommended="left out in this test"
        )
    )
    sections = []
    for section in document.sections:
        content = [part_of(block) for block in section.content]
        sections.append([section.key, section.title, content])
    return [list(document.alerts), sections]


def analyses_of(campaign: lb.Campaign) -> Any:
    models = {"constant": MODEL.with_degree(0), "linear": MODEL}
    results = [
        lb.check_campaign(campaign),
        lb.identify(MODEL, campaign),
        lb.compare(models, campaign, evidence_only=True),
    ]
    results.append(lb.design(MODEL, pilot=campaign, tests=2, forces_N=FORCES_N))
    return plain_json([wording.with_words(result) for result in results])


def rows_of(folders: dict[str, Path]) -> Any:
    """Rows of a batch, and which of its campaigns are relied on."""
    settings = Settings(model_to_toml(lb.HybridModel.first(0)), ess=100.0)
    rows = [
        fit_row(settings, Job(k, str(folder), str(folder)))
        for k, folder in enumerate(folders.values())
    ]
    relied, caveats = choose(pd.DataFrame(rows))
    assert list(relied["campaign"]) == [str(folders["good"])]
    kinds_and_names = [[str(caveat.kind), caveat.names] for caveat in caveats]
    return plain_json([rows, list(relied["campaign"]), kinds_and_names])


def population_of() -> Any:
    """Of eight campaigns, two of one machine; one campaign that the model does not expect, one not
    converged."""
    rows = drawn_rows(8, np.random.default_rng(6)).assign(
        machine_id=[f"M{m}" for m in range(7)] + ["M6"]
    )
    doubtful = rows.assign(
        kinds=[[], ["truncation"], ["noise"], *[[]] * 5], converged=[True] * 7 + [False]
    )
    pooled = lb.fleet.fit_population(doubtful)
    assert "M1" not in pooled.machine
    return plain_json({**wording.with_words(pooled), "sha256": None})


def fits_of(folder: Path) -> Any:
    """What the command prints and its exit code: a target missed, one reached, bad input."""
    model = ("--degree", "0", "--without", "discrepancy,setup-shift")
    fit = ["fit", str(folder), *model, "--sampler", "independent", "--json", "--quiet"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ldbb_bayes.inference.mcmc.Assessment.meets", lambda *_, **__: False)
        runs = [CliRunner().invoke(app, [*fit, "--max-steps", "400"])]
    runs += [
        CliRunner().invoke(app, [*fit, *options]) for options in (["--ess", "600"], ["--ci", "2"])
    ]
    codes = [run.exit_code for run in runs]
    assert codes == [1, 0, 2]
    records = [json.loads(run.stdout) | {"provenance": None} for run in runs[:2]]
    for record in records:
        record["sampler"]["seconds"] = None
    return [codes, records]


@pytest.mark.slow
@pytest.mark.parametrize(
    "analysis",
    ["analyses", "page", "rows", "population", "fits"],
)
def test_words_decide_nothing(
    analysis: str,
    campaigns: dict[str, lb.Campaign],
    folders: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    """Decisions, numbers, exit codes and campaigns left out; of a campaign that the model expects
    and one that it does not."""
    undrawn(monkeypatch)
    work: dict[str, Callable[[], Any]] = {
        "analyses": lambda: analyses_of(campaigns["good"]),
        "page": lambda: page_of(request.getfixturevalue("turned")),
        "rows": lambda: rows_of(folders),
        "population": population_of,
        "fits": lambda: fits_of(folders["good"]),
    }
    plain = work[analysis]()
    assert reword(monkeypatch) > 30
    assert same(plain, work[analysis]()) >= 5


@pytest.mark.parametrize(
    ("words", "kinds"),
    [
        (SENTENCES["cures"], set(Cure) - {Cure.CALIBRATION}),
        (SENTENCES["plans"], set(RemedyKind) - {RemedyKind.CERTIFICATE}),
        (SENTENCES["origins"], Origin),
        (SENTENCES["concerns"], {*ConcernKind, "one-force", "large-unit"}),
        (SENTENCES["remarks"] | SENTENCES["choices"], RemarkKind),
        (SENTENCES["signs"], Sign),
        (SENTENCES["caveats"], CaveatKind),
    ],
)
def test_every_kind_has_its_words(words: dict[str, Any], kinds: Any) -> None:
    """Looked up by value, so that words need not import the analyses."""
    assert set(words) == set(map(str, kinds))


PRIVATE = (
    r"told (from|apart)|tells? \w* ?apart|lopsided|unasked|in company|Idle here|foret(ell|old)|set"
    r" aside|for granted|tion aside"
)


def test_words_are_those_of_the_field(root: Path) -> None:
    """Terms of art in the order of the alphabet; words of this project alone are nowhere."""
    glossary = tomllib.loads((TEMPLATES / "glossary.toml").read_text(encoding="utf-8"))
    assert list(glossary) == sorted(glossary, key=str.casefold)
    pages = [
        *TEMPLATES.parents[1].rglob("*.py"),
        *filter(Path.is_file, TEMPLATES.rglob("*")),
        *(root / "docs").rglob("*.md"),
        root / "README.md",
    ]
    for page in pages:
        match = re.search(PRIVATE, page.read_text(encoding="utf-8"))
        assert match is None, f"{page.name}: {match}"


def test_a_decision_by_words_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def count(campaign: lb.Campaign) -> list[str]:
        return [
            text
            for text in wording.preview_sentences(lb.check_campaign(campaign))
            if text.startswith("Note: One")
        ]

    one_way = simulated(plan((30,) * 3, forces_N=FORCES_N))
    plain = count(one_way)
    assert plain
    reword(monkeypatch)
    with pytest.raises(AssertionError):
        same(plain, count(one_way))


# ---- what the functions make of findings


@pytest.mark.parametrize(
    ("items", "text"),
    [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")],
)
def test_items_are_joined(items: list[str], text: str) -> None:
    assert wording.joined(items) == text


def test_items_are_joined_by_another_word() -> None:
    assert wording.joined(["a", "b", "c"], "or") == "a, b or c"


@pytest.mark.parametrize(
    ("name", "words"),
    [("bar_length", "bar length"), ("form_cos2", "2-lobe form (cos 2θ)")],
)
def test_a_nuisance_in_words(name: str, words: str) -> None:
    assert wording.nuisance_words(name) == words


@pytest.mark.parametrize(
    ("name", "unit"), [("bar_length", (1e-3, "µm")), ("mount", (1e-3, "µm/bar"))]
)
def test_the_unit_in_which_a_nuisance_is_read(name: str, unit: tuple[float, str]) -> None:
    assert wording.unit_words(name) == unit


@pytest.mark.parametrize(
    ("term", "words"),
    [("BallForm", "ball form"), ("ReadingNoise", "reading noise"), ("E_C0YX", "E_C(0Y)X")],
)
def test_a_term_in_words(term: str, words: str) -> None:
    assert wording.term_words(term) == words
    assert wording.source_words(term) == words


def test_the_prior_of_the_parameters_is_a_source() -> None:
    assert wording.source_words("Parameters") == "prior of the parameters"


@pytest.mark.parametrize(
    ("p_value", "words"),
    [(0.0, "< 0.0001"), (9e-5, "< 0.0001"), (1.2e-4, "= 0.00012"), (0.25, "= 0.25"), (1.0, "= 1")],
)
def test_no_p_value_reads_0(p_value: float, words: str) -> None:
    assert number_words.p_value_words(p_value) == words


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (0.0, "< 0.001"),
        (4e-4, "< 0.001"),
        (0.0005, "0.001"),
        (0.25, "0.250"),
        (0.9995, "> 0.999"),
        (0.9996, "> 0.999"),
        (1.0, "> 0.999"),
    ],
)
def test_no_probability_reads_0_or_1(probability: float, words: str) -> None:
    assert wording.probability_words(probability) == words


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        (None, 60.0, "≤ 60"),
        (18.0, None, "≥ 18"),
        (-20.0, 20.0, "± 20"),
        (-20.0, 40.0, "−20 … 40"),
        (None, 12_000.0, "≤ 12000"),
        (-1e6, 9999.7, "−1000000 … 10000"),
        (0.12345, None, "≥ 0.1235"),
        (None, None, ""),
    ],
)
def test_limits_in_words(lower: float | None, upper: float | None, words: str) -> None:
    assert wording.limit_words(lower, upper) == words


def test_limits_in_the_unit_for_reading() -> None:
    assert wording.limit_words(None, 6e-5, 1e6) == "≤ 60"


def test_hyper_parameters_but_for_the_scales_of_single_circles() -> None:
    hyper_um = {"sigma": 0.31, "lambda_f036": 1.0, "decay": 0.5}
    assert wording.joined_sizes(hyper_um, " = ") == "sigma = 0.31 µm, decay = 0.5"


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({}, ""),
        ({"C_XXX": 1.0, "C_XXY": -1.0, "C_XXZ": 2.5}, "C_XXX − C_XXY + 2.5 C_XXZ"),
        ({"C_XXX": -1.0}, "−C_XXX"),
    ],
)
def test_the_sum_that_a_parameter_stands_for(members: dict[str, float], words: str) -> None:
    parameter = VisibleParameter("C_XXX", "mm/N", "", {}, not_negative=True, members=members)
    assert wording.sum_in_words(parameter) == words


def test_a_change_is_named_by_its_forces() -> None:
    change = {"smallest_force_N": 36.0, "largest_force_N": 742.0}
    assert wording.changes_by_words("C_XXX", change) == "C_XXX changes from 36 N to 742 N by"


@pytest.mark.parametrize(
    ("increase", "decrease", "words"),
    [
        (0.96, 0.04, "increases with probability 0.960"),
        (0.0, 1.0, "decreases with probability > 0.999"),
        (0.7, 0.3, "no change shown (increase 0.700, decrease 0.300)"),
        (0.2, 0.1, "no change shown (increase 0.200, decrease 0.100, exactly none 0.700)"),
    ],
)
def test_the_direction_of_a_change(increase: float, decrease: float, words: str) -> None:
    change = {"probability_of_increase": increase, "probability_of_decrease": decrease}
    assert wording.direction_words(change) == words


NO_CHANGE = {
    "unit": "mm/N",
    "probability_of_increase": 0.005,
    "probability_of_decrease": 0.006,
    "change": {"mean": 1e-9, "sd": 2e-7, "ci_low": 0.0, "ci_high": 0.0},
    "if_any": {"mean": 1e-7, "sd": 2e-6, "ci_low": -3.14e-6, "ci_high": 4.16e-6},
}


def test_a_change_whose_interval_is_zero_has_the_interval_of_a_change_that_is_there() -> None:
    words = "no change shown (increase 0.005, decrease 0.006, exactly none 0.989"
    assert wording.direction_words(NO_CHANGE) == f"{words}; if any, −3.1 to 4.2 nm/N)"
    assert wording.direction_words(NO_CHANGE | {"if_any": None}) == f"{words})"


def test_the_row_of_a_change_whose_interval_is_zero_has_no_uncertainty() -> None:
    cells = change_cells(NO_CHANGE)
    assert cells == ("0", "–", "–", "–", "nm/N")


def test_the_relative_change_has_no_uncertainty_either() -> None:
    compliance = {"mean": 5e-5, "sd": 4e-6, "ci_low": 4.2e-5, "ci_high": 5.8e-5}
    change = NO_CHANGE | {
        "prob": 0.95,
        "smallest_force_N": 36.0,
        "reference_force_N": 389.0,
        "largest_force_N": 742.0,
        "at_smallest": compliance,
        "at_reference": compliance,
        "at_largest": compliance,
        "relative": {"mean": 2e-4, "sd": 2e-3, "ci_low": 0.0, "ci_high": 0.018},
    }
    table, _ = change_parts(change)
    assert isinstance(table, Table)
    assert table.rows[-1] == ("change / C(F0)", "0", "–", "–", "%")


def test_a_change_that_is_almost_certainly_none_is_not_stated_by_the_few_draws() -> None:
    """Of 1000 draws 958 are zero, 29 above and 13 below: the interval with equal tails is
    [0.00, 0.91] nm/N, although changes of both signs are possible."""
    change = NO_CHANGE | {
        "probability_of_increase": 0.029,
        "probability_of_decrease": 0.013,
        "change": {"mean": 0.06e-6, "sd": 0.91e-6, "ci_low": 0.0, "ci_high": 0.91e-6},
    }
    assert change_cells(change) == ("0", "–", "–", "–", "nm/N")
    words = "no change shown (increase 0.029, decrease 0.013, exactly none 0.958"
    assert wording.direction_words(change) == f"{words}; if any, −3.1 to 4.2 nm/N)"
    rarer = change | {"probability_of_increase": 0.05}
    assert change_cells(rarer).interval == "[0.00, 0.91]"
    assert "if any" not in wording.direction_words(rarer)


def test_a_change_whose_interval_is_zero_in_german() -> None:
    german = TextTranslation(words_of("de"), catalogue_of("de", "annex"))
    translated = german.text(wording.direction_words(NO_CHANGE))
    assert translated.endswith("genau keine 0,989; falls doch, −3,1 bis 4,2 nm/N)")
    assert not german.missing


def test_the_interval_of_a_parameter_and_its_probability() -> None:
    entry = {"mean": 1.0, "ci90": [0.5, 1.5]}
    assert wording.interval_of(entry) == (0.5, 1.5)
    assert wording.percent_of({"parameters": {"C_XXX": entry}}) == "90 %"


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("", "decimal mark: , (as in the others): --decimal"),
        ("a.csv", "decimal mark: , (as in the others; a.csv): --decimal"),
    ],
)
def test_an_assumption_names_its_reason_and_its_option(place: str, words: str) -> None:
    assumption = Assumption(place, "decimal mark", ",", "as in the others", "--decimal")
    assert wording.assumption_words(assumption) == words


@pytest.mark.parametrize(
    ("certificate", "place"),
    [
        ("bar_U_um", "[bar] U_um"),
        ("work", "[balls.work]"),
        ("", "none: [terms.BarLength] of a model"),
    ],
)
def test_what_is_assumed_and_where_a_certificate_says_it(certificate: str, place: str) -> None:
    uncertainty = Uncertainty("bar_length", 0.0, 1e-3, "mm", certificate, stated=False)
    assert wording.assumed_words(uncertainty) == ("bar length", place)


def gap_in(*names: str) -> Any:
    """A preview in which these tests have a gap."""
    remarks = (Remark(RemarkKind.GAP, {"gap_deg": 12.34}),)
    return SimpleNamespace(tests=[SimpleNamespace(name=name, remarks=remarks) for name in names])


def test_a_remark_on_several_tests_is_one_sentence() -> None:
    assert wording.peculiarity_sentences(gap_in("f036", "f742")) == [
        "Look at f036, f742: gap of 12.3°."
    ]


def test_not_more_than_five_tests_are_named() -> None:
    (sentence,) = wording.peculiarity_sentences(gap_in(*"abcdefg"))
    assert sentence == "Look at a, b, c, d, e and 2 more: gap of 12.3°."


def test_nothing_odd_no_sentence() -> None:
    assert wording.peculiarity_sentences(gap_in()) == []


BAR_LENGTH = Degeneracy(
    term="BarLength",
    combination={"bar_length": 1e-3, "E_XX1": 6.67e-6, "E_YY1": 6.67e-6},
    parameters=("E_XX1", "E_YY1"),
    units={"E_XX1": "1", "E_YY1": "1"},
    modelled=True,
    stated=False,
    prior_sds=1.0,
    change_um=0.0,
)


def test_a_degeneracy_has_its_rate_and_its_cure() -> None:
    cures = [[Cure.RADIUS, Cure.CALIBRATION]]
    assert wording.degeneracy_items([BAR_LENGTH], cures) == (
        "1.00 µm of bar length looks exactly like −6.67 µm/m of E_XX1 and −6.67 µm/m of E_YY1."
        " Cure: A second radius or a calibration of the bar's length.",
    )


def test_a_degeneracy_without_a_test_that_ends_it_asks_for_a_prior() -> None:
    (item,) = wording.degeneracy_items([BAR_LENGTH], [[]])
    assert item.endswith("Cure: A narrower prior on one of them.")


@pytest.mark.parametrize(("log_prob", "verb"), [(-20.0, "contradict"), (-8.0, "speak against")])
def test_how_strongly_readings_oppose_a_prior(log_prob: float, verb: str) -> None:
    concern = Concern(ConcernKind.TRUNCATION, log_prob, -4.0)
    (sentence,) = wording.concern_sentences((concern,), {})
    assert sentence.startswith(f"The readings {verb} non-negative compliance: ln P(T | y) = −")


@pytest.mark.parametrize(
    ("levels", "beginning"), [(1.0, "One force level: only"), (2.0, "Only 2 force levels: at")]
)
def test_too_few_forces(levels: float, beginning: str) -> None:
    (sentence,) = wording.concern_sentences((Concern(ConcernKind.FORCES, levels, 3.0),), {})
    assert sentence.startswith(beginning)


@pytest.mark.parametrize(("kind", "option"), [("independent", "--ess"), ("joint", "--max-steps")])
def test_the_cure_of_a_fit_that_has_not_converged(kind: str, option: str) -> None:
    concern = Concern(ConcernKind.NOT_CONVERGED, 200.0, 400.0)
    sampler = {"kind": kind, "target_rhat": 1.01}
    (sentence,) = wording.concern_sentences((concern,), sampler)
    assert "ESS ≥ 400 and R-hat ≤ 1.01 was not reached in 200 steps" in sentence
    assert option in sentence


def fit_with_shifts(**moved_by_test: float) -> Any:
    """A fit that does not expect order 4 of tests which move a parameter by so much [u]."""
    failing = [Check(CheckKind.ORDER, test, 1e-3, order=4) for test in moved_by_test]
    misfits = [check for check in failing if moved_by_test[check.test] > 0.5]
    passing = [Check(CheckKind.NOISE, "f036", 0.25)]
    return SimpleNamespace(
        misfits=misfits,
        unexpected=failing,
        checks=failing or passing,
        shift={test: shift for test, shift in moved_by_test.items() if shift > 0.5},
        widening=0.0,
        kinds=(),
        concerns=(),
    )


def test_a_model_that_expects_the_readings() -> None:
    assert wording.expectation(fit_with_shifts()) == (
        "the model expects readings like these (1 check, smallest p = 0.25, white noise of f036)"
    )


def test_a_model_that_does_not_expect_the_readings() -> None:
    assert wording.expectation(fit_with_shifts(f520=0.7)) == (
        "the model does not expect readings like these (order 4 of f520):"
        " without f520 a parameter moves by 0.7 u"
    )


def test_what_is_not_expected_but_hardly_matters() -> None:
    assert wording.expectation(fit_with_shifts(f520=0.1)) == (
        "what the model does not expect (order 4 of f520) hardly moves an interval"
    )


RESULT = {"model": {"preset": "first"}, "sampler": {}}


def test_nothing_forbids_the_numbers_of_a_good_fit() -> None:
    assert wording.alert_sentences(fit_with_shifts(), RESULT) == ()


def test_a_misfit_limits_the_numbers() -> None:
    (sentence,) = wording.alert_sentences(fit_with_shifts(f520=0.7), RESULT)
    assert sentence.startswith("Misfit: the model does not expect readings like these")


def test_least_squares_limits_the_numbers() -> None:
    result = {**RESULT, "model": {"preset": "paper"}}
    assert wording.alert_sentences(fit_with_shifts(), result) == (wording.PAGE["paper"],)


FITTED_MODEL = {
    "degree": 1,
    "reference_force_N": 389.0,
    "preset": "first",
    "priors": "proper",
    "truncated": True,
    "terms": ["BallForm", "Mount"],
}


def test_what_was_fitted() -> None:
    assert wording.model_words(FITTED_MODEL) == (
        "Compliance linear in force, reference force 389 N; preset first, priors proper,"
        " no compliance is negative; terms: ball form, mount."
    )


def test_terms_without_effect_are_named() -> None:
    words = wording.model_words({**FITTED_MODEL, "truncated": False, "idle_terms": ["Hysteresis"]})
    assert "compliances may be negative" in words
    assert words.endswith("Without effect here: hysteresis.")


def test_how_well_it_was_fitted() -> None:
    quality = {"rmse_um": 0.456, "linearisation_error_um": 0.0012, "log_prob_truncation": -3.25}
    words = wording.quality_words(quality)
    assert words.startswith("RMSE 0.46 µm (Eq. 34, of all that circles share); linear geometry")
    assert "at most 0.0012 µm. ln P(T | y) = −3.25: the log probability" in words


def test_joints_and_rank_of_a_machine() -> None:
    described = lb.describe_machine(lb.Machine("wXFYZt", ("XY", "YZ")))
    words = " ".join(wording.machine_sentences(described))
    assert words.startswith("wXFYZt, planes XY, YZ. ")
    assert f" {described.rank} compliances can be separated; condition number" in words


@pytest.mark.parametrize(("degree", "name"), [(0, "constant"), (1, "linear"), (2, "quadratic")])
def test_the_model_of_the_annex(degree: int, name: str) -> None:
    sentence = f"Numbers from here on are those of {name} compliance alone"
    assert wording.annex_words(degree, averaged=False) == f"{sentence}."
    assert wording.annex_words(degree, averaged=True) == (
        f"{sentence}; those of sheets 1 and 2, and of the budgets, are averaged over models, and so"
        " are the verdicts there."
    )


@pytest.mark.parametrize("instrument", [False, True])
@pytest.mark.parametrize("machine", [False, True])
def test_what_differences_rest_on(instrument: bool, machine: bool) -> None:
    words = wording.common_words(389.0, Shared(instrument=instrument, machine=machine))
    assert words.startswith("Differences are at 389 N; ")
    assert ("The instrument was the same" in words) == instrument
    assert ("Instruments are taken as independent" in words) == (not instrument)
    assert ("The machine was the same" in words) == machine
    assert ("Machines are taken as independent" in words) == (not machine)
    assert ("no compliance is negative is left out" in words) == (instrument or machine)


def test_two_stated_machines_are_not_said_to_be_perhaps_one() -> None:
    words = wording.common_words(389.0, Shared(states_two_machines=True))
    assert "state different machines, which are taken as independent." in words
    assert "--same-machine" not in words


def test_differences_without_doubts() -> None:
    assert wording.difference_doubts("a", "b", {"conflict": ("bar_length", 0.02)}) == ()
    assert wording.difference_doubts("a", "b", {}) == ()
    assert wording.unusable_fit_sentences("a", "b", True, {}) == ()


def test_differences_with_doubts() -> None:
    (instrument,) = wording.difference_doubts("a", "b", {"conflict": ("bar_length", 0.004)})
    assert "a and b disagree about the bar length (p = 0.004)" in instrument
    assert instrument.startswith("Not one instrument")
    (certain,) = wording.difference_doubts("a", "b", {"conflict": ("bar_length", 0.0)})
    assert "a and b disagree about the bar length (p < 0.0001)" in certain
    conflict = ("joint_load_X_seat", 0.004)
    (machine,) = wording.difference_doubts("a", "b", {"conflict": conflict})
    assert machine.startswith("Not the same joints: a and b disagree about the seat of axis X")


def test_compared_fits_that_cannot_be_used() -> None:
    converged, unit = wording.unusable_fit_sentences(
        "a", "b", False, {"doubted_units": (("f036",), ())}
    )
    assert converged == "Not converged: b. Do not use its numbers."
    assert unit.startswith("The unit of the readings of a is in doubt.")


CHANGES = pd.DataFrame(
    {
        "difference": [1e-5, 1e-6],
        "sd": [1e-6, 1e-6],
        "ci_low": [0.8e-5, -1e-6],
        "ci_high": [1.2e-5, 3e-6],
        "unit": ["mm/N", "mm/N"],
        "probability_of_increase": [0.999, 0.8],
    },
    index=["C_XXX", "C_YYY"],
)


def test_parameters_that_have_changed_are_named_with_U() -> None:
    assert wording.change_sentence("a", "b", CHANGES, 0.95) == (
        "b differs from a (± U, k = 2) in: C_XXX 10.0 ± 2.0 nm/N."
        " 95 % intervals, each parameter by itself. Of these, allowing for 2 comparisons (Holm's"
        " method): C_XXX."
    )


def test_no_changes_are_named_where_campaigns_are_in_conflict() -> None:
    """Not at the terminal, not in the annex, not in Python."""
    table = CHANGES.copy()
    table.attrs["conflict"] = ("form_8_cos", 0.004)
    sentence = wording.change_sentence("a", "b", table, 0.95)
    assert sentence == "a and b: the differences cannot be used, so that no changes are named."
    refuses("differences must be usable to name changes", changed_parameters, table, 0.95)
    table.attrs["conflict"] = ("form_8_cos", 0.02)
    assert "C_XXX 10.0 ± 2.0 nm/N" in wording.change_sentence("a", "b", table, 0.95)


def test_no_parameter_has_changed() -> None:
    sentence = wording.change_sentence("a", "b", CHANGES.loc[["C_YYY"]], 0.95)
    assert "in: no parameter. 95 %" in sentence


def test_what_a_certificate_would_bring() -> None:
    """Parameters that it narrows by a tenth or more, the most narrowed first."""
    identifiability = SimpleNamespace(
        certificates={
            "none of these": {"C_XXX": 1.0, "E_XX1": 1.0, "E_C0YX": 1.0},
            "bar": {"C_XXX": 0.95, "E_XX1": 0.5, "E_C0YX": 0.2},
            "mount": {"C_XXX": 0.95, "E_XX1": 1.0, "E_C0YX": 1.0},
        }
    )
    assert wording.certificate_rows(identifiability) == [
        ("bar", "E_C(0Y)X 20 %, E_XX1 50 %"),
        ("mount", "none by a tenth"),
    ]
    assert wording.certificate_rows(identifiability, 1)[0] == ("bar", "E_C(0Y)X 20 %, …")


def test_at_what_an_identifiability_holds() -> None:
    identifiability = SimpleNamespace(
        hyper_um={"sigma": 0.3},
        measured=False,
        scales_from_pilot=False,
        contradicted_certificates=(),
        truncated=True,
        effective_parameters=1.5,
        parameters=("a", "b"),
        changes={"a": SimpleNamespace(smallest_force_N=36.0, largest_force_N=742.0)},
    )
    sentences = wording.identifiability_sentences(identifiability)
    assert "at sigma = 0.3 µm (prior median; no readings)." in sentences[0]
    assert "no compliance being negative" in sentences[0]
    identifiability.scales_from_pilot = True
    from_pilot = wording.identifiability_sentences(identifiability)
    assert "at sigma = 0.3 µm (mean of what the pilot leaves likely)." in from_pilot[0]
    identifiability.measured = True
    measured = wording.identifiability_sentences(identifiability)
    assert measured[0].startswith("Sign free: u without the condition")
    assert sentences[1].startswith("Effective number of parameters 1.5 of 2 (")


@pytest.mark.parametrize(
    ("model", "truncated"),
    [
        (lb.HybridModel.first(0), True),
        (lb.HybridModel.first(0).without("truncation"), False),
        (lb.HybridModel.paper(0), False),
    ],
)
@pytest.mark.parametrize("measured", [True, False])
def test_identify_speaks_of_negative_compliances_where_the_model_excludes_them(
    model: lb.HybridModel, truncated: bool, measured: bool
) -> None:
    campaign = simulated(plan()) if measured else plan()
    identified = lb.identify(model, campaign)
    sentences = " ".join(
        (
            *wording.identifiability_screen(identified),
            *wording.identifiability_sentences(identified),
        )
    )
    speaks = "none negative" in sentences or "no compliance being negative" in sentences
    assert identified.truncated == truncated
    assert speaks == truncated
    assert ("without the condition" in sentences) == (truncated and measured)
    # A plan can be put in another order; of circles that were run, each is repeated.
    assert ("Shuffle, both ways" in sentences) == measured


def judged(verdict: str, held_by: VarianceSource, **partner_shares: float) -> Any:
    """A verdict on a parameter, with the source that holds it and its partners."""
    return SimpleNamespace(
        verdict=verdict,
        held_by=held_by,
        partners=tuple(partner_shares),
        partner_shares=partner_shares,
        origin_shares={"measured here": 0.25, "stated": 0.0, "assumed": 0.75},
    )


MOUNT = VarianceSource("Mount", Origin.ASSUMED, 0.39)
IDENTIFIED = judged("identified", MOUNT)
CONFOUNDED = judged("confounded", MOUNT, Mount=0.39, E_YY1=0.2)
LIMITED = judged("prior-limited", VarianceSource("Parameters", Origin.ASSUMED, 0.9))


@pytest.mark.parametrize(
    ("entry", "words", "short", "held_by"),
    [
        (
            IDENTIFIED,
            "identified, limited by mount (39 %, assumed)",
            "identified: mount 39 %",
            "mount 39 %, assumed",
        ),
        (
            CONFOUNDED,
            "confounded with mount (39 %) and prior of E_YY1 (20 %)",
            "confounded: mount 39 %, …",
            "mount 39 %, prior of E_YY1 20 %, assumed",
        ),
        (LIMITED, "prior-limited", "prior-limited: its prior 90 %", "its prior 90 %, assumed"),
    ],
)
def test_verdicts_in_words(entry: Any, words: str, short: str, held_by: str) -> None:
    assert wording.verdict_words(entry) == words
    assert wording.short_verdict_words(entry) == short
    assert wording.held_by_words(entry) == held_by
    assert wording.origins_in_words(entry) == "25 / 0 / 75"


def test_verdicts_without_shares() -> None:
    assert wording.verdict_words(CONFOUNDED, shares=False) == (
        "confounded with mount and prior of E_YY1"
    )
    assert wording.verdict_words(IDENTIFIED, shares=False) == "identified"


def test_confounded_parameters_are_one_sentence() -> None:
    partners = CONFOUNDED.partners
    (sentence,) = wording.confounded_sentences({"C_XXX": partners, "C_YYY": partners})
    assert sentence.startswith("Confounded: C_XXX and C_YYY with mount and E_YY1. Nobody measured")


def test_no_sentence_without_confounded_parameters() -> None:
    assert not list(wording.confounded_sentences({}))


def test_what_is_switched_off_is_named() -> None:
    assert wording.not_modelled_sentences(("BallForm", "Drift")) == (
        "Not modelled: ball form and drift. No interval covers what was switched off.",
    )
    assert wording.not_modelled_sentences(()) == ()


@pytest.mark.parametrize(
    ("kind", "certificate", "words"),
    [
        (RemedyKind.DIRECTION, "", "both ways"),
        (RemedyKind.CERTIFICATE, "mount ± 2 %", "mount ± 2 %"),
        (RemedyKind.CERTIFICATE, "balls of grade G10", "G10 balls"),
    ],
)
def test_cures_in_words(kind: RemedyKind, certificate: str, words: str) -> None:
    assert wording.remedy_in_words(Remedy(kind, certificate, 0, 1.0, 0.5)) == words
    assert wording.remedy_in_words(None) == "–"


def test_doubts_about_one_bar_for_all_machines() -> None:
    without = wording.population_doubts(SimpleNamespace(caveats=(), instrument=False))
    with_bar = wording.population_doubts(SimpleNamespace(caveats=(), instrument=True))
    assert len(without) == 1
    assert with_bar[0] == without[0]
    assert "one bar has the same length and ball form in all campaigns" in with_bar[1]


def test_headings_of_identifiability_differ() -> None:
    assert wording.ALIKE.endswith(":")
    assert wording.NONE_ALIKE.endswith(".")
    assert len(wording.IN_FORCE) == len(DEGREE_NAMES)


def test_the_page_of_the_glossary_is_the_glossary() -> None:
    """The page can be read in a checkout, and says what a report says."""
    glossary = tomllib.loads((TEMPLATES / "glossary.toml").read_text(encoding="utf-8"))
    path = Path(__file__).parents[2] / "docs" / "reference" / "glossary.md"
    rows = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    expected = [f"| {term} | {meaning} |" for term, meaning in glossary.items()]
    assert [row.replace("\\|", "|") for row in rows[2:]] == expected


@pytest.mark.parametrize(
    ("topology", "name", "is_below"), [("wCAFYXZSt", "E_C0YX", True), ("wFXYZSt", "E_C0XY", False)]
)
def test_the_sign_of_squareness_is_that_of_the_model(
    topology: str, name: str, is_below: bool
) -> None:
    """A path that is long at 45° is that of axes whose angle is below 90°."""
    reading_mm = lb.machine.exact_reading_mm(
        lb.Machine(topology),
        lb.machine.Circle(radius_mm=150.0),
        np.radians([45.0, 135.0]),
        force_N=0.0,
        geometric_errors={name: 1e-4},
    )
    assert (reading_mm[0] > 0.0 > reading_mm[1]) == is_below
    glossary = tomllib.loads((TEMPLATES / "glossary.toml").read_text(encoding="utf-8"))
    assert "E_C(0Y)X above zero is an angle from +X to +Y below 90°" in glossary["squareness"]
    units = Path(__file__).parents[2] / "docs" / "reference" / "units.md"
    text = " ".join(units.read_text(encoding="utf-8").split())
    assert "angle from +X to +Y is then smaller than 90°. Of E_C(0X)Y, which turns Y, it is" in text


def test_the_sign_of_a_bayes_factor_near_zero_is_seen(compared: lb.analysis.Comparison) -> None:
    first, *rest = compared.prior_sensitivity
    scaled = tuple(replace(own, log_bayes_factor=-8.44) for own in rest)
    near = replace(
        compared,
        prior_sensitivity=(replace(first, log_bayes_factor=-0.03), *scaled),
        prior_sensitivity_crossings=(),
    )
    text = " ".join(wording.comparison_sentences(near))
    assert "does not change the sign" in text
    assert "ln B lies between −8.4 and −0.03." in text
