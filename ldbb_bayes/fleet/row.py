"""One campaign, one row: what a fit says of it, or why there is none."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import labels_of, read_campaign
from ldbb_bayes.errors import InputError, plain_reason
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.population_prior import PopulationPrior, stands_for
from ldbb_bayes.fleet.statistics import sufficient_statistics
from ldbb_bayes.inference.evidence import log_bayes_factor, log_evidence
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import numbers_of, record_of, saved_bytes
from ldbb_bayes.inference.sample import sample_with_densities, versions
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256
from ldbb_bayes.report.findings import fit_in_words

__all__ = ["Job", "Settings", "failed_row", "fit_row", "posterior_name", "stamp_of"]

_EVIDENCE_TOLERANCE = 1e-2
_LONGEST_REASON = 1200
# What no campaign causes: a full or failing disk, a mount that went, a system that opens no more files.
_NAMES = ("ENOSPC", "EDQUOT", "EIO", "ESTALE", "ENODEV", "ENOTCONN", "ETIMEDOUT", "EMFILE", "ENFILE")
_SYSTEM = {getattr(errno, name) for name in _NAMES if hasattr(errno, name)}


@dataclass(frozen=True)
class Settings:
    """How every campaign of a batch is fitted.

    Attributes
    ----------
    model_toml : str
    sampler : str
    seed : int
    ess, ci_prob : float
        Effective sample size asked for; probability of the intervals.
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
    sampler: str = "independent"
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


@lru_cache(maxsize=4)
def _model(text: str) -> HybridModel:
    return model_from_toml(text)


@dataclass(frozen=True)
class Job:
    """A campaign's number in the batch, and its path as given."""

    index: int
    path: str


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the row of a campaign; ``parameters`` holds unit and numbers of each by name, ``stamp`` what its files looked like.

    Raises
    ------
    InputError
        When the disk or its mount fails, as it would for every other campaign too.
    """
    place = os.path.join(settings.here, job.path)
    row = _given(settings, job) | {"stamp": stamp_of(place)}
    try:
        with warnings.catch_warnings(action="ignore"):
            is_table = not os.path.isdir(place) and not place.lower().endswith(".toml")
            campaign = read_campaign(place, **(settings.table if is_table else {}))
            row |= _origin(campaign)
            fitted, posterior = _fitted(settings, campaign)
    except Exception as error:  # noqa: BLE001  # one campaign must not end the others
        _refuse_a_failing_disk(error, place)
        return labels_of(place) | row | {"status": "failed", "reason": _reason(error).replace(place, job.path)}
    if settings.posteriors is not None:
        write_whole(Path(settings.posteriors) / posterior_name(job.index, campaign.sha256), posterior)
    return row | fitted


def failed_row(settings: Settings, job: Job, reason: str) -> dict[str, Any]:
    """Return the row of a campaign that could not even be tried."""
    place = os.path.join(settings.here, job.path)
    return labels_of(place) | _given(settings, job) | {"stamp": None, "status": "failed", "reason": reason}


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
        **{name: getattr(campaign, name) for name in ("name", "sha256", "machine_id", "date", "topology", "readings")},
        "planes": ",".join(campaign.machine().planes),
        "compliances": json.dumps(stands_for(campaign)),
        "tests": len(campaign.tests),
        "force_min_N": float(campaign.forces_N.min()),
        "force_max_N": float(campaign.forces_N.max()),
    }


def _fitted(settings: Settings, campaign: Campaign) -> tuple[dict[str, Any], bytes]:
    """Columns of the fit, and its posterior as bytes of a file where it is to be kept."""
    doubts = () if settings.population is None else settings.population.doubts(campaign)
    posterior, densities = sample_with_densities(
        settings.model, campaign, sampler=settings.sampler, seed=settings.seed, rule=StoppingRule(ess=settings.ess)
    )
    record, words = record_of(posterior), fit_in_words(posterior)
    beside, breakdowns = _beside(settings, campaign, densities)
    row = {
        **beside,
        "status": "done",
        "reference_force_N": record["model"]["reference_force_N"],
        "terms": record["model"]["terms"],
        "converged": bool(record["sampler"]["converged"]),
        **words,
        "warnings": [*words["warnings"], *breakdowns, *doubts],
        "log_prob_truncation": record["fit"]["log_prob_truncation"],
        "rmse_um": record["fit"]["rmse_um"],
        "parameters": _parameters(posterior, settings.ci_prob),
    }
    return row, b"" if settings.posteriors is None else saved_bytes(posterior)


def _parameters(posterior: xr.DataTree, ci_prob: float) -> dict[str, dict[str, Any]]:
    found = {}
    for name, variable in posterior["posterior"].data_vars.items():
        found[str(name)] = {"unit": variable.attrs.get("unit", ""), **numbers_of(variable.to_numpy(), ci_prob)}
    return found


def _beside(settings: Settings, campaign: Campaign, densities: Mapping[bool, HyperPosterior]) -> tuple[dict[str, Any], list[str]]:
    """Columns of the Bayes factor and of the sufficient statistics; one that breaks down is a warning, and the fit stands."""
    model = settings.model
    parts: dict[str, Callable[[], dict[str, Any]]] = {}
    if not model.prior.flat:
        if settings.compare and model.degree and campaign.force_levels > 1:
            parts["Bayes factor"] = lambda: _bayes_factor(model, campaign, densities[model.prior.truncated])
        parts["sufficient statistics"] = lambda: sufficient_statistics(densities[False]).columns()
    found: dict[str, Any] = {}
    breakdowns = []
    for name, part in parts.items():
        try:
            found |= part()
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            breakdowns.append(f"No {name}: {plain_reason(error)}")
    return found, breakdowns


def _bayes_factor(model: HybridModel, campaign: Campaign, density: HyperPosterior) -> dict[str, float]:
    if model.degree == 1 and density.truncated == density.bound.truncation.active:
        linear = density.nodes(_EVIDENCE_TOLERANCE).evidence
    else:
        linear = log_evidence(model.with_degree(1), campaign, tolerance=_EVIDENCE_TOLERANCE)
    constant = log_evidence(model.with_degree(0), campaign, tolerance=_EVIDENCE_TOLERANCE)
    value, error = log_bayes_factor(linear, constant)
    return {"log_bayes_factor": float(value), "log_bayes_factor_error": float(error)}


def _reason(error: Exception) -> str:
    """One line; of an error that no input should cause also its kind and place, so that it can be mended."""
    reason = plain_reason(error)
    if isinstance(error, MemoryError):
        reason = f"the campaign must fit into memory, got: {error or 'not enough'}. Leave out readings, or add memory."
    elif reason is None:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = "/".join(Path(last.filename).parts[-2:])
        reason = f"unexpected {type(error).__name__}: {error} ({place}, line {last.lineno}). Please report it."
    return " ".join(reason.split())[:_LONGEST_REASON]


def _refuse_a_failing_disk(error: BaseException, place: str) -> None:
    """End the batch where it is the disk, not the campaign: else every campaign left would count as failed."""
    chain: list[BaseException] = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None and before not in chain:
        chain.append(before)
    try:
        os.stat(place)  # of a mount that went, exists() and the like only say that nothing is there
    except (OSError, ValueError) as gone:
        chain.append(gone)
    for each in chain:
        if isinstance(each, OSError) and each.errno in _SYSTEM:
            raise InputError(
                f"{each.filename or place} must be usable, got: {each.strerror}. That is the place, not the campaign: mend it "
                "(or remove this file, if it alone is lost), then go on with --resume. What is done is kept."
            ) from None


def stamp_of(place: str) -> str | None:
    """Return a digest of the sizes and times of a campaign's files; None where nothing is there."""
    digest = hashlib.blake2b(digest_size=8)
    root = Path(place) if os.path.isdir(place) else Path(place).parent
    whole = os.path.isdir(place) or place.lower().endswith(".toml")
    try:
        files = sorted(path for path in root.rglob("*") if path.suffix.lower() in (".toml", ".csv")) if whole else [Path(place)]
        for path in files:
            seen = path.stat()
            digest.update(f"{path.relative_to(root)}\0{seen.st_size}\0{seen.st_mtime_ns}\n".encode(errors="surrogateescape"))
    except (OSError, ValueError):
        return None
    return digest.hexdigest() if files else None


def posterior_name(index: int, sha256: str) -> str:
    """Return the name of a campaign's posterior: its number in the batch, and the beginning of its digest."""
    return f"{index:07d}-{sha256[:12]}.nc"
