"""Where a posterior came from: its record, its campaign and its model, kept inside the DataTree."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.spec import model_from_toml

__all__ = ["bound_of", "campaign_of", "campaign_record", "draws_of", "model_of", "record_of"]

Array = NDArray[Any]

_ANY_CIRCLE_DEG = np.arange(0.0, 360.0, 10.0)
_TEST_FIELDS = (
    "name",
    "force_N",
    "pressure_bar",
    "direction",
    "work_ball_deg",
    "tool_ball_deg",
    "radius_mm",
    "plane",
    "centre_x_mm",
    "centre_y_mm",
    "centre_z_mm",
    "setup",
    "temperature_C",
    "time_s",
)


def campaign_record(campaign: Campaign) -> dict[str, Any]:
    """What the record keeps of a campaign; the readings stand in constant_data, as read, and in
    observed_data in inside units."""
    return {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "tests": len(campaign.tests),
        "readings": campaign.readings,
        "forces_N": campaign.forces_N.tolist(),
        "fields": {
            "topology": campaign.topology,
            "plane": campaign.plane,
            "radius_mm": campaign.radius_mm,
            "resolution_um": campaign.resolution_um,
            "feed_mm_per_min": campaign.feed_mm_per_min,
            "machine_id": campaign.machine_id,
            "date": campaign.date,
            "mount": [campaign.mount.deflection_um_per_bar, campaign.mount.compensated],
            "force_law": [campaign.force_law.slope_N_per_bar, campaign.force_law.offset_N],
            "frames_mm": {axis: list(frame) for axis, frame in campaign.frames_mm.items()},
        },
        "test_fields": [{name: getattr(test, name) for name in _TEST_FIELDS} for test in campaign.tests],
        "foreseen": [{name: getattr(test, name) for name in _TEST_FIELDS} for test in campaign.foreseen],
    }


def record_of(posterior: xr.DataTree) -> dict[str, Any]:
    """What was fitted, how, and how well: the JSON kept in the group ``provenance``."""
    record: dict[str, Any] = json.loads(posterior["provenance"].attrs["json"])
    return record


def campaign_of(posterior: xr.DataTree) -> Campaign:
    """The campaign, readings included."""
    record = record_of(posterior)["campaign"]
    owner = posterior["constant_data"]["test_index"].to_numpy()
    angle, reading = (posterior["constant_data"][name].to_numpy() for name in ("angle_as_read_deg", "reading_as_read_um"))
    tests = tuple(
        CircularTest(angle_deg=angle[owner == i], reading_um=reading[owner == i], **fields)
        for i, fields in enumerate(record["test_fields"])
    )
    fields = dict(record["fields"])
    fields["foreseen"] = tuple(CircularTest(angle_deg=_ANY_CIRCLE_DEG, **own) for own in record.get("foreseen", ()))
    mount, law = MountCompensation(*fields.pop("mount")), ForceLaw(*fields.pop("force_law"))
    return Campaign(tests, name=record["name"], mount=mount, force_law=law, **fields)


def model_of(posterior: xr.DataTree) -> HybridModel:
    """The model."""
    return model_from_toml(record_of(posterior)["model"]["toml"])


def bound_of(posterior: xr.DataTree) -> BoundModel:
    """The model bound to the campaign, as it was sampled."""
    return model_of(posterior).bind(campaign_of(posterior))


def draws_of(posterior: xr.DataTree, bound: BoundModel, size: int | None = None) -> tuple[Array, Array]:
    """Posterior draws as arrays, evenly picked.

    Returns
    -------
    beta : ndarray, shape (size, p)
    phi : ndarray, shape (size, h) [mm]
    """
    group = posterior["posterior"]
    beta = np.stack([group[name].to_numpy().ravel() for name in bound.names], axis=1)
    phi = np.stack([group[str(name)].to_numpy().ravel() for name in bound.hyper_prior.names], axis=1)
    if size is None or size >= len(beta):
        return beta, phi
    pick = np.linspace(0, len(beta) - 1, size).astype(int)
    return beta[pick], phi[pick]
