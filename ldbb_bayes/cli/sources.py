"""Input of ``ldbb-bayes report``: files of readings, a campaign, or fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import LABELS
from ldbb_bayes.cli.questions import complete_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.reading.importing import Imported

__all__ = ["TOML_NAME", "ReportSource", "SourceCampaign", "has_unstated_balls"]

# Name of the file by which a folder is recognised as a campaign.
TOML_NAME = "campaign.toml"


class SourceCampaign(NamedTuple):
    """A campaign, and the record of its import from tables.

    The record states the assumptions of the import; it is None if nothing was imported.
    """

    campaign: lb.Campaign
    imported: Imported | None


def has_unstated_balls(campaign: lb.Campaign) -> bool:
    """Return whether a campaign states nothing about the grade or the form of either ball.

    Parameters
    ----------
    campaign
        The campaign.

    Returns
    -------
    bool
    """
    return campaign.instrument.work == campaign.instrument.tool == lb.Ball()


@dataclass(frozen=True)
class ReportSource:
    """File paths of a report's input, and options that describe tables and instrument.

    Parameters
    ----------
    typed_paths
        Paths as typed by the user.
    paths
        The same paths with ``*`` and ``?`` expanded.
    layout
        Layout of the tables, from a layout file and options.
    campaign_fields
        Fields of the campaign that options state.
    certificates
        Fields of the instrument that options state.
    """

    typed_paths: Sequence[Path]
    paths: Sequence[Path]
    layout: lb.reading.Layout
    campaign_fields: Mapping[str, Any]
    certificates: Mapping[str, Any]

    @property
    def is_result(self) -> bool:
        """Whether the first file path is that of a stored fit."""
        first = self.paths[0]
        return first.suffix == ".nc" or (first.is_dir() and (first / "posterior.nc").exists())

    @property
    def is_campaign(self) -> bool:
        """Whether the first file path is a campaign, which need not be imported from tables."""
        first = self.paths[0]
        return first.suffix.lower() == ".toml" or (first / TOML_NAME).is_file()

    def refuse_table_options(self) -> None:
        """Raise an `InputError` for options that describe tables, machine or instrument.

        A stored fit cannot use such options.

        Raises
        ------
        InputError
            If an option of tables, machine or instrument is given.
        """
        stated = self.layout != lb.reading.Layout() or self.campaign_fields or self.certificates
        require(
            not stated,
            "options of tables, machine and instrument must go with files, got a fit,"
            f" {self.paths[0]}. Fit again with them.",
        )

    def report_folder(self) -> Path:
        """Return the default folder of the report, which is beside the first input file.

        For ``readings.xlsx`` it is ``readings_report``.
        """
        first = self.paths[0]
        if first.name == TOML_NAME:
            first = first.parent
        if first.is_dir():
            first = first.resolve()
            return first.parent / f"{first.name}_report"
        return first.parent / f"{first.stem}_report"

    def read(self, *, ask: bool) -> SourceCampaign:
        """Return the campaign, read from its folder or imported from tables.

        Parameters
        ----------
        ask
            Whether to ask the user about machine, mount and balls if nothing states them.

        Returns
        -------
        SourceCampaign

        Raises
        ------
        InputError
            If files cannot be read or contain no readings, or options do not apply to them.
        """
        if self.is_campaign:
            campaign = self._read_campaign()
            imported = None
            unstated = set()
        else:
            imported = self._import_tables()
            campaign = imported.campaign
            unstated = set(imported.unsaid)
        require(
            not campaign.is_plan,
            f"{self.paths[0]} must have readings to be reported, got a plan. Ask ldbb-bayes"
            " identify or design, or run it.",
        )
        if not ask:
            return SourceCampaign(campaign, imported)

        if has_unstated_balls(campaign):
            unstated.add("balls")
        campaign = complete_campaign(campaign, unstated)
        if imported is not None:
            answered = unstated & {"topology", "mount"}
            assumptions = [
                assumption for assumption in imported.assumptions if assumption.what not in answered
            ]
            imported = replace(imported, campaign=campaign, assumptions=tuple(assumptions))
        return SourceCampaign(campaign, imported)

    def _read_campaign(self) -> lb.Campaign:
        first = self.paths[0]
        require(
            len(self.paths) == 1,
            f"report must have one campaign, got {len(self.paths)}. Report each by itself; several"
            " fits go side by side.",
        )
        require(
            self.layout == lb.reading.Layout(),
            f"options of an import must go with tables, got a campaign, {first}. Leave them out.",
        )
        labels = {}
        fields = {}
        for name, value in self.campaign_fields.items():
            if name == "name" or name in LABELS:
                labels[name] = value
            else:
                fields[name] = value
        campaign = lb.read_campaign(first, certificates=self.certificates, **fields)
        return replace(campaign, **labels)

    def _import_tables(self) -> Imported:
        """Return the campaign imported from the tables, with its assumptions.

        Raise an `InputError` if the first path is a folder.
        """
        first = self.paths[0]
        require(
            not first.is_dir(),
            f"{first} must hold {TOML_NAME} or posterior.nc, got neither. Name the tables in it:"
            f" {first}/*",
        )
        instrument = lb.Instrument(**self.certificates)
        return lb.import_campaign(
            self.typed_paths, layout=self.layout, **self.campaign_fields, instrument=instrument
        )
