"""A term that a user writes in a script goes through everything without a change of the package."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import TRUTH, plan, refuses
from reports import undrawn

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies
from ldbb_bayes.analysis.cures import cures
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.specification import model_from_toml, model_to_toml
from ldbb_bayes.report.wording import cure_words, remedy_words


@dataclass(frozen=True)
class PitchError(lb.Term):
    """cos 5θ, sin 5θ in proportion to the radius, the same in all tests: pitch of the screws, with
    a scale of its own."""

    scale_um: float = 4.0
    calibration = "a laser measurement of the screws"
    remedy = "Measure the screws' pitch with a laser."

    @property
    def scales(self) -> tuple[lb.Scale, ...]:
        return (lb.Scale("pitch", self.scale_um, "π", "pitch error"),)

    def columns(self, setting: Setting) -> tuple[lb.Columns, ...]:
        values = setting.harmonics([5]) * (setting.radius_mm / 150.0)[:, None, None]
        return (lb.Columns(("pitch_error_cos5", "pitch_error_sin5"), values, np.ones(2), "pitch"),)


@dataclass(frozen=True)
class KnownLobe(lb.Term):
    """cos 5θ of 3 µm, known to ``sd_um``."""

    sd_um: float = 1e-4

    def columns(self, setting: Setting) -> tuple[lb.Columns, ...]:
        sd = np.array([self.sd_um * 1e-3])
        mean = np.array([3e-3])
        return (lb.Columns(("known_lobe",), setting.harmonics([5])[:, :, :1], sd, mean=mean),)


MODEL = lb.HybridModel.first(0).without("ball-form").with_term(PitchError())


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    """With a pitch error ten times as large as what circles differ by at that order."""
    return MODEL.simulate(
        plan(),
        seed=3,
        parameters=TRUTH,
        hyper_um={"sigma": 0.1, "delta": 0.5, "kappa": 0.3, "pitch": 3.0},
    ).campaign


@pytest.fixture(scope="module")
def posterior(campaign: lb.Campaign) -> Any:
    return lb.sample(MODEL, campaign, sampler="independent", seed=1)


def test_toml_both_ways() -> None:
    assert [scale.name for scale in MODEL.scales] == ["sigma", "delta", "kappa", "pitch"]
    assert [scale.name for scale in MODEL.without("pitch-error").scales] == [
        "sigma",
        "delta",
        "kappa",
    ]
    assert "PitchError" in str(MODEL)
    text = model_to_toml(MODEL.with_term(PitchError(2.5)))
    assert "[terms.PitchError]\nscale_um = 2.5" in text
    assert model_from_toml(text).nuisances == MODEL.with_term(PitchError(2.5)).nuisances
    refuses(
        "PitchError scale_um must be a positive number, got -1",
        model_from_toml,
        text.replace("2.5", "-1.0"),
    )
    refuses("PitchError key must be one of", model_from_toml, text.replace("scale_um", "size_um"))


def test_fit_finds_it(posterior: Any, campaign: lb.Campaign) -> None:
    """The amplitude that the plain mean of the circles' fifth order has; the scale learnt with
    it."""
    found = lb.nuisances(posterior).loc[["pitch_error_cos5", "pitch_error_sin5"]]
    assert set(found["term"]) == {"PitchError"}
    angle = campaign.tests[0].angles_rad()
    readings = np.mean([test.readings_mm() for test in campaign.tests], axis=0)
    expected = [2.0 * np.mean(readings * wave(5.0 * angle)) for wave in (np.cos, np.sin)]
    assert np.abs(found["mean"] / found["sd"]).max() > 5.0
    np.testing.assert_allclose(found["mean"], expected, atol=2e-4)
    assert (
        lb.summarize(posterior).loc["pitch", "mean"] > lb.summarize(posterior).loc["kappa", "mean"]
    )


def test_identify_budgets_design_and_report_know_it(
    campaign: lb.Campaign, posterior: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = lb.identify(MODEL, campaign)
    assert "PitchError" in found.parameters["C_XXX"].confounding
    budgets = lb.budgets(posterior)
    shares = {name: budget.share("PitchError") for name, budget in budgets.items()}
    assert all(-1e-9 <= share < 0.1 for share in shares.values())
    assert (
        remedy_words(replace(budgets["C_XXX"], heaviest="PitchError"))
        == "Measure the screws' pitch with a laser."
    )
    designed = lb.design(MODEL, campaign, tests=3, forces_N=(36.0, 400.0, 742.0))
    assert len(designed.tests) == 3
    undrawn(monkeypatch)
    lb.write_report(
        posterior, tmp_path / "report", comparison="left out here", recommended="left out here"
    )
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "pitch error (cos 5θ)" in page


def test_an_alias_of_it_is_stated_with_its_cure() -> None:
    """In proportion to the radius at order 2 it is a geometric error at one radius."""
    bound = MODEL.without("pitch-error").with_term(SecondOrder()).bind(plan())
    found = [degeneracy for degeneracy in degeneracies(bound) if degeneracy.term == "SecondOrder"]
    assert {name for degeneracy in found for name in degeneracy.parameters} == {
        "E_XX1",
        "E_YY1",
        "E_C0YX",
    }
    assert all(
        "easurement of it" in cure_words(own, cure)
        for own, cure in zip(found, cures(bound, found), strict=True)
    )


@dataclass(frozen=True)
class SecondOrder(lb.Term):
    """cos 2θ, sin 2θ: geometry in another name."""

    sd_um: float = 2.0

    def columns(self, setting: Setting) -> tuple[lb.Columns, ...]:
        return (
            lb.Columns(
                ("second_order_cos2", "second_order_sin2"),
                setting.harmonics([2]),
                np.full(2, self.sd_um * 1e-3),
            ),
        )


def test_what_is_no_term_is_refused() -> None:
    class Loose(lb.Term):
        pass

    refuses(
        r"nuisances must be terms, got Loose\. Derive its class from Term",
        lb.HybridModel.first().with_term,
        Loose(),
    )
    with pytest.raises(InputError, match="a term must have a name of its own, got BallForm"):
        dataclasses.make_dataclass(
            "BallForm", [], bases=(lb.Term,), namespace={"__module__": __name__}
        )
    with pytest.raises(
        InputError, match=r"columns of a, b must have values of shape \(tests, 25, 2\)"
    ):
        lb.Columns(("a", "b"), np.zeros((4, 25, 1)), np.ones(2))
    lb.Term.kinds.pop("Loose")
    one = lb.Columns(("a", "b"), np.zeros((4, 25, 2)), 2e-3, mean=1)
    np.testing.assert_array_equal([one.sd, one.mean], [[2e-3, 2e-3], [1.0, 1.0]])
    with pytest.raises(
        InputError,
        match=r"term must be one of BallForm.*'Squeak'.* commands do not have it; define or import",
    ):
        model_from_toml("schema = 1\n[terms.Squeak]\nsd_um = 1.0\n")


@pytest.mark.slow
def test_simulation_based_calibration_passes() -> None:
    found = lb.validate(MODEL, plan((24,) * 4), replicates=24, draws=49)
    assert found.calibrated
    assert "pitch" in json.dumps(found.as_dict())


def test_a_prior_mean_of_its_columns_counts(campaign: lb.Campaign) -> None:
    """In simulated readings, and in the likelihood: readings with 3 µm more of cos 5θ are as
    probable under it as without."""
    plain = lb.HybridModel.first(0)
    phi = np.array([[3e-4, 5e-4, 2e-4, 2e-3]])
    model = plain.with_term(KnownLobe())
    more = tuple(
        t.with_reading_um(np.asarray(t.reading_um) + 3.0 * np.cos(5.0 * t.angles_rad()))
        for t in campaign.tests
    )
    value = model.bind(replace(campaign, tests=more)).log_evidence(phi)
    np.testing.assert_allclose(value, plain.bind(campaign).log_evidence(phi), atol=1e-5)
    silent = dict.fromkeys(("sigma", "delta", "kappa", "tau"), 0.0)
    quiet = (
        model.without("bar-length", "mount", "force-error")
        .simulate(plan(), seed=1, parameters={}, hyper_um=silent)
        .campaign
    )
    for test in quiet.tests:
        np.testing.assert_allclose(
            test.reading_um, 3.0 * np.cos(5.0 * test.angles_rad()), atol=1e-3
        )
