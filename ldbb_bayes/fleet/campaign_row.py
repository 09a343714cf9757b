"""Split from its neighbours; see there."""

from __future__ import annotations

import json
import os
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.analysis.conformity import conformity
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import labels_of, read_campaign
from ldbb_bayes.errors import InputError, plain_reason
from ldbb_bayes.fleet.campaign_statistics import sufficient_statistics
from ldbb_bayes.fleet.compliance_meaning import stands_for
from ldbb_bayes.inference.evidence import log_bayes_factor, log_evidence
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import record_of
from ldbb_bayes.inference.sample import sample_from
from ldbb_bayes.inference.summary import numbers_of
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256
from ldbb_bayes.parallel import one_blas_thread, versions
from ldbb_bayes.report.text import fit_in_words

__all__ = ["Job", "Settings", "fit_row"]


_EVIDENCE_TOLERANCE = 1e-2


_LONGEST_REASON = 1200


@dataclass(frozen=True)
class Settings:
    """How every campaign of a batch is fitted. ``table`` are fields of `Campaign` that tidy CSVs do
    not say, ``certificates`` of `Instrument` instead of what campaigns say."""

    model_toml: str
    sampler: str = "independent"
    seed: int = 1
    ess: float = 1000.0
    ci_prob: float = 0.95
    compare: bool = True
    table: Mapping[str, Any] = field(default_factory=dict)
    certificates: Mapping[str, Any] = field(default_factory=dict)
    #: of quantities, before what campaigns say
    tolerances: Mapping[str, str] = field(default_factory=dict)

    @property
    def model(self) -> HybridModel:
        """The model in the TOML."""
        return _model(self.model_toml)


_model = lru_cache(maxsize=4)(model_from_toml)


class Job(NamedTuple):
    """A campaign's number in the batch, its path as given, and where that is, wherever a worker
    stands."""

    number: int
    path: str
    place: str


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the row of a campaign; ``parameters`` holds unit and numbers of each by name."""
    row = _given(settings, job)
    try:
        with warnings.catch_warnings(action="ignore"):
            is_table = not os.path.isdir(job.place) and not job.place.lower().endswith(".toml")
            campaign = read_campaign(
                job.place,
                certificates=settings.certificates,
                **(settings.table if is_table else {}),
            )
            campaign = replace(campaign, tolerances={**campaign.tolerances, **settings.tolerances})
            row |= _origin(campaign)
            return row | _fitted(settings, campaign)
    except Exception as error:  # one campaign must not end the others
        reason = plain_reason(error)
        if reason is None:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = "/".join(Path(last.filename).parts[-2:])
            reason = (
                f"unexpected {type(error).__name__}: {error} ({place}, line {last.lineno}). Please"
                " report it."
            )
        reason = " ".join(reason.split())[:_LONGEST_REASON].replace(job.place, job.path)
        return labels_of(job.place) | row | {"status": "failed", "reason": reason}


def _given(settings: Settings, job: Job) -> dict[str, Any]:
    return {
        "campaign": job.path,
        "degree": settings.model.degree,
        "model_sha256": model_sha256(settings.model),
        "sampler": settings.sampler,
        "seed": settings.seed,
        "versions": json.dumps(versions()),
    }


def _origin(campaign: Campaign) -> dict[str, Any]:
    return {
        **{
            name: getattr(campaign, name)
            for name in ("name", "sha256", "machine_id", "date", "topology", "readings")
        },
        "planes": ",".join(campaign.machine().planes),
        "compliances": json.dumps(stands_for(campaign)),
        "tolerances": json.dumps(dict(campaign.tolerances), ensure_ascii=False),
        "tests": len(campaign.tests),
        "force_min_N": float(campaign.forces_N.min()),
        "force_max_N": float(campaign.forces_N.max()),
    }


def _fitted(settings: Settings, campaign: Campaign) -> dict[str, Any]:
    """Columns of the fit, the Bayes factor and the statistics; where one of these two breaks down,
    a warning says so."""
    inside = HyperPosterior(settings.model.bind(campaign), truncated=True, seed=settings.seed)
    rule = StoppingRule(ess=settings.ess)
    posterior = sample_from(inside, settings.sampler, seed=settings.seed, rule=rule, prior_draws=0)
    record = record_of(posterior)
    words = fit_in_words(posterior)
    model = settings.model
    breakdowns = []
    beside: dict[str, Any] = {}
    parts: dict[str, Callable[[], dict[str, Any]]] = {}
    if settings.compare and model.degree and campaign.force_levels > 1:
        parts["Bayes factor"] = lambda: _bayes_factor(
            model, campaign, inside if model.prior.truncated else inside.plain
        )
    parts["sufficient statistics"] = lambda: sufficient_statistics(inside.plain).columns()
    parts = {} if model.prior.flat else parts
    if campaign.tolerances:
        parts["conformity"] = lambda: {
            "conformity": {name: own.as_dict() for name, own in conformity(posterior).items()}
        }
    for name, part in parts.items():
        try:
            beside |= part()
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            breakdowns.append(f"No {name}: {plain_reason(error)}")
    return {
        **beside,
        "status": "done",
        "reference_force_N": record["model"]["reference_force_N"],
        "terms": record["model"]["terms"],
        "converged": bool(record["sampler"]["converged"]),
        **words,
        "warnings": [*words["warnings"], *breakdowns],
        "log_prob_truncation": record["fit"]["log_prob_truncation"],
        "rmse_um": record["fit"]["rmse_um"],
        "parameters": {
            str(name): {
                "unit": variable.attrs.get("unit", ""),
                **numbers_of(variable.to_numpy(), settings.ci_prob),
            }
            for name, variable in posterior["posterior"].data_vars.items()
        },
    }


def _bayes_factor(
    model: HybridModel, campaign: Campaign, density: HyperPosterior
) -> dict[str, float]:
    if model.degree == 1 and density.truncated == density.bound.truncation.active:
        linear = density.nodes(_EVIDENCE_TOLERANCE).evidence
    else:
        linear = log_evidence(model.with_degree(1), campaign, tolerance=_EVIDENCE_TOLERANCE)
    constant = log_evidence(model.with_degree(0), campaign, tolerance=_EVIDENCE_TOLERANCE)
    value, error = log_bayes_factor(linear, constant)
    return {"log_bayes_factor": float(value), "log_bayes_factor_error": float(error)}
