"""Posteriors: how they are built, and functions that return their contents.

A posterior is an xarray DataTree in ArviZ's layout. Its contents are, for example, the campaign,
the model and the random draws.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from pydantic import ValidationError

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.inference.coefficients import ModelDraws, evenly_spaced
from ldbb_bayes.inference.elastic_deflections import (
    ElasticDraws,
    draw_for_joint_loads,
    elastic_draws_with,
)
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_from_toml
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit

__all__ = [
    "MODEL_EDITION",
    "bound_of",
    "build_tree",
    "campaign_of",
    "campaign_record",
    "curves_of",
    "draws_of",
    "elastic_draws_of",
    "fit_of",
    "model_draws_of",
    "model_of",
    "record_of",
    "to_units",
]

# Seed of the random draws of effects on the compliances that are not among the parameters.
_SEED = 0
# Dimensions of the arrays in a posterior (an xarray DataTree), except for arrays of random draws.
# The keys are the names of the arrays. The dimension ``test`` has one entry for each test, and
# ``reading`` one entry for each reading of all tests.
_DIMENSIONS = {
    "force_N": ["test"],
    "pressure_bar": ["test"],
    "work_ball_deg": ["test"],
    "tool_ball_deg": ["test"],
    "radius_mm": ["test"],
    "angle_rad": ["reading"],
    "angle_as_read_deg": ["reading"],
    "reading_as_read_um": ["reading"],
    "test_index": ["reading"],
    "reading_mm": ["reading"],
    "reference_force_N": [],
}
# Units of the arrays in a posterior, which is an xarray DataTree. The keys are the names of the
# arrays.
_UNITS = {
    "force_N": "N",
    "pressure_bar": "bar",
    "reading_mm": "mm",
    "angle_rad": "rad",
    "radius_mm": "mm",
}
# Attributes of a `CircularTest` that are arrays. In a posterior these arrays are kept in the group
# constant_data, not in the JSON record of the campaign.
_ARRAY_FIELDS = ("angle_deg", "reading_um", "angle_rad", "reading_mm")
# Angles [°] that are given to foreseen tests (tests that may be run later, in the field
# ``foreseen`` of a campaign) when a campaign is rebuilt from the record in a posterior. The record
# does not hold the true angles of these tests.
_ANY_CIRCLE_DEG = np.arange(0.0, 360.0, 10.0)
# Number of the present edition of the default model. The number is increased whenever the terms or
# priors of the default model change. The record of a posterior states the edition with which it was
# computed; draws from another edition are refused. The presets ``first`` and ``paper`` are the same
# in all editions.
MODEL_EDITION = 3
# Cache of the campaigns from which posteriors were computed, the oldest first. A key (function
# `_campaign_key`) consists of the record of a campaign in a posterior, as JSON text, and of the
# campaign's test indices, angles and readings, as bytes. Because of the cache, all analyses of a
# posterior use the same `Campaign` object and the results that are stored in it.
_CAMPAIGNS: dict[tuple[str | bytes, ...], Campaign] = {}
# Largest number of campaigns in the cache of campaigns from which posteriors were computed.
_KEPT_CAMPAIGNS = 8


def build_tree(
    groups: Mapping[str, Mapping[str, Array]], bound: BoundModel, record: Mapping[str, Any]
) -> xr.DataTree:
    """Return a DataTree with groups of arrays; its group ``provenance`` holds a record as JSON.

    ``groups`` is a dict of dicts with the arrays: the first key is the name of the group, the
    second key the name of the array. Arrays of random draws have the shape (chains, draws, …).
    ``bound``, the model of the campaign, gives names and units. ``record`` states what was fitted
    and how.
    """
    # ArviZ is imported only when it is needed, because its import also loads Matplotlib.
    from arviz_base import from_dict

    coordinates: dict[str, Array] = {"test": np.array(bound.test_names)}
    if "observed_data" in groups:
        coordinates["reading"] = np.arange(len(groups["observed_data"]["reading_mm"]))
    tree = from_dict(groups, dims=_DIMENSIONS, coords=coordinates)
    units = dict(_UNITS)
    units.update({parameter.name: parameter.unit for parameter in bound.parameters})
    units.update(zip(bound.hyper_prior.names, bound.hyper_prior.units, strict=True))
    for node in tree.children.values():
        for name, variable in node.data_vars.items():
            if name in units:
                variable.attrs["unit"] = units[str(name)]
    text = json.dumps(record, ensure_ascii=False)
    tree["provenance"] = xr.DataTree(xr.Dataset(attrs={"json": text}))
    if "constant_data" in groups and len(bound.test_names) == len(bound.campaign.tests):
        _keep_campaign(_campaign_key(tree), bound.campaign)
    return tree


def campaign_record(campaign: Campaign) -> dict[str, Any]:
    """Return the entry ``campaign`` of a posterior's record, from which the campaign is rebuilt.

    The entry holds the attributes of the campaign and of its tests. Readings and angles are left
    out, because the group ``constant_data`` of the posterior has them. The pilot (the campaign from
    which this campaign was planned) is left out too, because it matters only before the tests are
    run.
    """
    campaign_fields = _fields(campaign, "name", "tests", "foreseen", "pilot", "adds_to_pilot")
    for name in ("mount", "force_law", "instrument"):
        campaign_fields[name] = asdict(getattr(campaign, name))
    return {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "tests": len(campaign.tests),
        "readings": campaign.readings,
        "forces_N": campaign.forces_N.tolist(),
        "fields": campaign_fields,
        "test_fields": [_fields(test, *_ARRAY_FIELDS) for test in campaign.tests],
        "foreseen": [_fields(test, *_ARRAY_FIELDS) for test in campaign.foreseen],
    }


def _fields(source: Campaign | CircularTest, *excluded: str) -> dict[str, Any]:
    """Return the fields of a campaign or test in a dict, except those named in ``excluded``."""
    names = [field.name for field in fields(source) if field.name not in excluded]
    return {name: getattr(source, name) for name in names}


def _require_tree(posterior: object) -> None:
    """Raise an `InputError` unless ``posterior`` is an xarray DataTree."""
    require(
        isinstance(posterior, xr.DataTree),
        f"the posterior must be a DataTree, got {type(posterior).__name__}. Pass what lb.sample or"
        " lb.load returned.",
    )


def _require_record(posterior: xr.DataTree) -> None:
    """Raise an `InputError` unless ``posterior`` is a DataTree with the group ``provenance``."""
    _require_tree(posterior)
    if "provenance" not in posterior.children:
        raise InputError(
            "the posterior must be one of sample or load, got one in units for reading (to_units)."
            " Pass the first."
        )


def record_of(posterior: xr.DataTree) -> dict[str, Any]:
    """Return the record that states how a posterior was made.

    The record states what was fitted, with which settings, and how well the model fits. It is kept
    as JSON in the group ``provenance``. Raise an `InputError` for a posterior from `to_units`,
    which has no record.
    """
    _require_record(posterior)
    record: dict[str, Any] = json.loads(posterior["provenance"].attrs["json"])
    return record


def fit_of(posterior: xr.DataTree) -> Fit:
    """Return how well the model of a posterior fits the readings, with warnings.

    The result is read from the record that is stored in the posterior. Raise an `InputError` if the
    fit was made by another version of this package.
    """
    try:
        return Fit.from_dict(record_of(posterior)["fit"])
    except ValidationError as error:
        field = ".".join(map(str, error.errors()[0]["loc"]))
        raise InputError(
            "the posterior must be of this edition of ldbb-bayes, got a fit of another (its"
            f" {field}). Fit again."
        ) from None


def campaign_of(posterior: xr.DataTree) -> Campaign:
    """Return the campaign, with its readings, from which a posterior was computed.

    Posteriors of the same campaign, such as a fit and an average over models, share one `Campaign`
    object.
    """
    _require_record(posterior)
    key = _campaign_key(posterior)
    campaign = _CAMPAIGNS.get(key)
    if campaign is None:
        campaign = _rebuild_campaign(posterior)
        _keep_campaign(key, campaign)
    return campaign


def _campaign_key(posterior: xr.DataTree) -> tuple[str | bytes, ...]:
    """Return the key of a posterior's campaign in the cache of campaigns.

    The first item of the key is the entry ``campaign`` of the posterior's record, as JSON text. The
    other items are the indices of the tests, the angles and the readings of the campaign, as bytes.
    """
    constants = posterior["constant_data"].dataset
    names = ("test_index", "angle_as_read_deg", "reading_as_read_um")
    readings = [np.asarray(constants[name].values).tobytes() for name in names]
    return (_campaign_text(posterior["provenance"].attrs["json"]), *readings)


@lru_cache(maxsize=16)
def _campaign_text(record_json: str) -> str:
    """Return the entry ``campaign`` of a posterior's record as JSON text.

    ``record_json`` is the whole record as JSON text.
    """
    return json.dumps(json.loads(record_json)["campaign"])


def _keep_campaign(key: tuple[str | bytes, ...], campaign: Campaign) -> None:
    """Add a campaign to the cache, and remove the oldest campaigns if the cache holds too many.

    ``key`` is the key of the campaign in the cache, as `_campaign_key` returns it.
    """
    _CAMPAIGNS[key] = campaign
    for oldest in list(_CAMPAIGNS)[:-_KEPT_CAMPAIGNS]:
        _CAMPAIGNS.pop(oldest, None)


def _rebuild_campaign(posterior: xr.DataTree) -> Campaign:
    """Return the campaign of a posterior, made from the posterior's JSON record and readings."""
    record = record_of(posterior)["campaign"]
    constants = posterior["constant_data"].dataset
    test_index = constants["test_index"].values
    angle_deg = constants["angle_as_read_deg"].values
    reading_um = constants["reading_as_read_um"].values
    tests = []
    for index, test_fields in enumerate(record["test_fields"]):
        of_test = test_index == index
        tests.append(
            CircularTest(
                angle_deg=angle_deg[of_test], reading_um=reading_um[of_test], **test_fields
            )
        )
    foreseen = [
        CircularTest(angle_deg=_ANY_CIRCLE_DEG, **test_fields) for test_fields in record["foreseen"]
    ]
    return Campaign(tuple(tests), name=record["name"], foreseen=tuple(foreseen), **record["fields"])


def model_of(posterior: xr.DataTree) -> HybridModel:
    """Return the model that was fitted to obtain a posterior.

    The model is read from the record that is stored in the posterior. If the posterior is an
    average over several models, return the one model that has the parameters of all these models.
    """
    return model_from_toml(record_of(posterior)["model"]["toml"])


def bound_of(posterior: xr.DataTree) -> BoundModel:
    """Return the model of a posterior, applied to the campaign of the posterior."""
    return model_of(posterior).bind(campaign_of(posterior))


def draws_of(
    posterior: xr.DataTree, bound: BoundModel, size: int | None = None
) -> tuple[Array, Array]:
    """Return posterior draws of the p parameters and of the h hyper-parameters.

    Parameters are compliances, their changes with force, and geometric errors, in mm, N and rad.
    Hyper-parameters are quantities such as the standard deviation of the noise; those that are
    lengths are in mm. The draws of all chains are joined. The results have the shapes (draws, p)
    and (draws, h). If ``size`` is not None, at most that many draws are returned, evenly spaced.
    ``bound`` is the posterior's model of the campaign.
    """
    group = posterior["posterior"].dataset
    beta = _stack_draws(group, bound.names)
    phi = _stack_draws(group, bound.hyper_prior.names)
    draws = ModelDraws(bound, phi, beta)
    if size is not None:
        draws = draws.thinned(size)
    return draws.beta, draws.phi


def _stack_draws(group: Any, names: tuple[str, ...]) -> Array:
    """Return random draws of the variables ``names``, shape (chains × draws, variables).

    ``group`` is the dataset that contains the draws.
    """
    return np.stack([group[str(name)].values.ravel() for name in names], axis=1)


def model_draws_of(posterior: xr.DataTree, size: int | None = None) -> list[ModelDraws]:
    """Return posterior draws, grouped by the alternative explanations that their models contain.

    Alternative explanations are effects that look like a change of compliance with force. The
    models of an average may contain different ones. The effect of an alternative explanation on the
    readings can be computed only from draws of models that contain this explanation. Each item of
    the list therefore holds the draws of all models with the same alternative explanations. The
    list has one item if the posterior is of one model.

    Each draw has all parameters of the average; parameters that the model of the draw lacks are
    zero. If ``size`` is not None, at most that many draws are returned in total, evenly spaced.
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, size)
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return [ModelDraws(bound, phi, beta)]
    model_index = np.asarray(posterior["sample_stats"]["model"]).ravel()
    model_index = model_index[evenly_spaced(len(model_index), len(beta))]
    rivals_of_model = [tuple(model["rivals"]) for model in averaged["models"]]
    rivals_of_draw = [rivals_of_model[index] for index in model_index]
    by_model = []
    for rivals in dict.fromkeys(rivals_of_draw):
        has_rivals = np.array([other == rivals for other in rivals_of_draw])
        model = bound.model.with_rivals(*rivals).bind(bound.campaign)
        by_model.append(ModelDraws(model, phi[has_rivals], beta[has_rivals]))
    return by_model


def curves_of(posterior: xr.DataTree, force_N: Array, size: int | None = None) -> Array:
    """Return posterior draws of the compliances C(F) at n forces, shape (draws, n, compliances).

    ``force_N``, shape (n,), holds the forces F [N]. C(F) is computed from the compliance at the
    reference force and its slopes (changes with force); see `elastic_draws`. At most ``size``
    draws are used; if ``size`` is None, all draws are used. If the posterior is an average over
    several models, the draws are sorted as in `model_draws_of`: by the alternative explanations
    (effects that look like a change of compliance with force) that their models contain. The random
    draws of effects that are not among the parameters are the same in every call.
    """
    return elastic_draws_of(posterior, (), force_N, size).compliances


def elastic_draws_of(
    posterior: xr.DataTree,
    circles: Sequence[int],
    force_N: Array,
    size: int | None = None,
) -> ElasticDraws:
    """Return posterior draws of compliances and of the elastic deflection around circles.

    ``circles`` holds the indices of the tests for whose circles the deflection is returned.
    ``force_N``, shape (n,), holds n forces of the bar [N], see `elastic_draws`. At most ``size``
    draws are used; if ``size`` is None, all draws are used. If the posterior is an average over
    several models, the draws are sorted as in `model_draws_of`: by the alternative explanations
    (effects that look like a change of compliance with force) that their models contain. The random
    draws of effects that are not among the parameters are the same in every call.
    """
    by_model = [
        elastic_draws_with(of_model.shared, of_model.draws, circles, force_N)
        for of_model in _draws_for_joint_loads(posterior, size)
    ]
    return ElasticDraws(
        np.concatenate([draws.compliances for draws in by_model]),
        np.concatenate([draws.per_force for draws in by_model]),
    )


class _DrawsForJointLoads(NamedTuple):
    """Posterior draws of a model, with draws of the nuisance coefficients that tests share."""

    draws: ModelDraws
    #: draws of the q coefficients, see `draw_for_joint_loads`, shape (draws, q)
    shared: Array


@cached_by_posterior
def _draws_for_joint_loads(posterior: xr.DataTree, size: int | None) -> list[_DrawsForJointLoads]:
    """Return the draws that `elastic_draws_of` needs, in the order of `model_draws_of`.

    ``size`` is the largest number of draws; None stands for all.
    """
    rng = np.random.default_rng(_SEED)
    return [
        _DrawsForJointLoads(draws, draw_for_joint_loads(draws, rng))
        for draws in model_draws_of(posterior, size)
    ]


def to_units(posterior: xr.DataTree) -> xr.DataTree:
    """Return a posterior with its draws in units that are easy to read, such as nm/N and µrad.

    The result is for plots and summaries by other libraries; the analyses of this package need the
    posterior itself. Only the draws in the groups ``posterior`` and ``prior`` are converted;
    readings, forces and angles are not. In all groups, a variable that has the attribute ``unit``
    has the attribute ``units`` instead in the result, and no other attributes. Variables without
    the attribute ``unit`` are left unchanged.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    DataTree
        Converted posterior, without the group ``provenance``.

    Examples
    --------
    >>> converted = lb.to_units(posterior)
    >>> compliance = converted["posterior"]["C_YYY"]
    >>> compliance.attrs["units"]
    'nm/N'
    >>> round(float(compliance.mean()))
    39
    """
    _require_tree(posterior)
    converted = {}
    for path, node in posterior.children.items():
        if path == "provenance":
            continue
        dataset = node.to_dataset().copy()
        for name, variable in dataset.data_vars.items():
            unit = variable.attrs.get("unit")
            if unit is None:
                continue
            factor = 1.0
            label = unit
            if path in ("posterior", "prior"):
                factor, label = _plain_unit(str(name), unit)
            dataset[name] = variable.copy(data=variable.values * factor)
            dataset[name].attrs = {"units": label}
        converted[path] = dataset
    return xr.DataTree.from_dict(converted)


def _plain_unit(name: str, unit: str) -> tuple[float, str]:
    """Return a factor, and the unit in which draws of a variable are exported, such as nm/N.

    The factor converts draws from ``unit``, the internal unit of the variable ``name``, to the unit
    of the export. Because other libraries round to two decimals, the unit of the export is so small
    that most draws are at least about 0.1 in magnitude.
    """
    factor, label = display_unit(unit)
    is_scale = unit == "mm" and not name.startswith("E_")
    if is_scale or label.startswith("µrad/"):
        return factor * 1e3, f"n{label[1:]}"
    return factor, label
