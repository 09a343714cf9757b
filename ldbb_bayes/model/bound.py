"""A HybridModel bound to a campaign or plan: parameters with units and priors, columns, reduced readings, densities.

p(β, φ | y) ∝ p(y | β, φ) p(β) p(φ) 1[A β ≥ 0], nuisances integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.kept import kept_compliances
from ldbb_bayes.machine.names import ComplianceName, GeometricName
from ldbb_bayes.model.basis import SIZE
from ldbb_bayes.model.columns import BasisNoise, Columns
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.gaussian import least_squares
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.orthant import Orthant, Truncation
from ldbb_bayes.model.prior import Prior, compliance_unit, geometric_unit
from ldbb_bayes.model.reduction import Reduced, reduce_readings
from ldbb_bayes.model.setting import Setting, geometric_errors_of, setting_of
from ldbb_bayes.model.structured import StructuredGaussian
from ldbb_bayes.model.terms import Compliance, GeometricErrors

__all__ = ["BoundModel", "Parameter"]

Array = NDArray[Any]
Group = Literal["compliance", "slope", "geometric"]
_PLANNED_COMPLIANCE = 5e-5
_KEPT: WeakKeyDictionary[Campaign, tuple[Reduced, ...]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Parameter:
    """One parameter of interest: name, unit, prior sd (infinite when flat), group, of a compliance the power of force it goes
    with, and the prior mean (zero when flat)."""

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


class BoundModel:
    """The model of one campaign.

    Parameters
    ----------
    model : HybridModel
    campaign : Campaign
    keep : sequence of str, optional
        Names of the tests to use. F0, force range, truncation, Ĉ and the two-ball rule stay those of the whole campaign.
    pilot : Campaign, optional
        Of a plan: the campaign whose F0, force range and Ĉ are used instead of the plan's own.

    Attributes
    ----------
    model, campaign, pilot : as given
    parameters : tuple of Parameter
        Compliances, their slopes degree by degree, geometric errors.
    test_names : tuple of str
    setting : Setting
    reduced : tuple of Reduced
    interest : ndarray, shape (tests, 25, p)
        H: columns of the parameters of interest.
    physical : Truncation
        The region of physical compliances, C(F) ≥ 0.
    truncation : Truncation
        The same where the prior imposes it, else the whole space.
    """

    def __init__(
        self, model: HybridModel, campaign: Campaign, *, keep: Sequence[str] | None = None, pilot: Campaign | None = None
    ) -> None:
        _check(model, campaign if pilot is None else pilot)
        self.model, self.campaign, self.pilot = model, campaign, pilot
        kept = kept_compliances(campaign.machine(), *dict.fromkeys(test.circle for test in campaign.scope))
        self.compliances: tuple[ComplianceName, ...] = kept.names
        self._kept = kept
        self.geometric_errors: tuple[GeometricName, ...] = geometric_errors_of(campaign)
        reduced = _reduced(campaign)
        whole = setting_of(campaign, self.compliances, model.reference_force_N, pilot=pilot)
        every = self._list_parameters(whole.force_range_N)
        check_known("fixed parameter", model.fixed, [parameter.name for parameter in every])
        self._free = np.array([parameter.name not in model.fixed for parameter in every])
        self.parameters = tuple(parameter for parameter in every if parameter.name not in model.fixed)
        self.physical = Truncation(self._physical_rows(campaign, whole.reference_force_N))
        self.truncation = self.physical if model.prior.truncated else Truncation(np.zeros((0, len(self.parameters))))
        estimate = self._estimate(whole, reduced) if pilot is None else self._estimate_of(pilot)
        whole = replace(whole, compliance_estimate=estimate)
        rows = _rows(campaign, keep)
        self.setting: Setting = whole.select(rows)
        self.reduced = tuple(reduced[i] for i in rows)
        self.test_names = tuple(campaign.tests[i].name for i in rows)
        self.interest = self._interest(self.setting)
        self.hyper_prior = model.prior.hyper(model.hypers, campaign.resolution_um)

    def keeping(self, names: Sequence[str]) -> BoundModel:
        """The same binding with only the named tests; campaign properties stay frozen."""
        return BoundModel(self.model, self.campaign, keep=names, pilot=self.pilot)

    def with_two_balls(self) -> BoundModel:
        """The same binding with a form for each ball, as other readings with the same balls need."""
        found = BoundModel(self.model, self.campaign, keep=self.test_names, pilot=self.pilot)
        found.setting = replace(found.setting, two_balls=True)
        return found

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of interest."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def terms(self) -> tuple[str, ...]:
        """Class names of the terms that act on this campaign: hysteresis needs both directions of travel."""
        idle = {type(term).__name__ for term in self.model.nuisances if not term.columns(self.setting)}
        return tuple(name for name in self.model.terms if name not in idle)

    def compliance_at(self, force_N: float, *, reference_force_N: float | None = None) -> Array:
        """Rows A with C(F) = A β, one per kept compliance, shape (compliances, p)."""
        reference = self.setting.reference_force_N if reference_force_N is None else reference_force_N
        labels = [name.label for name in self.compliances]
        rows = np.zeros((len(labels), len(self.parameters)))
        for column, parameter in enumerate(self.parameters):
            if parameter.group != "geometric":
                rows[labels.index(parameter.compliance), column] = (force_N - reference) ** parameter.degree
        return rows

    @cached_property
    def prior_sd(self) -> Array:
        """Prior sd of the parameters, shape (p,); infinite when flat."""
        return np.array([parameter.prior_sd for parameter in self.parameters])

    @cached_property
    def prior_mean(self) -> Array:
        """Prior mean of the parameters, shape (p,); zero when flat."""
        return np.array([parameter.prior_mean for parameter in self.parameters])

    @cached_property
    def scale(self) -> Array:
        """Typical size of every parameter, shape (p,): its prior sd, or the default prior's when flat."""
        if not self.model.prior.flat:
            return self.prior_sd
        return self._sd_of(Prior.default(), self.setting.force_range_N)[self._free]

    @cached_property
    def centre(self) -> Array:
        """Least-squares estimate about which densities are computed, shape (p,); the prior mean for a plan."""
        return self._fit(self.interest, self.prior_mean, self.scale, self.setting, self.reduced)

    @property
    def known_offset(self) -> Array:
        """Nominal mount deflection still in the readings (Eq. 32), shape (tests, 25) [mm]; zero when compensated."""
        return _mount_mean(self.setting)

    @cached_property
    def nuisance_columns(self) -> tuple[Columns | BasisNoise, ...]:
        """All nuisance columns, in the order of the model's terms."""
        return tuple(column for term in self.model.nuisances for column in term.columns(self.setting))

    @cached_property
    def given_interest(self) -> StructuredGaussian:
        """p(y | β, φ): nuisances integrated out. Coefficients are β − centre."""
        return self._structured(())

    @cached_property
    def collapsed(self) -> StructuredGaussian:
        """p(y | φ): nuisances and β integrated out, truncation left aside. The last shared coefficients are β − centre."""
        return self._structured((Columns(self.names, self.interest, self.prior_sd, mean=self.prior_mean - self.centre),))

    def log_likelihood(self, phi: Array, beta: Array) -> Array:
        """ln p(y | β, φ), shape (w,). φ (w, h) [mm], β (w, p)."""
        return self.given_interest.log_density(phi, beta - self.centre)

    def log_likelihood_per_test(self, phi: Array, beta: Array) -> Array:
        """ln p(y_r | other tests, β, φ), shape (w, tests): shared nuisances make tests dependent."""
        shifted = beta - self.centre
        return self.given_interest.log_density(phi, shifted)[:, None] - self.given_interest.log_density_without(phi, shifted)

    def log_prior(self, beta: Array) -> Array:
        """ln p(β), shape (...): −inf outside the truncation, its prior probability divided out; 0 when flat."""
        if self.model.prior.flat:
            return np.zeros(beta.shape[:-1])
        white = (beta - self.prior_mean) / self.prior_sd
        density = -0.5 * (white**2).sum(axis=-1) - np.log(self.prior_sd * np.sqrt(2 * np.pi)).sum()
        if not self.truncation.active:
            return np.asarray(density)
        return np.where(self.truncation.holds(beta), density - self.log_prob_truncation_prior, -np.inf)

    @cached_property
    def log_prob_truncation_prior(self) -> float:
        """ln P(T | prior); 0 without truncation. Compliances that share no parameter are independent."""
        if not self.truncation.active:
            return 0.0
        mean, spread = self.truncation.rows @ self.prior_mean, self.truncation.rows * self.prior_sd
        count, label = connected_components(np.abs(spread @ spread.T) > 0.0, directed=False)
        blocks = [(mean[None, label == k], spread[None, label == k]) for k in range(count)]
        values = [Orthant(*block).log_probability(1 << 14)[0][0] for block in blocks]
        return float(np.sum(values))

    def given(self, phi: Array) -> tuple[Array, ParameterConditional]:
        """ln p(y | φ), shape (w,), without its normalising constant when the prior is flat; and p(β | y, φ)."""
        log_evidence, shared = self.collapsed.conditional(phi, np.zeros(len(self.names)))
        p = len(self.names)
        return log_evidence, ParameterConditional(
            shared.mean[:, -p:] + self.centre, shared.precision_root[:, -p:, -p:], shared.scale[:, -p:], self.physical
        )

    def log_evidence(self, phi: Array) -> Array:
        """ln p(y | φ) alone, shape (w,); see `given`."""
        return self.collapsed.log_density(phi, np.zeros(len(self.names)))

    def _structured(self, extra: tuple[Columns, ...]) -> StructuredGaussian:
        columns = [term for term in self.nuisance_columns if isinstance(term, Columns)]
        offset = self.interest @ self.centre + self.known_offset
        shared = [replace(term, mean=None) for term in columns if not term.private]
        return StructuredGaussian(
            self.reduced,
            noise=[term for term in self.nuisance_columns if isinstance(term, BasisNoise)],
            private=[term for term in columns if term.private],
            shared=[*shared, *extra],
            interest=self.interest,
            offset=offset,
            hypers=self.model.hypers,
        )

    def _interest(self, setting: Setting) -> Array:
        by_degree = Compliance(self.model.degree).columns(setting)
        return np.concatenate([*by_degree, GeometricErrors().columns(setting)], axis=2)[:, :, self._free]

    def _estimate_of(self, pilot: Campaign) -> Array:
        """The pilot's Ĉ; what it does not know of, as for a plan."""
        known = BoundModel(self.model, pilot)
        labels = [name.label for name in known.compliances]
        return np.array(
            [
                known.setting.compliance_estimate[labels.index(name.label)] if name.label in labels else planned
                for name, planned in zip(self.compliances, self._planned(), strict=True)
            ]
        )

    def _planned(self) -> Array:
        """What no readings tell: the prior mean where the prior has one, else a usual machine's."""
        usual = {name.label: _PLANNED_COMPLIANCE if name.kind == "direct" else 0.0 for name in self.compliances}
        return np.array([self.model.prior.means.get(name, value) for name, value in usual.items()])

    def _estimate(self, setting: Setting, reduced: Sequence[Reduced]) -> Array:
        """Ĉ: least squares of [C, E] at degree 0 on the whole campaign, nearest to the prior mean in units of the prior sd."""
        if reduced[0].projection is None:
            return self._planned()
        columns = np.concatenate([Compliance(0).columns(setting)[0], setting.geometric], axis=2)
        prior = Prior.default() if self.model.prior.flat else self.model.prior
        compliance = self._compliance_sd(prior, 0, setting.force_range_N)
        scale = np.concatenate([compliance, prior.geometric_sd(self.geometric_errors)])
        names = [*(name.label for name in self.compliances), *(name.label for name in self.geometric_errors)]
        mean = np.array([self.model.prior.means.get(name, 0.0) for name in names])
        found = self._fit(columns, mean, scale, setting, reduced)[: len(self.compliances)]
        seen = np.abs(setting.wrench).max(axis=(0, 1)) > 0.0
        return np.where(seen, found, self._planned())

    @staticmethod
    def _fit(columns: Array, near: Array, scale: Array, setting: Setting, reduced: Sequence[Reduced]) -> Array:
        """Least squares; where not unique, what is closest to ``near`` in units of ``scale``. Of a plan, ``near`` itself."""
        if reduced[0].projection is None:
            return near
        mean = _mount_mean(setting)
        rows = np.concatenate([test.factor @ columns[r] for r, test in enumerate(reduced)])
        values = [np.asarray(test.projection) - test.factor @ mean[r] for r, test in enumerate(reduced)]
        return near + least_squares(rows, np.concatenate(values) - rows @ near, scale)

    def _list_parameters(self, force_range_N: float) -> tuple[Parameter, ...]:
        sd = self._sd_of(self.model.prior, force_range_N)
        if self.model.prior.flat:
            sd = np.full(len(sd), np.inf)
        names: list[tuple[str, str, Group, int]] = []
        for k in range(self.model.degree + 1):
            group: Group = "slope" if k else "compliance"
            suffix = f"_{k}" if k else ""
            names += [(c.label + suffix, compliance_unit(c, k), group, k) for c in self.compliances]
        names += [(name.label, geometric_unit(name.kind), "geometric", 0) for name in self.geometric_errors]
        self.model.prior.check_names([name for name, *_ in names])
        means = self.model.prior.means
        return tuple(Parameter(n, u, float(s), g, k, means.get(n, 0.0)) for (n, u, g, k), s in zip(names, sd, strict=True))

    def _sd_of(self, prior: Prior, force_range_N: float) -> Array:
        degrees = range(self.model.degree + 1)
        compliance = [self._compliance_sd(prior, k, force_range_N) for k in degrees]
        return np.concatenate([*compliance, prior.geometric_sd(self.geometric_errors)])

    def _compliance_sd(self, prior: Prior, degree: int, force_range_N: float) -> Array:
        """Prior sd of every kept compliance; what it has absorbed of dropped sets is added in quadrature, unless overridden."""
        own = prior.compliance_sd(self.compliances, degree, force_range_N)
        suffix = f"_{degree}" if degree else ""
        for k, (name, absorbed) in enumerate(zip(self.compliances, self._kept.absorbed, strict=True)):
            heads = [other for other in absorbed if other.label in self._kept.dependent]
            if heads and name.label + suffix not in prior.overrides:
                sd = prior.compliance_sd(heads, degree, force_range_N)
                own[k] = np.hypot(own[k], np.linalg.norm([absorbed[other] for other in heads] * sd))
        return own

    def _check_room(self, bounded: Sequence[int], at: Sequence[Array], reference_force_N: float) -> None:
        """Refuse a compliance fixed at zero at F0 whose free slope would make it negative on one side of F0."""
        for j in bounded:
            label = self.compliances[j].label
            slopes = [p for p in self.parameters if p.compliance == label and p.degree]
            signs = {float(np.sign(rows[j] @ [p in slopes for p in self.parameters])) for rows in at}
            if label in self.model.fixed and [p.degree for p in slopes] == [1] and {-1.0, 1.0} <= signs:
                raise InputError(
                    f"{label} must not be fixed at zero while {slopes[0].name} is free: about F0 = {reference_force_N:g} N C(F) "
                    f"would be negative on one side. Fix {slopes[0].name} too, or give a reference_force_N outside "
                    "the tested forces."
                )

    def _physical_rows(self, campaign: Campaign, reference_force_N: float) -> Array:
        """C(F) ≥ 0 for compliances that are a deflection under the force itself, at every tested force that can bind."""
        forces = np.unique(campaign.forces_N)
        if self.model.degree == 0:
            forces = forces[:1]
        elif self.model.degree == 1:
            forces = forces[[0, -1]]
        bounded = np.flatnonzero(self._kept.not_negative).tolist()
        at = [self.compliance_at(force, reference_force_N=reference_force_N) for force in forces]
        self._check_room(bounded, at, reference_force_N)
        rows = [tuple(rows[j]) for j in bounded for rows in at]
        return np.array([row for row in dict.fromkeys(rows) if any(row)]).reshape(-1, len(self.parameters))


def _check(model: HybridModel, campaign: Campaign) -> None:
    levels = campaign.force_levels
    if levels == 1 and model.degree >= 1:
        raise InputError(
            f"degree ≥ 1 must have at least two force levels, got one ({campaign.forces_N[0]:g} N). "
            "Use degree 0 (--degree 0), or add tests at another force."
        )
    if levels == 1 and model.prior.flat:
        raise InputError(
            f"flat priors must have at least two force levels, got one ({campaign.forces_N[0]:g} N): constant compliance and "
            "geometry cannot be separated. Use the default preset or add tests at another force."
        )
    if model.prior.flat and levels < model.degree + 2:
        raise InputError(
            f"flat priors at degree {model.degree} must have at least {model.degree + 2} force levels, got {levels}: "
            "compliance and geometry cannot be separated. Use the default preset, a lower degree, or add tests at another force."
        )


def _rows(campaign: Campaign, keep: Sequence[str] | None) -> list[int]:
    if keep is None:
        return list(range(len(campaign.tests)))
    chosen = campaign.select(keep)
    names = {test.name for test in chosen.tests}
    return [i for i, test in enumerate(campaign.tests) if test.name in names]


def _reduced(campaign: Campaign) -> tuple[Reduced, ...]:
    """The reduced readings, computed once while the campaign lives: comparisons bind it to hundreds of models."""
    if campaign not in _KEPT:
        plan = campaign.is_plan
        _KEPT[campaign] = tuple(
            reduce_readings(test.angles_rad(), None if plan else test.readings_mm()) for test in campaign.tests
        )
    return _KEPT[campaign]


def _mount_mean(setting: Setting) -> Array:
    mean = np.zeros((setting.tests, SIZE))
    if not setting.compensated:
        mean[:, 0] = setting.pressure_bar * setting.deflection_um_per_bar * 1e-3
    return mean
