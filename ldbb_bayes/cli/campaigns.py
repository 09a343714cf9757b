"""Commands ``import``, ``check`` and ``simulate`` of ``ldbb-bayes``.

These commands read, examine and simulate campaigns, but do not fit a model to them. A campaign is a
set of circular tests of one machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.campaign.directions import planes_run_both_ways
from ldbb_bayes.campaign.folder import (
    IMPORT_NAME,
    MODEL_NAME,
    TRUTH_NAME,
    files_of,
    write_campaign_into,
)
from ldbb_bayes.campaign.preview import CampaignPreview, preview_of_model
from ldbb_bayes.campaign.remarks import Remark, RemarkKind
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.arguments import campaign_fields
from ldbb_bayes.cli.campaign_notes import notes_on_campaign, notes_on_readings
from ldbb_bayes.cli.chosen_model import model_beside
from ldbb_bayes.cli.options import REQUIRED, command, group, option
from ldbb_bayes.cli.output import Output
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.report.campaign_text import parts_of
from ldbb_bayes.units import counted, inside_name, is_direct

__all__ = ["check", "import_", "simulate"]

# name of the file that ``check --out`` writes
_CHECK_NAME = "check.json"


@command
def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="CSV, text, XLSX, XLS or ODS; one test each, or a column that names the test.",
            metavar="FILE...",
        ),
    ],
    out: Annotated[Path, option(Path, "Campaign folder to write.", REQUIRED, metavar="CAMPAIGN")],
    layout: arguments.ChosenLayout,
    name: Annotated[
        dict[str, Any], group(campaign_fields, name=option(str, "Name of the campaign."))
    ],
    table: arguments.TableFields,
    certificates: arguments.Certificates,
    yes: Annotated[bool, arguments.YES],
    force: Annotated[bool, arguments.FORCE],
    as_json: Annotated[bool, arguments.JSON],
    quiet: Annotated[bool, arguments.QUIET],
) -> None:
    """Read tables from instruments or spreadsheets, and write their readings as a campaign.

    The command prints what it assumes about the tables. Every assumed value can be stated instead,
    by an option or in the file of --layout. At a terminal the command asks for information that the
    tables do not give, such as which of two units the readings are in.
    """
    # The modules that import tables are imported here, and not at the top of the file, because only
    # the command ``import`` needs them.
    from ldbb_bayes.cli.questions import can_ask, import_with_answers
    from ldbb_bayes.reading.import_result import Imported
    from ldbb_bayes.reading.layout import layout_to_toml

    output = Output(out, force, as_json, quiet)
    output.check(*files_of(out))
    instrument = lb.Instrument(**certificates)

    def import_with(completed: lb.reading.Layout) -> Imported:
        """Import the user's files; the layout ``completed`` says how their tables are read."""
        return lb.import_campaign(files, layout=completed, **table, **name, instrument=instrument)

    result = import_with_answers(import_with, layout, ask=not yes and can_ask())
    output.deliver(
        result.as_dict(),
        (*parts_of(result), *notes_on_readings(result.campaign)),
        {IMPORT_NAME: layout_to_toml(result.layout)},
        write_more=partial(write_campaign_into, result.campaign),
        note=f"{_counts_in_brackets(result.campaign)}. Look at it: ldbb-bayes check {out}",
    )


def _check_signs(parameters: Mapping[str, float] | None, model: lb.HybridModel, path: Path) -> None:
    """Raise an `InputError` if a true direct compliance is negative, but must not be in the model.

    ``parameters`` are the true values from the file ``path`` in mm, N and rad; None if they are
    drawn at random.
    """
    if not model.prior.truncated:
        return
    for name, value in (parameters or {}).items():
        require(
            not (value < 0.0 and is_direct(inside_name(name))),
            f"{path}: true {name} must not be negative, got {value:g}: a joint yields in the"
            " direction of its load. Correct the sign, or allow it (--without truncation).",
        )


def _counts_in_brackets(campaign: lb.Campaign) -> str:
    """Return the numbers of tests and readings of a campaign as text, in brackets."""
    return f" ({counted(len(campaign.tests), 'test')}, {campaign.readings} readings)"


@command
def check(
    campaign: arguments.GivenCampaign,
    model_file: arguments.ModelBeside,
    output: arguments.OutputOptions,
) -> None:
    """Show what is in a campaign, what looks odd, and what a fit will assume.

    The command fits nothing.
    """
    output.check(_CHECK_NAME)
    # Raise an error if only some tests of a plane state a direction of travel, or if a tolerance
    # cannot be used. A fit raises the same errors.
    planes_run_both_ways(campaign)
    if campaign.tolerances:
        _check_tolerances(campaign)
    preview = lb.check_campaign(campaign)
    uncertainties = lb.terms.uncertainties(campaign)
    if model_file is not None:
        model = lb.read_model(model_file)
        preview = _with_model_file(preview, model_file, model)
        uncertainties = lb.terms.uncertainties(campaign, model.nuisances)
    record = lb.report.with_words(preview) | {
        "uncertainties": uncertainties.as_dict()["assumed"],
        "certificates": dict(uncertainties.certificates),
    }
    output.deliver(record, (*parts_of(preview), *parts_of(uncertainties)), {_CHECK_NAME: record})


def _with_model_file(
    preview: CampaignPreview, model_file: Path, model: lb.HybridModel
) -> CampaignPreview:
    """Return a preview that states what a fit assumes with the model file beside the campaign.

    It names the file, the reference force F0, and the terms of the default model that the model
    leaves out. ``model`` is the model in the file. If it states no F0, F0 is that of the preview.
    """
    assumptions = []
    for remark in preview_of_model(preview, model.terms).assumptions:
        if remark.kind is RemarkKind.REFERENCE:
            values = {"file": model_file.name, **remark.values}
            if model.reference_force_N is not None:
                values["force_N"] = model.reference_force_N
            remark = Remark(RemarkKind.MODEL_FILE, values)
        assumptions.append(remark)
    names = set(lb.HybridModel.default().terms) - set(model.terms)
    missing = [kind.words for name, kind in lb.terms.Term.kinds.items() if name in names]
    if missing:
        values = {"file": model_file.name, "terms": ", ".join(missing)}
        assumptions.append(Remark(RemarkKind.NOT_MODELLED, values))
    return replace(preview, assumptions=tuple(assumptions))


def _check_tolerances(campaign: lb.Campaign) -> None:
    """Raise an `InputError` if a tolerance of a campaign cannot be used in any fit.

    The model is that with the most quantities: compliances that are quadratic in force.
    """
    # The module for the results of fits is imported here, and not at the top of the file, because
    # it takes a long time to load.
    from ldbb_bayes.cli.fit_results import with_tolerances

    with_tolerances(campaign, lb.HybridModel.default(2), {})


@command
def simulate(
    source: Annotated[
        Path,
        typer.Argument(
            help="A TOML of truths (forces_N, parameters, hyper_um), or a plan or campaign."
        ),
    ],
    out: Annotated[Path, option(Path, "Campaign folder to write.", REQUIRED, metavar="DIR")],
    model: arguments.ChosenModel,
    truth: Annotated[
        Path | None,
        option(Path, "Truths for a plan: a TOML, or a truth.json.", metavar="FILE"),
    ],
    table: arguments.TableFields,
    certificates: arguments.Certificates,
    force: Annotated[bool, arguments.FORCE],
    seed: Annotated[int, arguments.SEED],
    as_json: Annotated[bool, arguments.JSON],
    quiet: Annotated[bool, arguments.QUIET],
) -> None:
    """Write a campaign with simulated readings, and truth.json with the true values beside it.

    True values of parameters and noise are drawn at random unless a TOML file states them: for a
    plan whose pilot has readings from what these leave likely, else from the priors.
    """
    # These modules load SciPy, which takes a long time. They are therefore imported here, and not
    # at the top of the file.
    from ldbb_bayes.analysis.design.candidates import with_angles_as_run
    from ldbb_bayes.analysis.design.states import draw_machine_like_pilot
    from ldbb_bayes.model.specification import Truths, is_truths, model_to_toml, read_truths

    effects: dict[str, float] = {}
    if is_truths(source):
        require(
            truth is None,
            f"truths must come from one file, got {source} and {truth}. Give a plan as first"
            " argument, or drop --truth.",
        )
        require(
            not table,
            f"options of a tidy CSV must go with one, got {', '.join(table)} with {source}. Write"
            " them into the file.",
        )
        truths = read_truths(source)
        _check_signs(truths.parameters, model, source)
        if truths.plan is None:
            raise InputError(
                f"{source}: 'forces_N' must be given, found none. List the forces, or give a plan"
                " as first argument."
            )
        plan = replace(truths.plan, instrument=lb.Instrument(**certificates))
    else:
        plan = lb.read_campaign(source, certificates=certificates, **table)
        truths = Truths(None, None, {}, False)
        if truth is not None:
            truths = read_truths(truth)
            _check_signs(truths.parameters, model, truth)
        elif machine := draw_machine_like_pilot(model, plan, seed):
            truths = Truths(None, machine.parameters, machine.hyper_um, False)
            effects = machine.effects
        require(
            truths.plan is None,
            f"{truth}: 'forces_N' must stand in truths given alone, got it beside {source}. Remove"
            " one of them.",
        )
    plan = with_angles_as_run(plan)
    with placed(truth or source):
        simulation = model.simulate(
            plan,
            seed=seed,
            parameters=truths.parameters,
            hyper_um=truths.hyper_um,
            effects=effects,
            exact=truths.exact,
        )
    record = {
        "schema": 1,
        "seed": seed,
        "sha256": simulation.campaign.sha256,
        "parameters": simulation.parameters,
        "units": simulation.units,
        "hyper_um": simulation.hyper_um,
        "effects": simulation.effects,
        "change_with_force": {
            name: asdict(change) for name, change in simulation.change_with_force.items()
        },
    }
    contents: dict[str, Any] = {TRUTH_NAME: record}
    if model_beside(source) is not None:
        contents[MODEL_NAME] = model_to_toml(model)
    output = Output(out, force, as_json, quiet, files=(*files_of(out), MODEL_NAME))
    output.deliver(
        record,
        (*notes_on_campaign(plan, (RemarkKind.NOT_RUN,)), *_notes_on_truth(truth)),
        contents,
        write_more=partial(write_campaign_into, simulation.campaign),
        note=f"{_counts_in_brackets(simulation.campaign)}, the truth in {out}/truth.json",
    )


def _notes_on_truth(truth: Path | None) -> tuple[str, ...]:
    """Return a note on what a simulation does not take from a file truth.json.

    ``truth`` is the file with true values that the user gives, or None. There is no note on a TOML
    file, because all of it is used.
    """
    if truth is None or truth.suffix.lower() != ".json":
        return ()
    return (
        f"Note: parameters and hyper_um are those of {truth}. Its effects, and the scales of its"
        " circles, are not used: they are drawn anew.",
    )
