"""One campaign of a batch: read, fitted and summed up in a row; whatever goes wrong with it stays in that row.

A row holds nothing of when, where or how fast it was made: but for its stamp, which stays in the journal, it is the same on every
executor, to the last bit.
"""

from __future__ import annotations

import json
import os
import traceback
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import read_campaign
from ldbb_bayes.campaign.labels import labels_of
from ldbb_bayes.errors import InputError, plain_reason
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.places import refuse_sick_places
from ldbb_bayes.fleet.stamps import stamp_of
from ldbb_bayes.inference.evidence import evidence_of, log_bayes_factor, log_evidence
from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.inference.posterior import saved_bytes
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.sample import sample_with_densities, versions
from ldbb_bayes.inference.stopping import StoppingRule
from ldbb_bayes.inference.sufficient import sufficient_statistics
from ldbb_bayes.inference.summary import numbers_of
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.meaning import stands_for
from ldbb_bayes.model.population_prior import PopulationPrior
from ldbb_bayes.model.spec import model_from_toml, model_sha256
from ldbb_bayes.report.result import look_warnings
from ldbb_bayes.threads import one_blas_thread

__all__ = ["STAMP", "Job", "Settings", "failed_row", "fit_row", "posterior_name"]
STAMP = "stamp"
_EVIDENCE_TOLERANCE = 1e-2
_LONGEST_REASON = 1200


@dataclass(frozen=True)
class Settings:
    """How every campaign of a batch is fitted.

    Attributes
    ----------
    model_toml : str
    sampler : str
    seed : int
    ess : float
        Effective sample size asked for.
    ci_prob : float
    compare : bool
        Whether linear compliance is weighed against constant.
    posteriors : str, optional
        Folder for a posterior of every campaign.
    table : mapping
        Fields of `Campaign` for tidy CSVs, which do not say them.
    here : str
        Folder that relative paths start from, wherever a worker stands.
    population : PopulationPrior, optional
        Whose prior is in the model: what speaks against it is said of every campaign.
    """

    model_toml: str
    sampler: str = "quadrature"
    seed: int = 1
    ess: float = 1000.0
    ci_prob: float = 0.95
    compare: bool = True
    posteriors: str | None = None
    table: Mapping[str, Any] = field(default_factory=dict)
    here: str = ""
    population: PopulationPrior | None = None

    @property
    def model(self) -> HybridModel:
        """The model in the TOML."""
        return _model(self.model_toml)


@dataclass(frozen=True)
class Job:
    """A campaign's place in the batch, and its path as given."""

    index: int
    path: str


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """The row of a campaign, plain enough for JSON; ``parameters`` holds unit and numbers of each by name.

    ``STAMP`` holds what its files looked like: for the journal, not for the table.

    Raises
    ------
    InputError
        When the disk or its mount fails, as it would for every other campaign too.
    """
    place = os.path.join(settings.here, job.path)
    row = _given(settings, job) | {STAMP: stamp_of(place)}
    try:
        with warnings.catch_warnings(action="ignore"):
            campaign = read_campaign(place, **(settings.table if _is_table(place) else {}))
            row |= _origin(campaign)
            fitted, posterior = _fitted(settings, campaign)
    except Exception as error:  # noqa: BLE001  # one campaign must not end the others
        refuse_sick_places(error, place)
        return labels_of(place) | row | {"status": "failed", "reason": _reason(error).replace(place, job.path)}
    if settings.posteriors is not None:
        _keep(posterior, Path(settings.posteriors), posterior_name(job.index, campaign.sha256))
    return row | fitted


def failed_row(settings: Settings, job: Job, reason: str) -> dict[str, Any]:
    """The row of a campaign that could not even be tried."""
    return labels_of(os.path.join(settings.here, job.path)) | _given(settings, job) | {"status": "failed", "reason": reason}


def posterior_name(index: int, sha256: str) -> str:
    """File of a campaign's posterior: its place in the batch, and the beginning of its digest."""
    return f"{index:07d}-{sha256[:12]}.nc"


@lru_cache(maxsize=4)
def _model(text: str) -> HybridModel:
    return model_from_toml(text)


def _is_table(path: str) -> bool:
    return not os.path.isdir(path) and Path(path).suffix.lower() != ".toml"


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
    forces = campaign.forces_N
    return {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "machine_id": campaign.machine_id,
        "date": campaign.date,
        "topology": campaign.topology,
        "planes": ",".join(campaign.machine().planes),
        "compliances": json.dumps(stands_for(campaign)),
        "tests": len(campaign.tests),
        "readings": campaign.readings,
        "force_min_N": float(forces.min()),
        "force_max_N": float(forces.max()),
    }


def _fitted(settings: Settings, campaign: Campaign) -> tuple[dict[str, Any], bytes]:
    """Columns of the fit, and its posterior as bytes of a file where it is to be kept."""
    model = settings.model
    doubts = () if settings.population is None else settings.population.doubts(campaign)
    posterior, densities = sample_with_densities(
        model, campaign, sampler=settings.sampler, seed=settings.seed, rule=StoppingRule(ess=settings.ess)
    )
    record = record_of(posterior)
    fit, own_warnings = record["fit"], []
    found: dict[str, Any] = {}
    # What is beside the fit may break down by itself: the fit stands all the same.
    for part in _beside(settings, campaign, densities):
        if isinstance(part, str):
            own_warnings.append(part)
        else:
            found |= part
    return found | {
        "status": "done",
        "reference_force_N": record["model"]["reference_force_N"],
        "terms": record["model"]["terms"],
        "converged": bool(record["sampler"]["converged"]),
        "verdict": fit["verdict"],
        "misfits": fit["misfits"],
        "warnings": [*fit["warnings"], *look_warnings(campaign), *own_warnings, *doubts],
        "log_prob_truncation": fit["log_prob_truncation"],
        "rmse_um": fit["rmse_um"],
        "parameters": _parameters(posterior, settings.ci_prob),
    }, b"" if settings.posteriors is None else saved_bytes(posterior)


def _parameters(posterior: xr.DataTree, ci_prob: float) -> dict[str, dict[str, Any]]:
    found = {}
    for name, variable in posterior["posterior"].data_vars.items():
        numbers = numbers_of(variable.to_numpy(), ci_prob)
        low, high = numbers.pop("interval")
        found[str(name)] = {"unit": variable.attrs.get("unit", ""), **numbers, "ci_low": low, "ci_high": high}
    return found


def _beside(settings: Settings, campaign: Campaign, densities: Mapping[bool, HyperPosterior]) -> Iterator[dict[str, Any] | str]:
    """Columns of the Bayes factor and of the sufficient statistics; where one breaks down, a warning in its place."""
    model = settings.model
    if model.prior.flat:
        return
    if settings.compare and model.degree and campaign.force_levels > 1:
        try:
            yield _bayes_factor(model, campaign, densities[model.prior.truncated])
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            yield f"No Bayes factor: {plain_reason(error)}"
    try:
        yield sufficient_statistics(densities[False]).columns()
    except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
        yield f"No sufficient statistics: {plain_reason(error)}"


def _bayes_factor(model: HybridModel, campaign: Campaign, density: HyperPosterior) -> dict[str, float]:
    if model.degree == 1 and density.truncated == density.bound.truncation.active:
        linear = evidence_of(density, tolerance=_EVIDENCE_TOLERANCE)
    else:
        linear = log_evidence(model.with_degree(1), campaign, tolerance=_EVIDENCE_TOLERANCE)
    constant = log_evidence(model.with_degree(0), campaign, tolerance=_EVIDENCE_TOLERANCE)
    value, error = log_bayes_factor(linear, constant)
    return {"log_bayes_factor": float(value), "log_bayes_factor_error": float(error)}


def _keep(content: bytes, folder: Path, name: str) -> None:
    """A posterior that cannot be written is no matter of the campaign."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} must be writable, got: {error.strerror}. Mend the place, then go on with --resume.") from None
    write_whole(folder / name, content)


def _reason(error: Exception) -> str:
    """One line; of an error that no input should cause also its kind and place, so that it can be mended."""
    if isinstance(error, MemoryError):
        said: str | None = f"the campaign must fit into memory, got: {error or 'not enough'}. Leave out readings, or add memory."
    else:
        said = plain_reason(error)
    if said is None:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = "/".join(Path(last.filename).parts[-2:])
        said = f"unexpected {type(error).__name__}: {error} ({place}, line {last.lineno}). Please report it."
    return " ".join(said.split())[:_LONGEST_REASON]
