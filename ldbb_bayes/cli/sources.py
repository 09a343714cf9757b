"""Input of commands such as ``report``: files of readings, a campaign, or stored fits."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import LABELS
from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.campaign.folder_of_tables import advice_on_folder
from ldbb_bayes.campaign.readings_table import is_tidy_table
from ldbb_bayes.cli.questions import can_ask, complete_campaign, import_with_answers
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files.similar_names import advice_on_path
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.reading.import_result import Imported
from ldbb_bayes.report import import_text, wording
from ldbb_bayes.report.terminal_translation import assumption_in_language

__all__ = [
    "ReportSource",
    "SourceCampaign",
    "assumed_parts",
    "has_unstated_balls",
]


class SourceCampaign(NamedTuple):
    """A campaign, and the record of its import from tables.

    The record states the assumptions of the import. It is None if nothing was imported.
    """

    campaign: lb.Campaign
    imported: Imported | None


def has_unstated_balls(campaign: lb.Campaign) -> bool:
    """Return whether a campaign states nothing about the work ball and nothing about the tool ball.

    Parameters
    ----------
    campaign
        The campaign.

    Returns
    -------
    bool
    """
    return campaign.instrument.work == campaign.instrument.tool == lb.Ball()


def assumed_parts(
    campaign: lb.Campaign,
    imported: Imported | None,
    language: str = "en",
    names: Sequence[str] = (),
) -> tuple[Any, ...]:
    """Return tables and sentences on the assumptions about imported files and about the balls.

    If the campaign states nothing about the form deviations of the two balls, one sentence says
    only that the balls are "as the model assumes". The sentence does not give the values of the
    model's prior for the form deviations.

    Parameters
    ----------
    campaign
        The campaign.
    imported
        Record of the import of the tables, with the assumptions made; None if the campaign was not
        imported.
    language
        Code of the language in which the assumptions are stated. The heading is English.
    names
        Names of files and tests, which are not translated.

    Returns
    -------
    tuple
        Tables and sentences.
    """
    assumptions: tuple[Assumption, ...] = ()
    if imported is not None:
        assumptions = imported.assumptions
    if has_unstated_balls(campaign):
        balls = Assumption(
            "",
            "balls",
            "as the model assumes",
            "nothing says otherwise",
            "--balls, --work-ball, --tool-ball",
        )
        assumptions = (*assumptions, balls)
    assumptions = tuple(
        assumption_in_language(assumption, language, names) for assumption in assumptions
    )
    if imported is None:
        return tuple(wording.assumption_words(assumption) for assumption in assumptions)
    return tuple(import_text.parts_of(replace(imported, assumptions=assumptions)))


def _require_path(path: Path) -> None:
    """Raise an `InputError` that lists the readable kinds of files if a path does not exist."""
    require(
        path.exists(),
        f"{path} must be a table (CSV or other text, XLSX, XLSB, XLS, ODS), a folder with"
        f" {TOML_NAME}, a {TOML_NAME} or the --out folder of a fit, found none."
        f" {advice_on_path(path)}",
    )


def _how_to_compare(paths: Sequence[Path]) -> str:
    """Return a sentence with the commands that compare several campaigns.

    Paths of fits need no command of their own. If ``paths`` also has other files, such as tables,
    the sentence says only that several fits can be compared.
    """
    commands = []
    fits = []
    for number, path in enumerate(paths, start=1):
        if (path / "posterior.nc").is_file():
            fits.append(shlex.quote(str(path)))
        elif (path / TOML_NAME).is_file() or path.name == TOML_NAME:
            fits.append(f"fit_{number}")
            commands.append(f"ldbb-bayes fit {shlex.quote(str(path))} --out fit_{number}")
    if len(fits) < len(paths):
        return "report sets several fits side by side."
    commands.append(f"ldbb-bayes report {' '.join(fits)}")
    return f"To compare them: {'; '.join(commands)}"


@dataclass(frozen=True)
class ReportSource:
    """Paths of the files that a command reads, and options that describe tables and instrument.

    Parameters
    ----------
    typed_paths
        Paths as the user typed them.
    paths
        The same paths with ``*`` and ``?`` expanded.
    layout
        Layout of the tables, from a layout file and options.
    campaign_fields
        Fields of the campaign that the options set.
    certificates
        Fields of the instrument that the options set.
    """

    typed_paths: Sequence[Path]
    paths: Sequence[Path]
    layout: lb.reading.Layout
    campaign_fields: Mapping[str, Any]
    certificates: Mapping[str, Any]

    @property
    def is_result(self) -> bool:
        """Whether the first of ``paths`` is a stored fit.

        A stored fit is a path that ends in ``.nc``, which need not exist, or a folder with a file
        ``posterior.nc``.
        """
        first = self.paths[0]
        return first.suffix == ".nc" or (first.is_dir() and (first / "posterior.nc").exists())

    @property
    def is_campaign(self) -> bool:
        """Whether the first of ``paths`` is a campaign folder, or a path that ends in ``.toml``.

        Such a path needs no import. It need not exist.
        """
        first = self.paths[0]
        return first.suffix.lower() == ".toml" or (first / TOML_NAME).is_file()

    def refuse_table_options(self) -> None:
        """Raise an `InputError` for options that describe tables, machine or instrument.

        A stored fit cannot use such options.

        Raises
        ------
        InputError
            If such an option is given.
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
        """Return the campaign, read from a campaign folder or imported from tables.

        Parameters
        ----------
        ask
            Whether to ask the user for information that the files do not give. The user is also
            asked about the machine, mount and balls if neither the files nor the options describe
            them.

        Returns
        -------
        SourceCampaign

        Raises
        ------
        InputError
            If files cannot be read or contain no readings, or if options do not apply to these
            files.
        """
        campaign, imported = self._read_readings(ask=ask)
        unstated: set[str] = set()
        if imported is not None:
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

    def read_any(self, *, may_ask: bool = True) -> SourceCampaign:
        """Return the campaign or plan that the user names.

        The user may name a folder of a campaign, a stored fit, or files with tables. If the tables
        lack information that is needed to read them, the user is asked for it at a terminal. The
        user is not asked about the machine, the mount or the balls.

        Parameters
        ----------
        may_ask
            Whether to ask at a terminal. If false, tables that lack information are refused.

        Returns
        -------
        SourceCampaign

        Raises
        ------
        InputError
            If files cannot be read, or if options do not apply to these files.
        """
        first = self.paths[0]
        if self.is_result and not self.is_campaign:
            require(
                len(self.paths) == 1,
                f"one fit must be given, got {len(self.paths)}. Name one of them.",
            )
            self.refuse_table_options()
            return SourceCampaign(campaign_of(lb.load(first)), None)
        is_tidy = len(self.paths) == 1 and first.is_file() and is_tidy_table(first)
        _require_path(first)
        is_folder = len(self.paths) == 1 and not first.is_file()
        if is_folder:
            self._refuse_layout()
        if is_folder or (is_tidy and self.layout == lb.reading.Layout()):
            campaign = lb.read_campaign(
                first, certificates=self.certificates, **self.campaign_fields
            )
            return SourceCampaign(campaign, None)
        return self._read_readings(ask=may_ask and can_ask())

    def _read_readings(self, *, ask: bool) -> SourceCampaign:
        """Return the campaign that is read from a campaign.toml or imported from the user's tables.

        ``ask`` states whether to ask the user for information that the tables do not give.
        """
        _require_path(self.paths[0])
        if self.is_campaign:
            return SourceCampaign(self._read_campaign(), None)
        imported = self._import_tables(ask=ask)
        return SourceCampaign(imported.campaign, imported)

    def _read_campaign(self) -> lb.Campaign:
        """Return the campaign in the folder or the campaign.toml that the user names.

        Names and dates that the user gives as options replace those of the campaign. Raise an
        `InputError` if several files are given, or if an option is given that applies only to the
        import of tables.
        """
        first = self.paths[0]
        require(
            len(self.paths) == 1,
            f"one campaign must be given, got {len(self.paths)} files. Take each by itself."
            f" {_how_to_compare(self.paths)}",
        )
        self._refuse_layout()
        labels = {}
        fields = {}
        for name, value in self.campaign_fields.items():
            if name == "name" or name in LABELS:
                labels[name] = value
            else:
                fields[name] = value
        campaign = lb.read_campaign(first, certificates=self.certificates, **fields)
        return replace(campaign, **labels)

    def _refuse_layout(self) -> None:
        """Raise an `InputError` if an option is given that applies only to the import of tables."""
        require(
            self.layout == lb.reading.Layout(),
            f"options of an import must go with tables, got a campaign, {self.paths[0]}. Leave them"
            " out.",
        )

    def _import_tables(self, *, ask: bool) -> Imported:
        """Return the campaign imported from the user's tables, with the assumptions of the import.

        ``ask`` states whether to ask the user for information that the tables do not give. Raise an
        `InputError` if the first of ``paths`` is a folder, or if the tables cannot be imported.
        """
        first = self.paths[0]
        if first.is_dir():
            raise InputError(
                f"{first} must hold {TOML_NAME} or posterior.nc, got neither."
                f" {advice_on_folder(first)}"
            )
        instrument = lb.Instrument(**self.certificates)

        def import_with(layout: lb.reading.Layout) -> Imported:
            """Import the user's files, whose tables have the given layout; return the campaign."""
            return lb.import_campaign(
                self.typed_paths, layout=layout, **self.campaign_fields, instrument=instrument
            )

        return import_with_answers(import_with, self.layout, ask=ask)
