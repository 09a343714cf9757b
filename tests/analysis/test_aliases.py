"""The null space of a campaign's design: every statement holds in the exact forward model,
clockings end what they should."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import clocked, plan
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import (
    Degeneracy,
    StandingKind,
    degeneracies,
    standing_degeneracies,
)
from ldbb_bayes.analysis.cures import cures
from ldbb_bayes.inference.checks import in_order_of_force
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.machine.exact import geometric_reading_mm
from ldbb_bayes.machine.linear import wrench_jacobian
from ldbb_bayes.machine.parameters import wrench_names
from ldbb_bayes.report.wording import alias_sentences, cure_words, statement


def found(campaign: lb.Campaign, degree: int = 1) -> dict[str, set[str]]:
    every = degeneracies(lb.HybridModel.first(degree).bind(campaign))
    return {d.nuisances[0] if d.term else "": set(d.parameters) for d in every}


def two_radii() -> lb.Campaign:
    two = plan(work_deg=40.0, tool_deg=-65.0)
    return replace(
        two,
        tests=tuple(
            replace(t, radius_mm=r) for t, r in zip(two.tests, (150, 100, 150, 100), strict=True)
        ),
    )


def test_recovered_experiment(recovered: lb.Campaign) -> None:
    expected = {
        "form_cos2": {"E_XX1", "E_YY1"},
        "form_sin2": {"E_C0YX"},
        "form_cos3": {"E_XY2", "E_Xt0"},
        "form_sin3": {"E_YX2", "E_Yt0"},
        "bar_length": {"E_XX1", "E_YY1"},
        "mount": {"C_XXX", "C_YYY"},
        "force_gain": {"C_XXX", "C_YYY", "C_CXY", "C_CCY"},
    }
    assert found(recovered) == expected
    assert found(recovered, 0).keys() == expected.keys()


def test_exchange_rates(recovered: lb.Campaign) -> None:
    """cos 2θ of 1 µm at R = 150 mm is E_XX1 − E_YY1 = 2/150 = 13.3 µm/m; a length of 1 µm is 1/150
    on both."""
    every = {d.nuisances[0]: d for d in degeneracies(lb.HybridModel.first(1).bind(recovered))}
    form = every["form_cos2"].combination
    assert form["form_cos2"] == pytest.approx(1e-3)
    assert -form["E_XX1"] == pytest.approx(1e-3 / 150.0, rel=1e-9)
    assert form["E_YY1"] == pytest.approx(1e-3 / 150.0, rel=1e-9)
    assert (
        statement(every["form_cos2"])
        == "1.00 µm of 2-lobe form (cos 2θ) looks exactly like +6.67 µm/m of E_XX1 and −6.67 µm/m"
        " of E_YY1."
    )
    length = every["bar_length"].combination
    assert [-length["E_XX1"], -length["E_YY1"]] == pytest.approx([1e-3 / 150.0] * 2, rel=1e-6)
    assert -every["form_sin2"].combination["E_C0YX"] == pytest.approx(2e-3 / 150.0, rel=1e-9)
    assert statement(every["force_gain"]).startswith(
        "1.00 % of force gain looks exactly like +0.619 nm/N of C_XXX, +0.461 nm/N of C_YYY"
    )


def exact_change_um(campaign: lb.Campaign, degeneracy: Degeneracy, degree: int = 1) -> float:
    """The largest change of a reading by the combination: geometry exactly, the rest from the
    definition of each nuisance."""
    change = degeneracy.combination
    largest = 0.0
    bound = lb.HybridModel.first(degree).bind(campaign)
    estimate = bound.setting.compliance_estimate
    kept = [c.label for c in bound.compliances]
    forces = campaign.forces_N
    for test, pressure in zip(campaign.tests, campaign.pressures_bar, strict=True):
        angle = test.angles_rad()
        machine = campaign.machine()
        force = float(test.force_N or 0.0)
        labels = [name.label for name in wrench_names(machine)]
        wrench = wrench_jacobian(machine, test.circle, angle)
        total = geometric_reading_mm(
            machine, test.circle, angle, {n: v for n, v in change.items() if n.startswith("E_")}
        )
        for name, value in change.items():
            form = re.fullmatch(r"(work_|tool_)?form_(cos|sin)(\d+)", name)
            if name.startswith("C_"):
                stem, _, degree = name.partition("_1")
                lever = force - 0.5 * (forces.min() + forces.max()) if name.endswith("_1") else 1.0
                assert degree == ""
                total = total + value * force * lever * wrench[:, labels.index(stem)]
            elif form:
                psi = {
                    "work_": test.work_ball_deg,
                    "tool_": test.tool_ball_deg - 180.0,
                    None: test.work_ball_deg,
                }[form[1]]
                phase = int(form[3]) * (angle - np.deg2rad(psi))
                total = total + value * (np.cos(phase) if form[2] == "cos" else np.sin(phase))
            elif name.startswith("bar_length"):
                total = total + value * (
                    1.0
                    if name == "bar_length" or float(name.split("_")[-1]) == test.radius_mm
                    else 0.0
                )
            elif name == "mount":
                total = total + value * pressure
            elif name == "force_gain":
                total = total + value * force * (
                    wrench[:, [labels.index(c) for c in kept]] @ estimate
                )
        largest = max(largest, float(np.abs(total).max()))
    return largest * 1e3


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize(
    "which", ["recovered", "two balls", "one ball", "two radii", "arcs", "one force"]
)
def test_every_statement_holds_in_the_exact_model(
    recovered: lb.Campaign, which: str, degree: int
) -> None:
    """No reading moves by more than the linearisation error of changes this small and a tenth of
    the resolution."""
    campaign = {
        "recovered": recovered,
        "two balls": clocked(((0.0, 0.0), (180.0, 180.0))),
        "one ball": clocked(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0))),
        "two radii": two_radii(),
        "arcs": plan((30, 40, 50, 30), arc_deg=230.0),
        "one force": plan((40,), forces_N=(300.0,)),
    }[which]
    if which == "one force" and degree:
        return
    every = degeneracies(lb.HybridModel.first(degree).bind(campaign))
    assert every
    for degeneracy in every:
        change = exact_change_um(campaign, degeneracy, degree)
        assert (
            change
            < 0.05
            * exact_change_um(
                campaign, replace(degeneracy, combination=lead_of(degeneracy)), degree
            )
            + 1e-6
        )
        assert change / max(degeneracy.prior_sds, 1.0) < 0.1 * campaign.resolution_um, statement(
            degeneracy
        )
        assert change == pytest.approx(degeneracy.change_um, rel=0.03, abs=2e-3)


@pytest.mark.parametrize("order", [2, 3, 4, 11])
def test_clocking_ends_what_it_should(order: int) -> None:
    """Order n of a ball is separated by ψ unless nψ is a multiple of 360°; here of a form that is
    alone in its order."""

    def left(turns: tuple[tuple[float, float], ...]) -> set[str]:
        """Nuisances of this order that some parameter imitates."""
        every = degeneracies(lb.HybridModel.first(0).bind(clocked(turns)))
        return {n for d in every for n in d.nuisances if n.endswith((f"cos{order}", f"sin{order}"))}

    assert bool(left(((0.0, 0.0),))) is (order < 4)
    assert not left(((0.0, 0.0), (45.0, 45.0), (90.0, 90.0)))
    both = left(((0.0, 0.0), (180.0, 180.0)))
    assert bool(both) is (order == 2)
    one = left(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0)))
    assert one == ({f"tool_form_cos{order}", f"tool_form_sin{order}"} if order < 4 else set())
    other = left(((0.0, 0.0), (0.0, 45.0), (0.0, 90.0)))
    assert other == ({f"work_form_cos{order}", f"work_form_sin{order}"} if order < 4 else set())


def test_a_second_radius_brings_a_second_length() -> None:
    """Form is told apart, lengths only from each other: in proportion to the radii they are a
    scale."""
    every = degeneracies(lb.HybridModel.first(1).bind(two_radii()))
    lengths = [d for d in every if d.term == "BarLength"]
    assert len(lengths) == 1
    change = lengths[0].combination
    assert change["bar_length_150"] / change["bar_length_100"] == pytest.approx(1.5, rel=1e-6)
    assert set(lengths[0].parameters) == {"E_XX1", "E_YY1"}


def test_cures_are_found_by_trying() -> None:
    def cure_of(campaign: lb.Campaign, degree: int) -> dict[str, str]:
        bound = lb.HybridModel.first(degree).bind(campaign)
        every = degeneracies(bound)
        names = [d.nuisances[0] if d.term else "+".join(d.parameters) for d in every]
        return dict(zip(names, map(cure_words, every, cures(bound, every)), strict=True))

    cure = cure_of(clocked(((0.0, 0.0),)), 1)
    assert (
        cure["form_cos2"]
        == "Clocking both balls (0/45/90°), a second radius or a calibration of the balls' form."
    )
    assert cure["bar_length"] == "A calibration of the bar's length."
    assert cure["mount"] == "A measurement of the mount's deflection."
    one = cure_of(clocked(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0))), 1)
    assert one["tool_form_cos2"].startswith("Clocking the tool ball (0/45/90°)")
    lonely = cure_of(plan((40,), forces_N=(300.0,)), 0)
    assert lonely["form_cos4"].startswith("Other force levels")
    assert "force levels" not in lonely["form_cos2"]
    assert (
        "Other force levels" in cure_of(plan((40, 40), forces_N=(390.0, 390.1)), 0)["C_XXX+E_XX1"]
    )


def test_what_the_model_leaves_out_is_said_too(recovered: lb.Campaign) -> None:
    every = degeneracies(lb.HybridModel.paper(0).bind(recovered))
    assert not any(d.modelled for d in every)
    assert "the model leaves it out, and the intervals do not cover it" in statement(every[0])
    (alone,) = alias_sentences(every)
    assert re.search(r"mount with .*The model leaves these out: no interval covers them", alone)


@pytest.mark.parametrize("readings", [9, 24])
def test_what_no_reading_sees_has_no_partner(readings: int) -> None:
    """sin 12θ is zero at 24 uniform angles: that is not a likeness with compliances that are zero
    as well."""
    campaign = plan((readings,) * 4)
    for degeneracy in degeneracies(lb.HybridModel.first(1).bind(campaign)):
        largest = max(abs(change) for change in degeneracy.combination.values())
        assert largest < 1.0
        assert (
            exact_change_um(campaign, replace(degeneracy, combination=lead_of(degeneracy))) > 0.024
        )
    bare = degeneracies(lb.HybridModel.first(1).without("ball-form").bind(plan((24,) * 4)))
    assert {name for d in bare if d.term == "BallForm" for name in d.parameters}.isdisjoint(
        {"C_XXX", "C_YYY", "C_CCY"}
    )


def lead_of(degeneracy: Degeneracy) -> dict[str, float]:
    """The first coefficient alone, at the length of one prior sd along the whole."""
    name = next(iter(degeneracy.combination))
    return {name: degeneracy.combination[name]}


@pytest.mark.parametrize("readings", [3585, 3600])
def test_several_turns_of_the_same_angles(readings: int) -> None:
    angle = np.arange(readings) * 3.0
    campaign = lb.Campaign(tuple(lb.CircularTest(f, angle) for f in (36.0, 390.0, 742.0)))
    assert len(degeneracies(lb.HybridModel.first(1).without("ball-form").bind(campaign))) == 7


def test_both_directions_at_the_same_forces_show_friction() -> None:
    angle = np.arange(40) * 9.0

    def notes(pairs: tuple[tuple[float, str], ...]) -> bool:
        bound = lb.HybridModel.first(0).bind(
            lb.Campaign(tuple(lb.CircularTest(f, angle, direction=d) for f, d in pairs))
        )
        return any(
            own.kind == StandingKind.FRICTION
            for own in standing_degeneracies(bound, degeneracies(bound))
        )

    assert notes(((36.0, "CW"), (742.0, "CW")))
    assert notes(((36.0, "CW"), (742.0, "CCW")))
    assert not notes(((36.0, "CW"), (36.0, "CCW"), (742.0, "CW"), (742.0, "CCW")))


def test_a_drift_in_the_order_of_force_looks_like_compliance(recovered: lb.Campaign) -> None:
    """F, F cos θ and F sin θ are sums of columns that these compliances and `Position` have."""
    bound = lb.HybridModel.default(1).bind(recovered)
    (drift,) = (
        own.parameters for own in standing_degeneracies(bound, ()) if own.kind == StandingKind.DRIFT
    )
    parts = [
        part.values
        for part in shared_terms(bound.nuisance_columns)
        if part.names[0].startswith("position_")
    ]
    own = np.concatenate(
        [bound.interest[:, :, [bound.names.index(name) for name in drift]], *parts], axis=2
    ).reshape(-1, 8)
    like = np.einsum("t,jk->tkj", recovered.forces_N, np.eye(25)[:3]).reshape(-1, 3)
    np.testing.assert_allclose(
        own @ np.linalg.lstsq(own, like, rcond=1e-12)[0], like, atol=1e-9 * like.max()
    )
    assert "Drift" in lb.identify(bound.model, recovered).parameters["C_CXY"].partners


def test_orders_of_force() -> None:
    """Where Spearman's rank correlation is significant: one in twenty that chance gives. Times go
    before the list."""
    rng = np.random.default_rng(1)
    for order in [np.arange(7), np.arange(7)[::-1], *(rng.permutation(7) for _ in range(30))]:
        run = [
            lb.CircularTest(50.0 + k**2, np.arange(30) * 12.0, np.ones(30), time_s=60.0 * j)
            for j, k in enumerate(order)
        ]
        for tests in (
            [replace(test, time_s=None) for test in run],
            sorted(run, key=lambda test: test.force_N),
        ):
            found = in_order_of_force(lb.HybridModel.paper(0).bind(lb.Campaign(tuple(tests))))
            assert found == (stats.spearmanr(order, np.arange(7)).pvalue < 0.05)


def test_another_machine_and_plane() -> None:
    """Found numerically, not written out: a machine of the other order in another plane."""
    campaign = lb.Campaign(
        tuple(lb.CircularTest(f, np.arange(40) * 9.0) for f in (100.0, 400.0)),
        topology="wXFYZt",
        plane="YZ",
    )
    names = found(campaign, 0)
    assert names["bar_length"] == {"E_YY1", "E_ZZ1"}
    assert names["form_cos2"] == {"E_YY1", "E_ZZ1"}
    assert names["mount"] >= {"C_YYY", "C_ZZZ"}
