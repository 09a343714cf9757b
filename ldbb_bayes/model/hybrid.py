"""The hybrid model: `HybridModel` for any campaign, `BoundModel` for one campaign.

The reading is ρ = Σ_k F (F − F0)^k j_C·C_k + j_G·E + nuisances + ε. F is the force and F0 the
reference force; C_0 are the compliances at F0, C_1 and C_2 their slopes (linear and quadratic
change with force), and E the geometric errors. j_C is the reading per unit force and compliance,
j_G the reading per unit geometric error. Nuisances are effects that are modelled but not of
interest; ε is white noise. The parameters β = (C_0 …, E) have a Gaussian prior. The nuisances are
Gaussian given the hyper-parameters φ, which are the scales of noise and nuisances.

The two classes refer to each other (`HybridModel.bind`, `BoundModel.model`) and are therefore in
one module.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, distinct_forces, require_campaign
from ldbb_bayes.errors import InputError, check_known, check_seed, require
from ldbb_bayes.machine.exact import geometric_reading_mm
from ldbb_bayes.machine.linear import kept_compliances
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName
from ldbb_bayes.model.campaign_setting import geometric_errors_of, setting_of
from ldbb_bayes.model.conditional import GivenHyperParameters, ParameterConditional
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hyper_parameters import acting_hyper_parameters, hyper_parameters_of
from ldbb_bayes.model.interest import (
    ParametersOfInterest,
    compliance_rows,
    interest_columns,
    physical_rows,
)
from ldbb_bayes.model.likelihood import StructuredGaussian
from ldbb_bayes.model.linearisation import (
    MachineEstimate,
    estimate_machine,
    fit_nearest,
    linearise,
    nominal_mount_offset,
    planned_compliances,
)
from ldbb_bayes.model.parameter_kinds import (
    EXAMPLES,
    check_possible,
    degree_of,
    parameter_to_inside,
)
from ldbb_bayes.model.parameter_prior import ParameterPrior
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.reduced_readings import reduced_readings
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.reference_posterior import ReferencePosterior, fixed_point
from ldbb_bayes.model.rivals import RIVALS
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.simulation import (
    Simulation,
    draw_nuisances,
    true_changes,
    true_hyper_parameters,
    true_parameters,
)
from ldbb_bayes.model.term_checks import check_coefficient_names, check_terms
from ldbb_bayes.model.terms import BasisNoise, CircleScale, Columns, Scale, Term
from ldbb_bayes.model.terms.editions import first_edition
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array, Result, Shown
from ldbb_bayes.units import display_unit, inside_name

__all__ = ["BoundModel", "HybridModel", "Preset", "require_model"]

Preset = Literal["default", "first", "paper"]
# If the model has the term ``CircleScale`` and the campaign has at least this number of circles,
# each circle has a separate factor λ, which multiplies its noise. Otherwise no circle has such a
# factor.
_FEWEST_SCALED_CIRCLES = 4
# Largest number of machines (sets of parameters) that are drawn at random from the prior, to find
# one without a negative compliance. With the default prior and three tested planes, about one in 60
# machines has no negative compliance.
_MOST_MACHINES = 20_000


def _default_terms() -> tuple[Term, ...]:
    """Return the nuisance terms of the default model.

    These are all terms except those that are only added on request (``on_demand``).
    """
    return tuple(kind() for kind in Term.kinds.values() if not kind.on_demand)


@dataclass(frozen=True)
class HybridModel(Result):
    """Model that can be applied to any campaign; it consists of nuisance terms and priors.

    A reading is ρ = Σ_k F (F − F0)^k j_C·C_k + j_G·E + nuisances + ε. F is the force, F0 the
    reference force, C_0 the compliances at F0, C_1 and C_2 their slopes (linear and quadratic
    change with force), E the geometric errors, and ε white noise. j_C is the reading per unit force
    and compliance, j_G the reading per unit geometric error. Nuisances are effects that are
    modelled but not of interest. Start from ``default``, from ``first`` (the model's first edition)
    or from ``paper`` (least squares as in the article on the model). To change a setting, call a
    method that returns a changed copy of the model, such as ``with_prior``.

    Raises
    ------
    InputError
        If a setting is out of its range, or settings contradict each other.

    Examples
    --------
    >>> lb.HybridModel.default(degree=0).bind(campaign).names
    ('C_XXX', 'C_XYX', 'C_YYY', 'C_CXY', 'C_CYY', 'C_CCY',
     'E_XX1', 'E_YX2', 'E_XY2', 'E_YY1', 'E_C0YX', 'E_Xt0', 'E_Yt0')
    >>> informed = model.with_prior(C_XXX=("60 nm/N", "5 nm/N")).without("hysteresis")
    >>> informed.prior.means["C_XXX"], "Hysteresis" in informed.terms
    (6e-05, False)
    """

    #: degree of the compliance as a polynomial in force: 0 constant, 1 linear, 2 quadratic
    degree: int = 1
    #: nuisance terms: effects on the readings that are modelled but not of interest, such as the
    #: form errors of the balls
    nuisances: Sequence[Term] = field(default_factory=_default_terms)
    #: prior of the parameters of interest and of the hyper-parameters
    prior: Prior = field(default_factory=Prior.default)
    #: reference force F0 [N], at which compliances are stated; by default the midpoint between the
    #: campaign's smallest and largest force. With F0 = 0 the model is Eq. 33 of the article on the
    #: model.
    reference_force_N: float | None = None
    #: name of the preset from which the model was made: default, first or paper
    preset: Preset = "default"
    #: names of the parameters of interest that are fixed at zero, such as C_XYX_1. A name that a
    #: campaign does not have is refused when the model is applied to the campaign.
    fixed: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check the model's settings; store names of parameters in the form that results use."""
        fixed = {inside_name(name) for name in self.fixed}
        object.__setattr__(self, "fixed", tuple(sorted(fixed)))
        object.__setattr__(self, "nuisances", tuple(self.nuisances))
        require(
            self.degree in (0, 1, 2),
            f"degree must be 0, 1 or 2, got {self.degree!r}."
            " Choose constant, linear or quadratic compliance.",
        )
        force = self.reference_force_N
        require(
            force is None or bool(np.isfinite(force)),
            f"reference_force_N must be finite, got {force}. Give a force in N or leave it out.",
        )
        for name in self.fixed:
            mean = self.prior.means.get(name, 0.0)
            require(
                not mean,
                f"{name} must be fixed at zero or have a prior mean, got both ({mean:g})."
                " Remove one of them.",
            )
        self._check_terms()

    def _check_terms(self) -> None:
        """Raise an `InputError` unless the model's nuisance terms are valid and fit together.

        Names of hyper-parameters must differ. A model with a flat prior must have no nuisance
        terms. For each term alone, see `check_terms`.
        """
        check_terms(self.nuisances)
        names = [scale.name for scale in dict.fromkeys(self.scales)]
        require(
            len(set(names)) == len(names),
            f"hyper-parameters must differ, got {', '.join(names)}."
            " Rename the scale of a term of your own.",
        )
        for scale in self.scales:
            is_number = isinstance(scale.prior_um, int | float)
            require(
                not is_number or 0.0 < float(scale.prior_um) < np.inf,
                f"the prior of the scale {scale.name!r} must be a positive number of µm, got"
                f" {scale.prior_um}. To drop the effect, leave its term out.",
            )
        require(
            not (self.prior.flat and self.nuisances),
            "a flat prior must stand without nuisances, got"
            f" {', '.join(type(term).__name__ for term in self.nuisances)}: what they share with"
            " the parameters would be undetermined. Use proper priors or remove the nuisances.",
        )

    @classmethod
    def default(cls, degree: int = 1) -> HybridModel:
        """Return the default model, with proper priors and without negative compliances.

        The model has all nuisances except those that are only added on request. Each compliance is
        a polynomial in force of the degree ``degree``: 0, 1 or 2.
        """
        return cls(degree)

    @classmethod
    def first(cls, degree: int = 1) -> HybridModel:
        """Return the model's first edition (preset ``first``), with fewer effects than the default.

        The prior sd of a form error of the balls with n waves around the circle is proportional to
        1/n, instead of a power of n that is estimated from the readings. Each compliance is a
        polynomial in force of the degree ``degree``: 0, 1 or 2.
        """
        return cls(degree, first_edition(), Prior.first(), preset="first")

    @classmethod
    def paper(cls, degree: int = 0) -> HybridModel:
        """Return the model whose point estimates are least-squares estimates (preset ``paper``).

        Eq. 31 in the article on the hybrid model gives these estimates. The model has flat priors
        and no nuisances, and its compliances may be negative. Each compliance is a polynomial in
        force of the degree ``degree``: 0, 1 or 2.
        """
        return cls(degree, (), Prior.paper(), preset="paper")

    @classmethod
    def from_preset(cls, preset: str, degree: int) -> HybridModel:
        """Return the model of the preset with the name ``preset``: default, first or paper.

        Each compliance of the model is a polynomial in force of the degree ``degree``: 0, 1 or 2.
        Raise an `InputError` if there is no preset of this name.
        """
        presets = {"default": cls.default, "first": cls.first, "paper": cls.paper}
        check_known("preset", [preset], presets)
        return presets[preset](degree)

    def with_degree(self, degree: int) -> HybridModel:
        """Return the same model with another degree of the compliance as a polynomial in force.

        The degree is 0, 1 or 2. If it is smaller than before, slopes of higher degrees no longer
        exist; priors that the user gave for these slopes are dropped, and the names of these slopes
        are removed from ``fixed``.
        """
        fixed = tuple(name for name in self.fixed if degree_of(name) <= degree)
        overrides = {
            name: sd for name, sd in self.prior.overrides.items() if degree_of(name) <= degree
        }
        prior = replace(self.prior, overrides=overrides)
        return replace(self, degree=degree, fixed=fixed, prior=prior)

    def with_slope_scale(self, scale: float) -> HybridModel:
        """Return the same model with another ``slope_scale``, a factor without unit.

        ``scale`` is the new factor. The default prior sds of all slopes are proportional to this
        factor. Prior sds that the user gave for slopes are multiplied by the ratio of the new
        factor to the old factor.
        """
        factor = scale / self.prior.slope_scale
        overrides = dict(self.prior.overrides)
        for name, sd in overrides.items():
            if degree_of(name):
                overrides[name] = sd * factor
        return replace(self, prior=replace(self.prior, slope_scale=scale, overrides=overrides))

    def fixing(self, *names: str) -> HybridModel:
        """Return the same model with the named parameters of interest fixed at zero.

        A name is, for example, C_XYX_1. The prior means of these parameters become zero too. Raise
        an `InputError` for a name that no parameter of any machine has; whether the machine has a
        parameter is checked when the model is applied to a campaign.
        """
        new_names = [inside_name(name) for name in names]
        check_possible("fixed parameter", new_names)
        fixed = {*self.fixed, *new_names}
        means = dict(self.prior.means)
        for name in means:
            if name in fixed:
                means[name] = 0.0
        return replace(self, fixed=tuple(fixed), prior=replace(self.prior, means=means))

    def with_prior(
        self, priors: Mapping[str, Any] | None = None, /, **further_priors: Any
    ) -> HybridModel:
        """Return the same model with other priors of parameters and hyper-parameters.

        For a parameter of interest, give the mean and the sd of its prior; if it was fixed at zero,
        it is free again. The mean of a slope must be 0. Each value is a string with a unit, or a
        number. Numbers for parameters of interest are in internal units (mm, N, rad); a number for
        a field of `Prior` is in the unit that the field's name states. Whether the machine has a
        parameter is checked when the model is applied to a campaign.

        Parameters
        ----------
        priors : mapping of str to object, optional
            The same as ``further_priors``, but as a mapping, so that names can be written as in the
            paper: ``{"E_C(0Y)X": (0, "20 µrad")}``.
        **further_priors : object
            Mean and sd of a parameter, such as ``C_XXX=("60 nm/N", "5 nm/N")``, or the value of a
            field of `Prior`, such as ``tau_um="2 µm"``.

        Returns
        -------
        HybridModel
            The model with these priors.

        Raises
        ------
        InputError
            If a name belongs neither to a parameter nor to a field of `Prior`, if the value for a
            parameter is not a pair of mean and sd, or if the unit of a value does not fit.

        Examples
        --------
        >>> calibrated = model.with_prior({"E_C(0Y)X": (0, "20 µrad")}, tau_um="0.5 µm")
        >>> calibrated.prior.overrides["E_C0YX"], calibrated.prior.tau_um
        (2e-05, 0.5)
        """
        new_priors = {
            inside_name(name): value for name, value in {**(priors or {}), **further_priors}.items()
        }
        settings = [f.name for f in fields(Prior) if f.name not in ("means", "overrides")]
        not_parameters = [name for name in new_priors if not name.startswith(("C_", "E_"))]
        check_known(
            "prior",
            not_parameters,
            [*settings, *EXAMPLES],
            " Parameters are named like C_XXX and E_XX1.",
        )
        parameters = [name for name in new_priors if name not in settings]
        check_possible("parameter with a prior", parameters)
        new_settings = {}
        means: dict[str, Any] = dict(self.prior.means)
        overrides: dict[str, Any] = dict(self.prior.overrides)
        for name, value in new_priors.items():
            if name in settings:
                new_settings[name] = value
                continue
            require(
                isinstance(value, tuple | list) and len(value) == 2,
                f"prior of {name} must be its mean and sd, got {value!r}. Write {name}=(mean, sd).",
            )
            overrides[name] = value[1]
            mean = parameter_to_inside(name, value[0], "prior mean of")
            if mean or not degree_of(name):
                means[name] = mean
        fixed = tuple(name for name in self.fixed if name not in new_priors)
        prior = replace(self.prior, **new_settings, means=means, overrides=overrides)
        return replace(self, fixed=fixed, prior=prior)

    def with_term(self, *terms: Term) -> HybridModel:
        """Return the same model with further nuisance terms.

        If the model already has a term of the same class, the new term replaces it. Raise an
        `InputError` for anything that is no term, such as the name or the class of one.

        Examples
        --------
        >>> "Drift" in model.with_term(lb.terms.Drift("temperature")).terms
        True
        """
        term_by_kind = {type(term): term for term in (*self.nuisances, *terms)}
        order = [*Term.kinds.values(), *term_by_kind]
        kinds = sorted(term_by_kind, key=order.index)
        return replace(self, nuisances=tuple(term_by_kind[kind] for kind in kinds))

    def without(self, *names: str) -> HybridModel:
        """Return the same model without the named effects.

        The effects are named as on the command line, such as ``ball-form``. The name ``truncation``
        removes the condition that compliances are not negative. Raise an `InputError` for any other
        name.
        """
        check_known("term", names, (*(kind.key() for kind in Term.kinds.values()), "truncation"))
        prior = replace(self.prior, truncated=False) if "truncation" in names else self.prior
        nuisances = tuple(term for term in self.nuisances if term.key() not in names)
        return replace(self, nuisances=nuisances, prior=prior)

    @property
    def rivals(self) -> tuple[str, ...]:
        """Names of effects in the model that resemble a change of compliance with force.

        These effects are alternative explanations of the slopes and are called rivals. The possible
        names are ``joint load``, ``curved mount`` (a deflection of the work ball's mount that is
        not proportional to force) and ``curved force law`` (a force that is not a linear function
        of pressure).
        """
        term_by_kind = {type(term): term for term in self.nuisances}
        names = []
        for name, rival in RIVALS.items():
            term = term_by_kind.get(rival.term)
            if term is not None and getattr(term, rival.setting, True):
                names.append(name)
        return tuple(names)

    def with_rivals(self, *names: str) -> HybridModel:
        """Return the same model without some effects that resemble a slope.

        The property `rivals` lists these effects of a model, such as ``joint load``. The result has
        only those that are in ``names``.
        """
        model = self
        for name in self.rivals:
            if name in names:
                continue
            rival = RIVALS[name]
            if rival.setting:
                term: Any = next(term for term in self.nuisances if type(term) is rival.term)
                model = model.with_term(replace(term, **{rival.setting: 0.0}))
            else:
                model = model.without(rival.term.key())
        return model

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters of the model: first the sd σ of white noise, then those of nuisances.

        Most of their hyper-parameters are sds of effects. Some are numbers without unit, such as
        the exponent with which form errors decrease with their order.
        """
        return hyper_parameters_of(self.nuisances)

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return the hyper-parameters that have an effect on the tests of a campaign.

        If the noise of each circle is multiplied by a factor λ, these factors are included.
        ``setting`` describes the test conditions.
        """
        return acting_hyper_parameters(self.nuisances, setting)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of all parts of the model: Compliance, GeometricErrors, then its nuisance terms.

        Nuisance terms have the names of their classes.
        """
        return ("Compliance", "GeometricErrors", *(type(term).__name__ for term in self.nuisances))

    def bind(self, campaign: Campaign) -> BoundModel:
        """Return a `BoundModel`: this model applied to one campaign or plan.

        The most recently bound models are kept in a cache, so that several analyses of one campaign
        use the same object. Raise an `InputError` if the campaign has too few different forces for
        the model's degree or for flat priors, or if the model names a parameter that the campaign
        does not have.
        """
        require_campaign(campaign)
        for known in _BOUND_MODELS:
            if known.campaign is campaign and known.model == self:
                return known
        bound = BoundModel(self, campaign)
        _BOUND_MODELS.append(bound)
        del _BOUND_MODELS[:-_KEPT_BOUND_MODELS]
        return bound

    def bind_to_simulate(self, plan: Campaign) -> BoundModel:
        """Return a `BoundModel` for a plan whose readings are to be simulated.

        A plan of one force, such as that of the next circle, takes the reference force, the range
        of forces and the estimated compliances from its pilot, the campaign to which it adds. Any
        other plan is bound by itself. An `InputError` is raised as by `bind`.
        """
        require_campaign(plan)
        if plan.pilot is None or plan.force_levels > 1 or self.degree == 0:
            return self.bind(plan)
        return BoundModel(self, plan, pilot=plan.pilot)

    def simulate(
        self,
        plan: Campaign,
        *,
        seed: int,
        parameters: Mapping[str, float | str] | None = None,
        hyper_um: Mapping[str, float | str] | None = None,
        effects: Mapping[str, float] | None = None,
        exact: bool = False,
    ) -> Simulation:
        """Simulate readings for a plan, or new readings for the tests of a campaign.

        Parameters
        ----------
        plan : Campaign
            Plan or campaign with the forces, angles and set-ups of the tests, and with the machine.
            A plan of one force takes the reference force and the range of forces from its pilot.
        seed : int
            Seed of the random numbers.
        parameters : mapping of str to float or str, optional
            True compliances, their changes with force, and geometric errors by name: numbers in
            internal units (mm, N, rad), or texts with a unit, such as "60 nm/N". Parameters that
            are not named are zero. By default, all parameters are drawn at random from the prior.
        hyper_um : mapping of str to float or str, optional
            True hyper-parameters by name, such as the standard deviation of the noise. Lengths are
            numbers in µm, or texts with a unit. Hyper-parameters that are not named are drawn at
            random from their priors.
        effects : mapping of str to float, optional
            True coefficients of effects that tests have in common by name, such as
            ``joint_load_X_seat``, in internal units. Coefficients that are not named are drawn at
            random from their priors.
        exact : bool, default False
            Whether geometric errors act through the exact forward model (Eq. 1-14 of the article on
            the model) instead of the linear forward model.

        Returns
        -------
        Simulation
            The simulated ``campaign`` and the true values from which it was simulated: parameters,
            hyper-parameters, the effects that tests have in common, and the compliances C(F) at the
            tested forces. Effects that each test has separately are not kept.

        Raises
        ------
        InputError
            If a name is unknown, a text has no unit of its quantity, an effect is no finite number,
            a hyper-parameter is outside its range, or parameters are so large that a reading
            exceeds 100 mm. If no ``parameters`` are given, the error is also raised for a flat
            prior, and for a prior under which nearly all random machines have a negative
            compliance.

        Examples
        --------
        >>> truth = {"C_XXX": 60e-6, "C_YYY": 40e-6}
        >>> simulation = model.simulate(campaign.plan(), seed=1, parameters=truth)
        >>> simulation.campaign.readings
        4320

        The change of a compliance over the tested forces, with what joints under load add to it:

        >>> simulation = model.simulate(campaign.plan(), seed=1)
        >>> simulation.change_with_force["C_YYY"].change == simulation.parameters["C_YYY_1"] * 706
        False
        """
        check_seed(seed)
        rng = np.random.default_rng(seed)
        bound = self.bind_to_simulate(plan)
        if parameters is None:
            beta = bound.draw_machine(rng)
        else:
            beta = true_parameters(parameters, bound.names, bound.interest_columns)
        phi = true_hyper_parameters(hyper_um or {}, bound.hyper_prior, rng)
        true_setting = bound.linearised_at(beta)
        without_nuisances = bound.interest_columns @ beta + bound.known_offset
        nuisances = draw_nuisances(
            self.nuisances, true_setting, phi, rng, without_nuisances, known=effects or {}
        )
        tests = []
        for test, coefficients_of_test in zip(plan.tests, nuisances.readings_mm, strict=True):
            noise = rng.normal(0.0, phi["sigma"], len(test.angle_deg))
            reading = basis(test.angles_rad()) @ coefficients_of_test + noise
            if exact:
                reading = reading + bound.linearisation_error_mm(test, beta)
            tests.append(test.with_reading_um(reading * 1e3))
        forces_N = np.append(np.unique(true_setting.force_N), true_setting.reference_force_N)
        at_forces = np.stack([bound.compliance_at(force) @ beta for force in forces_N])
        units = {parameter.name: parameter.unit for parameter in bound.parameters}
        return Simulation(
            replace(plan, tests=tuple(tests)),
            dict(zip(bound.names, beta.tolist(), strict=True)),
            bound.hyper_prior.display_values(np.array([*phi.values()])),
            units | nuisances.units,
            nuisances.effects,
            true_changes(bound.compliances, forces_N, at_forces, nuisances.effects, true_setting),
        )


class _KnownEstimate(NamedTuple):
    """Estimated parameters of a machine, and the model with which they were estimated."""

    model: HybridModel
    estimate: MachineEstimate


# Cache of estimated machine parameters. For each campaign, it holds one estimate for each model,
# the newest last. An estimate always uses all tests of the campaign, even if the model is applied
# to only some of the tests.
_ESTIMATES: WeakKeyDictionary[Campaign, list[_KnownEstimate]] = WeakKeyDictionary()
# Largest number of estimates of the machine's parameters, made with different models, that the
# cache holds for one campaign.
_KEPT_ESTIMATES = 64
# Cache of bound models: models that were applied to a whole campaign, the newest last. Several
# analyses can use the same bound model, because a model in the cache is never changed.
_BOUND_MODELS: list[BoundModel] = []
# Largest number of bound models that the cache holds. An average over models with constant and
# linear compliance uses sixteen bound models, and a fit of the same campaign may use further bound
# models.
_KEPT_BOUND_MODELS = 24


class BoundModel(Shown):
    """The model of one campaign: ρ = H β + nuisances + ε, with priors for this campaign.

    ρ are the readings, β the p parameters of interest, H the readings per unit of each parameter,
    and ε white noise.

    Parameters
    ----------
    model : model for any campaign.
    campaign : campaign or plan.
    keep_tests : names of the tests to use; by default all. Some properties always describe the
        whole campaign: the reference force F0, the force range, the region in which compliances are
        not negative, the estimate Ĉ of the compliances, and whether the form errors of the two
        balls are modelled as one sum or separately.
    pilot : only for a plan: the campaign from which F0, the force range and Ĉ are taken.
    coefficients_of_pilot : whether the coefficients of all effects are those of an analysis of the
        pilot, as for a prediction. The largest force and the reference of the travel, with which
        coefficients are scaled, are then those of the pilot, and otherwise those of the plan.

    Attributes
    ----------
    parameters, names, prior_sd, prior_mean : tuples, and ndarrays of shape (p,)
        Parameters of interest that are not fixed, and the names, prior sds and prior means of these
        parameters, in mm, N and rad. Compliances come first, then linear slopes, then quadratic
        slopes, then geometric errors. With a flat prior, every sd is infinite and every mean is
        zero.
    test_names, reduced, setting : tuple of str, tuple of Reduced, Setting
        Names, reduced readings and conditions of the tests that are used.
    interest_columns : ndarray, shape (tests, 25, p)
        H: reading per unit of each parameter of interest, as 25 Fourier coefficients.
    physical, truncation : Truncation
        ``physical`` is the region of parameters in which compliances C(F) are not negative; only
        compliances that are deflections in the direction of the load itself are restricted. If the
        prior is truncated to this region, ``truncation`` is the same region; otherwise
        ``truncation`` permits all values of the parameters.
    """

    shown = ("model", "campaign", "test_names", "names", "setting")

    def __init__(
        self,
        model: HybridModel,
        campaign: Campaign,
        *,
        keep_tests: Sequence[str] | None = None,
        pilot: Campaign | None = None,
        coefficients_of_pilot: bool = False,
    ) -> None:
        """Compute effects of parameters on the readings of the campaign, and their priors."""
        _check_force_levels(model, campaign if pilot is None else pilot)
        self.model = model
        self.campaign = campaign
        self.pilot = pilot
        self.coefficients_of_pilot = coefficients_of_pilot
        circles = dict.fromkeys(test.circle for test in campaign.scope)
        visible = kept_compliances(campaign.machine(), *circles)
        self._of_interest = ParametersOfInterest(
            model.degree, visible, geometric_errors_of(campaign)
        )
        reduced = reduced_readings(campaign)
        campaign_setting = self._setting_of_campaign(reduced)
        self.hyper_prior = model.prior.hyper(
            model.scales_in(campaign_setting), campaign.resolution_um
        )
        parameters = self._of_interest.with_prior(model.prior, campaign_setting)
        check_known("fixed parameter", model.fixed, [parameter.name for parameter in parameters])
        self._is_free = np.array([parameter.name not in model.fixed for parameter in parameters])
        self.parameters = tuple(
            parameter for parameter in parameters if parameter.name not in model.fixed
        )
        self.names = tuple(parameter.name for parameter in self.parameters)
        self.prior_sd = np.array([parameter.prior_sd for parameter in self.parameters])
        self.prior_mean = np.array([parameter.prior_mean for parameter in self.parameters])
        self.physical = Truncation(self._physical_rows(campaign_setting.reference_force_N))
        self.truncation = self.physical
        if not model.prior.truncated:
            self.truncation = Truncation(np.zeros((0, len(self.names))))
        rows = _indices_of_tests(campaign, keep_tests)
        self.setting: Setting = campaign_setting.select(rows)
        self.reduced = tuple(reduced[r] for r in rows)
        self.test_names = tuple(campaign.tests[r].name for r in rows)
        self.interest_columns = interest_columns(self.setting, model.degree)[:, :, self._is_free]

    def _setting_of_campaign(self, reduced: Sequence[Reduced]) -> Setting:
        """Return the test conditions, with the estimates about which the model is linearised.

        Test conditions are, for example, the forces and radii of all tests. The parameters are the
        compliances and geometric errors of the machine. Some effects on the readings depend
        nonlinearly on the parameters. The model replaces them by linear approximations near
        estimates of the parameters (module `linearisation`). If the campaign is a plan that was
        designed from another campaign (its pilot), the parameters are estimated from the pilot.
        Otherwise they are estimated from ``reduced``, the reduced readings of all tests (at most 25
        numbers for each test). The estimates are also stored in the attribute ``estimate``.
        """
        setting = self._with_noise_factors(
            setting_of(
                self.campaign,
                self.compliances,
                self.model.reference_force_N,
                pilot=self.pilot,
                coefficients_of_pilot=self.coefficients_of_pilot,
            )
        )
        if self.pilot is None:
            self.estimate = self._estimate_of_campaign(setting, reduced)
        else:
            self.estimate = self._estimate_of_pilot(self.pilot)
        return linearise(setting, self.compliances, self.estimate)

    def _with_noise_factors(self, setting: Setting) -> Setting:
        """Return ``setting`` with the names of the circles' noise factors λ added.

        ``setting`` describes the conditions of all tests. A noise factor λ is a hyper-parameter
        that multiplies the noise of one circle. Circles have noise factors only if two conditions
        are met: the model has the term `CircleScale`, and the campaign has at least four tests. A
        plan with fewer tests meets the second condition if the campaign from which it was designed
        (its pilot) has at least four tests.
        """
        count = len(self.campaign.tests)
        if self.pilot is not None:
            count = max(count, len(self.pilot.tests))
        scaled = any(isinstance(term, CircleScale) for term in self.model.nuisances)
        if scaled and count >= _FEWEST_SCALED_CIRCLES:
            names = np.array([f"lambda_{test.name}" for test in self.campaign.tests])
            setting = replace(setting, circle=names)
        return setting

    def _estimate_of_campaign(
        self, setting: Setting, reduced: Sequence[Reduced]
    ) -> MachineEstimate:
        """Return the compliances and geometric errors estimated from the readings of all tests.

        ``setting`` describes the conditions of all tests. ``reduced`` holds at most 25 numbers for
        each test, which replace its readings without loss of information. Models of the presets
        ``first`` and ``paper``, and models with flat priors, use the least-squares estimate. Other
        models use the posterior mean that is computed with the hyper-parameters fixed at their
        prior medians (module `reference_posterior`). For a plan, which has no readings, typical
        values are returned. The estimates are kept in a cache for every campaign and model.
        """
        model = self.model
        of_campaign = _ESTIMATES.setdefault(self.campaign, [])
        for known in of_campaign:
            if known.model == model:
                return known.estimate
        estimate = estimate_machine(self._of_interest, model.prior, setting, reduced)
        by_least_squares = model.preset != "default" or model.prior.flat
        if not (self.campaign.is_plan or by_least_squares):
            linearised = linearise(setting, self.compliances, estimate)
            hyper_prior = model.prior.hyper(
                model.scales_in(linearised), self.campaign.resolution_um
            )
            median = hyper_prior.quantile(np.full(len(hyper_prior.names), 0.5))
            posterior = ReferencePosterior(
                replace(self._of_interest, degree=min(1, model.degree)),
                model.prior,
                model.nuisances,
                model.fixed,
                dict(zip(hyper_prior.names, median.tolist(), strict=True)),
                reduced,
            )
            estimate = fixed_point(posterior, setting, estimate)
        of_campaign.append(_KnownEstimate(model, estimate))
        del of_campaign[:-_KEPT_ESTIMATES]
        return estimate

    def _estimate_of_pilot(self, pilot: Campaign) -> MachineEstimate:
        """Return the compliances and geometric errors estimated from a pilot campaign.

        The pilot is the campaign from which this plan was designed. The model of the plan may have
        parameters that the model of the pilot lacks. If such a parameter is a compliance, it gets
        the value that is assumed if there are no readings. If it is a geometric error, it gets the
        value zero.
        """
        bound = BoundModel(self.model, pilot)
        of_pilot = bound.estimate
        compliance_of = dict(zip(bound.compliances, of_pilot.compliances, strict=True))
        sd_of = dict(zip(bound.compliances, of_pilot.compliance_sd, strict=True))
        geometric_of = dict(zip(bound.geometric_errors, of_pilot.geometric_errors, strict=True))
        planned = planned_compliances(self.compliances, self.model.prior)
        compliances = [
            compliance_of.get(name, value)
            for name, value in zip(self.compliances, planned, strict=True)
        ]
        sd = [sd_of.get(name, 0.0) for name in self.compliances]
        geometric = [geometric_of.get(name, 0.0) for name in self.geometric_errors]
        return MachineEstimate(np.array(compliances), np.array(sd), np.array(geometric))

    def _physical_rows(self, reference_force_N: float) -> Array:
        """Return the matrix A of the conditions A β ≥ 0 on the parameters β, shape (rows, p).

        β are the p parameters of interest. A β holds the compliances C(F) that must not be
        negative, at tested forces F. The elements of A for slopes are powers of F − F0, where F0 is
        the reference force ``reference_force_N``. If compliances are constant in force, A has rows
        for only one tested force. If they are linear in force, A has rows for the smallest and the
        largest tested force. If they are quadratic, A has rows for all tested forces.
        """
        forces = distinct_forces(self.campaign.forces_N)
        if self.model.degree == 0:
            forces = forces[:1]
        elif self.model.degree == 1:
            forces = forces[[0, -1]]
        levers = [force - reference_force_N for force in forces]
        return physical_rows(self._of_interest, self.parameters, levers, reference_force_N)

    @property
    def untested_parameters(self) -> frozenset[str]:
        """Names of the free parameters on which no reading depends.

        They are parameters of planes in which circles are planned, but none has been run yet.
        """
        untested = []
        for k, name in enumerate(self.names):
            if not self.interest_columns[:, :, k].any():
                untested.append(name)
        return frozenset(untested)

    @property
    def compliances(self) -> tuple[ComplianceName, ...]:
        """Names of the model's compliances at the reference force, including those fixed at zero.

        The model has all compliances that the campaign's circles can separate.
        """
        return self._of_interest.compliances

    @property
    def geometric_errors(self) -> tuple[GeometricName, ...]:
        """Names of the geometric errors of the model, including geometric errors fixed at zero."""
        return self._of_interest.geometric_errors

    def keeping(self, names: Sequence[str]) -> BoundModel:
        """Return the same model with only the named tests of the campaign.

        ``names`` are the names of the tests to keep. Reference force, force range and other
        properties of the whole campaign do not change.
        """
        return BoundModel(
            self.model,
            self.campaign,
            keep_tests=names,
            pilot=self.pilot,
            coefficients_of_pilot=self.coefficients_of_pilot,
        )

    def with_two_balls(self) -> BoundModel:
        """Return the same model with a separate form error for each ball.

        By default, a model may describe only the sum of the form errors of both balls. Separate
        form errors are needed when another campaign with the same balls is used together with this
        campaign.
        """
        bound = self.keeping(self.test_names)
        bound.setting = replace(bound.setting, two_balls=True)
        return bound

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the parts of the model that have an effect on the tests of this campaign.

        The names are Compliance, GeometricErrors and the class names of nuisance terms. Drift, for
        example, has no effect if the order of the tests is not known.
        """
        idle = []
        for kind, columns in self.columns_of.items():
            if kind is not CircleScale and not columns:
                idle.append(kind.__name__)
        if not self.setting.circle[0]:
            idle.append(CircleScale.__name__)
        return tuple(name for name in self.model.terms if name not in idle)

    def compliance_at(self, force_N: float) -> Array:
        """Return the matrix A with C(F) = A β, shape (compliances, p), at one force F.

        C(F) are the compliances at the force F = ``force_N`` [N], and β are the p parameters of
        interest: compliances at the reference force, their changes with force, and geometric
        errors.
        """
        lever = force_N - self.setting.reference_force_N
        return compliance_rows(self.compliances, self.parameters, lever)

    @cached_property
    def scale(self) -> Array:
        """Typical magnitude of each of the p parameters of interest, shape (p,), in mm, N and rad.

        The magnitude is the prior sd of the parameter. If the prior is flat, it is the prior sd
        that the parameter has in the model's first edition (preset ``first``).
        """
        if not self.model.prior.flat:
            return self.prior_sd
        return self._of_interest.prior_sd(Prior.first(), self.setting)[self._is_free]

    def prior_sd_for_sizes(self, compliance_size: Array) -> Array:
        """Return the prior sds that the parameters have if the compliances have other magnitudes.

        The prior sd of a slope is proportional to the estimated magnitude of its compliance.
        ``compliance_size``, shape (compliances,), holds the magnitudes that replace the estimated
        ones. The result has the shape (p,), in mm, N and rad.
        """
        setting = replace(self.setting, compliance_size_estimate=compliance_size)
        return self._of_interest.prior_sd(self.model.prior, setting)[self._is_free]

    @cached_property
    def least_squares_estimate(self) -> Array:
        """Least-squares estimate of the p parameters of interest, shape (p,), in mm, N and rad.

        For a plan, which has no readings, it is the prior mean. Densities are computed as functions
        of the difference between the parameters and this estimate, to reduce rounding errors.
        """
        return fit_nearest(
            self.interest_columns, self.prior_mean, self.scale, self.reduced, self.known_offset
        )

    @property
    def known_offset(self) -> Array:
        """Nominal deflection of the work ball's mount that is contained in the readings [mm].

        The deflection is described by Fourier coefficients, shape (tests, 25). They are zero if the
        readings are compensated for the deflection.
        """
        return nominal_mount_offset(self.setting)

    @cached_property
    def columns_of(self) -> dict[type[Term], tuple[Columns | BasisNoise, ...]]:
        """Dict with the columns of every nuisance term; its keys are the classes of the terms.

        A column holds the change of the reading per unit of one coefficient. For a term that has no
        effect on the tests of this campaign, the dict holds an empty tuple.
        """
        columns = {type(term): tuple(term.columns(self.setting)) for term in self.model.nuisances}
        for kind, columns_of_term in columns.items():
            check_coefficient_names(kind, columns_of_term)
        return columns

    @property
    def nuisance_columns(self) -> tuple[Columns | BasisNoise, ...]:
        """Columns (readings per unit coefficient) of all nuisance terms, in one tuple."""
        columns: list[Columns | BasisNoise] = []
        for columns_of_term in self.columns_of.values():
            columns.extend(columns_of_term)
        return tuple(columns)

    @cached_property
    def likelihood_given_parameters(self) -> StructuredGaussian:
        """Density p(y | β, φ) of the readings y, with the nuisances integrated out.

        The result is an object that computes this density. β are the parameters of interest and φ
        the hyper-parameters. The methods of the object take the difference β −
        `least_squares_estimate` instead of β.
        """
        return self._structured(self.nuisance_columns, self.interest_columns)

    @cached_property
    def collapsed(self) -> StructuredGaussian:
        """Density p(y | φ) of the readings y, with nuisances and parameters β integrated out.

        Nuisances are effects modelled but not of interest, β are the parameters of interest, and φ
        the hyper-parameters. Negative compliances are not excluded. The readings that the
        least-squares estimate of β predicts are subtracted from y. The differences β −
        `least_squares_estimate` are then treated like the coefficients of nuisances that are the
        same in all tests. In arrays, they come after the coefficients of nuisances.
        """
        interest = Columns(
            self.names,
            self.interest_columns,
            self.prior_sd,
            mean=self.prior_mean - self.least_squares_estimate,
        )
        return self._structured([*self.nuisance_columns, interest])

    def _structured(
        self, columns: Sequence[Columns | BasisNoise], interest: Array | None = None
    ) -> StructuredGaussian:
        """Return the density of the readings, with the nuisance coefficients integrated out.

        ``columns`` holds the columns of the design matrix that belong to these coefficients, and
        those nuisances that are described as noise. ``interest``, shape (tests, 25, p), holds the
        change of the readings per unit of each of the p parameters of interest. If it is None, the
        density does not depend on parameters. The readings that the least-squares estimate
        predicts are first subtracted.
        """
        return StructuredGaussian(
            self.reduced,
            columns,
            offset=self.interest_columns @ self.least_squares_estimate + self.known_offset,
            hypers=self.hyper_prior.names,
            interest=interest,
        )

    def log_likelihood(self, phi: Array, beta: Array) -> Array:
        """Return the log likelihood ln p(y | β, φ) of the readings y, shape (w,).

        ``phi``, shape (w, h), holds w values of the h hyper-parameters φ, with lengths in mm.
        ``beta``, shape (w, p), holds w values of the p parameters of interest β in mm, N and rad.
        """
        return self.likelihood_given_parameters.log_density(phi, beta - self.least_squares_estimate)

    @cached_property
    def parameter_prior(self) -> ParameterPrior:
        """Prior of the p parameters of interest, which may exclude negative compliances."""
        return ParameterPrior(
            self.prior_mean, self.prior_sd, self.truncation, self.model.prior.flat
        )

    def given(self, phi: Array) -> GivenHyperParameters:
        """Return the log evidence ln p(y | φ), shape (w,), and the density p(β | y, φ).

        y are the readings, β the p parameters of interest, and φ the h hyper-parameters. ``phi``,
        shape (w, h), holds w values of φ, with lengths in mm. Negative compliances are not
        excluded. With a flat prior of β, the evidence is defined only up to a constant factor.
        """
        log_evidence, shifted = self.collapsed.conditional(phi, last=len(self.names))
        conditional = ParameterConditional.factored(
            shifted.mean + self.least_squares_estimate, shifted.root, shifted.scale
        )
        conditional.physical = self.physical
        return GivenHyperParameters(log_evidence, conditional)

    def log_evidence(self, phi: Array) -> Array:
        """Return the log evidence ln p(y | φ) of the readings y, shape (w,).

        φ are the h hyper-parameters. ``phi``, shape (w, h), holds w values of φ, with lengths in
        mm. Parameters and nuisances are integrated out, and negative compliances are not excluded.
        `given` returns the same log evidence.
        """
        return self.collapsed.log_density(phi)

    def draw_machine(self, rng: np.random.Generator) -> Array:
        """Return the p parameters of a machine drawn at random from the prior, shape (p,).

        In the default model, the prior sd of a slope is proportional to the magnitude of the
        estimated compliance. For a drawn machine, it is proportional to the magnitude of the drawn
        compliance instead. If the prior excludes negative compliances, no drawn compliance is
        negative. The parameters are in mm, N and rad. Raise an `InputError` if the prior is flat,
        or if nearly all machines drawn from the prior have a negative compliance.
        """
        prior = self.model.prior
        if prior.flat or not prior.slopes_of_estimate:
            return self.parameter_prior.draw(1, rng)[0]
        for _ in range(_MOST_MACHINES):
            beta = self.prior_mean + rng.standard_normal(len(self.names)) * self.prior_sd
            sd = self._of_interest.prior_sd(prior, self.linearised_at(beta))[self._is_free]
            beta = self.prior_mean + (beta - self.prior_mean) * sd / self.prior_sd
            if self.truncation.holds(beta):
                return np.asarray(beta)
        raise self._impossible_prior()

    def _impossible_prior(self) -> InputError:
        """Return the error for a prior under which nearly all machines have a negative compliance.

        Its message names the compliance with the lowest ratio of prior mean to prior sd. If the
        prior mean of this compliance is not negative, the message names the setting ``slope_scale``
        instead.
        """
        constrained = np.flatnonzero(self.truncation.rows.any(axis=0))
        ratio = self.prior_mean[constrained] / self.prior_sd[constrained]
        worst = self.parameters[constrained[np.argmin(ratio)]]
        if worst.prior_mean >= 0.0:
            return InputError(
                "prior slope_scale must let compliances be positive at every tested force, got"
                f" {self.model.prior.slope_scale:g}: {_MOST_MACHINES} machines drawn from the prior"
                " all have a negative compliance. Reduce it, or set truncated = false."
            )
        size, label = display_unit(worst.unit)
        return InputError(
            f"prior mean of {worst.name} must leave compliances that are not negative, got"
            f" {worst.prior_mean * size:g} {label} with the sd {worst.prior_sd * size:g} {label}:"
            f" {_MOST_MACHINES} machines drawn from the prior all have a negative compliance."
            " Correct the mean, widen the sd, or set truncated = false."
        )

    def linearised_at(self, beta: Array) -> Setting:
        """Return the test conditions for a model that is linearised about given parameters β.

        Some effects on the readings, such as that of an error of the angle, depend nonlinearly on
        the machine's compliances and geometric errors. The model replaces them by linear
        approximations near given compliances and geometric errors. In the returned `Setting`, these
        are taken from ``beta``; they replace the estimated ones. ``beta``, shape (p,), holds the p
        parameters of interest in mm, N and rad.
        """
        every_parameter = np.zeros(len(self._is_free))
        every_parameter[self._is_free] = beta
        first_geometric = len(every_parameter) - len(self.geometric_errors)
        estimate = MachineEstimate.known(
            every_parameter[: len(self.compliances)], every_parameter[first_geometric:]
        )
        return linearise(self.setting, self.compliances, estimate)

    def linearisation_error_mm(self, test: CircularTest, beta: Array) -> Array:
        """Return the linearisation error of one test's n readings, shape (n,) [mm].

        The error is the exact effect of the geometric errors on the reading (Eq. 1-14 of the
        article on the model) minus the linear effect. ``beta``, shape (p,), holds the p parameters
        of interest for which the error is computed, in mm, N and rad.
        """
        values = dict(zip(self.names, beta.tolist(), strict=True))
        angle = test.angles_rad()
        errors = {name: values.get(name.label, 0.0) for name in self.geometric_errors}
        columns = self.setting.geometric[self.test_names.index(test.name)]
        linear = basis(angle) @ (columns @ np.array([*errors.values()]))
        errors_of_setup = {}
        for name, value in errors.items():
            if name.kind != "offset" or (name.setup or 1) == test.setup:
                errors_of_setup[replace(name, setup=0).label] = value
        exact = geometric_reading_mm(self.campaign.machine(), test.circle, angle, errors_of_setup)
        return exact - linear

    def largest_linearisation_error_mm(self, beta: Array) -> float:
        """Return the largest absolute linearisation error of all readings [mm].

        The error is the exact effect of the geometric errors on the reading minus the linear
        effect. ``beta``, shape (p,), holds the p parameters of interest for which the error is
        computed, in mm, N and rad.
        """
        errors = []
        for test in self.campaign.tests:
            if test.name in self.test_names:
                errors.append(np.abs(self.linearisation_error_mm(test, beta)).max())
        return float(max(errors))


def require_model(model: object) -> None:
    """Raise an `InputError` unless ``model`` is a `HybridModel`."""
    require(
        isinstance(model, HybridModel),
        f"model must be a HybridModel, got {type(model).__name__}. Make one with"
        " lb.HybridModel.default(degree=1); the model comes first, then the campaign.",
    )


def _indices_of_tests(campaign: Campaign, names: Sequence[str] | None) -> list[int]:
    """Return the indices of the named tests in a campaign, or of all tests if ``names`` is None."""
    selected = campaign if names is None else campaign.select(names)
    selected_names = {test.name for test in selected.tests}
    return [r for r, test in enumerate(campaign.tests) if test.name in selected_names]


def _check_force_levels(model: HybridModel, campaign: Campaign) -> None:
    """Raise an `InputError` if a campaign has too few different forces for a model.

    A model with linear or quadratic compliance (degree 1 or 2) needs at least two different forces.
    A model of degree k with flat priors needs at least k + 2 different forces.
    """
    levels = campaign.force_levels
    degree = model.degree
    require(
        levels > 1 or degree == 0,
        "degree ≥ 1 must have at least two force levels,"
        f" got one ({campaign.forces_N[0]:g} N). Use degree 0 (--degree 0), or add tests at another"
        " force.",
    )
    fewest_in_words = ("two", "three", "four")[degree]
    require(
        levels >= degree + 2 or not model.prior.flat,
        f"flat priors must have at least {fewest_in_words} force levels at degree"
        f" {degree}, got {levels}: compliance and geometry cannot be separated. Use the default"
        " preset, a lower degree, or add tests at another force.",
    )
