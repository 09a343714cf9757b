"""What the studies state: the paper's own numbers, right signs, calibrated intervals, and what the
README says of them."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import explanation
import numpy as np
import pandas as pd
import pytest
import study
from campaigns import cases, misses, printed

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.machine.exact import exact_reading_mm

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "studies"
CLAIMS: dict[str, list[str]] = cases(__file__, "claims.toml")


@cache
def stated(name: str) -> dict[str, Any]:
    return dict(json.loads((STUDIES / name / "results.json").read_text(encoding="utf-8")))


def near(one: float, other: float, relative: float = 1e-3) -> bool:
    return one == pytest.approx(other, rel=relative)


STUDIES_AND_CLAIMS = [(name, claim) for name, claims in CLAIMS.items() for claim in claims]


@pytest.mark.parametrize(("name", "claim"), STUDIES_AND_CLAIMS)
def test_what_a_study_states(name: str, claim: str) -> None:
    assert eval(claim, {"near": near, **stated(name)})


def module_of(folder: str, name: str) -> ModuleType:
    """A module of a study, which may import its neighbours."""
    sys.path[:0] = [str(STUDIES / "02_recovered_experiment"), str(STUDIES / folder)]
    return import_module(name)


def paper_estimate(campaign: Campaign) -> dict[str, float]:
    bound = lb.HybridModel.paper(0).bind(campaign)
    mean = bound.given(np.array([[1e-3]]))[1].mean
    centre = bound.least_squares_estimate / bound.scale
    np.testing.assert_allclose(mean[0] / bound.scale, centre, atol=1e-9)
    return dict(zip(bound.names, mean[0], strict=True))


def test_tables_5_to_8(recovered: Campaign) -> None:
    """All 78 printed numbers within 1.05 half-units of their last digit."""
    half_units: list[float] = []
    everything = paper_estimate(recovered)
    for name in ("table_5_global_compliances", "table_6_global_geometric_errors"):
        half_units += misses(printed(name).iloc[0], everything)
    for name in ("table_7_local_compliances", "table_8_local_geometric_errors"):
        for _, row in printed(name).iterrows():
            pair = [f"f{int(row[column]):03d}" for column in ("force_low_N", "force_high_N")]
            half_units += misses(row, paper_estimate(recovered.select(pair)))
    assert len(half_units) == 78
    assert max(half_units) <= 1.05


def test_the_script_makes_the_campaign_that_is_shipped(recovered: Campaign) -> None:
    """From the printed tables alone, whose printing error stands as printed."""
    campaign = module_of("02_recovered_experiment", "make_campaign").make_campaign()
    names = [test.name for test in recovered.tests]
    assert [test.name for test in campaign.tests] == names
    np.testing.assert_array_equal(campaign.forces_N, recovered.forces_N)
    np.testing.assert_array_equal(campaign.pressures_bar, recovered.pressures_bar)
    for ours, shipped in zip(campaign.tests, recovered.tests, strict=True):
        assert (len(shipped.angle_deg), shipped.direction) == (720, "CW")
        np.testing.assert_array_equal(ours.angle_deg, shipped.angle_deg)
        np.testing.assert_allclose(ours.reading_um, shipped.reading_um, atol=1e-8)
    table = printed("table_4_simulation").set_index("error")
    assert (table.loc["E_YY1", "estimated"], table.loc["E_YY1", "percent_difference"]) == (
        "-2.2195E-04",
        "0.8863",
    )


def test_one_circle_ignored() -> None:
    """The same as saying of every harmonic of that circle that it is known to a millimetre."""
    harmonics = module_of("04_constant_or_linear", "harmonics")
    grid = {"delta": np.array([7e-4]), "kappa": np.array([1e-4]), "tau": np.array([5e-3])}
    data = harmonics.printed_numbers()
    for circle in (0, 3):
        columns = slice(8 * circle, 8 * circle + 8)
        vague = harmonics.Model(data, grid=grid)
        vague.fixed[:] += data.jacobian[:, columns] @ data.jacobian[:, columns].T
        ignored = harmonics.Model(data.without(circle), grid=grid).log_bayes_factor()
        assert ignored == pytest.approx(vague.log_bayes_factor(), abs=0.01)
        assert ignored != pytest.approx(
            harmonics.Model(data, grid=grid).log_bayes_factor(), abs=0.5
        )


def test_a_broken_evidence_would_be_seen() -> None:
    """Probabilities that are too sure by a factor of 4 in log odds fail the test of calibration."""
    reliability = module_of("04_constant_or_linear", "simulated").reliability
    rng = np.random.default_rng(1)
    log_odds = rng.normal(0.0, 2.0, 400)
    outcome = (rng.random(400) < 1.0 / (1.0 + np.exp(-log_odds))).astype(float)
    honest, sure = (
        reliability(1.0 / (1.0 + np.exp(-factor * log_odds)), outcome) for factor in (1.0, 4.0)
    )
    assert abs(honest["spiegelhalter_z"]) < 3.0 < abs(sure["spiegelhalter_z"])


def test_a_seat_yields_to_the_whole_force_of_the_bar_at_every_angle() -> None:
    """Deflection over that of a linear spring: 1 + share ((F0/F)^⅓ − 1), at every angle alike."""
    sys.modules.pop("machines", None)
    machines = module_of("12_real_machines", "machines")
    mild = machines.draw_machine(machines.FAMILIES["mild"], np.random.default_rng(3))
    compliance = dict.fromkeys(mild.compliance, 0.0) | {"C_XXX": 5e-5, "C_YYY": 4e-5}
    linear = replace(mild, compliance=compliance, slope=dict.fromkeys(compliance, 0.0))
    seated = replace(linear, seat=(0.3, 0.5))
    angle = np.deg2rad(np.array([20.0, 60.0, 200.0]))
    for force in (36.0, 742.0):
        deflection = np.array(machines.deflection_mm(seated, force, force, angle))
        linear_deflection = np.array(machines.deflection_mm(linear, force, force, angle))
        softer = (machines.MIDDLE_N / force) ** (1.0 / 3.0) - 1.0
        expected = np.array([[1.0 + 0.3 * softer], [1.0 + 0.5 * softer]]) * np.ones(3)
        assert deflection / linear_deflection == pytest.approx(expected, rel=1e-3)
        secants = [seated.secant(name, force) for name in ("C_XXX", "C_YYY")]
        assert secants == pytest.approx(np.array([5e-5, 4e-5]) * expected[:, 0], rel=1e-12)


def test_sorted_and_shuffled_warm_ups_list_the_tests_as_they_ran() -> None:
    """The same machine and drift; forces rise, or come in an order of chance."""
    sys.modules.pop("machines", None)
    machines = module_of("12_real_machines", "machines")
    kinds = machines.NEW
    rising, machine = machines.simulate(kinds["warm-up, sorted"], 5)
    mixed, same_machine = machines.simulate(kinds["warm-up, shuffled"], 5)
    assert rising.forces_N.tolist() == sorted(mixed.forces_N.tolist())
    assert mixed.forces_N.tolist() != rising.forces_N.tolist()
    assert machine.truth == same_machine.truth
    for campaign in (rising, mixed):
        resting = replace(machines.FAMILIES["mild"], shuffled=campaign is mixed)
        still, _ = machines.simulate(resting, 5)
        pairs = zip(campaign.tests, still.tests, strict=True)
        drift_um = [np.mean(test.reading_um - other.reading_um) for test, other in pairs]
        steps = np.diff(drift_um)
        assert steps == pytest.approx(np.full(6, steps.mean()), abs=0.05)
        assert abs(drift_um[-1] - drift_um[0]) > 0.5


def test_machines_as_they_are_in_the_limits() -> None:
    """Rigid: the exact forward model; linear springs: Eq. 20, but for deflection over radius; a
    lobe: its order alone."""
    sys.modules.pop("machines", None)
    machines = module_of("12_real_machines", "machines")
    angle = np.deg2rad(np.arange(0.0, 360.0, 2.5))
    machine = machines.draw_machine(machines.FAMILIES["mild"], np.random.default_rng(3))
    for springs, errors in ((0.0, machine.geometry), (1e-3, {}), (1.0, {})):
        compliance = {name: springs * value for name, value in machine.compliance.items()}
        variant = replace(
            machine, compliance=compliance, slope=dict.fromkeys(compliance, 0.0), geometry=errors
        )
        trace = machines.trace_mm(variant, 742.0, angle)
        exact = exact_reading_mm(
            Machine(),
            Circle(),
            angle,
            force_N=742.0,
            compliances=compliance,
            geometric_errors=errors,
        )
        difference = np.abs(trace - exact).max()
        assert difference <= 1e-12 + 1e-4 * springs * np.abs(exact).max()
    lobed = machines.ball(np.random.default_rng(1), 2.0, 5.0, True)
    (order,) = np.flatnonzero(lobed) + 2
    assert 2 <= order <= 5
    assert np.abs(lobed).sum() == pytest.approx(2.5e-3, rel=1e-4)
    bent = replace(machine, geometry={}, contact=(0.3, 0.4), own_load=(0.1, -0.2))
    axes_rad = np.array([0.0, np.pi / 2])
    deflection_mm = machines.deflection_mm(bent, 742.0, 742.0, axes_rad)
    secants = [bent.secant(name, 742.0) for name in ("C_XXX", "C_YYY")]
    assert np.diag(deflection_mm) / 742.0 == pytest.approx(secants, rel=1e-3)
    drive = dict.fromkeys(("mismatch", "friction", "spikes"), np.zeros(2)) | {
        "lost": np.array([2e-3, 0.0])
    }
    forward, back = (
        np.fft.rfft(machines._drives(angle, sign, drive, np.random.default_rng(1)))[:13]
        for sign in (1.0, -1.0)
    )
    assert np.flatnonzero(np.abs(forward) > 1e-3).tolist() == [2, 4, 6, 8, 10, 12]
    np.testing.assert_allclose(forward, -back, atol=1e-12)


def test_pages_of_the_handbook_quote_the_studies() -> None:
    simulated = stated("08_other_campaigns")["simulated"]
    page = (ROOT / "docs" / "how-to" / "directions_radii_balls.md").read_text(encoding="utf-8")
    radii = ("one radius", "two radii")
    directions = ("five clockwise", "ten clockwise", "both directions")
    rows = (
        ("E_C0YX", 1e6, "µrad", radii),
        ("E_YX2", 1e9, "µm/m²", radii),
        ("C_XYX", 1e6, "nm/N", directions),
    )
    for name, factor, unit, kinds in rows:
        for kind in kinds:
            entry = simulated[kind]["shown"][name]
            assert f"{entry['u'] * factor:.3g} {unit}, {entry['coverage']:.3f}" in page, (
                name,
                kind,
            )
    one = stated("91_fleet")
    six = stated("05_next_campaign")["six"]["efficiency"]
    many = stated("11_many_campaigns")
    run = one["runs"]["process 2 1000"]
    pages = "".join(
        (ROOT / "docs" / "how-to" / name).read_text("utf-8")
        for name in ("shop_floor.md", "next_tests.md")
    )
    assert (
        many["trend"]
        | {
            "latest_found": 3,
            "median_found": 1.0,
            "false_alarms": 0,
            "found_at_all": many["setting"]["series"],
        }
        == many["trend"]
    )
    for words in (
        f"fit {run['per_second']:.1f} campaigns",
        f"{one['scaling']['process']:.1f} times as many",
        f"in {round(run['worker_MB'], -1):.0f} MB",
        f"In {many['setting']['fleets']} simulated fleets",
        f"on all of {many['setting']['series']} machines",
        f"on {many['setting']['quiet']} that stayed",
        f"{100.0 * many['trend']['level_inside']['coverage']:.0f} % hold the compliance",
        f"is {six['recommended']:.2f} against {six['equal steps']:.2f}",
    ):
        assert words in pages, words


def test_pages_of_the_explanation_state_what_studies_found_and_the_model_assumes() -> None:
    assert {
        path.name: path.read_text(encoding="utf-8") == text
        for path, text in explanation.written().items()
    } == dict.fromkeys(
        [
            "confounding.md",
            "evidence.md",
            "model.md",
            "paper.md",
            "report.md",
            "validation.md",
            "verdicts.md",
        ],
        True,
    )


def test_the_lines_of_the_readme_and_the_table_of_priors() -> None:
    """They say what the studies found and what the default model assumes: their templates, filled
    with it."""
    text = (
        (ROOT / "README.md")
        .read_text(encoding="utf-8")
        .split("## The paper, re-examined")[1]
        .split("\n## ")[0]
    )
    assert "](studies/README.md)" in text
    results = {
        path.parent.name: stated(path.parent.name) for path in STUDIES.glob("[01]*/results.json")
    }
    assert text.endswith(f"\n\n{study.page(STUDIES, 'six_lines.md', results)}")
    terms = {type(term).__name__: term for term in lb.HybridModel.first().nuisances}
    priors = study.page(STUDIES, "priors.md", {"prior": lb.Prior.first(), **terms})
    assert f"\n\n{priors}\n" in (STUDIES / "README.md").read_text(encoding="utf-8")


def test_the_shortest_interval_of_an_exponential_begins_at_zero() -> None:
    shortfalls = module_of("12_real_machines", "shortfalls")
    draws = -np.log1p(-(np.arange(4000) + 0.5) / 4000)
    low, high = shortfalls.shortest_interval(draws)
    assert low == pytest.approx(0.0, abs=1e-3)
    assert high == pytest.approx(-np.log(0.05), rel=1e-2)


def test_intervals_of_equal_tails_miss_what_lies_in_a_tail() -> None:
    shortfalls = module_of("12_real_machines", "shortfalls")
    rows = pd.DataFrame(
        {"x/error": [0.0, 2.5, -2.5], "x/below": [0.5, 0.01, 0.99], "x/shortest": [1.0, 1.0, 0.0]}
    )
    stated_of_x = shortfalls.coverage_of(rows, ("x",))
    assert stated_of_x["equal_tails"] == pytest.approx(1.0 / 3.0)
    assert (stated_of_x["above"], stated_of_x["below"]) == (1, 1)
    assert stated_of_x["within_U"] == pytest.approx(1.0 / 3.0)
    assert stated_of_x["from_zero"] == stated_of_x["shortest"] == pytest.approx(2.0 / 3.0)


def test_perfect_drives_add_nothing_to_the_path() -> None:
    sys.modules.pop("machines", None)
    machines = module_of("12_real_machines", "machines")
    drives = module_of("13_stiffness", "drives")
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    added_mm = drives.added_by_drives_mm(machines.FAMILIES["mild"], 5, angle)
    assert np.abs(added_mm).max() == 0.0


def test_spikes_of_drives_add_to_the_path_what_looks_like_geometric_errors() -> None:
    sys.modules.pop("machines", None)
    machines = module_of("12_real_machines", "machines")
    drives = module_of("13_stiffness", "drives")
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    family = machines.STATED["drives, drift, well planned"]
    added_mm = drives.added_by_drives_mm(family, 5, angle)
    assert np.abs(added_mm).max() > 1e-5
