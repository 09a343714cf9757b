"""Row of one campaign in the table of a batch: results of the fit, or the reason why it failed."""

from __future__ import annotations

import json
import os
import traceback
import warnings
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.analysis.compliance_meaning import stands_for
from ldbb_bayes.analysis.conformity import assess_conformity
from ldbb_bayes.analysis.directional_stiffness import stiffness_of_fit
from ldbb_bayes.analysis.posterior_verdicts import confounded_at
from ldbb_bayes.analysis.tolerances import (
    Quantity,
    check_stated_tolerances,
    name_in_plane,
    quantities_of,
    tolerances_in,
)
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import labels_of, read_campaign
from ldbb_bayes.campaign.placed_circles import placed_circles
from ldbb_bayes.campaign.preview import check_campaign
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.errors import LONGEST_MESSAGE, InputError, check_known, plain_reason
from ldbb_bayes.fleet.campaign_statistics import sufficient_statistics
from ldbb_bayes.fleet.dataset import PARAMETER_COLUMNS
from ldbb_bayes.fleet.linear_or_constant import linear_over_constant
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.sample import FittedModel, fit_model
from ldbb_bayes.inference.summary import interval_numbers
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256
from ldbb_bayes.parallel import one_blas_thread, versions
from ldbb_bayes.report.fit_description import words_of_fit
from ldbb_bayes.report.wording import remark_words
from ldbb_bayes.units import inside_name

__all__ = ["Job", "Settings", "check_tolerances", "failed_row", "fit_row"]

# Error allowed in each of the two log evidences from which a campaign's Bayes factor is computed
# [nat]. The error of the log Bayes factor is then at most 0.1 nat, too little to change a decision
# between constant and linear compliance.
_EVIDENCE_TOLERANCE = 0.05
# Attributes of `Campaign` that are copied into columns of a batch's table with the same names.
_CAMPAIGN_COLUMNS = (
    "name",
    "sha256",
    "circles_sha256",
    "machine_id",
    "date",
    "topology",
    "readings",
)
# Kinds of remarks on readings that make the results of a fit wrong without any sign of it in the
# fit: two tests with the same readings, and a test whose readings have the other sign.
_ODD_READINGS = (RemarkKind.COPY, RemarkKind.MIRRORED)


@dataclass(frozen=True)
class Settings:
    """Settings with which every campaign of a batch is fitted."""

    model_toml: str  #: TOML text of the model that is fitted to every campaign of a batch
    #: name of the sampler that every fit uses: ``independent`` or ``joint``
    sampler: str = "independent"
    seed: int = 1  #: seed of the random draws of every fit of a batch
    ess: float = 1000.0  #: effective sample size that every fit of a batch aims to reach
    prob: float = 0.95  #: probability of the credible intervals of every fit of a batch
    #: whether the Bayes factor of linear over constant compliance is computed for every campaign
    compare: bool = True
    #: values of fields of `Campaign`, for campaigns in tidy CSV files, which cannot state these
    #: fields; the keys are the names of the fields
    table: Mapping[str, Any] = field(default_factory=dict)
    #: fields of `Instrument` that certificates state; the keys are the names of the fields. The
    #: values replace the values that the campaigns state for the same fields.
    certificates: Mapping[str, Any] = field(default_factory=dict)
    #: tolerances of parameters and stiffnesses, as texts such as 60 nm/N; the keys are the names of
    #: these quantities. The tolerances replace those that the campaigns state.
    tolerances: Mapping[str, str] = field(default_factory=dict)

    @property
    def model(self) -> HybridModel:
        """Model that is fitted to every campaign of a batch, from the TOML text ``model_toml``."""
        return _cached_model(self.model_toml)


_cached_model = lru_cache(maxsize=4)(model_from_toml)


class Job(NamedTuple):
    """One campaign to be fitted: its number in the batch, counted from 0, and its file path.

    ``path`` is the file path as the user wrote it, and ``absolute_path`` is the same path in
    absolute form.
    """

    number: int  #: number of the campaign in its batch, counted from 0
    path: str  #: file path of the campaign, as the user wrote it
    absolute_path: str  #: file path of the campaign in absolute form


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the row of a campaign in the table of a batch.

    Parameters
    ----------
    settings : settings of the fit, the same for all campaigns of the batch.
    job : the campaign to be fitted.

    Returns
    -------
    Dictionary of the values in the row; the keys are names of columns. The entry ``odd_readings``
    holds a sentence on each test that was read twice or has the other sign. ``parameters`` holds
    the unit, moments and credible interval of each parameter, and the entry ``stiffness``
    holds the same numbers for each stiffness by direction. The entry ``conformity`` holds, for each
    quantity with a tolerance, the probability of conformity and the decision. The row of a campaign
    that cannot be fitted has the status "failed" and states the reason.
    """
    origin: dict[str, Any] = {}
    try:
        with warnings.catch_warnings(action="ignore"):
            stated = _read_campaign(settings, job.absolute_path)
            tolerances = {**stated.tolerances, **settings.tolerances}
            campaign = replace(stated, tolerances=tolerances)
            origin = _origin_columns(campaign)
            check_stated_tolerances(stated, settings.model)
            fit = _fit_columns(settings, campaign)
    except Exception as error:  # noqa: BLE001 - one campaign must not end the others
        return failed_row(settings, job, _reason(error, job)) | origin
    return _settings_columns(settings, job) | origin | fit


def failed_row(settings: Settings, job: Job, reason: str) -> dict[str, Any]:
    """Return the row of a batch's table for a campaign that could not be fitted.

    Parameters
    ----------
    settings : settings of the fit, the same for all campaigns of the batch.
    job : the campaign that could not be fitted.
    reason : why the campaign could not be fitted.
    """
    return {
        **labels_of(job.absolute_path),
        **_settings_columns(settings, job),
        "status": "failed",
        "reason": reason,
    }


def _read_campaign(settings: Settings, path: str) -> Campaign:
    """Read a campaign, and replace what its files state with what the settings of the batch state.

    ``path`` is the file path of the campaign. The settings state certified properties of the
    instrument and, for a tidy CSV file, also the fields of `Campaign` that such a file cannot
    state.
    """
    is_table = not os.path.isdir(path) and not path.lower().endswith(".toml")
    fields = settings.table if is_table else {}
    return read_campaign(path, certificates=settings.certificates, **fields)


def check_tolerances(settings: Settings, paths: Sequence[str]) -> None:
    """Raise an `InputError` if a tolerance is of a quantity that no campaign has, or has no unit.

    A campaign of one plane, for example, has no compliance of another plane. Campaigns that cannot
    be read are passed over; each of them has a row with the reason.

    Parameters
    ----------
    settings : settings of the fit, the same for all campaigns of the batch.
    paths : file paths of the campaigns.
    """
    unknown = {inside_name(name) for name in settings.tolerances}
    model = model_from_toml(settings.model_toml)
    known: dict[str, Quantity] = {}
    for path in paths:
        if not unknown:
            break
        try:
            campaign = _read_campaign(settings, path)
            known |= quantities_of(model.bind(campaign))
        except InputError:
            continue
        unknown -= set(known)
    if known:
        check_known("quantity with a tolerance", sorted(unknown), sorted(known))
        tolerances_in(known, settings.tolerances)


def _reason(error: Exception, job: Job) -> str:
    """Return one line of text that states why a campaign could not be fitted.

    ``error`` is the error that the fit raised, and ``job`` is the campaign. The text names the file
    path of the campaign as the user wrote it.
    """
    reason = plain_reason(error)
    if reason is None:
        last_call = traceback.extract_tb(error.__traceback__)[-1]
        file = "/".join(Path(last_call.filename).parts[-2:])
        reason = (
            f"unexpected {type(error).__name__}: {error} ({file}, line {last_call.lineno}). Please"
            " report it."
        )
    one_line = " ".join(reason.split())
    return one_line[:LONGEST_MESSAGE].replace(job.absolute_path, job.path)


def _settings_columns(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the values of a campaign's row that state its path and the settings of its fit.

    The row belongs to the table of a batch. The keys of the result are the names of the columns.
    ``job`` is the campaign, and ``settings`` are the settings of the fit.
    """
    return {
        "campaign": job.path,
        "degree": settings.model.degree,
        "model_sha256": model_sha256(settings.model),
        "sampler": settings.sampler,
        "seed": settings.seed,
        "prob": settings.prob,
        "versions": json.dumps(versions()),
    }


def _origin_columns(campaign: Campaign) -> dict[str, Any]:
    """Return the values of a row that describe the campaign, such as machine, date and forces.

    The keys of the result are the names of the columns in the table of a batch.
    """
    columns: dict[str, Any] = {name: getattr(campaign, name) for name in _CAMPAIGN_COLUMNS}
    return columns | {
        "planes": ",".join(campaign.machine().planes),
        "circles": json.dumps(sorted(placed_circles(campaign), key=str)),
        "compliances": json.dumps(stands_for(campaign)),
        "tolerances": json.dumps(dict(campaign.tolerances), ensure_ascii=False),
        "tests": len(campaign.tests),
        "force_min_N": float(campaign.forces_N.min()),
        "force_max_N": float(campaign.forces_N.max()),
    }


def _fit_columns(settings: Settings, campaign: Campaign) -> dict[str, Any]:
    """Fit a campaign, and return the values of its row in the table of a batch.

    The keys of the result are the names of the table's columns. Besides the results of the fit, the
    row may hold further quantities: the Bayes factor of linear over constant compliance, the
    sufficient statistics, the stiffness by direction and the conformity with tolerances. If one of
    these further quantities cannot be computed, a warning in the row names this quantity.
    ``settings`` are the settings of the fit.
    """
    density = HyperPosterior(settings.model.bind(campaign), truncated=True, seed=settings.seed)
    rule = StoppingRule(ess=settings.ess)
    fitted = fit_model(density, settings.sampler, seed=settings.seed, rule=rule, prior_draws=0)
    bound = density.bound
    confounded = confounded_at(bound, fitted.draws.phi.mean(axis=0))
    preview = check_campaign(campaign)
    words = words_of_fit(fitted.fit, fitted.sampler, bound, confounded, preview)
    odd_readings = [odd for odd in preview.remarks if odd.kind in _ODD_READINGS]
    columns: dict[str, Any] = {}
    breakdowns = []
    further = _functions_of_further_columns(settings, campaign, density, fitted)
    for name, compute_columns in further.items():
        try:
            columns |= compute_columns()
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            breakdowns.append(f"No {name}: {plain_reason(error)}")
    return {
        **columns,
        "status": "done",
        "reference_force_N": bound.setting.reference_force_N,
        "terms": list(bound.terms),
        "converged": bool(fitted.sampler["converged"]),
        **words,
        "kinds": [*words["kinds"], *dict.fromkeys(str(odd.kind) for odd in odd_readings)],
        "warnings": [*words["warnings"], *breakdowns],
        "odd_readings": [remark_words(odd) for odd in odd_readings],
        "log_prob_truncation": fitted.fit.log_prob_truncation,
        "rmse_um": fitted.fit.rmse_um,
        "parameters": _parameter_numbers(fitted, settings.prob),
    }


def _functions_of_further_columns(
    settings: Settings, campaign: Campaign, density: HyperPosterior, fitted: FittedModel
) -> dict[str, Callable[[], dict[str, Any]]]:
    """Return functions that compute further quantities of a campaign from its fit.

    The keys of the result are the names of these quantities. Each function has no arguments and
    returns a dictionary with values of the campaign's row in the batch's table. ``fitted`` is the
    fit, and ``density`` is the posterior density of the hyper-parameters (such as the standard
    deviation of the noise).

    The sufficient statistics are computed only if the priors are not flat. The Bayes factor is
    computed only if, in addition, the settings request it, the compliances of the model depend on
    force, and the campaign has several forces. The stiffness by direction is always computed.
    Conformity is computed only if the campaign has tolerances.
    """
    model = settings.model
    steps: dict[str, Callable[[], dict[str, Any]]] = {}
    if not model.prior.flat:
        if settings.compare and model.degree and campaign.force_levels > 1:
            steps["Bayes factor"] = partial(_bayes_factor_columns, density)
        steps["sufficient statistics"] = partial(_statistics_columns, density)
    steps["stiffness"] = partial(_stiffness_columns, fitted, settings.prob)
    if campaign.tolerances:
        steps["conformity"] = partial(_conformity_columns, fitted)
    return steps


def _bayes_factor_columns(density: HyperPosterior) -> dict[str, Any]:
    """Return the log Bayes factor of linear over constant compliance, and its error [nat].

    The Bayes factor compares a model with compliance linear in force and a model with constant
    compliance. The keys of the result are the names of the two columns in the table of a batch.
    ``density`` is the posterior density of the hyper-parameters (such as the standard deviation of
    the noise) under the model of the fit.
    """
    value, error = linear_over_constant(density, tolerance=_EVIDENCE_TOLERANCE)
    return {"log_bayes_factor": value, "log_bayes_factor_error": error}


def _statistics_columns(density: HyperPosterior) -> dict[str, Any]:
    """Return the sufficient statistics of a campaign, as columns of its row in a batch's table.

    Sufficient statistics are posterior and prior moments of the parameters and of the instrument's
    errors. They are computed without the condition that no compliance is negative. ``density`` is
    the posterior density of the hyper-parameters (such as the standard deviation of the noise).
    """
    return sufficient_statistics(density.without_truncation).columns()


def _stiffness_columns(fitted: FittedModel, prob: float) -> dict[str, Any]:
    """Return the stiffness by direction of a machine, from the fit of one campaign.

    The stiffness is computed at the reference force. The result is a dictionary with one entry,
    ``stiffness``. This entry is a dictionary whose keys are the names of quantities: stiffnesses,
    their ratios and directions, and differences of compliances. The values hold the unit, mean, sd,
    median and credible interval of each quantity; for quantities that the readings do not
    determine, see `_determined_numbers`. If the reference force is zero, an empty dictionary is
    returned. ``prob`` is the probability of the credible intervals.
    """
    reference_N = fitted.draws.bound.setting.reference_force_N
    if not reference_N > 0.0:
        return {}
    table = stiffness_of_fit(fitted.draws, reference_N, prob=prob).table()
    planes = fitted.draws.bound.setting.tested_planes
    numbers: dict[str, dict[str, Any]] = {}
    for row in table.to_dict(orient="records"):
        if row["quantity"] in fitted.draws.bound.names:
            # A compliance that was fitted is left out, because the row of the campaign already
            # holds it as a parameter.
            continue
        name = str(row["quantity"]).replace("−", "minus").replace(" ", "_")
        if row["plane"] in planes:
            name = name_in_plane(name, row["plane"], planes)
        numbers[name] = {"unit": row["unit"], **_determined_numbers(row)}
    return {"stiffness": numbers}


def _determined_numbers(row: Mapping[Hashable, Any]) -> dict[str, float | None]:
    """Return the mean, sd, median and credible interval of a quantity.

    ``row`` is the row of the quantity in `DirectionalStiffness.table`. The readings may not
    determine a stiffness, a ratio of stiffnesses or a direction. If a direction is not determined,
    all its values are None. If a stiffness or a ratio is not determined, all its values are None
    except the lower end of the credible interval, which serves as a lower limit. Compliances and
    their differences are always determined.
    """
    numbers: dict[str, float | None] = {name: row[name] for name in PARAMETER_COLUMNS}
    if not row["is_determined"]:
        numbers = dict.fromkeys(numbers)
        if row["unit"] != "deg":
            numbers["ci_low"] = row["ci_low"]
    return numbers


def _conformity_columns(fitted: FittedModel) -> dict[str, Any]:
    """Return the decision on conformity for each quantity with a tolerance.

    ``fitted`` is the fit of one campaign. The result is a dictionary with the single key
    ``conformity``. Its value is a dictionary of the decisions, with the names of the quantities as
    keys.
    """
    decisions = {
        name: decision.as_dict() for name, decision in assess_conformity(fitted.tree()).items()
    }
    return {"conformity": decisions}


def _parameter_numbers(fitted: FittedModel, prob: float) -> dict[str, dict[str, Any]]:
    """Return the unit, mean, sd, median and interval of every quantity that was fitted.

    The quantities are the parameters and the hyper-parameters. Hyper-parameters are quantities such
    as the standard deviation of the noise. The keys of the result are the names of the parameters
    and hyper-parameters. ``prob`` is the probability of the credible intervals.
    """
    bound = fitted.draws.bound
    units = {parameter.name: parameter.unit for parameter in bound.parameters}
    units.update(zip(bound.hyper_prior.names, bound.hyper_prior.units, strict=True))
    numbers: dict[str, dict[str, Any]] = {}
    for name, draws in fitted.groups["posterior"].items():
        numbers[name] = {"unit": units[name], **interval_numbers(draws, prob)}
    return numbers
