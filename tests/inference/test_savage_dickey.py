"""Nested Bayes factors by two routes, and models with parameters fixed at zero."""

from __future__ import annotations

import pytest
from campaigns import HYPER_UM, TRUTH, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import evidence_of, evidence_on
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.savage_dickey import savage_dickey

SLOPES = tuple(f"{name}_1" for name in ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"))
CAMPAIGNS = {
    "uniform": simulated(plan(), seed=1),
    "arcs, clocked": simulated(plan((30, 26, 40, 12), arc_deg=250.0, work_deg=35.0), seed=2),
    "three forces": simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=3),
}


@pytest.mark.parametrize("truncated", [True, False])
@pytest.mark.parametrize("name", CAMPAIGNS)
@pytest.mark.parametrize("fixed", [SLOPES, ("C_XYX_1",), ("C_CCY_1", "C_XXX_1"), ("E_C0YX",), ("C_CCY", "C_CCY_1")], ids="+".join)
def test_equals_the_difference_of_evidences(name: str, fixed: tuple[str, ...], truncated: bool) -> None:
    model = lb.HybridModel.default(1) if truncated else lb.HybridModel.default(1).without("truncation")
    bound = model.bind(CAMPAIGNS[name])
    posterior = HyperPosterior(bound, truncated=truncated)
    lattice = posterior.lattice(1e-2)
    value, error = savage_dickey(posterior, evidence_on(posterior, lattice), fixed)
    smaller = lb.log_evidence(model.fixing(*fixed), CAMPAIGNS[name], tolerance=1e-2)
    direct, direct_error = lb.log_bayes_factor(smaller, evidence_on(posterior, lattice))
    assert value == pytest.approx(direct, abs=0.05)
    assert abs(value - direct) < 3.0 * (error + direct_error) + 1e-4


def test_where_the_slopes_are_beyond_doubt() -> None:
    """The two models put the hyper-parameters in different places; the ratio is integrated where it is large."""
    truth = TRUTH | {"C_YYY_1": 4e-8, "C_XXX_1": -3e-8}
    campaign = lb.HybridModel.default(1).simulate(plan(), seed=3, parameters=truth, hyper_um=HYPER_UM).campaign
    posterior = HyperPosterior(lb.HybridModel.default(1).bind(campaign), truncated=True)
    value, error = savage_dickey(posterior, evidence_of(posterior, tolerance=1e-2), SLOPES)
    constant, linear = (lb.log_evidence(lb.HybridModel.default(degree), campaign, tolerance=1e-2) for degree in (0, 1))
    direct, _ = lb.log_bayes_factor(constant, linear)
    assert direct < -20.0
    assert value == pytest.approx(direct, abs=0.05)
    assert error < 0.05


def test_recovered_experiment(recovered: lb.Campaign) -> None:
    posterior = HyperPosterior(lb.HybridModel.default(1).bind(recovered), truncated=True)
    value, _ = savage_dickey(posterior, evidence_of(posterior, tolerance=1e-2), SLOPES)
    evidences = [lb.log_evidence(lb.HybridModel.default(degree), recovered, tolerance=1e-2) for degree in (0, 1)]
    assert value == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.05)


def test_fixing_all_slopes_is_the_constant_model() -> None:
    model = lb.HybridModel.default(1)
    fixed, constant = model.fixing(*SLOPES), model.with_degree(0)
    for campaign in CAMPAIGNS.values():
        values = [lb.log_evidence(m, campaign, tolerance=1e-2).log_value for m in (fixed, constant)]
        assert values[0] == pytest.approx(values[1], abs=1e-6)


def test_unknown_names_are_refused() -> None:
    posterior = HyperPosterior(lb.HybridModel.default(0).bind(CAMPAIGNS["uniform"]), truncated=False)
    with pytest.raises(InputError, match=r"parameter must be one of C_XXX, .* got 'C_XXX_1'"):
        savage_dickey(posterior, evidence_of(posterior, tolerance=1e-2), ["C_XXX_1"])


def test_different_readings_are_refused() -> None:
    model, names = lb.HybridModel.default(0), ("uniform", "three forces")
    one, other = (lb.log_evidence(model, CAMPAIGNS[name], tolerance=1e-2) for name in names)
    with pytest.raises(InputError, match="must be between models of the same readings, got two campaigns"):
        lb.log_bayes_factor(one, other)
    bound = lb.HybridModel.default(0).bind(CAMPAIGNS["uniform"]).keeping(["f036", "f300", "f520"])
    posterior = HyperPosterior(bound, truncated=True)
    with pytest.raises(InputError, match="same readings"):
        lb.log_bayes_factor(one, evidence_on(posterior, posterior.lattice(1e-2)))
