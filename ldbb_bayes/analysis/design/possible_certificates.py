"""Certificates that an instrument can have, given what the readings of a pilot show of its balls.

The pilot is the campaign or plan that a design starts from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ldbb_bayes.analysis.design.certificate_offers import CertificateOffer
from ldbb_bayes.analysis.design.states import hyper_nodes
from ldbb_bayes.analysis.value_of_certificates import missing_certificates
from ldbb_bayes.campaign.campaign import Campaign, Instrument
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.contradicted_certificates import contradicted_certificates
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["possible_certificates", "require_possible"]

# Number of values of the hyper-parameters at which certificates are compared with the pilot's
# readings, and seed of their random draws.
_VALUES = 64
_SEED = 1


def possible_certificates(
    model: HybridModel, pilot: Campaign, instrument: Instrument
) -> dict[str, Mapping[str, Any]]:
    """Return the certificates that an instrument does not have but can have.

    They are the `missing_certificates` of ``instrument`` that the readings of ``pilot`` do not
    contradict. The keys are the names of the certificates, and the values are what they state.
    """
    missing = missing_certificates(instrument)
    contradicted = _contradicted(model, pilot, missing)
    return {name: states for name, states in missing.items() if name not in contradicted}


def require_possible(
    offers: Sequence[CertificateOffer], model: HybridModel, pilot: Campaign
) -> None:
    """Raise an `InputError` if the pilot's readings contradict a certificate that is offered."""
    statements = {offer.name: offer.statements for offer in offers}
    for name in _contradicted(model, pilot, statements):
        raise InputError(
            f"certificates must agree with the readings of {pilot.name!r}, got {name}: the readings"
            " show that the balls are less round. Leave this certificate out."
        )


def _contradicted(
    model: HybridModel, pilot: Campaign, certificates: Mapping[str, Mapping[str, Any]]
) -> tuple[str, ...]:
    """Return the names of the ``certificates`` that the readings of ``pilot`` contradict."""
    if pilot.is_plan or model.prior.flat:
        return ()
    phi = hyper_nodes(model, pilot, _VALUES, _SEED)
    weight = np.full(len(phi), 1.0 / len(phi))
    return contradicted_certificates(model.bind(pilot), certificates, weight, phi)
