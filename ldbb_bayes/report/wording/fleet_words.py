"""Sentences on the trend of one machine, and on a population of machines."""

from __future__ import annotations

from typing import Any

from ldbb_bayes.report.wording.effect_names import first_names
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import display_name, plus_minus, ranked

__all__ = ["caveat_words", "population_doubts", "population_sentences", "trend_sentences"]

# If more campaigns than this lie outside the control limits, a sentence names only the first ones.
_MOST_JOINED = 3

_TEMPLATES = SentenceFile("fleet", JOINED=_MOST_JOINED, plus_minus=plus_minus)


@_TEMPLATES.filter
def caveat_words(caveat: Any) -> str:
    """Return one or two sentences on a limitation of the results of a trend or a population.

    A trend is the change of one machine's parameters over its campaigns; a population is a group of
    machines.
    """
    template = SENTENCES["caveats"][caveat.kind]
    return str(
        template.format(
            *caveat.values,
            names=first_names(caveat.names),
            parameters=", ".join(map(display_name, caveat.names)),
            text=caveat.text,
        )
    )


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return sentences on the trend of a machine, the most important sentence first.

    A trend is the change of one machine's parameters over its campaigns. ``trend`` is the result of
    `find_trend`. Sentences on limitations of the trend are not included.
    """
    estimates = trend.estimates
    probability_of_time = 0.0
    if trend.changed:
        change = trend.parameters[trend.most_probable]
        rows = estimates[estimates["parameter"] == trend.most_probable]
        probability_of_time = rows["change_here"].iloc[change.place]
    outside = []
    outside_rows = estimates[estimates["outside"]]
    for name, parameters in outside_rows.groupby("campaign", sort=False)["parameter"]:
        outside.append(f"{name} ({', '.join(map(display_name, parameters))})")
    return _TEMPLATES.sentences("trend_sentences", trend, probability_of_time, outside)


def population_sentences(population: Any) -> tuple[str, ...]:
    """Return sentences on a population of machines, and on machines that do not belong to it.

    ``population`` is the result of `fit_population`. For each machine that does not belong to the
    population, a sentence names the parameter in which the machine deviates most, relative to the
    scatter of the population. Sentences on the limitations of the population are not included.
    """
    most_deviating = {}
    for name in population.not_belonging:
        z_scores = population.machine[name].z
        sizes = {parameter: abs(z) for parameter, z in z_scores.items()}
        most_deviating[name] = ranked(z_scores, sizes.__getitem__)[0]
    return _TEMPLATES.sentences("population_sentences", population, most_deviating)


def population_doubts(doubts: Any) -> tuple[str, ...]:
    """Return sentences on the limitations of the results for a population of machines.

    ``doubts`` is the result of `fit_population`; its attribute ``caveats`` lists limitations. They
    matter most if the population serves as a prior for another machine.
    """
    return _TEMPLATES.sentences("population_doubts", doubts)
