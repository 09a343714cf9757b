"""Reports made from files of readings: fit, comparison of models, next tests, HTML page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.analysis.model_comparison import begin_comparison
from ldbb_bayes.analysis.posterior_verdicts import judge_at_force
from ldbb_bayes.campaign.folder import IMPORT_NAME, write_campaign_into
from ldbb_bayes.campaign.tested_forces import check_force, force_to_state
from ldbb_bayes.cli.fit_results import RESULT_FILES, with_tolerances, write_result
from ldbb_bayes.cli.goal_designs import running_order
from ldbb_bayes.cli.output import Output, write_files
from ldbb_bayes.cli.progress import Begin
from ldbb_bayes.cli.sources import ReportSource, SourceCampaign, assumed_parts
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import staged_folder
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, model_of, record_of
from ldbb_bayes.parallel import second_process, start_early
from ldbb_bayes.reading.layout import layout_to_toml
from ldbb_bayes.report import fit_tables, wording
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.fit_record import full_result, result_at_force
from ldbb_bayes.report.page import REPORT_FILES, Document
from ldbb_bayes.report.terminal_translation import printed_in_language
from ldbb_bayes.units import U_PROBABILITY

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

__all__ = ["AVERAGED_NAME", "STEPS", "WrittenReport", "page_settings", "report_files"]

# Name of the file with the posterior that is averaged over constant and linear compliance.
AVERAGED_NAME = "averaged.nc"
# Files and folders that are written for a report made from readings, in addition to the report's
# page and the files of the fit.
_FILES_BESIDE_PAGE = (AVERAGED_NAME, "campaign", "comparison.json", "design.json")
# Approximate durations of the steps in which a report is made, relative to each other. The keys are
# the names of the steps.
STEPS = {"fit": 1.0, "compare": 10.0, "average": 1.0, "page": 8.0}
# Largest numerical error that a report allows in a log evidence [nat]. The command compare allows
# only 0.01, which makes the computation take three to ten times as long.
_TOLERANCE = 0.05


class WrittenReport(NamedTuple):
    """A report whose files have been written into a folder."""

    document: Document
    #: Tables and sentences on the results of the report, to be printed at the terminal.
    parts: tuple[Any, ...]
    #: Whether the random draws of the fit reached the required effective sample size.
    converged: bool
    #: Name of the campaign that sheets 1 and 2 are of, if the report compares it with others; empty
    #: if not. Warnings are then printed before the results, because the results are differences
    #: that a warning may forbid to use.
    compared_campaign: str = ""


@dataclass(frozen=True)
class _Analyses:
    """Results that a report shows in addition to the fit of the campaign.

    If the comparison of models, or the design (choice of the next tests), cannot be computed, a
    string with the reason is stored instead.
    """

    #: Comparison of two models, one with constant compliance and one with compliance linear in
    #: force.
    comparison: lb.analysis.Comparison | str
    #: Posterior averaged over two models, one with constant and one with linear compliance; None if
    #: it cannot be computed.
    averaged: xr.DataTree | None
    #: Function without arguments that returns the best circular tests to run next; the first call
    #: waits for the computation.
    design: Callable[[], lb.analysis.Design | str]


def report_files(
    source: ReportSource,
    output: Output,
    settings: dict[str, Any],
    model: lb.HybridModel,
    steps: AbstractContextManager[Begin],
    *,
    ask: bool = False,
) -> WrittenReport:
    """Read files of readings, fit them, and write the report into a folder.

    Parameters
    ----------
    source
        The files, and the options that describe their tables and the instrument.
    output
        Output of the command ``report``. If it names no folder, the report is written into a folder
        beside the first file.
    settings
        Options of the report; the keys are the names of the options.
    model
        Model with compliance linear in force.
    steps
        Context manager that shows the progress through the steps of `STEPS`, for example
        `ldbb_bayes.cli.progress.step_progress`.
    ask
        Whether to ask the user for information that neither the files nor the options give.

    Returns
    -------
    WrittenReport

    Raises
    ------
    InputError
        If files or options cannot be used; nothing is written.
    """
    _check_settings(settings, source)
    output.out = output.out or source.report_folder()
    output.check(*RESULT_FILES, *REPORT_FILES, *_FILES_BESIDE_PAGE)
    campaign, imported = source.read(ask=ask)
    _check_forces(campaign)
    check_force(campaign, settings.get("force_N"))
    campaign = with_tolerances(campaign, model, settings.get("tolerances", {}))
    source_campaign = SourceCampaign(campaign, imported)
    analyse = _analyse
    other_process: AbstractContextManager[Executor | None] = second_process()
    if settings["sheets_only"]:
        analyse = _analyse_for_sheets
        if len({test.plane for test in campaign.tests}) == 1:
            # The fit takes less time than a second process takes to start.
            other_process = nullcontext()
    with steps as begin_step, other_process as executor:
        fit, analyses = analyse(campaign, model, begin_step, settings, executor)
        stated_posterior = fit if analyses.averaged is None else analyses.averaged
        fit_result = full_result(fit, settings["prob"])
        stated_result = full_result(stated_posterior, settings["prob"])
        if campaign.tolerances:
            # The report decides on conformity only once, at the force that it states. The decisions
            # are made from the averaged posterior or, if there is no average, from the fit. They
            # are then part of the results of the fit and of the results of the averaged posterior,
            # so that both agree with the report.
            decisions = lb.assess_conformity(stated_posterior, force_N=settings.get("force_N"))
            conformity = {name: decision.as_dict() for name, decision in decisions.items()}
            fit_result["conformity"] = conformity
            stated_result["conformity"] = conformity
        with staged_folder(output.out, force=output.force, ours=output.files) as staging:
            document = lb.write_report(
                fit,
                staging,
                comparison=analyses.comparison,
                recommended=analyses.design,
                averaged=analyses.averaged,
                **page_settings(settings),
                progress=begin_step("page"),
            )
            _write_beside_page(staging, fit, fit_result, imported, analyses)
    names = [campaign.name, *(test.name for test in campaign.tests)]
    for path in source.paths:
        names += [str(path), path.name]
    parts = _printed_parts(
        source_campaign, stated_posterior, stated_result, analyses, settings, names
    )
    if not settings["sheets_only"]:
        parts += _printed_annex(analyses)
    parts = printed_in_language(parts, settings["language"], names)
    return WrittenReport(document, parts, record_of(fit)["sampler"]["converged"])


def _check_settings(settings: dict[str, Any], source: ReportSource) -> None:
    """Raise an `InputError` for options that are valid only for reports made from stored fits.

    ``settings`` are the options; the keys are the names of the options. ``source`` holds the paths
    of the files of readings, for the error message.
    """
    for name in ("comparison", "design"):
        require(
            name not in settings,
            f"--{name} must go with a fit, got {source.paths[0]}. Leave it out: it is worked out.",
        )
    for name in ("same_instrument", "same_machine"):
        require(
            not settings[name],
            f"--{name.replace('_', '-')} must go with several fits, got readings, which would be"
            " taken as one campaign. Make a fit of each campaign first (fit, or report with --out),"
            " and name the fits.",
        )
    require(
        not (settings["sheets_only"] and "tests" in settings),
        "--tests must go with the annex, which recommends circles, got --sheets-only. Leave one of"
        " them out.",
    )


def _check_forces(campaign: lb.Campaign) -> None:
    """Raise an `InputError` if all tests of a campaign have the same force.

    A report of readings compares constant compliance with compliance linear in force.
    """
    require(
        campaign.force_levels > 1,
        "report must weigh constant and linear compliance, which takes tests at two forces or more,"
        f" got one ({campaign.forces_N[0]:g} N). Add tests at another force; or fit constant"
        " compliance, and report the fit: ldbb-bayes fit CAMPAIGN --degree 0 --out DIR, then"
        " ldbb-bayes report DIR.",
    )


def page_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the options that are also arguments of `ldbb_bayes.write_report`.

    Parameters
    ----------
    settings
        Options of the report; the keys are the names of the options.

    Returns
    -------
    dict
        Options that set the probability, the language and the force, and options that say whether
        the annex (the sections after the certificate) is printed or left out. The keys are the
        names of the arguments. Options that the user did not type are missing.
    """
    names = ("prob", "language", "annex", "sheets_only", "force_N")
    return {name: settings[name] for name in names if name in settings}


def _analyse(
    campaign: lb.Campaign,
    model: lb.HybridModel,
    begin_step: Begin,
    settings: dict[str, Any],
    executor: Executor | None,
) -> tuple[xr.DataTree, _Analyses]:
    """Return the fit of a model, and further analyses.

    In the fitted model, compliance changes linearly with force. The further analyses are a
    comparison with a model of constant compliance, an average over these two models, and the choice
    of the next tests. If there is a second process, it may compute the fit, parts of the comparison
    and the choice of the next tests.

    Parameters
    ----------
    campaign
        Campaign with readings.
    model
        Model with compliance linear in force.
    begin_step
        Function that is called with the name of a step when this step of the report begins, so that
        the progress bar shows the name.
    settings
        Options of the report; the keys are the names of the options.
    executor
        Executor with a second process, which computes a part of the analyses; None if there is no
        second process.
    """
    seed = settings["seed"]
    models = _averaged_models(model)
    begin_step("fit")
    fit = _begin_fit(model, campaign, seed, executor)

    evidences = Evidences(campaign, tolerance=_TOLERANCE)
    finish_comparison = _result_or_reason(
        partial(
            begin_comparison,
            models,
            evidences,
            prob=settings["prob"],
            seed=seed,
            progress=begin_step("compare"),
            executor=executor,
        )
    )
    choose_tests = partial(lb.design, model, pilot=campaign, tests=settings.get("tests"), seed=seed)
    design = start_early(partial(_result_or_reason, choose_tests), executor)
    comparison = finish_comparison
    if not isinstance(comparison, str):
        comparison = _result_or_reason(finish_comparison)

    begin_step("average")
    averaged = _average_or_none(models, evidences, seed)
    fitted = fit()
    # The design (choice of the next tests) is shown on the page, in files and at the terminal, but
    # is computed only once.
    return fitted, _Analyses(comparison, averaged, cache(design))


def _analyse_for_sheets(
    campaign: lb.Campaign,
    model: lb.HybridModel,
    begin_step: Begin,
    settings: dict[str, Any],
    executor: Executor | None,
) -> tuple[xr.DataTree, _Analyses]:
    """Return a fit with compliance linear in force, and an average over two models.

    One of the two models has constant compliance, the other linear compliance. For the arguments
    see `_analyse`. This function is used for a report without its second part, the annex. A
    comparison of models and a choice of the next tests are not computed, because only the annex
    shows them.
    """
    seed = settings["seed"]
    begin_step("fit")
    fit = _begin_fit(model, campaign, seed, executor)
    begin_step("average")
    evidences = Evidences(campaign, tolerance=_TOLERANCE)
    averaged = _average_or_none(_averaged_models(model), evidences, seed)
    return fit(), _Analyses(wording.NO_ANNEX, averaged, _no_design)


def _begin_fit(
    model: lb.HybridModel, campaign: lb.Campaign, seed: int, executor: Executor | None
) -> Callable[[], xr.DataTree]:
    """Begin the fit of a model in a second process, and return a function that waits for it.

    If ``executor`` is None, there is no second process, and the fit is computed at once. ``seed``
    is the seed of the random draws.
    """
    fit = start_early(
        partial(lb.sample, model, campaign, sampler="independent", seed=seed), executor
    )
    if executor is not None:
        return fit
    posterior = fit()
    return lambda: posterior


def _no_design() -> str:
    """Return a text that says why a report recommends no tests to run next.

    The recommendation would stand in the annex, but the user asked for a report without the annex.
    """
    return wording.NO_ANNEX


def _averaged_models(model: lb.HybridModel) -> dict[str, lb.HybridModel]:
    """Return ``model``, whose compliance is linear, and the same model with constant compliance."""
    return {"constant": model.with_degree(0), "linear": model}


def _average_or_none(
    models: Mapping[str, lb.HybridModel], evidences: Evidences, seed: int
) -> xr.DataTree | None:
    """Return the posterior averaged over ``models``; None if it cannot be computed.

    ``evidences`` holds the evidences of models that are already computed; ``seed`` is the seed of
    the random draws.
    """
    try:
        return lb.average(models, evidences.campaign, evidences=evidences, seed=seed)
    except InputError:
        return None


def _result_or_reason(work: Callable[[], Any]) -> Any:
    """Return the result of an analysis for a report, or a string with the reason for its failure.

    ``work`` is the function without arguments that computes the analysis.
    """
    try:
        return work()
    except InputError as error:
        return str(error)


def _write_beside_page(
    folder: Path,
    fit: xr.DataTree,
    result: dict[str, Any],
    imported: lb.reading.Imported | None,
    analyses: _Analyses,
) -> None:
    """Write all files of a report except its page.

    The files hold the posterior of the fit, the posterior averaged over two models, the campaign,
    the comparison of the models, and the design (choice of the next tests).

    Parameters
    ----------
    folder
        Existing folder of the report.
    fit
        Posterior of the fit with linear compliance.
    result
        Summary of the fit.
    imported
        Record of the import of the tables, with the layout of the tables, which is written into a
        file; None if the campaign was not imported.
    analyses
        Further results; results that could not be computed are not written.
    """
    write_result(fit, result, folder)
    if analyses.averaged is not None:
        lb.save(analyses.averaged, folder / AVERAGED_NAME)
    (folder / "campaign").mkdir()
    write_campaign_into(campaign_of(fit), folder / "campaign")
    if imported is not None:
        write_files(folder / "campaign", {IMPORT_NAME: layout_to_toml(imported.layout)})
    records = {}
    for name, result_or_reason in (
        ("comparison.json", analyses.comparison),
        ("design.json", analyses.design()),
    ):
        if not isinstance(result_or_reason, str):
            records[name] = {"schema": 1, **lb.report.with_words(result_or_reason)}
    write_files(folder, records)


def _printed_parts(
    source: SourceCampaign,
    stated: xr.DataTree,
    result: dict[str, Any],
    analyses: _Analyses,
    settings: Mapping[str, Any],
    names: Sequence[str],
) -> tuple[Any, ...]:
    """Return the assumptions, remarks and results of a report, to be printed at the terminal.

    ``source`` is the campaign with the record of its import. ``stated`` is the posterior whose
    results are stated: the average over constant and linear compliance or, if there is no average,
    the fit of linear compliance. ``result`` is the summary of ``stated``. ``analyses`` are the
    further results of the report. ``settings`` are the options of the report, and ``names`` the
    names of files and tests. The assumptions are in the language of the report, all else is in
    English.
    """
    reference_N = bound_of(stated).setting.reference_force_N
    force_N = settings.get("force_N") or force_to_state(campaign_of(stated), reference_N)
    result_of_U = result
    if settings["prob"] != U_PROBABILITY:
        result_of_U = full_result(stated, U_PROBABILITY)
    result_of_U = result_at_force(stated, result_of_U, U_PROBABILITY, force_N)
    result = result_at_force(stated, result, settings["prob"], force_N)
    campaign = campaign_of(stated)
    constant_names = model_of(stated).with_degree(0).bind(campaign).names
    parameters = {
        name: summary for name, summary in result["parameters"].items() if name in constant_names
    }
    heading = "Linear compliance:"
    if analyses.averaged is not None:
        heading = wording.averaged_over(record_of(analyses.averaged)["averaged"]["probability"])
    table = fit_tables.results_table(
        result | {"parameters": parameters},
        judge_at_force(stated, force_N),
        force_N=force_N,
        result_of_U=result_of_U,
    )
    parts: list[Any] = [
        *assumed_parts(campaign, source.imported, settings["language"], names),
        *wording.preview_sentences(lb.check_campaign(campaign)),
        heading,
        table,
        *fit_tables.explanation_of_U(table),
    ]
    concerns = fit_of(stated).concerns
    near_zero = tuple(concern for concern in concerns if concern.kind == ConcernKind.NEAR_ZERO)
    parts += [f"Note: {sentence}" for sentence in wording.concern_sentences(near_zero, {})]
    if "conformity" in result:
        parts.append(conformity_table(result["conformity"]))
    return tuple(parts)


def _printed_annex(analyses: _Analyses) -> tuple[Any, ...]:
    """Return what a report says about the comparison of models and about the next tests."""
    parts: list[Any] = []
    comparison = analyses.comparison
    if isinstance(comparison, str):
        parts.append(comparison)
    else:
        parts.append(wording.comparison_sentences(comparison)[0])
        parts += wording.odd_tests_sentences(comparison)
    design = analyses.design()
    if isinstance(design, str):
        parts.append(design)
    else:
        parts.append(_next_tests(design.plan()))
    return tuple(parts)


def _next_tests(plan: lb.Campaign) -> str:
    """Return sentences that list the forces of a plan's tests, and say why these were chosen.

    The forces are listed in the order in which the tests are to be run.
    """
    labels = [f"{test.force_N:.4g} N" for test in plan.tests]
    return (
        f"Run next, in this order: {running_order(plan, labels)}. At these forces the readings are"
        " expected to tell most about the parameters."
    )
