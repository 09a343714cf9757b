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
from ldbb_bayes.inference.coefficients import private_terms
from ldbb_bayes.model.bound_information import _Noise, _noise_covariances
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.specification import model_from_toml, model_to_toml
from ldbb_bayes.report.wording import cure_words, remedy_words
from ldbb_bayes.report.wording.effect_names import nuisance_words, unit_words


@dataclass(frozen=True)
class PitchError(lb.terms.Term):
    """cos 5θ, sin 5θ in proportion to the radius, the same in all tests: pitch of the screws, with
    a scale of its own."""

    scale_um: float = 4.0
    calibration = "a laser measurement of the screws"
    remedy = "Measure the screws' pitch with a laser."

    @property
    def scales(self) -> tuple[lb.terms.Scale, ...]:
        return (lb.terms.Scale("pitch", self.scale_um, "π", "pitch error"),)

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        values = setting.harmonics([5]) * (setting.radius_mm / 150.0)[:, None, None]
        return (
            lb.terms.Columns(("pitch_error_cos5", "pitch_error_sin5"), values, np.ones(2), "pitch"),
        )


@dataclass(frozen=True)
class KnownLobe(lb.terms.Term):
    """cos 5θ of 3 µm, known to ``sd_um``."""

    sd_um: float = 1e-4

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        sd = np.array([self.sd_um * 1e-3])
        mean = np.array([3e-3])
        return (lb.terms.Columns(("known_lobe",), setting.harmonics([5])[:, :, :1], sd, mean=mean),)


@dataclass(frozen=True)
class Ripple(lb.terms.Term):
    """cos 7θ, sin 7θ, anew in every circle, in proportion to the circle's noise factor."""

    sd_um: float = 2.0

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        names = ("ripple_cos7", "ripple_sin7")
        values = setting.harmonics([7])
        sd = self.sd_um * 1e-3
        return (lb.terms.Columns(names, values, sd, private=True, circle=setting.circle),)


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
    other = text.replace("PitchError", "LeadError")
    refuses("got 'LeadError'. A term of your own: commands do not have it", model_from_toml, other)
    refuses("PitchError key must be one of", model_from_toml, text.replace("scale_um", "size_um"))


def test_fit_finds_it(posterior: Any, campaign: lb.Campaign) -> None:
    """The amplitude that the plain mean of the circles' fifth order has; the scale learnt with
    it."""
    table = lb.inference.summarize_nuisances(posterior).loc[
        ["pitch_error_cos5", "pitch_error_sin5"]
    ]
    assert set(table["term"]) == {"PitchError"}
    phase = 5.0 * campaign.tests[0].angles_rad()
    readings = np.mean([test.readings_mm() for test in campaign.tests], axis=0)
    cosine = 2.0 * np.mean(readings * np.cos(phase))
    sine = 2.0 * np.mean(readings * np.sin(phase))
    assert np.abs(table["mean"] / table["sd"]).max() > 5.0
    np.testing.assert_allclose(table["mean"], [cosine, sine], atol=2e-4)
    means = lb.summarize(posterior)["mean"]
    assert means["pitch"] > means["kappa"]


def test_identify_knows_it(campaign: lb.Campaign) -> None:
    identified = lb.identify(MODEL, campaign)
    assert "PitchError" in identified.parameters["C_XXX"].confounding


def test_budgets_know_it(posterior: Any) -> None:
    budgets = lb.analysis.budget_uncertainty(posterior)
    for budget in budgets.values():
        assert -1e-9 <= budget.share("PitchError") < 0.1
    words = remedy_words(replace(budgets["C_XXX"], heaviest="PitchError"))
    assert words == "Measure the screws' pitch with a laser."


def test_design_knows_it(campaign: lb.Campaign) -> None:
    designed = lb.design(MODEL, campaign, tests=3, forces_N=(36.0, 400.0, 742.0))
    assert len(designed.tests) == 3


def test_the_report_knows_it(
    posterior: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    undrawn(monkeypatch)
    lb.write_report(
        posterior, tmp_path / "report", comparison="left out here", recommended="left out here"
    )
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "pitch error (cos 5θ)" in page


def test_an_alias_of_it_is_stated_with_its_cure() -> None:
    """In proportion to the radius at order 2 it is a geometric error at one radius."""
    bound = MODEL.without("pitch-error").with_term(SecondOrder()).bind(plan())
    aliases = [alias for alias in degeneracies(bound) if alias.term == "SecondOrder"]
    parameters: set[str] = set()
    for alias in aliases:
        parameters.update(alias.parameters)
    assert parameters == {"E_XX1", "E_YY1", "E_C0YX"}
    for alias, cures_of_it in zip(aliases, cures(bound, aliases), strict=True):
        assert "easurement of it" in cure_words(alias, cures_of_it)


@dataclass(frozen=True)
class SecondOrder(lb.terms.Term):
    """cos 2θ, sin 2θ: geometry in another name."""

    sd_um: float = 2.0

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        return (
            lb.terms.Columns(
                ("second_order_cos2", "second_order_sin2"),
                setting.harmonics([2]),
                np.full(2, self.sd_um * 1e-3),
            ),
        )


def test_a_term_that_is_no_dataclass_is_refused() -> None:
    class Loose(lb.terms.Term):
        pass

    message = r"nuisances must be terms, got Loose\. Derive its class from Term"
    refuses(message, lb.HybridModel.first().with_term, Loose())
    lb.terms.Term.kinds.pop("Loose")


def test_a_term_with_the_name_of_another_is_refused() -> None:
    module = {"__module__": __name__}
    with pytest.raises(InputError, match="a term must have a name of its own, got BallForm"):
        dataclasses.make_dataclass("BallForm", [], bases=(lb.terms.Term,), namespace=module)


def test_columns_of_another_shape_are_refused() -> None:
    message = r"columns of a, b must have values of shape \(tests, 25, 2\)"
    refuses(message, lb.terms.Columns, ("a", "b"), np.zeros((4, 25, 1)), np.ones(2))


def test_a_mean_of_private_columns_is_refused() -> None:
    message = "private columns of a must have the prior mean zero, got a mean"
    arguments = {"private": True, "mean": 1e-3}
    refuses(message, lb.terms.Columns, ("a",), np.zeros((4, 25, 1)), 1e-3, **arguments)


def test_noise_factors_of_columns_that_are_not_private_are_refused() -> None:
    message = "columns of a must be private to have noise factors of circles"
    circle = ["lambda_a"] * 4
    refuses(message, lb.terms.Columns, ("a",), np.zeros((4, 25, 1)), 1e-3, circle=circle)


def test_noise_factors_count_in_every_use_of_private_columns() -> None:
    """Private columns of all Fourier functions are the same as noise of these functions."""
    circle = ["lambda_a", "lambda_b"]
    phi = {"sigma": 1e-4, "ripple": 2e-3, "lambda_a": 0.5, "lambda_b": 3.0}
    values = np.broadcast_to(np.eye(25), (2, 25, 25))
    names = [f"ripple_{k}" for k in range(25)]
    columns = lb.terms.Columns(names, values, 1.0, "ripple", private=True, circle=circle)
    noise = lb.terms.BasisNoise("ripple", np.ones(25), circle)
    draws = columns.draw(phi, 2, np.random.default_rng(1))
    np.testing.assert_allclose(draws, noise.draw(phi, 2, np.random.default_rng(1)), rtol=1e-12)
    factor = np.diag(np.arange(1.0, 26.0))
    for test in range(2):
        covariances = _noise_covariances(
            factor, [_Noise("Columns", columns), _Noise("Noise", noise)], phi, test
        )
        np.testing.assert_allclose(covariances["Columns"], covariances["Noise"], rtol=1e-12)


def test_a_new_circle_has_private_coefficients_of_its_noise_factor() -> None:
    bound = lb.HybridModel.default(0).with_term(Ripple()).bind(plan())
    phi = np.full((1, len(bound.hyper_prior.names)), 1.0)
    names = bound.hyper_prior.names
    for r, test in enumerate(bound.test_names):
        phi[0, names.index(f"lambda_{test}")] = 1.0 + r
    for r in range(len(bound.test_names)):
        (sd,) = [term.sd for term in private_terms(bound, phi, r) if term.sd.shape == (1, 2)]
        np.testing.assert_allclose(sd, [[2e-3 * (1.0 + r)] * 2], rtol=1e-12)


def test_one_number_is_the_sd_and_mean_of_all_columns() -> None:
    columns = lb.terms.Columns(("a", "b"), np.zeros((4, 25, 2)), 2e-3, mean=1)
    np.testing.assert_array_equal(columns.sd, [2e-3, 2e-3])
    np.testing.assert_array_equal(columns.mean, [1.0, 1.0])


def test_sds_may_be_a_list_or_one_number_of_any_kind() -> None:
    values = np.zeros((4, 25, 2))
    for sd in ([2e-3, 2e-3], np.float32(2e-3), np.array(2e-3)):
        np.testing.assert_allclose(lb.terms.Columns(("a", "b"), values, sd).sd, [2e-3] * 2)
    np.testing.assert_array_equal(lb.terms.BasisNoise("ripple", 2).sd, np.full(25, 2.0))


@pytest.mark.parametrize(
    ("message", "names", "values", "sd", "mean"),
    [
        ("must be a list of different names, got 'ab'", "ab", np.zeros((4, 25, 2)), 1.0, None),
        ("must be a list of different names", ("a", "a"), np.zeros((4, 25, 2)), 1.0, None),
        ("must have a mean of shape", ("a",), np.zeros((4, 25, 1)), 1.0, [1.0, 2.0]),
        ("must be numbers, got some that are not", ("a",), np.full((4, 25, 1), np.nan), 1.0, None),
        ("must be numbers, got some that are not", ("a",), np.zeros((4, 25, 1)), np.nan, None),
    ],
)
def test_columns_that_would_end_in_a_traceback_later_are_refused(
    message: str, names: Any, values: Any, sd: Any, mean: Any
) -> None:
    refuses(message, lb.terms.Columns, names, values, sd, mean=mean)


@pytest.mark.parametrize("sd", [np.ones(3), -1.0])
def test_noise_with_other_sds_is_refused(sd: Any) -> None:
    refuses(r"noise must have an sd of shape \(25,\)", lb.terms.BasisNoise, "ripple", sd)


@dataclass(frozen=True)
class Slip(lb.terms.Term):
    """A term with a slip that its author may make."""

    kind: str = "scale"

    @property
    def scales(self) -> tuple[lb.terms.Scale, ...]:
        return (lb.terms.Scale("slip", -1.0),) if self.kind == "negative" else ()

    def columns(self, setting: Setting) -> Any:
        shape = setting.harmonics([0 if self.kind == "constant" else 5])[:, :, :1]
        block = lb.terms.Columns(("slip",), shape, 1e-3)
        columns_by_case = {
            "scale": (lb.terms.Columns(("slip",), shape, 1.0, "no_such"),),
            "noise": (lb.terms.BasisNoise("no_such", 1.0),),
            "comma": block,
            "tests": (lb.terms.Columns(("slip",), shape[:1], 1e-3),),
            "twice": (block, block),
        }
        return columns_by_case.get(self.kind, (block,))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("scale", "the sd of columns of Slip must be counted in a scale.* got 'no_such'"),
        ("noise", "the sd of columns of Slip must be counted in a scale.* got 'no_such'"),
        ("comma", "columns of Slip must return a tuple of Columns, got Columns.* put a comma"),
        ("tests", r"columns of Slip must have values of shape \(4, 25, 1\), got \(1, 25, 1\)"),
        ("twice", "coefficients of Slip must have different names, got slip twice"),
        ("constant", "orders of harmonics must be whole numbers from 1 to 12, got 0.*constant"),
        ("negative", "the prior of the scale 'slip' must be a positive number of µm, got -1"),
    ],
)
def test_a_slip_in_a_term_is_told(kind: str, message: str, campaign: lb.Campaign) -> None:
    def fit() -> object:
        return lb.HybridModel.default(0).with_term(Slip(kind)).bind(campaign)

    refuses(message, fit)


@pytest.mark.parametrize("order", [0, 13, 2.5])
def test_harmonics_are_of_the_orders_1_to_12(order: float, campaign: lb.Campaign) -> None:
    """Order 0 gave sin 12θ in the place of the constant."""
    setting = MODEL.bind(campaign).setting
    refuses("orders of harmonics must be whole numbers from 1 to 12", setting.harmonics, [order])


def test_an_unknown_term_of_a_file_is_refused() -> None:
    message = r"term must be one of BallForm.*'Squeak'.* commands do not have it; define or import"
    refuses(message, model_from_toml, "schema = 1\n[terms.Squeak]\nsd_um = 1.0\n")


@pytest.mark.slow
def test_simulation_based_calibration_passes() -> None:
    validation = lb.calibrate(MODEL, plan((24,) * 4), replicates=24, draws=49)
    assert validation.calibrated
    assert "pitch" in json.dumps(validation.as_dict())


def lobe_um(test: lb.CircularTest) -> np.ndarray:
    return 3.0 * np.cos(5.0 * test.angles_rad())


def test_a_prior_mean_of_its_columns_counts_in_the_likelihood(campaign: lb.Campaign) -> None:
    """Readings with 3 µm more of cos 5θ are as probable under it as without."""
    plain = lb.HybridModel.first(0)
    phi = np.array([[3e-4, 5e-4, 2e-4, 2e-3]])
    tests = []
    for test in campaign.tests:
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + lobe_um(test)))
    with_lobe = replace(campaign, tests=tuple(tests))
    value = plain.with_term(KnownLobe()).bind(with_lobe).log_evidence(phi)
    np.testing.assert_allclose(value, plain.bind(campaign).log_evidence(phi), atol=1e-5)


def test_a_prior_mean_of_its_columns_counts_in_simulated_readings() -> None:
    model = lb.HybridModel.first(0).with_term(KnownLobe())
    model = model.without("bar-length", "mount", "force-error")
    silent = dict.fromkeys(("sigma", "delta", "kappa", "tau"), 0.0)
    simulation = model.simulate(plan(), seed=1, parameters={}, hyper_um=silent)
    for test in simulation.campaign.tests:
        np.testing.assert_allclose(test.reading_um, lobe_um(test), atol=1e-3)


@dataclass(frozen=True)
class AngleEncoder(lb.terms.Term):
    """cos 2θ, sin 2θ in mm: its name begins with that of `Angle`, whose unit is rad."""

    sd_um: float = 4.0

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        names = ("angle_encoder_cos2", "angle_encoder_sin2")
        return (lb.terms.Columns(names, setting.harmonics([2]), self.sd_um * 1e-3),)


def test_a_coefficient_belongs_to_the_term_with_the_longest_stem() -> None:
    for name in ("angle_encoder_cos2", "angle_encoder_sin2"):
        assert lb.terms.Term.owner(name) is AngleEncoder
        assert unit_words(name) == (1e-3, "µm")
    assert nuisance_words("angle_encoder_cos2") == "angle encoder (cos 2θ)"
    assert lb.terms.Term.owner("angle_lag") is lb.terms.Angle
    assert lb.terms.Term.owner("mount_curvature") is lb.terms.Mount


@dataclass(frozen=True)
class Nameless(lb.terms.Term):
    """cos 5θ, under a name of another term."""

    name: str = "lobe"

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        return (lb.terms.Columns((self.name,), setting.harmonics([5])[:, :, :1], 1e-3),)


def test_a_name_of_another_term_is_refused() -> None:
    bound = lb.HybridModel.default(0).with_term(Nameless("mount_lobe")).bind(plan())
    refuses(
        "the coefficients of Nameless must have names that begin with its stem.*got 'mount_lobe',"
        " a name of Mount",
        lambda: bound.nuisance_columns,
    )
    assert lb.HybridModel.default(0).with_term(Nameless("lobe")).bind(plan()).nuisance_columns


@pytest.mark.parametrize("name", ["C_XXX", "C_XXX_1", "E_C0YX", "E_Xt0_2"])
def test_a_name_of_a_parameter_is_refused(name: str) -> None:
    """Results would hold two quantities of one name."""
    bound = lb.HybridModel.default(0).with_term(Nameless(name)).bind(plan())
    refuses(
        f"a coefficient of Nameless must not be named like a parameter, got '{name}'",
        lambda: bound.nuisance_columns,
    )


@dataclass(frozen=True)
class AxisRoll(lb.terms.Term):
    """cos 5θ, in rad for each mm, under a name that shows no unit."""

    unit = lb.terms.Unit("rad", 1e-6, "µrad")

    def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
        return (lb.terms.Columns(("roll",), setting.harmonics([5])[:, :, :1], 1e-5),)


def test_a_name_without_a_stem_is_refused_where_its_unit_would_be_wrong() -> None:
    """Results would state 10 µrad as 0.01 µm."""
    assert unit_words("roll") == (1e-3, "µm")
    bound = lb.HybridModel.default(0).with_term(AxisRoll()).bind(plan())
    refuses(
        r"the coefficients of AxisRoll must have names that begin with its stem \('axis_roll'\),"
        r" got 'roll'\. Rename",
        lambda: bound.nuisance_columns,
    )


@dataclass(frozen=True)
class StifferMount(lb.terms.Mount):
    """The mount of the package with half its prior sd."""

    relative_sd: float = 0.05


def test_a_derived_term_keeps_the_names_of_its_base() -> None:
    model = lb.HybridModel.default(0).without("mount").with_term(StifferMount())
    names = [name for c in model.bind(plan()).columns_of[StifferMount] for name in c.names]
    assert names
    assert {lb.terms.Term.owner(name) for name in names} == {lb.terms.Mount}
