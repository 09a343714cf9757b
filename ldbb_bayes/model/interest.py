"""The parameters of interest β of a campaign: compliances, their slopes and geometric errors.

A slope is the change of a compliance with force: C(F) = C_0 + C_1 (F − F0) + C_2 (F − F0)², where
F0 is the reference force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.machine.linear import Kept
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName
from ldbb_bayes.model.parameter_kinds import compliance_unit, geometric_unit
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.results import Array

__all__ = [
    "Group",
    "Parameter",
    "ParametersOfInterest",
    "compliance_rows",
    "interest_columns",
    "physical_rows",
]

Group = Literal["compliance", "slope", "geometric"]
# The prior sd of a slope is proportional to the magnitude of the estimated compliance. This
# magnitude is taken to be at least the typical magnitude of the compliance (usually its prior sd)
# divided by this number.
_SD_PER_LEAST_SIZE = 20.0


@dataclass(frozen=True)
class Parameter:
    """Parameter of interest: a compliance, its change with force (slope), or a geometric error."""

    name: str
    #: unit of a parameter of interest in all computations (internal unit), made of mm, N and rad;
    #: for a compliance such as C_XXX, it is mm/N
    unit: str
    #: standard deviation of the prior of a parameter of interest, in internal units (mm, N, rad);
    #: infinite if the prior is flat
    prior_sd: float
    group: Group
    #: exponent k of the factor (F − F0)^k by which a slope is multiplied; F is the force and F0 the
    #: reference force. The exponent is 0 for compliances and geometric errors.
    degree: int = 0
    #: mean of the prior of a parameter of interest, in internal units (mm, N, rad); zero if the
    #: prior is flat
    prior_mean: float = 0.0

    @property
    def compliance(self) -> str:
        """Name of the compliance to which a slope belongs: C_XXX for C_XXX_1.

        For a compliance or a geometric error, it is the name of the parameter itself.
        """
        return self.name.removesuffix(f"_{self.degree}") if self.degree else self.name


class _Row(NamedTuple):
    """The name, the unit, the kind and the degree of a parameter of interest, without its prior.

    The degree is the power of the bar force that multiplies the parameter when a compliance is
    written as a polynomial in force; it is 0 for geometric errors.
    """

    name: str
    unit: str
    group: Group
    degree: int


@dataclass(frozen=True)
class ParametersOfInterest:
    """Parameters of interest β = (C_0, C_1, …, E) of a campaign, including those fixed at zero.

    C_0 are the compliances at the reference force, C_1 and C_2 their slopes (linear and quadratic
    change with force) and E the geometric errors. ``degree`` is the degree of the compliance as a
    polynomial in force: 0, 1 or 2.
    """

    degree: int
    #: the compliances that the campaign's circles can separate; each also represents those
    #: compliances that circles cannot distinguish from it
    visible: Kept
    geometric_errors: tuple[GeometricName, ...]

    @property
    def compliances(self) -> tuple[ComplianceName, ...]:
        """Names of the compliances that circles can separate; names of slopes are not included."""
        return self.visible.names

    def with_prior(self, prior: Prior, setting: Setting) -> tuple[Parameter, ...]:
        """Return all parameters of interest with their prior means and sds.

        ``setting`` describes the test conditions. Raise an `InputError` if the prior names a
        parameter that the campaign does not have.
        """
        rows = self._parameters_without_prior()
        names = [row.name for row in rows]
        check_known("prior override", prior.overrides, names)
        check_known("prior mean", prior.means, names)
        parameters = []
        for row, sd in zip(rows, self.prior_sd(prior, setting).tolist(), strict=True):
            prior_sd = np.inf if prior.flat else sd
            mean = prior.means.get(row.name, 0.0)
            parameters.append(Parameter(row.name, row.unit, prior_sd, row.group, row.degree, mean))
        return tuple(parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters: compliances, their changes with force, then geometric errors."""
        return tuple(row.name for row in self._parameters_without_prior())

    def prior_mean(self, prior: Prior) -> Array:
        """Return the prior mean of all parameters of interest, shape (parameters,).

        The means are in internal units (mm, N, rad).
        """
        return np.array([prior.means.get(name, 0.0) for name in self.names])

    def _parameters_without_prior(self) -> list[_Row]:
        """Return the name, the unit, the kind and the degree of each of the p parameters.

        The degree is the power of the bar force that multiplies the parameter when a compliance is
        written as a polynomial in force; it is 0 for geometric errors.
        """
        rows = [
            _Row(name.label, compliance_unit(name), "compliance", 0) for name in self.compliances
        ]
        for degree in range(1, self.degree + 1):
            for name in self.compliances:
                unit = compliance_unit(name, degree)
                rows.append(_Row(f"{name.label}_{degree}", unit, "slope", degree))
        for error in self.geometric_errors:
            rows.append(_Row(error.label, geometric_unit(error.kind), "geometric", 0))
        return rows

    def prior_sd(self, prior: Prior, setting: Setting) -> Array:
        """Return the prior sd of all parameters of interest, shape (parameters,).

        The sds are in internal units (mm, N, rad). A prior sd that the user gave is used unchanged.
        The default prior sd of a slope is proportional to the magnitude of its compliance. This
        magnitude, which ``setting`` holds, is computed from the estimate of the compliance and its
        standard uncertainty, added in quadrature. It is taken to be at least 1/20 of the
        compliance's typical magnitude (usually its prior sd). In the model's first edition (preset
        ``first``), the prior sd of a slope is proportional to this typical magnitude instead.
        """
        size = self._with_dropped_sets(prior.compliance_size)
        if prior.slopes_of_estimate:
            size = np.maximum(setting.compliance_size_estimate, size / _SD_PER_LEAST_SIZE)
        blocks = [self.compliance_sd(prior)]
        for degree in range(1, self.degree + 1):
            blocks.append(prior.slope_sd(self.compliances, degree, setting.force_range_N, size))
        return np.concatenate([*blocks, prior.geometric_sd(self.geometric_errors)])

    def compliance_sd(self, prior: Prior) -> Array:
        """Return the prior sd of every compliance, shape (compliances,), in mm, N and rad.

        The model omits some compliances of the machine, because their effect on the readings is a
        linear combination of the effects of compliances in the model. The estimates of the
        compliances in the model then also contain a share of the omitted ones. The prior sds are
        therefore increased by contributions of the omitted compliances. Only a prior sd that the
        user gave is used unchanged.
        """
        overridden = [name.label in prior.overrides for name in self.compliances]
        with_dropped_sets = self._with_dropped_sets(prior.compliance_sd)
        return np.where(overridden, prior.compliance_sd(self.compliances), with_dropped_sets)

    def _with_dropped_sets(self, size_of: Callable[[Sequence[ComplianceName]], Array]) -> Array:
        """Return prior sds or typical magnitudes, increased for compliances that the model omits.

        The result has one element for each compliance of the model, shape (compliances,).
        ``size_of`` is a function that returns the prior sds, or the typical magnitudes, for given
        names of compliances. The estimate of a compliance in the model also contains a weighted sum
        of omitted compliances (weights: `Kept.absorbed`). The prior sd or magnitude of each omitted
        compliance is therefore multiplied by its weight and added in quadrature to that of the
        compliance in the model. If several omitted compliances change the readings in proportion to
        each other, only one of them is added.
        """
        sizes = size_of(self.compliances)
        for k, absorbed in enumerate(self.visible.absorbed):
            left_out = [name for name in absorbed if name.label in self.visible.dependent]
            if left_out:
                weights = np.array([absorbed[name] for name in left_out])
                sizes[k] = np.hypot(sizes[k], np.linalg.norm(weights * size_of(left_out)))
        return sizes


def interest_columns(setting: Setting, degree: int) -> Array:
    """Return the effects of all parameters of interest on the readings of every test.

    The result has the shape (tests, 25, parameters). An effect is the change of the reading per
    unit of the parameter, as 25 Fourier coefficients. For a compliance it is F j_C, where F is the
    force and j_C the reading per unit force and per unit of the compliance. For the slope of degree
    k of this compliance, it is F (F − F0)^k j_C, where F0 is the reference force. For a geometric
    error it is j_G, the reading per unit of the error. ``setting`` describes the test conditions.
    Each compliance is a polynomial in force of the degree ``degree``.
    """
    lever = setting.force_N - setting.reference_force_N
    columns = []
    for k in range(degree + 1):
        factor = setting.force_N * lever**k
        columns.append(factor[:, None, None] * setting.elastic)
    return np.concatenate([*columns, setting.geometric], axis=2)


def compliance_rows(
    compliances: Sequence[ComplianceName], parameters: Sequence[Parameter], lever_N: float
) -> Array:
    """Return the matrix A with C(F) = A β at one force F, shape (compliances, p).

    C(F) are the compliances at this force, and β the p parameters of interest: compliances at the
    reference force F0, their slopes, and geometric errors.

    Parameters
    ----------
    compliances
        The compliances, one for each row.
    parameters
        The parameters β, one for each column.
    lever_N
        F − F0, the force minus the reference force [N].
    """
    labels = [name.label for name in compliances]
    rows = np.zeros((len(labels), len(parameters)))
    for column, parameter in enumerate(parameters):
        if parameter.group != "geometric":
            row = labels.index(parameter.compliance)
            rows[row, column] = lever_N**parameter.degree
    return rows


def physical_rows(
    interest: ParametersOfInterest,
    parameters: Sequence[Parameter],
    levers_N: Sequence[float],
    reference_force_N: float,
) -> Array:
    """Return the matrix A of the conditions A β ≥ 0 on the parameters β, shape (rows, p).

    The conditions exclude negative values of those compliances that are deflections in the
    direction of the load itself. The product of a row of A and β is the value C(F) of such a
    compliance at one force F. Raise an `InputError` if a compliance is fixed at zero but has a free
    slope that would make the compliance negative on one side of the reference force F0.

    Parameters
    ----------
    interest
        All parameters of interest, including those that are fixed at zero.
    parameters
        The p parameters β that are not fixed, one for each column of A.
    levers_N
        F − F0 for every force F at which C(F) ≥ 0 is required [N].
    reference_force_N
        Reference force F0 [N], for the error message.
    """
    at_forces = [compliance_rows(interest.compliances, parameters, lever) for lever in levers_N]
    # The rows of the matrix A in the conditions A β ≥ 0 (no compliance is negative) are stored as
    # keys of a dictionary, which keeps their order and removes duplicates.
    rows: dict[tuple[float, ...], None] = {}
    for j in np.flatnonzero(interest.visible.not_negative):
        label = interest.compliances[j].label
        rows_of_compliance = [matrix[j] for matrix in at_forces]
        _check_slope_has_compliance(label, parameters, rows_of_compliance, reference_force_N)
        for row in rows_of_compliance:
            if row.any():
                rows[tuple(row)] = None
    return np.array([*rows]).reshape(-1, len(parameters))


def _check_slope_has_compliance(
    label: str, parameters: Sequence[Parameter], rows: Sequence[Array], reference_force_N: float
) -> None:
    """Raise an `InputError` if a compliance that is fixed at zero would be negative at some force.

    A compliance that is fixed at zero is zero at the reference force, but changes with force if its
    slope is free. If only the linear slope is free, and there are tested forces on both sides of
    the reference force, the compliance is negative on one side. ``label`` is the name of the
    compliance, and ``parameters`` are the p parameters that are not fixed. ``rows`` holds one array
    of shape (p,) for each tested force; the product of this array and the parameters is the
    compliance at the force. ``reference_force_N`` is the reference force F0 [N], for the error
    message.
    """
    belongs_to_compliance = [
        parameter.group != "geometric" and parameter.compliance == label for parameter in parameters
    ]
    degrees = [
        parameter.degree
        for parameter, belongs in zip(parameters, belongs_to_compliance, strict=True)
        if belongs
    ]
    only_linear_slope_is_free = degrees == [1]
    if not only_linear_slope_is_free:
        return
    signs = {float(np.sign(row @ belongs_to_compliance)) for row in rows}
    require(
        not {-1.0, 1.0} <= signs,
        f"{label} must not be fixed at zero while {label}_1 is free: about F0 ="
        f" {reference_force_N:g} N C(F) would be negative on one side. Fix"
        f" {label}_1 too, or give a reference_force_N outside the tested forces.",
    )
