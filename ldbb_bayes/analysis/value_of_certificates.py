"""Standard uncertainties to expect with further certificates of the instrument."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Ball, Instrument
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "CERTIFICATES",
    "Moments",
    "averaged_moments",
    "missing_certificates",
    "uncertainty_with",
    "worth_of_certificates",
]

# Certificates that the instrument could have. The keys are names of certificates. Each value is a
# dictionary: its keys are the fields of the instrument to which the certificate gives a value, and
# its values are what the certificate states, such as an expanded uncertainty of 1 µm. A certificate
# for a single ball is meant for instruments whose other ball already has a certificate.
CERTIFICATES: Mapping[str, Mapping[str, Any]] = {
    "balls of grade G10": {"work": Ball(grade="G10"), "tool": Ball(grade="G10")},
    "work ball of grade G10": {"work": Ball(grade="G10")},
    "tool ball of grade G10": {"tool": Ball(grade="G10")},
    "bar ± 1 µm": {"bar_U_um": 1.0},
    "mount ± 2 %": {"mount_U_percent": 2.0},
    "force ± 0.5 %, linearity 0.2 %, random 1 N": {
        "force_U_percent": 0.5,
        "force_linearity_percent": 0.2,
        "force_random_N": 1.0,
    },
    "angle ± 0.05°": {"angle_U_deg": 0.05},
}
# Largest number of values of the hyper-parameters at which the uncertainties with certificates are
# computed. If there are more values, a systematic sample of this number of values is used.
_MOST_VALUES = 1024


def uncertainty_with(bound: BoundModel, instrument: Instrument, weight: Array, phi: Array) -> Array:
    """Return the standard uncertainty of every parameter, given an instrument's certificates.

    The hyper-parameters φ are, for example, the standard deviations of the noise and of random
    effects. The results account for the uncertainty of φ. The variance of each parameter is the
    mean of its variances given the values of φ, plus the variance of its means given these values.
    The values ``phi`` belong to the model with the instrument that the campaign has. They are also
    used for the model with ``instrument``, whose certificates may differ; see `HyperPrior.carried`.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    instrument
        Instrument with its certificates.
    weight
        Weights of the w values of the hyper-parameters, shape (w,).
    phi
        Values of the h hyper-parameters, shape (w, h), from `hyper_parameter_nodes`; lengths in mm.

    Returns
    -------
    ndarray
        Standard uncertainties of the p parameters, shape (p,), in internal units (mm, N, rad).
    """
    certified_campaign = replace(bound.campaign, instrument=instrument)
    certified = BoundModel(bound.model, certified_campaign, pilot=bound.pilot)
    carried = certified.hyper_prior.values_from(bound.hyper_prior, phi)
    posterior = certified.given(carried).parameters
    error_of_mean = posterior.mean - weight @ posterior.mean
    return np.asarray(np.sqrt(weight @ (posterior.sd**2 + error_of_mean**2)))


class Moments(NamedTuple):
    """Posterior means and standard deviations of q linear combinations of a model's coefficients.

    ``mean`` and ``sd`` have the shape (q,) each.
    """

    mean: Array
    sd: Array


def averaged_moments(bound: BoundModel, combinations: Array, weight: Array, phi: Array) -> Moments:
    """Return the means and standard uncertainties of linear combinations of coefficients.

    The results are averaged over the hyper-parameters φ, such as the standard deviation of the
    noise. As in `uncertainty_with`, the variance of a combination is the mean of its variances
    given φ, plus the variance of its means given φ.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    combinations
        Weights of the m coefficients in each of q combinations, shape (q, m). The coefficients are
        in internal units and in the order of `Information.names`: the parameters, then the nuisance
        coefficients that all tests share.
    weight
        Weights of the w values of the hyper-parameters, shape (w,).
    phi
        Values of the h hyper-parameters, shape (w, h); lengths in mm.
    """
    sample = _few_values(weight, phi)
    number = len(bound.names)
    # In the posterior density ``density``, the nuisance coefficients (of effects not of interest)
    # come first and the parameters last. The weights of the coefficients in each linear combination
    # are put in the same order.
    rows = np.concatenate([combinations[:, number:], combinations[:, :number]], axis=1)
    density = bound.collapsed.conditional(sample.phi)[1]
    mean = density.mean @ rows.T + combinations[:, :number] @ bound.least_squares_estimate
    variance = np.sum(density.spread(rows) ** 2, axis=2)
    average = sample.weight @ mean
    return Moments(average, np.sqrt(sample.weight @ (variance + (mean - average) ** 2)))


class _ScaleValues(NamedTuple):
    """Values of the hyper-parameters over which results are averaged, and weights of these values.

    ``phi``, shape (w, h), holds w values of the h hyper-parameters, and ``weight``, shape (w,),
    holds the weights of these values.
    """

    weight: Array
    phi: Array


def _few_values(weight: Array, phi: Array) -> _ScaleValues:
    """Return at most 1024 values of the hyper-parameters, with the weights of these values.

    ``weight``, shape (w,), holds the weights of the w values ``phi``, shape (w, h), of the h
    hyper-parameters. If w is larger than 1024, a systematic sample of 1024 values with equal
    weights is returned.
    """
    if len(weight) <= _MOST_VALUES:
        return _ScaleValues(weight, phi)
    return _ScaleValues(np.full(_MOST_VALUES, 1.0 / _MOST_VALUES), phi[_systematic_sample(weight)])


def worth_of_certificates(
    bound: BoundModel, weight: Array, phi: Array, *, contradicted: Collection[str] = ()
) -> dict[str, dict[str, float]]:
    """Return the standard uncertainties to expect with further certificates of the instrument.

    The uncertainties of all parameters are computed for the present instrument, then with each
    missing certificate alone, and finally with all missing certificates. Missing certificates are
    the certificates in `CERTIFICATES` that the instrument does not have yet, without those that the
    readings contradict.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    weight
        Weights of the w values of the hyper-parameters, shape (w,).
    phi
        Values of the h hyper-parameters, shape (w, h), from `hyper_parameter_nodes`; lengths in mm.
    contradicted
        Names of the certificates that the readings contradict.

    Returns
    -------
    dict
        Standard uncertainties in internal units (mm, N, rad). The outer keys are the cases, and the
        inner keys are the names of the parameters. The cases are "none of these", the names of the
        missing certificates and, if several certificates are missing, "all of these".
    """
    missing = {}
    for name, statements in missing_certificates(bound.campaign.instrument).items():
        if name not in contradicted:
            missing[name] = statements
    cases: dict[str, Mapping[str, Any]] = {"none of these": {}, **missing}
    sample = _few_values(weight, phi)
    if len(missing) > 1:
        all_statements: dict[str, Any] = {}
        for statements in missing.values():
            all_statements.update(statements)
        cases["all of these"] = all_statements
    uncertainties = {}
    for case, statements in cases.items():
        instrument = replace(bound.campaign.instrument, **statements)
        sd = uncertainty_with(bound, instrument, sample.weight, sample.phi)
        uncertainties[case] = dict(zip(bound.names, sd.tolist(), strict=True))
    return uncertainties


def missing_certificates(instrument: Instrument) -> dict[str, Mapping[str, Any]]:
    """Return the certificates in `CERTIFICATES` that the instrument does not have yet.

    The keys are names of certificates. Each value holds the fields of the instrument for which the
    certificate gives values. The certificate of a single ball is included only if the other ball
    already has a certificate. Two certificates in the result therefore never give values for the
    same field.
    """
    uncertified = Instrument()
    missing = {}
    stated_fields: set[str] = set()
    for name, statements in CERTIFICATES.items():
        fields = list(statements)
        is_missing = all(getattr(instrument, key) == getattr(uncertified, key) for key in fields)
        if is_missing and stated_fields.isdisjoint(fields):
            missing[name] = statements
            stated_fields.update(fields)
    return missing


def _systematic_sample(weight: Array) -> NDArray[np.intp]:
    """Return the indices of a systematic sample of weighted values, shape (1024,).

    The sample is taken in equal steps of the cumulative weight. An index whose weight is a share s
    of the total weight occurs 1024 s times, rounded up or down.
    """
    steps = (np.arange(_MOST_VALUES) + 0.5) / _MOST_VALUES
    cumulative = np.cumsum(weight) / np.sum(weight)
    return np.searchsorted(cumulative, steps)
