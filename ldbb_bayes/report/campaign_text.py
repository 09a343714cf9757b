"""Tables and sentences on campaigns: what was measured, and what a fit assumes.

Campaigns are also displayed before any fit. This module does not import the analysis modules,
because loading them would delay the display.
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circle_preview import TestPreview
from ldbb_bayes.campaign.preview import CampaignPreview
from ldbb_bayes.model.terms import BallForm, Term, Uncertainties
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import value_and_uncertainty

__all__ = ["parts_of"]


class _Setting(NamedTuple):
    """A column in a table of tests that shows one setting, such as the radius.

    ``head`` is the heading of the column; ``template`` is the format string of its values.
    """

    head: str
    template: str


# Columns for the settings of circular tests. The keys are the names of the settings, which are
# attributes of a test. The table of a preview has such a column only if the tests differ in the
# setting.
_SETTINGS = {
    "plane": _Setting("plane", "{}"),
    "setup": _Setting("set-up", "{}"),
    "radius_mm": _Setting("R (mm)", "{:g}"),
    "centre_mm": _Setting("centre (mm)", "({0[0]:g}, {0[1]:g}, {0[2]:g})"),
}
_CAMPAIGN_COLUMNS = {
    "test": "name",
    "force (N)": "force_N",
    "pressure (bar)": "pressure_bar",
    "arc (°)": "arc_deg",
    "direction": "direction",
    "plane": "plane",
    "radius (mm)": "radius_mm",
    "work ball (°)": "work_ball_deg",
    "tool ball (°)": "tool_ball_deg",
}


@parts_of.register
def _passages_of_campaign(campaign: Campaign) -> tuple[Passage, ...]:
    """Return a table of a campaign's tests, with one row per test."""
    rows = []
    for test in campaign.tests:
        cells = [getattr(test, field) for field in _CAMPAIGN_COLUMNS.values()]
        rows.append([*cells, len(test.angle_deg)])
    text_columns = ["plane"]
    if any(test.direction for test in campaign.tests):
        text_columns.append("direction")
    radii_mm = sorted({test.circle.radius_mm for test in campaign.tests})
    radii = ", ".join(f"{radius_mm:g}" for radius_mm in radii_mm)
    caption = (
        f"{repr(campaign)[1:-1]}; {campaign.topology}, plane {campaign.machine().plane},"
        f" R = {radii} mm"
    )
    return (Table.of(caption, [*_CAMPAIGN_COLUMNS, "readings"], rows, text=text_columns),)


@parts_of.register
def _passages_of_campaign_preview(preview: CampaignPreview) -> tuple[Passage, ...]:
    """Return a table of the tests of a campaign, remarks, and a list of what a fit will assume.

    A preview shows what can be seen in the readings before a model is fitted. The table has columns
    for the plane, the set-up, the radius and the centre only if the tests differ in these settings.
    The column "balls" holds the angles by which the work ball and the tool ball are turned in their
    sockets (clocking).
    """
    varied_settings = []
    for field in _SETTINGS:
        if len({getattr(test, field) for test in preview.tests}) > 1:
            varied_settings.append(field)
    rows = [_preview_row(test, varied_settings) for test in preview.tests]
    heads = (
        "test",
        "force (N)",
        "pressure (bar)",
        "readings",
        "arc (°)",
        "gap (°)",
        "direction",
        *(_SETTINGS[field].head for field in varied_settings),
        "balls (°)",
        "step (µm)",
        "spikes",
        "noise (µm)",
        "end − start (µm)",
        "peak to peak (µm)",
    )
    return (
        Table.of("", heads, rows, text=("direction", "plane", "centre (mm)")),
        *wording.preview_sentences(preview),
        "A fit will assume:",
        tuple(map(wording.remark_words, preview.assumptions)),
    )


def _preview_row(test: TestPreview, varied_settings: list[str]) -> tuple[str, ...]:
    """Return the cells that describe one test in the table of a preview.

    ``varied_settings`` holds the names of the settings, such as the radius, that differ between the
    tests of the campaign. Only these settings have a cell.
    """
    return (
        test.name,
        f"{test.force_N:.4g}",
        f"{test.pressure_bar:.3g}",
        str(test.readings),
        f"{test.arc_deg:.0f}",
        f"{test.largest_gap_deg:.2g}",
        wording.travel_words(test),
        *(_SETTINGS[field].template.format(getattr(test, field)) for field in varied_settings),
        f"{test.work_ball_deg:g} / {test.tool_ball_deg:g}",
        _significant(test.resolution_um, 2),
        str(test.spikes),
        _significant(test.noise_um, 3),
        _significant(test.start_end_um, 3),
        _significant(test.peak_to_peak_um, 3),
    )


def _significant(value: float | None, digits: int) -> str:
    """Return a value as a string with ``digits`` significant digits, or a dash for None."""
    return "–" if value is None else f"{value:.{digits}g}"


@parts_of.register
def _passages_of_uncertainties(result: Uncertainties) -> tuple[Passage, ...]:
    """Return a table of what a fit assumes about the instrument, and a list of its certificates.

    Each row of the table states a quantity, its nominal value, its standard uncertainty u, and
    whether u comes from a certificate or from the model. The last column names the place in
    campaign.toml where the user can state the quantity. If no certificate states the form of a
    ball, a note on the lobes (periodic form errors) of balls follows the table.
    """
    rows = []
    for assumed in result.assumed:
        _, unit_size, label = Term.owner(assumed.name).unit_of(assumed.name)
        words, place = wording.assumed_words(assumed)
        nominal, spread = value_and_uncertainty(assumed.value / unit_size, assumed.sd / unit_size)
        source = "certificate" if assumed.stated else "the model"
        rows.append((words, nominal, spread, label, source, place))
    heads = ("assumed", "nominal", "u (1 sd)", "unit", "source", "in campaign.toml")
    table = Table.of("What a fit assumes of the instrument", heads, rows, text=heads[3:])
    certificates = [
        f"Certificate of the {piece}: {name}" for piece, name in result.certificates.items()
    ]
    if any(_is_assumed_lobe(assumed) for assumed in result.assumed):
        return (table, *certificates, wording.PAGE["lobes"])
    return (table, *certificates)


def _is_assumed_lobe(assumed: Uncertainty) -> bool:
    """Return whether ``assumed`` is the form uncertainty of a ball without certificate or grade."""
    return Term.owner(assumed.name) is BallForm and not assumed.stated
