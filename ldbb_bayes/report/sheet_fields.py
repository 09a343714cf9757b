"""Form fields of the test certificate: the machine, the tests, and the assumptions."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from ldbb_bayes.analysis.assumed_sizes import AssumedSize, deciding_assumptions
from ldbb_bayes.analysis.origins import Origin, is_prior_stated, is_size_stated, term_named
from ldbb_bayes.campaign.campaign import Campaign, CampaignFields
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.campaign.run_times import TimeSource, time_source
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Angle, BallForm, BarLength, Columns, ForceError, Mount
from ldbb_bayes.model.terms.columns import PARAMETERS
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.sheet_instrument import instrument_pieces
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.translation import Words
from ldbb_bayes.report.wording import source_unit_words
from ldbb_bayes.units import display_unit, two_digits

__all__ = ["assumption_fields", "campaign_fields", "identity_fields", "shorten"]

_LONGEST_ENTRY = 70  # largest number of characters of the text in a form field
_CAMPAIGN_ENTRIES = ("machine_type", "serial_number", "date", "operator", "place")
_DEVICE_ENTRIES = ("ball_bar", "ball_bar_calibrated", "force_device")
# Entries of the campaign that state the machine and the date. Both sheets of the test
# certificate show these entries.
_IDENTITY_ENTRIES = ("machine_type", "serial_number", "date")
# Names of the texts with which sheet 1 of the test certificate states how the order of the tests is
# known. The keys are the possible sources of this knowledge, such as the start times of the tests.
_ORDER_ENTRIES = {
    TimeSource.TIMES: "entries.by_times",
    TimeSource.LISTED: "entries.as_listed",
    TimeSource.RANDOM: "entries.random_order",
    TimeSource.NO_DRIFT: "entries.no_drift",
}
# Names of the model terms that describe the errors of the instrument's parts. The keys are the
# parts. The test certificate states the uncertainty of each part in a form field of its own. The
# certificate's list of other assumed effects therefore leaves these model terms out.
_TERM_OF_PIECE = {
    "bar": BarLength.__name__,
    "work": BallForm.__name__,
    "tool": BallForm.__name__,
    "mount": Mount.__name__,
    "force": ForceError.__name__,
    "angle": Angle.__name__,
}
# Regular expressions for the beginnings of the names of those coefficients whose uncertainty the
# form field of a part states. The keys are the parts.
_COEFFICIENTS_OF_PIECE = {
    "bar": "bar_length",
    "work": "(work_)?form_",
    "tool": "(tool_)?form_",
    "mount": "mount$",
    "force": "force_gain",
    "angle": "angle_reference",
}


def shorten(text: str) -> str:
    """Return a string cut to the length of a form field, with an ellipsis at the cut."""
    if len(text) <= _LONGEST_ENTRY:
        return text
    return f"{text[: _LONGEST_ENTRY - 1]}…"


# ---- machine, operator, tests and instrument


def campaign_fields(findings: Findings, words: Words) -> Iterator[tuple[str, str]]:
    """Yield the form fields on sheet 1 of the test certificate, such as the operator's name.

    If the campaign does not state the content of a field, the text of the field is empty.

    Parameters
    ----------
    findings
        All results of a fit that a report shows.
    words
        Texts of the test certificate, in its language.

    Yields
    ------
    tuple of str
        Name and text of a form field.
    """
    campaign = bound_of(findings.posterior).campaign
    yield from _stated_entries(campaign, _CAMPAIGN_ENTRIES, words)
    yield words("fields.machine"), _machine_text(campaign, words)
    yield from _stated_entries(campaign, _DEVICE_ENTRIES, words)
    yield words("fields.temperature"), _temperature_text(campaign, words)
    yield words("fields.tests"), _tests_text(campaign, words)
    yield words("fields.path"), _path_text(campaign, words)
    yield words("fields.certificates"), _certificates_text(findings, words)


def identity_fields(findings: Findings, words: Words) -> tuple[tuple[str, str], ...]:
    """Return the form fields that state the machine and the date of measurement.

    Parameters
    ----------
    findings
        All results of a fit that a report shows.
    words
        Texts of the test certificate, in its language.

    Returns
    -------
    tuple of tuple of str
        Name and text of each form field.
    """
    campaign = bound_of(findings.posterior).campaign
    machine = (words("fields.machine"), _machine_text(campaign, words))
    return (*_stated_entries(campaign, _IDENTITY_ENTRIES, words), machine)


def _stated_entries(
    campaign: Campaign, keys: tuple[str, ...], words: Words
) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of one form field for each name in ``keys``.

    Each of ``keys`` names something that a campaign can state, such as ``operator``. The text of
    the field is empty if the campaign does not state it.
    """
    for key in keys:
        yield words(f"fields.{key}"), shorten(str(getattr(campaign, key) or ""))


def _machine_text(campaign: Campaign, words: Words) -> str:
    """Return a string that states the machine's topology and the planes of the tests.

    Planes are in alphabetical order, as in the other tables, whatever the order of the tests.
    """
    planes = sorted({str(test.plane) for test in campaign.tests})
    key = "entries.machine" if len(planes) == 1 else "entries.machine_in_planes"
    return words(key, topology=campaign.topology, planes=words.joined(planes))


def _temperature_text(campaign: Campaign, words: Words) -> str:
    """Return the lowest and the highest temperature of the tests as a string [°C].

    The string is empty if no test states its temperature.
    """
    temperatures = [test.temperature_C for test in campaign.tests if test.temperature_C is not None]
    if not temperatures:
        return ""
    ends = [words.number(f"{end:.1f}") for end in (min(temperatures), max(temperatures))]
    return words("entries.temperature", range=" … ".join(dict.fromkeys(ends)))


def _tests_text(campaign: Campaign, words: Words) -> str:
    """Return a string that states the number of circles of a campaign, their forces and radii."""
    radii_mm = sorted({test.circle.radius_mm for test in campaign.tests})
    return words(
        "entries.tests",
        count=str(len(campaign.tests)),
        low=words.number(f"{min(campaign.forces_N):.4g}"),
        high=words.number(f"{max(campaign.forces_N):.4g}"),
        radius=words.number(", ".join(f"{radius:g}" for radius in radii_mm)),
    )


def _path_text(campaign: Campaign, words: Words) -> str:
    """Return a string that states the feed, the directions of travel and the order of the tests."""
    path = []
    if campaign.feed_mm_per_min:
        path.append(words("entries.feed", feed=f"{campaign.feed_mm_per_min:g}"))
    directions = dict.fromkeys(str(test.direction) for test in campaign.tests if test.direction)
    if directions:
        path.append("/".join(words(f"entries.{direction}") for direction in directions))
    else:
        path.append(words("entries.no_direction"))
    if len(campaign.tests) > 1:
        path.append(words(_ORDER_ENTRIES[time_source(campaign)]))
    return ", ".join(path)


def _certificates_text(findings: Findings, words: Words) -> str:
    """Return a string that lists what calibration certificates state about the instrument."""
    stated = []
    for piece in instrument_pieces(findings, words):
        if piece.is_stated:
            stated.append(f"{words(f'entries.{piece.key}')} {piece.size}{piece.certificate}")
    return ", ".join(stated) or words("entries.none")


# ---- assumptions on which the numbers depend


def assumption_fields(numbers: SheetNumbers) -> Iterator[tuple[str, str]]:
    """Yield the form fields for the assumptions on which the test certificate's numbers depend.

    Parameters
    ----------
    numbers
        Quantities that the test certificate states.

    Yields
    ------
    tuple of str
        Name of the assumption, and a string with the assumed value and the mark *stated* or
        *assumed*.
    """
    words = numbers.words
    bound = bound_of(numbers.findings.posterior)
    campaign = bound.campaign
    machine = _machine_text(campaign, words)
    is_stated = campaign.topology != CampaignFields.topology
    yield words("fields.machine"), _marked(machine, is_stated, words)
    yield words("assumptions.readings"), _mount_text(campaign, words)
    if campaign.uses_force_law:
        yield words("assumptions.force_law"), _force_law_text(campaign, words)
    terms_of_pieces = set()
    for piece in instrument_pieces(numbers.findings, words):
        text = f"{piece.size}{piece.certificate}"
        terms_of_pieces.add(_TERM_OF_PIECE[piece.key])
        is_stated = piece.is_stated or _is_piece_edited(bound, piece.key)
        yield words(f"assumptions.{piece.key}"), _marked(text, is_stated, words)
    budgets = numbers.findings.budgets
    stated = {name: budgets[name] for name in (*numbers.parameters, *numbers.slopes)}
    for origin in (Origin.STATED, Origin.ASSUMED):
        for effect in deciding_assumptions(stated, origin):
            if effect.term in terms_of_pieces:
                continue
            sizes = [_assumed_size(effect.term, size, words) for size in effect.sizes]
            name = words.term(effect.term)
            text = _marked(words.joined(sizes), origin == Origin.STATED, words)
            yield name[:1].upper() + name[1:], text
    priors = []
    for is_stated in (True, False):
        texts = _deciding_priors(numbers, bound, is_stated=is_stated)
        if texts:
            priors.append(_marked("; ".join(texts), is_stated, words))
    if priors:
        yield words("assumptions.before"), "; ".join(priors)


def _is_piece_edited(bound: BoundModel, key: str) -> bool:
    """Return whether the user, not the package, states the uncertainty of a part of the instrument.

    ``key`` names the part, such as ``bar``. The user states its uncertainty by a model term such as
    ``BarLength(sd_um=3.0)``.
    """
    term = term_named(bound, _TERM_OF_PIECE[key])
    if term is None:
        return False
    for columns in bound.columns_of[type(term)]:
        for name in columns.names if isinstance(columns, Columns) else ():
            is_of_piece = re.match(_COEFFICIENTS_OF_PIECE[key], name) is not None
            if is_of_piece and is_size_stated(bound, name, term):
                return True
    return False


def _marked(text: str, is_stated: bool, words: Words) -> str:
    """Return the text of a value with a mark: *stated* if ``is_stated`` is true, else *assumed*."""
    mark = words("origins.assumed")
    if is_stated:
        mark = words("origins.stated")
    return f"{text} ({mark})"


def _mount_text(campaign: Campaign, words: Words) -> str:
    """Return a string on the deflection of the bar's mount under pressure [µm/bar].

    The string states whether the readings were already compensated for this deflection, and has the
    mark *stated* or *assumed*. If they were not, the mark is that of the subtracted deflection: it
    is assumed if it is the usual one and no certificate states its uncertainty.
    """
    mount = campaign.mount
    usual = MountCompensation()
    key = "compensated" if mount.compensated else "not_compensated"
    deflection = words.number(f"{mount.deflection_um_per_bar:g}")
    text = words(f"assumptions.{key}", deflection=deflection)
    is_stated = mount != usual
    if not mount.compensated:
        is_usual = mount.deflection_um_per_bar == usual.deflection_um_per_bar
        is_stated = not is_usual or campaign.instrument.mount_U_percent is not None
    return _marked(text, is_stated, words)


def _force_law_text(campaign: Campaign, words: Words) -> str:
    """Return a string with the force as a linear function of pressure.

    The string states the slope [N/bar] and the offset [N], and has the mark *stated* or *assumed*.
    """
    law = campaign.force_law
    sign = "−" if law.offset_N < 0.0 else "+"
    text = words(
        "assumptions.law",
        slope=words.number(f"{law.slope_N_per_bar:g}"),
        offset=words.number(f"{sign} {abs(law.offset_N):g}"),
    )
    return _marked(text, law != ForceLaw(), words)


def _assumed_size(term: str, size: AssumedSize, words: Words) -> str:
    """Return the size that the model assumes for an effect: ± twice the prior standard deviation.

    ``term`` is the class name of the model term that describes the effect. The result is a string.
    It says "up to" if the model assumes a smaller size for some coefficients of the effect.
    """
    factor, label = source_unit_words(size.source, term, size.unit)
    value = words.number(two_digits(2.0 * size.sd, factor))
    text = f"±\u00a0{value}\u00a0{words.unit(label)}"
    if size.differs:
        return words("entries.up_to", size=text)
    return text


def _deciding_priors(numbers: SheetNumbers, bound: BoundModel, *, is_stated: bool) -> list[str]:
    """Return one string, such as "E_XX1 ± 50 µm/m", for each quantity that depends on its prior.

    A quantity depends on its prior if the prior is the largest source of the quantity's posterior
    variance. The number after ± is twice the prior standard deviation. Only quantities are returned
    whose prior the user gave in the model ``bound`` or, if ``is_stated`` is false, whose prior is
    that of the package.
    """
    words = numbers.words
    quantities = dict(numbers.parameters)
    for name, change in numbers.changes.items():
        quantities[f"{name}_1"] = change
    priors = []
    for name, quantity in quantities.items():
        entry = quantity.entry or quantity.change_entry
        if is_prior_stated(bound, name) != is_stated:
            continue
        if entry is not None and entry.held_by.name == PARAMETERS and np.isfinite(entry.prior_sd):
            factor, label = display_unit(entry.unit)
            size = words.number(two_digits(2.0 * entry.prior_sd, factor))
            priors.append(f"{quantity.symbol} ±\u00a0{size}\u00a0{words.unit(label)}")
    return priors
