"""The model of the readings that the user chooses by options, or by a file beside the campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import typer

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import MODEL_NAME, TOML_NAME
from ldbb_bayes.cli.options import Option, options_of
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.gathering import gather
from ldbb_bayes.model.terms import Term

__all__ = ["model_beside", "model_file_of_campaign", "model_from", "model_options"]


def model_options() -> dict[str, Option]:
    """Return the command-line options with which the user describes the model of the readings.

    The help text of the option ``--without`` lists all terms that a model can have.
    """
    options = options_of("model")
    terms = [kind.key() for kind in Term.kinds.values()]
    without = options["without"]
    help_text = without.help.format(terms=", ".join([*terms, "truncation"]))
    options["without"] = replace(without, help=help_text)
    return options


def model_from(
    degree: int | None = None,
    preset: str | None = None,
    without: tuple[str, ...] = (),
    model: Path | None = None,
    drift: str | None = None,
    *,
    campaign: Path | None = None,
    files: Sequence[Path] = (),
    source: Path | Sequence[Path] = (),
    campaigns: Sequence[str] = (),
) -> lb.HybridModel:
    """Return the model of the readings that the command-line options describe.

    If neither ``model`` nor ``preset`` is given, and a file model.toml lies in the folder of the
    campaign, beside its campaign.toml, the model is read from this file. `design` writes such a
    file with a plan. The campaigns of a batch have one model. It is read from such files if each
    campaign has one and all files are the same. A note on stderr says so.

    Parameters
    ----------
    degree
        Degree of the compliance as a polynomial in force. Default: the degree in the model file, or
        1 if there is no model file.
    preset
        Name of a set of terms and priors: ``default``, ``first`` or ``paper``. Default:
        ``default``.
    without
        Names of terms of the model to leave out, such as ``drift``.
    model
        Path of a model file (TOML), instead of a preset.
    drift
        Quantity to which drift is proportional: ``time`` or ``temperature``. By default, the drift
        term of the model is not changed.
    campaign, files, source
        Path of the campaign, as typed by the user. Commands name this argument differently. If it
        holds several paths, they are tables, which have no model beside them.
    campaigns
        Paths and lists of the campaigns of a batch, as typed by the user.

    Returns
    -------
    HybridModel

    Raises
    ------
    InputError
        If both a model file and a preset are given; if the preset or the name of a term is unknown;
        if the file cannot be used; or if ``drift`` is given and ``without`` contains ``drift``.
    """
    if drift is not None and "drift" in without:
        raise InputError(
            f"drift must be added or left out, got --drift {drift} and --without drift. Keep one of"
            " them."
        )
    if model is not None and preset is not None:
        raise InputError(
            "the model must come from --model or --preset, got both. Write preset = … into the"
            " file."
        )
    if model is None and preset is None:
        if campaigns:
            model = _model_file_of_batch(campaigns)
        else:
            model = model_file_of_campaign(campaign or files or source)
        if model is not None:
            typer.echo(f"The model is that of {model}. For another give --preset.", err=True)
    chosen = _model_of(model, preset or "default", degree).without(*without)
    if drift is not None:
        chosen = chosen.with_term(_drift_over(drift, chosen))
    return chosen


def _model_of(file: Path | None, preset: str, degree: int | None) -> lb.HybridModel:
    """Return the model in a model file, or that of a preset if there is no file.

    ``degree`` is the degree of the compliance; None for the degree in the file, or 1 without a
    file.
    """
    if file is None:
        return lb.HybridModel.from_preset(preset, 1 if degree is None else degree)
    model = lb.read_model(file)
    if degree is None:
        return model
    return model.with_degree(degree)


def model_file_of_campaign(campaign: Path | Sequence[Path]) -> Path | None:
    """Return the path of the model.toml beside the campaign that the user names, or None.

    ``campaign`` is one path, or all paths that the user typed. Several paths are tables, which have
    no model beside them.
    """
    if isinstance(campaign, Path):
        return model_beside(campaign)
    if len(campaign) == 1:
        return model_beside(campaign[0])
    return None


def _model_file_of_batch(campaigns: Sequence[str]) -> Path | None:
    """Return the path of the model.toml that lies beside every campaign of a batch, or None.

    The model.toml of all campaigns must have the same content. If only some campaigns have one, or
    if the contents differ, a note on stderr says that the files are not used. ``campaigns`` are
    paths and lists of campaigns, as typed by the user.
    """
    folders = [Path(path) for path in gather(campaigns)]
    files = [file for file in map(model_beside, folders) if file is not None]
    if not files:
        return None
    all_have_one = len(files) == len(folders)
    if all_have_one and len({file.read_bytes() for file in files}) == 1:
        return files[0]
    typer.echo(
        f"The campaigns of a batch have one model, here that of --preset default: {len(files)} of"
        f" {len(folders)} have a {MODEL_NAME} beside them, such as {files[0]}, which are not used."
        " For one of them give --model.",
        err=True,
    )
    return None


def model_beside(campaign: Path) -> Path | None:
    """Return the path of the file model.toml that lies in the folder of a campaign.

    Parameters
    ----------
    campaign
        A campaign folder, or its campaign.toml.

    Returns
    -------
    pathlib.Path or None
        None if there is no such file, or if ``campaign`` is something else, such as a table.
    """
    folder = campaign
    if campaign.name == TOML_NAME:
        folder = campaign.parent
    if (folder / TOML_NAME).is_file() and (folder / MODEL_NAME).is_file():
        return folder / MODEL_NAME
    return None


def _drift_over(covariate: str, model: lb.HybridModel) -> lb.terms.Drift:
    """Return the drift term of a model, with drift proportional to the quantity ``covariate``.

    The quantity is ``time`` or ``temperature``. The other settings are copied from the model's
    drift term; they are the defaults if the model has no drift term.
    """
    usual = lb.terms.Drift()
    for term in model.nuisances:
        if isinstance(term, lb.terms.Drift):
            usual = term
    return replace(usual, over=covariate)  # type: ignore[arg-type]
