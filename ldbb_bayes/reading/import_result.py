"""Result of an import: campaign, layout of the files, and assumptions that were made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import PlainSerializer

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.results import Result

__all__ = ["Imported"]


def _campaign_in_json(campaign: Campaign) -> dict[str, Any]:
    """Return a dict for JSON with a campaign's name, number of tests and number of readings."""
    return {
        "name": campaign.name,
        "tests": len(campaign.tests),
        "readings": campaign.readings,
    }


def _layout_in_json(layout: Layout) -> dict[str, Any]:
    """Return the stated fields of a layout as a dict for JSON."""
    return layout.model_dump(by_alias=True, exclude_none=True)


@dataclass(frozen=True, eq=False)
class Imported(Result):
    """An imported campaign, with all assumptions that were made.

    Examples
    --------
    >>> angle_deg = np.arange(0.0, 360.0, 5.0)
    >>> table = np.column_stack([angle_deg, np.cos(np.deg2rad(2.0 * angle_deg))])
    >>> np.savetxt("36 N.csv", table, header="angle [deg];reading [um]", delimiter=";", comments="")
    >>> imported = lb.import_campaign("36 N.csv")
    >>> imported.layout.columns
    {'angle': 'angle [deg]', 'reading': 'reading [um]'}
    >>> imported.unsaid
    ('topology', 'plane', 'radius_mm', 'resolution_um', 'mount')
    """

    #: version of the format in which an imported campaign is written as JSON
    schema: int = field(default=1, init=False)
    #: imported campaign. If the import is written as JSON, only the campaign's name, number of
    #: tests and number of readings are written
    campaign: Annotated[Campaign, PlainSerializer(_campaign_in_json)]
    #: layout with which the files can be read again without assumptions about their format
    layout: Annotated[Layout, PlainSerializer(_layout_in_json)]
    #: assumptions that the import made, each with the command-line option that changes it
    assumptions: tuple[Assumption, ...]
    #: names of the fields of the campaign that neither the files nor the user state; these fields
    #: have their default values
    unsaid: tuple[str, ...]
