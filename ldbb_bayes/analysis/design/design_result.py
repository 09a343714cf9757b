"""Result of a design: the tests of the next campaign, and what they are expected to show.

A clocking is the pair of angles by which the two balls are turned in their sockets. A pilot is the
campaign or plan that a design starts from. The share of a candidate test is its number of runs
divided by the number of all runs. The best shares are computed as if fractions of a run were
possible. The efficiency of a design compares its criterion, such as the expected information gain,
with that of the best shares. It is 1 if the design is equally good, and smaller if the design is
worse.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Annotated, Any

import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Degeneracy
from ldbb_bayes.analysis.cures import Cure
from ldbb_bayes.analysis.design.forecast import Expected, Forecast
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.results import Records, Result, read_result, readable

__all__ = ["Certificate", "Design", "Judged", "Limits", "Pilot", "Planned", "read_design"]


@dataclass(frozen=True)
class Certificate(Result):
    """Optimality certificate: whether the shares of candidate tests are proven to be optimal.

    A candidate is a test that could be run; its share is its number of runs divided by the number
    of all runs. The criterion is the figure of merit that the design maximises. The sensitivity of
    a candidate is the derivative of the criterion with respect to the candidate's share. The bound
    is the mean of the sensitivities, weighted by the shares. By Kiefer and Wolfowitz (1960), the
    shares are optimal if no sensitivity exceeds the bound. ``holds`` is true if the largest
    sensitivity exceeds the bound by at most 0.01 %. For criterion D with flat priors, the bound is
    the number of parameters. If the criterion is not concave, ``is_global`` is false: the
    certificate then proves only that no small change of the shares is an improvement.
    """

    #: largest sensitivity of all candidate tests. The sensitivity of a candidate is the derivative
    #: of the design criterion with respect to the candidate's share of all runs.
    max_sensitivity: float
    #: mean of the sensitivities of the candidate tests (derivatives of the design criterion),
    #: weighted by the candidates' shares. The share of a candidate is its number of runs divided by
    #: the number of all runs.
    bound: float
    is_global: Annotated[bool, Field(alias="global")]
    holds: bool


@dataclass(frozen=True, eq=False)
class Judged(Forecast):
    """A design that is compared with the recommended design, and the forecast of its results."""

    name: str
    #: table of the tests of the compared design, one row per test. The columns are force_N and
    #: those that `Design.columns` names.
    tests: Records
    #: efficiency of the compared design, computed with the criterion by which the recommended
    #: design was chosen. It is 1 if no choice of equally many tests from the candidates would be
    #: better, and 0 if the compared design does not determine all parameters.
    efficiency: float


@dataclass(frozen=True)
class Limits(Result):
    """Weaknesses of a design that more runs of the same tests would not remove."""

    #: number of different forces of the tests, if it is too small to show whether the compliances
    #: are polynomials in force of a higher degree than in the model. None if it is large enough, or
    #: if the tests are analysed together with tests that have already been run.
    levels: int | None
    #: direction of travel of each plane whose circles all run in the same direction although the
    #: model includes hysteresis; the keys are the planes
    one_way: dict[str, str]
    #: whether drift may make the results worse than forecast. This is true if the model includes
    #: drift, and the machine may have drifted in the campaign that the design starts from. The
    #: forecast assumes that drift does not depend on the settings of the tests.
    drift: bool
    #: parameters whose expected standard deviation would decrease by less than 20 % even if every
    #: test were run very many times. Those in ``not_shown`` are left out.
    shared: tuple[str, ...]
    #: combinations of coefficients of the model whose effects cancel in every reading. Each
    #: combination contains at least one of the parameters in ``shared``.
    degeneracies: tuple[Degeneracy, ...]
    #: ways to separate the coefficients of each combination in ``degeneracies``: kinds of further
    #: tests, or a calibration. The entries have the order of ``degeneracies``.
    cures: tuple[tuple[Cure, ...], ...]
    #: parameters that have no effect on any of the tests, such as the offsets of the tool ball in a
    #: set-up in which none of the tests is run
    not_shown: tuple[str, ...] = ()


@dataclass(frozen=True)
class Pilot(Result):
    """Name and digest (SHA-256) of the campaign or plan that a design starts from."""

    name: str
    sha256: str


@dataclass(frozen=True)
class Planned:
    """Recommended tests, the tests that they were chosen from, and the model for the analysis."""

    tests: tuple[CircularTest, ...]
    space: Space
    model: HybridModel


@dataclass(frozen=True, eq=False, repr=False)
class Design(Forecast):
    """Design of the next campaign: the recommended tests and the forecast of their results.

    Examples
    --------
    >>> model = lb.HybridModel.first(0)
    >>> best = lb.design(model, campaign, tests=3, forces_N=(36.0, 742.0))
    >>> best.certificate.holds  # no other distribution of the tests over the forces is better
    True
    >>> best.expected["C_XXX"].sd < best.expected["C_XXX"].prior_sd
    True
    >>> sorted(test.force_N for test in best.plan(seed=1).tests)
    [36.0, 742.0, 742.0]
    """

    #: criterion that the design optimizes, such as ``eig`` (expected information gain)
    criterion: str
    #: names of the parameters of interest, for which the design is made; all other parameters are
    #: nuisance parameters
    parameters: tuple[str, ...]
    #: table of the recommended tests, with one row for each different test. The columns are
    #: force_N, those that `columns` names, and count, which is the number of times to run the test.
    table: Annotated[Records, Field(alias="tests")]
    #: whether the recommended tests are analysed together with the tests of the campaign that the
    #: design starts from
    augment: bool
    degree: int  #: degree of the model's compliances as polynomials of force
    #: reference force F0 of the campaign or plan that the design starts from [N]
    reference_force_N: float
    #: efficiency of the design, computed with the criterion by which it was chosen. It is 1 if the
    #: design is as good as the optimal ``shares`` of the candidate tests, and smaller if it is
    #: worse.
    efficiency: float
    #: optimality certificate: it states whether it is proven that no other shares of the candidate
    #: tests give a better value of the design criterion than ``shares``
    certificate: Certificate
    #: best shares of the candidate tests, one row per candidate with a share above 0.0001. The
    #: share is the candidate's number of runs divided by the number of all runs. The columns are
    #: force_N, the columns that `columns` names, and share.
    shares: Records
    #: expected standard deviation of each parameter for a simple design with evenly spaced forces.
    #: All tests of this design have the same radius and the same clocking (pair of ball angles):
    #: the first radius and the first clocking that the search could choose. The keys are the names
    #: of the parameters.
    baseline: dict[str, Expected]
    #: designs that are compared with this one: a design with evenly spaced forces, and the
    #: campaigns that were given to `design` as ``against``
    compared: tuple[Judged, ...]
    #: weaknesses of the design that more runs of the same tests would not remove, such as too few
    #: different forces
    limits: Limits
    #: root mean square of each hyper-parameter (such as the standard deviation of the noise) over
    #: the values for which the forecast is computed. Lengths are in µm. Two kinds of
    #: hyper-parameters have no unit: the noise factor λ of each circle, by which the noise of the
    #: circle is multiplied, and the decay. The decay is the exponent of the power law by which the
    #: balls' form errors decrease with the number of waves per turn.
    hyper_um: dict[str, float]
    #: whether the hyper-parameters are estimated from the readings of the campaign that the design
    #: starts from; if not, their values come from the prior
    measured: bool
    pilot: Pilot  #: campaign or plan that the design starts from
    #: one row per candidate test. The columns are force_N, those named in `columns`, and
    #: sensitivity. The sensitivity is the derivative of the design criterion with respect to the
    #: candidate's share of all runs. It is computed for the best shares.
    sensitivity: Annotated[Records, Field(exclude=True)] = field(default_factory=pd.DataFrame)
    #: the recommended tests, the tests that they were chosen from, and the model for the analysis;
    #: None if the design was read from a file
    planned: Annotated[Any, Field(exclude=True)] = None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the table columns that describe a test, apart from ``force_N``.

        The columns are the angles by which the two balls are turned, and the radius. There are
        further columns for plane, direction and set-up if tests differ in these properties.
        """
        return tuple(str(column) for column in self.table.columns[1:-1])

    @property
    def tests(self) -> tuple[CircularTest, ...]:
        """The recommended tests; a test that is to be run several times is repeated.

        The tests have the order of the candidates (the tests that could be run): sorted by plane
        and direction, then by radius, angles of the balls, and force.
        """
        return self._require_planned().tests

    @property
    def model(self) -> HybridModel:
        """The model for the analysis of the recommended tests.

        The model takes its reference force F0, and the prior standard deviations of the slopes
        (changes of compliance with force), from the campaign or plan that the design starts from,
        not from the recommended tests.
        """
        return self._require_planned().model

    def plan(self, *, seed: int = 1) -> Campaign:
        """Return the recommended tests as a plan, in the order in which to run them.

        Tests with the same set-up, plane, radius and angles of the balls are run one after the
        other, in random order. The plan states no times. If the model includes a drift with time,
        the drift is taken to follow the order of the tests in the plan. If the model includes a
        drift with temperature, the temperature of the plan's tests is taken to be the mean
        temperature of the campaign that the design starts from.

        Parameters
        ----------
        seed
            Seed of the random order.

        Returns
        -------
        Campaign
            The plan.

        Raises
        ------
        InputError
            If the design was read from a file.
        """
        planned = self._require_planned()
        return planned.space.plan_of(planned.tests, seed=seed)

    def _require_planned(self) -> Planned:
        """Return the recommended tests, the tests that they were chosen from, and the model.

        Raise an `InputError` if the design was read from a file, because the file contains neither
        the tests nor the model.
        """
        if not isinstance(self.planned, Planned):
            raise InputError(
                "a design must be at hand, got one read from a file. Read the plan and the"
                " model.toml beside it."
            )
        return self.planned

    def expected_table(self) -> pd.DataFrame:
        """Return a table of the expected posterior standard deviations of the parameters.

        Returns
        -------
        pandas.DataFrame
            One row per parameter, in units composed of mm, N and rad. ``sd`` is the expected
            standard deviation. ``sd_error`` is the standard error of ``sd``, computed from the
            scatter of the result over the simulated machines. Three columns are for comparison:
            ``prior_sd`` is the prior standard deviation, ``floor_sd`` is the standard deviation
            that would remain if every planned test were run very many times, and ``baseline_sd`` is
            the standard deviation that is expected for a simple design, in which the forces of the
            tests are evenly spaced.
        """
        columns = ["unit", "prior_sd", "sd", "sd_error", "floor_sd"]
        frame = pd.DataFrame([vars(entry) for entry in self.expected.values()], columns=columns)
        frame.insert(0, "parameter", list(self.expected))
        baseline_sd = [self.baseline[name].sd for name in self.expected]
        return readable(frame.assign(baseline_sd=baseline_sd), "Expected sd")

    def __repr__(self) -> str:
        """Return a short text with the design's number of tests, efficiency and criterion."""
        return (
            f"Design of {self.table['count'].sum()} tests, efficiency {self.efficiency:.3f} by"
            f" criterion {self.criterion}"
        )


def read_design(path: str | os.PathLike[str]) -> Design:
    """Read the design in a folder written by ``ldbb-bayes design --out``.

    Parameters
    ----------
    path : str or os.PathLike
        Folder, or its file ``design.json``.

    Returns
    -------
    Design
        The design without its tests; the plan in the same folder contains them.

    Raises
    ------
    InputError
        If the file is missing, damaged, or not written by this package.

    Examples
    --------
    >>> best = lb.analysis.read_design("design")  # doctest: +SKIP
    """
    return read_result(path, "design", "design", Design.from_dict)
