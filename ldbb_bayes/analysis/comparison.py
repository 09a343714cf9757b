"""Result of a comparison of models of one campaign by their evidences.

The posterior probability of a model M given the readings y is p(M | y) ∝ p(y | M) p(M). The
evidence p(y | M) is the density of the readings under the model, averaged over the prior of the
parameters. The ratio of two evidences is the Bayes factor B; ln B is stated in nats (1 nat is a
factor e).

The elpd (expected log predictive density) of a model states how well it predicts readings that were
left out. Here the elpd is the sum, over the tests r, of ln p(y_r | y_−r): the log density of test r
given all other tests. Slopes are changes of compliances with force.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS
from ldbb_bayes.analysis.rival_explanations import Explanations
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE, Assumed
from ldbb_bayes.analysis.varying_slopes import Curve, SlopeSubset, VaryingSlope
from ldbb_bayes.results import Finite, Number, Records, Result, read_result
from ldbb_bayes.units import ranked

__all__ = [
    "DEFAULT_TOLERANCE",
    "REJECTED",
    "ComparedModel",
    "ComparedTest",
    "Comparison",
    "Sign",
    "read_comparison",
]

# Limit at which the readings reject an assumption [nat]. Every model makes an assumption about what
# differs at random from circle to circle, for example the position of the set-up. The models are
# also compared under alternative assumptions. An alternative is rejected if its log evidence is at
# least this number below that of the assumption that the models make.
REJECTED = 5.0
# Largest error of a log evidence that a comparison allows if the caller states none [nat].
DEFAULT_TOLERANCE = 1e-2


class Sign(StrEnum):
    """Whether the sign of a log Bayes factor holds under other priors and model assumptions."""

    OPEN = "depends on assumptions that the readings allow"
    HELD = "holds but for assumptions that the readings reject"
    FIRM = "holds under every assumption"


@dataclass(frozen=True)
class ComparedCampaign:
    """The campaign of a comparison: its name, and the SHA-256 digest of its readings."""

    name: str
    sha256: str


@dataclass(frozen=True)
class ParameterEstimate:
    """Posterior mean and standard deviation of a parameter, in a unit composed of mm, N and rad."""

    unit: str
    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """Evidence, fit and parameter estimates of one of the compared models.

    ``degree`` is the degree of the compliances as polynomials of force: 0 is constant, 1 is linear.
    Log evidence and its error are in nats.
    """

    log_evidence: float
    log_evidence_error: Finite
    posterior_probability: float
    #: estimate of the expected log predictive density (elpd) by cross-validation [nat]: each test
    #: is predicted from all other tests, and the log densities of the tests under these predictions
    #: are added. NaN if no cross-validation was made. ``lofo`` in the name stands for "leave one
    #: force out", but what is left out is one test at a time, even if other tests have the same
    #: force.
    elpd_lofo: Number
    #: standard error of the expected log predictive density ``elpd_lofo`` [nat], from the standard
    #: deviation of the log densities of the tests
    elpd_lofo_se: Number
    #: root-mean-square residual [µm] of the posterior mean prediction (Eq. 34 of the article on
    #: which the model is based). The prediction includes the effects of the machine, and the
    #: nuisance effects that act in several tests.
    rmse_um: float
    #: root-mean-square residual of a least-squares fit [µm]. The article on which the model is
    #: based defines the fit (Eq. 31) and the root-mean-square residual (Eq. 34). NaN if the tests
    #: have too few different forces for the fit.
    least_squares_rmse_um: Number
    degree: int
    parameters: dict[str, ParameterEstimate]
    compliance_against_force: dict[str, Curve]


@dataclass(frozen=True, eq=False)
class ComparedTest:
    """One test of a campaign, predicted from the other tests.

    In the names of fields, ``lofo`` stands for "leave one force out". These fields compare the
    readings of one test with their prediction from all other tests, even if other tests have the
    same force. `JudgedTest` explains the p-values, ``lofo_worst_order`` and ``flag``.
    """

    force_N: float
    #: log density of the test's readings given all other tests [nat], under each model; the keys
    #: are names of models
    lofo_log_density: dict[str, float]
    lofo_p_value: float
    lofo_family_wise_p_value: float
    lofo_worst_order: int
    lofo_p_value_by_order: dict[int, float]
    flag: bool

    @property
    def stands_out(self) -> bool:
        """Return whether the test deviates clearly from what the other tests predict.

        This is the case if the family-wise p-value is below 2 %. Even then, the test is not flagged
        (``flag`` is false) if half of the tests or more would be flagged, because nothing shows
        which tests are wrong.
        """
        return self.lofo_family_wise_p_value < FALSE_ALARMS


@dataclass(frozen=True)
class ScaledSlopes:
    """Log Bayes factor of two models for one prior of the slopes, and its numerical error [nat].

    The prior standard deviation of this change, over the range of force, is ``slope_scale`` times a
    reference value of the compliance. `Prior` defines the reference value.
    """

    slope_scale: float
    log_bayes_factor: float
    error: Finite


@dataclass(frozen=True)
class Difference:
    """Sum of log predictive densities, or of their differences between two models [nat].

    ``value`` is the sum over the tests of a campaign. ``se`` is the standard error of the sum,
    computed from the standard deviation of the summands.
    """

    value: Number
    se: Number


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Result of a comparison of models of one campaign, by evidence and by prediction.

    Logarithms are natural; parameters are in internal units (mm, N, rad).

    Examples
    --------
    >>> models = {"constant": lb.HybridModel.first(0), "linear": lb.HybridModel.first(1)}
    >>> comparison = lb.compare(models, campaign, evidence_only=True, tolerance=0.1)
    >>> round(comparison.models["constant"].posterior_probability, 2)
    1.0
    >>> comparison.sign.value
    'depends on assumptions that the readings allow'
    """

    campaign: ComparedCampaign  #: name of the campaign and SHA-256 digest of its readings
    #: results of each compared model, by the name that the caller gave to the model
    models: dict[str, ComparedModel]
    #: log Bayes factor ln B of every other model over the first model [nat]. The keys have the form
    #: "linear/constant", where "constant" is the name of the first model.
    log_bayes_factor: dict[str, float]
    #: numerical error of each log Bayes factor [nat]; the keys are those of ``log_bayes_factor``
    log_bayes_factor_error: dict[str, Finite]
    #: expected log predictive density of tests left out: its value for every other model minus its
    #: value for the first model [nat]. The keys are those of ``log_bayes_factor``. Empty if no test
    #: was left out.
    elpd_difference: dict[str, Difference]
    #: names of the first two of the compared models, written as "second/first". The log Bayes
    #: factors of the second model over the first are also computed under other priors and
    #: assumptions.
    sensitivity_of: str
    #: log Bayes factor of the second model over the first, for narrower and wider priors of the
    #: slopes. Empty if neither model has slopes, or if the two models differ only in this prior.
    prior_sensitivity: tuple[ScaledSlopes, ...]
    #: widths of the slopes' prior, stated as ``slope_scale``, at which the log Bayes factor of the
    #: second model over the first changes sign.
    prior_sensitivity_crossings: tuple[float, ...]
    #: log Bayes factors of the second model over the first, in this order: (1) under the models'
    #: own assumption about the random differences between circles; (2) if ``explanations`` is not
    #: None, two values: averaged over all combinations of alternative explanations, and without any
    #: of them; (3) under other assumptions about the random differences; (4) for models without
    #: nuisance terms (effects not of interest), in which circles differ by white noise alone. An
    #: alternative explanation is an effect, such as a nonlinear mount, that changes the readings in
    #: a similar way to a change of compliance with force.
    discrepancy_sensitivity: tuple[Assumed, ...]
    #: posterior probability that each compliance changes with force, by name of the compliance;
    #: empty if compliance is constant in all compared models, or if only evidences were computed
    slopes: dict[str, VaryingSlope]
    #: models that differ in which of the compliances change with force, the most probable model
    #: first. If there are too many such models, only some are compared. Empty if compliance is
    #: constant in all compared models, or if only evidences were computed.
    slope_subsets: tuple[SlopeSubset, ...]
    #: curve of each compliance C(F) against the force F, averaged over models that differ in which
    #: of the compliances change with force. The keys are the names of the compliances. Empty if
    #: ``slopes`` is empty.
    compliance_against_force: dict[str, Curve]
    #: comparison of each test with its prediction from the other tests; the keys are the names of
    #: the tests. Empty if no cross-validation was made.
    tests: dict[str, ComparedTest]
    #: table of compliances that are fitted separately to each pair of neighbouring forces and taken
    #: as constant within the pair, as the function `local_fits` returns it. Empty if all tests have
    #: the same force, or if only evidences were computed.
    local_fits: Records
    #: largest error allowed for a log evidence [nat]. The log evidences of the first two models are
    #: also computed under other assumptions about the random differences between circles. Under an
    #: assumption that the readings clearly reject, an error of 0.1 nat is allowed, even if
    #: ``tolerance`` is smaller. An assumption is clearly rejected if it lowers the larger of the
    #: two log evidences by at least 10 nat.
    tolerance: float
    #: largest error of any log evidence [nat]. Log evidences under assumptions that the readings
    #: clearly reject are only rough, and are left out here (see ``tolerance``).
    largest_error: Finite
    #: number of model evidences whose error is infinite, because the quadrature weights are not
    #: reliable. The field has kept its name from an older version, because other programs read this
    #: name in the JSON file.
    by_emcee: int = 0
    #: probability of each explanation of why compliance seems to change with force: a true change
    #: (slopes), or another effect that influences the readings in a similar way, such as a
    #: nonlinear mount. The field is None unless two conditions hold: the second model is the first
    #: model with slopes added, and it contains at least one such other effect.
    explanations: Explanations | None = None
    #: whether ``slope_scale`` is relative to the estimate of the compliance; if false, it is
    #: relative to the prior standard deviation of the compliance, as in the model's first edition
    slopes_of_estimate: bool = True

    @property
    def pair(self) -> tuple[str, str]:
        """Return the names of the first two of the compared models.

        These two models are also compared under other priors and assumptions.
        """
        first, second, *_ = self.models
        return first, second

    @property
    def headline(self) -> tuple[float, float]:
        """Return the log Bayes factor of the second model over the first, and its error [nat].

        Alternative explanations are effects, such as a nonlinear mount, that influence the readings
        in a similar way to slopes. If the comparison includes alternative explanations, the log
        Bayes factor is averaged over them.
        """
        if self.explanations is None:
            return (
                self.log_bayes_factor[self.sensitivity_of],
                self.log_bayes_factor_error[self.sensitivity_of],
            )
        averaged = self.explanations.averaged
        return averaged.log_bayes_factor, averaged.log_bayes_factor_error

    @property
    def within_tolerance(self) -> bool:
        """Return whether the largest error of any log evidence is at most ``tolerance``.

        The models are also compared under other assumptions about the differences between circles.
        Log evidences under an assumption that the readings clearly reject are computed only
        roughly, and are not considered here.
        """
        return self.largest_error <= self.tolerance

    @property
    def has_default_tolerance(self) -> bool:
        """Return whether ``tolerance`` is the default, so that no caller need have asked for it."""
        return self.tolerance == DEFAULT_TOLERANCE

    def gain(self, assumed: Assumed) -> float:
        """Return by how much the log evidence is larger under another assumption [nat].

        The assumption is about the random differences between circles. ``assumed`` holds the log
        evidences of the first two of the compared models under this assumption. The result is the
        larger of these two log evidences, minus the larger of the two log evidences under the
        assumption that the models themselves make. It is negative if the readings favour the
        models' own assumption.
        """
        return assumed.best - self.discrepancy_sensitivity[0].best

    def turning(self) -> list[Assumed]:
        """Return the assumptions that change the sign of the log Bayes factor.

        The assumptions are about the random differences between circles. Under the assumption that
        the models make, the log Bayes factor of the second model over the first is `headline`;
        under the returned assumptions, it has the opposite sign. The assumption that white noise is
        the only random difference is never returned. The assumption with the largest log evidence
        comes first.
        """
        opposite_sign = -np.sign(self.headline[0])
        turning = []
        for assumed in self.discrepancy_sensitivity:
            turns = np.sign(assumed.log_bayes_factor) == opposite_sign
            if turns and assumed.assumption != WHITE_NOISE:
                turning.append(assumed)
        return ranked(turning, self.gain)

    def allowed(self, assumed: Assumed) -> bool:
        """Return whether the readings allow an assumption about random differences between circles.

        The first two of the compared models make an assumption of their own; ``assumed`` holds
        their log evidences under a different assumption. For each of the two assumptions, the log
        evidence of the better model is taken. The readings allow the different assumption if this
        value is less than 5 nat below the value for the models' own assumption.
        """
        return self.gain(assumed) > -REJECTED

    @property
    def sign(self) -> Sign:
        """Return whether the sign of the log Bayes factor holds under other assumptions.

        The log Bayes factor of the second model over the first is `headline`. The other assumptions
        are about the random differences between circles, and about the prior of the slopes.
        """
        turning = self.turning()
        if self.prior_sensitivity_crossings or any(map(self.allowed, turning)):
            return Sign.OPEN
        if turning:
            return Sign.HELD
        return Sign.FIRM

    def preferred_assumption(self) -> Assumed | None:
        """Return an assumption that fits the readings clearly better than the models' own, or None.

        The assumptions are about the random differences between circles. The assumption with the
        largest log evidence is returned if its log evidence exceeds that of the models' own
        assumption by more than 5 nat. Otherwise, None is returned. White noise alone is left out:
        it also drops all effects of the instrument, which act whether the readings show them or
        not.
        """
        candidates = [
            assumed for assumed in self.discrepancy_sensitivity if assumed.assumption != WHITE_NOISE
        ]
        best = ranked(candidates, lambda assumed: assumed.best)[0]
        return best if self.gain(best) > REJECTED else None


def read_comparison(path: str | os.PathLike[str]) -> Comparison:
    """Read the comparison in a folder written by ``ldbb-bayes compare --out``.

    Parameters
    ----------
    path : str or os.PathLike
        Folder, or its file ``comparison.json``.

    Returns
    -------
    Comparison
        Comparison as `compare` returned it.

    Raises
    ------
    InputError
        If the file is missing, damaged, or not written by this package.

    Examples
    --------
    >>> comparison = lb.analysis.read_comparison("comparison")  # doctest: +SKIP
    """
    return read_result(path, "comparison", "compare", Comparison.from_dict)
