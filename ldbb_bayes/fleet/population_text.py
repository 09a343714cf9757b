"""Population of machines as a table, sentences and a JSON record with sentences."""

from __future__ import annotations

import json
from typing import Any

from ldbb_bayes.fleet.interval_summary import Summary
from ldbb_bayes.fleet.population import PooledParameter, Population
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import PAGE, population_doubts, population_sentences, with_words
from ldbb_bayes.results import Table, json_text
from ldbb_bayes.units import (
    NO_VALUE,
    display_name,
    display_unit,
    plus_minus,
    round_uncertainty,
    state,
)

__all__ = ["parts_of"]


@with_words.register
def _population_record(result: Population) -> dict[str, Any]:
    """Return the content of the file population.json.

    The file holds the results, sentences on their limitations, and the SHA-256 digest of both.
    """
    record = result.as_dict() | {"doubts": list(population_doubts(result))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _population_parts(result: Population) -> tuple[Table | str, ...]:
    """Return what ``print`` shows of a population: a table of its parameters, then sentences.

    The table has one row for each parameter. The sentences state the findings and the limitations.
    """
    percent = f"{100 * result.prob:g} %"
    heads = (
        "parameter",
        "unit",
        "mean",
        "U of the bar",
        "spread",
        f"spread, {percent}",
        "next machine",
    )
    rows = [_table_row(name, parameter) for name, parameter in result.parameters.items()]
    table = Table.of("Population", heads, rows, text=("unit",))
    passages: list[Table | str] = [table, PAGE["population"].format(percent=percent), ""]
    passages += population_sentences(result)
    passages += population_doubts(result)
    return tuple(passages)


def _table_row(name: str, parameter: PooledParameter) -> list[str]:
    """Return the cells of one parameter's row in the printed table of a population.

    The cells are

    - the name and the unit of the parameter;
    - the mean of the population ± U, and the part of U that is due to the instrument;
    - the spread (standard deviation from machine to machine) and its credible interval;
    - the prediction for a further machine ± U.

    U is the expanded uncertainty (k = 2). For a skewed quantity, an interval is stated instead of
    the mean ± U.
    """
    factor, unit = display_unit(parameter.unit)
    common = NO_VALUE
    if parameter.instrument_sd > 0.0:
        common = round_uncertainty(2.0 * parameter.instrument_sd * factor)[0]
    spread = parameter.spread
    stated_spread = state(spread.mean, spread.sd, spread.interval, parameter.unit)
    return [
        display_name(name),
        unit,
        _without_unit(parameter.mean, parameter.unit),
        common,
        stated_spread.value,
        stated_spread.interval,
        _without_unit(parameter.next, parameter.unit),
    ]


def _without_unit(summary: Summary, unit: str) -> str:
    """Return the mean and uncertainty of a distribution as text, without the name of the unit.

    ``unit`` is the internal unit of the distribution, such as mm/N. The numbers are converted to
    the unit that tables show, such as nm/N.
    """
    _, shown_unit = display_unit(unit)
    stated = plus_minus(summary.mean, summary.sd, summary.interval, unit)
    return stated.removesuffix(f" {shown_unit}")
