"""HybridModel: the terms, the prior and the noise, before they meet a campaign; BoundModel: the
same of one campaign.

ρ = Σ_k F (F − F0)^k j_C·C_k + j_G·E + nuisances + ε, β = (C_0 …, E) ~ N(m, S), nuisances Gaussian
given φ = (σ, δ, κ, τ).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal
from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, distinct_forces
from ldbb_bayes.errors import check_known, renamed, require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.machine.exact import geometric_reading_mm
from ldbb_bayes.machine.linear import kept_compliances
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.likelihood import StructuredGaussian
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.prior import (
    EXAMPLES,
    Prior,
    compliance_unit,
    degree_of,
    geometric_unit,
    parameter_to_inside,
)
from ldbb_bayes.model.reduction import Reduced, reduce_readings
from ldbb_bayes.model.setting import Setting, geometric_errors_of, setting_of
from ldbb_bayes.model.terms import (
    BasisNoise,
    CircleScale,
    Columns,
    ForceError,
    JointLoad,
    Mount,
    Scale,
    Term,
    first_edition,
)
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array, Result, Shown
from ldbb_bayes.units import inside_name

__all__ = ["BoundModel", "HybridModel", "Parameter", "Preset", "Simulation"]

Preset = Literal["default", "first", "paper"]
_SIGMA = Scale("sigma", "sigma_um", "σ", "white noise")
# φ in this order, then the scales of other terms in theirs, the circles' last.
_ORDER = ("sigma", "delta", "delta_0", "delta_1", "kappa", "tau", "decay", "omega", "eta")
# Circles scatter each by a scale of its own where there are so many.
_FEWEST_SCALED = 4
# What explains a change with force as slopes do: the term, which setting of it, or all, and how its
# coefficients' names begin.
_RIVALS: dict[str, tuple[type[Term], str, str]] = {
    "joint load": (JointLoad, "", "joint_load"),
    "curved mount": (Mount, "curvature_um", "mount_curvature"),
    "curved force law": (ForceError, "curvature_sd", "force_curvature"),
}


@dataclass(frozen=True)
class HybridModel(Result):
    """The model of a campaign, not yet bound to one: its ``nuisances`` (terms) and priors; refused
    where they clash."""

    #: compliance constant (0), linear (1) or quadratic (2) in force; constant: linear with its
    #: slopes at zero
    degree: int = 1
    nuisances: tuple[Term, ...] = field(
        default_factory=lambda: tuple(own() for own in Term.kinds.values() if not own.on_demand)
    )
    prior: Prior = field(default_factory=Prior.default)  #: of parameters and hyper-parameters
    #: F0; default: mid-range of the campaign's forces. F0 = 0 gives Eq. 33 literally
    reference_force_N: float | None = None
    preset: Preset = "default"  #: where the model started from
    #: parameters fixed at zero, such as C_XYX_1; names are checked when the model meets a
    #: campaign
    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", tuple(sorted(set(map(inside_name, self.fixed)))))
        constant = f"got {self.degree}. Choose constant, linear or quadratic compliance."
        require(self.degree in (0, 1, 2), f"degree must be 0, 1 or 2, {constant}")
        force = self.reference_force_N
        finite = force is None or np.isfinite(force)
        require(
            finite,
            f"reference_force_N must be finite, got {force}. Give a force in N or leave it out.",
        )
        for name in self.fixed:
            mean = self.prior.means.get(name, 0.0)
            cure = f"got both ({mean:g}). Remove one of them."
            require(not mean, f"{name} must be fixed at zero or have a prior mean, {cure}")
        kinds = [type(term) for term in self.nuisances]
        for kind in kinds:
            derived = issubclass(kind, Term) and "__dataclass_fields__" in vars(kind)
            cure = "Derive its class from Term, under @dataclass(frozen=True)."
            require(derived, f"nuisances must be terms, got {kind.__name__}. {cure}")
            require(
                kinds.count(kind) == 1,
                f"nuisances must differ, got {kind.__name__} twice. Remove one.",
            )
        names = [scale.name for scale in dict.fromkeys(self.scales)]
        cure = f"got {', '.join(names)}. Rename the scale of a term of your own."
        require(len(set(names)) == len(names), f"hyper-parameters must differ, {cure}")
        require(
            not (self.prior.flat and kinds),
            "a flat prior must stand without nuisances, got"
            f" {', '.join(kind.__name__ for kind in kinds)}: what they share with the parameters"
            " would be undetermined. Use proper priors or remove the nuisances.",
        )

    @classmethod
    def default(cls, degree: int = 1) -> HybridModel:
        """All nuisances, proper priors, truncation."""
        return cls(degree)

    @classmethod
    def first(cls, degree: int = 1) -> HybridModel:
        """The model's first edition: form of 1/n, linear springs, circles of one scatter."""
        return cls(degree, first_edition(), Prior.first(), preset="first")

    @classmethod
    def paper(cls, degree: int = 0) -> HybridModel:
        """No nuisances, flat priors, no truncation: the point estimate is Eq. 31."""
        return cls(degree, (), Prior.paper(), preset="paper")

    @classmethod
    def from_preset(cls, preset: str, degree: int) -> HybridModel:
        """The named preset."""
        presets = {"default": cls.default, "first": cls.first, "paper": cls.paper}
        check_known("preset", [preset], presets)
        return presets[preset](degree)

    def with_degree(self, degree: int) -> HybridModel:
        """The same model with another degree; what is fixed or overridden stays so where the new
        degree has it."""
        fixed = tuple(name for name in self.fixed if degree_of(name) <= degree)
        overrides = {
            name: sd for name, sd in self.prior.overrides.items() if degree_of(name) <= degree
        }
        return replace(
            self, degree=degree, fixed=fixed, prior=replace(self.prior, overrides=overrides)
        )

    def with_slope_scale(self, scale: float) -> HybridModel:
        """The same model with slopes of this prior scale; what is overridden changes in
        proportion."""
        factor = scale / self.prior.slope_scale
        overrides = {
            name: sd * (factor if degree_of(name) else 1.0)
            for name, sd in self.prior.overrides.items()
        }
        return replace(self, prior=replace(self.prior, slope_scale=scale, overrides=overrides))

    def fixing(self, *names: str) -> HybridModel:
        """The same model with the named parameters fixed at zero; a prior mean they had becomes
        zero."""
        fixed = {*self.fixed, *map(inside_name, names)}
        means = {name: 0.0 if name in fixed else mean for name, mean in self.prior.means.items()}
        return replace(self, fixed=tuple(fixed), prior=replace(self.prior, means=means))

    def with_prior(self, priors: Mapping[str, Any] | None = None, /, **more: Any) -> HybridModel:
        """The same model with other priors, each text with its unit or a number in the inside unit
        (mm, N, rad).

        ``C_XXX=("60 nm/N", "5 nm/N")``: mean and sd of a parameter, which is free again if it was
        fixed; a slope's mean stays 0. ``tau_um="2 µm"``: a field of `Prior`. Names as the paper
        prints them go in a mapping: ``{"E_C(0Y)X": (0, "20 µrad")}``. InputError for what is
        neither; names are checked against the machine when the model meets a campaign.
        """
        given = {inside_name(name): value for name, value in {**(priors or {}), **more}.items()}
        tables: dict[str, Any] = {
            "means": dict(self.prior.means),
            "overrides": dict(self.prior.overrides),
        }
        settings = [own.name for own in fields(Prior) if own.name not in tables]
        others = [name for name in given if not name.startswith(("C_", "E_"))]
        check_known(
            "prior", others, [*settings, *EXAMPLES], " Parameters are named like C_XXX and E_XX1."
        )
        for name, value in given.items():
            if name not in settings:
                pair = isinstance(value, tuple | list) and len(value) == 2
                require(
                    pair,
                    f"prior of {name} must be its mean and sd, got {value!r}. Write {name}=(mean,"
                    " sd).",
                )
                tables["overrides"][name] = value[1]
                mean = parameter_to_inside(name, value[0], "prior mean of")
                tables["means"] |= {name: mean} if mean or not degree_of(name) else {}
        own = {name: value for name, value in given.items() if name in settings}
        fixed = tuple(name for name in self.fixed if name not in given)
        return replace(self, fixed=fixed, prior=replace(self.prior, **own, **tables))

    def with_term(self, *terms: Term) -> HybridModel:
        """The same model with these nuisances, in place of its own of the same kind:
        ``with_term(Drift("temperature"))``."""
        own = {type(term): term for term in (*self.nuisances, *terms)}
        places = [*Term.kinds.values(), *own]
        return replace(self, nuisances=tuple(own[kind] for kind in sorted(own, key=places.index)))

    def including(self, *terms: Term) -> HybridModel:
        """Return the same as `with_term`, its name since 0.2.0, with a FutureWarning."""
        renamed("the method", "including", {"including": "with_term"}, refused_from="0.3.0")
        return self.with_term(*terms)

    def without(self, *names: str) -> HybridModel:
        """The same model without the named terms (``ball-form`` … ``hysteresis``,
        ``truncation``)."""
        check_known("term", names, (*(kind.key() for kind in Term.kinds.values()), "truncation"))
        prior = replace(self.prior, truncated=False) if "truncation" in names else self.prior
        return replace(
            self,
            nuisances=tuple(term for term in self.nuisances if term.key() not in names),
            prior=prior,
        )

    @property
    def rivals(self) -> tuple[str, ...]:
        """What it has that explains a change with force as slopes do: joint load, curved mount,
        curved force law."""
        own = {type(term): term for term in self.nuisances}
        return tuple(
            name
            for name, (kind, setting, _) in _RIVALS.items()
            if kind in own and getattr(own[kind], setting, True)
        )

    def with_rivals(self, *names: str) -> HybridModel:
        """The same model with these alone of its `rivals`."""
        model = self
        for kind, setting, _ in (_RIVALS[name] for name in self.rivals if name not in names):
            own: Any = next(term for term in self.nuisances if type(term) is kind)
            model = (
                model.with_term(replace(own, **{setting: 0.0}))
                if setting
                else model.without(kind.key())
            )
        return model

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters; σ always, the others with their term."""
        return self.scales_in(None)

    def scales_in(self, setting: Setting | None) -> tuple[Scale, ...]:
        """The same of a setting, with a scale for every circle, and without those that do not act
        there."""
        own = [
            (term, term.scales if setting is None else term.scales_in(setting))
            for term in self.nuisances
        ]
        every = dict.fromkeys([_SIGMA, *(scale for term, scales in own for scale in scales)])
        if setting is not None:
            parts = [part for term, _ in own for part in term.columns(setting)]
            sources = [own for part in parts for own in part.sources]
            acting = {"sigma", *(name for source in sources for name in source[:3])}
            every = {scale: None for scale in every if scale.name in acting}

        def place(scale: Scale) -> int:
            return (
                _ORDER.index(scale.name)
                if scale.name in _ORDER
                else len(_ORDER) + (scale.law == "circle")
            )

        return tuple(sorted(every, key=place))

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of all terms."""
        return ("Compliance", "GeometricErrors", *(type(term).__name__ for term in self.nuisances))

    def bind(self, campaign: Campaign) -> BoundModel:
        """The model of this campaign or plan; InputError for forces too few for its degree, or for
        flat priors."""
        return BoundModel(self, campaign)

    def simulate(
        self,
        plan: Campaign,
        *,
        seed: int,
        parameters: Mapping[str, float] | None = None,
        hyper_um: Mapping[str, float] | None = None,
        exact: bool = False,
    ) -> Simulation:
        """Simulate the readings of a plan (or replace those of a campaign).

        InputError for unknown names, negative hyper-parameters, or a flat prior without parameters.

        Parameters
        ----------
        parameters : true values in inside units; what it leaves out is zero. Default: a draw from
            the prior.
        hyper_um : true hyper-parameters [µm]; what it leaves out is drawn from its prior.
        exact : geometric errors through the exact forward model (Eq. 1-14) instead of the linear
            one.
        """
        rng = np.random.default_rng(seed)
        bound = self.bind(plan)
        if parameters is None:
            beta = bound.draw_machine(rng)
        else:
            parameters = {inside_name(name): value for name, value in parameters.items()}
            check_known("parameter", parameters, bound.names)
            beta = np.array([parameters.get(name, 0.0) for name in bound.names], dtype=float)
        given = hyper_um or {}
        names = bound.hyper_prior.names
        check_known("hyper-parameter", given, names)
        for name, value in given.items():
            usable = np.isfinite(value) and value >= 0
            require(
                usable,
                f"hyper-parameter {name} must be a number ≥ 0 in µm, got {value}. Correct it.",
            )
        drawn = bound.hyper_prior.draw(1, rng)[0]
        unit = 1.0 / bound.hyper_prior.shown
        phi = {
            name: given.get(name, float(own / k)) * k
            for name, own, k in zip(names, drawn, unit.tolist(), strict=True)
        }
        truth = bound.linearised_at(beta)
        coefficients = bound.interest @ beta + bound.known_offset
        for term in self.nuisances:
            for columns in term.columns(truth):
                coefficients = coefficients + columns.draw(phi, truth.tests, rng)
        tests = []
        for test, own in zip(plan.tests, coefficients, strict=True):
            reading = basis(test.angles_rad()) @ own + rng.normal(
                0.0, phi["sigma"], len(test.angle_deg)
            )
            if exact:
                reading = reading + bound.linearisation_error_mm(test, beta)
            tests.append(test.with_reading_um(reading * 1e3))
        return Simulation(
            replace(plan, tests=tuple(tests)),
            dict(zip(bound.names, beta.tolist(), strict=True)),
            bound.hyper_prior.named(np.array([*phi.values()])),
            {parameter.name: parameter.unit for parameter in bound.parameters},
        )


@dataclass(frozen=True)
class Simulation(Result):
    """A simulated campaign, and what it was made from: true parameters in inside units (mm, N,
    rad), hyper-parameters, lengths in µm, and the parameters' units."""

    campaign: Campaign
    parameters: dict[str, float]
    hyper_um: dict[str, float]
    units: dict[str, str]


Group = Literal["compliance", "slope", "geometric"]
_PLANNED_COMPLIANCE = 5e-5
_LEAST_SHARE = 20.0
_KEPT: WeakKeyDictionary[Campaign, tuple[Reduced, ...]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Parameter:
    """One parameter of interest: name, unit, prior sd (infinite when flat), group, of a compliance
    the power of force it goes with, and the prior mean (zero when flat)."""

    name: str
    unit: str
    prior_sd: float
    group: Group
    degree: int = 0
    prior_mean: float = 0.0

    @property
    def compliance(self) -> str:
        """The compliance that a slope belongs to: C_XXX for C_XXX_1."""
        return self.name.removesuffix(f"_{self.degree}") if self.degree else self.name


def _rivals_slopes(part: Columns | BasisNoise) -> bool:
    """Whether columns explain a change with force as slopes do."""
    return isinstance(part, Columns) and part.names[0].startswith(
        tuple(stem for *_, stem in _RIVALS.values())
    )


class BoundModel(Shown):
    """The model of one campaign.

    Parameters
    ----------
    keep : names of the tests to use. F0, force range, truncation, Ĉ and the two-ball rule stay
        those of the whole campaign.
    pilot : of a plan: the campaign whose F0, force range and Ĉ are used instead of the plan's own.

    Attributes
    ----------
    parameters, names, prior_sd, prior_mean : tuples, and ndarrays of shape (p,)
        Compliances, their slopes degree by degree, geometric errors; infinite sd and zero mean when
        flat.
    test_names, reduced, setting : tuple of str, tuple of Reduced, Setting
    interest : ndarray, shape (tests, 25, p)
        H: columns of the parameters of interest.
    physical, truncation : Truncation
        The region of physical compliances, C(F) ≥ 0; the same where the prior imposes it, else the
        whole space.
    """

    shown = ("model", "campaign", "test_names", "names", "setting")

    def __init__(
        self,
        model: HybridModel,
        campaign: Campaign,
        *,
        keep: Sequence[str] | None = None,
        pilot: Campaign | None = None,
    ) -> None:
        _check_levels(model, campaign if pilot is None else pilot)
        self.model = model
        self.campaign = campaign
        self.pilot = pilot
        self._kept = kept_compliances(
            campaign.machine(), *dict.fromkeys(test.circle for test in campaign.scope)
        )
        self.compliances: tuple[ComplianceName, ...] = self._kept.names
        self.geometric_errors: tuple[GeometricName, ...] = geometric_errors_of(campaign)
        reduced = _reduced(campaign)
        self.setting: Setting = setting_of(
            campaign, self.compliances, model.reference_force_N, pilot=pilot
        )
        fitted = self._estimate(reduced) if pilot is None else self._estimate_of(pilot)
        self.setting = self._linearised(*fitted)
        self.geometric_estimate = fitted[1]
        most = max(len(each.tests) for each in (campaign, pilot or campaign))
        if (
            any(isinstance(term, CircleScale) for term in model.nuisances)
            and most >= _FEWEST_SCALED
        ):
            self.setting = replace(
                self.setting, circle=np.array([f"lambda_{test.name}" for test in campaign.tests])
            )
        self.hyper_prior = model.prior.hyper(model.scales_in(self.setting), campaign.resolution_um)
        every = self._every_parameter()
        check_known("fixed parameter", model.fixed, [parameter.name for parameter in every])
        self._free = np.array([parameter.name not in model.fixed for parameter in every])
        self.parameters = tuple(
            parameter for parameter in every if parameter.name not in model.fixed
        )
        self.names = tuple(parameter.name for parameter in self.parameters)
        self.prior_sd = np.array([parameter.prior_sd for parameter in self.parameters])
        self.prior_mean = np.array([parameter.prior_mean for parameter in self.parameters])
        self.physical = Truncation(self._physical_rows())
        self.truncation = (
            self.physical if model.prior.truncated else Truncation(np.zeros((0, len(self.names))))
        )
        kept = {test.name for test in (campaign if keep is None else campaign.select(keep)).tests}
        rows = [i for i, test in enumerate(campaign.tests) if test.name in kept]
        self.setting = self.setting.select(rows)
        self.reduced = tuple(reduced[i] for i in rows)
        self.test_names = tuple(campaign.tests[i].name for i in rows)
        lever = self.setting.force_N - self.setting.reference_force_N
        elastic = [
            (self.setting.force_N * lever**k)[:, None, None] * self.setting.wrench
            for k in range(model.degree + 1)
        ]
        self.interest = np.concatenate([*elastic, self.setting.geometric], axis=2)[:, :, self._free]

    def keeping(self, names: Sequence[str]) -> BoundModel:
        """The same binding with only the named tests; campaign properties stay frozen."""
        return BoundModel(self.model, self.campaign, keep=names, pilot=self.pilot)

    def with_two_balls(self) -> BoundModel:
        """The same binding with a form for each ball, as other readings with the same balls
        need."""
        bound = self.keeping(self.test_names)
        bound.setting = replace(bound.setting, two_balls=True)
        return bound

    @property
    def terms(self) -> tuple[str, ...]:
        """Class names of the terms that act on this campaign: hysteresis needs both directions of
        travel."""
        idle = [
            kind.__name__
            for kind, columns in self.columns_of.items()
            if not columns and kind is not CircleScale
        ]
        idle += [CircleScale.__name__] * (not self.setting.circle[0])
        return tuple(name for name in self.model.terms if name not in idle)

    def compliance_at(self, force_N: float) -> Array:
        """Rows A with C + slopes = A β at a force, one per kept compliance, shape (compliances,
        p)."""
        labels = [name.label for name in self.compliances]
        rows = np.zeros((len(labels), len(self.parameters)))
        for column, parameter in enumerate(self.parameters):
            if parameter.group != "geometric":
                lever = force_N - self.setting.reference_force_N
                rows[labels.index(parameter.compliance), column] = lever**parameter.degree
        return rows

    @cached_property
    def scale(self) -> Array:
        """Typical size of every parameter, shape (p,): its prior sd, or the default prior's when
        flat."""
        return self._sd_of(Prior.first())[self._free] if self.model.prior.flat else self.prior_sd

    @cached_property
    def centre(self) -> Array:
        """Least-squares estimate about which densities are computed, shape (p,); the prior mean for
        a plan."""
        return self._fit(self.interest, self.prior_mean, self.scale, self.reduced)

    @property
    def known_offset(self) -> Array:
        """Nominal mount deflection still in the readings (Eq. 32), shape (tests, 25) [mm]; zero
        when compensated."""
        nominal = 0.0 if self.setting.compensated else self.setting.deflection_um_per_bar * 1e-3
        return self.setting.constant(self.setting.pressure_bar * nominal)[:, :, 0]

    @cached_property
    def columns_of(self) -> dict[type[Term], tuple[Columns | BasisNoise, ...]]:
        """The nuisances' columns, term by term in the model's order; of a term that does not act
        here, none."""
        return {type(term): tuple(term.columns(self.setting)) for term in self.model.nuisances}

    @property
    def nuisance_columns(self) -> tuple[Columns | BasisNoise, ...]:
        """The same without their terms."""
        return tuple(part for columns in self.columns_of.values() for part in columns)

    @cached_property
    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Prior mean and sd of the last shared coefficients of `collapsed`: of rivals of slopes,
        and the parameters."""
        rivals = [
            part
            for part in self.nuisance_columns
            if isinstance(part, Columns) and _rivals_slopes(part)
        ]
        found = {
            name: (0.0, sd)
            for part in rivals
            for name, sd in zip(part.names, part.sd.tolist(), strict=True)
        }
        return found | {own.name: (own.prior_mean, own.prior_sd) for own in self.parameters}

    @cached_property
    def given_interest(self) -> StructuredGaussian:
        """p(y | β, φ): nuisances integrated out. Coefficients are β − centre."""
        return self._structured(self.nuisance_columns, self.interest)

    @cached_property
    def collapsed(self) -> StructuredGaussian:
        """p(y | φ): nuisances and β integrated out, not truncated. Its last shared coefficients:
        rivals of slopes, β − centre."""
        last = sorted(self.nuisance_columns, key=_rivals_slopes)
        return self._structured(
            [
                *last,
                Columns(
                    self.names, self.interest, self.prior_sd, mean=self.prior_mean - self.centre
                ),
            ]
        )

    def _structured(
        self, columns: Sequence[Columns | BasisNoise], interest: Array | None = None
    ) -> StructuredGaussian:
        return StructuredGaussian(
            self.reduced,
            columns,
            offset=self.interest @ self.centre + self.known_offset,
            hypers=self.hyper_prior.names,
            interest=interest,
        )

    def log_likelihood(self, phi: Array, beta: Array) -> Array:
        """ln p(y | β, φ), shape (w,). φ (w, h) [mm], β (w, p)."""
        return self.given_interest.log_density(phi, beta - self.centre)

    def log_prior(self, beta: Array) -> Array:
        """ln p(β), shape (...): −inf outside the truncation, its prior probability divided out; 0
        when flat."""
        if self.model.prior.flat:
            return np.zeros(beta.shape[:-1])
        white = (beta - self.prior_mean) / self.prior_sd
        density = -0.5 * (white**2).sum(axis=-1) - np.log(self.prior_sd * np.sqrt(2 * np.pi)).sum()
        return np.where(
            self.truncation.holds(beta), density - self.log_prob_truncation_prior, -np.inf
        )

    @cached_property
    def truncation_prior(self) -> tuple[float, float]:
        """ln P(T | prior) and its error [nat]; 0 without truncation. Compliances that share no
        parameter are independent."""
        if not self.truncation.active:
            return 0.0, 0.0
        mean = self.truncation.rows @ self.prior_mean
        spread = self.truncation.rows * self.prior_sd
        _, label = connected_components(np.abs(spread @ spread.T) > 0.0, directed=False)
        blocks = [
            (mean[None, label == k], spread[None, label == k]) for k in range(label.max() + 1)
        ]
        value, error = np.sum(
            [Orthant(*block).log_probability(1e-4) for block in blocks], axis=(0, 2)
        )
        return float(value), float(error)

    @property
    def log_prob_truncation_prior(self) -> float:
        """ln P(T | prior)."""
        return self.truncation_prior[0]

    def given(self, phi: Array) -> tuple[Array, ParameterConditional]:
        """ln p(y | φ), shape (w,), without its normalising constant when the prior is flat; and p(β
        | y, φ)."""
        log_evidence, own = self.collapsed.conditional(phi, last=len(self.names))
        given = ParameterConditional.factored(own.mean + self.centre, own.root, own.scale)
        given.physical = self.physical
        return log_evidence, given

    def log_evidence(self, phi: Array) -> Array:
        """ln p(y | φ) alone, shape (w,); see `given`."""
        return self.collapsed.log_density(phi)

    def draw_parameters(self, size: int, rng: np.random.Generator) -> Array:
        """Draws of β from its prior, which must not be flat, inside the truncation, shape (size,
        p)."""
        require(
            not self.model.prior.flat,
            "parameters must be given when the prior is flat, got none. Pass true values.",
        )
        p = len(self.names)
        if not self.truncation.active:
            return self.prior_mean + rng.standard_normal((size, p)) * self.prior_sd
        draws = np.zeros((0, p))
        spread = np.broadcast_to(np.diag(self.prior_sd), (size, p, p))
        orthant = self.truncation.orthants(np.broadcast_to(self.prior_mean, (size, p)), spread)
        while len(draws) < size:
            white, exact = orthant.draw_standard(rng)
            beta = self.prior_mean + white * self.prior_sd
            draws = np.concatenate([draws, beta[exact & self.truncation.holds(beta)]])
        return draws[:size]

    def draw_machine(self, rng: np.random.Generator) -> Array:
        """β (p,) of a machine from the prior inside the truncation, its slopes measured against its
        own compliances."""
        if not self.model.prior.slopes_of_estimate:
            return self.draw_parameters(1, rng)[0]
        while True:
            beta = self.prior_mean + rng.standard_normal(len(self.names)) * self.prior_sd
            own = self._sd_of(self.model.prior, self.linearised_at(beta))[self._free]
            beta = self.prior_mean + (beta - self.prior_mean) * own / self.prior_sd
            if self.truncation.holds(beta):
                return np.asarray(beta)

    def linearisation_error_mm(self, test: CircularTest, beta: Array) -> Array:
        """Exact (Eq. 1-14) minus linear geometric reading of one test, shape (n,) [mm]. β (p,)."""
        values = dict(zip(self.names, beta.tolist(), strict=True))
        angle = test.angles_rad()
        errors = {name: values.get(name.label, 0.0) for name in self.geometric_errors}
        linear = basis(angle) @ (
            self.setting.geometric[self.test_names.index(test.name)] @ np.array([*errors.values()])
        )
        in_setup = {
            replace(name, setup=0).label: value
            for name, value in errors.items()
            if not (name.kind == "offset" and (name.setup or 1) != test.setup)
        }
        return geometric_reading_mm(self.campaign.machine(), test.circle, angle, in_setup) - linear

    def largest_linearisation_error_mm(self, beta: Array) -> float:
        """The largest absolute error over all readings [mm]."""
        tests = [test for test in self.campaign.tests if test.name in self.test_names]
        return float(max(np.abs(self.linearisation_error_mm(test, beta)).max() for test in tests))

    def _every_parameter(self) -> tuple[Parameter, ...]:
        prior = self.model.prior
        sd = iter(self._sd_of(prior).tolist())
        rows: list[tuple[str, str, Group, int]] = []
        for k in range(self.model.degree + 1):
            group: Group = "slope" if k else "compliance"
            rows += [
                (c.label + (f"_{k}" if k else ""), compliance_unit(c, k), group, k)
                for c in self.compliances
            ]
        rows += [
            (name.label, geometric_unit(name.kind), "geometric", 0)
            for name in self.geometric_errors
        ]
        check_known("prior override", prior.overrides, [name for name, *_ in rows])
        check_known("prior mean", prior.means, [name for name, *_ in rows])
        return tuple(
            Parameter(
                name, unit, np.inf if prior.flat else next(sd), group, k, prior.means.get(name, 0.0)
            )
            for name, unit, group, k in rows
        )

    def _sd_of(self, prior: Prior, setting: Setting | None = None) -> Array:
        """Prior sd of all parameters, fixed ones included; slopes measured against this setting's
        Ĉ."""
        setting = setting or self.setting
        compliance = self._compliance_sd(prior)
        size = self._size(prior.compliance_size, prior)
        if prior.slopes_of_estimate:
            size = np.maximum(np.abs(setting.compliance_estimate), size / _LEAST_SHARE)
        degrees = range(1, self.model.degree + 1)
        slopes = [prior.slope_sd(self.compliances, k, setting.force_range_N, size) for k in degrees]
        return np.concatenate([compliance, *slopes, prior.geometric_sd(self.geometric_errors)])

    def _compliance_sd(self, prior: Prior) -> Array:
        """Prior sd of every kept compliance, what it has absorbed of dropped sets included, unless
        overridden."""
        overridden = [name.label in prior.overrides for name in self.compliances]
        return np.where(
            overridden,
            prior.compliance_sd(self.compliances),
            self._size(prior.compliance_sd, prior),
        )

    def _size(self, of: Callable[[Sequence[ComplianceName]], Array], prior: Prior) -> Array:
        """Sizes of kept compliances; what each has absorbed of dropped sets is added in
        quadrature."""
        own = of(self.compliances)
        for k, absorbed in enumerate(self._kept.absorbed):
            heads = [other for other in absorbed if other.label in self._kept.dependent]
            if heads:
                own[k] = np.hypot(
                    own[k], np.linalg.norm([absorbed[other] for other in heads] * of(heads))
                )
        return own

    def linearised_at(self, beta: Array) -> Setting:
        """The setting linearised about parameters (p,)."""
        every = np.zeros(len(self._free))
        every[self._free] = beta
        return self._linearised(
            every[: len(self.compliances)], every[len(every) - len(self.geometric_errors) :]
        )

    def _linearised(self, compliance: Array, geometric: Array) -> Setting:
        """The setting with Ĉ and the circle fitted with it."""
        setting = self.setting
        axial = np.zeros(3)
        for name, value in zip(self.compliances, compliance, strict=True):
            if name.kind == "direct":
                axial[LINEAR.index(name.twist)] += value
        fitted = (
            setting.force_N[:, None] * (setting.wrench @ compliance) + setting.geometric @ geometric
        )
        return replace(setting, compliance_estimate=compliance, axial_estimate=axial, fitted=fitted)

    def _estimate_of(self, pilot: Campaign) -> tuple[Array, Array]:
        """The pilot's Ĉ and Ê; what its circles do not show, as for a plan."""
        bound = BoundModel(self.model, pilot)
        seen = dict(zip(bound.compliances, bound.setting.compliance_estimate, strict=True))
        compliance = [
            seen.get(name, planned)
            for name, planned in zip(self.compliances, self._planned(), strict=True)
        ]
        rigid = dict(zip(bound.geometric_errors, bound.geometric_estimate, strict=True))
        return np.array(compliance), np.array(
            [rigid.get(name, 0.0) for name in self.geometric_errors]
        )

    def _planned(self) -> Array:
        """Ĉ without readings: the prior mean where the prior has one, else a usual machine's."""
        usual = {
            name.label: _PLANNED_COMPLIANCE if name.kind == "direct" else 0.0
            for name in self.compliances
        }
        return np.array([self.model.prior.means.get(name, value) for name, value in usual.items()])

    def _estimate(self, reduced: Sequence[Reduced]) -> tuple[Array, Array]:
        """Ĉ and Ê: least squares at degree 0 on the whole campaign, nearest to the prior mean in
        units of the prior sd."""
        setting = self.setting
        prior = Prior.first() if self.model.prior.flat else self.model.prior
        columns = np.concatenate(
            [setting.force_N[:, None, None] * setting.wrench, setting.geometric], axis=2
        )
        scale = np.concatenate(
            [self._compliance_sd(prior), prior.geometric_sd(self.geometric_errors)]
        )
        labels = [
            *(name.label for name in self.compliances),
            *(name.label for name in self.geometric_errors),
        ]
        mean = np.array([prior.means.get(label, 0.0) for label in labels])
        estimate, geometric = np.split(
            self._fit(columns, mean, scale, reduced), [len(self.compliances)]
        )
        seen = (np.abs(setting.wrench).max(axis=(0, 1)) > 0.0) & (reduced[0].projection is not None)
        return np.where(seen, estimate, self._planned()), geometric

    def _fit(self, columns: Array, near: Array, scale: Array, reduced: Sequence[Reduced]) -> Array:
        """Least squares; where not unique, what is closest to ``near`` in units of ``scale``. Of a
        plan, ``near`` itself."""
        if reduced[0].projection is None:
            return near
        rows = np.concatenate([test.factor @ columns[r] for r, test in enumerate(reduced)])
        values = [
            test.projection - test.factor @ own
            for test, own in zip(reduced, self.known_offset, strict=True)
        ]
        return near + minimum_norm_solution(rows, np.concatenate(values) - rows @ near, scale)

    def _physical_rows(self) -> Array:
        """C(F) ≥ 0 for compliances that are a deflection under the force itself, at every tested
        force that can bind. A compliance fixed at zero at F0 whose free slope would make it
        negative on one side of F0 is refused."""
        forces = distinct_forces(self.campaign.forces_N)
        degree = self.model.degree
        forces = forces if degree == 2 else forces[[0, -1][: degree + 1]]
        bounded = np.flatnonzero(self._kept.not_negative)
        at = [self.compliance_at(force) for force in forces]
        for j in bounded:
            label = self.compliances[j].label
            slopes = [p for p in self.parameters if p.compliance == label and p.degree]
            signs = {
                float(np.sign(rows[j] @ [p in slopes for p in self.parameters])) for rows in at
            }
            alone = (
                label in self.model.fixed
                and [p.degree for p in slopes] == [1]
                and {-1.0, 1.0} <= signs
            )
            require(
                not alone,
                f"{label} must not be fixed at zero while {label}_1 is free: about F0 ="
                f" {self.setting.reference_force_N:g} N C(F) would be negative on one side. Fix"
                f" {label}_1 too, or give a reference_force_N outside the tested forces.",
            )
        rows = dict.fromkeys(tuple(rows[j]) for j in bounded for rows in at)
        return np.array([row for row in rows if any(row)]).reshape(-1, len(self.parameters))


def _check_levels(model: HybridModel, campaign: Campaign) -> None:
    levels = campaign.force_levels
    degree = model.degree
    got = (
        f"got one ({campaign.forces_N[0]:g} N). Use degree 0 (--degree 0), or add tests at another"
        " force."
    )
    require(levels > 1 or degree == 0, f"degree ≥ 1 must have at least two force levels, {got}")
    require(
        levels >= degree + 2 or not model.prior.flat,
        f"flat priors must have at least {('two', 'three', 'four')[degree]} force levels at degree"
        f" {degree}, got {levels}: compliance and geometry cannot be separated. Use the default"
        " preset, a lower degree, or add tests at another force.",
    )


def _reduced(campaign: Campaign) -> tuple[Reduced, ...]:
    """The reduced readings, computed once while the campaign lives: comparisons bind it to hundreds
    of models."""
    if campaign not in _KEPT:
        plan = campaign.is_plan
        planned = {test.angle_deg.tobytes(): test for test in campaign.tests} if plan else {}
        once = {
            angles: reduce_readings(test.angles_rad(), None) for angles, test in planned.items()
        }
        _KEPT[campaign] = tuple(
            (
                once[test.angle_deg.tobytes()]
                if plan
                else reduce_readings(test.angles_rad(), test.readings_mm())
            )
            for test in campaign.tests
        )
    return _KEPT[campaign]
