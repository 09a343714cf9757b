"""Parts of the instrument (bar, balls, mount, …) with their certified or assumed uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Ball
from ldbb_bayes.inference.posterior import bound_of, campaign_of
from ldbb_bayes.model.terms import BallForm, uncertainties
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.translation import Words
from ldbb_bayes.units import display_unit, two_digits

__all__ = ["InstrumentPiece", "instrument_pieces"]

# The name of a calibration certificate is cut off after this number of characters.
_LONGEST_CERTIFICATE = 32
# The test certificate states one standard uncertainty for each part of the instrument. The keys are
# the parts. The value for a part is the name of the error that has this standard uncertainty.
_UNCERTAINTY_OF_PIECE = {
    "bar": "bar_length",
    "work": "work_form_2",
    "tool": "tool_form_2",
    "mount": "mount",
    "force": "force_gain",
    "angle": "angle_reference",
}


@dataclass(frozen=True)
class InstrumentPiece:
    """A part of the instrument with its certified or assumed uncertainty.

    ``key`` names the part, such as ``bar``. ``size`` is a string with the part's certified value,
    its grade, or its uncertainty U (k = 2). ``certificate`` is the name of the part's certificate
    in brackets, or an empty string if the part has no certificate. ``is_stated`` is true if a
    certificate states the part's uncertainty.
    """

    key: str
    size: str
    certificate: str
    is_stated: bool


def instrument_pieces(findings: Findings, words: Words) -> list[InstrumentPiece]:
    """Return the parts of the instrument (bar, balls, …) whose errors are in the model.

    Parameters
    ----------
    findings
        All results of a fit that a report shows.
    words
        Texts of the test certificate, in its language.

    Returns
    -------
    list of InstrumentPiece
    """
    bound = bound_of(findings.posterior)
    assumed = uncertainties(bound.campaign, bound.model.nuisances).assumed
    by_name = {uncertainty.name: uncertainty for uncertainty in assumed}
    pieces = []
    for key, name in _UNCERTAINTY_OF_PIECE.items():
        if name in by_name:
            uncertainty = by_name[name]
            size = _ball_size(findings, key, words)
            if not size:
                size = words.number(_uncertainty_text(key, uncertainty))
            certificate = _certificate_name(findings, key)
            pieces.append(InstrumentPiece(key, size, certificate, uncertainty.stated))
    return pieces


def _ball_size(findings: Findings, key: str, words: Words) -> str:
    """Return a string with the grade of a ball, such as G10, or its sphericity, such as 0.2 µm.

    ``key`` names a part of the instrument. The sphericity is used if no grade is stated. If nothing
    is stated about the ball, the string describes the form error that the model assumes. The string
    is empty if the part is not a ball, or if only harmonics of the ball's form are stated.
    """
    if key not in ("work", "tool"):
        return ""
    bound = bound_of(findings.posterior)
    ball = getattr(bound.campaign.instrument, key)
    if ball is not None and ball.grade:
        return str(ball.grade)
    if ball is not None and ball.stated_sphericity_um is not None:
        return _sphericity(ball.sphericity_um, words)
    if ball is not None and ball.harmonics_um:
        return ""
    for term in bound.model.nuisances:
        if isinstance(term, BallForm):
            return _assumed_form(findings, term, words)
    return ""


def _assumed_form(findings: Findings, term: BallForm, words: Words) -> str:
    """Return a string on the form error that is assumed for a ball that has no certificate.

    The string states the assumed sphericity, and U (k = 2) of the form errors with two and with
    three waves around the ball. U combines two contributions: the form error according to the
    assumed sphericity, and the form error extrapolated from higher orders. The extrapolation uses
    the posterior draws of two hyper-parameters, tau (scale of the form errors) and decay (exponent
    of their decrease with the number of waves). If the posterior does not have them, the string
    states only the sphericity. ``term`` is the model term of the balls' form.
    """
    draws = findings.posterior["posterior"].dataset
    sphericity = words.number(f"{term.sphericity_um:g}")
    if not {"tau", "decay"} <= set(draws):
        return _sphericity(term.sphericity_um, words)
    expanded_um = {}
    for order in (2, 3):
        sd_um = term.coefficient_sd_um(
            Ball(), order, 1e3 * draws["tau"].values, draws["decay"].values
        )
        expanded_um[order] = words.number(two_digits(2.0 * float(np.sqrt(np.mean(sd_um**2)))))
    return words("entries.assumed_form", two=expanded_um[2], three=expanded_um[3], size=sphericity)


def _sphericity(sphericity_um: float, words: Words) -> str:
    """Return the sphericity of a ball [µm] as a text in the language of the certificate."""
    return words("entries.sphericity", size=words.number(f"{sphericity_um:g}"))


def _uncertainty_text(key: str, uncertainty: Uncertainty) -> str:
    """Return a string with the certified or assumed uncertainty U (k = 2) of a part.

    ``key`` names the part of the instrument, such as ``bar``. For a bar with a length error other
    than zero, the string begins with this error.
    """
    if uncertainty.unit == "1" or key == "mount":
        size = f"{two_digits(2.0 * uncertainty.sd / (uncertainty.value or 1.0), 100.0)} %"
    elif uncertainty.unit == "rad":
        size = f"{two_digits(np.degrees(2.0 * uncertainty.sd))}°"
    else:
        factor, label = display_unit(uncertainty.unit)
        size = f"{two_digits(2.0 * uncertainty.sd, factor)} {label}"
    size = f"U = {size}"
    if key == "bar" and uncertainty.value:
        size = f"{uncertainty.value * 1e3:+.4g} µm, {size}".replace("-", "−")
    return size


def _certificate_name(findings: Findings, key: str) -> str:
    """Return the name, in brackets, of the certificate of a part of the instrument.

    ``key`` names the part, such as ``bar``. The string is empty if the part has no certificate.
    """
    certificates = campaign_of(findings.posterior).instrument.certificates
    for name, certificate in certificates.items():
        if name.startswith(key):
            return f" ({certificate.split(': ')[0][:_LONGEST_CERTIFICATE]})"
    return ""
